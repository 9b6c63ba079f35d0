//! Block trees of real runs, Athena++'s and FLASH's: through their readers and through ingest,
//! against facts that independent readers found (`yt_facts.json`).

#![allow(clippy::unwrap_used)] // a test's way to fail

#[path = "support/data.rs"]
mod data;
#[path = "support/facts.rs"]
mod facts;

use std::path::Path;

use deepfield::ingest::{Options, Progress, ingest};
use deepfield::source::{self, GridBlock};
use deepfield::synth::{self, Grids, Recipe};

fn check(set: &str, format: &str) {
    let Some((path, stated)) = facts::load(set, "path") else { return };
    let source = source::open(&path, None).unwrap();
    assert_eq!(source.format(), format);
    facts::check_leaves(&*source, &stated);
    for brick in [8, 16, 32] {
        facts::check_cache(&path, &stated, brick);
    }
}

#[test]
fn athena_plus_plus() {
    check("athena_nested13", "athena++");
}

#[test]
fn flash() {
    check("flash_sedov", "flash");
}

#[test]
fn what_the_runs_say_of_themselves() {
    let Some((path, stated)) = facts::load("athena_nested13", "path") else { return };
    let source = source::open(&path, None).unwrap();
    let hierarchy = source.hierarchy();
    let names: Vec<&str> = hierarchy.fields.iter().map(|f| f.name.as_str()).collect();
    assert_eq!(names, ["rho", "press", "vel1", "vel2", "vel3"]);
    assert_eq!((hierarchy.density, hierarchy.time), (Some(0), stated["meta"]["time"].as_f64()));
    assert!(hierarchy.fields.iter().all(|f| f.units.is_none() && f.to_cgs.is_none()));

    let Some((path, stated)) = facts::load("flash_sedov", "path") else { return };
    let source = source::open(&path, None).unwrap();
    let hierarchy = source.hierarchy();
    let names: Vec<&str> = hierarchy.fields.iter().map(|f| f.name.as_str()).collect();
    assert_eq!(names, ["dens", "pres", "temp", "velx"]);
    assert_eq!((hierarchy.density, hierarchy.time), (Some(0), stated["meta"]["time"].as_f64()));
    // The run's parameters say pc_unitsBase = CGS.
    assert!(hierarchy.fields.iter().all(|f| f.units.is_some() && f.to_cgs == Some(1.0)));
}

#[test]
fn curved_coordinates_are_refused_by_name() {
    let Some(path) = data::shared("data/athena_sph/sph.out1.00001.athdf") else { return };
    for format in [None, Some("athena++"), Some("Athena++")] {
        let error = source::open(&path, format).err().unwrap().to_string();
        assert!(error.contains("sph.out1.00001.athdf"), "{error}");
        assert!(error.contains("coordinates `spherical_polar`: only cartesian"), "{error}");
    }
}

#[test]
fn blocks_are_parts_of_the_whole() {
    for set in ["athena_nested13", "flash_sedov"] {
        let Some((path, _)) = facts::load(set, "path") else { return };
        let source = source::open(&path, None).unwrap();
        for grid in facts::grids(&*source).iter().step_by(101) {
            let whole = facts::read_whole(&*source, grid, 1);
            let block = GridBlock { lo: [1, 2, 3], size: [5, 4, 2] };
            let mut part = vec![0.0; block.len()];
            source.read(grid, 1, block, &mut part).unwrap();
            let at = |i: usize| whole[1 + i % 5 + 8 * (2 + i / 5 % 4 + 8 * (3 + i / 20))];
            assert_eq!(part, (0..40).map(at).collect::<Vec<_>>(), "grid {}", grid.id);
        }
    }
}

/// Writes recipe `name` of `datasets_synthetic` and checks what its reader says: leaves tile the
/// domain once, and the density in each cell is the recipe's model there.
fn check_synthetic(name: &str, format: &str) {
    let recipes = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets_synthetic");
    let text = std::fs::read_to_string(recipes.join(format!("{name}.toml"))).unwrap();
    let recipe = Recipe::parse(&text, name).unwrap();
    let model = Grids::new(&recipe).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let written = synth::write(&recipe, folder.path(), &mut |_, _| {}).unwrap();
    let source = source::open(&written.input, None).unwrap();
    assert_eq!(source.format(), format);
    let hierarchy = source.hierarchy();
    assert_eq!(hierarchy.levels.count() as u32, recipe.refinement.max_level + 1);
    // In root cells; sums of powers of two, exact as far as levels reach into a double's bits.
    let mut volume = 0.0;
    for grid in facts::grids(&*source) {
        let density = facts::read_whole(&*source, &grid, hierarchy.density.unwrap());
        volume += density.len() as f64 * (-3.0 * f64::from(grid.level)).exp2();
        let [nx, ny, _] = grid.size.map(|n| n as usize);
        for (at, value) in density.into_iter().enumerate() {
            let local = [at % nx, at / nx % ny, at / nx / ny];
            let cell = [0, 1, 2].map(|a| grid.lo[a] + local[a] as i128);
            let exact = model.model().in_cell(grid.level, cell);
            assert!((value - exact).abs() <= 1e-7 * exact, "{grid:?} {cell:?}: {value} {exact}");
        }
    }
    let roots: u64 = recipe.domain.root.iter().product();
    assert!((volume - roots as f64).abs() < 1e-9, "{volume} of {roots} root cells");
}

