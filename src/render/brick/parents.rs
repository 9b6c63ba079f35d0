//! What the next coarser block makes of a block's cells: along each axis ¾ of a cell's parent and ¼ of
//! the parent's neighbour on the cell's side.

use super::blocks::ScaledBlock;
use super::windows::Window;
use crate::cache::BrickShape;

/// Weights along an axis: of the parent, and of its neighbour on the cell's side.
const WEIGHTS: [f64; 2] = [0.75, 0.25];

/// A coarser block, seen from the next finer one.
pub(super) struct Parents<'b> {
    pub(super) coarse: &'b ScaledBlock,
}

/// Cells along an edge of a coarser block, at most.
const MOST_SIDE: usize = BrickShape::MOST_CELLS / 2 + 2;

/// A row of the coarser block on its way to the finer one's, and what each of its cells makes of its
/// two halves.
#[derive(Debug, Default)]
pub(super) struct ParentRow {
    coarse: [f64; MOST_SIDE],
    halves: [[f64; 2]; MOST_SIDE],
}

impl<'b> Parents<'b> {
    pub(super) fn new(coarse: &'b ScaledBlock) -> Self {
        Self { coarse }
    }

    /// The parent of the finer block's cell `cell` along axis `a`, and its neighbour on the
    /// cell's side; ghosts counted.
    pub(super) fn along(&self, a: usize, cell: usize) -> [usize; 2] {
        let place = cell + 1 + self.coarse.upper[a];
        let (parent, last) = (place / 2, self.coarse.side - 1);
        let beside = if place.is_multiple_of(2) { parent.saturating_sub(1) } else { parent + 1 };
        [parent.min(last), beside.min(last)]
    }

    /// The coarser values interpolated at the cells of the finer block's row (y, z).
    #[inline(always)]
    pub(super) fn row<'r>(&self, [y, z]: [usize; 2], row: &'r mut ParentRow) -> &'r [f64] {
        let side = self.coarse.side;
        let (coarse, halves) = (&mut row.coarse[..side], &mut row.halves[..side]);
        let (y, z) = (self.along(1, y), self.along(2, z));
        let values = |y: usize, z: usize| &self.coarse.values[self.coarse.at([0, y, z])..][..side];
        let near = values(y[0], z[0]).iter().zip(values(y[1], z[0]));
        let far = values(y[0], z[1]).iter().zip(values(y[1], z[1]));
        for (x, ((a, b), (c, d))) in coarse.iter_mut().zip(near.zip(far)) {
            *x = weighted(weighted(*a, *b), weighted(*c, *d));
        }
        let last = side - 1;
        for (halves, of) in halves[1..].iter_mut().zip(coarse.windows(3)) {
            *halves = [weighted(of[1], of[0]), weighted(of[1], of[2])];
        }
        halves[0] = [coarse[0], weighted(coarse[0], coarse[1])];
        halves[last] = [weighted(coarse[last], coarse[last - 1]), coarse[last]];
        &halves.as_flattened()[1 + self.coarse.upper[0]..]
    }

    /// The cells that the interpolant draws on between those of a window along axis `a`.
    pub(super) fn around(&self, a: usize, (first, end): Window) -> Window {
        let last = self.coarse.side - 1;
        let low = self.along(a, first)[0].saturating_sub(1).min(last - 1);
        let high = (self.along(a, end)[0] + 1).min(last);
        (low, high.max(low + 1))
    }
}

#[inline(always)]
fn weighted(parent: f64, beside: f64) -> f64 {
    WEIGHTS[0] * parent + WEIGHTS[1] * beside
}
