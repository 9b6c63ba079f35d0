//! How far values are from the source's, as they are stored, and how far they may be off in all.

use super::distance::range_beneath;
use super::rounded::up;
use crate::polynomial::Polynomial;
use crate::scene::Rounding;

/// Rounding in f64 of values, and of means of them.
const ROUNDING: f64 = 16.0 * f64::EPSILON;
/// Values are as good as 0 that are no farther below it, in x and relative to where 0 lies.
const AS_GOOD_AS_ZERO: f64 = 1e-12;

/// Bound of the difference that storage makes to x where that is a mean of stored values, as
/// interpolants are: at most `most`, and at most `base` + `slope`·x. For values of one sign stored
/// with a relative error, a mean of them is off by no more of its own. Nothing changes from x = 1 on, so
/// that what crosses no place up to there counts for nothing: from far above, `most` may be less than the
/// difference; of values that are no means, but cells' own, from far below 0 as well.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Storage {
    // Rounded up to f32: bricks have many of these.
    most: f32,
    /// The largest difference of any value, from however far above.
    largest: f32,
    base: f32,
    slope: f32,
}

impl Storage {
    /// The bound for values between `low` and `high`, in place of which the truth has others, no
    /// more than `beneath` from them and within `tree`.
    pub(crate) fn new(
        rounding: &Rounding,
        [low, high]: [f64; 2],
        beneath: f64,
        tree: [f64; 2],
    ) -> Self {
        let [lowest, highest] = range_beneath([low, high], beneath, tree);
        // Where neighbours are far larger their share is rounding.
        let rounded = ROUNDING * low.abs().max(high.abs());
        let most = rounding.between(lowest, highest) + rounded;
        let Some([zero, slope, lost]) = rounding.line() else {
            return Self::at_most(most);
        };
        let below = AS_GOOD_AS_ZERO * zero.abs();
        // What the slope is rounded up by counts from x = `low` on.
        let steeper = f64::from(up(slope)) - slope;
        let own = slope * (2.0 * below - zero) + rounded + lost;
        let (own, base) = if lowest >= zero - below {
            (own, own + slope * beneath.min(highest - low) - steeper * low)
        } else {
            (f64::INFINITY, f64::INFINITY)
        };
        Self {
            most: up(most.min(farthest_below_one(own, slope))),
            largest: up(most),
            base: up(base),
            slope: up(slope),
        }
    }

    /// The largest difference, wherever x is, or the farthest from a place up to 1 that it may cross.
    pub(crate) fn most(&self) -> f64 {
        f64::from(self.most)
    }

    /// How much more the difference may be for each unit of x; 0 where only its largest is known.
    pub(crate) fn slope(&self) -> f64 {
        f64::from(self.slope)
    }

    /// The bound where no more is known than the largest difference.
    pub(crate) fn at_most(most: f64) -> Self {
        Self { most: up(most), largest: up(most), base: f32::INFINITY, slope: 0.0 }
    }

    /// The same where values are single cells' own, of either sign: what lies so far from [0, 1] that it
    /// stays on its side counts for nothing.
    pub(crate) fn of_cells(
        rounding: &Rounding,
        range: [f64; 2],
        beneath: f64,
        tree: [f64; 2],
    ) -> Self {
        let of_means = Self::new(rounding, range, beneath, tree);
        let Some([zero, slope, lost]) = rounding.line() else { return of_means };
        let off = |place: f64| (slope + ROUNDING) * (place - zero).abs() + ROUNDING + lost;
        let most = if slope < 1.0 { off(0.0).max(off(1.0)) / (1.0 - slope) } else { f64::INFINITY };
        Self { most: of_means.most.min(up(most)), ..of_means }
    }

    /// The largest difference where x is at most `x`.
    #[inline]
    pub(crate) fn up_to(&self, x: f64) -> f64 {
        (f64::from(self.base) + self.slope() * x).min(self.most()).max(0.0)
    }

    /// The base of a line of another slope, no less steep, that bounds it from x = `low` on.
    pub(crate) fn base_for(&self, slope: f64, low: f64) -> f64 {
        f64::from(self.base) + (self.slope() - slope) * low
    }

    /// What holds for both, and the steeper slope.
    pub(crate) fn max(self, other: Self) -> Self {
        let is_one = self.slope == other.slope;
        Self {
            most: self.most.max(other.most),
            largest: self.largest.max(other.largest),
            base: if is_one { self.base.max(other.base) } else { f32::INFINITY },
            slope: self.slope.max(other.slope),
        }
    }
}

/// How far from a place up to 1 a stored x may be if the source's, within `base` + `slope`·x of it, may lie
/// on the other side: above it x(1 − slope) − base is at most 1, and below x itself is.
fn farthest_below_one(base: f64, slope: f64) -> f64 {
    let is_known = base.is_finite() && slope < 1.0;
    if is_known { ((base + slope) / (1.0 - slope)).max(base).max(0.0) } else { f64::INFINITY }
}

