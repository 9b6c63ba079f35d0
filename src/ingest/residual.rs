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
        let rows = (0..edge * edge).map(|at| [at % edge, at / edge]);
        if self.pair.iter().all(is_complete) {
            rows.for_each(|row| self.lattice.push(Borders::existing(raw, row)));
        } else {
            self.borders.look_at(&self.pair);
            for row in rows {
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

#[cfg(test)]
mod tests {
    use super::*;

    const EDGE: usize = 8;

    /// A block of `cells` cells along an edge and ghosts, of which those below 0 along x and y lie
    /// outside the domain; cells measure `width`.
    fn block(cells: usize, width: f64) -> Block {
        let side = cells + 2;
        let mut block = Block { side, ..Block::default() };
        for at in 0..side.pow(3) {
            let cell = [at % side, at / side % side, at / side / side];
            let is_outside = cell[0] == 0 || cell[1] == 0;
            let [x, y, z] = cell.map(|c| (c as f64 - 0.5) * width);
            let value = (0.3 * x).sin() + (0.2 * y).cos() + 0.01 * z * x;
            block.values.push(if is_outside { 0.0 } else { value as f32 });
            block.states.push(if is_outside { state::OUTSIDE } else { state::EXISTS });
        }
        block
    }

    /// The interpolant at `place`, in widths of the finer cells from the domain's corner.
    fn value(block: &Block, width: f64, place: [f64; 3]) -> f64 {
        let at = place.map(|c| c / width + 0.5);
        let first = at.map(f64::floor);
        (0..8_usize).fold(0.0, |sum, corner| {
            let mut weight = 1.0;
            let cell: [usize; 3] = std::array::from_fn(|a| {
                let up = (corner >> a & 1) as f64;
                let part = at[a] - first[a];
                weight *= if up > 0.0 { part } else { 1.0 - part };
                let least = if a < 2 { 1.0 } else { 0.0 };
                (first[a] + up).clamp(least, (block.side - 1) as f64) as usize
            });
            sum + weight * f64::from(block.values[block.at(cell[0], cell[1], cell[2])])
        })
    }

    #[test]
    fn beside_the_domains_faces_the_difference_is_evaluated() {
        let raw = RawBrick { blocks: vec![block(EDGE, 1.0), block(EDGE / 2, 2.0)] };
        let mut residual = Residual::default();
        let shape = BrickShape::new(EDGE as u32).unwrap();
        assert!(residual.look_at(shape, &raw, false));
        let bound = residual.bound(Scale::Linear);
        let mut most = 0.0_f64;
        for at in 0..(2 * EDGE + 1).pow(3) {
            let along = |n: usize| (at / n % (2 * EDGE + 1)) as f64 * 0.5;
            let place = [along(1), along(2 * EDGE + 1), along((2 * EDGE + 1).pow(2))];
            let [own, above] = [(0, 1.0), (1, 2.0)].map(|(n, w)| value(&raw.blocks[n], w, place));
            most = most.max((own - above).abs());
        }
        assert!((bound - most).abs() < 1e-12 && most > 0.1, "{bound} {most}");
    }
}
