//! Real runs, and what independent readers found in them (`yt_facts.json`).

#![allow(dead_code)] // each test program uses a part of it
#![allow(clippy::unwrap_used)] // a test's way to fail

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use deepfield::cache::{self, Cache};
use deepfield::ingest::{Options, Progress, ingest};
use deepfield::render::Probe;
use deepfield::scene::Interpolation;
use deepfield::source::{self, GridBlock, GridRecord, Hierarchy, Source};
use deepfield::space::Decimal;
use serde_json::Value;

use crate::data::shared;

/// What to open of data set `set` (named by the facts' entry `entry`), and the facts; none, said
/// on stderr, where it is not there.
pub(crate) fn load(set: &str, entry: &str) -> Option<(PathBuf, Value)> {
    let path = shared(&format!("data/{set}/yt_facts.json"))?;
    let (folder, facts) = (path.parent().unwrap(), std::fs::read_to_string(&path).unwrap());
    let facts: Value = serde_json::from_str(&facts).unwrap();
    Some((folder.join(facts[entry].as_str().unwrap()), facts))
}

/// All grids of a source.
pub(crate) fn grids(source: &dyn Source) -> Vec<GridRecord> {
    let mut grids = Vec::new();
    let mut visit = |grid| {
        grids.push(grid);
        Ok(())
    };
    source.for_each_grid(&mut visit).unwrap();
    grids
}

/// All values of a grid.
pub(crate) fn read_whole(source: &dyn Source, grid: &GridRecord, field: usize) -> Vec<f64> {
    let block = GridBlock { lo: [0; 3], size: grid.size };
    let mut values = vec![0.0; block.len()];
    source.read(grid, field, block, &mut values).unwrap();
    values
}

/// The grid (of `grids`, finest first) whose cell holds `point`, and that cell's index on its
/// level.
pub(crate) fn find<'g>(
    grids: &'g [GridRecord],
    hierarchy: &Hierarchy,
    point: &[Decimal; 3],
) -> Option<(&'g GridRecord, [i128; 3])> {
    let position = hierarchy.domain.position(point).unwrap();
    grids.iter().find_map(|grid| {
        let octree = hierarchy.levels.octree(grid.level as usize)?;
        let cell = hierarchy.domain.cell_of(i32::try_from(octree).unwrap(), &position);
        let cells = grid.cells();
        let inside = (0..3).all(|a| (cells.lo[a]..cells.hi[a]).contains(&cell[a]));
        inside.then_some((grid, cell))
    })
}

/// The exact point of a sample.
fn point(sample: &Value) -> [Decimal; 3] {
    [0, 1, 2].map(|a| Decimal::from_f64(sample["pos"][a].as_f64().unwrap()).unwrap())
}

#[track_caller]
fn close(found: f64, stated: &Value, tolerance: f64) {
    let stated = stated.as_f64().unwrap();
    assert!((found - stated).abs() <= tolerance * stated.abs(), "{found} instead of {stated}");
}

fn level_facts(facts: &Value, what: &str) -> BTreeMap<u32, u64> {
    let levels = facts["levels"].as_object().unwrap();
    levels.iter().map(|(l, of)| (l.parse().unwrap(), of[what].as_u64().unwrap())).collect()
}

fn samples(facts: &Value) -> &[Value] {
    let samples = facts["samples"].as_array().unwrap();
    assert_eq!(samples.len(), 1000);
    samples
}

fn field(source: &dyn Source, facts: &Value) -> usize {
    let name = facts["field"].as_str().unwrap();
    source.hierarchy().fields.iter().position(|field| field.name == name).unwrap()
}

/// Compares domain, root grid and depth with the facts.
pub(crate) fn check_domain(source: &dyn Source, facts: &Value) {
    let hierarchy = source.hierarchy();
    let domain = &hierarchy.domain;
    for (found, key) in [(domain.left(), "domain_left_edge"), (domain.right(), "domain_right_edge")]
    {
        (0..3).for_each(|a| close(found[a], &facts[key][a], 0.0));
    }
    let roots = [0, 1, 2].map(|a| facts["base_cells"][a].as_u64().unwrap());
    assert_eq!(domain.root_cells(), roots);
    assert_eq!(hierarchy.levels.count() as u64, facts["max_level"].as_u64().unwrap() + 1);
}

