//! The logarithm to base 10, written so that loops over many numbers compute several at once.

/// The largest number whose mantissa counts as below 1: the bits of √½.
const ROOT_OF_HALF: u64 = 0x3fe6_a09e_667f_3bcd;
const ONE: u64 = 0x3ff0_0000_0000_0000;
const MANTISSA_BITS: u32 = 52;
/// 2⁵², whose last bits hold a whole number.
const WHOLE: u64 = 0x4330_0000_0000_0000;
/// 2⁵⁴: lifts what is subnormal.
const LIFT: f64 = 18_014_398_509_481_984.0;
/// log10 2, cut to 32 bits so that products with exponents are exact, and the rest.
const LOG10_2_HIGH: f64 = 0.301_029_995_549_470_2;
const LOG10_2_LOW: f64 = 1.145_110_089_802_183_8e-10;
/// Terms of the series of artanh s / s in s², which is at most 0.0295: what comes after is below
/// 2⁻⁵⁶.
const TERMS: usize = 11;

/// log10 x within 3e-16 of the larger of it and 1, as [`f64::log10`] has it for 0, infinity and
/// what has none.
#[inline(always)]
pub(crate) fn log10(x: f64) -> f64 {
    let (lifted, lift) =
        if x < f64::MIN_POSITIVE { (x * LIFT, 1023.0 + 54.0) } else { (x, 1023.0) };
    // x = m·2ⁿ with m from √½ to √2.
    let bits = lifted.to_bits().wrapping_add(ONE - ROOT_OF_HALF);
    let exponent = f64::from_bits((bits >> MANTISSA_BITS) | WHOLE) - f64::from_bits(WHOLE) - lift;
    let mantissa = (bits & ((1 << MANTISSA_BITS) - 1)).wrapping_add(ROOT_OF_HALF);
    // ln m = 2·artanh s with s = (m − 1) / (m + 1), of which m − 1 is exact.
    let above = f64::from_bits(mantissa) - 1.0;
    let s = above / (above + 2.0);
    let square = s * s;
    let mut series = 0.0;
    let mut term = TERMS;
    while term > 0 {
        term -= 1;
        series = series * square + 1.0 / (2 * term + 1) as f64;
    }
    let natural = 2.0 * s * series;
    let rest = exponent * LOG10_2_LOW + natural * std::f64::consts::LOG10_E;
    let finite = exponent * LOG10_2_HIGH + rest;
    let positive = if x == f64::INFINITY { x } else { finite };
    let zero = if x == 0.0 { f64::NEG_INFINITY } else { f64::NAN };
    if x > 0.0 { positive } else { zero }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]
        #[test]
        fn it_is_the_librarys(bits in any::<u64>(), near in -1e-3..1e-3_f64) {
            for x in [f64::from_bits(bits), 1.0 + near, 1.0 + 1e-9 * near, near.abs()] {
                let (found, expected) = (log10(x), x.log10());
                let off = (found - expected).abs();
                let same = found.to_bits() == expected.to_bits()
                    || found.is_nan() && expected.is_nan();
                prop_assert!(same || off <= 3e-16 * expected.abs().max(1.0), "{x}: {found} {expected}");
                // And near 1, where it is small, relative to itself.
                let small = expected.abs() < 1e-3;
                prop_assert!(!small || off <= 1e-15 * expected.abs(), "{x}: {found} {expected}");
            }
        }
    }

    #[test]
    fn it_is_defined_at_the_ends() {
        for x in [0.0, -0.0, f64::INFINITY, f64::MIN_POSITIVE, 5e-324, f64::MAX, 1.0, 1000.0, 1e-30]
        {
            let (found, expected) = (log10(x), x.log10());
            assert!(found == expected || (found / expected - 1.0).abs() < 4e-16, "{x}: {found}");
        }
        assert!(log10(-1.0).is_nan() && log10(f64::NAN).is_nan());
        assert!(log10(f64::NEG_INFINITY).is_nan());
    }
}