#[test]
fn synthetic_trees_hold_the_recipes_density_at_any_depth() {
    check_synthetic("athena13", "athena++");
    check_synthetic("flash10", "flash");
    check_synthetic("flash40", "flash");
}

/// `bytes` with the one place where `from` stands holding `to`.
fn replaced(bytes: &[u8], from: &[u8], to: &[u8]) -> Vec<u8> {
    let places: Vec<usize> =
        (0..bytes.len() - from.len()).filter(|&at| bytes[at..].starts_with(from)).collect();
    assert_eq!(places.len(), 1);
    let at = places[0];
    [&bytes[..at], to, &bytes[at + from.len()..]].concat()
}

/// Level and location of a block.
type Block = (u32, [i64; 3]);

/// The lists of Athena++ of where `blocks` lie: levels, then locations.
fn places(blocks: &[Block]) -> [Vec<u8>; 2] {
    let levels = blocks.iter().flat_map(|block| (block.0 as i32).to_be_bytes());
    let locations = blocks.iter().flat_map(|block| block.1).flat_map(i64::to_be_bytes);
    [levels.collect(), locations.collect()]
}

/// What ingest says of an Athena++ output when `change` has moved its blocks.
fn moved(change: &dyn Fn(&mut Vec<Block>)) -> String {
    let recipe = "name = \"run\"\n[domain]\nleft = [0, 0, 0]\nright = [2, 1, 1]\nroot = [16, 8, 8]\n\
        tiles = [1, 1, 1]\n[refinement]\nmax_level = 2\nseed = 1\n[[refinement.centre]]\n\
        position = [0.4, 0.4, 0.4]\nhalf_size = [4, 4, 4]\n[[density]]\nkind = \"gradient\"\n\
        value = 1.0\nslope = [0.1, 0.1, 0.1]\n[output]\nformat = \"athena++\"\nblock = [4, 4, 4]\n";
    let folder = tempfile::tempdir().unwrap();
    let recipe = Recipe::parse(recipe, "recipe").unwrap();
    let input = synth::write(&recipe, &folder.path().join("run"), &mut |_, _| {}).unwrap().input;
    let grids = facts::grids(&*source::open(&input, None).unwrap());
    let mut blocks: Vec<_> =
        grids.iter().map(|grid| (grid.level, grid.lo.map(|c| c as i64 / 4))).collect();
    let [levels, locations] = places(&blocks);
    change(&mut blocks);
    let [new_levels, new_locations] = places(&blocks);
    let bytes = replaced(&std::fs::read(&input).unwrap(), &levels, &new_levels);
    std::fs::write(&input, replaced(&bytes, &locations, &new_locations)).unwrap();
    let source = source::open(&input, None).unwrap();
    let cache = folder.path().join("cache.dfc");
    let mut quiet = |_, _, _| {};
    let done = ingest(&*source, &cache, &Options::default(), &mut Progress::new(&mut quiet));
    done.map(|_| String::new()).unwrap_or_else(|error| error.to_string())
}

#[test]
fn blocks_that_do_not_tile_the_domain_are_refused() {
    let finest = |blocks: &[Block]| blocks.iter().position(|one| one.0 == 2).unwrap();
    assert_eq!(moved(&|_| ()), "");
    // One of eight children gives way to their parent, and to the sibling beside it.
    let error = moved(&|blocks| {
        let at = finest(blocks);
        blocks[at] = (1, blocks[at].1.map(|i| i / 2));
    });
    assert!(
        error.contains("of level 1 in grid ") && error.contains("beside finer cells"),
        "{error}"
    );
    let error = moved(&|blocks| {
        let at = finest(blocks);
        blocks[at].1[0] ^= 1;
    });
    assert!(error.contains("overlaps grid") && error.contains("of the same level 2"), "{error}");
}
