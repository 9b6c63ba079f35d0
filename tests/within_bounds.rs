//! Pictures whose truth lies where it is easily left out of a bound: nothing beneath a brick that shows
//! something, means of a scale that is not linear, steps between a value and what is stored of it.

#![allow(clippy::unwrap_used)] // a test's way to fail

#[path = "support/data.rs"]
mod data;
#[path = "support/random.rs"]
mod random;
mod twin;

use std::path::{Path, PathBuf};

use deepfield::cache::{Cache, Cursor};
use deepfield::ingest::{Options, Progress, ingest};
use deepfield::render::{RenderOptions, Rendered, render};
use deepfield::scene::Scene;
use deepfield::space::Decimal;
use twin::memory::MemorySource;

/// From 0 to 1, without pattern.
fn noise(level: u32, [i, j, k]: [i128; 3]) -> f64 {
    let mixed = (i * 73_856_093) ^ (j * 19_349_663) ^ (k * 83_492_791) ^ i128::from(level * 7919);
    mixed.rem_euclid(10_007) as f64 / 10_007.0
}

fn ingested(source: &MemorySource, folder: &Path, name: &str, options: &Options) -> PathBuf {
    let path = folder.join(name);
    ingest(source, &path, options, &mut Progress::new(&mut |_, _, _| {})).unwrap();
    path
}

fn picture(cache: &Path, scene: &str, tolerance: &str) -> Rendered {
    let scene = Scene::parse(&scene.replace("TOLERANCE", tolerance), "test").unwrap();
    let (memory, threads) = (512 << 20, Some(1));
    let options = RenderOptions { memory, threads, progress: None, fixed: None, resident: false };
    render(&Cache::open(cache, Cursor::WINDOWS).unwrap(), &scene, &options).unwrap()
}

