//! The blocks of cells that a decoded brick holds: mapped values, in f64 and as packets see them.

use crate::cache::{Block, BrickShape, state};
use crate::lanes::{BYTE_PADDING, Kernel, Lanes, Width};

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
    /// Along each axis the half of the block's cell 0 that the next finer block's cell 0 is: 0 or 1.
    pub(super) upper: [usize; 3],
}

impl ScaledBlock {
    /// Index of the cell (x, y, z) counted from the block's lowest cell, its ghost.
    #[inline]
    pub(crate) fn at(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.side + y) * self.side + x
    }

    /// Makes the block `side` cells wide; what cells hold is left to be set.
    fn begin(&mut self, side: usize) {
        self.side = side;
        fit(&mut self.states, side.pow(3));
        fit(&mut self.values, side.pow(3));
    }

    /// Becomes a block of cells of one level that all exist.
    pub(super) fn take(&mut self, side: usize, values: &[f64]) {
        self.begin(side);
        self.states.fill(state::EXISTS);
        self.values.copy_from_slice(values);
        (self.corner, self.scale, self.upper) = ([0.0; 3], 1.0, [0; 3]);
    }

    /// Becomes as another is.
    pub(super) fn copy(&mut self, other: &Self) {
        self.begin(other.side);
        self.states.copy_from_slice(&other.states);
        self.values.copy_from_slice(&other.values);
        (self.corner, self.scale, self.upper) = (other.corner, other.scale, other.upper);
    }

    /// Takes in the cells of `raw`, their values mapped; cells that do not exist become 0 until they
    /// are filled. Where the block lies is left as it is.
    pub(super) fn load(&mut self, raw: &Block, mapping: impl Fn(&[f32], &mut [f64])) {
        self.begin(raw.side);
        self.states.copy_from_slice(&raw.states);
        mapping(&raw.values, &mut self.values);
        if state::any(&raw.states, |bits| bits & state::EXISTS == 0) {
            for (x, bits) in self.values.iter_mut().zip(&raw.states) {
                *x = if bits & state::EXISTS == 0 { 0.0 } else { *x };
            }
        }
    }
}

/// Makes a vector so long, in no more memory than that takes, since the memory limit counts it.
fn fit<T: Copy + Default>(numbers: &mut Vec<T>, length: usize) {
    numbers.reserve_exact(length.saturating_sub(numbers.len()));
    numbers.resize(length, T::default());
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
        Width::best().run(Narrow { from: &block.values, to: &mut self.values });
        if !has_borders {
            return;
        }
        gather_corners(&mut self.corners, block, |bits| u8::from(bits & EXISTING != 0), [1, 2, 4]);
        self.corners.extend([0; BYTE_PADDING]);
    }
}

/// Adds numbers in f32, compiled for the processor that the lanes are of.
struct Narrow<'n> {
    from: &'n [f64],
    to: &'n mut Vec<f32>,
}

impl Kernel for Narrow<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, _: L) {
        self.to.extend(self.from.iter().map(|&x| x as f32));
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
    // Exact, because the memory limit counts these bytes.
    out.reserve_exact((block.side - 1).pow(3) + BYTE_PADDING);
    Width::best().run(Gather { out, block, flags, shifts });
}

/// [`gather_corners`], compiled for the processor that the lanes are of.
struct Gather<'g, F> {
    out: &'g mut Vec<u8>,
    block: &'g ScaledBlock,
    flags: F,
    shifts: [u32; 3],
}

impl<F: Fn(u8) -> u8> Kernel for Gather<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, _: L) {
        const MOST_SIDE: usize = BrickShape::MOST_CELLS + 2;
        let Self { out, block, flags, shifts } = self;
        let (side, count) = (block.side, block.side - 1);
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
}

/// States of cells that count as existing.
pub(super) const EXISTING: u8 = state::EXISTS | state::OUTSIDE;
