//! Where a field is largest, found by the index.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use super::brick::{BrickPlace, RawBrick, state};
use super::codec::Decoder;
use super::digits::Precision;
use super::index::Cursor;
use super::reader::Cache;
use super::record::{BrickEntry, FieldRecord, NodeRecord};
use crate::space::Position;
use crate::{Error, Result};

/// Most bricks that are read. Few are where records tell nearly all: the brick that holds the value, and
/// those that have it as a ghost.
const MOST_READ: usize = 1000;

/// A leaf cell and its value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeafCell {
    /// Position of its level in [`super::Header::levels`].
    pub tree_level: usize,
    /// Octree level.
    pub octree: i32,
    /// Index at that level.
    pub index: [i128; 3],
    /// The value as stored.
    pub stored: f32,
}

impl LeafCell {
    /// The cell's centre.
    pub fn centre(&self, cache: &Cache) -> Position {
        cache.header().domain.cell_corner(self.octree + 1, self.index.map(|c| 2 * c + 1))
    }
}

/// The leaf cell with the largest value of field `field` among those at level `from` of the tree and
/// deeper; none where all of them are dropped or NaN, or where the index says too little to find it in
/// few bricks.
///
/// # Errors
/// A damaged cache.
pub fn largest_leaf(cache: &Cache, field: usize, from: usize) -> Result<Option<LeafCell>> {
    let root = cache.header().levels.first().map_or(0, |level| level.octree);
    let mut search = Search {
        cache,
        field,
        from,
        cursor: cache.cursor(),
        open: BinaryHeap::new(),
        decoder: Decoder::new()
            .map_err(|source| Error::io(cache.path(), "cannot set up decompression", source))?,
        brick: RawBrick::default(),
        found: None,
        read: 0,
    };
    search.add_subtree(0, BrickPlace::root(-root))?;
    while let Some(next) = search.open.pop() {
        if search.found.is_some_and(|found| next.bound <= found.stored) {
            break;
        }
        if !next.is_brick {
            search.split(&next)?;
        } else if search.read < MOST_READ {
            search.look_into(&next)?;
        } else {
            return Ok(None);
        }
    }
    Ok(search.found)
}

/// A brick, or one with all beneath it, that may hold a larger value than was found.
#[derive(Debug, Clone, Copy)]
struct Open {
    /// What no value in it is above.
    bound: f32,
    is_brick: bool,
    node: u64,
    place: BrickPlace,
}

impl Ord for Open {
    /// The largest bound first; of equal ones bricks, then the deepest.
    fn cmp(&self, other: &Self) -> Ordering {
        let key = |open: &Self| (open.is_brick, open.place.tree_level);
        self.bound
            .total_cmp(&other.bound)
            .then_with(|| key(self).cmp(&key(other)))
            .then_with(|| other.node.cmp(&self.node))
    }
}

impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Open {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Open {}

struct Search<'c> {
    cache: &'c Cache,
    field: usize,
    from: usize,
    cursor: Cursor<'c>,
    open: BinaryHeap<Open>,
    decoder: Decoder,
    brick: RawBrick,
    found: Option<LeafCell>,
    read: usize,
}

impl Search<'_> {
    fn records(&mut self, node: u64) -> Result<(NodeRecord, FieldRecord)> {
        Ok((self.cursor.node(node)?, self.cursor.field(node, self.field)?))
    }

    /// Opens a brick and what lies beneath it, if that goes deep enough.
    fn add_subtree(&mut self, node: u64, place: BrickPlace) -> Result<()> {
        let (record, described) = self.records(node)?;
        if place.tree_level + usize::from(record.depth) >= self.from {
            self.add(described.tree, false, node, place);
        }
        Ok(())
    }

    /// Opens what may hold values in `range`, if that is not empty.
    fn add(&mut self, [low, bound]: [f32; 2], is_brick: bool, node: u64, place: BrickPlace) {
        if low <= bound {
            self.open.push(Open { bound, is_brick, node, place });
        }
    }

    /// Opens a brick's own cells, and its children.
    fn split(&mut self, &Open { node, place, .. }: &Open) -> Result<()> {
        let (record, described) = self.records(node)?;
        if place.tree_level >= self.from && record.leaf_cells > 0 {
            self.add(described.own, true, node, place);
        }
        for octant in 0..8 {
            if let Some(child) = record.child(octant) {
                self.add_subtree(child, place.child(octant))?;
            }
        }
        Ok(())
    }

    /// Looks for larger values among a brick's leaf cells.
    fn look_into(&mut self, &Open { node, place, .. }: &Open) -> Result<()> {
        let (record, described) = self.records(node)?;
        let entry =
            BrickEntry { node, field: self.field, node_record: &record, field_record: &described };
        self.cache.read_brick(&entry, Precision::Full, &mut self.decoder, &mut self.brick)?;
        self.read += 1;
        let shape = self.cache.header().shape;
        let (edge, lowest) = (shape.edge(), place.lowest_cell(shape));
        let Some(own) = self.brick.blocks.first() else { return Ok(()) };
        for at in 0..shape.cells() {
            let cell = [at % edge, at / edge % edge, at / edge / edge];
            let [x, y, z] = cell.map(|c| c + 1);
            let stored = own.values[own.at(x, y, z)];
            let is_leaf = own.states[own.at(x, y, z)] == state::EXISTS;
            let is_larger = self.found.is_none_or(|found| stored > found.stored);
            if is_leaf && is_larger && !stored.is_nan() {
                let index = std::array::from_fn(|a| lowest[a] + cell[a] as i128);
                let BrickPlace { tree_level, octree, .. } = place;
                self.found = Some(LeafCell { tree_level, octree, index, stored });
            }
        }
        Ok(())
    }
}
