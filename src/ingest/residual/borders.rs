//! Cells beside borders: the ranges of the values that interpolants draw on there.

use crate::cache::{Block, RawBrick, state};

/// What lies around cells beside borders of levels, of holes and of the domain.
#[derive(Debug, Default)]
pub(super) struct Borders {
    /// Around each cell of the brick's own block, and of its parent's.
    around: [Around; 2],
    /// [least, most] stored value that either interpolant draws on, for each cell beside a border.
    ranges: Vec<[f32; 2]>,
}

impl Borders {
    /// Forgets the cells of the last brick.
    pub(super) fn clear(&mut self) {
        self.ranges.clear();
    }

    /// Looks at a brick's own block and its parent's.
    pub(super) fn look_at(&mut self, raw: &RawBrick) {
        for (around, block) in self.around.iter_mut().zip(&raw.blocks) {
            around.look_at(block);
        }
    }

    /// Whether a cell, counted from the brick's lowest, and its parent have only cells around
    /// them that exist.
    pub(super) fn is_inside(&self, raw: &RawBrick, cell: [usize; 3]) -> bool {
        let places = places(raw, cell);
        (0..2).all(|up| self.around[up].kinds[places[up]] & Around::ABSENT == 0)
    }

    /// Adds a cell beside a border: what both interpolants draw on are the cells around it on
    /// both levels and, while there are holes among those, the parents' of these and theirs
    /// around.
    pub(super) fn add(&mut self, raw: &RawBrick, cell: [usize; 3]) {
        let mut range = [f32::INFINITY, f32::NEG_INFINITY];
        let places = places(raw, cell);
        for (around, place) in self.around.iter().zip(places) {
            widen(&mut range, [around.least[place], around.most[place]]);
        }
        if self.around[1].kinds[places[1]] & Around::HOLE != 0 {
            further_up(raw, cell.map(|c| c / 2 + 1), &mut range);
        }
        self.ranges.push(range);
    }

    /// The largest of all cells' ranges, of values mapped by `scale`, which never falls.
    pub(super) fn spread(&self, scale: impl Fn(f32) -> f64) -> f64 {
        let spreads = self.ranges.iter().map(|&[least, most]| scale(most) - scale(least));
        spreads.fold(0.0, f64::max)
    }
}

/// Where a cell and its parent stand in their blocks.
fn places(raw: &RawBrick, [x, y, z]: [usize; 3]) -> [usize; 2] {
    let [fine, coarse] = [&raw.blocks[0], &raw.blocks[1]];
    [fine.at(x + 1, y + 1, z + 1), coarse.at(x / 2 + 1, y / 2 + 1, z / 2 + 1)]
}

fn widen(range: &mut [f32; 2], other: [f32; 2]) {
    *range = [range[0].min(other[0]), range[1].max(other[1])];
}

/// What blocks beyond the parent's add to a range, from the parent's cell `above` on.
fn further_up(raw: &RawBrick, above: [usize; 3], range: &mut [f32; 2]) {
    // Blocks of one cell and its ghosts do not halve: there all count.
    let halves = raw.blocks[0].side.saturating_sub(2).checked_ilog2().unwrap_or(0) as usize;
    let mut reach = above.map(|c| (c - 1, c + 1));
    for (up, block) in raw.blocks.iter().enumerate().skip(2) {
        let last = block.side - 1;
        reach = match up > halves {
            true => [(0, last); 3],
            false => reach.map(|(lo, hi)| (parent(lo) - 1, (parent(hi) + 1).min(last))),
        };
        if !take_in(block, reach, range) {
            break;
        }
    }
}

/// Takes the existing cells within `reach` into `range`; whether there are holes.
fn take_in(block: &Block, reach: [(usize, usize); 3], range: &mut [f32; 2]) -> bool {
    let mut has_holes = false;
    for z in reach[2].0..=reach[2].1 {
        for y in reach[1].0..=reach[1].1 {
            for x in reach[0].0..=reach[0].1 {
                let at = block.at(x, y, z);
                if block.states[at] & state::EXISTS != 0 {
                    widen(range, [block.values[at]; 2]);
                } else {
                    has_holes |= block.states[at] & state::OUTSIDE == 0;
                }
            }
        }
    }
    has_holes
}

/// A cell's parent, at least 1, both counted from their blocks' first ghosts: block cell 1 is the
/// first of the brick.
fn parent(cell: usize) -> usize {
    cell.div_ceil(2).max(1)
}

/// For each cell of a block what is among it and the 26 around it. At the block's edge that means
/// nothing.
#[derive(Debug, Default)]
struct Around {
    /// [`Self::ABSENT`] | [`Self::HOLE`].
    kinds: Vec<u8>,
    /// Least and largest stored value of those that exist.
    least: Vec<f32>,
    most: Vec<f32>,
    /// What the values were before they were joined along an axis.
    spare: Vec<f32>,
}

impl Around {
    /// Some do not exist.
    const ABSENT: u8 = 1;
    /// Some of these lie within the domain.
    const HOLE: u8 = 2;

    fn look_at(&mut self, block: &Block) {
        let exists = |bits: u8| bits & state::EXISTS != 0;
        let cells = || block.values.iter().zip(&block.states);
        let kind = |&bits: &u8| match bits {
            bits if exists(bits) => 0,
            bits if bits & state::OUTSIDE != 0 => Self::ABSENT,
            _ => Self::ABSENT | Self::HOLE,
        };
        let value_or =
            |none: f32| move |(&v, &bits): (&f32, &u8)| if exists(bits) { v } else { none };
        fill(&mut self.kinds, block.states.iter().map(kind));
        fill(&mut self.least, cells().map(value_or(f32::INFINITY)));
        fill(&mut self.most, cells().map(value_or(f32::NEG_INFINITY)));
        let Self { kinds, least, most, spare } = self;
        spread_out(kinds, &mut Vec::new(), block.side, |a, b| a | b);
        spread_out(least, spare, block.side, |a, b| if a < b { a } else { b });
        spread_out(most, spare, block.side, |a, b| if a > b { a } else { b });
    }
}

fn fill<T>(values: &mut Vec<T>, new: impl Iterator<Item = T>) {
    values.clear();
    values.extend(new);
}

/// Joins each cell with its neighbours along each axis in turn. Rows run into each other at the
/// block's edge, which no cell within reads.
fn spread_out<T: Copy>(
    values: &mut [T],
    spare: &mut Vec<T>,
    side: usize,
    join: impl Fn(T, T) -> T,
) {
    for stride in [1, side, side * side] {
        spare.clear();
        spare.extend_from_slice(values);
        let count = values.len().saturating_sub(2 * stride);
        let (before, after) = (&spare[..count], &spare[2 * stride..][..count]);
        let joined = values[stride..][..count].iter_mut().zip(before).zip(after);
        joined.for_each(|((value, &a), &b)| *value = join(*value, join(a, b)));
    }
}
