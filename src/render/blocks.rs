//! The blocks of cells that a decoded brick holds: mapped values, in f64 and as packets see them.

use super::lanes::BYTE_PADDING;
use crate::cache::{Block, BrickShape, state};

/// Mapped values are held to ± this.
const LARGEST: f64 = 1e30;

/// One block of mapped values: [`Block`] with every cell filled.
#[derive(Debug, Default)]
pub(super) struct ScaledBlock {
    /// Cells along an edge, ghosts included.
    pub(super) side: usize,
    /// x of the transfer function, unclamped, x fastest.
    pub(super) values: Vec<f64>,
    /// [`state`] bits. In the brick's own block a hole has its owner's VOID bit.
    pub(super) states: Vec<u8>,
    /// Where the brick's lower corner lies in the block's cell 0 (ghosts not counted), in cells.
    pub(super) corner: [f64; 3],
    /// Width of one of the brick's cells, in the block's.
    pub(super) scale: f64,
}

impl ScaledBlock {
    /// Index of the cell (x, y, z) counted from the block's lowest cell, its ghost.
    #[inline]
    pub(super) fn at(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.side + y) * self.side + x
    }

    /// Sets states, with room for as many values and none yet.
    fn begin(&mut self, side: usize, states: impl ExactSizeIterator<Item = u8>) {
        self.side = side;
        self.states.clear();
        self.values.clear();
        // Exact, because the memory limit counts these bytes.
        self.states.reserve_exact(states.len());
        self.values.reserve_exact(states.len());
        self.states.extend(states);
    }

    /// Becomes a block of cells of one level that all exist.
    pub(super) fn take(&mut self, side: usize, values: &[f64]) {
        self.begin(side, values.iter().map(|_| state::EXISTS));
        self.values.extend_from_slice(values);
        (self.corner, self.scale) = ([0.0; 3], 1.0);
    }

    /// Becomes as another is.
    pub(super) fn copy(&mut self, other: &Self) {
        self.begin(other.side, other.states.iter().copied());
        self.values.extend_from_slice(&other.values);
        (self.corner, self.scale) = (other.corner, other.scale);
    }

    pub(super) fn load(&mut self, raw: &Block, mapping: impl Fn(&[f32], &mut [f64])) {
        self.begin(raw.side, raw.states.iter().copied());
        self.values.resize(raw.values.len(), 0.0);
        mapping(&raw.values, &mut self.values);
        for (x, bits) in self.values.iter_mut().zip(&raw.states) {
            *x = if bits & state::EXISTS == 0 { 0.0 } else { held(*x) };
        }
    }
}

pub(super) fn held(x: f64) -> f64 {
    if x.is_nan() { 0.0 } else { x.clamp(-LARGEST, LARGEST) }
}

/// A block in f32.
#[derive(Debug, Default)]
pub(super) struct NarrowBlock {
    /// The block's values.
    pub(super) values: Vec<f32>,
    /// Which of a dual cell's eight cells exist: bit a of a cell's number is set where it is the
    /// upper one along axis a. (side − 1)³ dual cells, x fastest, and padding for lanes; empty
    /// where the brick has no borders.
    pub(super) corners: Vec<u8>,
}

impl NarrowBlock {
    pub(super) fn clear(&mut self) {
        self.values.clear();
        self.corners.clear();
    }

    pub(super) fn fill(&mut self, block: &ScaledBlock, has_borders: bool) {
        self.values.reserve_exact(block.values.len());
        self.values.extend(block.values.iter().map(|&x| x as f32));
        if !has_borders {
            return;
        }
        gather_corners(&mut self.corners, block, |bits, corner| {
            u8::from(bits & EXISTING != 0) << corner
        });
        self.corners.extend([0; BYTE_PADDING]);
    }
}

/// For each dual cell of a block, x fastest, all bits that `flags` makes of its corners' states;
/// with room for padding.
pub(super) fn gather_corners(
    out: &mut Vec<u8>,
    block: &ScaledBlock,
    flags: impl Fn(u8, usize) -> u8,
) {
    const MOST_SIDE: usize = BrickShape::MOST_CELLS + 2;
    let (side, count) = (block.side, block.side - 1);
    // Exact, because the memory limit counts these bytes.
    out.reserve_exact(count.pow(3) + BYTE_PADDING);
    // A plane at a time, as one long row; its last column's are of no dual cell.
    let mut plane = [0; MOST_SIDE * MOST_SIDE];
    let plane = &mut plane[..count * side - 1];
    for z in 0..count {
        plane.fill(0);
        for corner in 0..8 {
            let first = block.at([corner & 1, corner >> 1 & 1, z + (corner >> 2 & 1)]);
            let states = &block.states[first..][..plane.len()];
            for (all, bits) in plane.iter_mut().zip(states) {
                *all |= flags(*bits, corner);
            }
        }
        for row in plane.chunks(side) {
            out.extend_from_slice(&row[..count]);
        }
    }
}

/// States of cells that count as existing.
pub(super) const EXISTING: u8 = state::EXISTS | state::OUTSIDE;
