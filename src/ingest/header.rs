//! What is told of a cache in its header.

use super::build::{Built, LevelCells, upper_levels};
use super::overlaps::Layout;
use super::tally::Tally;
use crate::cache::{BrickShape, CachedField, Header, TreeLevel};
use crate::source::{Hierarchy, Source, SourceField};

/// What the cache's header says before payloads are written.
pub(super) fn header(
    source: &dyn Source,
    fields: &[usize],
    shape: BrickShape,
    layout: &Layout,
    built: &Built,
) -> Header {
    let hierarchy = source.hierarchy();
    let of_source = fields.iter().map(|&field| &hierarchy.fields[field]);
    let fields = of_source.zip(&built.tallies).map(|(field, tally)| cached_field(field, tally));
    Header {
        file_bytes: 0,
        source_format: source.format().to_owned(),
        time: hierarchy.time,
        domain: hierarchy.domain.clone(),
        shape,
        levels: tree_levels(hierarchy, shape, layout, built),
        fields: fields.collect(),
        max_parent_blocks: 0,
        index_offset: 0,
        index_pages: 0,
        page_table_checksum: 0,
        checksum: 0,
    }
}

fn tree_levels(
    hierarchy: &Hierarchy,
    shape: BrickShape,
    layout: &Layout,
    built: &Built,
) -> Vec<TreeLevel> {
    let upper = upper_levels(shape, hierarchy.domain.root_cells()) as i32;
    let mut first_node = 0;
    let level = |(depth, cells): (usize, &LevelCells)| {
        let octree = depth as i32 - upper;
        let at = u32::try_from(octree).ok();
        let nodes = built.store.bricks(depth);
        first_node += nodes;
        TreeLevel {
            octree,
            simulation: at.and_then(|o| hierarchy.levels.simulation(o)).map(|l| l as u32),
            first_node: first_node - nodes,
            nodes,
            grids: at.and_then(|o| layout.grids_per_level.get(o as usize)).copied().unwrap_or(0),
            cells: cells.existing,
            leaf_cells: cells.leaf,
        }
    };
    built.cells.iter().enumerate().map(level).collect()
}

fn cached_field(field: &SourceField, tally: &Tally) -> CachedField {
    CachedField {
        name: field.name.clone(),
        units: field.units.clone(),
        to_cgs: field.to_cgs,
        exponent: tally.exponent(),
        min: tally.min,
        max: tally.max,
        smallest_positive: Some(tally.smallest_positive).filter(|least| least.is_finite()),
        sum: tally.sum.value(),
        stored_sum: tally.stored_sum.value(),
        nan_cells: tally.nan_cells,
        dropped_cells: tally.dropped_cells,
        dropped_volume: tally.dropped_volume.value(),
        dropped_sum: tally.dropped_sum.value(),
        relative_error: tally.relative_error,
        leaf_error: tally.leaf_error,
    }
}
