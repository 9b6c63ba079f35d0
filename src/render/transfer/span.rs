//! What the transfer function does over a range of x.

use super::change::Change;
use super::run_tree::Run;

/// What the transfer function does over a range of x.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Span {
    /// Steepest slopes.
    pub(crate) slope: Change,
    /// Sum of changes but for steps, upward and downward ones all positive.
    pub(crate) variation: Change,
    /// Sum of steps.
    pub(crate) jumps: Change,
    /// Largest emission of any channel, and largest extinction.
    pub(crate) most: Change,
}

impl Span {
    /// Whether the function is the same everywhere over the range.
    pub(crate) fn is_constant(&self) -> bool {
        self.variation == Change::default() && self.jumps == Change::default()
    }

    /// Whether the function changes at about the same rate all over the range, which is so wide: without
    /// steps, and nowhere much steeper than on average.
    pub(crate) fn is_even(&self, width: f64) -> bool {
        const STEEPER: f64 = 4.0;
        let Self { slope, variation, jumps, .. } = *self;
        let is_even = |slope: f64, variation: f64| slope * width <= STEEPER * variation;
        jumps == Change::default()
            && is_even(slope.emission, variation.emission)
            && is_even(slope.extinction, variation.extinction)
    }

    /// The larger of each.
    pub(crate) fn max(self, other: Self) -> Self {
        Self {
            slope: self.slope.max(other.slope),
            variation: self.variation.max(other.variation),
            jumps: self.jumps.max(other.jumps),
            most: self.most.max(other.most),
        }
    }
}

impl Run for Span {
    // Of both ranges, which meet.
    fn and(self, other: Self) -> Self {
        Self {
            slope: self.slope.max(other.slope),
            variation: self.variation.plus(other.variation),
            jumps: self.jumps.plus(other.jumps),
            most: self.most.max(other.most),
        }
    }
}

/// How far the transfer function is from linear over a range of x.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Smoothness {
    /// Whether it steps.
    pub(crate) steps: bool,
    /// Steepest slopes.
    pub(crate) slope: Change,
    /// Largest half second derivative of the emission.
    pub(super) bend: f64,
    /// Largest difference of emission to what the pieces say.
    pub(crate) deviation: f64,
    /// Largest emission of any channel, and largest extinction.
    pub(crate) most: Change,
    /// Least extinction.
    pub(crate) least_extinction: f64,
}
