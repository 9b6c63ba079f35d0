//! What is known of a pixel while its rays come in: its value, how far it is off at most, and,
//! where that stays too much, how far it is off as far as its rays' differences tell.
//!
//! Squares come in two ways. One by one, each with a bound of what its mean differs from its
//! centre's ray by: they make the pixel's *certified* value. Where that bound stays above the
//! tolerance, squares are quartered on, and the rays of their quarters stand for themselves. What
//! these say is closer to the truth, and the certificate holds with the distance of both values
//! added to it.

use super::unevenness::{DEVIATIONS, Unevenness};
use super::waiting::Found;
use crate::render::bounds::shares::ErrorShares;
use crate::render::bounds::sums::larger;
use crate::sum::Sum;

/// A pixel in hand.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Pixel {
    /// What it is, as far as it is known.
    pub(super) value: [f64; 4],
    /// The sum of squares with bounds, each times its part of the pixel.
    certified: [f64; 4],
    /// What `certified` may be off by: a bound, by cause.
    pub(super) shares: ErrorShares,
    /// The part of the pixel that `certified` covers.
    pub(super) weight: f64,
    /// What squares that were taken as they are may add to what it is off by.
    taken: f64,
    /// Rays that stand for themselves, but for those at its outer sides.
    pub(super) rays_alone: u32,
    /// Squares whose rays stand for themselves, with what these alone may be off by.
    alone: Alone,
}

/// Squares that are left, added up. A core that shines adds far more than what is left of it once
/// its square is quartered, so that rounding must not stay.
#[derive(Debug, Clone, Copy, Default)]
struct Alone {
    /// The variance of what they add to the pixel, and what their means exceed their centres' rays
    /// by together, without those of which nothing is known yet.
    variance: Sum,
    bend: [Sum; 4],
    /// What those may be off by together whose rays lie at their centres, where edges may run beside all
    /// of these: a standard deviation.
    aligned: Sum,
    /// How many these are.
    unknown: u32,
    /// The same of squares that were given up for want of room: more rays in others do not change what
    /// these are off by.
    lost: Lost,
    /// What their rays may be off by, where that is known.
    own: Sum,
    /// The variance as four rays of the whole pixel told it, and how many of its quarters stand for
    /// themselves by one ray each.
    first: Option<f64>,
    quarters: u8,
}

/// Squares that were given up, likewise.
#[derive(Debug, Clone, Copy, Default)]
struct Lost {
    variance: f64,
    bend: [f32; 4],
    aligned: f64,
    unknown: u32,
}

impl Pixel {
    /// The error that a square of what is not known yet may have on average, where the whole may
    /// have `allowed`.
    pub(super) fn rate(&self, allowed: f64) -> f64 {
        let open = 1.0 - self.weight;
        if open > 1e-9 { ((allowed - self.shares.total()) / open).max(allowed) } else { allowed }
    }

    /// Takes a square that is `weight` of it as it is.
    pub(super) fn take(&mut self, found: &Found, weight: f64) {
        self.certify(found, weight);
        self.taken += weight * found.shares().total();
        self.draw(found, weight);
    }

    fn certify(&mut self, found: &Found, weight: f64) {
        add(&mut self.certified, &found.value, weight);
        self.shares.add(&found.shares(), weight);
        self.weight += weight;
    }

    /// Leaves a square to rays that stand for themselves: its bound is what it is.
    pub(super) fn leave(&mut self, found: &Found, weight: f64) {
        self.certify(found, weight);
        match &found.uneven {
            Some(uneven) => {
                self.alone.count(uneven, weight, 1.0);
                self.alone.own.add(weight * found.own());
                if found.square.halvings == 1 {
                    self.alone.first = Some(4.0 * uneven.variance(weight));
                    self.alone.quarters += 1;
                }
            }
            None => self.alone.unknown += 1,
        }
    }

    /// Takes a square of those left, or a quarter of one, as it is.
    pub(super) fn draw(&mut self, found: &Found, weight: f64) {
        add(&mut self.value, &found.value, weight);
    }

    /// Takes a square of those left as it is, for want of room: what it may be off by stays.
    pub(super) fn give_up(&mut self, found: &Found, weight: f64) {
        self.alone.lose(found.uneven.as_ref(), weight);
        self.alone.forget_quarter(found);
        self.draw(found, weight);
    }

