//! The blocks of cells that a decoded brick holds: mapped values, in f64 and as packets see them.

use crate::cache::{Block, BrickShape, state};
use crate::lanes::BYTE_PADDING;

/// Mapped values are held to ± this.
const LARGEST: f64 = 1e30;

/// One block of mapped values: [`Block`] with every cell filled.
#[derive(Debug, Default)]
pub(crate) struct ScaledBlock {
    /// Cells along an edge, ghosts included.
    pub(crate) side: usize,
    /// x of the transfer function, unclamped, x fastest.
    pub(crate) values: Vec<f64>,
    /// [`state`] bits. In the brick's own block a hole has its owner's VOID bit.
    pub(crate) states: Vec<u8>,
    /// Where the brick's lower corner lies in the block's cell 0 (ghosts not counted), in cells.
    pub(crate) corner: [f64; 3],
    /// Width of one of the brick's cells, in the block's.
    pub(crate) scale: f64,
}

impl ScaledBlock {
    /// Index of the cell (x, y, z) counted from the block's lowest cell, its ghost.
    #[inline]
    pub(crate) fn at(&self, [x, y, z]: [usize; 3]) -> usize {
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

    /// Takes in the cells of `raw`, their values mapped and held to what is allowed; cells that do
    /// not exist become 0 until they are filled. `corner` and `scale` are left as they are.
    pub(super) fn load(&mut self, raw: &Block, mapping: impl Fn(&[f32], &mut [f64])) {
        self.begin(raw.side, raw.states.iter().copied());
        self.values.resize(raw.values.len(), 0.0);
        mapping(&raw.values, &mut self.values);
        for (x, bits) in self.values.iter_mut().zip(&raw.states) {
            *x = if bits & state::EXISTS == 0 { 0.0 } else { held(*x) };
        }
    }
}

/// A mapped value as it is kept: NaN becomes 0, others are held to ±10³⁰.
pub(super) fn held(x: f64) -> f64 {
    if x.is_nan() { 0.0 } else { x.clamp(-LARGEST, LARGEST) }
}

/// A block in f32.
#[derive(Debug, Default)]
pub(crate) struct NarrowBlock {
    /// The block's values.
    pub(crate) values: Vec<f32>,
    /// Which of a dual cell's eight cells exist: bit a of a cell's number is set where it is the
    /// upper one along axis a. (side − 1)³ dual cells, x fastest, and padding for lanes; empty
    /// where the brick has no borders.
    pub(crate) corners: Vec<u8>,
}

impl NarrowBlock {
    /// Empties the block; its memory is kept.
    pub(super) fn clear(&mut self) {
        self.values.clear();
        self.corners.clear();
    }

    /// Takes in the values of `block`, into a block that was cleared; and which corners exist where
    /// the brick has borders.
    pub(super) fn fill(&mut self, block: &ScaledBlock, has_borders: bool) {
        self.values.reserve_exact(block.values.len());
        self.values.extend(block.values.iter().map(|&x| x as f32));
        if !has_borders {
            return;
        }
        gather_corners(&mut self.corners, block, |bits| u8::from(bits & EXISTING != 0), [1, 2, 4]);
        self.corners.extend([0; BYTE_PADDING]);
    }
}

/// For each dual cell of a block, x fastest, all bits that `flags` makes of its corners' states, those
/// of the upper one along an axis shifted by that of `shifts`; with room for padding.
pub(super) fn gather_corners(
    out: &mut Vec<u8>,
    block: &ScaledBlock,
    flags: impl Fn(u8) -> u8,
    shifts: [u32; 3],
) {
    const MOST_SIDE: usize = BrickShape::MOST_CELLS + 2;
    let (side, count) = (block.side, block.side - 1);
    // Exact, because the memory limit counts these bytes.
    out.reserve_exact(count.pow(3) + BYTE_PADDING);
    // Planes as one long row each; what their last columns and rows hold is of no dual cell.
    let mut buffers = [[0; MOST_SIDE * MOST_SIDE]; 2];
    let [below, above] = &mut buffers;
    let (mut below, mut above) = (&mut below[..side * side], &mut above[..side * side]);
    for (z, states) in block.states.chunks_exact(side * side).enumerate() {
        let pairs = states.iter().zip(&states[1..]);
        for (all, (lower, upper)) in above.iter_mut().zip(pairs) {
            *all = flags(*lower) | flags(*upper) << shifts[0];
        }
        for y in 0..count {
            let (row, rest) = above[y * side..].split_at_mut(side);
            row.iter_mut().zip(rest).for_each(|(all, bits)| *all |= *bits << shifts[1]);
        }
        if z > 0 {
            below.iter_mut().zip(&*above).for_each(|(all, bits)| *all |= bits << shifts[2]);
            for row in below.chunks_exact(side).take(count) {
                out.extend_from_slice(&row[..count]);
            }
        }
        std::mem::swap(&mut below, &mut above);
    }
}

/// States of cells that count as existing.
pub(super) const EXISTING: u8 = state::EXISTS | state::OUTSIDE;
