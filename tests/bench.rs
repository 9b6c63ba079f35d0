//! `deepfield bench` on small sets: tables that parse, errors that are right, plots, and refusals.

// What tests share fails as a test does.
#![allow(clippy::unwrap_used, clippy::panic)]

mod support;

use std::collections::HashMap;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;

use support::program::{names, run, written};
use support::{IngestOptions, ingest, synth};
use tempfile::TempDir;

/// A small cache and a scene of 32×24 pixels with `samples`.
fn cache_and_scene(samples: &str) -> (TempDir, PathBuf, PathBuf) {
    let folder = TempDir::new().unwrap();
    let dump = synth("small", folder.path()).unwrap();
    let cache = ingest(&dump, folder.path(), "small", &IngestOptions::default()).unwrap();
    let scene = format!(
        "[image]\nwidth = 32\nheight = 24\n[camera]\nposition = [0.45, 0.4, -0.9]\n\
         look_at = [0.45, 0.55, 0.4]\n[render]\nsamples = {samples}\n[[volume]]\n\
         field = \"density\"\nscale = \"log10\"\nabsorption = [[0.0, 0.0], [1.0, 20.0]]\n"
    );
    let scene = written(folder.path(), "a scene.toml", &scene);
    (folder, cache, scene)
}

/// The rows of a table, by the names of its columns.
fn table(csv: &str) -> Vec<HashMap<String, String>> {
    csv::Reader::from_reader(csv.as_bytes()).deserialize().map(Result::unwrap).collect()
}

fn number(row: &HashMap<String, String>, column: &str) -> f64 {
    row[column].parse().unwrap_or_else(|_| panic!("{column}: {row:?}"))
}

fn bench(words: &[&dyn AsRef<OsStr>]) -> support::program::Ended {
    run(&[&[&"bench" as &dyn AsRef<OsStr>], words, &[&"--threads=1"]].concat())
}

#[test]
fn the_exact_picture_has_no_error_and_looser_ones_take_no_more_than_they_should() {
    let (folder, cache, scene) = cache_and_scene("1");
    let plots = folder.path().join("made/plots");
    let list = "--tolerances=1e-1,1e-3";
    let ended = bench(&[&"tolerance", &cache, &scene, &list, &"--repeat=1", &"-o", &plots]).done();
    let rows = table(&ended);
    let tolerances: Vec<f64> = rows.iter().map(|row| number(row, "tolerance")).collect();
    assert_eq!(tolerances, [0.1, 0.001, 0.0]);
    let exact = &rows[2];
    assert_eq!((number(exact, "error"), number(exact, "tolerance_absolute")), (0.0, 0.0));
    assert_eq!(number(exact, "reference_rays"), 1.0);
    for row in &rows {
        let [seconds, bytes, samples, tolerance] =
            ["seconds", "bytes_read", "samples", "tolerance"].map(|c| number(row, c));
        assert!(seconds > 0.0 && bytes > 0.0 && samples > 0.0);
        // Whoever looks at coarse bricks first may find that nearly all finer ones are needed as
        // well: where each has eight children, an eighth more, and more where trees are ragged.
        let most = 1.3 * number(exact, "bytes_read");
        assert!(bytes <= most, "{tolerance}: {bytes} of {most}");
        // Packets take one sample a stretch, or more where that is too uncertain, cheaper ones than
        // the exact march does.
        let share = if tolerance > 0.01 { 0.7 } else { 1.5 };
        let most = number(exact, "samples") * share;
        assert!(samples <= most, "{tolerance}: {samples} of {most}");
        assert!(number(row, "error_relative") <= tolerance, "{row:?}");
        assert!(number(row, "peak_rss_bytes") > 1e6);
    }
    assert_eq!(names(&plots), ["bytes.svg", "samples.svg", "seconds.svg", "tolerance.csv"]);
    assert_eq!(std::fs::read_to_string(plots.join("tolerance.csv")).unwrap(), ended);
    for name in ["bytes", "samples", "seconds"] {
        is_a_plot(&std::fs::read_to_string(plots.join(format!("{name}.svg"))).unwrap());
    }
}