/// Compares level, cell and value of every sample point, by looking through all grids from the
/// finest.
pub(crate) fn check_samples(source: &dyn Source, facts: &Value) {
    let field = field(source, facts);
    let mut grids = grids(source);
    grids.sort_by_key(|grid| std::cmp::Reverse(grid.level));
    let mut data: HashMap<u64, Vec<f64>> = HashMap::new();
    for sample in samples(facts) {
        let (grid, cell) = find(&grids, source.hierarchy(), &point(sample)).unwrap();
        assert_eq!(Some(u64::from(grid.level)), sample["level"].as_u64(), "{sample}");
        let stated = [0, 1, 2].map(|a| i128::from(sample["cell"][a].as_i64().unwrap()));
        assert_eq!(cell, stated, "{sample}");
        let values = data.entry(grid.id).or_insert_with(|| read_whole(source, grid, field));
        let [x, y, z] = [0, 1, 2].map(|a| (cell[a] - grid.lo[a]) as usize);
        let [nx, ny, _] = grid.size.map(|n| n as usize);
        close(values[x + nx * (y + ny * z)], &sample["value"], 0.0);
    }
}

/// Compares a source whose grids are leaves only with its facts: the domain, grids and cells of
/// each level, extrema and sum, and the level, cell and value at each sample point.
pub(crate) fn check_leaves(source: &dyn Source, facts: &Value) {
    let (hierarchy, field) = (source.hierarchy(), field(source, facts));
    let domain = &hierarchy.domain;
    check_domain(source, facts);
    let (mut counts, mut cells) = (BTreeMap::new(), BTreeMap::new());
    let (mut min, mut max, mut sum) = (f64::INFINITY, f64::NEG_INFINITY, 0.0);
    for grid in grids(source) {
        let values = read_whole(source, &grid, field);
        *counts.entry(grid.level).or_insert(0) += 1;
        *cells.entry(grid.level).or_insert(0) += values.len() as u64;
        let octree = hierarchy.levels.octree(grid.level as usize).unwrap();
        let volume = domain.cell_width(i32::try_from(octree).unwrap()).element_product();
        sum += values.iter().sum::<f64>() * volume;
        min = values.iter().copied().fold(min, f64::min);
        max = values.iter().copied().fold(max, f64::max);
    }
    assert_eq!(counts, level_facts(facts, "grids"));
    assert_eq!(cells, level_facts(facts, "leaf_cells"));
    close(min, &facts["leaf_min"], 0.0);
    close(max, &facts["leaf_max"], 0.0);
    close(sum, &facts["sum_field_times_cell_volume"], 1e-9);

    check_samples(source, facts);
}

/// Ingests a source and compares the cache with the facts: grids and leaf cells of each level,
/// extrema, sums, and level and value at each sample point.
pub(crate) fn check_cache(path: &Path, facts: &Value, brick: u32) {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("real.dfc");
    let name = facts["field"].as_str().unwrap();
    let options =
        Options { brick: Some(brick), fields: vec![name.to_owned()], ..Options::default() };
    let source = source::open(path, None).unwrap();
    let mut quiet = |_, _, _| {};
    let header =
        ingest(source.as_ref(), &target, &options, &mut Progress::new(&mut quiet)).unwrap();
    let cache = Cache::open(&target, 8).unwrap();
    assert_eq!(cache::verify(&cache, &mut |_, _| {}).unwrap().listed, []);

    let of = |count: fn(&cache::TreeLevel) -> u64| -> BTreeMap<u32, u64> {
        let levels = header.levels.iter().filter(|level| count(level) > 0);
        levels.map(|level| (level.simulation.unwrap(), count(level))).collect()
    };
    assert_eq!(of(|level| level.grids), level_facts(facts, "grids"));
    assert_eq!(of(|level| level.leaf_cells), level_facts(facts, "leaf_cells"));
    let field = &header.fields[0];
    close(field.min, &facts["leaf_min"], 0.0);
    close(field.max, &facts["leaf_max"], 0.0);
    close(field.sum, &facts["sum_field_times_cell_volume"], 1e-9);
    close(field.stored_sum, &facts["sum_field_times_cell_volume"], 1e-6);

    let mut probe = Probe::new(&cache, name, Interpolation::Cell).unwrap();
    for sample in samples(facts) {
        let found = probe.at(&point(sample)).unwrap().unwrap();
        assert_eq!(Some(u64::from(found.level)), sample["level"].as_u64(), "{sample}");
        let stated = sample["value"].as_f64().unwrap();
        assert_eq!(found.value, f64::from(stated as f32), "{sample}");
    }
}
