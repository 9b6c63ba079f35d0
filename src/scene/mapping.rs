//! From a field's value to the transfer function's x.

use std::f64::consts::LN_10;

use super::scale::Scale;
use crate::log10::log10;
use crate::{Error, Result};

/// [`Mapping::unclamped`] saturates at ± this, so that what is interpolated stays finite, in f32
/// too.
pub const LARGEST_UNCLAMPED: f64 = 1e30;

/// What a mapping needs to know of a field: extrema over its leaf cells, in code units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldExtrema {
    /// The smallest leaf value.
    pub minimum: f64,
    /// The largest leaf value.
    pub maximum: f64,
    /// The smallest leaf value above 0, if there is one.
    pub smallest_positive: Option<f64>,
}

/// Maps field values to x = (s(f) − s(lo)) / (s(hi) − s(lo)), with s the scale: 0 at lo and 1 at
/// hi. Never decreasing (up to rounding in the logarithm). NaN counts as lo.
///
/// Everything maps to 0 if hi is not above lo in the scale (a constant field without a range of
/// its own), and if the scale is log10 and no leaf value is positive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mapping {
    scale: Scale,
    factor: f64,
    floor: f64,
    low: f64,
    high: f64,
}

/// Smaller differences of x are lost in its own rounding.
const LEAST_DISTANCE: f64 = 1e-18;

/// Bound of the difference that values stored with a relative error make in x: `slope` times the
/// distance of x from `zero`, and at most `most`; `lost` more where x is below `least`.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Rounding {
    slope: f64,
    zero: f64,
    most: f64,
    least: f64,
    lost: f64,
}

impl Rounding {
    /// The bound where x is between `low` and `high`.
    pub fn between(&self, low: f64, high: f64) -> f64 {
        let by_slope = self.slope * (low - self.zero).abs().max((high - self.zero).abs());
        let lost = if low < self.least { self.lost } else { 0.0 };
        lost + if by_slope < self.most { by_slope } else { self.most }
    }

    /// The x of 0, the bound's slope from there on, and what it is at 0, where it grows with the value.
    pub fn line(&self) -> Option<[f64; 3]> {
        self.slope.is_finite().then_some([self.zero, self.slope, self.lost])
    }
}

impl Mapping {
    /// The mapping under `scale` with `range` = [lo, hi], in the units of the scene; without one,
    /// the extrema of `field` (under log10 from its smallest positive value). `factor` takes code
    /// units to the scene's units, and values are multiplied by it first: 1 for code units.
    ///
    /// # Errors
    /// A factor that is not a positive number; extrema that are not finite, or not under `scale`; ends of
    /// a range that are one number under `scale`.
    pub fn new(
        scale: Scale,
        range: Option<[f64; 2]>,
        field: FieldExtrema,
        factor: f64,
    ) -> Result<Self> {
        if !(factor.is_finite() && factor > 0.0) {
            return Err(Error::request(format!(
                "the field's unit factor is {factor}; it must be a positive number"
            )));
        }
        let floor = match scale {
            Scale::Log10 => field.smallest_positive.unwrap_or(f64::NAN) * factor,
            Scale::Linear | Scale::Symlog { .. } => f64::NEG_INFINITY,
        };
        let [low, high] =
            range.unwrap_or([(field.minimum * factor).max(floor), field.maximum * factor]);
        if !(low.is_finite() && high.is_finite()) {
            return Err(Error::request(format!(
                "the field's values run from {low} to {high}; give the volume a finite `range`"
            )));
        }
        let [lowest, highest] = [low, high].map(|end| scale.apply(end));
        if !floor.is_nan() && (lowest.is_infinite() || highest.is_infinite()) {
            return Err(Error::request(format!(
                "the field's values run from {low:e} to {high:e} in these units, which have no \
                 logarithm; give the volume a `range`"
            )));
        }
        let mapping = Self { scale, factor, floor, low: lowest, high: highest };
        if range.is_some() && mapping.width() <= 0.0 {
            return Err(Error::request(format!(
                "the ends of `range`, {low:e} and {high:e}, are alike under this scale: give the volume \
                 a wider one"
            )));
        }
        Ok(mapping)
    }

    /// x of field value `f` in code units: below 0 and above 1 where `f` lies outside the range.
    /// Finite for every `f`.
    pub fn unclamped(&self, f: f64) -> f64 {
        if self.is_flat() { 0.0 } else { self.place(f, |f| self.scale.apply(f)) }
    }

