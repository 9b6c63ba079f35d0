//! How far a brick's interpolant is from its parent's: an upper bound, from the payload alone.

mod borders;
mod chain;
mod lattice;
mod scale;

use crate::cache::{BrickShape, RawBrick};

use borders::Borders;
use chain::Chain;
use lattice::Lattice;
pub(super) use scale::Scale;

/// F_l − F_{l−1} in a brick of level l, bounded; `F`, `T` and `w` as in `docs/SEAMS.md`,
/// "The rule".
///
/// Holes are filled with the coarser T at their centres. So where every cell around exists on the
/// coarser level, F_{l−1} = T_{l−1}, and F_l − F_{l−1} is w_l times T_l − T_{l−1}, at most. Both T are
/// trilinear between half-integer coordinates of the finer level, so that their difference takes its
/// extremes there, and is evaluated. Beside holes of the coarser level F_{l−1} fades on to F_{l−2}:
/// T_l − F_{l−1} is at most T_l − T_{l−1} and T_{l−1} − T_{l−2} together, and so on up to a level
/// without holes there. Where the payload's blocks are too coarse to be told from each other, both F
/// are convex combinations of values nearby, whose range bounds it. Cells outside the domain are what
/// the nearest ones inside are.
///
/// The memory is reused from brick to brick.
#[derive(Debug, Default)]
pub(super) struct Residual {
    lattice: Lattice,
    chain: Chain,
    borders: Borders,
    has_nan: bool,
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
        self.chain.begin(raw);
        self.lattice.begin(edge);
        let rows = (0..edge * edge).map(|at| [at % edge, at / edge]);
        if self.chain.is_complete() {
            rows.for_each(|row| self.lattice.push(Borders::existing(raw, row)));
        } else {
            self.borders.look_at(self.chain.pair());
            let side = raw.blocks[0].side;
            self.chain.keep_holes(|at| self.borders.is_near_cells(side, at));
            for row in rows {
                self.look_at_row(raw, row);
            }
            self.chain.end(raw);
        }
        self.lattice.end();
        true
    }

    fn look_at_row(&mut self, raw: &RawBrick, row: [usize; 2]) {
        let existing = Borders::existing(raw, row);
        let inside = self.borders.inside(raw, row) & existing;
        let mut beside = existing & !inside;
        let is_evaluated = Chain::reaches_up(raw);
        self.lattice.push(if is_evaluated { existing } else { inside });
        while beside != 0 {
            let cell = [beside.trailing_zeros() as usize, row[0], row[1]];
            if is_evaluated {
                self.chain.fades(cell);
            } else {
                self.borders.add(raw, cell);
            }
            beside &= beside - 1;
        }
    }

    /// Bounds |F_l − F_{l−1}| over the box of the brick last looked at, of values mapped by
    /// `scale`. Infinite where NaN takes part.
    pub(super) fn bound(&mut self, scale: Scale) -> f64 {
        if self.has_nan {
            return f64::INFINITY;
        }
        self.chain.map(scale);
        let [fine, coarse] = self.chain.mapped();
        let evaluated = self.lattice.difference(fine, coarse) + self.chain.beyond();
        self.borders.spread(scale).max(evaluated)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cache::{Block, state};

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
