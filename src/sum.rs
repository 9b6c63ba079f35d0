//! Sums that lose nothing to rounding.

/// A sum whose rounding errors are carried along (Neumaier, ZAMM 54, 1974).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Sum {
    sum: f64,
    carried: f64,
}

impl Sum {
    /// Adds a number.
    pub(crate) fn add(&mut self, value: f64) {
        let sum = self.sum + value;
        self.carried += if self.sum.abs() >= value.abs() {
            (self.sum - sum) + value
        } else {
            (value - sum) + self.sum
        };
        self.sum = sum;
    }

    /// What it has come to.
    pub(crate) fn value(self) -> f64 {
        self.sum + self.carried
    }
}
