//! Light along one ray.
//!
//! Within a cell places are f64, counted from where the ray enters the cell above; that point is
//! a double-double and reduced to the cell before it is rounded, so places are as exact at level
//! 48 as at level 0.

use super::super::double_double::DoubleDouble;
use super::super::march_cell::{Gathered, OPAQUE};
use super::super::walk::Ray;
use super::layers::{self, Along};
use super::medium::Medium;
use super::tree::Tree;

/// A tree seen through a transfer function.
#[derive(Clone, Copy)]
pub(crate) struct Scenery<'a> {
    pub(crate) tree: &'a Tree,
    pub(crate) medium: &'a Medium,
    pub(crate) is_linear: bool,
}

/// A plane between cells that the ray crosses.
#[derive(Debug, Clone, Copy)]
struct Cut {
    /// Code length from the block's entry.
    at: f64,
    axis: usize,
    /// Cells of the block's level from the domain's left edge.
    plane: i64,
}

/// A block of cells: the root grid, or the eight children of a cell.
struct Block<'a> {
    level: usize,
    lo: [i64; 3],
    size: [i64; 3],
    enter: DoubleDouble,
    leave: DoubleDouble,
    above: Option<&'a Parent<'a>>,
}

/// A cell on the way down to a block.
pub(crate) struct Parent<'a> {
    pub(crate) node: usize,
    pub(crate) index: [i64; 3],
    pub(crate) above: Option<&'a Self>,
}

/// The picture of one ray.
pub(crate) fn march(scenery: Scenery<'_>, ray: &Ray) -> Gathered {
    let mut walk = Walk { scenery, ray, gathered: Gathered::default() };
    if let Some((enter, leave)) = ray.inside(scenery.tree.root_cells) {
        let size = scenery.tree.root_cells;
        walk.block(&Block { level: 0, lo: [0; 3], size, enter, leave, above: None });
    }
    walk.gathered
}

struct Walk<'a> {
    scenery: Scenery<'a>,
    ray: &'a Ray,
    gathered: Gathered,
}

impl Walk<'_> {
    /// Walks through a block; false once nothing behind can be seen.
    fn block(&mut self, block: &Block<'_>) -> bool {
        let entry = self.ray.at(block.enter, block.level);
        let start: [f64; 3] =
            std::array::from_fn(|a| (entry[a] - DoubleDouble::from_index(block.lo[a])).to_f64());
        let slope = self.ray.direction.map(|d| d.scaled(block.level as i32).to_f64());
        let length = (block.leave - block.enter).to_f64();
        let cuts = cuts_of(block, start, slope, length);
        let mut begin: Option<&Cut> = None;
        for n in 0..=cuts.len() {
            let end = cuts.get(n);
            let from = begin.map_or(0.0, |cut| cut.at);
            let to = end.map_or(length, |cut| cut.at);
            if from < to && !self.segment(block, (start, slope), (from, to), (begin, end)) {
                return false;
            }
            begin = end;
        }
        true
    }

    /// One cell's part of a block.
    fn segment(
        &mut self,
        block: &Block<'_>,
        (start, slope): ([f64; 3], [f64; 3]),
        (from, to): (f64, f64),
        (begin, end): (Option<&Cut>, Option<&Cut>),
    ) -> bool {
        let middle = 0.5 * (from + to);
        let cell: [i64; 3] = std::array::from_fn(|a| {
            ((start[a] + slope[a] * middle).floor() as i64).clamp(0, block.size[a] - 1)
        });
        let index: [i64; 3] = std::array::from_fn(|a| block.lo[a] + cell[a]);
        let tree = self.scenery.tree;
        let node = match block.above {
            None => Some(tree.root(index)),
            Some(parent) => {
                let octant = (0..3).fold(0, |o, a| o | (cell[a] as usize) << a);
                tree.nodes[parent.node].child(octant)
            }
        };
        let Some(node) = node else { return true };
        if tree.nodes[node].child(0).is_some() {
            let parent = Parent { node, index, above: block.above };
            return self.block(&Block {
                level: block.level + 1,
                lo: index.map(|i| 2 * i),
                size: [2; 3],
                enter: begin.map_or(block.enter, |cut| self.crossing(block, cut)),
                leave: end.map_or(block.leave, |cut| self.crossing(block, cut)),
                above: Some(&parent),
            });
        }
        let place: [f64; 3] = std::array::from_fn(|a| start[a] - cell[a] as f64 + slope[a] * from);
        let leaf = Parent { node, index, above: block.above };
        self.leaf(&leaf, Along { place, slope, length: to - from });
        self.gathered.optical_depth < OPAQUE
    }

    /// Where the ray crosses a plane: one Newton step from the double's place.
    fn crossing(&self, block: &Block<'_>, cut: &Cut) -> DoubleDouble {
        let level = block.level as i32;
        let near = block.enter + DoubleDouble::from(cut.at);
        let point = self.ray.origin[cut.axis] + self.ray.direction[cut.axis] * near;
        let rest = DoubleDouble::from_index(cut.plane) - point.scaled(level);
        let slope = self.ray.direction[cut.axis].scaled(level).to_f64();
        near + DoubleDouble::from(rest.to_f64() / slope)
    }

    fn leaf(&mut self, leaf: &Parent<'_>, along: Along) {
        let Scenery { tree, medium, is_linear } = self.scenery;
        if !is_linear {
            medium.add_constant(tree.nodes[leaf.node].value(), along.length, &mut self.gathered);
            return;
        }
        along.each_half(&mut |half| {
            layers::each_piece(tree, leaf, half, &mut |value, range, length| {
                medium.add(value, range, length, &mut self.gathered);
            });
        });
    }
}

/// The planes inside a block, in the order in which the ray crosses them.
fn cuts_of(block: &Block<'_>, start: [f64; 3], slope: [f64; 3], length: f64) -> Vec<Cut> {
    let mut cuts = Vec::new();
    for axis in (0..3).filter(|a| slope[*a] != 0.0) {
        for cell in 1..block.size[axis] {
            let at = (cell as f64 - start[axis]) / slope[axis];
            if 0.0 < at && at < length {
                cuts.push(Cut { at, axis, plane: block.lo[axis] + cell });
            }
        }
    }
    cuts.sort_unstable_by(|a, b| a.at.total_cmp(&b.at));
    cuts
}