    /// [`Self::unclamped`] of all `fields`, times `unit`.
    #[inline(always)]
    pub fn unclamped_all(&self, fields: &[f32], unit: f64, out: &mut [f64]) {
        if self.is_flat() {
            return out.fill(0.0);
        }
        // One loop for each scale, so that none asks in between; and no calls in them.
        match self.scale {
            Scale::Linear => self.place_all(fields, unit, out, |f| f),
            Scale::Log10 => self.place_all(fields, unit, out, log10),
            Scale::Symlog { .. } => self.place_all(fields, unit, out, |f| self.scale.apply(f)),
        }
    }

    /// Whether everything maps to 0.
    fn is_flat(&self) -> bool {
        let ends = self.floor.is_nan() || self.high.is_nan() || self.low.is_nan();
        ends || self.width() <= 0.0
    }

    /// Half of the range: the difference of two finite numbers need not be finite, nor half of the least
    /// one be more than 0.
    fn width(&self) -> f64 {
        0.5 * self.high - 0.5 * self.low
    }

    #[inline(always)]
    fn place_all(&self, fields: &[f32], unit: f64, out: &mut [f64], scale: impl Fn(f64) -> f64) {
        for (x, field) in out.iter_mut().zip(fields) {
            *x = self.place(f64::from(*field) * unit, &scale);
        }
    }

    #[inline(always)]
    fn place(&self, f: f64, scale: impl Fn(f64) -> f64) -> f64 {
        let scaled = scale((f * self.factor).max(self.floor));
        let x = (0.5 * scaled - 0.5 * self.low) / self.width();
        if f.is_nan() { 0.0 } else { x.clamp(-LARGEST_UNCLAMPED, LARGEST_UNCLAMPED) }
    }

    /// How far x may be off where means of field values are off by at most `linear` (code units), and
    /// those of their log10 by at most `log10`, of values between `low` and `high` (code units).
    pub fn distance(&self, linear: f64, log10: f64, [low, high]: [f64; 2]) -> f64 {
        self.of_scale(match self.scale {
            Scale::Linear => linear * self.factor,
            Scale::Log10 => log10,
            Scale::Symlog { linthresh } => {
                let [low, high] = [low, high].map(|f| f * self.factor);
                let within = self.scale.means_apart(linear * self.factor, [low, high], linthresh);
                // Beyond it is the logarithm but for a constant.
                if low >= linthresh { log10.min(within) } else { within }
            }
        })
    }

    /// How far x of a value may be off that is off by at most `off` (code units) itself, under another
    /// scale than log10.
    fn of_value(&self, off: f64) -> f64 {
        self.of_scale(match self.scale {
            // The steepest slope of symlog is that of its linear part.
            Scale::Symlog { linthresh } => off * self.factor / (0.9 * linthresh),
            Scale::Linear | Scale::Log10 => off * self.factor,
        })
    }

    /// How far x may be off where field values are off by at most `relative` of their own, and those of
    /// magnitudes below `least` (code units) by up to 2⁻²⁴ of that. Under other scales than log10 the
    /// latter counts for all values, where it is no less than f64 makes of x.
    pub fn rounding(&self, relative: f64, least: f64) -> Rounding {
        let relative = relative.min(1.0);
        let most = self.of_scale(match self.scale {
            Scale::Linear => f64::INFINITY,
            Scale::Log10 => -(-relative).ln_1p() / LN_10,
            // Steepest within its linear part, of half-width 0.9.
            Scale::Symlog { .. } => relative / 0.9 / (1.0 - relative),
        });
        // Symlog is proportional to the value, or beyond 1 and less steep.
        let slope = match self.scale {
            Scale::Log10 => f64::INFINITY,
            Scale::Linear | Scale::Symlog { .. } => relative / (1.0 - relative),
        };
        let zero = -self.of_scale(self.low);
        let exact = Rounding::default();
        let rounding =
            if relative == 0.0 { exact } else { Rounding { slope, zero, most, ..exact } };
        if self.scale != Scale::Log10 {
            let lost = self.of_value(least * f64::from(f32::EPSILON));
            let counts = lost > LEAST_DISTANCE;
            let least = f64::INFINITY;
            return if counts { Rounding { least, lost, ..rounding } } else { rounding };
        }
        let least = least * self.factor;
        if self.is_flat() || least <= self.floor {
            return rounding;
        }
        // From the smallest value on, which counts for all that are below it.
        let lost = self.of_scale((least * f64::from(f32::EPSILON) / self.floor).ln_1p() / LN_10);
        let least = self.place(least / self.factor, log10);
        Rounding { least: least.next_up(), lost: lost * (1.0 + 1e-12), ..rounding }
    }

