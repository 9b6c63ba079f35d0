//! The interpolant: trilinear within a level, blended into the coarser one beside its borders, so
//! that it is continuous whatever the jump of levels.
//!
//! Between the centre of cell c and those of its neighbours toward the sample, T is trilinear.
//! With v the distance from c's centre along each axis (0 … ½), s = 1 − 2v and, for every set n
//! of axes whose neighbour does not exist, w = min(w, max over n of s). The interpolant is
//! F_l = F_{l−1} + w·(T_l − F_{l−1}), evaluated from the finest level on until w = 1.

use glam::DVec3;

use super::scaled::ScaledBrick;
use crate::cache::state;

/// Which of the 27 bricks around a brick (itself included) are drawn at its level or finer,
/// where they exist: bit (dx + 1) + 3 (dy + 1) + 9 (dz + 1).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DrawnNeighbours(pub u32);

impl DrawnNeighbours {
    /// All of them.
    pub const ALL: Self = Self((1 << 27) - 1);

    /// Whether the brick that holds `cell` is drawn; cells count from the middle brick's lowest
    /// one, bricks have `edge` cells.
    #[inline]
    fn holds(self, cell: [i32; 3], edge: i32) -> bool {
        let along = |c: i32| if c < 0 { 0 } else { 1 + u32::from(c >= edge) };
        self.0 >> (along(cell[0]) + 3 * along(cell[1]) + 9 * along(cell[2])) & 1 == 1
    }
}

/// A cell and its seven neighbours toward a sample, at one level.
#[derive(Clone, Copy)]
pub(crate) struct Cube {
    /// Their values; bit a of the index: the neighbour along axis a.
    pub(crate) values: [f64; 8],
    /// Which of them exist and are drawn at the level or finer.
    pub(crate) exists: u8,
}

impl Cube {
    /// `exists` of a cube without a border.
    pub(crate) const COMPLETE: u8 = 0xff;

    fn trilinear(&self, v: [f64; 3]) -> f64 {
        (0..8)
            .map(|n| {
                let along = |a: usize| if n >> a & 1 == 1 { v[a] } else { 1.0 - v[a] };
                self.values[n] * (along(0) * along(1) * along(2))
            })
            .sum()
    }
}

/// The weight w of a level at distances `v` from the centre of a cell of which, and of whose
/// neighbours, these `exist` (as in [`Cube`]).
#[inline]
pub(crate) fn weight(exist: u8, v: [f64; 3]) -> f64 {
    if exist & 1 == 0 {
        return 0.0;
    }
    let [x, y, z] = [1.0 - 2.0 * v[0], 1.0 - 2.0 * v[1], 1.0 - 2.0 * v[2]];
    let larger = |a: f64, b: f64| if a > b { a } else { b };
    let (xy, xz, yz) = (larger(x, y), larger(x, z), larger(y, z));
    let sets = [x, y, xy, z, xz, yz, larger(xy, z)];
    let mut weight = 1.0;
    for (n, farthest) in sets.into_iter().enumerate() {
        if exist >> (n + 1) & 1 == 0 && farthest < weight {
            weight = farthest;
        }
    }
    if weight > 0.0 { weight } else { 0.0 }
}

/// One of the eight parts of a cell between its centre and its corners, at one level.
#[derive(Clone, Copy)]
pub(crate) struct CellOctant {
    up: usize,
    cell: [usize; 3],
    is_upper: [bool; 3],
}

impl ScaledBrick {
    /// The part of the cell `up` levels above the brick's cell `cell` that holds `point` (the
    /// brick's local coordinates).
    #[inline]
    pub(crate) fn octant(&self, up: usize, cell: [usize; 3], point: [f64; 3]) -> CellOctant {
        // Beyond the brick's own size its whole block is one cell.
        let cell = if up <= self.edge_bits as usize { cell.map(|c| c >> up) } else { [0; 3] };
        let is_upper =
            std::array::from_fn(|a| self.coarse(up, a, point[a]) - cell[a] as f64 >= 0.5);
        CellOctant { up, cell, is_upper }
    }

    /// A local coordinate in the cells of the block `up` levels above.
    #[inline]
    fn coarse(&self, up: usize, axis: usize, x: f64) -> f64 {
        self.blocks[up].corner[axis] + x * self.blocks[up].scale
    }

