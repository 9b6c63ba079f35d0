//! How far the rays of a square are apart in a brick, and over how much of a ray's way through a cell
//! they are on both sides of a plane at which formulas change.

use crate::render::brick::walk::Step;
use crate::render::camera::frame::LocalRay;

/// How far the rays of a square are from its centre's in a brick, at the same distance from the eye.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Spread {
    /// Displacement of the farthest, cells along each axis.
    pub(crate) cells: [f64; 3],
    /// What of that does not cancel between opposite rays, however small the displacement: places at
    /// one distance from the eye lie on a sphere, towards the eye of the plane through the centre's.
    pub(crate) bend: [f64; 3],
    /// Half the square's diagonal as an angle.
    pub(crate) angle: f64,
}

/// A ray's way through a unit cube, in its coordinates, and how far the square's rays are away.
pub(crate) struct Touch {
    from: [f64; 3],
    to: [f64; 3],
    spread: [f64; 3],
}

impl Touch {
    /// The way of `ray` through the cell of `step`, in a grid whose cell 0 begins at −`shift`.
    #[inline]
    pub(crate) fn new(ray: &LocalRay, step: &Step, shift: f64, spread: [f64; 3]) -> Self {
        let at = |sigma: f64| -> [f64; 3] {
            std::array::from_fn(|a| {
                ray.origin[a] + ray.direction[a] * sigma + shift - f64::from(step.cell[a])
            })
        };
        Self { from: at(step.from), to: at(step.to), spread }
    }

    /// The share of the way within reach of the plane where coordinate `a` is `value`.
    #[inline]
    pub(crate) fn plane(&self, a: usize, value: f64) -> f64 {
        share_near(self.from[a] - value, self.to[a] - value, self.spread[a])
    }

    /// How far rays of the square are, on average over the way and the square, beyond the plane
    /// where coordinate `a` is `value`, of those that are on its far side; the others count as 0.
    ///
    /// For displacements δ that are uniform within ± D that is E[(δ − d)⁺] = (D − d)² / 4D at
    /// distance d. A square's displacements along an axis are sums of two uniform ones with the
    /// same bound, which is less than that at any d.
    #[inline]
    pub(crate) fn beyond(&self, a: usize, value: f64) -> f64 {
        mean_beyond((self.from[a] - value).abs(), (self.to[a] - value).abs(), self.spread[a])
    }

    /// The shares of the way within reach of each of the cube's six faces, summed.
    #[inline]
    pub(crate) fn faces(&self) -> f64 {
        (0..3).map(|a| self.plane(a, 0.0) + self.plane(a, 1.0)).sum()
    }

    /// The shares of the way within reach of each of the three planes through the cube's middle
    /// that are parallel to faces, summed.
    pub(crate) fn middles(&self) -> f64 {
        (0..3).map(|a| self.plane(a, 0.5)).sum()
    }

    /// The shares of the way within reach of each of the six planes through two opposite edges of
    /// the cube, summed.
    pub(crate) fn diagonals(&self) -> f64 {
        let mut sum = 0.0;
        for (a, b) in [(0, 1), (1, 2), (2, 0)] {
            let reach = self.spread[a] + self.spread[b];
            let less = |p: &[f64; 3]| p[a] - p[b];
            let more = |p: &[f64; 3]| p[a] + p[b] - 1.0;
            sum += share_near(less(&self.from), less(&self.to), reach);
            sum += share_near(more(&self.from), more(&self.to), reach);
        }
        sum
    }
}

/// The share of a way along which a coordinate goes from `from` to `to` that is within `reach` of
/// 0.
#[inline]
fn share_near(from: f64, to: f64, reach: f64) -> f64 {
    let (low, high) = (from.min(to), from.max(to));
    if high < -reach || low > reach {
        return 0.0;
    }
    let width = high - low;
    if width < 1e-9 {
        return 1.0;
    }
    ((high.min(reach) - low.max(-reach)) / width + 1e-9).clamp(0.0, 1.0)
}

/// Mean of (D − d)⁺² / 4D with D = `reach` for d from `from` to `to`.
#[inline]
fn mean_beyond(from: f64, to: f64, reach: f64) -> f64 {
    let (low, high) = (from.min(to), from.max(to));
    let left = reach - low;
    if left <= 0.0 {
        return 0.0;
    }
    let width = high - low;
    if width < 1e-6 * reach {
        return left * left / (4.0 * reach);
    }
    let right = (reach - high).max(0.0);
    (left.powi(3) - right.powi(3)) / (12.0 * reach * width)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn shares_by_hand() {
        let ray = LocalRay {
            origin: DVec3::new(-0.5, 0.3, 0.9),
            direction: DVec3::new(1.0, 0.0, 0.0),
            length: 1.0,
            sigma_min: 0.0,
        };
        let step = Step { cell: [0; 3], from: 0.5, to: 1.5 };
        let touch = Touch::new(&ray, &step, 0.0, [0.1, 0.2, 0.2]);
        let close = |a: f64, b: f64| (a - b).abs() < 1e-6;
        assert!(close(touch.plane(0, 0.0), 0.1) && close(touch.plane(0, 0.5), 0.2));
        assert_eq!((touch.plane(1, 0.0), touch.plane(2, 1.0)), (0.0, 1.0));
        assert!(close(touch.faces(), 1.2));
        assert!(close(touch.middles(), 0.2 + 1.0));
        // x = y at 0.3, x = 1 − y at 0.7, within 0.3; x = z at 0.9, 1 − z at 0.1; y, z apart.
        assert!(close(touch.beyond(0, 0.0), 0.1 / 12.0 * 0.1));
        assert!(close(touch.beyond(1, 0.2), 0.01 / 0.8) && touch.beyond(1, 0.0) == 0.0);
        assert!(close(touch.diagonals(), 0.6 + 0.6 + 0.4 + 0.4 + 1.0));
    }
}