    /// Learns of the quarters of a square left, `weight` of the pixel: that they are uneven, and
    /// what their rays may be off by.
    pub(super) fn learn(
        &mut self,
        whole: &Found,
        quarters: &[Unevenness; 4],
        weight: f64,
        shares: &ErrorShares,
    ) {
        let alone = &mut self.alone;
        match &whole.uneven {
            Some(uneven) => {
                alone.count(uneven, weight, -1.0);
                alone.own.add(-weight * whole.own());
            }
            None => alone.unknown = alone.unknown.saturating_sub(1),
        }
        alone.forget_quarter(whole);
        for quarter in quarters {
            alone.count(quarter, 0.25 * weight, 1.0);
        }
        if whole.square.halvings == 0 {
            alone.first = Some(quarters.iter().map(|quarter| quarter.variance(0.25)).sum());
            alone.quarters = 4;
        }
        alone.own.add(weight * shares.likely_beside_area());
    }

    /// Takes the whole of it, which was left, by its centre's ray: its neighbours tell how it varies, and
    /// have been off by so much elsewhere.
    pub(super) fn take_as_predicted(&mut self, found: &Found, predicted: &Unevenness, doubt: f64) {
        let alone = &mut self.alone;
        alone.unknown = alone.unknown.saturating_sub(1);
        alone.count(predicted, 1.0, 1.0);
        alone.own.add(found.own() + doubt);
        self.draw(found, 1.0);
    }

    /// The variance that its first four rays told.
    pub(super) fn first_variance(&self) -> Option<f64> {
        self.alone.first
    }

    /// Whether one ray each stands for quarters of it.
    pub(super) fn has_quarters(&self) -> bool {
        self.alone.quarters > 0
    }

    /// What its mean may be off by in all likelihood, where its variance is taken for at least
    /// `least`; infinite while something is unknown.
    pub(super) fn unlikely(&self, least: f64) -> f64 {
        let Alone { unknown, variance, bend, aligned, lost, .. } = &self.alone;
        let variance = larger(variance.value() + lost.variance, least);
        let bend = |n: usize| bend[n].value() + f64::from(lost.bend[n]);
        let aligned = aligned.value() + lost.aligned;
        likely_error(unknown + lost.unknown, variance, aligned, std::array::from_fn(bend))
    }

    /// What its mean may be off by in all likelihood as far as more rays may change it, where that
    /// variance is taken for at least `least`: squares that were given up are left out.
    pub(super) fn changeable(&self, least: f64) -> f64 {
        let Alone { unknown, variance, bend, aligned, .. } = &self.alone;
        let variance = larger(variance.value(), least);
        likely_error(*unknown, variance, aligned.value(), bend.map(Sum::value))
    }

    /// By how much the variance that more rays may change is above the one with which its mean is off by
    /// `room` in all likelihood; without limit where nothing is known of part of it, or none is small enough.
    pub(super) fn surplus(&self, room: f64) -> f64 {
        let Alone { unknown, variance, bend, aligned, .. } = &self.alone;
        let most = (room - most(bend.map(Sum::value))) / DEVIATIONS;
        let allowed = most * most - aligned.value() * aligned.value();
        let is_none = *unknown > 0 || most.is_nan() || most <= 0.0 || allowed <= 0.0;
        if is_none { f64::INFINITY } else { variance.value() - allowed }
    }

    /// What it is off by at most.
    pub(super) fn bound(&self) -> ErrorShares {
        let distance = |n: usize| (self.value[n] - self.certified[n]).abs();
        let farthest = (0..4).map(distance).fold(0.0, f64::max);
        // The value's f32 may round by more than that of the certified one.
        let pixel_area = self.shares.pixel_area + farthest * (1.0 + f64::from(f32::EPSILON));
        ErrorShares { pixel_area, ..self.shares }
    }

    /// Whether of part of it nothing is known but one ray.
    pub(super) fn is_partly_unknown(&self) -> bool {
        self.alone.unknown + self.alone.lost.unknown > 0
    }

    /// What it is off by beside its mean: what was taken as it is, and what rays themselves are off
    /// by.
    pub(super) fn beside_mean(&self) -> f64 {
        self.taken + self.alone.own.value()
    }

    /// What it will be off by beside its mean once a square left, `weight` of the pixel, is known
    /// by rays that may be off by `shares`.
    pub(super) fn beside_mean_with(&self, whole: &Found, weight: f64, shares: &ErrorShares) -> f64 {
        let known = whole.uneven.map_or(0.0, |_| whole.own());
        self.beside_mean() + weight * (shares.likely_beside_area() - known)
    }

    /// What it is off by as far as its rays tell, and not more than the bound.
    pub(super) fn estimate(&self) -> f64 {
        (self.beside_mean() + self.unlikely(0.0)).min(self.bound().total())
    }
}

/// What a mean may be off by in all likelihood; without limit where nothing is known of some squares.
fn likely_error(unknown: u32, variance: f64, aligned: f64, bend: [f64; 4]) -> f64 {
    if unknown > 0 {
        return f64::INFINITY;
    }
    // What overflowed may be no number: nothing is known then.
    larger(DEVIATIONS * (larger(variance, 0.0) + aligned * aligned).sqrt(), 0.0) + most(bend)
}

