use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use tempfile::TempDir;

use super::testing::scene::scene;
use super::testing::tree::tree;
use super::*;

const MEBIBYTE: u64 = 1 << 20;

/// A cache of some 900 bricks at five levels, not all of them refined.
fn cache() -> (TempDir, PathBuf) {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("tree.dfc");
    tree(&[0xff, 0xff, 0xff, 0xfb], 4).write(&path);
    (folder, path)
}

fn options(memory: u64, threads: usize) -> RenderOptions<'static> {
    RenderOptions { memory, threads: Some(threads), progress: None, fixed: None, resident: false }
}

fn draw(path: &Path, scene: &Scene, memory: u64, threads: usize) -> Result<Rendered> {
    render(&Cache::open(path, 16)?, scene, &options(memory, threads))
}

fn smallest(path: &Path, scene: &Scene, threads: usize) -> u64 {
    let text = draw(path, scene, 0, threads).unwrap_err().to_string();
    let number = text.split("works is ").nth(1).and_then(|rest| rest.split("MiB").next());
    number.unwrap().parse().unwrap()
}

#[test]
fn the_picture_does_not_depend_on_threads_or_memory() {
    let (_folder, path) = cache();
    for settings in [
        "samples = 1\ntolerance = 0",
        "samples = 1\ntolerance = 0\ninterpolation = \"cell\"",
        "samples = 2\ntolerance = \"1%\"\ninterpolation = \"cell\"",
    ] {
        let scene = scene(settings, 130, 100);
        let reference = draw(&path, &scene, 4 << 30, 1).unwrap();
        assert!(reference.film.largest_value() > 0.1);
        // A tolerance needs a glance first, for which fewer digits do.
        let is_exact = settings.contains("tolerance = 0");
        let Stats { bricks_reloaded, bricks_in_other_digits, .. } = reference.stats;
        assert_eq!(bricks_reloaded, 0, "everything fits");
        assert_eq!(bricks_in_other_digits > 0, !is_exact, "{settings}");
        for threads in [1, 2] {
            let memory = smallest(&path, &scene, threads) * MEBIBYTE;
            let found = draw(&path, &scene, memory, threads).unwrap();
            assert!(found.film == reference.film, "{settings}, {threads} threads");
            let plenty = draw(&path, &scene, 4 << 30, threads).unwrap();
            assert!(plenty.film == reference.film, "{settings}, {threads} threads");
        }
    }
}

#[test]
fn a_small_pool_loads_again_and_the_counts_add_up() {
    let (_folder, path) = cache();
    let scene = scene("samples = 1\ntolerance = 0", 192, 128);
    let memory = smallest(&path, &scene, 1) * MEBIBYTE;
    let Rendered { film, stats, .. } = draw(&path, &scene, memory, 1).unwrap();
    assert!(stats.bricks_reloaded > 0);
    assert!(stats.bytes_decompressed >= 5000 * (stats.bricks_loaded + stats.bricks_reloaded));
    assert_eq!(
        stats.bricks_in_view,
        stats.bricks_loaded
            + stats.bricks_covered
            + stats.bricks_skipped_resolution
            + stats.bricks_skipped_transparent
            + stats.bricks_skipped_occluded
    );
    assert!(stats.bricks_in_view <= stats.bricks_total && stats.bricks_loaded > 500);
    assert_eq!(stats.samples, stats.levels.iter().map(|level| level.samples).sum::<u64>());
    let visited: u64 = stats.levels.iter().map(|level| level.bricks_visited).sum();
    assert_eq!((visited, stats.deepest_level_used), (stats.bricks_loaded, Some(2)));
    let json = serde_json::to_value(&stats).unwrap();
    assert!(json["levels"][0]["bricks_visited"].is_u64());
    // Tolerance 0: what remains is rounding.
    let bound = json["error_bound"].as_f64().unwrap();
    assert!(bound > 0.0 && bound <= 1e-6 * f64::from(film.largest_value()), "{bound:e}");
    assert_eq!(json["tolerance"], 0.0);
    let share = |name: &str| json["error_shares"][name].as_f64().unwrap();
    let shares = ["levels", "pixel_area", "proxies", "quadrature"].map(share);
    assert_eq!(shares, [0.0; 4]);
}

