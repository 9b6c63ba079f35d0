//! The leaf cells that a ray crosses, front to back.

use super::dataset::Dataset;
use super::double_double::DoubleDouble;

/// A ray: `origin + t · direction` in root cells from the domain's left edge, `t` in code length.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ray {
    pub(crate) origin: [DoubleDouble; 3],
    pub(crate) direction: [DoubleDouble; 3],
    /// Whether only `t >= 0` is seen.
    pub(crate) forward_only: bool,
}

/// A piece of a ray inside one cell.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Segment {
    pub(crate) level: usize,
    pub(crate) index: [i64; 3],
    pub(crate) enter: DoubleDouble,
    pub(crate) leave: DoubleDouble,
}

impl Segment {
    /// Length in code length.
    pub(crate) fn length(&self) -> f64 {
        (self.leave - self.enter).to_f64()
    }
}

impl Ray {
    /// The point at `t`, in cells of `level`.
    pub(crate) fn at(&self, t: DoubleDouble, level: usize) -> [DoubleDouble; 3] {
        std::array::from_fn(|a| (self.origin[a] + self.direction[a] * t).scaled(level as i32))
    }

    /// Where the ray crosses the plane at `cells` cells of `level` along `axis`.
    fn crossing(&self, axis: usize, cells: DoubleDouble, level: usize) -> DoubleDouble {
        (cells.scaled(-(level as i32)) - self.origin[axis]) / self.direction[axis]
    }

    /// The part of the ray inside the domain; faces on the upper side lie outside.
    pub(crate) fn inside(&self, root_cells: [i64; 3]) -> Option<(DoubleDouble, DoubleDouble)> {
        let mut enter = DoubleDouble::from(if self.forward_only { 0.0 } else { f64::NEG_INFINITY });
        let mut leave = DoubleDouble::from(f64::INFINITY);
        for (a, cells) in root_cells.into_iter().enumerate() {
            let upper = DoubleDouble::from_index(cells);
            if self.direction[a].is_zero() {
                if self.origin[a] < DoubleDouble::ZERO || self.origin[a] >= upper {
                    return None;
                }
                continue;
            }
            let near = self.crossing(a, DoubleDouble::ZERO, 0);
            let far = self.crossing(a, upper, 0);
            let (near, far) = if near < far { (near, far) } else { (far, near) };
            enter = if near > enter { near } else { enter };
            leave = if far < leave { far } else { leave };
        }
        (enter < leave).then_some((enter, leave))
    }

    /// The cuts of `enter..leave` at planes `lo + step, lo + 2 step … < hi` (in cells of
    /// `level`) along each axis: ascending, both ends included.
    pub(crate) fn cuts(
        &self,
        level: usize,
        (lo, hi): ([i64; 3], [i64; 3]),
        step: f64,
        (enter, leave): (DoubleDouble, DoubleDouble),
    ) -> Vec<DoubleDouble> {
        let mut cuts = vec![enter, leave];
        for a in (0..3).filter(|&a| !self.direction[a].is_zero()) {
            let planes = ((hi[a] - lo[a]) as f64 / step) as i64;
            for plane in 1..planes {
                let offset = DoubleDouble::from(plane as f64 * step);
                let t = self.crossing(a, DoubleDouble::from_index(lo[a]) + offset, level);
                if enter < t && t < leave {
                    cuts.push(t);
                }
            }
        }
        cuts.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
        cuts.dedup();
        cuts
    }

    /// Hands every leaf cell's segment to `visit`, front to back, until it returns false.
    pub(crate) fn walk(&self, dataset: &Dataset, visit: &mut dyn FnMut(&Segment) -> bool) {
        let root = dataset.root_cells();
        if let Some(range) = self.inside(root) {
            self.walk_box(dataset, 0, ([0; 3], root), range, visit);
        }
    }

    fn walk_box(
        &self,
        dataset: &Dataset,
        level: usize,
        (lo, hi): ([i64; 3], [i64; 3]),
        range: (DoubleDouble, DoubleDouble),
        visit: &mut dyn FnMut(&Segment) -> bool,
    ) -> bool {
        let cuts = self.cuts(level, (lo, hi), 1.0, range);
        cuts.windows(2).all(|ends| {
            let middle = (ends[0] + ends[1]).scaled(-1);
            let point = self.at(middle, level);
            let index = [0, 1, 2].map(|a| point[a].floor().clamp(lo[a], hi[a] - 1));
            match dataset.cell(level, index) {
                Some(cell) if cell.refined => {
                    let beneath = (index.map(|i| 2 * i), index.map(|i| 2 * i + 2));
                    self.walk_box(dataset, level + 1, beneath, (ends[0], ends[1]), visit)
                }
                Some(_) => visit(&Segment { level, index, enter: ends[0], leave: ends[1] }),
                None => true,
            }
        })
    }
}
