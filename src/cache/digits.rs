//! Values coded such that their leading bits alone are the values rounded.

/// All NaN are stored as this one, of which the upper half tells that it is one.
pub(super) const NAN_BITS: u32 = 0x7fc0_0000;

/// How many digits of stored values are read: how many parts of their payload.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Precision {
    /// The leading 16 bits of each, rounded.
    Short,
    /// The leading 20.
    Medium,
    /// The leading 24.
    Long,
    /// All.
    #[default]
    Full,
}

impl Precision {
    /// All but the last, the fewest digits first.
    pub const FEWER: [Self; PARTS - 1] = [Self::Short, Self::Medium, Self::Long];

    /// The last part that is read.
    pub fn last_part(self) -> usize {
        self as usize
    }
}

/// Parts of a payload.
pub const PARTS: usize = 4;

/// Carries into the digit above, where that which ends below bit `end` counts as negative: from its
/// middle on.
#[inline(always)]
fn carry(bits: u32, end: u32) -> u32 {
    bits.wrapping_add((bits & middle(end)) << 1)
}

#[inline(always)]
fn uncarry(bits: u32, end: u32) -> u32 {
    bits.wrapping_sub((bits & middle(end)) << 1)
}

const fn middle(end: u32) -> u32 {
    1 << (end - 1)
}

/// The bits of a value such that its leading ones alone are the value rounded: the upper half is the value
/// rounded to its leading 16 bits; with the four bits below, which count as negative where that was
/// rounded up, it is the value rounded to 20, and so on. Rounding up may carry into the exponent, up to
/// infinity. All NaN become one.
#[inline(always)]
pub(super) fn code(value: f32) -> u32 {
    let [coded, ..] = carried(bits(value));
    coded
}

#[inline(always)]
fn bits(value: f32) -> u32 {
    if value.is_nan() { NAN_BITS } else { value.to_bits() }
}

/// The bits with all carries, with those of the lower two digits, and with that of the lowest.
#[inline(always)]
fn carried(bits: u32) -> [u32; PARTS - 1] {
    let long = carry(bits, 8);
    let medium = carry(long, 12);
    [carry(medium, 16), medium, long]
}

/// The value of such bits, of which the lower ones may be missing: 0.
#[inline(always)]
pub(super) fn decode(coded: u32) -> f32 {
    f32::from_bits(uncarry(uncarry(uncarry(coded, 16), 12), 8))
}

/// Bounds of the relative differences of finite values in fewer digits, for each part that is the last:
/// for normal values no more than twice the largest; 1 where there is none, as for subnormal ones that
/// change. Infinity counts as the largest number. None is smaller than the one behind it, although fewer
/// digits may happen to be nearer.
pub(super) fn rounding_errors(values: &[f32]) -> [f32; PARTS - 1] {
    let (mut most, mut subnormal) = ([0; PARTS - 1], false);
    // Without an end or a branch: several values at a time.
    for value in values {
        let bits = bits(*value);
        let kept = carried(bits).into_iter().zip([!0xffff, !0xfff, !0xff]);
        for (most, (carried, kept)) in most.iter_mut().zip(kept) {
            // In units of the value's last bit, whatever the exponent of what it is rounded to.
            *most = (bits.wrapping_sub(carried & kept) as i32).unsigned_abs().max(*most);
        }
        subnormal |= value.is_subnormal();
    }
    let [short, medium, long] = most;
    let most = [short.max(medium).max(long), medium.max(long), long];
    // A normal value is at least 2²³ such units; a subnormal one may be a single one, and more than double.
    let relative = |off: u32| off as f32 * (-23f32).exp2();
    most.map(|off| if subnormal && off > 0 { 1.0 } else { relative(off) })
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
        // Carries thrice, and more than doubles.
        all.push(f32::from_bits(0x7f80));
        // All that fewer digits may leave out.
        all.extend((0..=0xffff).map(|low| f32::from_bits(0x3f80_0000 | low)));
        for value in all {
            let whole = decode(code(value));
            assert!(whole.to_bits() == value.to_bits() || whole.is_nan() && value.is_nan());
            assert!(rounding_errors(&[value]).is_sorted_by(|fewer, more| fewer >= more));
            for (precision, bit) in Precision::FEWER.into_iter().zip([16, 12, 8]) {
                let rounded = decode(code(value) >> bit << bit);
                assert_eq!(rounded.to_bits() << (32 - bit), 0, "{value:e} {rounded:e}");
                assert_eq!(value.is_nan(), rounded.is_nan());
                let off = f64::from(rounded.clamp(f32::MIN, f32::MAX)) - f64::from(value);
                let error = f64::from(rounding_errors(&[value])[precision.last_part()]);
                let is_bounded = off.abs() <= error * f64::from(value.abs()) || error >= 1.0;
                assert!(value.is_nan() || is_bounded, "{value:e}");
                // The sign and the exponent take nine of 32 bits. It errs by half of the last bit, and by
                // what lower digits are rounded by before.
                let half = f64::from(bit - 24).exp2();
                assert!(!value.is_normal() || error <= 1.07 * half, "{value:e} {rounded:e}");
            }
        }
        let short = [0.0, -0.0, 1.0, -3.5, 2.0_f32.powi(-130), f32::NAN];
        assert_eq!(rounding_errors(&short), [0.0; PARTS - 1]);
        assert_eq!(rounding_errors(&[]), [0.0; PARTS - 1]);
        let [short, medium, long] = rounding_errors(&[1.0 + 0.5_f32.powi(10)]);
        assert!(short > 9e-4 && medium == 0.0 && long == 0.0);
        assert!(rounding_errors(&[1e-45])[2] >= 1.0);
    }
}
