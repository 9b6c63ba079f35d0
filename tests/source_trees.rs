//! Block trees of real runs, Athena++'s and FLASH's: through their readers and through ingest,
//! against facts that independent readers found (`yt_facts.json`).

#![allow(clippy::unwrap_used)] // a test's way to fail

#[path = "support/facts.rs"]
mod facts;

use std::path::Path;

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
    let path = facts::folder("athena_sph").join("sph.out1.00001.athdf");
    if !path.is_file() {
        eprintln!("skipped: {} is not there", path.display());
        return;
    }
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