/// Every element is closed, and the axes and the legend have words.
fn is_a_plot(svg: &str) {
    assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"));
    let inside = svg.lines().skip(1).filter(|line| !line.starts_with("<svg") && *line != "</svg>");
    for line in inside.filter(|line| line.starts_with('<')) {
        assert!(line.ends_with("/>") || line.ends_with("</text>"), "{line}");
    }
    for words in ["a scene", "measured error", "exact", "largest value of the picture"] {
        assert!(svg.contains(words), "{words}: {svg}");
    }
    assert!(svg.contains("<polyline") || svg.matches("<circle").count() >= 2);
    assert!(!svg.contains("NaN"));
}

#[test]
fn the_reference_of_an_area_is_many_rays_and_tells_its_own_change() {
    let (folder, cache, scene) = cache_and_scene("\"area\"");
    let text = std::fs::read_to_string(scene).unwrap();
    let smaller = text.replace("width = 32", "width = 16").replace("height = 24", "height = 12");
    let scene = written(folder.path(), "smaller.toml", &smaller);
    let plots = format!("--output={}", folder.path().join("plots").display());
    let words = ["--tolerances=1e-2", "--repeat=2", "--fixed", "--reference-seconds=1", &plots];
    let mut arguments: Vec<&dyn AsRef<OsStr>> = vec![&"tolerance", &cache, &scene];
    arguments.extend(words.iter().map(|word| word as &dyn AsRef<OsStr>));
    let rows = table(&bench(&arguments).done());
    assert_eq!(rows.len(), 2);
    for row in &rows {
        let rays = number(row, "reference_rays");
        assert!((2.0..=64.0).contains(&rays) && rays.log2().fract() == 0.0);
        let change = number(row, "reference_change");
        assert!(change > 0.0 && change < 0.3, "{change}");
        let estimate = number(row, "error_estimate");
        assert!(estimate > 0.0 && number(row, "error") <= estimate + change, "{row:?}");
        // A rival is named only where it reaches what was measured.
        if !row["fixed_seconds"].is_empty() {
            assert!(number(row, "fixed_error") <= number(row, "error").max(change));
            let ratio = number(row, "seconds") / number(row, "fixed_seconds");
            assert!((ratio / number(row, "seconds_over_fixed") - 1.0).abs() < 1e-9);
        }
    }
}

#[test]
fn a_rival_that_is_the_exact_picture_is_found() {
    let (folder, cache, scene) = cache_and_scene("2");
    let plots = format!("--output={}", folder.path().join("plots").display());
    let words: [&dyn AsRef<OsStr>; 7] =
        [&"tolerance", &cache, &scene, &"--tolerances=1e-2", &"--fixed", &"--repeat=1", &plots];
    let rows = table(&bench(&words).done());
    assert_eq!(number(&rows[1], "fixed_error"), 0.0, "all levels, 2×2 rays, exact");
    assert_eq!(number(&rows[1], "fixed_rays_per_axis"), 2.0);
}

#[test]
fn the_exact_picture_may_be_left_out() {
    let (folder, cache, scene) = cache_and_scene("1");
    let plots = folder.path().join("plots");
    let words: [&dyn AsRef<OsStr>; 7] = [
        &"tolerance",
        &cache,
        &scene,
        &"--tolerances=1e-1,1e-2",
        &"--no-exact",
        &"--repeat=1",
        &format!("--output={}", plots.display()),
    ];
    let rows = table(&bench(&words).done());
    let tolerances: Vec<f64> = rows.iter().map(|row| number(row, "tolerance")).collect();
    assert_eq!(tolerances, [0.1, 0.01]);
    assert!(rows.iter().all(|row| number(row, "error") > 0.0), "compared with the exact picture");
    let svg = std::fs::read_to_string(plots.join("seconds.svg")).unwrap();
    assert!(svg.contains("measured error") && !svg.contains("exact"), "{svg}");
}

