//! The continuous interpolant across levels: blend to parent.
//!
//! At level l, `T_l` is trilinear between cell centres; where a cell has a neighbour without
//! data of its level, `T_l` fades into the coarser interpolant over the outer half cell:
//! `F_l = F_{l−1} + w_l (T_l − F_{l−1})`, `F_0 = T_0`.

use std::cell::RefCell;

use super::dataset::{Dataset, IndexMap};
use super::double_double::DoubleDouble;
use super::transfer::Transfer;

/// Scaled values of one data set, ghosts and holes included.
pub(crate) struct Interpolant<'a> {
    pub(crate) dataset: &'a Dataset,
    transfer: &'a Transfer,
    /// Interpolated values where a level has no data, by level.
    ghosts: RefCell<Vec<IndexMap<[i64; 3], f64>>>,
}

/// What one level contributes within one half cell (an octant of a cell).
#[derive(Debug, Clone)]
pub(crate) struct Octant {
    /// The cell whose centre is the lowest of the eight that are interpolated.
    lowest: [i64; 3],
    /// Whether the octant lies on the cell's upper side along each axis.
    upper: [bool; 3],
    /// Scaled values at the eight centres, x fastest.
    pub(crate) corners: [f64; 8],
    /// Non-empty sets of axes (bits) whose neighbour does not exist.
    pub(crate) missing: Vec<usize>,
}

impl<'a> Interpolant<'a> {
    pub(crate) fn new(dataset: &'a Dataset, transfer: &'a Transfer) -> Self {
        let tables = vec![IndexMap::default(); dataset.deepest() + 1];
        Self { dataset, transfer, ghosts: RefCell::new(tables) }
    }

    /// `v_level(index)`: the cell's scaled value, else interpolated from the parents; beyond the
    /// domain that of the nearest cell inside.
    pub(crate) fn value(&self, level: usize, index: [i64; 3]) -> f64 {
        let across = self.dataset.cells_across(level);
        let index: [i64; 3] = std::array::from_fn(|a| index[a].clamp(0, across[a] - 1));
        if let Some(cell) = self.dataset.cell(level, index) {
            return self.transfer.scaled(cell.value);
        }
        let known = self.ghosts.borrow()[level].get(&index).copied();
        known.unwrap_or_else(|| {
            let value = self.ghost(level, index);
            self.ghosts.borrow_mut()[level].insert(index, value);
            value
        })
    }

    /// Per axis ¾ of the parent and ¼ of the parent's neighbour on the cell's side.
    fn ghost(&self, level: usize, index: [i64; 3]) -> f64 {
        let mut sum = 0.0;
        for n in 0..8 {
            let mut weight = 1.0;
            let parent = [0, 1, 2].map(|a| {
                let side = if index[a] & 1 == 0 { -1 } else { 1 };
                let far = n >> a & 1 == 1;
                weight *= if far { 0.25 } else { 0.75 };
                (index[a] >> 1) + if far { side } else { 0 }
            });
            sum += weight * self.value(level - 1, parent);
        }
        sum
    }

    /// Whether `level` has data at `index`, refined further or not; outside the domain it has.
    pub(crate) fn exists(&self, level: usize, index: [i64; 3]) -> bool {
        let across = self.dataset.cells_across(level);
        let outside = (0..3).any(|a| !(0..across[a]).contains(&index[a]));
        outside || self.dataset.cell(level, index).is_some()
    }

    /// The octant that holds `point` (in cells of `level`).
    pub(crate) fn octant(&self, level: usize, point: [DoubleDouble; 3]) -> Octant {
        let cell = point.map(DoubleDouble::floor);
        let half = DoubleDouble::from(0.5);
        let upper: [bool; 3] =
            std::array::from_fn(|a| point[a] - DoubleDouble::from_index(cell[a]) >= half);
        let lowest: [i64; 3] = std::array::from_fn(|a| cell[a] - i64::from(!upper[a]));
        let neighbour = |set: usize| -> [i64; 3] {
            std::array::from_fn(|a| {
                let side = if upper[a] { 1 } else { -1 };
                cell[a] + if set >> a & 1 == 1 { side } else { 0 }
            })
        };
        Octant {
            lowest,
            upper,
            corners: std::array::from_fn(|n| {
                self.value(level, [0, 1, 2].map(|a| lowest[a] + (n >> a & 1) as i64))
            }),
            missing: (1..8).filter(|&set| !self.exists(level, neighbour(set))).collect(),
        }
    }

    /// The octants at `point` (in root cells) from `level` upward, ending at the first where
    /// nothing is missing, or at the root grid: `w = 1` there.
    pub(crate) fn octants(&self, level: usize, point: [DoubleDouble; 3]) -> Vec<(usize, Octant)> {
        let mut octants = Vec::new();
        for level in (0..=level).rev() {
            let octant = self.octant(level, point.map(|x| x.scaled(level as i32)));
            let whole = octant.missing.is_empty();
            octants.push((level, octant));
            if whole {
                break;
            }
        }
        octants
    }

    /// `F(point)`, scaled; `point` in root cells inside the domain.
    pub(crate) fn at(&self, point: [DoubleDouble; 3]) -> f64 {
        let cell = |level: usize| point.map(|x| x.scaled(level as i32).floor());
        let levels = 0..=self.dataset.deepest();
        let finest = levels.rev().find(|&l| self.dataset.cell(l, cell(l)).is_some());
        let octants = self.octants(finest.unwrap_or(0), point);
        octants.iter().rev().fold(0.0, |coarser, (level, octant)| {
            let place = octant.place(point.map(|x| x.scaled(*level as i32)));
            let fade = octant.missing.iter().map(|set| octant.edge_distance(*set, place));
            let weight = fade.fold(1.0, f64::min);
            coarser + weight * (octant.trilinear(place) - coarser)
        })
    }
}

impl Octant {
    /// `point` (in cells of the level) relative to the lowest centre: 0 … 1 along each axis.
    pub(crate) fn place(&self, point: [DoubleDouble; 3]) -> [f64; 3] {
        std::array::from_fn(|a| {
            let centre = DoubleDouble::from_index(self.lowest[a]) + DoubleDouble::from(0.5);
            (point[a] - centre).to_f64()
        })
    }

    /// `s_a = 1 − |2u_a − 1|` as `(value, slope)` in the place along axis `a`: 0 on the octant's
    /// outer face, 1 at the cell's centre.
    pub(crate) fn fade(&self, axis: usize) -> (f64, f64) {
        if self.upper[axis] { (1.0, -2.0) } else { (-1.0, 2.0) }
    }

    /// `max s_a` over the axes of `set`.
    fn edge_distance(&self, set: usize, place: [f64; 3]) -> f64 {
        let axes = (0..3).filter(|a| set >> a & 1 == 1);
        axes.map(|a| self.fade(a).0 + self.fade(a).1 * place[a]).fold(f64::MIN, f64::max)
    }

    fn trilinear(&self, place: [f64; 3]) -> f64 {
        let weight = |n: usize, a: usize| if n >> a & 1 == 1 { place[a] } else { 1.0 - place[a] };
        (0..8).map(|n| (0..3).map(|a| weight(n, a)).product::<f64>() * self.corners[n]).sum()
    }
}