    /// A difference in the scale, in x.
    fn of_scale(&self, difference: f64) -> f64 {
        if self.is_flat() || difference == 0.0 { 0.0 } else { 0.5 * difference / self.width() }
    }

    /// x of field value `f` in code units, in [0, 1].
    pub fn clamped(&self, f: f64) -> f64 {
        self.unclamped(f).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const FIELD: FieldExtrema =
        FieldExtrema { minimum: -2.0, maximum: 1e4, smallest_positive: Some(1e-3) };

    fn mapping(scale: Scale, range: Option<[f64; 2]>) -> Mapping {
        Mapping::new(scale, range, FIELD, 1.0).unwrap()
    }

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() <= 1e-14 * b.abs().max(1.0)
    }

    #[test]
    fn what_a_scale_cannot_tell_apart_is_refused() {
        let symlog = |linthresh| Scale::Symlog { linthresh };
        let next = |x: f64| Some([x, x.next_up()]);
        for (scale, range) in
            [(Scale::Log10, next(3.0)), (symlog(1e-9), next(1.0)), (symlog(1e-310), next(1.0))]
        {
            let refused = Mapping::new(scale, range, FIELD, 1.0).unwrap_err().to_string();
            assert!(refused.contains("alike"), "{refused}");
        }
        let mapping = Mapping::new(Scale::Linear, next(3.0), FIELD, 1.0).unwrap();
        assert!(mapping.unclamped(4.0) >= 1.0 && mapping.unclamped(3.0) == 0.0);
        // Of a linear part that is far too small to be seen nothing but the logarithm is left.
        for linthresh in [1e-290, 1e-310, 5e-324] {
            let mapping = Mapping::new(symlog(linthresh), Some([1.0, 1e4]), FIELD, 1.0).unwrap();
            let below = 1.0 / 0.9 - linthresh.log10();
            for exponent in 0..=4 {
                let x = mapping.unclamped(10_f64.powi(exponent));
                assert!(
                    (x - 0.25 * f64::from(exponent)).abs() < 1e-13 * below,
                    "{linthresh:e}: {x}"
                );
            }
        }
    }

    #[test]
    fn values_by_hand() {
        let linear = mapping(Scale::Linear, Some([2.0, 4.0]));
        assert!(close(linear.unclamped(5.0), 1.5) && close(linear.clamped(5.0), 1.0));
        assert!(close(linear.unclamped(1.0), -0.5) && close(linear.clamped(1.0), 0.0));
        let log = mapping(Scale::Log10, Some([1e-2, 1e4]));
        assert!(close(log.unclamped(10.0), 0.5));
        assert!(close(log.unclamped(0.0), log.unclamped(1e-3)), "floor");
        assert!(close(log.unclamped(-7.0), -1.0 / 6.0), "floor");
        let symlog = mapping(Scale::Symlog { linthresh: 0.45 }, Some([-4.5, 4.5]));
        assert!(close(symlog.unclamped(0.0), 0.5) && close(symlog.unclamped(4.5), 1.0));
        let full = 2.0 * (1.0 / 0.9 + 1.0);
        assert!(close(symlog.unclamped(-45.0), 0.5 - (1.0 / 0.9 + 2.0) / full));
        assert!(close(symlog.unclamped(0.225), 0.5 + 0.5 / 0.9 / full), "linear part");
    }

    #[test]
    fn ends_that_the_scale_cannot_show_are_refused() {
        let field = FieldExtrema { minimum: 0.0, maximum: 1e-200, smallest_positive: Some(1e-300) };
        let mapped = |range| Mapping::new(Scale::Log10, range, field, 1e-100);
        let refused = mapped(None).unwrap_err().to_string();
        assert!(refused.contains("give the volume a `range`"), "{refused}");
        assert_eq!(mapped(Some([1e-310, 1e-300])).unwrap().clamped(1e-300), 0.0);
        // Nothing is positive: everything maps to 0.
        let field = FieldExtrema { minimum: 0.0, maximum: 0.0, smallest_positive: None };
        assert_eq!(Mapping::new(Scale::Log10, None, field, 1.0).unwrap().unclamped(0.0), 0.0);
    }