#[test]
fn a_plot_is_drawn_in_the_working_folder_where_none_is_named() {
    let (folder, cache, scene) = cache_and_scene("1");
    let mut bench = Command::new(env!("CARGO_BIN_EXE_deepfield"));
    bench.args(["bench", "tolerance"]).arg(&cache).arg(&scene);
    bench.args(["--tolerances=1e-1,1e-2", "--repeat=1", "--threads=1"]);
    let ended = bench.current_dir(folder.path()).output().unwrap();
    assert!(ended.status.success(), "{ended:?}");
    assert_eq!(table(&String::from_utf8(ended.stdout).unwrap()).len(), 3);
    let svg = std::fs::read_to_string(folder.path().join("a scene-tolerance.svg")).unwrap();
    assert!(svg.contains("measured error"), "{svg}");
}

#[test]
fn depths_are_compared_with_the_first() {
    let (folder, cache, scene) = cache_and_scene("1");
    let dump = synth("small", folder.path()).unwrap();
    let shallow = folder.path().join("shallow.dfc");
    run(&[&"ingest", &dump, &"-o", &shallow, &"--max-level=2"]).done();
    let words: [&dyn AsRef<OsStr>; 5] = [&"depth", &scene, &shallow, &cache, &"--repeat=2"];
    let rows = table(&bench(&words).done());
    assert_eq!([0, 1].map(|n| number(&rows[n], "deepest_level")), [2.0, 4.0]);
    assert_eq!((rows.len(), number(&rows[0], "seconds_over_first")), (2, 1.0));
    let seconds = [0, 1].map(|n| number(&rows[n], "seconds"));
    let ratio = number(&rows[1], "seconds_over_first");
    assert!((ratio / (seconds[1] / seconds[0]) - 1.0).abs() < 1e-3, "{ratio}, {seconds:?}");
    assert!(number(&rows[1], "bytes_read") > number(&rows[0], "bytes_read"));
    let more = table(&bench(&[&"depth", &scene, &cache, &"--samples=2", &"--repeat=1"]).done());
    assert!(number(&more[0], "rays") >= 3.5 * number(&rows[1], "rays"));
}

/// The scene of [`cache_and_scene`], which has the values that map to 0 and 1, with more lines.
fn with_range(folder: &Path, scene: &Path, lines: &str) -> PathBuf {
    let text = std::fs::read_to_string(scene).unwrap();
    let text = text.replace("[render]\n", &format!("[render]\n{lines}\n"));
    let text = text.replace("scale = \"log10\"", "scale = \"log10\"\nrange = [0.2, 300.0]");
    written(folder, "ranged.toml", &text)
}

#[test]
fn the_grid_of_the_deepest_level_shows_the_same_cells() {
    let (folder, cache, scene) = cache_and_scene("1");
    let scene = with_range(folder.path(), &scene, "interpolation = \"cell\"");
    let words: [&dyn AsRef<OsStr>; 6] =
        [&"covering-grid", &cache, &scene, &"--tolerance=0", &"--levels=0..4", &"--repeat=1"];
    let rows = table(&bench(&words).done());
    let data: Vec<_> = rows.iter().map(|row| (&row["data"][..], &row["level"][..])).collect();
    let grids = ["0", "1", "2", "3", "4"].map(|level| ("grid", level));
    assert_eq!(data, [&[("cache", "4"), ("levels", "4")][..], &grids].concat());
    for (row, level) in rows[2..].iter().zip(0..) {
        // The recipe's root grid.
        let cells = 20.0 * 14.0 * 18.0 * 8f64.powi(level);
        assert_eq!((number(row, "cells"), number(row, "array_bytes")), (cells, 4.0 * cells));
        for column in ["file_bytes", "loading_seconds", "render_seconds", "peak_rss_bytes"] {
            assert!(number(row, column) > 0.0);
        }
        let ratio = number(row, "file_bytes") / number(&rows[0], "file_bytes");
        assert!((number(row, "file_over_cache") / ratio - 1.0).abs() < 1e-3);
    }
    let differences: Vec<_> = rows.iter().map(|row| number(row, "difference_relative")).collect();
    // Both add up the same cells, one of them piece by piece where the other has large cells.
    assert!(differences[6] < 1e-5, "{differences:?}");
    assert!(differences[2..6].is_sorted_by(|a, b| a > b) && differences[5] > 5e-4);
    // All levels in memory are the same cells, and the same file.
    assert!(differences[1] < 1e-3, "{differences:?}");
    assert_eq!(number(&rows[1], "file_over_cache"), 1.0);
    assert!(rows[1]["array_bytes"].is_empty());
    // They are loaded before, where the cache is but opened, and drawn without a bound.
    assert!(number(&rows[1], "loading_over_cache") > 2.0, "{:?}", rows[1]);
    assert!(rows[1]["error_bound"].is_empty() && !rows[0]["error_bound"].is_empty());
}

