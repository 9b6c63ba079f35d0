//! Which cells a region drops, and how data end beside dropped ones.

#![allow(clippy::unwrap_used)] // a test's way to fail

#[path = "support/data.rs"]
mod data;
#[path = "support/random.rs"]
mod random;
mod twin;

use deepfield::cache::Cache;
use deepfield::ingest::{Options, Progress, ingest};
use deepfield::render::{Probe, RenderOptions, Rendered, render};
use deepfield::scene::{Interpolation, Scene};
use deepfield::space::Decimal;
use twin::memory::MemorySource;

/// A value for each cell of a level, without pattern.
fn noise(level: u32, [i, j, k]: [i128; 3]) -> f64 {
    let mixed = (i * 73_856_093) ^ (j * 19_349_663) ^ (k * 83_492_791) ^ i128::from(level * 7919);
    0.1 + (mixed.rem_euclid(10_007)) as f64 / 1000.0
}

/// A root grid of 8³ cells of which the box of root cells `lo` to `hi` is the domain: refined in
/// x ≥ 4, y < 6, and twice in a block in the middle.
fn source(lo: [i128; 3], hi: [i128; 3]) -> MemorySource {
    let edges = [lo, hi].map(|corner| corner.map(|c| c as f64 / 8.0));
    let cells: [u64; 3] = std::array::from_fn(|a| (hi[a] - lo[a]) as u64);
    let mut source = MemorySource::new(edges[0], edges[1], cells, &[2, 2]).unwrap();
    for (level, from, to) in
        [(0, [0, 0, 0], [8, 8, 8]), (1, [4, 0, 0], [8, 6, 8]), (2, [5, 3, 2], [7, 5, 6])]
    {
        // Root cells that are refined so far and lie in the domain, in the level's own cells.
        let factor = 1 << level;
        let first: [i128; 3] = std::array::from_fn(|a| lo[a].max(from[a]));
        let size = std::array::from_fn(|a| (factor * (hi[a].min(to[a]) - first[a])) as u32);
        let own = std::array::from_fn(|a| factor * (first[a] - lo[a]));
        let value =
            |cell: [i128; 3]| noise(level, std::array::from_fn(|a| cell[a] + factor * lo[a]));
        source = source.grid(level, own, size, value);
    }
    source
}

#[test]
fn dropped_cells_of_any_level_border_like_the_domains_edge() {
    // Beside it lie dropped cells of level 0 (lower x, upper y), and of level 1 (lower y).
    let (lo, hi) = ([4, 2, 0], [8, 6, 8]);
    let folder = tempfile::tempdir().unwrap();
    let corner = |corner: [i128; 3]| corner.map(|c| decimal(c as f64 / 8.0));
    for brick in [8, 16] {
        let cache = |name: &str, source: &MemorySource, region| {
            let path = folder.path().join(name);
            let options = Options { region, brick: Some(brick), ..Options::default() };
            ingest(source, &path, &options, &mut Progress::new(&mut |_, _, _| {})).unwrap();
            Cache::open(&path, 4).unwrap()
        };
        let region = cache("region.dfc", &source([0; 3], [8; 3]), Some([corner(lo), corner(hi)]));
        let edge = cache("edge.dfc", &source(lo, hi), None);
        let [mut region, mut edge] = [&region, &edge]
            .map(|cache| Probe::new(cache, "density", Interpolation::Linear).unwrap());
        for n in 0..4000 {
            let at = |step: f64, a: usize| {
                let share = (f64::from(n) * step).fract();
                // Half of them are close to a face.
                let share = if n % 2 == 0 {
                    share
                } else {
                    (0.02 * share + 0.98 * share.round()).min(0.9999)
                };
                decimal((lo[a] as f64 + share * (hi[a] - lo[a]) as f64) / 8.0)
            };
            let point = [at(0.618_033_98, 0), at(0.754_877_66, 1), at(0.569_840_29, 2)];
            let [a, b] = [&mut region, &mut edge].map(|probe| probe.at(&point).unwrap().unwrap());
            assert_eq!(a.level, b.level, "{point:?}");
            assert!(
                (a.value - b.value).abs() <= 1e-6 * b.value,
                "{point:?}: {} {}",
                a.value,
                b.value
            );
        }
    }
}

