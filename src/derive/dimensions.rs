//! Physical dimensions in cgs, as products of powers of base units.

use std::fmt;

/// Base units, in the order of exponents.
const BASES: [&str; 4] = ["g", "cm", "s", "K"];
/// Exponents are multiples of such a part: hundredths, halves to eighths and twelfths are exact.
const PARTS: i32 = 4200;
/// Largest exponent kept.
const LARGEST: i32 = 100 * PARTS;

/// Names of units whose factor to cgs is 1, and their exponents of g, cm, s, K in halves.
const NAMES: [(&str, [i32; 4]); 9] = [
    ("g", [2, 0, 0, 0]),
    ("cm", [0, 2, 0, 0]),
    ("s", [0, 0, 2, 0]),
    ("K", [0, 0, 0, 2]),
    ("erg", [2, 4, -4, 0]),
    ("dyn", [2, 2, -4, 0]),
    ("gauss", [1, -1, -2, 0]),
    ("Gauss", [1, -1, -2, 0]),
    ("dimensionless", [0, 0, 0, 0]),
];

/// A product of powers of g, cm, s and K.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Dimensions([i32; 4]);

impl Dimensions {
    /// The dimensions of a pure number.
    pub(super) const NONE: Self = Self([0; 4]);

    /// The dimensions of the unit `name`, if it is a cgs one.
    pub(super) fn of_unit(name: &str) -> Option<Self> {
        let (_, halves) = NAMES.iter().find(|(known, _)| *known == name)?;
        Some(Self(halves.map(|n| n * PARTS / 2)))
    }

    /// The dimensions of `self · other^sign`; none where an exponent is larger than is kept.
    pub(super) fn times(self, other: Self, sign: i32) -> Option<Self> {
        Self::checked(std::array::from_fn(|i| self.0[i] + sign * other.0[i]))
    }

    /// The dimensions of `self^exponent`; none where an exponent is no multiple of a part, or
    /// larger than is kept.
    pub(super) fn power(self, exponent: f64) -> Option<Self> {
        let powers = self.0.map(|n| f64::from(n) * exponent);
        let whole = |x: &f64| x.abs() <= f64::from(LARGEST) && (x - x.round()).abs() < 1e-9;
        if !powers.iter().all(whole) {
            return None;
        }
        Self::checked(powers.map(|x| x.round() as i32))
    }

    fn checked(exponents: [i32; 4]) -> Option<Self> {
        exponents.iter().all(|n| n.abs() <= LARGEST).then_some(Self(exponents))
    }
}

impl fmt::Display for Dimensions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let factor = |(base, &n): (&&str, &i32)| match (n.abs(), n.abs() % PARTS) {
            (PARTS, _) => (*base).to_owned(),
            (n, 0) => format!("{base}^{}", n / PARTS),
            (n, _) => {
                let divisor = num_integer::gcd(n, PARTS);
                format!("{base}^({}/{})", n / divisor, PARTS / divisor)
            }
        };
        let of_sign = |sign: i32| -> Vec<String> {
            let factors = BASES.iter().zip(&self.0);
            factors.filter(|(_, n)| n.signum() == sign).map(factor).collect()
        };
        let (over, under) = (of_sign(1), of_sign(-1));
        let over = match over.is_empty() {
            true if under.is_empty() => return f.write_str("dimensionless"),
            true => "1".to_owned(),
            false => over.join("*"),
        };
        match &under[..] {
            [] => f.write_str(&over),
            [one] => write!(f, "{over}/{one}"),
            more => write!(f, "{over}/({})", more.join("*")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> Dimensions {
        Dimensions::of_unit(text).unwrap()
    }

    #[test]
    fn products_and_powers_are_written_as_units_are() {
        let over = |a: Dimensions, b: Dimensions| a.times(b, -1).unwrap();
        let volume = of("cm").power(3.0).unwrap();
        assert_eq!(over(of("g"), volume).to_string(), "g/cm^3");
        assert_eq!(over(of("erg"), volume).to_string(), "g/(cm*s^2)");
        assert_eq!(over(of("erg"), of("g")).power(0.5).unwrap().to_string(), "cm/s");
        assert_eq!(of("g").power(-1.4).unwrap().to_string(), "1/g^(7/5)");
        assert_eq!(of("g").power(0.67).unwrap().to_string(), "g^(67/100)");
        assert_eq!(of("gauss").to_string(), "g^(1/2)/(cm^(1/2)*s)");
        assert_eq!(over(Dimensions::NONE, of("s")).to_string(), "1/s");
        assert_eq!(over(of("s"), of("s")).to_string(), "dimensionless");
    }

    #[test]
    fn what_cannot_be_kept_is_unknown() {
        assert_eq!(Dimensions::of_unit("code_length"), None);
        assert_eq!(of("cm").power(1.0 / 9.0), None);
        assert_eq!(of("cm").power(1.0 / 3.0).and_then(|d| d.power(3.0)), Some(of("cm")));
        assert_eq!(of("cm").power(1e300), None);
        assert_eq!(of("cm").power(f64::NAN), None);
        let large = of("cm").power(100.0).unwrap();
        assert_eq!(large.times(of("cm"), 1), None);
        assert_eq!(Dimensions::NONE.power(1.0 / 9.0), Some(Dimensions::NONE));
    }
}
