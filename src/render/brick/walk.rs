//! The walk of a ray from cell to cell of a regular grid.

use crate::render::camera::frame::LocalRay;

/// The stretch [from, to] of σ in which `ray` is inside the box [lo, hi] (local cells) and in
/// front of the eye, if there is one.
pub(crate) fn clip(ray: &LocalRay, lo: [f64; 3], hi: [f64; 3]) -> Option<(f64, f64)> {
    Crossings::new(ray, lo, hi).within(ray, [0.0; 3], 0)
}

/// Where a ray crosses the planes of a box's faces.
pub(crate) struct Crossings {
    /// The box.
    lo: [f64; 3],
    hi: [f64; 3],
    /// σ at the lower and the upper plane along each axis.
    planes: [[f64; 2]; 3],
    /// σ for each cell along each axis; without limit where the ray does not move along it.
    inverse: [f64; 3],
}

impl Crossings {
    /// Of a ray and the box [lo, hi] (local cells).
    #[inline]
    pub(crate) fn new(ray: &LocalRay, lo: [f64; 3], hi: [f64; 3]) -> Self {
        let inverse = ray.direction.to_array().map(f64::recip);
        let planes = std::array::from_fn(|a| {
            [lo[a], hi[a]].map(|plane| (plane - ray.origin[a]) * inverse[a])
        });
        Self { lo, hi, planes, inverse }
    }

    /// The stretch of σ in which the ray is inside and in front of the eye, if there is one, where those
    /// of the box's `faces` (a bit each: lower ones, then upper ones) lie `off` cells farther outside.
    #[inline]
    pub(crate) fn within(&self, ray: &LocalRay, off: [f64; 3], faces: u8) -> Option<(f64, f64)> {
        let (mut from, mut to) = (ray.sigma_min, f64::INFINITY);
        for (a, off) in off.into_iter().enumerate() {
            let by = |face: usize| if faces >> face & 1 == 1 { off } else { 0.0 };
            let (lower, upper, inverse) = (by(a), by(3 + a), self.inverse[a]);
            if inverse.is_finite() {
                let [s, t] = self.planes[a];
                let (s, t) = (s - lower * inverse, t + upper * inverse);
                from = from.max(s.min(t));
                to = to.min(s.max(t));
            } else if !(self.lo[a] - lower..self.hi[a] + upper).contains(&ray.origin[a]) {
                return None;
            }
        }
        (from < to && to.is_finite() && from.is_finite()).then_some((from, to))
    }
}

/// One cell on the way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Step {
    /// The cell.
    pub(crate) cell: [i32; 3],
    /// σ where the ray enters.
    pub(crate) from: f64,
    /// σ where the ray leaves.
    pub(crate) to: f64,
}

/// Rounding of a place on a ray, relative to what it is the sum of.
const PLACE_ROUNDING: f64 = 4.0 * f64::EPSILON;
/// Along an axis with hardly any motion rounding reaches farther; no more than this of it is passed over.
const MOST_REACH: f64 = 64.0;

/// Walks the cells [n, n + 1) of a grid, each σ computed anew from the plane's own position, so
/// that nothing drifts.
pub(crate) struct Walk {
    origin: [f64; 3],
    inverse: [f64; 3],
    next: [f64; 3],
    sign: [i32; 3],
    /// 1 where the plane ahead of a cell is its upper one.
    ahead: [i32; 3],
    cell: [i32; 3],
    last: [i32; 3],
    from: f64,
    to: f64,
}

impl Walk {
    /// The walk of `ray` from σ `from` to `to` through cells `lo` to `hi` (inclusive) of the grid
    /// whose cell 0 begins at −`shift` along every axis.
    pub(crate) fn new(
        ray: &LocalRay,
        (from, to): (f64, f64),
        shift: f64,
        lo: [i32; 3],
        hi: [i32; 3],
    ) -> Self {
        let origin = ray.origin.to_array().map(|x| x + shift);
        let direction = ray.direction.to_array();
        let mut walk = Self {
            origin,
            inverse: direction.map(f64::recip),
            next: [f64::INFINITY; 3],
            sign: [0; 3],
            ahead: [0; 3],
            cell: lo,
            last: hi,
            from,
            to,
        };
        for a in 0..3 {
            let moves = walk.inverse[a].is_finite();
            let x = if moves { origin[a] + direction[a] * from } else { origin[a] };
            walk.cell[a] = (x.floor() as i32).clamp(lo[a], hi[a]);
            if moves {
                let up = direction[a] > 0.0;
                walk.sign[a] = if up { 1 } else { -1 };
                walk.ahead[a] = i32::from(up);
                walk.last[a] = if up { hi[a] } else { lo[a] };
                walk.next[a] = walk.plane(a);
            }
        }
        if from - ray.sigma_min <= PLACE_ROUNDING * MOST_REACH * (1.0 + from.abs()) {
            walk.leave_planes_behind();
        }
        walk
    }

