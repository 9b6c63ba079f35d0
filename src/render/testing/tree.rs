//! Hand-made trees for tests, in memory and as caches.

use std::path::Path;

use super::scene::domain;
use crate::Result;
use crate::atomic_file::AtomicFile;
use crate::cache::{
    BrickPlace, BrickShape, CachedField, Encoder, FieldRecord, Header, NodeRecord, RawBrick,
    TreeLevel, Writer, state,
};
use crate::render::plan::tree_walk::Index;

/// A hand-made tree: nodes in the order of their levels.
#[derive(Clone)]
pub(crate) struct Tree {
    pub(crate) nodes: Vec<(NodeRecord, FieldRecord)>,
    places: Vec<BrickPlace>,
    levels: Vec<TreeLevel>,
}

impl Index for Tree {
    fn records(&mut self, node: u64) -> Result<(NodeRecord, FieldRecord)> {
        Ok(self.nodes[usize::try_from(node).unwrap()])
    }
}

/// Bricks of 8³ cells over a root grid of 20×12×28: the root lies two levels above it. Each brick
/// has the children that `masks` says in turn, as far as they touch the domain.
pub(crate) fn tree(masks: &[u8], depth: usize) -> Tree {
    let mut tree = Tree { nodes: Vec::new(), places: Vec::new(), levels: Vec::new() };
    let mut places = vec![BrickPlace { tree_level: 0, octree: -2, coordinates: [0; 3] }];
    let mut origins = vec![(0u64, 0u8)];
    for level in 0..=depth {
        if places.is_empty() {
            break;
        }
        let octree = i32::try_from(level).unwrap() - 2;
        let first_node = tree.nodes.len() as u64;
        tree.levels.push(TreeLevel {
            octree,
            simulation: u32::try_from(octree).ok(),
            first_node,
            nodes: places.len() as u64,
            grids: 0,
            cells: 0,
            leaf_cells: 0,
        });
        let (mut next, mut next_origins) = (Vec::new(), Vec::new());
        for (place, (parent, octant)) in places.iter().zip(&origins) {
            let node = tree.nodes.len();
            let first_child = first_node + (places.len() + next.len()) as u64;
            let wanted = masks[node % masks.len()];
            let mut record =
                NodeRecord { octant: *octant, parent: *parent, ..NodeRecord::default() };
            for octant in 0..8 {
                let child = place.child(octant);
                if level < depth && wanted >> octant & 1 == 1 && in_domain(&child) {
                    record.child_mask |= 1 << octant;
                    next.push(child);
                    next_origins.push((node as u64, octant));
                    record.first_child = first_child;
                }
            }
            // No level says anything of the next: all of the range may be beneath.
            let differs = if record.child_mask == 0 { 0.0 } else { 1.0 };
            let field = FieldRecord {
                own: [0.1, 0.9],
                tree: [0.1, 0.9],
                residual_linear: differs,
                residual_log10: differs,
                errors: [-8f32, -12.0, -16.0].map(f32::exp2),
                ..FieldRecord::default()
            };
            tree.nodes.push((record, field));
            tree.places.push(*place);
        }
        (places, origins) = (next, next_origins);
    }
    tree.count_descendants();
    tree
}

fn in_domain(place: &BrickPlace) -> bool {
    let corner = domain().cell_corner(place.octree, place.coordinates.map(|c| c * 8));
    (0..3).all(|a| corner.0[a] < domain().upper().0[a])
}

impl Tree {
    fn count_descendants(&mut self) {
        for node in (0..self.nodes.len()).rev() {
            let record = self.nodes[node].0;
            let children = (0..8).filter_map(|octant| record.child(octant));
            let below = |child: u64| self.nodes[usize::try_from(child).unwrap()].0.descendants + 1;
            self.nodes[node].0.descendants = children.clone().map(below).sum();
            let deeper = |child: u64| self.nodes[usize::try_from(child).unwrap()].0.depth + 1;
            self.nodes[node].0.depth = children.map(deeper).max().unwrap_or(0);
        }
    }

    pub(crate) fn header(&self) -> Header {
        let field = CachedField {
            name: "Density".to_owned(),
            units: None,
            to_cgs: None,
            exponent: 0,
            min: 0.0,
            max: 1.0,
            smallest_positive: Some(0.1),
            sum: 0.0,
            stored_sum: 0.0,
            nan_cells: 0,
            dropped_cells: 0,
            dropped_volume: 0.0,
            dropped_sum: 0.0,
            relative_error: 0.0,
            leaf_error: 0.0,
        };
        Header {
            file_bytes: 0,
            source_format: String::new(),
            time: None,
            domain: domain(),
            shape: BrickShape::new(8).unwrap(),
            levels: self.levels.clone(),
            fields: vec![field],
            max_parent_blocks: 1,
            index_offset: 0,
            index_pages: 0,
            page_table_checksum: 0,
            checksum: 0,
        }
    }

    pub(crate) fn nodes(&self) -> u64 {
        self.nodes.len() as u64
    }

    /// Writes the tree as a cache with some value in every cell.
    pub(crate) fn write(&mut self, path: &Path) {
        let file = AtomicFile::create(path).unwrap();
        let mut writer = Writer::new(path, file, &self.header()).unwrap();
        let mut encoder = Encoder::new().unwrap();
        let mut brick = RawBrick::default();
        for node in 0..self.nodes.len() {
            let (record, field) = &mut self.nodes[node];
            fill(&mut brick, &self.places[node], record);
            let stored = encoder.encode(&brick).unwrap();
            writer.payload(node as u64, 0, &stored, field).unwrap();
        }
        let records = |node: u64, fields: &mut Vec<FieldRecord>| {
            let (record, field) = self.nodes[usize::try_from(node).unwrap()];
            fields.push(field);
            Ok(record)
        };
        writer.finish(self.header(), records).unwrap();
    }
}

/// A payload without holes, and its counts.
fn fill(brick: &mut RawBrick, place: &BrickPlace, record: &mut NodeRecord) {
    let shape = BrickShape::new(8).unwrap();
    *brick = RawBrick::default();
    brick.fit(shape, 1);
    let (lowest, block) = (place.lowest_cell(shape), &mut brick.blocks[0]);
    (record.existing_cells, record.refined_cells) = (0, 0);
    for cell in (0..1000usize).map(|n| [n % 10, n / 10 % 10, n / 100]) {
        let global: [i128; 3] = std::array::from_fn(|a| lowest[a] + cell[a] as i128 - 1);
        let corner = domain().cell_corner(place.octree, global);
        let at = block.at(cell[0], cell[1], cell[2]);
        if !domain().contains(&corner) {
            block.states[at] = state::OUTSIDE;
            continue;
        }
        let wave = (7 * global[0] + 13 * global[1] + 29 * global[2]).rem_euclid(17) as f32;
        block.values[at] = (0.1 + 0.8 * wave / 17.0).clamp(0.1, 0.9);
        block.states[at] = state::EXISTS;
        if cell.iter().all(|c| (1..9).contains(c)) {
            let octant = (0..3).fold(0, |octant, a| octant | u8::from(cell[a] > 4) << a);
            let refined = record.child_mask >> octant & 1;
            block.states[at] |= refined * state::REFINED;
            record.existing_cells += 1;
            record.refined_cells += u32::from(refined);
        }
    }
}
