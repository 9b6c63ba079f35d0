//! Cells narrower than pixels: what need not be read of them is found by a few rays of each tile.

// What tests share fails as a test does.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};

use deepfield::cache::{Cache, Cursor};
use deepfield::ingest::{Options, Progress, ingest};
use deepfield::render::{RenderOptions, Rendered, render};
use deepfield::scene::Scene;
use deepfield::{source, synth};

/// `one_level.toml` with 160³ cells, as a cache.
fn cache(folder: &Path) -> PathBuf {
    let recipe = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets_synthetic/one_level.toml");
    let text = std::fs::read_to_string(recipe).unwrap();
    let text = text.replace("root = [24, 20, 28]", "root = [160, 160, 160]");
    assert!(text.contains("160"));
    let recipe = synth::Recipe::parse(&text, "one_level.toml").unwrap();
    let output = synth::write(&recipe, &folder.join("output"), &mut |_, _| {}).unwrap().input;
    let cache = folder.join("one_level.dfc");
    let source = source::open(&output, None).unwrap();
    let mut quiet = |_, _, _| {};
    let mut progress = Progress::new(&mut quiet);
    ingest(source.as_ref(), &cache, &Options::default(), &mut progress).unwrap();
    cache
}

/// Two or three cells a pixel, of which each dims and shines a little.
fn picture(cache: &Path, samples: u32, tolerance: &str, threads: usize) -> Rendered {
    let text = format!(
        "[image]\nwidth = 64\nheight = 64\n[camera]\nposition = [0.45, 0.4, -2.2]\n\
         look_at = [0.45, 0.4, 0.6]\nfov = 40.0\n[render]\nsamples = {samples}\n\
         tolerance = {tolerance}\n[[volume]]\nfield = \"Density\"\nscale = \"log10\"\n\
         range = [0.1, 20.0]\ncolormap = \"magma\"\nabsorption = [[0.0, 0.0], [1.0, 2.0]]\n\
         emission = [[0.0, 0.0], [1.0, 3.0]]\n"
    );
    let scene = Scene::parse(&text, "soundings.toml").unwrap();
    let options = RenderOptions {
        memory: 256 << 20,
        threads: Some(threads),
        progress: None,
        fixed: None,
        resident: false,
    };
    render(&Cache::open(cache, Cursor::WINDOWS).unwrap(), &scene, &options).unwrap()
}

fn farthest(a: &Rendered, b: &Rendered) -> f64 {
    let pixels = a.film.pixels().iter().zip(b.film.pixels());
    pixels
        .flat_map(|(a, b)| a.iter().zip(b).map(|(a, b)| f64::from(a - b).abs()))
        .fold(0.0, f64::max)
}

#[test]
fn a_smooth_medium_of_narrow_cells_is_hardly_read() {
    let folder = tempfile::tempdir().unwrap();
    let cache = cache(folder.path());
    for samples in [1, 2] {
        let exact = picture(&cache, samples, "0.0", 2);
        // Of the bytes of the exact picture; without soundings 0.048 and 0.19.
        for (tolerance, most) in [("\"10%\"", 0.02), ("\"1%\"", 0.14)] {
            let found = picture(&cache, samples, tolerance, 2);
            let part = found.stats.bytes_read as f64 / exact.stats.bytes_read as f64;
            let (off, bound) = (farthest(&found, &exact), found.stats.error_bound.unwrap());
            eprintln!(
                "{samples}, {tolerance}: {part:.3} of the bytes, off by {off:.1e} of {bound:.1e}"
            );
            assert!(part <= most, "{samples}, {tolerance}: {part} of the bytes");
            assert!(off <= bound + exact.stats.error_bound.unwrap(), "{tolerance}: {off}, {bound}");
            assert!(bound <= found.stats.tolerance.unwrap(), "{tolerance}: {bound}");
            let alone = picture(&cache, samples, tolerance, 1);
            assert_eq!(alone.film.pixels(), found.film.pixels(), "{samples}, {tolerance}");
        }
    }
}