/// How far values along a ray may be off, in x.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Reach {
    /// How far values may be off by anything but storage.
    pub(crate) others: f64,
    /// How far values may be off by storage.
    pub(crate) storage: Storage,
    /// Whether the truth lies in other cells: beneath, or along other rays.
    pub(crate) is_elsewhere: bool,
}

/// The most that x may be off more at one place of a stretch, within a dual cell, than at another
/// as it is stored, per such stretch and per what that is at most. What is trilinear between
/// numbers within ±1 has slopes of up to 2 along each axis; weights that blend two such beside a
/// border have slopes of up to 2 along an axis, times a difference of up to 2, for each of a few
/// levels.
const DRIFT: f64 = 64.0;

impl Reach {
    /// The share of a stretch in which truth and `x` may be on different sides of `place`.
    pub(crate) fn share_across<const N: usize>(&self, x: &Polynomial<N>, place: f64) -> f64 {
        let [_, reach] = self.near(place);
        // Of anything else it is not said how it changes along the way. Corners of the cell may be
        // off by more than what is between them at the place.
        let drift =
            if self.is_elsewhere { f64::INFINITY } else { DRIFT * f64::from(self.storage.largest) };
        x.share_across(place, reach, drift)
    }

    /// The most that values may be off by, wherever x is.
    #[inline]
    pub(crate) fn most(&self) -> f64 {
        self.others + self.storage.most()
    }

