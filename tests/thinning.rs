//! Less work as the tolerance grows, within the bound: bricks drawn in fewer cells than they have, rays that
//! share what they see, and bricks that are not read since their cells are narrower than pixels.

// What tests share fails as a test does.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};

use deepfield::cache::{Cache, Cursor};
use deepfield::ingest::{Options, Progress, ingest};
use deepfield::render::{RenderOptions, Rendered, render};
use deepfield::scene::Scene;
use deepfield::{source, synth};

fn recipe(name: &str) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets_synthetic");
    std::fs::read_to_string(folder.join(name)).unwrap()
}

/// `nested13.toml` up to level 8, as a cache.
fn cache(folder: &Path) -> PathBuf {
    cache_of(folder, "nested13.toml", ["max_level = 13", "max_level = 8"])
}

/// The recipe `name`, of which `from` becomes `to`, as a cache.
fn cache_of(folder: &Path, name: &str, [from, to]: [&str; 2]) -> PathBuf {
    let text = recipe(name);
    assert!(text.contains(from));
    let recipe = synth::Recipe::parse(&text.replace(from, to), name).unwrap();
    let output = synth::write(&recipe, &folder.join("output"), &mut |_, _| {}).unwrap().input;
    let cache = folder.join("made.dfc");
    let source = source::open(&output, None).unwrap();
    let mut quiet = |_, _, _| {};
    let mut progress = Progress::new(&mut quiet);
    ingest(source.as_ref(), &cache, &Options::default(), &mut progress).unwrap();
    cache
}

/// A tile's worth of rays along the zoom.
fn picture(cache: &Path, tolerance: &str, within: (u64, usize)) -> Rendered {
    picture_of(cache, "0.01", tolerance, within)
}

/// The same in a view of so many degrees.
fn picture_of(cache: &Path, view: &str, tolerance: &str, within: (u64, usize)) -> Rendered {
    let text = recipe("nested13-zoom.toml")
        .replace("fov = 0.01", &format!("fov = {view}"))
        .replace("width = 256", "width = 64")
        .replace("height = 256", "height = 64")
        .replace("tolerance = \"1%\"", &format!("tolerance = {tolerance}"));
    assert!(text.contains("width = 64\nheight = 64\n") && text.contains(tolerance));
    assert!(text.contains(&format!("fov = {view}\n")));
    draw(cache, &text, within)
}

fn draw(cache: &Path, scene: &str, (memory, threads): (u64, usize)) -> Rendered {
    let scene = Scene::parse(scene, "scene.toml").unwrap();
    let options = RenderOptions {
        memory: memory << 20,
        threads: Some(threads),
        progress: None,
        fixed: None,
        resident: false,
    };
    render(&Cache::open(cache, Cursor::WINDOWS).unwrap(), &scene, &options).unwrap()
}

/// How far a picture is off and by how much it may be, after `truth`: no more, and within its tolerance.
fn off(found: &Rendered, truth: &Rendered, what: &str) -> [f64; 2] {
    let [bound, own] = [found, truth].map(|drawn| drawn.stats.error_bound.unwrap());
    let pixels = found.film.pixels().iter().zip(truth.film.pixels());
    let farthest = pixels
        .flat_map(|(a, b)| a.iter().zip(b).map(|(a, b)| f64::from(a - b).abs()))
        .fold(0.0, f64::max);
    assert!(farthest <= bound + own, "{what}: {farthest} of {bound}");
    assert!(bound <= found.stats.tolerance.unwrap(), "{what}: {bound}");
    [farthest, bound]
}