/// A dropped cell takes the place of a value only beside kept ones; farther off it must not widen
/// what its brick says of its values.
#[test]
fn ranges_beside_dropped_cells_are_those_of_kept_ones() {
    let value = |level: u32| move |cell: [i128; 3]| 100.0 + noise(level, cell);
    let source = MemorySource::new([0.0; 3], [1.0; 3], [16; 3], &[2, 2])
        .unwrap()
        .grid(0, [0; 3], [16; 3], value(0))
        .grid(1, [0; 3], [32; 3], value(1))
        .grid(2, [0; 3], [64; 3], value(2));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("region.dfc");
    let region = [["0.2", "0.21", "0.22"], ["0.6", "0.55", "0.57"]];
    let region = Some(region.map(|corner| corner.map(|c| Decimal::parse(c).unwrap())));
    let options = Options { region, brick: Some(8), ..Options::default() };
    ingest(&source, &path, &options, &mut Progress::new(&mut |_, _, _| {})).unwrap();
    let cache = Cache::open(&path, 4).unwrap();
    let level = cache.header().levels.iter().find(|level| level.octree == 2).unwrap();
    let mut cursor = cache.cursor();
    let records = (level.first_node..level.first_node + level.nodes)
        .map(|node| cursor.field(node, 0).unwrap())
        .filter(|record| !record.is_void());
    let lowest: Vec<f32> = records.map(|record| record.own[0]).collect();
    assert!(lowest.len() > 20 && lowest.iter().all(|least| *least >= 100.0), "{lowest:?}");
}

/// NaN is no value: between it and others there is none, and elsewhere it changes nothing.
#[test]
fn what_lies_between_nan_and_other_values_is_nan() {
    let value = |level: u32, cell: [i128; 3]| match (level, cell) {
        (0, [1, 1, 1]) | (1, [9, 4, 4]) => f64::NAN,
        _ => 2.5,
    };
    let source = MemorySource::new([0.0; 3], [8.0; 3], [8; 3], &[2])
        .unwrap()
        .grid(0, [0; 3], [8; 3], |cell| value(0, cell))
        .grid(1, [8, 0, 0], [8, 16, 16], |cell| value(1, cell));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("nan.dfc");
    let options = Options { brick: Some(8), ..Options::default() };
    ingest(&source, &path, &options, &mut Progress::new(&mut |_, _, _| {})).unwrap();
    let cache = Cache::open(&path, 4).unwrap();
    let mut linear = Probe::new(&cache, "density", Interpolation::Linear).unwrap();
    let mut at = |point: [f64; 3]| linear.at(&point.map(decimal)).unwrap().unwrap().value;
    for beside in [[2.0, 1.5, 1.5], [2.4, 1.5, 1.5], [0.6, 0.6, 2.4], [4.75, 2.0, 2.25]] {
        assert!(at(beside).is_nan(), "{beside:?}: {}", at(beside));
    }
    for apart in [[2.6, 1.5, 1.5], [1.5, 1.5, 2.55], [5.3, 2.25, 2.25], [7.1, 3.3, 7.9]] {
        assert_eq!(at(apart), 2.5, "{apart:?}");
    }
}

fn decimal(x: f64) -> Decimal {
    Decimal::from_shortest(x).unwrap()
}

#[test]
fn a_region_on_faces_keeps_the_cells_between_them() {
    // Neither the edges nor the cells are binary fractions.
    let source = MemorySource::new([-0.3, 0.1, -1.0], [0.9, 0.9, 0.6], [24, 16, 32], &[])
        .unwrap()
        .grid(0, [0; 3], [24, 16, 32], |cell| noise(0, cell));
    let folder = tempfile::tempdir().unwrap();
    let kept = |name: &str, region: [[&str; 3]; 2]| {
        let region = Some(region.map(|corner| corner.map(|c| Decimal::parse(c).unwrap())));
        let options = Options { region, ..Options::default() };
        let path = folder.path().join(name);
        let header = ingest(&source, &path, &options, &mut Progress::new(&mut |_, _, _| {}))?;
        Ok::<_, deepfield::Error>(24 * 16 * 32 - header.fields[0].dropped_cells)
    };
    let on_faces = kept("faces.dfc", [["0.0", "0.2", "-0.5"], ["0.3", "0.5", "-0.2"]]);
    assert_eq!(on_faces.unwrap(), 6 * 6 * 6);
    // What it touches stays whole, however thin it is.
    let within = kept("within.dfc", [["-0.01", "0.21", "-0.5"], ["0.31", "0.22", "-0.2"]]);
    assert_eq!(within.unwrap(), 8 * 6);
    let thin = kept("thin.dfc", [["0.02", "0.21", "-0.5"], ["0.02000000001", "0.22", "-0.2"]]);
    assert_eq!(thin.unwrap(), 6);
    for swapped in [[["0.4", "0.2", "-0.5"], ["0.3", "0.5", "-0.2"]], [["0"; 3], ["0", "1", "1"]]] {
        let refused = kept("swapped.dfc", swapped).unwrap_err().to_string();
        assert!(refused.contains("no extent along x"), "{refused}");
    }
}