#[test]
fn grids_are_compared_where_the_memory_has_room_from_two_cameras() {
    let (folder, cache, _) = cache_and_scene("1");
    let plots = folder.path().join("plots");
    let words: [&dyn AsRef<OsStr>; 6] =
        [&"covering-grid", &cache, &"--memory=112MiB", &"--repeat=2", &"-o", &plots];
    let csv = bench(&words).done();
    let rows = table(&csv);
    let data: Vec<_> = rows.iter().map(|row| (&row["data"][..], &row["level"][..])).collect();
    // Level 3 has 2.6 million cells: at some 32 bytes a cell the grid takes 82 MB.
    let caches = [("cache", "4"), ("levels", "4")];
    let grids = ["0", "1", "2", "3"].map(|level| ("grid", level));
    assert_eq!(data, [&caches[..], &grids, &caches, &grids].concat());
    for (half, name) in rows.chunks(6).zip(["outside", "inside"]) {
        assert!(half.iter().all(|row| row["scene"].ends_with(&format!("{name}.toml"))));
        assert!(number(&half[1], "difference_relative") < 0.05, "{:?}", half[1]);
        for row in &half[2..] {
            assert!(number(row, "difference_relative") > 1e-3, "{row:?}");
            assert!(number(row, "array_seconds") < number(row, "loading_seconds"), "{row:?}");
            let parts = number(row, "loading_seconds") + number(row, "render_seconds");
            assert!(number(row, "seconds") >= parts - 1e-9, "{row:?}");
        }
    }
    let written =
        ["1-outside.svg", "2-inside.svg", "covering-grid.csv", "inside.toml", "outside.toml"];
    assert_eq!(names(&plots), written);
    assert!(rows.iter().all(|row| Path::new(&row["scene"]).is_file()), "scenes that can be used");
    assert_eq!(std::fs::read_to_string(plots.join("covering-grid.csv")).unwrap(), csv);
}

#[test]
fn the_cameras_of_covering_grids_show_something() {
    let folder = TempDir::new().unwrap();
    for name in ["small", "deep25"] {
        let dump = synth(name, folder.path()).unwrap();
        let cache = ingest(&dump, folder.path(), name, &IngestOptions::default()).unwrap();
        let made = folder.path().join(format!("made-{name}"));
        let words: [&dyn AsRef<OsStr>; 7] =
            [&"covering-grid", &cache, &"--level=0", &"--repeat=1", &"--size=96x54", &"-o", &made];
        bench(&words).done();
        for view in ["inside", "outside"] {
            let picture = folder.path().join("picture.exr");
            let scene = made.join(format!("{view}.toml"));
            run(&[&"render", &cache, &scene, &"-o", &picture, &"--size=96x54"]).done();
            let (_, _, pixels) = support::read_exr(&picture).unwrap();
            let light = pixels.iter().map(|[r, g, b, _]| f64::from(r + g + b)).collect::<Vec<_>>();
            let most = light.iter().copied().fold(0.0, f64::max);
            let deviation = deviation(&light);
            assert!(deviation > 0.02 * most && most > 0.1, "{name} {view}: {deviation} of {most}");
        }
    }
}

/// The standard deviation.
fn deviation(values: &[f64]) -> f64 {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count).sqrt()
}

