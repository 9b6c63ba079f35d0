//! Exact rationals for setting up cameras: decimals as written, domain edges as their doubles.

use num_bigint::BigInt;
use num_integer::Integer;
use num_rational::Ratio;
use num_traits::{Float, FromPrimitive, One, Pow, Signed, ToPrimitive, Zero};

use super::Result;
use super::double_double::DoubleDouble;

pub(crate) type Rational = Ratio<BigInt>;

/// The rational that `text` is: `[sign]digits[.digits][e[sign]digits]`.
pub(crate) fn from_decimal(text: &str) -> Result<Rational> {
    let refuse = || format!("`{text}` is not a decimal number");
    let (mantissa, exponent) = match text.trim().split_once(['e', 'E']) {
        Some((mantissa, exponent)) => (mantissa, exponent.parse::<i32>().map_err(|_| refuse())?),
        None => (text.trim(), 0),
    };
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let digits = format!("{whole}{fraction}");
    let digits: BigInt = digits.parse().map_err(|_| refuse())?;
    let power = exponent - i32::try_from(fraction.len()).map_err(|_| refuse())?;
    let scale = BigInt::from(10).pow(power.unsigned_abs());
    Ok(if power < 0 { Rational::new(digits, scale) } else { Rational::from(digits * scale) })
}

/// The rational that a finite double is.
pub(crate) fn from_double(value: f64) -> Rational {
    let (mantissa, exponent, sign) = value.integer_decode();
    let signed = BigInt::from(mantissa) * BigInt::from(sign);
    let scale = BigInt::one() << exponent.unsigned_abs();
    if exponent < 0 { Rational::new(signed, scale) } else { Rational::from(signed * scale) }
}

/// The nearest double-double, to about 2⁻¹⁰⁶ of the value.
pub(crate) fn to_double_double(value: &Rational) -> DoubleDouble {
    if value.is_zero() {
        return DoubleDouble::ZERO;
    }
    let bits = |n: &BigInt| i64::try_from(n.bits()).unwrap_or(i64::MAX);
    let shift = 200 - (bits(value.numer()) - bits(value.denom()));
    let scale = BigInt::one() << shift.unsigned_abs();
    let scaled = if shift >= 0 {
        (value.numer() * scale).div_floor(value.denom())
    } else {
        value.numer().div_floor(&(value.denom() * scale))
    };
    let high = scaled.to_f64().unwrap_or(f64::NAN);
    let rest = scaled - BigInt::from_f64(high).unwrap_or_default();
    let power = i32::try_from(-shift).unwrap_or(i32::MIN);
    DoubleDouble::sum(high, rest.to_f64().unwrap_or(f64::NAN)).scaled(power)
}

/// `value` with `digits` decimal places, rounded up: what stands for a point on a cell's face
/// lies on or above the face, and comes to lie on it where positions are floored.
pub(crate) fn to_decimal(value: &Rational, digits: usize) -> String {
    let scale = BigInt::from(10).pow(u32::try_from(digits).unwrap_or(u32::MAX));
    let units = (value.numer() * scale).div_ceil(value.denom());
    let text = format!("{:0>width$}", units.abs().to_string(), width = digits + 1);
    let (whole, fraction) = text.split_at(text.len() - digits);
    format!("{}{whole}.{fraction}", if units.is_negative() { "-" } else { "" })
}