/// The largest of these, whatever their signs.
fn most(bend: [f64; 4]) -> f64 {
    bend.iter().fold(0.0, |most, bend| larger(most, bend.abs()))
}

fn add(sum: &mut [f64; 4], value: &[f64; 4], weight: f64) {
    sum.iter_mut().zip(value).for_each(|(sum, value)| *sum += weight * value);
}

impl Alone {
    /// Counts a square that is `weight` of the pixel, or, where `sign` is −1, takes it out again.
    fn count(&mut self, uneven: &Unevenness, weight: f64, sign: f64) {
        self.variance.add(sign * uneven.variance(weight));
        self.aligned.add(sign * weight * uneven.aligned());
        for (c, sum) in self.bend.iter_mut().enumerate() {
            sum.add(sign * weight * uneven.bend(c));
        }
    }

    /// Counts a square no longer among the pixel's quarters, if it is one of these and known.
    fn forget_quarter(&mut self, found: &Found) {
        if found.square.halvings == 1 && found.uneven.is_some() {
            self.quarters = self.quarters.saturating_sub(1);
        }
    }

    /// Counts a square that is `weight` of the pixel among those that were given up.
    fn lose(&mut self, uneven: Option<&Unevenness>, weight: f64) {
        let Some(uneven) = uneven else {
            self.unknown = self.unknown.saturating_sub(1);
            self.lost.unknown += 1;
            return;
        };
        self.count(uneven, weight, -1.0);
        self.lost.variance += uneven.variance(weight);
        self.lost.aligned += weight * uneven.aligned();
        for (c, sum) in self.lost.bend.iter_mut().enumerate() {
            *sum += (weight * uneven.bend(c)) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::bounds::shares::RayShares;
    use crate::render::camera::rays::Square;
    use crate::render::tiles::unevenness::{SquareSides, UNSEEN_EDGE_SPREAD};

    const CENTRE: [f64; 2] = [3.5, 2.5];

    fn found(square: Square, of: impl Fn([f64; 2]) -> f64) -> Found {
        let value = [of(square.centre); 4];
        Found { square, value, shares: RayShares::default(), uneven: None }
    }

    fn whole() -> Square {
        Square { centre: CENTRE, offset: [0; 2], pixel: 0, halvings: 0 }
    }

    #[test]
    fn what_is_given_up_is_likely_as_before_and_no_longer_changeable() {
        let rough = Unevenness::spread_and_bent(0.5, 0.1);
        let quarters = whole()
            .quarters()
            .map(|quarter| Found { uneven: Some(rough), ..found(quarter, |_| 1.0) });
        let mut pixel = Pixel::default();
        pixel.leave(&found(whole(), |_| 1.0), 1.0);
        pixel.learn(&found(whole(), |_| 1.0), &[rough; 4], 1.0, &ErrorShares::default());
        let likely = pixel.unlikely(0.0);
        let bend = rough.most_bend();
        assert!((likely - DEVIATIONS * 0.25 - bend).abs() < 1e-7);
        assert_eq!(pixel.changeable(0.0), likely);
        quarters[..3].iter().for_each(|quarter| pixel.give_up(quarter, 0.25));
        assert!((pixel.unlikely(0.0) - likely).abs() < 1e-7);
        assert!((pixel.changeable(0.0) - DEVIATIONS * 0.125 - 0.25 * bend).abs() < 1e-7);
        assert_eq!(pixel.value, [0.75; 4]);
        // Of what is not known at all.
        let mut pixel = Pixel::default();
        pixel.leave(&found(whole(), |_| 1.0), 1.0);
        assert_eq!(pixel.changeable(0.0), f64::INFINITY);
        pixel.give_up(&found(whole(), |_| 1.0), 1.0);
        assert_eq!((pixel.changeable(0.0), pixel.unlikely(0.0)), (0.0, f64::INFINITY));
    }

    #[test]
    fn quarters_decide_on_a_pixel_until_none_is_left() {
        let even = Unevenness::spread_and_bent(0.1, 0.0);
        let mut pixel = Pixel::default();
        pixel.leave(&found(whole(), |_| 1.0), 1.0);
        assert!(!pixel.has_quarters());
        pixel.learn(&found(whole(), |_| 1.0), &[even; 4], 1.0, &ErrorShares::default());
        let quarters = whole().quarters();
        let known = quarters.map(|square| Found { uneven: Some(even), ..found(square, |_| 1.0) });
        for quarter in &known[..3] {
            pixel.learn(quarter, &[even; 4], 0.25, &ErrorShares::default());
            // Quarters of this one are not the pixel's.
            let deeper = Found { square: quarter.square.quarters()[0], ..*quarter };
            pixel.learn(&deeper, &[even; 4], 0.0625, &ErrorShares::default());
            assert!(pixel.has_quarters());
        }
        pixel.give_up(&known[3], 0.25);
        assert!(!pixel.has_quarters());
    }

    #[test]
    fn a_surplus_is_what_brings_a_mean_within_its_room() {
        let uneven = Unevenness::spread_and_bent(0.5, 0.1);
        let mut pixel = Pixel::default();
        pixel.leave(&found(whole(), |_| 1.0), 1.0);
        assert_eq!(pixel.surplus(1.0), f64::INFINITY);
        pixel.learn(&found(whole(), |_| 1.0), &[uneven; 4], 1.0, &ErrorShares::default());
        // Three deviations of 1/4, and the bend.
        let bend = uneven.most_bend();
        assert!((pixel.surplus(0.6 + bend) - (0.0625 - 0.04)).abs() < 1e-7);
        assert!(pixel.surplus(0.76 + bend) < 0.0 && pixel.surplus(0.74 + bend) > 0.0);
        assert_eq!(pixel.surplus(0.09), f64::INFINITY);
    }

    #[test]
    fn nothing_is_known_of_what_overflows() {
        let endless = Unevenness::spread_and_bent(f64::INFINITY, 0.0);
        let square = Found { uneven: Some(endless), ..found(whole(), |_| 1.0) };
        let mut pixel = Pixel::default();
        pixel.leave(&square, 1.0);
        // Infinity less infinity is no number.
        pixel.learn(&square, &[Unevenness::default(); 4], 1.0, &ErrorShares::default());
        assert_eq!([pixel.unlikely(0.0), pixel.changeable(0.0)], [f64::INFINITY; 2]);
    }

    #[test]
    fn squares_along_an_edge_are_off_alike_where_their_rays_lie_at_their_centres() {
        let beside_edge = |is_aligned: bool| {
            let sides = SquareSides { beyond: [1.0; 4], own: [false, true, false, false] };
            let around = Some(Unevenness::of_edges([0.0, 1.0, 0.0, 0.0]));
            let ones = [1.0; 4];
            Unevenness::of_quarters(&ones, around, [&ones; 4], |_| sides, is_aligned)[1]
        };
        let likely = |is_aligned: bool| {
            let square = Found { uneven: Some(beside_edge(is_aligned)), ..found(whole(), |_| 1.0) };
            let mut pixel = Pixel::default();
            (0..16).for_each(|_| pixel.leave(&square, 1.0 / 256.0));
            let likely = pixel.changeable(0.0);
            (0..16).for_each(|_| pixel.give_up(&square, 1.0 / 256.0));
            assert!((pixel.unlikely(0.0) - likely).abs() < 1e-9 && pixel.changeable(0.0) < 1e-9);
            likely
        };
        // They cover a sixteenth of the pixel, which the edge may halve.
        assert!(
            (likely(false) - DEVIATIONS * UNSEEN_EDGE_SPREAD / 64.0).abs()
                < 1e-3 * UNSEEN_EDGE_SPREAD
        );
        assert!(likely(true) > DEVIATIONS * UNSEEN_EDGE_SPREAD / 16.0 && likely(true) > 0.3 / 16.0);
    }

    #[test]
    fn what_is_bright_leaves_nothing_behind_once_it_is_known() {
        let mut pixel = Pixel::default();
        let bright = |spread: f64| Unevenness::spread_and_bent(spread, -spread);
        let mut square = whole();
        pixel.leave(&found(square, |_| 0.0), 1.0);
        assert_eq!(pixel.unlikely(0.0), f64::INFINITY);
        let mut weight = 1.0;
        let mut before = None;
        for spread in [1e17, 1e19, 1e12, 1e-3] {
            let whole = Found { uneven: before, ..found(square, |_| 0.0) };
            let quarters = bright(spread);
            pixel.learn(&whole, &[quarters; 4], weight, &ErrorShares::default());
            // The other three turn out to be dark.
            for quarter in &square.quarters()[1..] {
                let quarter = Found { uneven: Some(quarters), ..found(*quarter, |_| 0.0) };
                pixel.learn(&quarter, &[bright(0.0); 4], 0.25 * weight, &ErrorShares::default());
            }
            (square, before) = (square.quarters()[0], Some(quarters));
            weight *= 0.25;
        }
        let last = bright(1e-3);
        let expected = weight * (last.spread() * DEVIATIONS + last.most_bend());
        assert!((pixel.unlikely(0.0) / expected - 1.0).abs() < 1e-5, "{}", pixel.unlikely(0.0));
    }
}
