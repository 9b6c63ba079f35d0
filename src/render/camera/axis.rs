//! Exact points on the view axis.

use crate::space::Position;

/// A coordinate beyond this (2¹²⁶, twice the range of positions) is held there: the point of an axis
/// through a position that is closest to something in the domain is no farther than the position is.
const LARGEST: i128 = 1 << 126;

/// `position + t·(look_at − position)`, exact but for a final floor to units of [`Position`]:
/// `t` counts as the dyadic rational that it is. Held to twice the range of positions.
pub(super) fn axis_point(position: &Position, look_at: &Position, t: f64) -> Position {
    Position(std::array::from_fn(|a| {
        let offset = scaled(look_at.0[a].saturating_sub(position.0[a]), t);
        position.0[a].saturating_add(offset).clamp(-LARGEST, LARGEST)
    }))
}

/// `floor(difference · t)`, held to ± [`LARGEST`].
fn scaled(difference: i128, t: f64) -> i128 {
    let bits = t.to_bits();
    let exponent = i32::try_from((bits >> 52) & 0x7ff).unwrap_or(0);
    let fraction = u128::from(bits & ((1 << 52) - 1));
    if exponent == 0 || difference == 0 {
        return 0;
    }
    let (mantissa, shift) = (fraction | 1 << 52, exponent - 1075);
    let magnitude = difference.unsigned_abs();
    // The product in two limbs, high · 2^64 + low: 53 bits times at most 127.
    let low = (magnitude & u128::from(u64::MAX)) * mantissa;
    let high = (magnitude >> 64) * mantissa + (low >> 64);
    let low = low & u128::from(u64::MAX);
    let (whole, exact) = if shift < 0 {
        shifted_down(high, low, shift.unsigned_abs())
    } else {
        (shifted_up(high, low, shift.unsigned_abs()), true)
    };
    let whole = i128::try_from(whole).map_or(LARGEST, |whole| whole.min(LARGEST));
    if (difference < 0) == (t < 0.0) { whole } else { -whole - i128::from(!exact) }
}

/// `(high · 2^64 + low) >> shift`, and whether nothing was lost.
fn shifted_down(high: u128, low: u128, shift: u32) -> (u128, bool) {
    if shift >= 192 {
        return (0, high == 0 && low == 0);
    }
    if shift >= 64 {
        let down = shift - 64;
        return (high >> down, low == 0 && high & ((1 << down) - 1) == 0);
    }
    let kept = if high.leading_zeros() < 64 - shift { u128::MAX } else { high << (64 - shift) };
    (kept | low >> shift, low & ((1 << shift) - 1) == 0)
}

/// `(high · 2^64 + low) << shift`, or the largest number where it does not fit.
fn shifted_up(high: u128, low: u128, shift: u32) -> u128 {
    let product = high << 64 | low;
    let fits = high.leading_zeros() >= 64 && shift <= product.leading_zeros();
    if fits { product.checked_shl(shift).unwrap_or(0) } else { u128::MAX }
}

#[cfg(test)]
mod tests {
    use num_bigint::BigInt;
    use num_integer::Integer;
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn equals_big_integers(
            difference in any::<i128>().prop_map(|d| d >> 1),
            shift in 0u32..126,
            mantissa in -(1i64 << 53)..(1i64 << 53),
            power in -200i32..20,
        ) {
            let difference = difference >> shift;
            let t = mantissa as f64 * f64::from(power).exp2();
            let product = BigInt::from(difference) * mantissa;
            let exact = if power >= 0 {
                product << power.unsigned_abs()
            } else {
                product.div_floor(&(BigInt::from(1) << power.unsigned_abs()))
            };
            let limit = BigInt::from(LARGEST);
            if exact >= -limit.clone() && exact <= limit {
                prop_assert_eq!(BigInt::from(scaled(difference, t)), exact);
            } else {
                prop_assert!(scaled(difference, t).abs() >= LARGEST);
            }
        }
    }

    #[test]
    fn far_and_near_points_are_exact() {
        let (eye, target) = (Position([5, -7, 1 << 100]), Position([6, -9, (1 << 100) + 3]));
        assert_eq!(axis_point(&eye, &target, 1.0), target);
        assert_eq!(axis_point(&eye, &target, 0.5), Position([5, -8, (1 << 100) + 1]));
        let far = axis_point(&eye, &target, 80.0_f64.exp2());
        assert_eq!(far, Position([5 + (1 << 80), -7 - (2 << 80), (1 << 100) + (3 << 80)]));
        assert_eq!(axis_point(&eye, &target, 1e300).0[0], LARGEST);
        assert_eq!(axis_point(&eye, &target, 0.0), eye);
    }
}
