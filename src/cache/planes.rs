//! Byte planes: of many 4-byte values all first bytes, then all second ones and so on, in which
//! compression finds more to save; and the upper ones of which tell the values in fewer digits.

/// All NaN are stored as this one, of which the upper half tells that it is one.
pub(super) const NAN_BITS: u32 = 0x7fc0_0000;

/// Carries into the byte above, or the half, where the rest counts as negative.
fn carry(bits: u32, middle: u32) -> u32 {
    bits.wrapping_add((bits & middle) << 1)
}

fn uncarry(bits: u32, middle: u32) -> u32 {
    bits.wrapping_sub((bits & middle) << 1)
}

/// The middles of the lower half and of the lowest byte.
const OF_HALF: u32 = 0x8000;
const OF_BYTE: u32 = 0x80;

/// The bits of a value such that its leading bytes alone are the value rounded: the upper half is
/// the value rounded to its leading 16 bits; with the byte below, which counts as negative where
/// that was rounded up, it is the value rounded to 24; the lowest byte counts likewise. Rounding up
/// may carry into the exponent, up to infinity.
fn carried(value: f32) -> u32 {
    let bits = if value.is_nan() { NAN_BITS } else { value.to_bits() };
    carry(carry(bits, OF_BYTE), OF_HALF)
}

/// Splits `values` into planes of as many bytes each: little-endian, the lowest bytes first, the
/// upper ones of values rounded to these. All NaN become one. Whatever is longer than the shortest of
/// all is left as it is.
pub fn split(values: &[f32], planes: [&mut [u8]; 4]) {
    for (shift, plane) in [0, 8, 16, 24].into_iter().zip(planes) {
        for (byte, value) in plane.iter_mut().zip(values) {
            *byte = (carried(*value) >> shift) as u8;
        }
    }
}

/// Puts together what [`split`] has split.
pub fn join([a, b, c, d]: [&[u8]; 4], values: &mut [f32]) {
    let planes = a.iter().zip(b).zip(c.iter().zip(d));
    for (value, ((&a, &b), (&c, &d))) in values.iter_mut().zip(planes) {
        let bits = u32::from_le_bytes([a, b, c, d]);
        *value = f32::from_bits(uncarry(uncarry(bits, OF_HALF), OF_BYTE));
    }
}

/// Values rounded to their leading 24 bits, from the upper three planes; beside the largest numbers
/// they may be infinite.
pub fn join_medium([b, c, d]: [&[u8]; 3], values: &mut [f32]) {
    for (value, (&b, (&c, &d))) in values.iter_mut().zip(b.iter().zip(c.iter().zip(d))) {
        *value = f32::from_bits(uncarry(u32::from_le_bytes([0, b, c, d]), OF_HALF));
    }
}

/// Values rounded to their leading 16 bits, from the upper two.
pub fn join_short([c, d]: [&[u8]; 2], values: &mut [f32]) {
    for (value, (&c, &d)) in values.iter_mut().zip(c.iter().zip(d)) {
        *value = f32::from_le_bytes([0, 0, c, d]);
    }
}