#[test]
fn covering_grids_that_cannot_be_compared_are_refused() {
    let (folder, cache, scene) = cache_and_scene("1");
    let ranged = with_range(folder.path(), &scene, "");
    let absent = folder.path().join("absent");
    let refused = |words: &[&dyn AsRef<OsStr>], what: &str| {
        let line = bench(&[&[&"covering-grid" as &dyn AsRef<OsStr>], words].concat()).failed();
        assert!(line.contains(what), "{line}");
    };
    refused(&[&absent, &ranged], "absent");
    refused(&[&cache, &absent], "absent");
    refused(&[&cache, &scene], "without `range`");
    refused(&[&cache, &ranged, &"--level=5"], "the deepest level");
    refused(&[&cache, &ranged, &"--level=4", &"--memory=64MiB"], "raise --memory");
    refused(&[&cache, &ranged, &"--memory=64KiB"], "raise --memory");
    for (option, name) in [("--tolerance=much", "--tolerance"), ("--samples=0", "--samples")] {
        let told = bench(&[&"covering-grid", &cache, &ranged, &option]).misused();
        assert!(told.contains(name), "{told}");
    }
    refused(&[&cache, &ranged, &"-o", &scene], "a scene.toml");
    for level in ["--level=", "--level=3..1", "--level=-1", "--level=0..."] {
        assert_eq!(bench(&[&"covering-grid", &cache, &ranged, &level]).code, Some(2), "{level}");
    }
    let dump = synth("small", folder.path()).unwrap();
    let holed = folder.path().join("holed.dfc");
    run(&[&"ingest", &dump, &"-o", &holed, &"--drop-below=1.0"]).done();
    refused(&[&holed, &ranged], "were dropped");
}

#[test]
fn reading_is_compared_with_plain_reading_in_every_layout() {
    let folder = TempDir::new().unwrap();
    let recipe = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets_synthetic/flash10.toml");
    let formats = ["enzo", "amrex", "athena++", "flash", "athena"];
    let made = formats.map(|format| {
        let output = folder.path().join(format);
        let said = run(&[&"synth", &recipe, &"--format", &format, &"-o", &output]).done();
        let (path, facts) = said.split_once(": ").unwrap();
        let cells = facts.split(", ").find_map(|fact| fact.strip_suffix(" cells")).unwrap();
        (PathBuf::from(path), cells.parse::<f64>().unwrap())
    });
    let mut words: Vec<&dyn AsRef<OsStr>> = vec![&"reading", &"--repeat=2"];
    words.extend(made.iter().map(|(path, _)| path as &dyn AsRef<OsStr>));
    let rows = table(&bench(&words).done());
    assert_eq!(rows.len(), formats.len());
    for ((row, format), (path, cells)) in rows.iter().zip(formats).zip(&made) {
        assert_eq!((&row["format"][..], Path::new(&row["input"])), (format, path.as_path()));
        let values = number(row, "values");
        match format {
            // Parents are stored too, which are no part of the solution.
            "flash" => assert!(values < 2.0 * cells && values > 1.5 * cells, "{row:?}"),
            // A velocity has all its components.
            "athena" => assert_eq!(values, 4.0 * cells),
            _ => assert_eq!(values, 2.0 * cells),
        }
        // Nothing is stored as less than a 32-bit float.
        assert!(number(row, "bytes") > 4.0 * values, "{row:?}");
        let times = ["plain_seconds", "seconds"].map(|column| number(row, column));
        assert!(times[0] > 0.0 && times[1] > times[0] / 10.0, "{row:?}");
        assert_eq!(number(row, "files") > 1.0, ["amrex", "athena"].contains(&format));
    }
}

