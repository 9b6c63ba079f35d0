//! Decimal numbers of any length as exact rationals.

use num_bigint::BigInt;
use num_traits::{One, Pow, ToPrimitive, Zero};

use crate::{Error, Result};

/// Most digits of a decimal: parsing takes time that grows with their square.
const MAX_DIGITS: usize = 1_000_000;
/// Largest power of ten: far beyond f64's range, and small enough to write out.
const MAX_EXPONENT: i64 = 100_000;

/// An exact rational number, `numerator / denominator` with `denominator > 0`, not reduced.
#[derive(Debug, Clone)]
pub struct Decimal {
    /// The numerator, of either sign.
    pub(super) numerator: BigInt,
    /// The denominator, above 0.
    pub(super) denominator: BigInt,
}

impl Decimal {
    /// Parses `[+-]digits[.digits][e[+-]digits]`, blanks around it ignored, taken exactly.
    ///
    /// # Errors
    /// Anything else (infinities and NaN included), and more than a million digits or an
    /// exponent beyond ±100,000.
    pub fn parse(text: &str) -> Result<Self> {
        let refuse = |why: &str| {
            let shown: String = text.trim().chars().take(40).collect();
            Error::request(format!("`{shown}` is not a decimal number: {why}"))
        };
        let body = text.trim();
        let (negative, body) = match body.as_bytes().first() {
            Some(b'-') => (true, &body[1..]),
            Some(b'+') => (false, &body[1..]),
            _ => (false, body),
        };
        let (mantissa, exponent) = match body.find(['e', 'E']) {
            Some(at) => (
                &body[..at],
                parse_exponent(&body[at + 1..])
                    .ok_or_else(|| refuse("its exponent must be a whole number within ±100000"))?,
            ),
            None => (body, 0),
        };
        let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
        if whole.is_empty() && fraction.is_empty() {
            return Err(refuse("it has no digits"));
        }
        if !whole.bytes().chain(fraction.bytes()).all(|b| b.is_ascii_digit()) {
            return Err(refuse("expected digits, at most one point, and an exponent"));
        }
        if whole.len() + fraction.len() > MAX_DIGITS {
            return Err(refuse("more than a million digits"));
        }
        let digits = [whole.as_bytes(), fraction.as_bytes()].concat();
        let magnitude = BigInt::parse_bytes(&digits, 10).unwrap_or_else(BigInt::zero);
        let numerator = if negative { -magnitude } else { magnitude };
        let shift = exponent - i64::try_from(fraction.len()).unwrap_or(i64::MAX);
        let power = BigInt::from(10).pow(shift.unsigned_abs());
        Ok(if shift >= 0 {
            Self { numerator: numerator * power, denominator: BigInt::one() }
        } else {
            Self { numerator, denominator: power }
        })
    }

    /// The decimal that is the shortest form of `value`, as a person would have written it.
    ///
    /// # Errors
    /// Infinities and NaN.
    pub fn from_shortest(value: f64) -> Result<Self> {
        Self::parse(&format!("{value:e}"))
    }

    /// The difference `self - other`.
    pub fn minus(&self, other: &Self) -> Self {
        Self {
            numerator: &self.numerator * &other.denominator - &other.numerator * &self.denominator,
            denominator: &self.denominator * &other.denominator,
        }
    }

    /// The number as a double, off by 2⁻⁵² of it at most; infinite or 0 where none is so large or small.
    pub fn to_f64(&self) -> f64 {
        // So that the quotient has 64 bits or more.
        let (above, below) = (self.numerator.bits(), self.denominator.bits());
        let shift = (below + 64).saturating_sub(above);
        let quotient = (&self.numerator << shift) / &self.denominator;
        let power = i32::try_from(shift).unwrap_or(i32::MAX);
        // In two steps, as the power alone may be beyond a double where the number is not.
        let half = 2f64.powi(-(power / 2));
        quotient.to_f64().unwrap_or(f64::NAN) * half * 2f64.powi(power / 2 - power)
    }

    /// The rational that the double `value` is.
    ///
    /// # Errors
    /// Infinities and NaN.
    pub fn from_f64(value: f64) -> Result<Self> {
        if !value.is_finite() {
            return Err(Error::request(format!("{value} is not a finite number")));
        }
        let bits = value.to_bits();
        let exponent = i32::try_from((bits >> 52) & 0x7ff).unwrap_or(0);
        let fraction = bits & ((1 << 52) - 1);
        let (mantissa, power) =
            if exponent == 0 { (fraction, -1074) } else { (fraction | 1 << 52, exponent - 1075) };
        let signed = BigInt::from(mantissa) * if value < 0.0 { -1 } else { 1 };
        let scale = BigInt::one() << power.unsigned_abs();
        Ok(if power >= 0 {
            Self { numerator: signed * scale, denominator: BigInt::one() }
        } else {
            Self { numerator: signed, denominator: scale }
        })
    }
}

fn parse_exponent(text: &str) -> Option<i64> {
    let digits = text.strip_prefix(['+', '-']).unwrap_or(text);
    if digits.is_empty() || !digits.bytes().all(|b| b.is_ascii_digit()) {
        return None;
    }
    text.parse::<i64>().ok().filter(|e| e.abs() <= MAX_EXPONENT)
}

impl PartialEq for Decimal {
    fn eq(&self, other: &Self) -> bool {
        &self.numerator * &other.denominator == &other.numerator * &self.denominator
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_values_of_other_spelling_are_equal() {
        for (a, b) in [("0.5", "5e-1"), ("-1.250", "-125E-2"), ("+3", "3.000"), (".5", "0.5")] {
            assert_eq!(Decimal::parse(a).unwrap(), Decimal::parse(b).unwrap());
        }
        assert_ne!(Decimal::parse("0.1").unwrap(), Decimal::from_f64(0.1).unwrap());
        assert_eq!(Decimal::parse("0.1").unwrap(), Decimal::from_shortest(0.1).unwrap());
        assert_eq!(Decimal::parse("5e-324").unwrap(), Decimal::from_shortest(5e-324).unwrap());
        assert_eq!(Decimal::parse("-0.375").unwrap(), Decimal::from_f64(-0.375).unwrap());
    }

    #[test]
    fn differences_as_doubles() {
        let difference = |a: &str, b: &str| {
            Decimal::parse(a).unwrap().minus(&Decimal::parse(b).unwrap()).to_f64()
        };
        assert_eq!(difference("0.75", "0.5"), 0.25);
        assert_eq!(difference("1e300", "-1e300"), 2e300);
        assert_eq!(difference("0.500000000000000000001", "0.5"), 1e-21);
        assert_eq!(difference("0.5", "0.500000000000000000001"), -1e-21);
        assert_eq!(difference("3", "3.0"), 0.0);
        assert_eq!(difference("1e-300", "0"), 1e-300);
        assert_eq!(difference("1e-90000", "0"), 0.0);
        assert_eq!(difference("1e90000", "0"), f64::INFINITY);
    }

    #[test]
    fn what_is_no_decimal_is_refused() {
        for text in [
            "",
            " ",
            "-",
            ".",
            "1..2",
            "1e",
            "1e+",
            "1e1.5",
            "nan",
            "inf",
            "0x1p3",
            "1 2",
            "1e999999999999999999999",
            "١",
            "--1",
            "1e100001",
        ] {
            assert!(Decimal::parse(text).is_err(), "{text}");
        }
        assert!(Decimal::from_f64(f64::NAN).is_err());
        assert!(Decimal::from_shortest(f64::INFINITY).is_err());
    }
}
