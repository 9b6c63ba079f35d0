//! Expressions over units: which unit a derived field has.

use super::cells::{function_of_one, function_of_two};
use super::dimensions::Dimensions;
use super::expression::{Algebra, Binary, Expression, Unary};
use crate::source::SourceField;

/// Sources print factors with a few digits: equal ones may differ by this part.
const SAME_FACTOR: f64 = 1e-5;

/// A field's unit, as far as it is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Unit {
    /// What it measures.
    pub(super) dimensions: Option<Dimensions>,
    /// Factor from code units to cgs.
    pub(super) to_cgs: Option<f64>,
}

impl Unit {
    const UNKNOWN: Self = Self { dimensions: None, to_cgs: None };
    const NUMBER: Self = Self { dimensions: Some(Dimensions::NONE), to_cgs: Some(1.0) };

    /// What a source says of its field's unit.
    pub(super) fn of(field: &SourceField) -> Self {
        Self { dimensions: field.units.as_deref().and_then(dimensions), to_cgs: field.to_cgs }
    }

    /// The unit of `expression`, whose names have the units `operands`.
    ///
    /// # Errors
    /// Sums, differences and extrema of what has different units.
    pub(super) fn of_expression(
        expression: &Expression,
        operands: &[Self],
    ) -> Result<Self, String> {
        expression.evaluate(&Units { operands }).map(Quantity::unit)
    }

    fn times(self, other: Self, sign: i32) -> Self {
        Self {
            dimensions: both(self.dimensions, other.dimensions).and_then(|(a, b)| a.times(b, sign)),
            to_cgs: both(self.to_cgs, other.to_cgs)
                .map(|(a, b)| a * b.powi(sign))
                .filter(|factor| factor.is_normal()),
        }
    }

    fn power(self, exponent: f64) -> Self {
        let dimensions = self.dimensions.and_then(|of| of.power(exponent));
        if dimensions.is_none() && self.dimensions.is_some() {
            return Self::UNKNOWN;
        }
        let to_cgs = self.to_cgs.map(|of| of.powf(exponent)).filter(|factor| factor.is_normal());
        Self { dimensions, to_cgs }
    }

    /// The unit of what is one of the two or their sum.
    fn shared(self, other: Self) -> Result<Self, String> {
        let Some((ours, theirs)) = both(self.dimensions, other.dimensions) else {
            return Ok(Self::UNKNOWN);
        };
        if ours != theirs {
            return Err(format!("it adds or compares {ours} and {theirs}"));
        }
        match (self.to_cgs, other.to_cgs) {
            (Some(a), Some(b)) if (a - b).abs() > SAME_FACTOR * a.abs() => Err(format!(
                "it adds or compares values in {a} {ours} and in {b} {ours}: multiply one of them"
            )),
            (Some(_), Some(_)) => Ok(self),
            _ => Ok(Self { to_cgs: None, ..self }),
        }
    }
}

fn both<T>(a: Option<T>, b: Option<T>) -> Option<(T, T)> {
    a.zip(b)
}

/// The dimensions of a unit's name, if all in it are units of cgs: `g/cm^3`, `erg/(cm**2*s)`.
fn dimensions(name: &str) -> Option<Dimensions> {
    let expression = Expression::parse(name).ok()?;
    let units: Option<Vec<Unit>> = expression
        .names()
        .iter()
        .map(|name| Some(Unit { dimensions: Some(Dimensions::of_unit(name)?), to_cgs: None }))
        .collect();
    Unit::of_expression(&expression, &units?).ok()?.dimensions
}

/// What an operation is done with.
#[derive(Debug, Clone, Copy)]
enum Quantity {
    /// A number that the expression states: in a sum it has the other's unit.
    Number(f64),
    /// What has a field in it.
    Measured(Unit),
}

impl Quantity {
    fn unit(self) -> Unit {
        match self {
            Self::Number(_) => Unit::NUMBER,
            Self::Measured(unit) => unit,
        }
    }
}

struct Units<'u> {
    operands: &'u [Unit],
}

impl Algebra for Units<'_> {
    type Value = Quantity;
    type Error = String;

    fn number(&self, number: f64) -> Quantity {
        Quantity::Number(number)
    }

    fn operand(&self, index: usize) -> Quantity {
        Quantity::Measured(self.operands[index])
    }

    fn unary(&self, operation: Unary, of: Quantity) -> Result<Quantity, String> {
        let unit = match of {
            Quantity::Number(n) => return Ok(Quantity::Number(function_of_one(operation)(n))),
            Quantity::Measured(unit) => unit,
        };
        Ok(Quantity::Measured(match operation {
            Unary::Negate | Unary::Abs => unit,
            Unary::Sqrt => unit.power(0.5),
            // Of a number in code units that is none in cgs they mean nothing in cgs.
            Unary::Exp | Unary::Log | Unary::Log10 => plain(unit),
        }))
    }

    fn binary(&self, operation: Binary, a: Quantity, b: Quantity) -> Result<Quantity, String> {
        if let (Quantity::Number(a), Quantity::Number(b)) = (a, b) {
            return Ok(Quantity::Number(function_of_two(operation)(a, b)));
        }
        let unit = match (operation, a, b) {
            (Binary::Multiply, a, b) => a.unit().times(b.unit(), 1),
            (Binary::Divide, a, b) => a.unit().times(b.unit(), -1),
            (Binary::Power, a, Quantity::Number(exponent)) => a.unit().power(exponent),
            (Binary::Power, a, b) if plain(a.unit()) == plain(b.unit()) => plain(a.unit()),
            (Binary::Power, ..) => Unit::UNKNOWN,
            (_, Quantity::Measured(unit), Quantity::Number(_))
            | (_, Quantity::Number(_), Quantity::Measured(unit)) => unit,
            (_, a, b) => a.unit().shared(b.unit())?,
        };
        Ok(Quantity::Measured(unit))
    }
}

