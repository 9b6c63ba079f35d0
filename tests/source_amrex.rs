//! AMReX plotfiles of real runs, through their reader and through ingest, against facts that
//! independent readers found (`yt_facts.json`).

#![allow(clippy::unwrap_used)] // a test's way to fail

#[path = "support/facts.rs"]
mod facts;

use std::collections::HashMap;

use deepfield::source::{self, GridRecord, Source};
use deepfield::space::Decimal;
use serde_json::Value;

fn check_set(set: &str) {
    let Some((path, stated)) = facts::load(set, "path") else { return };
    let source = source::open(&path, None).unwrap();
    assert_eq!(source.format(), "amrex");
    check_domain(&*source, &stated);
    check_samples(&*source, &stated);
    check_blocks(&*source);
    for brick in [8, 16, 32] {
        facts::check_cache(&path, &stated, brick);
    }
}

fn floats(facts: &Value) -> Vec<f64> {
    facts.as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect()
}

fn check_domain(source: &dyn Source, facts: &Value) {
    let hierarchy = source.hierarchy();
    assert_eq!(hierarchy.domain.left().as_slice(), floats(&facts["domain_left_edge"]));
    assert_eq!(hierarchy.domain.right().as_slice(), floats(&facts["domain_right_edge"]));
    let root: Vec<u64> =
        facts["base_cells"].as_array().unwrap().iter().map(|n| n.as_u64().unwrap()).collect();
    assert_eq!(hierarchy.domain.root_cells().as_slice(), root);
    assert_eq!(hierarchy.levels.count() as u64, facts["max_level"].as_u64().unwrap() + 1);
}

/// Which of the source's fields the facts are about.
fn field(source: &dyn Source, facts: &Value) -> usize {
    let name = facts["field"].as_str().unwrap();
    source.hierarchy().fields.iter().position(|field| field.name == name).unwrap()
}

fn point(sample: &Value) -> [Decimal; 3] {
    [0, 1, 2].map(|a| Decimal::from_f64(sample["pos"][a].as_f64().unwrap()).unwrap())
}

/// Level, cell and value of every sample, by looking through all grids from the finest.
fn check_samples(source: &dyn Source, facts: &Value) {
    let mut grids = facts::grids(source);
    grids.sort_by_key(|grid| std::cmp::Reverse(grid.level));
    let mut data: HashMap<u64, Vec<f64>> = HashMap::new();
    let samples = facts["samples"].as_array().unwrap();
    assert_eq!(samples.len(), 1000);
    for sample in samples {
        let (grid, cell) = facts::find(&grids, source.hierarchy(), &point(sample)).unwrap();
        assert_eq!(Some(u64::from(grid.level)), sample["level"].as_u64(), "{sample}");
        let stated = [0, 1, 2].map(|a| i128::from(sample["cell"][a].as_i64().unwrap()));
        assert_eq!(cell, stated, "{sample}");
        let values = data
            .entry(grid.id)
            .or_insert_with(|| facts::read_whole(source, grid, field(source, facts)));
        let within = [0, 1, 2].map(|a| u32::try_from(cell[a] - grid.lo[a]).unwrap());
        assert_eq!(Some(values[offset(grid, within)]), sample["value"].as_f64(), "{sample}");
    }
}

/// Where a cell of a grid stands among its values.
fn offset(grid: &GridRecord, cell: [u32; 3]) -> usize {
    let [nx, ny, _] = grid.size.map(|n| n as usize);
    let [x, y, z] = cell.map(|i| i as usize);
    x + nx * (y + ny * z)
}

/// Blocks of grids hold the same as the whole grids.
fn check_blocks(source: &dyn Source) {
    for grid in facts::grids(source).iter().step_by(17) {
        let whole = facts::read_whole(source, grid, 0);
        let lo = grid.size.map(|n| n / 3);
        let size = [0, 1, 2].map(|a| (3 + a as u32).min(grid.size[a] - lo[a]));
        let block = source::GridBlock { lo, size };
        let mut part = vec![0.0; block.len()];
        source.read(grid, 0, block, &mut part).unwrap();
        let mut part = part.into_iter();
        for z in lo[2]..lo[2] + size[2] {
            for y in lo[1]..lo[1] + size[1] {
                for x in lo[0]..lo[0] + size[0] {
                    let expected = whole[offset(grid, [x, y, z])];
                    assert_eq!(part.next().unwrap().to_bits(), expected.to_bits());
                }
            }
        }
    }
}

#[test]
fn little_endian_doubles() {
    check_set("amrex_adv");
}

#[test]
fn big_endian_floats() {
    check_set("amrex_be32");
}