    #[test]
    fn without_a_range_the_extrema_map_to_0_and_1() {
        for (scale, lowest) in
            [(Scale::Linear, -2.0), (Scale::Log10, 1e-3), (Scale::Symlog { linthresh: 1.0 }, -2.0)]
        {
            let mapping = mapping(scale, None);
            assert!(close(mapping.unclamped(lowest), 0.0), "{scale:?}");
            assert!(close(mapping.unclamped(1e4), 1.0), "{scale:?}");
        }
    }

    #[test]
    fn units_multiply_values_before_the_scale() {
        let cgs = Mapping::new(Scale::Log10, Some([1e-26, 1e-20]), FIELD, 1e-24).unwrap();
        assert!(close(cgs.unclamped(10.0), 0.5));
        assert!(close(cgs.unclamped(0.0), -1.0 / 6.0), "the floor is in the same units");
        let extrema = Mapping::new(Scale::Linear, None, FIELD, 3.0).unwrap();
        assert!(close(extrema.unclamped(1e4), 1.0) && close(extrema.unclamped(-2.0), 0.0));
        for factor in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(Mapping::new(Scale::Linear, None, FIELD, factor).is_err());
        }
    }

    #[test]
    fn degenerate_fields_map_to_0() {
        let constant = FieldExtrema { minimum: 3.0, maximum: 3.0, smallest_positive: Some(3.0) };
        let nothing = FieldExtrema { minimum: -1.0, maximum: 0.0, smallest_positive: None };
        for scale in [Scale::Linear, Scale::Log10, Scale::Symlog { linthresh: 1.0 }] {
            let mapping = Mapping::new(scale, None, constant, 1.0).unwrap();
            assert!([3.0, 4.0, -1.0, f64::NAN].iter().all(|&f| mapping.unclamped(f) == 0.0));
        }
        for range in [None, Some([1.0, 2.0])] {
            let mapping = Mapping::new(Scale::Log10, range, nothing, 1.0).unwrap();
            assert!([5.0, 0.0, -1.0].iter().all(|&f| mapping.unclamped(f) == 0.0));
        }
    }

    #[test]
    fn extreme_values_stay_finite() {
        let widest = mapping(Scale::Linear, Some([f64::MIN, f64::MAX]));
        assert!(close(widest.unclamped(0.0), 0.5));
        let narrow = mapping(Scale::Linear, Some([0.0, 1e-300]));
        assert_eq!(narrow.unclamped(f64::MAX), LARGEST_UNCLAMPED);
        assert_eq!(narrow.unclamped(f64::NEG_INFINITY), -LARGEST_UNCLAMPED);
        assert_eq!(narrow.unclamped(f64::NAN), 0.0);
        // Half of the smallest number is none.
        let extrema =
            FieldExtrema { minimum: 0.0, maximum: 5e-324, smallest_positive: Some(5e-324) };
        let flat = Mapping::new(Scale::Linear, None, extrema, 1.0).unwrap();
        assert_eq!([0.0, 5e-324, 1.0].map(|f| flat.unclamped(f)), [0.0; 3]);
        assert!(Mapping::new(Scale::Linear, Some([0.0, 5e-324]), extrema, 1.0).is_err());
        let symlog = mapping(Scale::Symlog { linthresh: 5e-324 }, Some([-1.0, 1.0]));
        assert!(symlog.unclamped(f64::MAX).is_finite() && close(symlog.unclamped(0.0), 0.5));
    }

    proptest! {
        #[test]
        fn distances_bound_differences(
            f in prop_oneof![-50.0f64..50.0, 1e-3f64..1e4],
            step in -1.0f64..1.0,
            relative in 0.0f64..0.5,
        ) {
            for scale in [Scale::Linear, Scale::Log10, Scale::Symlog { linthresh: 0.7 }] {
                let mapping = mapping(scale, Some([0.5, 20.0]));
                let off = |other: f64| (mapping.unclamped(other) - mapping.unclamped(f)).abs();
                let log10 = ((f + step).max(1e-3).log10() - f.max(1e-3).log10()).abs();
                let values = [f.min(f + step), f.max(f + step)];
                prop_assert!(off(f + step) <= mapping.distance(step.abs(), log10, values) + 1e-12);
                for other in [f * (1.0 + relative), f * (1.0 - relative)] {
                    let x = mapping.unclamped(f);
                    let bound = mapping.rounding(relative, 0.0).between(x, x);
                    prop_assert!(off(other) <= bound + 1e-12, "{scale:?} {f} {other} {bound}");
                }
            }
        }

        /// Interpolants of two levels are means of values after the scale, not before.
        #[test]
        fn distances_bound_differences_of_means(
            values in prop::array::uniform4(-1.0f64..1.0),
            weights in prop::array::uniform2(0.0f64..1.0),
            power in -3.0f64..3.0,
            is_even in any::<bool>(),
            is_positive in any::<bool>(),
        ) {
            let [a, b, c, d] = values.map(|v| if is_positive { v.abs() + 1e-3 } else { v });
            let [v, w] = weights;
            // One mean of the other's values: what no difference of means of values tells.
            let (c, d) = if is_even { (v * a + (1.0 - v) * b, d) } else { (c, d) };
            let (w, d) = if is_even { (1.0, d) } else { (w, d) };
            let linthresh = 10f64.powf(power);
            for scale in [Scale::Linear, Scale::Log10, Scale::Symlog { linthresh }] {
                if scale == Scale::Log10 && !is_positive {
                    continue;
                }
                let mapping = mapping(scale, Some([1e-3, 20.0]));
                // Whatever is not known of means, of one value there is only one.
                let alike = mapping.distance(0.0, 0.0, [a, a]);
                prop_assert_eq!(alike, 0.0);
                prop_assert!(!mapping.distance(f64::INFINITY, f64::INFINITY, [a, a]).is_nan());
                let apart = |of: &dyn Fn(f64) -> f64| {
                    let mean = |w: f64, [a, b]: [f64; 2]| w * of(a) + (1.0 - w) * of(b);
                    (mean(v, [a, b]) - mean(w, [c, d])).abs()
                };
                let all = [a, b, c, d];
                let ends = all.into_iter().fold([a, a], |[l, h], f| [l.min(f), h.max(f)]);
                let log10 = apart(&|f| f.max(1e-3).log10());
                let bound = mapping.distance(apart(&|f| f), log10, ends);
                let off = apart(&|f| mapping.unclamped(f));
                prop_assert!(off <= bound + 1e-12, "{scale:?}: {off:e}, not {bound:e}");
            }
        }

        /// Of fields that reach far below what f32 holds.
        #[test]
        fn what_f32_loses_is_bounded(power in -60.0f64..5.0, smallest in -60.0f64..-30.0) {
            let [f, smallest] = [power, smallest].map(|power| 10f64.powf(power));
            let f = f.max(smallest);
            let field =
                FieldExtrema { minimum: smallest, maximum: 1e5, smallest_positive: Some(smallest) };
            let mapping = Mapping::new(Scale::Log10, None, field, 1.0).unwrap();
            let stored = mapping.unclamped(f64::from(f as f32));
            let off = (stored - mapping.unclamped(f)).abs();
            let rounding = mapping.rounding((-24f64).exp2(), f64::from(f32::MIN_POSITIVE));
            prop_assert!(off <= rounding.between(stored, stored) + 1e-12, "{f:e}: {off:e}");
            if f > 1e-37 {
                prop_assert!(rounding.between(stored, stored) < 1e-7);
            }
        }

        /// Of fields whose range is below what f32 holds with all digits.
        #[test]
        fn what_f32_loses_is_bounded_under_any_scale(part in -3.0f64..3.0, power in -46.0f64..-34.0) {
            let range = 10f64.powf(power);
            let f = part * range;
            for scale in [Scale::Linear, Scale::Symlog { linthresh: 0.3 * range }] {
                let mapping = mapping(scale, Some([-range, range]));
                let stored = mapping.unclamped(f64::from(f as f32));
                let off = (stored - mapping.unclamped(f)).abs();
                let rounding = mapping.rounding((-24f64).exp2(), f64::from(f32::MIN_POSITIVE));
                let bound = rounding.between(stored, stored);
                prop_assert!(off <= bound + 1e-12, "{scale:?} {f:e}: {off:e}, {bound:e}");
                // No more than the step between such numbers makes, and what others are off by.
                prop_assert!(bound < 4.0 * 1.5e-45 / range + 1e-6, "{scale:?} {f:e}: {bound:e}");
            }
        }

        #[test]
        fn never_decreasing(a in -1e6f64..1e6, b in -1e6f64..1e6, linthresh in 1e-6f64..1e3) {
            let (a, b) = (a.min(b), a.max(b));
            for scale in [Scale::Linear, Scale::Log10, Scale::Symlog { linthresh }] {
                let mapping = mapping(scale, Some([0.5, 20.0]));
                prop_assert!(mapping.unclamped(a) <= mapping.unclamped(b) + 1e-15);
            }
        }
    }
}