/// A pure number's unit where `unit` is that, else unknown.
fn plain(unit: Unit) -> Unit {
    if unit == Unit::NUMBER { unit } else { Unit::UNKNOWN }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DENSITY: (&str, Option<f64>) = ("g/cm^3", Some(1e-24));
    const VELOCITY: (&str, Option<f64>) = ("cm/s", Some(1e5));
    const ENERGY: (&str, Option<f64>) = ("erg/g", Some(1e10 * (1.0 + 1e-7)));
    const TEMPERATURE: (&str, Option<f64>) = ("K", Some(1.0));
    const UNKNOWN: (&str, Option<f64>) = ("code_mass", None);

    fn unit(text: &str, fields: &[(&str, Option<f64>)]) -> Result<Unit, String> {
        let of = |&(name, to_cgs): &(&str, _)| {
            Unit::of(&SourceField { name: "x".into(), units: Some(name.into()), to_cgs })
        };
        let operands: Vec<Unit> = fields.iter().map(of).collect();
        Unit::of_expression(&Expression::parse(text).unwrap(), &operands)
    }

    fn shown(text: &str, fields: &[(&str, Option<f64>)]) -> (String, Option<f64>) {
        let unit = unit(text, fields).unwrap();
        (unit.dimensions.map_or("?".into(), |of| of.to_string()), unit.to_cgs)
    }

    #[track_caller]
    fn check(text: &str, fields: &[(&str, Option<f64>)], name: &str, factor: f64) {
        let (found, to_cgs) = shown(text, fields);
        assert_eq!(found, name, "{text}");
        assert!(to_cgs.is_some_and(|found| (found / factor - 1.0).abs() < 1e-12), "{to_cgs:?}");
    }

    #[test]
    fn products_quotients_and_powers_have_units_of_their_own() {
        check("d*v^2/2", &[DENSITY, VELOCITY], "g/(cm*s^2)", 1e-14);
        check("sqrt(x^2+y^2+z^2)", &[VELOCITY; 3], "cm/s", 1e5);
        check("t/d^(2/3)", &[TEMPERATURE, DENSITY], "cm^2*K/g^(2/3)", 1e16);
        check("1/t", &[TEMPERATURE], "1/K", 1.0);
        check("-abs(a)/b", &[VELOCITY; 2], "dimensionless", 1.0);
        check("log10(a/b)", &[DENSITY; 2], "dimensionless", 1.0);
        check("(a/b)^(c/d)", &[TEMPERATURE; 4], "dimensionless", 1.0);
        check("exp(2) * d", &[DENSITY], "g/cm^3", 1e-24);
    }

    #[test]
    fn sums_keep_their_unit_and_stated_numbers_take_it() {
        check("e - 0.5*v^2", &[ENERGY, VELOCITY], "cm^2/s^2", 1e10 * (1.0 + 1e-7));
        check("max(d, 1e-30)", &[DENSITY], "g/cm^3", 1e-24);
        check("1 + t - 273.15", &[TEMPERATURE], "K", 1.0);
    }

    #[test]
    fn different_units_are_not_added() {
        let refused = |text, fields: &[_]| unit(text, fields).unwrap_err();
        assert!(refused("a+b", &[DENSITY, VELOCITY]).contains("g/cm^3 and cm/s"));
        assert!(refused("max(a, b^2)", &[VELOCITY; 2]).contains("cm/s and cm^2/s^2"));
        assert!(refused("1 + a/b + a", &[DENSITY; 2]).contains("dimensionless and g/cm^3"));
        let other = refused("a - b", &[VELOCITY, ("cm/s", Some(1.0))]);
        assert!(other.contains("100000 cm/s and in 1 cm/s: multiply one"), "{other}");
    }

    #[test]
    fn what_is_unknown_stays_unknown() {
        let unknown = ("?".to_owned(), None);
        for text in ["a+b", "b+a", "a*b", "min(a, b)", "a^b", "a/b+a"] {
            assert_eq!(shown(text, &[DENSITY, UNKNOWN]), unknown, "{text}");
        }
        assert_eq!(shown("log(a)", &[DENSITY]), unknown);
        assert_eq!(shown("exp(a)", &[TEMPERATURE]), unknown);
        assert_eq!(shown("2^a", &[TEMPERATURE]), unknown);
        assert_eq!(shown("a + b", &[DENSITY, ("g/cm^3", None)]), ("g/cm^3".into(), None));
        assert_eq!(shown("a^0.173", &[DENSITY]), unknown);
        assert_eq!(shown("a^20 * a^20", &[DENSITY]).1, None, "the factor leaves f64's range");
    }

    #[test]
    fn unit_names_are_read_as_sources_write_them() {
        let read = |name: &str| dimensions(name).map(|of| of.to_string());
        for (name, expected) in [
            ("g/cm^3", "g/cm^3"),
            ("g/cm**3", "g/cm^3"),
            ("erg/(cm^2*s)", "g/s^3"),
            (" K ", "K"),
            ("1/s", "1/s"),
            ("sqrt(erg/g)", "cm/s"),
            ("dimensionless", "dimensionless"),
        ] {
            assert_eq!(read(name).as_deref(), Some(expected), "{name}");
        }
        for name in ["km/s", "g + cm", "code_length", "", "(null)", "g cm^-3", "Msun"] {
            assert_eq!(read(name), None, "{name}");
        }
    }
}
