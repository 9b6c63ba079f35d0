//! Readers on real runs of other codes than Enzo: levels, sums, extrema and sample points, through
//! the source and through a cache, as independent readers found them (`yt_facts.json`).

#![allow(clippy::unwrap_used)] // a test's way to fail

#[path = "support/walk.rs"]
mod walk;

use std::collections::HashMap;
use std::path::Path;

use deepfield::cache::Cache;
use deepfield::ingest::{Options, Progress, ingest};
use deepfield::render::Probe;
use deepfield::scene::Interpolation;
use deepfield::source::{self, Source};
use deepfield::space::Decimal;
use serde_json::Value;

fn check_set(set: &str, format: &str) {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data")).join(set);
    let Ok(facts) = std::fs::read_to_string(folder.join("yt_facts.json")) else {
        eprintln!("skipped: {} is not there", folder.display());
        return;
    };
    let facts: Value = serde_json::from_str(&facts).unwrap();
    let source = source::open(&folder.join(facts["path"].as_str().unwrap()), None).unwrap();
    assert_eq!(source.format(), format);
    check_domain(&*source, &facts);
    check_samples(&*source, &facts);
    check_blocks(&*source);
    check_cache(&*source, &facts);
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
    let mut grids = walk::grids(source);
    grids.sort_by_key(|grid| std::cmp::Reverse(grid.level));
    let mut data: HashMap<u64, Vec<f64>> = HashMap::new();
    let samples = facts["samples"].as_array().unwrap();
    assert_eq!(samples.len(), 1000);
    for sample in samples {
        let position = source.hierarchy().domain.position(&point(sample)).unwrap();
        let (grid, cell) = walk::leaf(source, &grids, &position).unwrap();
        assert_eq!(Some(u64::from(grid.level)), sample["level"].as_u64(), "{sample}");
        for a in 0..3 {
            let index = grid.lo[a] + i128::from(cell[a]);
            assert_eq!(index, i128::from(sample["cell"][a].as_i64().unwrap()), "{sample}");
        }
        let values =
            data.entry(grid.id).or_insert_with(|| walk::values(source, grid, field(source, facts)));
        let value = values[walk::offset(grid, cell)];
        assert_eq!(Some(value), sample["value"].as_f64(), "{sample}");
    }
}

/// Blocks of grids hold the same as the whole grids.
fn check_blocks(source: &dyn Source) {
    for grid in walk::grids(source).iter().step_by(17) {
        let whole = walk::values(source, grid, 0);
        let lo = grid.size.map(|n| n / 3);
        let size = [0, 1, 2].map(|a| (3 + a as u32).min(grid.size[a] - lo[a]));
        let block = source::GridBlock { lo, size };
        let mut part = vec![0.0; block.len()];
        source.read(grid, 0, block, &mut part).unwrap();
        let mut part = part.into_iter();
        for z in lo[2]..lo[2] + size[2] {
            for y in lo[1]..lo[1] + size[1] {
                for x in lo[0]..lo[0] + size[0] {
                    let expected = whole[walk::offset(grid, [x, y, z])];
                    assert_eq!(part.next().unwrap().to_bits(), expected.to_bits());
                }
            }
        }
    }
}

fn check_cache(source: &dyn Source, facts: &Value) {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("cache.dfc");
    let name = facts["field"].as_str().unwrap();
    let options = Options { fields: vec![name.to_owned()], ..Options::default() };
    let header = ingest(source, &target, &options, &mut Progress::new(&mut |_, _, _| {})).unwrap();
    let mut simulated = 0;
    for level in &header.levels {
        let Some(number) = level.simulation else { continue };
        let of = |key: &str| facts["levels"][number.to_string()][key].as_u64().unwrap_or(0);
        let found = (level.grids, level.cells, level.leaf_cells);
        assert_eq!(found, (of("grids"), of("cells"), of("leaf_cells")), "level {number}");
        simulated += level.leaf_cells;
    }
    assert_eq!(Some(simulated), facts["total_leaf_cells"].as_u64());
    let field = &header.fields[0];
    assert_eq!(Some(field.min), facts["leaf_min"].as_f64());
    assert_eq!(Some(field.max), facts["leaf_max"].as_f64());
    let sum = facts["sum_field_times_cell_volume"].as_f64().unwrap();
    assert!((field.sum / sum - 1.0).abs() < 1e-12, "{} instead of {sum}", field.sum);
    assert!((field.stored_sum / sum - 1.0).abs() < 1e-6, "{}", field.stored_sum);
    let cache = Cache::open(&target, 8).unwrap();
    let mut probe = Probe::new(&cache, name, Interpolation::Cell).unwrap();
    for sample in facts["samples"].as_array().unwrap() {
        let found = probe.at(&point(sample)).unwrap().unwrap();
        assert_eq!(Some(u64::from(found.level)), sample["level"].as_u64(), "{sample}");
        let value = f64::from(sample["value"].as_f64().unwrap() as f32);
        assert_eq!(found.value, value, "{sample}");
    }
}

#[test]
fn amrex_little_endian_doubles() {
    check_set("amrex_adv", "amrex");
}

#[test]
fn amrex_big_endian_floats() {
    check_set("amrex_be32", "amrex");
}
