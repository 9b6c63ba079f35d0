//! What changes of emission and extinction make of a ray, summed along it.

use crate::render::transfer::change::Change;

/// Changes summed along a ray.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Sums {
    /// ∫ T̃·|Δj| ds.
    pub(crate) emission: f64,
    /// ∫ T̃·|Δκ| ds.
    pub(crate) dimmed: f64,
    /// ∫ |Δκ| ds.
    pub(crate) extinction: f64,
}

impl Sums {
    /// Where nothing is known.
    pub(crate) const ANYTHING: Self =
        Self { emission: f64::INFINITY, dimmed: f64::INFINITY, extinction: f64::INFINITY };

    /// Adds a stretch of `length` along which ∫ T̃ ds is at most `lit`.
    #[inline]
    pub(crate) fn add(&mut self, change: Change, length: f64, lit: f64) {
        self.emission += change.emission * lit;
        self.dimmed += change.extinction * lit;
        self.extinction += change.extinction * length;
    }

    /// The sums of one stretch, as of [`Self::add`].
    pub(crate) fn of(change: Change, length: f64, lit: f64) -> Self {
        let mut sums = Self::default();
        sums.add(change, length, lit);
        sums
    }

    /// The sum, number by number.
    pub(crate) fn plus(self, other: Self) -> Self {
        Self {
            emission: self.emission + other.emission,
            dimmed: self.dimmed + other.dimmed,
            extinction: self.extinction + other.extinction,
        }
    }

    /// The smaller of each number.
    pub(crate) fn min(self, other: Self) -> Self {
        Self {
            emission: self.emission.min(other.emission),
            dimmed: self.dimmed.min(other.dimmed),
            extinction: self.extinction.min(other.extinction),
        }
    }

    /// The larger of each number.
    pub(super) fn max(self, other: Self) -> Self {
        Self {
            emission: self.emission.max(other.emission),
            dimmed: self.dimmed.max(other.dimmed),
            extinction: self.extinction.max(other.extinction),
        }
    }

    /// All of them, times a factor.
    pub(crate) fn times(self, factor: f64) -> Self {
        Self {
            emission: self.emission * factor,
            dimmed: self.dimmed * factor,
            extinction: self.extinction * factor,
        }
    }

    /// The sums where only this `transmittance` is left of what is seen, as behind other things.
    pub(super) fn seen_through(self, transmittance: f64) -> Self {
        Self {
            emission: product(self.emission, transmittance),
            dimmed: product(self.dimmed, transmittance),
            extinction: self.extinction,
        }
    }

    /// What a ray is off by, with so much light `behind`.
    pub(crate) fn light(self, behind: f64) -> f64 {
        larger(self.emission + product(self.dimmed, behind), self.dimmed)
    }

    /// ∫ T̃·(|Δj| + |Δκ|·L) ds where L is at most `brightest`, and the light in ∫ |Δκ|·T̃·L ds what
    /// `absorbed` makes of ∫ |Δκ| ds; and of 1 − T: the larger of both.
    pub(super) fn bound(self, absorbed: impl Fn(f64) -> f64, brightest: f64) -> f64 {
        let absorbed = product(self.dimmed, brightest).min(absorbed(self.extinction));
        larger(self.emission + absorbed, self.dimmed)
    }
}

/// The larger; infinity where either is no number, as differences and products of what overflows are.
pub(crate) fn larger(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::INFINITY } else { a.max(b) }
}

/// The product, 0 where a factor is, also of infinity.
pub(super) fn product(a: f64, b: f64) -> f64 {
    if a == 0.0 || b == 0.0 { 0.0 } else { a * b }
}