    /// A ray that begins in a plane, to rounding, begins in the cell in front of the eye: where it is black
    /// there, nothing of what lies behind the eye may show.
    fn leave_planes_behind(&mut self) {
        for a in 0..3 {
            let reach = (self.origin[a].abs() + 1.0) * self.inverse[a].abs() + self.from.abs();
            let rounding = PLACE_ROUNDING * reach.min(MOST_REACH * (1.0 + self.from.abs()));
            let is_behind = self.next[a] - self.from <= rounding;
            if is_behind && self.cell[a] != self.last[a] {
                self.cell[a] += self.sign[a];
                self.next[a] = self.plane(a);
            } else if is_behind {
                self.from = self.to;
            }
        }
    }

    #[inline]
    fn plane(&self, a: usize) -> f64 {
        (f64::from(self.cell[a] + self.ahead[a]) - self.origin[a]) * self.inverse[a]
    }

    /// The next cell in which the ray has some length.
    #[inline]
    pub(crate) fn next(&mut self) -> Option<Step> {
        while self.from < self.to {
            let [x, y, z] = self.next;
            let a = if x <= y && x <= z {
                0
            } else if y <= z {
                1
            } else {
                2
            };
            let (cell, from) = (self.cell, self.from);
            let to = self.next[a].min(self.to);
            if self.cell[a] == self.last[a] {
                self.from = self.to;
                let to = self.to;
                return Some(Step { cell, from, to });
            }
            self.cell[a] += self.sign[a];
            self.next[a] = self.plane(a);
            if to > from {
                self.from = to;
                return Some(Step { cell, from, to });
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use proptest::prelude::*;

    use super::*;

    /// Cells along the grid's edge.
    const EDGE: i32 = 8;

    proptest! {
        #![proptest_config(ProptestConfig { cases: 2000, ..ProptestConfig::default() })]

        /// Whatever rounding makes of the eye's place, which rays tell by their own origins, and of the
        /// length ahead of it.
        #[test]
        fn a_ray_from_a_plane_begins_in_front_of_the_eye(
            (axis, plane) in (0..3_usize, 0..=EDGE),
            aside in prop::array::uniform3(0.01..7.99_f64),
            towards in prop::array::uniform3(prop_oneof![-1.0..-0.01_f64, 0.01..1.0_f64]),
            depth in prop_oneof![1 => Just(0.0), 4 => 0.0..30.0_f64],
        ) {
            let direction = DVec3::from(towards);
            let mut eye = DVec3::from(aside);
            eye[axis] = f64::from(plane);
            // Only along the axis the eye lies in a plane.
            prop_assume!((0..3).all(|a| a == axis || (eye[a] - eye[a].round()).abs() > 1e-6));
            let ray = LocalRay {
                origin: eye + direction * depth,
                direction,
                length: direction.length(),
                sigma_min: -depth,
            };
            let whole = clip(&ray, [0.0; 3], [f64::from(EDGE); 3]);
            let first = if direction[axis] > 0.0 { plane } else { plane - 1 };
            let steps: Vec<Step> = whole
                .map(|span| Walk::new(&ray, span, 0.0, [0; 3], [EDGE - 1; 3]))
                .map(|mut walk| std::iter::from_fn(|| walk.next()).collect())
                .unwrap_or_default();
            if !(0..EDGE).contains(&first) {
                prop_assert!(steps.is_empty(), "{:?}", steps);
                return Ok(());
            }
            prop_assert_eq!(steps[0].cell[axis], first);
            prop_assert!((steps[0].from + depth).abs() < 1e-12);
            for pair in steps.windows(2) {
                prop_assert_eq!(pair[0].to, pair[1].from);
            }
            prop_assert_eq!(steps[steps.len() - 1].to, whole.unwrap().1);
        }
    }
}
