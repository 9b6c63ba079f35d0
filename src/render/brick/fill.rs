//! Values for cells that have none: holes and ghosts beside coarser data, and cells outside the
//! domain.

use super::blocks::ScaledBlock;
use super::parents::{ParentRow, Parents};
use crate::cache::{state, visit_outside};
use crate::lanes::{Kernel, Lanes, Width};

/// Fills cells of state 0 in `block` with what the next coarser one makes of them, all of whose cells
/// are filled.
pub(super) fn fill_holes(block: &mut ScaledBlock, above: &ScaledBlock, row: &mut ParentRow) {
    if state::any(&block.states, |bits| bits == 0) {
        Width::best().run(Fill { block, parents: Parents::new(above), row });
    }
}

/// [`fill_holes`], compiled for the processor that the lanes are of.
struct Fill<'f> {
    block: &'f mut ScaledBlock,
    parents: Parents<'f>,
    row: &'f mut ParentRow,
}

impl Kernel for Fill<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, _: L) {
        let Self { block, parents, row } = self;
        let side = block.side;
        let rows = block.values.chunks_exact_mut(side).zip(block.states.chunks_exact(side));
        for (number, (values, states)) in rows.enumerate() {
            if !state::any(states, |bits| bits == 0) {
                continue;
            }
            let above = parents.row([number % side, number / side], row);
            for ((value, bits), above) in values.iter_mut().zip(states).zip(above) {
                *value = if *bits == 0 { *above } else { *value };
            }
        }
    }
}

/// Gives cells outside the domain the value of the nearest cell inside.
pub(super) fn fill_outside(block: &mut ScaledBlock) {
    let ScaledBlock { side, values, states, .. } = block;
    visit_outside(*side, states, |at, nearest| values[at] = values[nearest]);
}