#[test]
fn data_of_growing_size_are_made_ingested_drawn_and_removed() {
    let (folder, cache, _) = cache_and_scene("1");
    let scene = "[image]\nwidth = 24\nheight = 16\n[camera]\nposition = [2.6, 1.7, -1.7]\n\
                 look_at = [0.6, 0.55, 0.65]\nfov = 34.0\n[render]\nsamples = 1\n[[volume]]\n\
                 field = \"density\"\nscale = \"log10\"\nrange = [0.1, 1000.0]\n";
    let scene = written(folder.path(), "view.toml", scene);
    let (rooms, plots) = (folder.path().join("rooms"), folder.path().join("plots"));
    std::fs::create_dir(&rooms).unwrap();
    let words: [&dyn AsRef<OsStr>; 9] = [
        &"scaling",
        &"--scales=0.1,0.2",
        &"--scene",
        &scene,
        &"--folder",
        &rooms,
        &"--repeat=1",
        &"-o",
        &plots,
    ];
    let csv = bench(&words).done();
    let rows = table(&csv);
    assert_eq!(rows.len(), 2);
    for column in ["source_bytes", "leaf_cells", "bricks", "cache_bytes"] {
        assert!(number(&rows[1], column) > 2.0 * number(&rows[0], column), "{column}: {rows:?}");
    }
    for row in &rows {
        assert_eq!(number(row, "levels"), 14.0);
        let parts =
            ["hierarchy", "cells", "write"].map(|p| number(row, &format!("ingest_{p}_seconds")));
        // Rounded to hundredths each.
        assert!((parts.iter().sum::<f64>() - number(row, "ingest_seconds")).abs() < 0.1, "{row:?}");
        for column in ["ingest_peak_rss_bytes", "view_seconds", "view_peak_rss_bytes"] {
            assert!(number(row, column) > 0.0, "{column}: {row:?}");
        }
        assert!(number(row, "view_open_seconds") < number(row, "view_seconds"));
        assert!((0.0..=1.0).contains(&number(row, "view_wait_share")), "{row:?}");
    }
    assert_eq!(names(&rooms), [""; 0], "something is left");
    assert_eq!(names(&plots), ["memory.svg", "scaling.csv", "seconds.svg"]);
    assert_eq!(std::fs::read_to_string(plots.join("scaling.csv")).unwrap(), csv);
    // A cache has no source, and a camera outside and one inside.
    let rows = table(&bench(&[&"scaling", &cache, &"--repeat=1"]).done());
    assert_eq!((&rows[0]["source_bytes"][..], &rows[0]["ingest_seconds"][..]), ("", ""));
    assert!(number(&rows[0], "outside_seconds") > 0.0 && number(&rows[0], "inside_seconds") > 0.0);
    for (list, what) in [("--scales=1,,2", "--scales"), ("--scales=-1", "--scales")] {
        assert!(bench(&[&"scaling", &list]).misused().contains(what));
    }
}

#[test]
fn what_cannot_be_measured_is_one_clear_line() {
    let (folder, cache, scene) = cache_and_scene("1");
    let refused = |words: &[&dyn AsRef<OsStr>], what: &str| {
        let line = bench(words).failed();
        assert!(line.contains(what), "{line}");
    };
    for list in ["", "0", "1e-2,,1e-3", "-1", "nan", "2", "101%"] {
        let list = format!("--tolerances={list}");
        let told = bench(&[&"tolerance", &cache, &scene, &list]).misused();
        assert!(told.contains("--tolerances"), "{told}");
    }
    let (absent, not_toml) = (folder.path().join("absent"), written(folder.path(), "x", "[["));
    refused(&[&"tolerance", &absent, &scene], "absent");
    refused(&[&"tolerance", &cache, &absent], "absent");
    refused(&[&"tolerance", &cache, &not_toml], "x");
    refused(&[&"tolerance", &cache, &scene, &"--memory=1MiB"], "smallest that works");
    refused(&[&"tolerance", &cache, &scene, &"-o", &not_toml], "x");
    refused(&[&"depth", &scene, &cache, &absent], "absent");
    let told = bench(&[&"depth", &scene, &cache, &"--tolerance=much"]).misused();
    assert!(told.contains("--tolerance"), "{told}");
    refused(&[&"reading", &absent], "absent");
    refused(&[&"reading", &not_toml], "of no known format: enzo");
    assert_eq!(bench(&[&"depth", &scene]).code, Some(2));
    assert_eq!(bench(&[&"tolerance", &cache, &scene, &"--repeat=0"]).code, Some(2));
    assert_eq!(bench(&[]).code, Some(2));
}

#[test]
fn the_depth_recipes_differ_in_depth_alone() {
    let recipes = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets_synthetic");
    let read = |depth: u32| {
        let text = std::fs::read_to_string(recipes.join(format!("depth{depth}.toml"))).unwrap();
        let deepest = format!("max_level = {depth}\n");
        assert!(text.contains(&deepest));
        let rest = text.replace(&deepest, "");
        let kept =
            rest.lines().filter(|line| !line.starts_with("name =") && !line.starts_with('#'));
        kept.map(String::from).collect::<Vec<_>>()
    };
    for depth in [3, 13, 25] {
        assert_eq!(read(depth), read(48));
    }
}
