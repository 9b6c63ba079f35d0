//! Arbitrary-precision rationals, and domains and cells to try them on.

// Each test program uses only a part of it.
#![allow(dead_code)]

use deepfield::space::Domain;
use num_bigint::BigInt;
use num_rational::Ratio;
use num_traits::ToPrimitive;
use proptest::prelude::*;

/// Edges that are no binary fractions, root grids of odd sizes, cells that are not cubes; lower
/// and upper edges and root cells along each axis.
pub(crate) fn domains() -> impl Strategy<Value = Domain> {
    let of = |left, right, cells| Domain::new(left, right, cells).unwrap();
    prop_oneof![
        // Cells of 0.1 along each axis.
        Just(of([-0.3, 0.1, -1.0], [2.1, 1.8, -0.5], [24, 17, 5])),
        // 0.05, 0.06, 0.04.
        Just(of([-0.3, 0.1, -1.0], [0.9, 1.06, -0.12], [24, 16, 22])),
        Just(of([0.0; 3], [1.0, 0.7, 1.3], [17, 5, 24])),
        Just(of([1e-3, -7e5, 0.1], [1.1e-3, 3e6, 0.3], [5, 24, 17])),
        Just(of([-1.0; 3], [1.0; 3], [64; 3])),
    ]
}

pub(crate) type Rational = Ratio<BigInt>;

/// The rational that the double `value` is: 53 bits, then powers of two.
pub(crate) fn rational(value: f64) -> Rational {
    let exponent = value.abs().log2().max(-1000.0).floor() as i32;
    let mantissa = value / f64::from(exponent).exp2() * 53f64.exp2();
    Rational::from(BigInt::from(mantissa as i64)) * power(exponent - 53)
}

/// To a few bits fewer than a double has.
pub(crate) fn to_f64(value: &Rational) -> f64 {
    const BITS: i32 = 300;
    (value * power(BITS)).to_integer().to_f64().unwrap() * f64::from(-BITS).exp2()
}

pub(crate) fn power(exponent: i32) -> Rational {
    let whole = BigInt::from(1) << exponent.unsigned_abs();
    if exponent < 0 { Rational::new(1.into(), whole) } else { whole.into() }
}

pub(crate) fn root_width(domain: &Domain, axis: usize) -> Rational {
    let cells = Rational::from(BigInt::from(domain.root_cells()[axis]));
    (rational(domain.right()[axis]) - rational(domain.left()[axis])) / cells
}

/// A coordinate that lies at `part` (of 2⁶³) of the domain.
fn within(domain: &Domain, axis: usize, octree: i32, part: u64) -> i128 {
    let cells = i128::from(domain.root_cells()[axis]) << octree;
    ((BigInt::from(cells) * part) >> 63u32).to_i128().unwrap()
}

pub(crate) fn cells_at(domain: &Domain, octree: i32, parts: [u64; 3]) -> [i128; 3] {
    std::array::from_fn(|a| within(domain, a, octree, parts[a]))
}

pub(crate) fn parts() -> impl Strategy<Value = [u64; 3]> {
    prop::array::uniform3(prop_oneof![4 => 0..1u64 << 63, 1 => Just(0), 1 => Just((1 << 63) - 1)])
}

/// `value` to `digits` decimals, floored.
pub(crate) fn decimal_text(value: &Rational, digits: u32) -> String {
    let scale = BigInt::from(10).pow(digits);
    let floored = (value * Rational::from(scale)).floor().to_integer();
    format!("{floored}e-{digits}")
}
