//! How far pictures and rays may be off, by cause.

/// The part of what rays are bound to be off by for levels, digits, quadrature and proxies that they are
/// off by in all likelihood, at most: pictures' largest errors are a sixth of their bounds or less in three
/// of four (`docs/ACCURACY.md`, "Bound and truth").
pub(crate) const LIKELY_OF_BOUND: f64 = 1.0 / 3.0;

/// How far a picture may be off, by cause; in its own unit.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize)]
pub struct ErrorShares {
    /// Cells drawn coarser than the data.
    pub levels: f64,
    /// Values read in fewer digits than are stored.
    pub digits: f64,
    /// Transfer function and integrals replaced by simpler ones.
    pub quadrature: f64,
    /// Pixels' areas replaced by finitely many rays.
    pub pixel_area: f64,
    /// Rays replaced by others beside them.
    pub proxies: f64,
    /// Stored values that are not the source's: f32, or `ingest --error`.
    pub storage: f64,
    /// Rays that ended before the domain's far side.
    pub termination: f64,
    /// Rounding, of sums along rays and of the picture's f32.
    pub rounding: f64,
}

impl ErrorShares {
    /// All together.
    pub fn total(&self) -> f64 {
        let all: f64 = self.to_array().iter().sum();
        // Nothing is known then.
        if all.is_nan() { f64::INFINITY } else { all }
    }

    fn to_array(self) -> [f64; 8] {
        let Self { levels, digits, quadrature, pixel_area, .. } = self;
        let Self { proxies, storage, termination, rounding, .. } = self;
        [levels, digits, quadrature, pixel_area, proxies, storage, termination, rounding]
    }

    fn from_array(all: [f64; 8]) -> Self {
        let [levels, digits, quadrature, pixel_area, proxies, storage, termination, rounding] = all;
        Self { levels, digits, quadrature, pixel_area, proxies, storage, termination, rounding }
    }

    /// What a ray is likely to be off by itself: all but what pixels' areas are off by, which may be without
    /// limit.
    pub(crate) fn likely_beside_area(&self) -> f64 {
        let Self { storage, termination, rounding, .. } = self;
        let all = self.likely_of_rays() + (storage + termination + rounding);
        if all.is_nan() { f64::INFINITY } else { all }
    }

    /// The part of that which more care, finer levels or more digits change.
    pub(crate) fn likely_of_rays(&self) -> f64 {
        let Self { levels, digits, quadrature, proxies, .. } = self;
        LIKELY_OF_BOUND * (levels + digits + quadrature + proxies)
    }

    /// Adds `weight` times another's.
    pub(crate) fn add(&mut self, other: &Self, weight: f64) {
        let (mut all, other) = (self.to_array(), other.to_array());
        all.iter_mut().zip(other).for_each(|(share, other)| *share += weight * other);
        *self = Self::from_array(all);
    }
}

/// The same of one of many rays, in half the room: as f32, none smaller than it was.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct RayShares([f32; 8]);

impl From<ErrorShares> for RayShares {
    fn from(shares: ErrorShares) -> Self {
        Self(shares.to_array().map(|share| {
            let rounded = share as f32;
            if f64::from(rounded) < share { rounded.next_up() } else { rounded }
        }))
    }
}

impl From<RayShares> for ErrorShares {
    fn from(RayShares(all): RayShares) -> Self {
        Self::from_array(all.map(f64::from))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rays_shares_are_no_smaller_in_half_the_room() {
        let numbers = [0.1, 0.0, 1e-50, f64::INFINITY, 1e300, 1.0, 3e-7, 2.0];
        let shares = RayShares::from(ErrorShares::from_array(numbers));
        let rounded = ErrorShares::from(shares).to_array();
        for (rounded, number) in rounded.into_iter().zip(numbers) {
            assert!(
                rounded >= number && (rounded > 1e38 || rounded <= 1.000_000_2 * number + 2e-45)
            );
        }
        assert_eq!((rounded[1], rounded[5]), (0.0, 1.0));
        // What f32 cannot hold has no limit, and takes nothing from what is beside it.
        let wide = ErrorShares { pixel_area: 1e39, rounding: 1.0, ..ErrorShares::default() };
        let wide: ErrorShares = RayShares::from(wide).into();
        assert_eq!((wide.total(), wide.likely_beside_area()), (f64::INFINITY, 1.0));
    }
}
