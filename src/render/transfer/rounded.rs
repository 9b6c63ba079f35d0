//! Bounds in f32, as packets of rays look them up.

/// What bounds that are not 0 are at least, relative to what they are measured by: some processors
/// take a hundred cycles and more for a product with, or of, a number below the normal range.
const LEAST: f32 = 1e-32;
/// More than anything is off by, relative to the largest there is.
const MOST: f64 = 1e38;

/// An f32 that is no less than `x`, far from the least that there are.
pub(crate) fn up(x: f64) -> f32 {
    if x == 0.0 {
        return 0.0;
    }
    let up = (x as f32).next_up();
    if up.abs() < LEAST { LEAST } else { up }
}

/// Two bounds in one number: the upper halves of their f32, rounded up, the first in the upper half
/// of the bits and the second in the lower.
pub(crate) fn two_halves(values: [f64; 2]) -> u32 {
    // One more covers what is cut off.
    let half =
        |value: f64| if value == 0.0 { 0 } else { (up(value.min(MOST)).to_bits() >> 16) + 1 };
    half(values[0]) << 16 | half(values[1])
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn bounds_are_no_less_and_far_from_the_least(
            (exponent, part) in (-300..38_i32, 1.0..10.0_f64),
        ) {
            let x = part * 10_f64.powi(exponent);
            let close = |bound: f64, by: f64| bound <= x * (1.0 + by) || bound <= 1.1e-32;
            let halves = two_halves([x, 0.0]);
            let upper = f64::from(f32::from_bits(halves & 0xffff_0000));
            prop_assert_eq!(halves & 0xffff, 0);
            prop_assert!(upper >= x.min(MOST) && close(upper, 0.01), "{x:e} {upper:e}");
            let near = f64::from(up(x));
            prop_assert!(near >= x && close(near, 1e-6), "{x:e} {near:e}");
            prop_assert!(f64::from(up(-x)) >= -x);
            prop_assert!(up(-x).is_normal() && up(x).is_normal());
        }
    }
}