#[test]
fn one_mebibyte_below_the_smallest_limit_names_it_again() {
    let (_folder, path) = cache();
    let scene = scene("samples = 1", 100, 80);
    let named = smallest(&path, &scene, 2);
    assert!(draw(&path, &scene, named * MEBIBYTE, 2).is_ok());
    let message = draw(&path, &scene, (named - 1) * MEBIBYTE, 2).unwrap_err().to_string();
    assert!(message.contains(&format!("works is {named}MiB")), "{message}");
}

#[test]
fn a_damaged_brick_is_one_error_on_any_number_of_threads() {
    let (_folder, path) = cache();
    let mut bytes = std::fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x10;
    std::fs::write(&path, bytes).unwrap();
    let scene = scene("samples = 1\ntolerance = 0", 192, 128);
    for threads in [1, 2, 4] {
        let message = draw(&path, &scene, 1 << 30, threads).unwrap_err().to_string();
        assert!(message.contains("damaged") && message.contains("tree.dfc"), "{message}");
    }
}

#[test]
fn opaque_things_hide_what_lies_behind() {
    let (_folder, path) = cache();
    let text = scene("samples = 1\ntolerance = 0", 64, 64).source;
    let opaque = format!("{text}\nabsorption = [[0.0, 2000.0], [1.0, 2000.0]]\n");
    let scene = Scene::parse(&opaque, "test").unwrap();
    let stats = draw(&path, &scene, 1 << 30, 1).unwrap().stats;
    // The domain is 14×10×6 of the deepest bricks: their surface is a third of them.
    assert!(stats.bricks_skipped_occluded > stats.bricks_total / 5, "{stats:?}");
}

/// A pixel's ray is that of the middle one of 3×3 pixels in its place.
#[test]
fn what_lies_between_rays_is_not_loaded_and_not_missed() {
    let (_folder, path) = cache();
    let settings = "samples = 1\ntolerance = 0";
    let [few, many] = [1, 3].map(|fold| {
        let Rendered { film, stats, .. } =
            draw(&path, &scene(settings, 5 * fold, 3 * fold), 1 << 30, 1).unwrap();
        assert_eq!(film.width(), 5 * fold);
        (film, stats.bricks_loaded)
    });
    assert!(3 * few.1 < 2 * many.1, "{} of {} bricks", few.1, many.1);
    for n in 0..15 {
        let middle = (3 * (n / 5) + 1) * 15 + 3 * (n % 5) + 1;
        for (own, other) in few.0.pixels()[n].iter().zip(&many.0.pixels()[middle]) {
            assert!((own - other).abs() <= 1e-6, "pixel {n}: {own} {other}");
        }
    }
}

#[test]
fn every_tile_is_reported_once() {
    let (_folder, path) = cache();
    let seen = AtomicU64::new(0);
    let progress = |done: u64, total: u64| {
        assert!(done >= 1 && done <= total && total == 4);
        seen.fetch_add(done, Ordering::Relaxed);
    };
    let options = RenderOptions { progress: Some(&progress), ..options(1 << 30, 2) };
    let scene = scene("samples = 1", 128, 128);
    render(&Cache::open(&path, 16).unwrap(), &scene, &options).unwrap();
    assert_eq!(seen.into_inner(), 1 + 2 + 3 + 4);
}

#[test]
fn an_unknown_field_lists_those_there_are() {
    let (_folder, path) = cache();
    let other = |name: &str, more: &str| {
        let text = scene("samples = 1", 8, 8).source.replace("\"Density\"", name);
        draw(&path, &Scene::parse(&format!("{text}{more}"), "test").unwrap(), 1 << 30, 1)
    };
    let message = other("\"Temperature\"", "").unwrap_err().to_string();
    assert!(message.contains("`Temperature`") && message.contains("Density"), "{message}");
    assert!(other("\"density\"", "").is_ok());
    let message = other("\"density\"", "units = \"cgs\"\n").unwrap_err().to_string();
    assert!(message.contains("cgs"), "{message}");
}

