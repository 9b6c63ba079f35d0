//! How far a brick's interpolant is from its parent's: an upper bound, from the payload alone.

mod borders;
mod lattice;
mod scale;

use crate::cache::{Block, BrickShape, RawBrick, state, visit_outside};

use borders::Borders;
use lattice::Lattice;
pub(super) use scale::Scale;

/// Where in a brick F_l − F_{l−1} is known closely, and where only bounded; `F` as in
/// `docs/ARCHITECTURE.md`, "Across levels".
///
/// Where every cell around exists on both levels, F_l = T_l and F_{l−1} = T_{l−1}: both are
/// trilinear between half-integer coordinates of the finer level, so their difference takes its
/// extremes there, and is evaluated. Elsewhere both are convex combinations of values nearby,
/// whose range bounds it. Cells outside the domain are what the nearest ones inside are.
///
/// The memory is reused from brick to brick.
#[derive(Debug, Default)]
pub(super) struct Residual {
    lattice: Lattice,
    borders: Borders,
    has_nan: bool,
    /// The brick's own block and its parent's, with something in the place of cells outside.
    pair: [Block; 2],
}

impl Residual {
    /// Looks at a brick's cells, among whose values NaN is if `has_nan`; false for the root, which
    /// has no parent.
    pub(super) fn look_at(&mut self, shape: BrickShape, raw: &RawBrick, has_nan: bool) -> bool {
        if raw.blocks.len() < 2 {
            return false;
        }
        let edge = shape.edge();
        self.has_nan = has_nan;
        self.borders.clear();
        self.lattice.begin(edge);
        self.pair.iter_mut().zip(&raw.blocks).for_each(|(own, block)| take(own, block));
        if self.pair.iter().chain(&raw.blocks[..1]).all(is_complete) {
            (0..edge * edge).for_each(|_| self.lattice.push(u32::MAX));
        } else {
            self.borders.look_at(&self.pair);
            for row in (0..edge * edge).map(|at| [at % edge, at / edge]) {
                let existing = Borders::existing(raw, row);
                let inside = self.borders.inside(raw, row) & existing;
                self.lattice.push(inside);
                self.add_borders(raw, row, existing & !inside);
            }
        }
        self.lattice.end();
        true
    }

    /// Adds those of a row's cells, a bit each, that lie beside borders.
    fn add_borders(&mut self, raw: &RawBrick, [y, z]: [usize; 2], mut cells: u32) {
        while cells != 0 {
            self.borders.add(raw, [cells.trailing_zeros() as usize, y, z]);
            cells &= cells - 1;
        }
    }

    /// Bounds |F_l − F_{l−1}| over the box of the brick last looked at, of values mapped by
    /// `scale`. Infinite where NaN takes part.
    pub(super) fn bound(&mut self, scale: Scale) -> f64 {
        if self.has_nan {
            return f64::INFINITY;
        }
        let [fine, coarse] = &self.pair;
        let inside = self.lattice.difference(fine, coarse, scale);
        self.borders.spread(scale).max(inside)
    }
}

/// Takes over a block, its cells outside the domain as the nearest ones inside.
fn take(own: &mut Block, block: &Block) {
    own.side = block.side;
    own.values.clone_from(&block.values);
    own.states.clone_from(&block.states);
    visit_outside(block.side, &block.states, |at, nearest| {
        own.values[at] = block.values[nearest];
        own.states[at] = block.states[nearest];
    });
}

fn is_complete(block: &Block) -> bool {
    block.states.iter().fold(state::EXISTS, |all, bits| all & bits) != 0
}
