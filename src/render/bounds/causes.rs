//! What a ray itself may be off by, cause by cause.

use super::sums::Sums;

/// What makes a ray be off that was marched, each by sums of its own.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Causes {
    /// Cells that are drawn coarser than the data.
    pub(crate) levels: Sums,
    /// Values that are read in fewer digits than are stored.
    pub(crate) digits: Sums,
    /// Values that are not stored as the source has them.
    pub(crate) storage: Sums,
    /// The march of packets of rays.
    pub(crate) march: Sums,
}

impl Causes {
    /// All together.
    pub(super) fn sum(&self) -> Sums {
        let stored = self.digits.plus(self.storage);
        self.levels.plus(stored).plus(self.march)
    }

    /// ∫ |Δκ| ds of all together.
    #[inline]
    pub(super) fn extinction(&self) -> f64 {
        let stored = self.digits.extinction + self.storage.extinction;
        self.levels.extinction + stored + self.march.extinction
    }

    /// What values as they are read add to, which may have fewer digits than are stored.
    pub(super) fn of_stored(&mut self, is_rounded: bool) -> &mut Sums {
        if is_rounded { &mut self.digits } else { &mut self.storage }
    }

    /// The sum, cause by cause.
    pub(super) fn plus(self, other: Self) -> Self {
        self.with(other, Sums::plus)
    }

    /// The larger, cause by cause and number by number.
    pub(super) fn max(self, other: Self) -> Self {
        self.with(other, Sums::max)
    }

    /// What is left of each where so much `transmittance` lies in front.
    pub(super) fn seen_through(self, transmittance: f64) -> Self {
        self.with(self, |sums, _| sums.seen_through(transmittance))
    }

    fn with(self, other: Self, each: impl Fn(Sums, Sums) -> Sums) -> Self {
        Self {
            levels: each(self.levels, other.levels),
            digits: each(self.digits, other.digits),
            storage: each(self.storage, other.storage),
            march: each(self.march, other.march),
        }
    }
}
