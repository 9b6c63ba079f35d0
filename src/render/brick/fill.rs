//! Values for cells that have none: holes and ghosts beside coarser data, and cells outside the
//! domain.

use super::blocks::ScaledBlock;
use crate::cache::{state, visit_outside};

/// The next coarser block.
pub(super) struct CoarserBlock<'a> {
    /// The block, all of its cells filled.
    pub(super) block: &'a ScaledBlock,
    /// Index of its first cell among all cells of its level.
    pub(super) first: [i128; 3],
}

/// Along one axis: positions of a cell's parent and of the parent's neighbour on the cell's own
/// side, in the block above.
fn parents(side: usize, first: i128, above_first: i128, above_side: usize) -> Vec<[usize; 2]> {
    (0..side as i128)
        .map(|n| {
            let cell = first + n;
            let parent = cell >> 1;
            let beside = if cell & 1 == 0 { parent - 1 } else { parent + 1 };
            [parent, beside]
                .map(|index| usize::try_from(index - above_first).unwrap_or(0).min(above_side - 1))
        })
        .collect()
}

/// Fills cells of state 0 in `block`, whose first cell has index `first`: along each axis ¾ of
/// the parent and ¼ of its neighbour on the cell's side.
pub(super) fn fill_holes(block: &mut ScaledBlock, first: [i128; 3], above: &CoarserBlock<'_>) {
    if !state::any(&block.states, |bits| bits == 0) {
        return;
    }
    let side = block.side;
    let along: [Vec<[usize; 2]>; 3] =
        std::array::from_fn(|a| parents(side, first[a], above.first[a], above.block.side));
    for (z, z_parents) in along[2].iter().enumerate() {
        for (y, y_parents) in along[1].iter().enumerate() {
            let first = block.at([0, y, z]);
            let states = &block.states[first..first + side];
            if !states.contains(&0) {
                continue;
            }
            let rows = Rows::new(above.block, [*y_parents, *z_parents]);
            let values = &mut block.values[first..first + side];
            let cells = values.iter_mut().zip(states).zip(&along[0]);
            for ((value, _), parents) in cells.filter(|((_, states), _)| **states == 0) {
                *value = rows.prolonged(*parents);
            }
        }
    }
}

/// The rows above that a row of cells draws on, and their weights.
struct Rows<'a>([(&'a [f64], f64); 4]);

impl<'a> Rows<'a> {
    fn new(above: &'a ScaledBlock, parents: [[usize; 2]; 2]) -> Self {
        Self(std::array::from_fn(|n| {
            let (y, z) = (n & 1, n >> 1);
            let first = above.at([0, parents[0][y], parents[1][z]]);
            (&above.values[first..first + above.side], WEIGHTS[y] * WEIGHTS[z])
        }))
    }

    fn prolonged(&self, [parent, beside]: [usize; 2]) -> f64 {
        let mut sum = 0.0;
        for (row, weight) in &self.0 {
            sum += weight * (WEIGHTS[0] * row[parent] + WEIGHTS[1] * row[beside]);
        }
        sum
    }
}

/// Weights along an axis: of the parent of the cell to be filled, and of the parent's neighbour on
/// that cell's side.
const WEIGHTS: [f64; 2] = [0.75, 0.25];

/// Gives cells outside the domain the value of the nearest cell inside.
pub(super) fn fill_outside(block: &mut ScaledBlock) {
    let ScaledBlock { side, values, states, .. } = block;
    visit_outside(*side, states, |at, nearest| values[at] = values[nearest]);
}
