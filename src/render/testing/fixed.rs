//! Fixed-point numbers of arbitrary size, for tests that ask what is exact.

use std::ops::{Add, Mul, Neg, Sub};

use num_bigint::BigInt;
use num_traits::{Float, One, Signed, ToPrimitive, Zero};

/// Bits behind the point: sums of 10⁻⁴⁰ keep 70 digits.
const BITS: u32 = 384;

/// A number in units of 2⁻³⁸⁴; products and quotients are floored.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Fixed(BigInt);

impl Fixed {
    pub(crate) fn zero() -> Self {
        Self(BigInt::zero())
    }

    pub(crate) fn one() -> Self {
        Self(BigInt::one() << BITS)
    }

    /// The number that a finite double is, exact down to 2⁻³⁸⁴.
    pub(crate) fn of(value: f64) -> Self {
        let (mantissa, exponent, sign) = value.integer_decode();
        let whole = BigInt::from(mantissa) * i32::from(sign);
        let shift = i32::from(exponent) + BITS as i32;
        Self(if shift >= 0 { whole << shift as u32 } else { whole >> shift.unsigned_abs() })
    }

    /// The nearest double.
    pub(crate) fn to_f64(&self) -> f64 {
        let excess = (self.0.bits() as i32 - 1000).max(0);
        let kept = (&self.0 >> excess as u32).to_f64().unwrap_or(f64::NAN);
        kept * f64::from(excess - BITS as i32).exp2()
    }

    /// Times 2^`power`.
    pub(crate) fn scaled(&self, power: i32) -> Self {
        let shift = power.unsigned_abs();
        Self(if power >= 0 { &self.0 << shift } else { &self.0 >> shift })
    }

    /// Divided by a whole number above 0.
    pub(super) fn over(&self, divisor: usize) -> Self {
        Self(&self.0 / divisor)
    }

    /// Divided by a number that is not 0.
    pub(crate) fn divided(&self, divisor: &Self) -> Self {
        Self((&self.0 << BITS) / &divisor.0)
    }

    /// Times a whole number.
    pub(super) fn times(&self, factor: usize) -> Self {
        Self(&self.0 * factor)
    }

    pub(crate) fn abs(&self) -> Self {
        Self(self.0.abs())
    }

    /// Whether the size is below 2^−`bits`.
    pub(super) fn is_below(&self, bits: u32) -> bool {
        self.0.bits() < u64::from(BITS - bits)
    }

    /// e to this power, for powers in [−300, 0].
    pub(crate) fn exp(&self) -> Self {
        const HALVINGS: i32 = 12;
        let small = self.scaled(-HALVINGS);
        let (mut sum, mut term) = (Self::one(), Self::one());
        for n in 1.. {
            term = (&term * &small).over(n);
            if term.is_below(BITS - 8) {
                break;
            }
            sum = &sum + &term;
        }
        (0..HALVINGS).fold(sum, |power, _| &power * &power)
    }
}

impl Add for &Fixed {
    type Output = Fixed;
    fn add(self, other: Self) -> Fixed {
        Fixed(&self.0 + &other.0)
    }
}

impl Sub for &Fixed {
    type Output = Fixed;
    fn sub(self, other: Self) -> Fixed {
        Fixed(&self.0 - &other.0)
    }
}

impl Mul for &Fixed {
    type Output = Fixed;
    fn mul(self, other: Self) -> Fixed {
        Fixed((&self.0 * &other.0) >> BITS)
    }
}

impl Neg for &Fixed {
    type Output = Fixed;
    fn neg(self) -> Fixed {
        Fixed(-&self.0)
    }
}

#[test]
fn known_numbers() {
    let third = Fixed::one().over(3);
    assert_eq!(third.to_f64(), 1.0 / 3.0);
    assert!(((&third * &Fixed::of(-1.5e30)).to_f64() / -5e29 - 1.0).abs() < 1e-15);
    assert_eq!(Fixed::of(1e-30).divided(&Fixed::of(-4e-30)).to_f64(), -0.25);
    for power in [0.0, -1e-20, -0.5, -100.0_f64] {
        assert!((Fixed::of(power).exp().to_f64() / power.exp() - 1.0).abs() < 1e-15, "{power}");
    }
    // e⁻¹ to 30 digits, less its first 17.
    let e = Fixed::of(-1.0).exp();
    let rest = &(&e.times(10_usize.pow(17)) - &Fixed::of(36_787_944_117_144_232.0)).times(1000);
    assert_eq!(rest.times(10_usize.pow(10)).to_f64().floor(), 1_595_523_770_161.0);
}