#[test]
fn a_tolerance_is_kept_and_its_bound_holds() {
    let (_folder, path) = cache();
    for interpolation in ["linear", "cell"] {
        for samples in ["1", "2"] {
            let drawn = |tolerance: &str| {
                let text = format!(
                    "samples = {samples}\ntolerance = {tolerance}\n\
                     interpolation = \"{interpolation}\""
                );
                draw(&path, &scene(&text, 8, 6), 1 << 30, 1).unwrap()
            };
            let fine = drawn("0");
            let least = fine.stats.error_bound.unwrap();
            for tolerance in ["\"20%\"", "\"2%\"", "0.3"] {
                let Rendered { film, stats, .. } = drawn(tolerance);
                let what = format!("{interpolation}, {samples}, {tolerance}");
                let bound = stats.error_bound.unwrap();
                assert!(
                    bound > 0.0 && bound <= stats.tolerance.unwrap(),
                    "{what}: {bound} {stats:?}"
                );
                let pairs = film.pixels().iter().zip(fine.film.pixels());
                let error = pairs
                    .flat_map(|(a, b)| a.iter().zip(b))
                    .fold(0.0, |most, (a, b)| f64::max(most, f64::from((a - b).abs())));
                assert!(error <= bound + least, "{what}: {error} of {bound}");
            }
        }
    }
}

#[test]
fn a_fixed_setting_draws_what_the_scene_would() {
    let (_folder, path) = cache();
    let drawn = |text: &str, fixed: Option<FixedSetting>| {
        let options = RenderOptions { fixed, ..options(1 << 30, 1) };
        render(&Cache::open(&path, 16).unwrap(), &scene(text, 48, 32), &options).unwrap()
    };
    let fixed = |pixels_per_cell, rays_per_axis| {
        Some(FixedSetting { pixels_per_cell, rays_per_axis, relative_accuracy: 0.0 })
    };
    let other = "samples = 1\ntolerance = 1e-7";
    let exact = drawn("samples = 3\ntolerance = 0", None);
    let all_levels = drawn(other, fixed(0.0, 3));
    assert!(all_levels.film == exact.film && all_levels.stats.error_bound.is_none());
    let coarse = drawn(other, fixed(1e6, 1)).stats;
    assert!(coarse.bricks_loaded < exact.stats.bricks_loaded);
    assert!(coarse.bricks_skipped_resolution > 0);
}

#[test]
fn areas_that_no_bound_certifies_are_estimated_and_the_same_on_any_threads() {
    let (_folder, path) = cache();
    let scene = scene("samples = \"area\"\ntolerance = \"20%\"", 70, 40);
    let one = draw(&path, &scene, 256 * MEBIBYTE, 1).unwrap();
    let two = draw(&path, &scene, 64 * MEBIBYTE, 2).unwrap();
    assert!(one.film == two.film);
    let stats = &one.stats;
    assert_eq!(stats.error_bound, two.stats.error_bound);
    assert_eq!(stats.error_estimate, two.stats.error_estimate);
    let (bound, estimate) = (stats.error_bound.unwrap(), stats.error_estimate.unwrap());
    assert!(bound > stats.tolerance.unwrap(), "{bound:e}: nothing is left to rays for themselves");
    assert!(estimate > 0.0 && estimate <= 1.01 * stats.tolerance.unwrap(), "{estimate:e}");
}

#[test]
fn exact_areas_take_all_rays_that_there_are() {
    let (_folder, path) = cache();
    let drawn = |samples: &str| {
        let settings = format!("samples = {samples}\ntolerance = 0\ninterpolation = \"cell\"");
        draw(&path, &scene(&settings, 12, 8), 1 << 30, 2).unwrap()
    };
    let (area, mean) = (drawn("\"area\""), drawn("32"));
    let largest = f64::from(mean.film.largest_value());
    let pixels = area.film.pixels().iter().zip(mean.film.pixels());
    let off = pixels
        .flat_map(|(a, b)| a.iter().zip(b).map(|(a, b)| f64::from(a - b).abs()))
        .fold(0.0, f64::max);
    let stats = &area.stats;
    let (bound, estimate) = (stats.error_bound.unwrap(), stats.error_estimate.unwrap());
    assert!(off < 0.02 * largest, "{off:e} of {largest:e}");
    assert!(estimate < 0.02 * largest && estimate < 0.1 * bound, "{estimate:e}, {bound:e}");
}
