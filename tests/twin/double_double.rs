//! Numbers of about 106 bits as unevaluated sums of two doubles, with the error-free
//! transformations of Knuth (sum) and Dekker (product, here by fused multiply-add).

use std::ops::{Add, Div, Mul, Neg, Sub};

/// `high + low` with `|low|` at most half a unit in the last place of `high`.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub(crate) struct DoubleDouble {
    high: f64,
    low: f64,
}

/// `a + b` and its rounding error, whichever is larger (Knuth's TwoSum).
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let shadow = sum - a;
    (sum, (a - (sum - shadow)) + (b - shadow))
}

/// `a + b` and its rounding error for `|a| >= |b|` (Dekker's FastTwoSum).
fn fast_two_sum(a: f64, b: f64) -> DoubleDouble {
    let sum = a + b;
    DoubleDouble { high: sum, low: b - (sum - a) }
}

/// `a · b` and its rounding error.
fn two_product(a: f64, b: f64) -> (f64, f64) {
    let product = a * b;
    (product, a.mul_add(b, -product))
}

impl DoubleDouble {
    pub(crate) const ZERO: Self = Self { high: 0.0, low: 0.0 };
    pub(crate) const ONE: Self = Self { high: 1.0, low: 0.0 };

    /// The exact sum of two doubles.
    pub(crate) fn sum(a: f64, b: f64) -> Self {
        let (high, low) = two_sum(a, b);
        Self { high, low }
    }

    /// A whole number of up to 106 bits.
    pub(crate) fn from_index(index: i64) -> Self {
        let high = index as f64;
        Self::sum(high, (i128::from(index) - high as i128) as f64)
    }

    /// The nearest double.
    pub(crate) fn to_f64(self) -> f64 {
        self.high
    }

    /// Exact product with a power of two.
    pub(crate) fn scaled(self, power: i32) -> Self {
        let factor = f64::from(power).exp2();
        Self { high: self.high * factor, low: self.low * factor }
    }

    /// The largest whole number that is not above.
    pub(crate) fn floor(self) -> i64 {
        let whole = self.high.floor();
        let low = if whole == self.high { self.low.floor() } else { 0.0 };
        whole as i64 + low as i64
    }

    /// The square root, by one correction of the double's (Karp).
    pub(crate) fn sqrt(self) -> Self {
        if self.high <= 0.0 {
            return Self::ZERO;
        }
        let root = Self::from(self.high.sqrt());
        let corrected = root + (self - root * root) / (root + root);
        corrected + (self - corrected * corrected) / (corrected + corrected)
    }

    pub(crate) fn is_zero(self) -> bool {
        self.high == 0.0
    }
}

impl From<f64> for DoubleDouble {
    fn from(value: f64) -> Self {
        Self { high: value, low: 0.0 }
    }
}

impl Add for DoubleDouble {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        let (high, high_error) = two_sum(self.high, other.high);
        let (low, low_error) = two_sum(self.low, other.low);
        let partial = fast_two_sum(high, high_error + low);
        fast_two_sum(partial.high, partial.low + low_error)
    }
}

impl Neg for DoubleDouble {
    type Output = Self;
    fn neg(self) -> Self {
        Self { high: -self.high, low: -self.low }
    }
}

impl Sub for DoubleDouble {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for DoubleDouble {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let (high, error) = two_product(self.high, other.high);
        fast_two_sum(high, error + (self.high * other.low + self.low * other.high))
    }
}

impl Div for DoubleDouble {
    type Output = Self;
    /// Long division with three quotient digits of a double each.
    fn div(self, other: Self) -> Self {
        let first = self.high / other.high;
        let rest = self - other * Self::from(first);
        let second = rest.high / other.high;
        let rest = rest - other * Self::from(second);
        fast_two_sum(first, second) + Self::from(rest.high / other.high)
    }
}
