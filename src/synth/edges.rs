//! Edges of grids as the nearest doubles, and as Enzo's text files print them.

use num_bigint::BigInt;
use num_integer::Integer;
use num_traits::{One, ToPrimitive, Zero};

use crate::space::Domain;

/// The double nearest to the lower face of cell `index` of octree level `octree` along `axis`,
/// code length.
pub(super) fn cell_edge(domain: &Domain, octree: u32, axis: usize, index: i128) -> f64 {
    let (left, right) = (dyadic(domain.left()[axis]), dyadic(domain.right()[axis]));
    let exponent = left.1.min(right.1);
    let [left, right] =
        [left, right].map(|(m, e)| BigInt::from(m) << (e - exponent).unsigned_abs());
    let cells = BigInt::from(domain.root_cells()[axis]) << octree;
    let numerator = &left * &cells + (right - left) * BigInt::from(index);
    nearest(&numerator, &cells, exponent)
}

/// `value` as mantissa and exponent of two.
fn dyadic(value: f64) -> (i64, i32) {
    let bits = value.to_bits();
    let fraction = (bits & ((1 << 52) - 1)) as i64;
    let (mantissa, exponent) = match (bits >> 52) & 0x7ff {
        0 if fraction == 0 => (0, 0),
        0 => (fraction, -1074),
        biased => (fraction | 1 << 52, biased as i32 - 1075),
    };
    (if value < 0.0 { -mantissa } else { mantissa }, exponent)
}

/// The double nearest to `numerator / denominator · 2^exponent`.
fn nearest(numerator: &BigInt, denominator: &BigInt, exponent: i32) -> f64 {
    if numerator.is_zero() {
        return 0.0;
    }
    // A quotient of 66 bits or one more, its last bit set where a remainder is left, rounds as
    // the exact number does.
    let bits = |number: &BigInt| i64::try_from(number.bits()).unwrap_or(i64::MAX / 4);
    let shift = bits(denominator) + 66 - bits(numerator);
    let (up, down) = (shift.max(0).unsigned_abs(), shift.min(0).unsigned_abs());
    let (quotient, remainder) = (numerator << up).div_mod_floor(&(denominator << down));
    let sticky = if remainder.is_zero() { quotient } else { quotient | BigInt::one() };
    let power = f64::from(exponent) - shift as f64;
    sticky.to_f64().unwrap_or(0.0) * power.exp2()
}

/// `value` as C's `%.14g` prints it.
pub(super) fn general_14(value: f64) -> String {
    const DIGITS: i32 = 14;
    let scientific = format!("{value:.*e}", DIGITS as usize - 1);
    let Some((mantissa, exponent)) = scientific.split_once('e') else { return scientific };
    let exponent: i32 = exponent.parse().unwrap_or(0);
    let trim = |text: &str| match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text.to_owned(),
    };
    if (-4..DIGITS).contains(&exponent) {
        return trim(&format!("{value:.*}", (DIGITS - 1 - exponent) as usize));
    }
    c_exponent(&trim(mantissa), exponent)
}

/// `value` as C's `%e` prints it.
pub(super) fn exponential_6(value: f64) -> String {
    let scientific = format!("{value:.6e}");
    match scientific.split_once('e') {
        Some((mantissa, exponent)) => c_exponent(mantissa, exponent.parse().unwrap_or(0)),
        None => scientific,
    }
}

fn c_exponent(mantissa: &str, exponent: i32) -> String {
    let sign = if exponent < 0 { '-' } else { '+' };
    format!("{mantissa}e{sign}{:02}", exponent.abs())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_are_the_nearest_doubles() {
        let domain = Domain::new([-0.3, 0.1, 0.0], [0.9, 0.9, 1.0], [24, 16, 3]).unwrap();
        assert_eq!(cell_edge(&domain, 0, 0, 0), -0.3);
        assert_eq!(cell_edge(&domain, 0, 0, 24), 0.9);
        assert_eq!(cell_edge(&domain, 7, 1, 16 << 7), 0.9);
        assert_eq!(cell_edge(&domain, 0, 2, 1), 1.0 / 3.0);
        assert_eq!(cell_edge(&domain, 48, 2, 1 << 48), 1.0 / 3.0);
        assert_eq!(cell_edge(&domain, 48, 2, 2 << 48), 2.0 / 3.0);
        // The edge's own rounding is at most half a unit in the last place, so neighbours that
        // are one unit apart stay apart.
        let (a, b) = (cell_edge(&domain, 49, 2, 1 << 47), cell_edge(&domain, 49, 2, (1 << 47) + 1));
        assert!(a < b);
    }

    #[test]
    fn numbers_are_printed_as_c_prints_them() {
        for (value, text) in [
            (0.0, "0"),
            (1.0, "1"),
            (-0.3, "-0.3"),
            (0.43750000000001, "0.43750000000001"),
            (1.0 / 3.0, "0.33333333333333"),
            (5.355897770097512e-13, "5.3558977700975e-13"),
            (1e20, "1e+20"),
            (123_456_789.125, "123456789.125"),
            (0.0001, "0.0001"),
        ] {
            assert_eq!(general_14(value), text);
        }
        for (value, text) in
            [(0.0, "0.000000e+00"), (-0.3, "-3.000000e-01"), (1.0 / 3e-120, "3.333333e+119")]
        {
            assert_eq!(exponential_6(value), text);
        }
    }
}