#[test]
fn work_falls_with_the_tolerance_and_pixels_stay_within_their_bounds() {
    let folder = tempfile::tempdir().unwrap();
    let cache = cache(folder.path());
    let truth = picture(&cache, "0.0", (1024, 2));
    let tolerances = ["\"0.01%\"", "\"1%\"", "\"10%\""];
    let samples = tolerances.map(|tolerance| {
        let found = picture(&cache, tolerance, (1024, 2));
        let levels = found.stats.error_shares.unwrap().levels;
        let [farthest, bound] = off(&found, &truth, tolerance);
        eprintln!("{tolerance}: off by {farthest:.2e} of {bound:.2e}, levels {levels:.2e}");
        // All bricks are drawn that there are: what is off is that they have fewer cells.
        assert!(levels > 0.0 || tolerance == tolerances[0], "{tolerance}");
        let little = picture(&cache, tolerance, (64, 1));
        assert!(little.film == found.film, "{tolerance}: it depends on threads or memory");
        found.stats.samples
    });
    // Few are left to save between the last two: a few for each brick on the way.
    assert!(samples[1] < samples[0] * 15 / 100, "{samples:?}");
    assert!(samples[2] < samples[0] * 11 / 100 && samples[2] < samples[1], "{samples:?}");
}

#[test]
fn rays_far_closer_than_cells_share_what_they_see() {
    let folder = tempfile::tempdir().unwrap();
    let cache = cache(folder.path());
    let views = [("0.01", "\"10%\"", 20), ("0.001", "\"1%\"", 25), ("0.0001", "\"0.1%\"", 40)];
    for (view, tolerance, share) in views {
        let truth = picture_of(&cache, view, "0.0", (1024, 2));
        let found = picture_of(&cache, view, tolerance, (1024, 2));
        let shares = found.stats.error_shares.unwrap();
        let [farthest, bound] = off(&found, &truth, view);
        eprintln!(
            "{view}: off by {farthest:.2e} of {bound:.2e}, by rays {:.2e}; samples {} of {}",
            shares.proxies, found.stats.samples, truth.stats.samples
        );
        // Rays stand for themselves: only what others have seen for them is off by where they are.
        assert!(shares.proxies > 0.0, "{view}");
        let samples = [found.stats.samples, truth.stats.samples];
        assert!(samples[0] < samples[1] * share / 100, "{view}: {samples:?}");
        let little = picture_of(&cache, view, tolerance, (64, 1));
        assert!(little.film == found.film, "{view}: it depends on threads or memory");
    }
}

/// Two or three cells a pixel, of which each dims and shines a little.
fn narrow_cells(samples: u32, tolerance: &str) -> String {
    format!(
        "[image]\nwidth = 64\nheight = 64\n[camera]\nposition = [0.45, 0.4, -2.2]\n\
         look_at = [0.45, 0.4, 0.6]\nfov = 40.0\n[render]\nsamples = {samples}\n\
         tolerance = {tolerance}\n[[volume]]\nfield = \"Density\"\nscale = \"log10\"\n\
         range = [0.1, 20.0]\ncolormap = \"magma\"\nabsorption = [[0.0, 0.0], [1.0, 2.0]]\n\
         emission = [[0.0, 0.0], [1.0, 3.0]]\n"
    )
}

#[test]
fn a_smooth_medium_of_narrow_cells_is_hardly_read() {
    let folder = tempfile::tempdir().unwrap();
    let finer = ["root = [24, 20, 28]", "root = [160, 160, 160]"];
    let cache = cache_of(folder.path(), "one_level.toml", finer);
    for samples in [1, 2] {
        let exact = draw(&cache, &narrow_cells(samples, "0.0"), (256, 2));
        // Of the bytes of the exact picture; without soundings 0.048 and 0.19.
        for (tolerance, most) in [("\"10%\"", 0.02), ("\"1%\"", 0.14)] {
            let scene = narrow_cells(samples, tolerance);
            let found = draw(&cache, &scene, (256, 2));
            let part = found.stats.bytes_read as f64 / exact.stats.bytes_read as f64;
            let [farthest, bound] = off(&found, &exact, tolerance);
            eprintln!(
                "{samples}, {tolerance}: {part:.3} of the bytes, {farthest:.1e} of {bound:.1e}"
            );
            assert!(part <= most, "{samples}, {tolerance}: {part} of the bytes");
            let little = draw(&cache, &scene, (64, 1));
            assert!(little.film == found.film, "{tolerance}: it depends on threads or memory");
        }
    }
}
