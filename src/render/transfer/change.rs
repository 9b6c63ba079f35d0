//! Changes of what the transfer function gives.

/// How much emission and extinction may change.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Change {
    /// Change of emission, at most in any channel: radiance / code length.
    pub(crate) emission: f64,
    /// Change of extinction, 1 / code length.
    pub(crate) extinction: f64,
}

impl Change {
    /// Both, times a factor.
    pub(crate) fn times(self, factor: f64) -> Self {
        Self { emission: self.emission * factor, extinction: self.extinction * factor }
    }

    /// What a ray is off by for each code length of it, with so much light `behind`.
    pub(crate) fn light(self, behind: f64) -> f64 {
        (self.emission + self.extinction * behind).max(self.extinction)
    }

    /// The sum, number by number.
    pub(crate) fn plus(self, other: Self) -> Self {
        Self {
            emission: self.emission + other.emission,
            extinction: self.extinction + other.extinction,
        }
    }

    /// The smaller of each number.
    pub(crate) fn min(self, other: Self) -> Self {
        Self {
            emission: self.emission.min(other.emission),
            extinction: self.extinction.min(other.extinction),
        }
    }

    /// The larger of each number.
    pub(crate) fn max(self, other: Self) -> Self {
        Self {
            emission: self.emission.max(other.emission),
            extinction: self.extinction.max(other.extinction),
        }
    }
}