/// Bounds of the relative differences of finite values rounded to 16 bits, and to 24: for normal ones no
/// more than twice the largest; 1 where there is none, as for subnormal ones that change. Infinity counts
/// as the largest number.
pub(super) fn rounding_errors(values: &[f32]) -> [f32; 2] {
    let (mut of_half, mut of_byte, mut subnormal) = (0, 0, false);
    // Without an end or a branch: several values at a time.
    for value in values {
        let bits = if value.is_nan() { NAN_BITS } else { value.to_bits() };
        let short = carry(carry(bits, OF_BYTE), OF_HALF) & !0xffff;
        // In units of the value's last bit, whatever the exponent of what it is rounded to.
        of_half = of_half.max((bits.wrapping_sub(short) as i32).unsigned_abs());
        of_byte = of_byte.max(u32::from((bits as i8).unsigned_abs()));
        subnormal |= value.is_subnormal();
    }
    // A normal value is at least 2²³ such units; a subnormal one may be a single one, and more than double.
    let relative = |off: u32| off as f32 * (-23f32).exp2();
    [of_half, of_byte].map(|off| if subnormal && off > 0 { 1.0 } else { relative(off) })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of every kind, NaN with bits of its own among them.
    fn values(count: usize) -> Vec<f32> {
        let bits = |n: usize| (n as u32).wrapping_mul(0x9e37_79b9) ^ 0x7fc1_2345;
        (0..count).map(|n| f32::from_bits(bits(n))).collect()
    }

    #[test]
    fn fewer_digits_are_off_by_no_more_than_is_said() {
        let mut all = values(5000);
        let ends = [0.0, 1.0, -1.0, 1.0 + f32::EPSILON, f32::MAX, f32::MIN, 1e-45, 1e-39, f32::NAN];
        all.extend(ends);
        // Carries twice, and more than doubles.
        all.push(f32::from_bits(0x7f80));
        let mut planes = vec![vec![0u8; all.len()]; 4];
        let [a, b, c, d] = planes.as_mut_slice() else { unreachable!() };
        split(&all, [a, b, c, d]);
        let mut rounded = [vec![0.0; all.len()], vec![0.0; all.len()]];
        join_short([&planes[2], &planes[3]], &mut rounded[0]);
        join_medium([&planes[1], &planes[2], &planes[3]], &mut rounded[1]);
        for (n, (bits, rounded)) in [16, 24].into_iter().zip(&rounded).enumerate() {
            for (value, rounded) in all.iter().zip(rounded) {
                assert_eq!(rounded.to_bits() << bits, 0);
                assert_eq!(value.is_nan(), rounded.is_nan());
                let off = f64::from(rounded.clamp(f32::MIN, f32::MAX)) - f64::from(*value);
                let error = f64::from(rounding_errors(&[*value])[n]);
                let is_bounded = off.abs() <= error * f64::from(value.abs()) || error >= 1.0;
                assert!(value.is_nan() || is_bounded, "{value:e}");
                // The sign and the exponent take nine.
                let half = f64::from(8 - bits).exp2();
                assert!(!value.is_normal() || error <= 1.01 * half, "{value:e} {rounded:e}");
            }
        }
        let short = [0.0, -0.0, 1.0, -3.5, 2.0_f32.powi(-130), f32::NAN];
        assert_eq!(rounding_errors(&short), [0.0; 2]);
        assert_eq!(rounding_errors(&[]), [0.0; 2]);
        let [short, medium] = rounding_errors(&[1.0 + 0.5_f32.powi(10)]);
        assert!(short > 9e-4 && medium == 0.0);
        assert!(rounding_errors(&[1e-45])[1] >= 1.0);
    }

    #[test]
    fn planes_are_those_of_a_plain_loop_and_join_to_the_same_bits() {
        for count in [0, 1, 7, 15, 16, 17, 33, 216, 1000, 5832] {
            let values = values(count);
            let mut planes = vec![vec![0u8; count]; 4];
            let [a, b, c, d] = planes.as_mut_slice() else { unreachable!() };
            split(&values, [a, b, c, d]);
            for (n, value) in values.iter().enumerate() {
                for (plane, byte) in planes.iter().zip(carried(*value).to_le_bytes()) {
                    assert_eq!(plane[n], byte, "{n} of {count}");
                }
            }
            let mut joined = vec![0.0; count];
            join([0, 1, 2, 3].map(|n| &planes[n][..]), &mut joined);
            let of = |v: &f32| if v.is_nan() { NAN_BITS } else { v.to_bits() };
            let bits = |values: &[f32]| values.iter().map(of).collect::<Vec<_>>();
            assert_eq!(bits(&joined), bits(&values));
        }
    }
}
