//! Numbers as sums of two doubles.

/// A number as the sum of two doubles, of which the second is no more than what rounding leaves of
/// the first: exact to some 2⁻¹⁰⁰ of it (Dekker, *Numerische Mathematik* 18, 1971).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Twofold {
    /// The number, rounded.
    pub(crate) high: f64,
    /// What is left.
    pub(crate) low: f64,
}

impl From<f64> for Twofold {
    fn from(high: f64) -> Self {
        Self { high, low: 0.0 }
    }
}

impl Twofold {
    /// a + b, exactly.
    pub(crate) fn sum(a: f64, b: f64) -> Self {
        let high = a + b;
        let of_b = high - a;
        Self { high, low: (a - (high - of_b)) + (b - of_b) }
    }

    /// a · b, exactly.
    pub(crate) fn product(a: f64, b: f64) -> Self {
        let high = a * b;
        Self { high, low: a.mul_add(b, -high) }
    }

    /// The sum of both.
    pub(crate) fn plus(self, other: Self) -> Self {
        let sum = Self::sum(self.high, other.high);
        Self::sum(sum.high, sum.low + (self.low + other.low))
    }

    /// The product of both.
    pub(crate) fn times(self, other: Self) -> Self {
        let product = Self::product(self.high, other.high);
        let rest = product.low + (self.high * other.low + self.low * other.high);
        Self::sum(product.high, rest)
    }

    /// The quotient of both.
    pub(crate) fn over(self, other: Self) -> Self {
        let high = self.high / other.high;
        let rest = (-high).mul_add(other.high, self.high) + (self.low - high * other.low);
        Self::sum(high, rest / other.high)
    }

    /// The largest whole number that is not above it; the nearest there is beyond ±2¹²⁷.
    pub(crate) fn floor(self) -> i128 {
        let whole = self.high.floor();
        let rest = ((self.high - whole) + self.low).floor();
        (whole as i128).saturating_add(rest as i128)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_third_times_three_is_one_beyond_a_doubles_last_bit() {
        let third = Twofold::from(1.0).over(Twofold::from(3.0));
        let one = third.times(Twofold::from(3.0));
        let off = (one.high - 1.0) + one.low;
        assert!(off.abs() < 1e-31 && third.low != 0.0, "{off:e}");
        let tenth = Twofold::sum(1.0, 1e-20).plus(Twofold::from(-1.0));
        assert_eq!((tenth.high, tenth.low), (1e-20, 0.0));
    }

    #[test]
    fn floors_see_both_parts() {
        assert_eq!(Twofold { high: 3.0, low: -1e-20 }.floor(), 2);
        assert_eq!(Twofold { high: 2f64.powi(80), low: 5.5 }.floor(), (1 << 80) + 5);
        assert_eq!(Twofold { high: -0.5, low: 0.0 }.floor(), -1);
    }
}
