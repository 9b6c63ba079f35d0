//! The twin against pictures that an independent program made from real outputs.

#[path = "support/data.rs"]
mod data;
#[path = "support/random.rs"]
mod random;
mod support;
mod twin;

use std::path::Path;

use data::shared;
use twin::dataset::{Dataset, Precision};
use twin::picture::Picture;
use twin::scene::Scene;

/// Scenes of each output.
const SCENES: [(&str, &[&str]); 4] = [
    ("data/enzo_small/DD0010/DD0010", &["enzo_small_k1", "enzo_small_projection_z"]),
    ("data/enzo_deep13/DD0010/DD0010", &["enzo_deep13_k8", "enzo_deep13_outside"]),
    ("data/enzo_deep25/DD0021/DD0021", &["enzo_deep25_k15", "enzo_deep25_k30"]),
    ("data/enzo_offdomain/DD0001/DD0001", &["enzo_offdomain_outside"]),
];

/// A picture as little-endian f32 R, G, B, A, row by row.
fn read_reference(path: &Path, width: usize, height: usize) -> twin::Result<Picture> {
    let bytes = std::fs::read(path).map_err(|error| error.to_string())?;
    let values: Vec<f64> = bytes
        .chunks_exact(4)
        .map(|b| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])))
        .collect();
    let pixels: Vec<_> = values.chunks_exact(4).map(|p| [p[0], p[1], p[2], p[3]]).collect();
    if pixels.len() != width * height {
        return Err(format!("{}: {} pixels", path.display(), pixels.len()));
    }
    Ok(Picture { width, height, pixels })
}

fn compare(dataset: &str, scenes: &[&str]) -> twin::Result<()> {
    let Some(path) = shared(dataset) else { return Ok(()) };
    let source = deepfield::source::open(&path, None).map_err(|error| error.to_string())?;
    let dataset = Dataset::load(source.as_ref(), "Density", Precision::Source)?;
    for name in scenes {
        let Some(scene) = shared(&format!("reference/{name}.toml")) else { continue };
        let Some(pixels) = shared(&format!("reference/{name}.rgba.f32")) else { continue };
        let text = std::fs::read_to_string(&scene).map_err(|error| error.to_string())?;
        let scene = Scene::parse(&text)?;
        let reference = read_reference(&pixels, scene.image.width, scene.image.height)?;
        let difference = Picture::render(&scene, &dataset)?.difference(&reference)?;
        eprintln!("{name}: {difference:?}");
        assert!(difference.largest <= 1e-6, "{name}: {difference:?}");
    }
    Ok(())
}

#[test]
fn the_twin_draws_the_reference_pictures() -> twin::Result<()> {
    SCENES.iter().try_for_each(|(dataset, scenes)| compare(dataset, scenes))
}
