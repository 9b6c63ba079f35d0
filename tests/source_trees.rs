//! Block trees of real runs, Athena++'s and FLASH's: through their readers and through ingest,
//! against facts that independent readers found (`yt_facts.json`).

#![allow(clippy::unwrap_used)] // a test's way to fail

#[path = "support/facts.rs"]
mod facts;

use deepfield::source::{self, GridBlock};

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
