//! Cells beside borders of the coarser level: the ranges of the values that interpolants draw on there.

use super::scale::Scale;
use crate::cache::{Block, RawBrick, state};
use crate::lanes::{Kernel, Lanes, Width};

/// What lies around cells beside borders of levels, of holes and of the domain.
#[derive(Debug, Default)]
pub(super) struct Borders {
    /// Around each cell of the brick's own block, and of its parent's.
    around: [Around; 2],
    /// [least, most] stored value that either interpolant draws on, for each cell beside a border.
    ranges: Vec<[f32; 2]>,
    mapped: Vec<f64>,
}

impl Borders {
    /// Forgets the cells of the last brick.
    pub(super) fn clear(&mut self) {
        self.ranges.clear();
    }

    /// Looks at a brick's own block and its parent's, with something in the place of cells outside
    /// the domain.
    pub(super) fn look_at(&mut self, pair: [&Block; 2]) {
        for (around, block) in self.around.iter_mut().zip(pair) {
            Width::best().run(LookAround { around, block });
        }
    }

    /// Which cells of a row along x, counted from the brick's lowest, have only cells around their
    /// parents that exist: a bit each.
    pub(super) fn inside(&self, raw: &RawBrick, [y, z]: [usize; 2]) -> u32 {
        let edge = raw.blocks[0].side - 2;
        let [_, above] = places(raw, [0, y, z]);
        let above = lowest_bits(&self.around[1].kinds[above..above + edge / 2]);
        !doubled(above) & (u32::MAX >> (u32::BITS as usize - edge))
    }

    /// Whether cells exist around place `at` of the brick's own block, `side` cells wide, or it is one of
    /// its ghosts.
    pub(super) fn is_near_cells(&self, side: usize, at: usize) -> bool {
        let is_ghost = |c: usize| c == 0 || c == side - 1;
        let cell = [at % side, at / side % side, at / side / side];
        self.around[0].least[at] < f32::INFINITY || cell.into_iter().any(is_ghost)
    }

    /// The cells of a row along x that exist, likewise.
    pub(super) fn existing(raw: &RawBrick, [y, z]: [usize; 2]) -> u32 {
        let [own, _] = places(raw, [0, y, z]);
        lowest_bits(&raw.blocks[0].states[own..own + raw.blocks[0].side - 2])
    }

    /// Adds a cell beside a border of the coarser level: what both interpolants draw on are the cells
    /// around it on both levels and, while there are holes among those, the parents' of these and
    /// theirs around.
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
    pub(super) fn spread(&mut self, scale: Scale) -> f64 {
        scale.map(self.ranges.as_flattened(), &mut self.mapped);
        let spreads = self.mapped.as_chunks::<2>().0.iter().map(|[least, most]| most - least);
        spreads.fold(0.0, f64::max)
    }
}

/// The lowest bit of each of up to 32 bytes, the first's lowest.
fn lowest_bits(bytes: &[u8]) -> u32 {
    bytes.chunks(8).rev().fold(0, |bits, chunk| {
        let mut word = [0; 8];
        word[..chunk.len()].copy_from_slice(chunk);
        // The product brings the bit of byte n to bit 56 + n, and no two to the same place.
        let lowest = u64::from_le_bytes(word) & 0x0101_0101_0101_0101;
        bits << 8 | (lowest.wrapping_mul(0x0102_0408_1020_4080) >> 56) as u32
    })
}

/// Each of the lower 16 bits twice.
fn doubled(bits: u32) -> u32 {
    let apart = |bits: u32, by: u32, mask: u32| (bits | bits << by) & mask;
    let bits = apart(bits, 8, 0x00ff_00ff);
    let bits = apart(bits, 4, 0x0f0f_0f0f);
    let bits = apart(bits, 2, 0x3333_3333);
    let bits = apart(bits, 1, 0x5555_5555);
    bits | bits << 1
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
    /// What they were before they were joined along an axis.
    spare: Vec<f32>,
    spare_kinds: Vec<u8>,
}

impl Around {
    /// Some do not exist.
    const ABSENT: u8 = 1;
    /// Some of these lie within the domain.
    const HOLE: u8 = 2;

    #[inline(always)]
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
        let Self { kinds, least, most, spare, spare_kinds } = self;
        spread_out(kinds, spare_kinds, block.side, |a, b| a | b);
        spread_out(least, spare, block.side, |a, b| if a < b { a } else { b });
        spread_out(most, spare, block.side, |a, b| if a > b { a } else { b });
    }
}

/// Looks at a block with all that the processor has.
struct LookAround<'a> {
    around: &'a mut Around,
    block: &'a Block,
}

impl Kernel for LookAround<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, _: L) {
        self.around.look_at(self.block);
    }
}

#[inline(always)]
fn fill<T>(values: &mut Vec<T>, new: impl Iterator<Item = T>) {
    values.clear();
    values.extend(new);
}

/// Joins each cell with its neighbours along each axis in turn. Rows run into each other at the
/// block's edge, which no cell within reads.
#[inline(always)]
fn spread_out<T: Copy + Default>(
    values: &mut Vec<T>,
    spare: &mut Vec<T>,
    side: usize,
    join: impl Fn(T, T) -> T,
) {
    spare.resize(values.len(), T::default());
    for stride in [1, side, side * side] {
        let count = values.len().saturating_sub(2 * stride);
        let (before, after) = (&values[..count], &values[2 * stride..][..count]);
        let joined = spare[stride..][..count].iter_mut().zip(&values[stride..]);
        let joined = joined.zip(before.iter().zip(after));
        joined.for_each(|((joined, &value), (&a, &b))| *joined = join(value, join(a, b)));
        std::mem::swap(values, spare);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_gathered_and_doubled() {
        let bytes: Vec<u8> =
            (0..32_u32).map(|n| (n.wrapping_mul(0x9e37_79b9) >> 13) as u8).collect();
        for count in [4, 8, 16, 32] {
            let bits = lowest_bits(&bytes[..count]);
            for (n, byte) in bytes.iter().enumerate() {
                let expected = if n < count { u32::from(byte & 1) } else { 0 };
                assert_eq!(bits >> n & 1, expected, "{n} of {count}");
            }
            if count <= 16 {
                assert!((0..32).all(|n| doubled(bits) >> n & 1 == bits >> (n / 2) & 1), "{count}");
            }
        }
    }
}