/// Where a ray leaves the domain, rounding may place it beyond: also there nothing is left of what was
/// dropped, however much it would absorb. Bricks of 16³ reach beyond a domain of 8³ cells.
#[test]
fn rays_through_dropped_cells_alone_meet_nothing() {
    let source = MemorySource::new([0.0; 3], [1.0; 3], [8; 3], &[]).unwrap();
    let source = source.grid(0, [0; 3], [8; 3], |_| 1.0);
    let folder = tempfile::tempdir().unwrap();
    let region = Some([0.0, 0.25].map(|x| [x; 3].map(decimal)));
    let scene = "[image]\nwidth = 64\nheight = 64\n[camera]\nposition = [0.9, 0.02, 0.95]\n\
         look_at = [0.8, 0.5, 0.9]\nup = [0.0, 0.0, 1.0]\nfov = 20.0\n[render]\nsamples = 1\n\
         tolerance = TOLERANCE\n[[volume]]\nfield = \"density\"\nscale = \"linear\"\n\
         range = [0.0, 1.0]\ncolor = [[0.0, 1.0, 1.0, 1.0]]\nabsorption = [[0.0, 1e18]]\n\
         emission = [[0.0, 1.0]]\n";
    for brick in [8, 16] {
        let path = folder.path().join(format!("{brick}.dfc"));
        let options = Options { region: region.clone(), brick: Some(brick), ..Options::default() };
        ingest(&source, &path, &options, &mut Progress::new(&mut |_, _, _| {})).unwrap();
        let cache = Cache::open(&path, 4).unwrap();
        for tolerance in ["0.0", "0.01"] {
            let scene = scene.replace("TOLERANCE", tolerance);
            let scene = Scene::parse(&scene, "test").unwrap();
            let (memory, threads) = (512 << 20, Some(1));
            let options =
                RenderOptions { memory, threads, progress: None, fixed: None, resident: false };
            let found = render(&cache, &scene, &options).unwrap();
            assert_eq!(found.film.largest_value(), 0.0, "{brick}, {tolerance}");
        }
    }
}

/// Beside a NaN cell, which counts as the lower end of the range, values are between that and those
/// around: what shines there alone is seen, in whichever brick it lies.
#[test]
fn what_shines_between_nan_and_other_values_is_seen() {
    let scene = "[image]\nwidth = 24\nheight = 24\n[camera]\nposition = [0.3, 0.4, -2.0]\n\
         look_at = [0.31, 0.41, 0.4]\nfov = 6.0\n[render]\nsamples = 1\ntolerance = TOLERANCE\n\
         [[volume]]\nfield = \"density\"\nscale = \"linear\"\nrange = [0.1, 1.5]\nabsorption = \
         [[0.0, 0.0], [0.2, 0.0], [0.3, 500.0], [0.4, 0.0], [1.0, 0.0]]\n";
    let folder = tempfile::tempdir().unwrap();
    for nan in [[9, 12, 12], [7, 12, 12], [8, 15, 16]] {
        let source = MemorySource::new([0.0; 3], [1.0; 3], [32; 3], &[]).unwrap().grid(
            0,
            [0; 3],
            [32; 3],
            |cell| if cell == nan { f64::NAN } else { 1.0 },
        );
        for tolerance in ["0", "\"1%\""] {
            let mut pictures = Vec::new();
            for brick in [8, 16, 32] {
                let path = folder.path().join("nan.dfc");
                let options = Options { brick: Some(brick), ..Options::default() };
                ingest(&source, &path, &options, &mut Progress::new(&mut |_, _, _| {})).unwrap();
                let cache = Cache::open(&path, 4).unwrap();
                let scene = Scene::parse(&scene.replace("TOLERANCE", tolerance), "scene").unwrap();
                let options = RenderOptions {
                    memory: 256 << 20,
                    threads: Some(1),
                    progress: None,
                    fixed: None,
                    resident: false,
                };
                pictures.push(render(&cache, &scene, &options).unwrap());
            }
            let all = pictures[0].film.pixels();
            let opacity = all.iter().map(|pixel| pixel[3]).fold(0.0, f32::max);
            assert!(opacity > 0.9, "{nan:?}, {tolerance}: {opacity}");
            for Rendered { film, stats, .. } in &pictures[1..] {
                let bounds = [&pictures[0].stats, stats].map(|stats| stats.error_bound.unwrap());
                let off = film.pixels().iter().flatten().zip(all.iter().flatten());
                let off = off.map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max);
                assert!(off <= bounds[0] + bounds[1], "{nan:?}, {tolerance}: {off:e}");
            }
        }
    }
}