/// Largest difference of any channel.
fn apart(a: &Rendered, b: &Rendered) -> f64 {
    let channels = |rendered: &Rendered| -> Vec<f64> {
        rendered.film.pixels().iter().flatten().map(|&value| f64::from(value)).collect()
    };
    let pairs = channels(a).into_iter().zip(channels(b));
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// A view along x of the domain's middle, `height` high, from outside.
fn scene(middle: [f64; 3], height: f64, volume: &str) -> String {
    let eye = [middle[0] - 20.0, middle[1], middle[2]];
    format!(
        "[image]\nwidth = 48\nheight = 48\n[camera]\nposition = {eye:?}\nlook_at = {middle:?}\n\
         up = [0.0, 1.0, 0.0]\nprojection = \"orthographic\"\nheight = {height}\n[render]\n\
         samples = 1\ntolerance = TOLERANCE\n[[volume]]\nfield = \"density\"\n\
         color = [[0.0, 1.0, 1.0, 1.0]]\n{volume}"
    )
}

#[test]
fn bricks_above_dropped_cells_are_off_by_what_they_show() {
    let whole = MemorySource::new([0.0; 3], [16.0, 0.5, 0.5], [256, 8, 8], &[2]).unwrap();
    let source = whole.grid(0, [0; 3], [256, 8, 8], |cell| 1.0 + 2e-4 * noise(0, cell)).grid(
        1,
        [0; 3],
        [512, 16, 16],
        |cell| 1.0 + 2e-4 * noise(1, cell),
    );
    let folder = tempfile::tempdir().unwrap();
    let corner = |text: [&str; 3]| text.map(|t| Decimal::parse(t).unwrap());
    // Ends between two fine cells of one coarse one.
    let region = Some([corner(["0", "0", "0"]), corner(["16", "0.34375", "0.5"])]);
    let options = Options { region, brick: Some(8), ..Options::default() };
    let cache = ingested(&source, folder.path(), "void.dfc", &options);
    let volume = "scale = \"linear\"\nrange = [0.0, 500.0]\nabsorption = [[0.0, 0.0]]\n\
                  emission = [[0.0, 0.0], [0.004, 1.0], [1.0, 1.0]]\n";
    let scene = scene([8.0, 0.25, 0.25], 0.5, volume);
    let truth = picture(&cache, &scene, "0.0");
    let mut farthest = 0.0_f64;
    for tolerance in ["20.0", "\"50%\"", "\"10%\""] {
        let found = picture(&cache, &scene, tolerance);
        let (off, bound) = (apart(&found, &truth), found.stats.error_bound.unwrap());
        assert!(off <= bound, "{tolerance}: {off:e}, not {bound:e}");
        farthest = farthest.max(off);
    }
    assert!(farthest > 1.0, "nothing is shown where there is nothing: {farthest:e}");
}

#[test]
fn levels_under_symlog_are_off_by_what_its_bend_makes_of_means() {
    let whole = MemorySource::new([0.0; 3], [1.0; 3], [64; 3], &[]).unwrap();
    // A straight line, of which linear means tell nothing, and the scale bends within one cell.
    let source = whole.grid(0, [0; 3], [64; 3], |[_, y, _]| (y as f64 + 0.5) / 64.0 - 0.5);
    let folder = tempfile::tempdir().unwrap();
    let options = Options { brick: Some(8), ..Options::default() };
    let cache = ingested(&source, folder.path(), "line.dfc", &options);
    let volume = "scale = \"symlog\"\nlinthresh = 1e-3\nrange = [-0.5, 0.5]\n\
                  absorption = [[0.0, 0.0], [0.35, 0.0], [0.5, 1.0], [0.65, 0.0], [1.0, 0.0]]\n";
    let scene = scene([0.5; 3], 0.2, volume);
    let truth = picture(&cache, &scene, "0.0");
    for tolerance in ["\"20%\"", "\"5%\"", "\"1%\""] {
        let found = picture(&cache, &scene, tolerance);
        let (off, bound) = (apart(&found, &truth), found.stats.error_bound.unwrap());
        assert!(off <= bound, "{tolerance}: {off:e}, not {bound:e}");
        assert!(bound <= found.stats.tolerance.unwrap(), "{tolerance}: {bound:e}");
    }
}

#[test]
fn what_is_transparent_only_as_it_is_stored_counts() {
    let source = |value: f64| {
        let whole = MemorySource::new([0.0; 3], [1.0; 3], [16; 3], &[]).unwrap();
        whole.grid(0, [0; 3], [16; 3], move |cell| value + 0.5 * noise(0, cell).powi(64))
    };
    let folder = tempfile::tempdir().unwrap();
    // Stored as 0.3580887318, or with an error of a tenth as anything around.
    let value = 0.358_088_716_9;
    let options = Options { brick: Some(8), ..Options::default() };
    let lossy = Options { relative_error: 0.1, ..options.clone() };
    let caches = [
        (ingested(&source(value), folder.path(), "f32.dfc", &options), 0.358_088_725),
        (ingested(&source(value), folder.path(), "lossy.dfc", &lossy), value + 1e-3),
    ];
    for ((cache, step), interpolation) in
        caches.iter().flat_map(|cache| ["cell", "linear"].map(|kind| (cache, kind)))
    {
        // Opaque below the step, which no stored value need be.
        let volume = format!(
            "scale = \"linear\"\nrange = [0.0, 1.0]\nabsorption = [[0.0, 1e3], [{step}, 1e3], [{step}, 0.0], [1.0, 0.0]]\n\
             emission = [[0.0, 0.0]]\n"
        );
        let scene = scene([0.5; 3], 0.8, &volume)
            .replace("[render]\n", &format!("[render]\ninterpolation = \"{interpolation}\"\n"));
        for tolerance in ["0.0", "0.01"] {
            let found = picture(cache, &scene, tolerance);
            let truth: f64 = 1.0;
            let opacity = found.film.pixels().iter().map(|p| f64::from(p[3])).fold(1.0, f64::min);
            let (off, bound) = (truth - opacity, found.stats.error_bound.unwrap());
            assert!(off <= bound + 1e-6, "{interpolation}, {tolerance}: {off:e}, not {bound:e}");
        }
    }
}

#[test]
fn squares_that_reach_from_dropped_cells_into_kept_ones_are_off_by_what_these_show() {
    /// Rays along a pixel's edge of the truth, of which a row may lie beside an edge.
    const RAYS: u32 = 32;
    let whole = MemorySource::new([0.0; 3], [1.0; 3], [16; 3], &[]).unwrap();
    let source = whole.grid(0, [0; 3], [16; 3], |cell| 1.0 + noise(0, cell));
    let folder = tempfile::tempdir().unwrap();
    let corner = |text: [&str; 3]| text.map(|t| Decimal::parse(t).unwrap());
    // The last cells that it keeps end at x = 0.3125: from there on rays along z meet nothing.
    let region = Some([corner(["0", "0", "0"]), corner(["0.3", "1", "1"])]);
    let mut nothing = 0;
    for brick in [8, 16] {
        let options = |region, drop_below| Options {
            region,
            drop_below,
            brick: Some(brick),
            ..Options::default()
        };
        let cut = ingested(&source, folder.path(), "cut.dfc", &options(region.clone(), None));
        let holes = ingested(&source, folder.path(), "holes.dfc", &options(None, Some(1.8)));
        for (cache, x, height, absorption) in [0.3115, 0.3135, 0.3165, 0.3625]
            .into_iter()
            .flat_map(|x| [0.01, 0.1, 0.6].map(|height| (x, height)))
            .flat_map(|(x, height)| [0.0, 2.0].map(|absorption| (x, height, absorption)))
            .flat_map(|(x, h, absorption)| [&cut, &holes].map(|cache| (cache, x, h, absorption)))
        {
            let view = |samples: &str| {
                format!(
                    "[image]\nwidth = 1\nheight = 1\n[camera]\nposition = [{x}, 0.31, -1.0]\n\
                     look_at = [{x}, 0.31, 2.0]\nprojection = \"orthographic\"\nheight = {height}\n\
                     [render]\nsamples = {samples}\ntolerance = TOLERANCE\n[[volume]]\n\
                     field = \"density\"\nscale = \"linear\"\nrange = [0.0, 2.0]\n\
                     color = [[0.0, 1.0, 1.0, 1.0]]\nemission = [[0.0, 1.0], [1.0, 1.0]]\n\
                     absorption = [[0.0, {absorption}], [1.0, {absorption}]]\n"
                )
            };
            let truth = picture(cache, &view(&RAYS.to_string()), "0.0");
            for tolerance in ["0.5", "0.05"] {
                let found = picture(cache, &view("\"area\""), tolerance);
                let (off, bound) = (apart(&found, &truth), found.stats.error_bound.unwrap());
                let allowed = bound + 0.5 / f64::from(RAYS);
                assert!(off <= allowed, "{brick}, {x}, {height}, {tolerance}: {off:e}, {bound:e}");
                nothing += u32::from(found.film.largest_value() == 0.0);
            }
        }
    }
    assert!(nothing > 0, "some squares' rays meet nothing");
}