    /// Distances of `point` from the centre of the octant's cell, 0 to ½ along each axis.
    #[inline]
    pub(crate) fn distances(&self, octant: &CellOctant, point: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|a| {
            let u = self.coarse(octant.up, a, point[a]) - octant.cell[a] as f64;
            (if octant.is_upper[a] { u - 0.5 } else { 0.5 - u }).clamp(0.0, 0.5)
        })
    }

    /// The cell of `octant` and its neighbours on the octant's side.
    pub(crate) fn cube(&self, octant: &CellOctant, drawn: DrawnNeighbours) -> Cube {
        let block = &self.blocks[octant.up];
        let own = octant.cell.map(|c| c + 1);
        let beside: [usize; 3] =
            std::array::from_fn(|a| if octant.is_upper[a] { own[a] + 1 } else { own[a] - 1 });
        let is_checked = octant.up == 0 && drawn != DrawnNeighbours::ALL;
        let first = [block.at([own[0], 0, 0]), block.at([0, own[1], 0]), block.at([0, 0, own[2]])];
        let second =
            [block.at([beside[0], 0, 0]), block.at([0, beside[1], 0]), block.at([0, 0, beside[2]])];
        let mut cube = Cube { values: [0.0; 8], exists: 0 };
        for n in 0..8 {
            let side = |a: usize| if n >> a & 1 == 1 { second[a] } else { first[a] };
            let at = side(0) + side(1) + side(2);
            cube.values[n] = block.values[at];
            let bits = block.states[at];
            let exists = bits & (state::EXISTS | state::OUTSIDE) != 0;
            let side = |a: usize| if n >> a & 1 == 1 { beside[a] } else { own[a] };
            let has_none = bits & (state::OUTSIDE | state::COARSER) != 0;
            let is_drawn = !is_checked || has_none || self.is_drawn([0, 1, 2].map(side), drawn);
            cube.exists |= u8::from(exists && is_drawn) << n;
        }
        cube
    }

    /// Whether the brick that holds `cell` of the own block (ghosts counted) is drawn.
    #[inline]
    fn is_drawn(&self, cell: [usize; 3], drawn: DrawnNeighbours) -> bool {
        drawn.holds(cell.map(|c| c as i32 - 1), self.edge as i32)
    }

    /// Whether a cell of dual cell `index` lies in a neighbour that is not drawn.
    #[inline]
    pub(crate) fn meets_undrawn(&self, index: [i32; 3], drawn: DrawnNeighbours) -> bool {
        let edge = self.edge as i32;
        let inside = |c: i32| c > 0 && c < edge;
        if drawn == DrawnNeighbours::ALL || index.into_iter().all(inside) {
            return false;
        }
        (0..8).any(|n| {
            let cell = std::array::from_fn(|a| index[a] - 1 + (n >> a & 1));
            !drawn.holds(cell, edge)
        })
    }

    /// The interpolant (x of the transfer function, unclamped) at `point`, in cells from the
    /// brick's lowest corner; of a brick prepared for `cell`, the cell's own value, NaN where
    /// nothing is drawn. Points outside the brick count as the nearest of its cells' faces.
    pub fn value_at(&self, point: DVec3, drawn: DrawnNeighbours) -> f64 {
        let largest = self.edge as f64;
        let point = point.to_array().map(|x| x.clamp(0.0, largest));
        let cell = point.map(|x| (x as usize).min(self.edge.saturating_sub(1)));
        let (mut value, mut share) = (0.0, 1.0);
        if self.is_piecewise_constant() {
            let own = &self.blocks[0];
            return own.values[own.at(cell.map(|c| c + 1))];
        }
        for up in 0..self.used {
            let octant = self.octant(up, cell, point);
            let (cube, v) = (self.cube(&octant, drawn), self.distances(&octant, point));
            if cube.exists == Cube::COMPLETE || up + 1 == self.used {
                return value + share * cube.trilinear(v);
            }
            let weight = weight(cube.exists, v);
            value += share * weight * cube.trilinear(v);
            share *= 1.0 - weight;
        }
        value
    }
}
