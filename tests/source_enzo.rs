//! The Enzo reader on real runs: grids and cells per level, and sample points, as independent
//! readers found them (`yt_facts.json`).

#![allow(clippy::unwrap_used)] // a test's way to fail

#[path = "support/data.rs"]
mod data;
#[path = "support/facts.rs"]
mod facts;
#[path = "support/hexadecimal.rs"]
mod hexadecimal;

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use deepfield::source::{self, GridBlock, GridRecord, Source};
use deepfield::space::Decimal;
use facts::grids;
use serde_json::Value;

fn dump(set: &str) -> Option<(PathBuf, Value)> {
    facts::load(set, "dump")
}

fn per_level(facts: &Value) -> BTreeMap<u32, u64> {
    let levels = facts.as_object().unwrap();
    levels.iter().map(|(l, n)| (l.parse().unwrap(), n.as_u64().unwrap())).collect()
}

fn check_counts(source: &dyn Source, facts: &Value) {
    let (mut counts, mut cells) = (BTreeMap::new(), BTreeMap::new());
    for grid in grids(source) {
        *counts.entry(grid.level).or_insert(0) += 1;
        *cells.entry(grid.level).or_insert(0) +=
            grid.size.iter().map(|&n| u64::from(n)).product::<u64>();
    }
    assert_eq!(counts, per_level(&facts["grids_per_level"]));
    assert_eq!(cells, per_level(&facts["cells_per_level"]));
    let hierarchy = source.hierarchy();
    assert_eq!(hierarchy.levels.count() as u64, facts["max_level"].as_u64().unwrap() + 1);
    // Some sets keep only some of the fields that the run had.
    let stated: Vec<&str> =
        facts["fields"].as_array().unwrap().iter().map(|f| f.as_str().unwrap()).collect();
    assert!(hierarchy.fields.iter().all(|f| stated.contains(&f.name.as_str())));
    assert!(hierarchy.fields.is_sorted_by_key(|f| &f.name));
    assert_eq!(hierarchy.fields[hierarchy.density.unwrap()].name, "Density");
}

/// Level, grid and cell of every sample, by looking through all grids from the finest.
fn check_samples(source: &dyn Source, facts: &Value) {
    let hierarchy = source.hierarchy();
    let mut grids = grids(source);
    grids.sort_by_key(|grid| std::cmp::Reverse(grid.level));
    let mut data: HashMap<u64, Vec<f64>> = HashMap::new();
    let samples = facts["samples"].as_array().unwrap();
    assert_eq!(samples.len(), 1000);
    for sample in samples {
        let point = [0, 1, 2].map(|a| {
            Decimal::from_f64(hexadecimal::parse(sample["pos_hex"][a].as_str().unwrap()).unwrap())
                .unwrap()
        });
        let (grid, cell) = facts::find(&grids, hierarchy, &point).unwrap();
        let cell = [0, 1, 2].map(|a| (cell[a] - grid.lo[a]) as u64);
        let stated = [0, 1, 2].map(|a| sample["ijk"][a].as_u64().unwrap());
        assert_eq!(Some(u64::from(grid.level)), sample["level"].as_u64(), "{sample}");
        assert_eq!(Some(grid.id), sample["grid_id"].as_u64(), "{sample}");
        assert_eq!(cell, stated, "{sample}");
        let values = data.entry(grid.id).or_insert_with(|| read_whole(source, grid));
        let [nx, ny, _] = grid.size.map(u64::from);
        let value = values[usize::try_from(cell[0] + nx * (cell[1] + ny * cell[2])).unwrap()];
        let stated: f64 = sample["density"].as_str().unwrap().parse().unwrap();
        assert_eq!(value.to_bits(), stated.to_bits(), "{sample}");
    }
}

fn read_whole(source: &dyn Source, grid: &GridRecord) -> Vec<f64> {
    facts::read_whole(source, grid, source.hierarchy().density.unwrap())
}

fn check_set(set: &str) {
    let Some((path, facts)) = dump(set) else { return };
    let source = source::open(&path, None).unwrap();
    check_counts(&*source, &facts);
    check_samples(&*source, &facts);
}

#[test]
fn small() {
    check_set("enzo_small");
}

#[test]
fn deep13() {
    check_set("enzo_deep13");
}

#[test]
fn deep25() {
    check_set("enzo_deep25");
}

#[test]
fn deep48() {
    check_set("enzo_deep48");
}

#[test]
fn offdomain() {
    check_set("enzo_offdomain");
}

/// A copy of a dump's files but those whose names end in `without`.
fn copy_without(path: &Path, without: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    for entry in std::fs::read_dir(path.parent().unwrap()).unwrap() {
        let entry = entry.unwrap();
        let name = entry.file_name().into_string().unwrap();
        if !name.ends_with(without) {
            std::fs::copy(entry.path(), folder.path().join(name)).unwrap();
        }
    }
    let copy = folder.path().join(path.file_name().unwrap());
    (folder, copy)
}

#[test]
fn the_text_alone_places_grids_the_same_as_far_as_its_digits_tell() {
    for set in ["enzo_deep13", "enzo_deep25", "enzo_offdomain"] {
        let Some((path, _)) = dump(set) else { return };
        let (_folder, copy) = copy_without(&path, ".hierarchy.hdf5");
        let exact = grids(&*source::open(&path, None).unwrap());
        assert_eq!(grids(&*source::open(&copy, None).unwrap()), exact, "{set}");
    }
}

#[test]
fn the_text_alone_is_refused_where_its_digits_do_not_tell() {
    let Some((path, _)) = dump("enzo_deep48") else { return };
    let (_folder, copy) = copy_without(&path, ".hierarchy.hdf5");
    let error = source::open(&copy, None)
        .and_then(|source| source.for_each_grid(&mut |_| Ok(())))
        .unwrap_err()
        .to_string();
    assert!(error.contains("DD0011.hierarchy: grid 4"), "{error}");
    assert!(error.contains("too few digits"), "{error}");
    assert!(error.contains(".hierarchy.hdf5"), "{error}");
}

#[test]
fn blocks_are_parts_of_the_whole() {
    let Some((path, _)) = dump("enzo_offdomain") else { return };
    let source = source::open(&path, None).unwrap();
    for grid in grids(&*source).iter().step_by(17) {
        let whole = read_whole(&*source, grid);
        let lo = grid.size.map(|n| n / 3);
        let size = [3, 4, 5].map(|n| n.min(grid.size[n as usize - 3] - lo[n as usize - 3]));
        let block = GridBlock { lo, size };
        let mut part = vec![0.0; block.len()];
        source.read(grid, source.hierarchy().density.unwrap(), block, &mut part).unwrap();
        let [nx, ny, _] = grid.size;
        let mut expected = Vec::new();
        for k in lo[2]..lo[2] + size[2] {
            for j in lo[1]..lo[1] + size[1] {
                for i in lo[0]..lo[0] + size[0] {
                    expected.push(whole[(i + nx * (j + ny * k)) as usize]);
                }
            }
        }
        assert_eq!(part, expected, "grid {}", grid.id);
    }
}

#[test]
fn other_kinds_of_data_are_not_taken_for_enzo() {
    for set in ["athena_nested13", "amrex_adv", "flash_sedov"] {
        if let Some(folder) = data::shared(&format!("data/{set}")) {
            let error = source::open(&folder, Some("enzo")).err().unwrap().to_string();
            assert!(error.contains("holds no Enzo dump"), "{error}");
        }
    }
}