    /// How far values may be off by storage, and in all, where x may be `place`.
    pub(crate) fn near(&self, place: f64) -> [f64; 2] {
        let stored = self.storage.up_to(place + self.most());
        [stored, self.others + stored]
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::scene::{FieldExtrema, Mapping, Scale};

    /// What stored values are off by, relative.
    const STORED: f64 = 0.01;

    fn scale(number: usize) -> (Scale, [f64; 2]) {
        [
            (Scale::Linear, [0.0, 50.0]),
            (Scale::Linear, [0.0, 0.7]),
            (Scale::Linear, [-20.0, 5.0]),
            (Scale::Linear, [3.0, 9.0]),
            (Scale::Log10, [1e-2, 1e3]),
            (Scale::Symlog { linthresh: 2.0 }, [-5.0, 50.0]),
        ][number]
    }

    #[test]
    fn lines_of_several_slopes_are_joined() {
        let flat = Storage { most: 4.0, largest: 4.0, base: 0.5, slope: 0.0 };
        let steep = Storage { most: 3.0, largest: 3.0, base: 1.0, slope: 0.25 };
        let both = flat.max(steep);
        let (low, count) = (-3.0, 100);
        for n in 0..=count {
            let x = low + 10.0 * f64::from(n) / f64::from(count);
            assert!(both.up_to(x) >= flat.up_to(x).max(steep.up_to(x)), "{x}");
            for own in [flat, steep] {
                let line = own.base_for(both.slope(), low) + both.slope() * x;
                assert!(line >= 0.0 && line.min(own.most()) >= own.up_to(x), "{x}");
            }
        }
        assert_eq!(steep.max(Storage { base: 2.0, ..steep }), Storage { base: 2.0, ..steep });
    }

    #[test]
    fn steps_are_crossed_on_one_side_by_what_is_stored_alone() {
        let storage = Storage::at_most(1e-4);
        let x = Polynomial([0.0, 1.0]);
        let own = Reach { others: 0.0, storage, is_elsewhere: false };
        assert!((own.share_across(&x, 0.5) - 1e-4).abs() < 1e-8);
        let elsewhere = Reach { is_elsewhere: true, ..own };
        assert!((elsewhere.share_across(&x, 0.5) - 2e-4).abs() < 1e-8);
    }

    #[test]
    fn corners_far_above_the_range_drift_by_all_that_they_are_off_by() {
        let extrema = FieldExtrema { minimum: 0.0, maximum: 1e9, smallest_positive: Some(1.0) };
        let mapping = Mapping::new(Scale::Linear, Some([0.0, 1.0]), extrema, 1.0).unwrap();
        let tree = [f64::NEG_INFINITY, f64::INFINITY];
        let storage = Storage::new(&mapping.rounding(STORED, 0.0), [0.5, 1e6], 0.0, tree);
        assert!(storage.most() < 1.1 * STORED && f64::from(storage.largest) >= 1e6 * STORED);
        // x is flat beside what such corners may do: truth may cross on both sides.
        let x = Polynomial([0.45, 0.1]);
        let reach = Reach { others: 0.0, storage, is_elsewhere: false };
        let alike = Reach { storage: Storage { largest: 1e-6, ..storage }, ..reach };
        assert!(reach.share_across(&x, 0.5) > 1.5 * alike.share_across(&x, 0.5));
    }

    #[test]
    fn cells_far_outside_the_range_are_off_by_nothing_that_shows() {
        let extrema = FieldExtrema { minimum: -1e6, maximum: 1e6, smallest_positive: Some(1e-6) };
        let mapping = Mapping::new(Scale::Linear, Some([0.0, 1e-2]), extrema, 1.0).unwrap();
        let rounding = mapping.rounding(6e-8, 0.0);
        let (range, tree) = ([-1e8, 1e8], [f64::NEG_INFINITY, f64::INFINITY]);
        assert!(Storage::new(&rounding, range, 0.0, tree).most() > 1.0, "means of them");
        let most = Storage::of_cells(&rounding, range, 0.0, tree).most();
        assert!(most > 6e-8 && most < 6.1e-8, "{most:e}");
    }

    proptest! {
        /// Means of mapped values, stored ones and the source's, at most `beneath` apart but for
        /// storage.
        #[test]
        fn means_are_off_by_no_more(
            number in 0..6_usize,
            values in prop::collection::vec((-1.0..1.0_f64, -1.0..1.0_f64, -1.0..1.0_f64), 8),
            weights in prop::collection::vec(0.01..1.0_f64, 8),
            sign in 0..3_usize,
            apart in 0.0..2.0_f64,
        ) {
            let (scale, range) = scale(number);
            let extrema = FieldExtrema { minimum: -60.0, maximum: 60.0, smallest_positive: Some(1e-3) };
            let mapping = Mapping::new(scale, Some(range), extrema, 1.0).unwrap();
            let rounding = mapping.rounding(STORED, 0.0);
            let log10_floor = if scale == Scale::Log10 { 1e-2 } else { 0.0 };
            let value = |v: f64| match sign {
                0 => v,
                1 => v.abs(),
                _ => -v.abs(),
            } * 50.0 + log10_floor;
            let (mut own, mut beneath) = (Vec::new(), 0.0_f64);
            let (mut drawn, mut kept, mut off, mut total) = (0.0, 0.0, 0.0, 0.0);
            for ((v, finer, error), weight) in values.iter().zip(&weights) {
                let x = mapping.unclamped(value(*v));
                let stored = value(*v) + apart * finer;
                let source = stored / (1.0 + STORED * error);
                beneath = beneath.max((mapping.unclamped(stored) - x).abs());
                own.push(x);
                drawn += weight * x;
                // By storage alone: both of what is beneath.
                kept += weight * mapping.unclamped(stored);
                off += weight * (mapping.unclamped(source) - mapping.unclamped(stored)).abs();
                total += weight;
            }
            let low = own.iter().copied().fold(f64::INFINITY, f64::min);
            let high = own.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let tree = [f64::NEG_INFINITY, f64::INFINITY];
            let storage = Storage::new(&rounding, [low, high], beneath, tree);
            let of_cells = Storage::of_cells(&rounding, [low, high], beneath, tree);
            for ((v, finer, error), x) in values.iter().zip(&own) {
                let stored = value(*v) + apart * finer;
                let [kept, other] =
                    [stored, stored / (1.0 + STORED * error)].map(|f| mapping.unclamped(f));
                let shown = (kept.clamp(0.0, 1.0) - other.clamp(0.0, 1.0)).abs();
                prop_assert!(shown <= of_cells.most(), "{shown:e} {of_cells:?}");
                for place in [0.0, 0.3, 0.99, 1.0] {
                    let is_crossed = (other < place) != (kept < place);
                    let reach = Reach { others: beneath, storage: of_cells, is_elsewhere: true };
                    let [_, reach] = reach.near(place);
                    prop_assert!(!is_crossed || (x - place).abs() <= reach * (1.0 + 1e-9));
                }
            }
            let [x, kept, off] = [drawn, kept, off].map(|sum| sum / total);
            let bound = storage.up_to(x) * (1.0 + 1e-9);
            for other in [kept - off, kept + off] {
                let shown = (kept.min(1.0) - other.min(1.0)).abs();
                prop_assert!(shown <= bound, "{shown:e} {bound:e} {storage:?}");
                for place in [-0.5, 0.0, 0.3, 0.99, 1.0] {
                    let is_crossed = (other < place) != (kept < place);
                    let [_, reach] = Reach { others: beneath, storage, is_elsewhere: true }.near(place);
                    prop_assert!(!is_crossed || (x - place).abs() <= reach * (1.0 + 1e-9));
                }
            }
            // It is no more than it takes.
            if beneath == 0.0 && low > 0.0 && scale == Scale::Linear && range[0] == 0.0 {
                prop_assert!(bound <= 1.02 * STORED * x.min(1.02));
            }
        }
    }
}
