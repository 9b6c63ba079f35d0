//! Expressions over cells: f64, cell by cell.

use std::convert::Infallible;

use super::expression::{Algebra, Binary, Expression, Unary};

/// Cells that are computed at a time: what lies between operations stays in the caches.
const STRIP: usize = 1024;

/// Puts the expression's value in each cell into `out`; `operands` has the values of each of its
/// names there. What has no value (√−1) is NaN, and whatever is computed of NaN is NaN.
pub(super) fn evaluate(expression: &Expression, operands: &[&[f64]], out: &mut [f64]) {
    for (strip, out) in out.chunks_mut(STRIP).enumerate() {
        let first = strip * STRIP;
        let cells = Cells { operands, first, count: out.len() };
        let Ok(values) = expression.evaluate(&cells);
        out.copy_from_slice(&values);
    }
}

struct Cells<'v> {
    operands: &'v [&'v [f64]],
    first: usize,
    count: usize,
}

impl Algebra for Cells<'_> {
    type Value = Vec<f64>;
    type Error = Infallible;

    fn number(&self, number: f64) -> Vec<f64> {
        vec![number; self.count]
    }

    fn operand(&self, index: usize) -> Vec<f64> {
        self.operands[index][self.first..self.first + self.count].to_vec()
    }

    fn unary(&self, operation: Unary, mut of: Vec<f64>) -> Result<Vec<f64>, Infallible> {
        let function = function_of_one(operation);
        of.iter_mut().for_each(|x| *x = function(*x));
        Ok(of)
    }

    fn binary(
        &self,
        operation: Binary,
        mut a: Vec<f64>,
        b: Vec<f64>,
    ) -> Result<Vec<f64>, Infallible> {
        let function = function_of_two(operation);
        a.iter_mut().zip(&b).for_each(|(a, &b)| *a = function(*a, b));
        Ok(a)
    }
}

/// What `operation` does to a number.
pub(super) fn function_of_one(operation: Unary) -> fn(f64) -> f64 {
    match operation {
        Unary::Negate => |x| -x,
        Unary::Abs => f64::abs,
        Unary::Sqrt => f64::sqrt,
        Unary::Exp => f64::exp,
        Unary::Log => f64::ln,
        Unary::Log10 => f64::log10,
    }
}

/// What `operation` makes of two numbers.
pub(super) fn function_of_two(operation: Binary) -> fn(f64, f64) -> f64 {
    match operation {
        Binary::Add => |a, b| a + b,
        Binary::Subtract => |a, b| a - b,
        Binary::Multiply => |a, b| a * b,
        Binary::Divide => |a, b| a / b,
        Binary::Power => power,
        // `f64::min` and `f64::max` would pass over NaN.
        Binary::Min => |a, b| if a.is_nan() || b.is_nan() { f64::NAN } else { a.min(b) },
        Binary::Max => |a, b| if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) },
    }
}

/// Squares are by far the most frequent power, and exact to half a unit in the last place.
fn power(base: f64, exponent: f64) -> f64 {
    if exponent == 2.0 {
        base * base
    } else if base.is_nan() || exponent.is_nan() {
        // `powf` takes 1 for 1^NaN and NaN^0.
        f64::NAN
    } else {
        base.powf(exponent)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(text: &str, operands: &[f64]) -> f64 {
        let expression = Expression::parse(text).unwrap();
        let operands: Vec<&[f64]> = operands.iter().map(std::slice::from_ref).collect();
        let mut out = [0.0];
        evaluate(&expression, &operands, &mut out);
        out[0]
    }

    #[test]
    fn values_by_hand() {
        for (text, expected) in [
            ("-2^2", -4.0),
            ("2^3^2", 512.0),
            ("2^-1", 0.5),
            ("8 - 3 - 2 * 2", 1.0),
            ("2/4/2", 0.25),
            ("sqrt(9) + abs(-2)", 5.0),
            ("min(3, 1, 2) + max(1, max(2, 3))", 4.0),
            ("log10(1e3) + log(exp(2))", 5.0),
            ("1e-3 * 2", 2e-3),
        ] {
            assert!((value(text, &[]) - expected).abs() < 1e-15, "{text}");
        }
        assert_eq!(value("sqrt(x^2+y^2)", &[3.0, -4.0]), 5.0);
    }

    #[test]
    fn nan_is_never_lost() {
        let nan = f64::NAN;
        for text in ["max(x, 1)", "min(1, x)", "x^0", "1^x", "x^2", "abs(x)", "0*x"] {
            assert!(value(text, &[nan]).is_nan(), "{text}");
        }
        assert!(value("sqrt(x)", &[-1.0]).is_nan());
        assert!(value("log(x)", &[-1.0]).is_nan());
    }

    #[test]
    fn every_cell_is_computed_of_its_own_values() {
        let x: Vec<f64> = (0..3 * STRIP + 5).map(|i| i as f64).collect();
        let y: Vec<f64> = x.iter().map(|x| 0.5 + x * x).collect();
        let mut out = vec![0.0; x.len()];
        evaluate(&Expression::parse("y - x*x").unwrap(), &[&y, &x], &mut out);
        assert!(out.iter().all(|&value| value == 0.5));
    }
}
