//! Where a ray crosses a step of the transfer function, and what it means that the truth crosses
//! it a little earlier or later.
//!
//! Let x come within `reach` of the step between the places a and b of the ray. There the truth and
//! what is marched are mixes of the media on both sides; by the formula of [`super::ray_error`] the
//! picture is off by `T̃(a)·|(Ĩ_ab + T̃_ab·L_b) − (I_ab + T_ab·L_b)|`, with L_b the light from
//! behind b. What a medium emits and absorbs mixes its source function S = j / κ into the light
//! from behind, so that both sums lie between the values of S near b and L_b, but for what the
//! medium before the step adds. And behind b, where the truth has crossed as well, an opaque medium
//! gives light near S: L_b lies as near as S varies until e^−τ is left of anything else. So a
//! surface that moves within what lies before it is seen changes the picture by little, however
//! steep it is.
//!
//! Where it moves by little, less than that can change: only over the length by which it moves are
//! the media different, and there, by the first formula, the picture is off by `T̃·|κ·(S − L) −
//! (j′ − κ′·L)| ds`, with j′ and κ′ of the medium before the step, and L as near S as above.

use super::sums::Sums;
use crate::polynomial::Polynomial;
use crate::render::transfer::piece::{Piece, Step};
use crate::render::transfer::storage::Reach;

/// Optical depth behind which nothing is seen.
const OPAQUE: f64 = 40.0;

/// A crossing that has nothing else within reach.
pub(crate) struct Crossing<'p> {
    step: &'p Step,
    before: &'p Piece,
    /// Where x is the step's place.
    place: f64,
    /// How far x may be off there by storage, and in all.
    stored: f64,
    reach: f64,
    /// Code lengths within reach of the step, and those of them in which truth and x may be on
    /// different sides of it.
    near: f64,
    across: f64,
    /// Transmittance at most within reach.
    transmittance: f64,
}

/// What the picture may be off by if an opaque medium begins elsewhere, seen from where it does.
struct Behind {
    /// Wherever it begins within reach.
    in_all: f64,
    /// For each code length by which it begins earlier or later.
    mixed_in: f64,
}

/// Whether a monotone way between x = `ends` comes from beyond `reach` of `step`, the start of
/// the second of two pieces, and leaves it beyond, with no other step in between.
pub(crate) fn is_clean(ends: [f64; 2], [lower, upper]: [&Piece; 2], reach: f64) -> bool {
    let (low, high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
    let within = |end: f64| end - upper.start > reach;
    within(upper.end.min(high)) && upper.start - lower.start.max(low) > reach
}

impl<'p> Crossing<'p> {
    /// A way along `x`, monotone and of `length`, crosses the step where the piece `upper` starts,
    /// from the piece `before` where transmittance falls `from` one value `to` another within the
    /// piece.
    pub(crate) fn new<const N: usize>(
        x: &Polynomial<N>,
        length: f64,
        upper: &'p Piece,
        reach: &Reach,
        before: &'p Piece,
        [from, to]: [f64; 2],
    ) -> Self {
        let (step, place) = (&upper.step, upper.start);
        let across = length * reach.share_across(x, place);
        let [stored, reach] = reach.near(place);
        let near = length * x.share_near(place, reach);
        let extinction = before.extinction(place - reach).max(before.extinction(place + reach));
        let transmittance = from.min(to * (extinction * near).exp());
        Self { step, before, place, stored, reach, near, across, transmittance }
    }

    /// How far x may be off by storage where it is the step's place.
    pub(crate) fn stored(&self) -> f64 {
        self.stored
    }

    /// What the picture may be off by where the way goes on through `after` over s in [`from`,
    /// `to`], and no light is brighter than `brightest`: by the step, and by that of slopes for
    /// each unit of x.
    pub(crate) fn sums<const N: usize>(
        &self,
        x: &Polynomial<N>,
        length: f64,
        [from, to]: [f64; 2],
        after: &Piece,
        brightest: f64,
    ) -> [Sums; 2] {
        let brightest = brightest.max(1.0);
        let (jump, kink) = (self.step.jump, self.step.kink);
        let moved = Sums::of(jump, self.across, self.across * self.transmittance);
        let kinks = Sums::of(kink, self.near, self.near * self.transmittance);
        let behind = self.behind(x, length, [from, to], after, brightest);
        let within = self.only(self.across * behind.mixed_in);
        let whole = self.only(behind.in_all);
        let light = |sums: Sums| sums.emission + sums.dimmed * brightest;
        let smaller = if light(within) < light(moved) { within } else { moved };
        // Each is a bound by itself, so this decides on how close it is alone.
        if light(whole) < light(smaller) + self.reach * light(kinks) {
            [whole, Sums::default()]
        } else {
            [smaller, kinks]
        }
    }

    /// The sums of what the picture is off by `light` seen through what lies in front.
    fn only(&self, light: f64) -> Sums {
        let emission = self.transmittance * if light.is_nan() { f64::INFINITY } else { light };
        Sums { emission, ..Sums::default() }
    }

    /// Bounds by the light from behind, for a way on as of [`Self::sums`].
    fn behind<const N: usize>(
        &self,
        x: &Polynomial<N>,
        length: f64,
        [from, to]: [f64; 2],
        after: &Piece,
        brightest: f64,
    ) -> Behind {
        let first = after.extinction(self.place);
        // As far as half of the extinction at the step makes opaque, or the way goes.
        let far = (from + (2.0 * OPAQUE / first + self.near) / length).min(to);
        let end = x.at(far);
        let least = after.extinction(end).min(first);
        let depth = least * ((far - from) * length - self.near).max(0.0);
        let width = (end - self.place).abs() + self.reach;
        let largest = |piece: &Piece, x: f64| piece.emission(x).into_iter().fold(0.0, f64::max);
        let source = largest(after, self.place) / first;
        let varies = (after.slope[0] + source * after.slope[1]) * width / least;
        let other = |x: f64| largest(self.before, x) + self.before.extinction(x) * brightest;
        let other = other(self.place - self.reach).max(other(self.place + self.reach));
        let from_source = varies + (-depth).exp() * brightest + self.near * other;
        Behind { in_all: varies + from_source, mixed_in: first * from_source + other }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::transfer::pieces::TransferPieces;
    use crate::scene::{ColorTable, PiecewiseLinear, TransferFunction};

    /// Nothing, and a medium between x = 0.4 and 0.8 whose source function there is from 1 to
    /// `brightest`.
    fn pieces(opaque: f64, brightest: f64) -> TransferPieces {
        let table = |points: &[(f64, f64)]| {
            PiecewiseLinear::new(&points.iter().map(|&(x, y)| (x, [y])).collect::<Vec<_>>())
        };
        let steps = |last: f64| table(&[(0.4, 0.0), (0.4, opaque), (0.8, last), (0.8, 0.0)]);
        let (emission, opacity) = (steps(opaque * brightest).unwrap(), steps(opaque).unwrap());
        let white = PiecewiseLinear::new(&[(0.0, [1.0; 3])]).unwrap();
        let transfer = TransferFunction::from_tables(&emission, &opacity, &ColorTable::List(white));
        TransferPieces::new(&transfer, |_| 0.0)
    }

    /// What a way from x = 0.2 to 0.7 through a step at 0.4 may be off by if x is by `reach`.
    fn off(opaque: f64, brightest: f64, reach: f64) -> Sums {
        let pieces = pieces(opaque, brightest);
        let x = Polynomial([0.2, 0.5, 0.0, 0.0]);
        let (before, after) = (pieces.all.at(0.3), pieces.all.at(0.5));
        assert!(is_clean([0.2, 0.7], [before, after], reach));
        let reach = Reach { others: reach, is_elsewhere: true, ..Reach::default() };
        let crossing = Crossing::new(&x, 1.0, after, &reach, before, [1.0, 1.0]);
        crossing.sums(&x, 1.0, [0.4, 1.0], after, brightest)[0]
    }

    #[test]
    fn an_opaque_surface_may_lie_a_little_off() {
        let sums = off(1e9, 1.0, 1e-6);
        assert_eq!((sums.dimmed, sums.extinction), (0.0, 0.0));
        assert!(sums.emission < 1e-8, "{sums:?}");
        // Through an optical depth of 0.6 at most, less what may lie in front of the step.
        let thin = off(1.0, 1.0, 1e-3);
        assert!((thin.emission - 4e-3 * (-0.596_f64).exp()).abs() < 1e-6, "{thin:?}");
        let bright_behind = off(1.0, 1e3, 1e-3);
        assert!((bright_behind.emission - 4e-3).abs() < 1e-8, "{bright_behind:?}");
        assert_eq!(bright_behind.dimmed, bright_behind.emission);
    }

    /// The nearest light of an opaque medium is its source function at its surface: as that moves,
    /// this changes by its slope along the ray, here 2.5 · 0.5.
    #[test]
    fn a_surface_that_moves_by_little_changes_the_picture_by_less() {
        const OPACITY: f64 = 1e4;
        for reach in [1e-6, 1e-5, 1e-4] {
            let sums = off(OPACITY, 2.0, reach);
            let moved = reach / 0.5;
            assert_eq!((sums.dimmed, sums.extinction), (0.0, 0.0));
            assert!(sums.emission > 2.5 * 0.5 * moved, "{sums:?}");
            let all_between = moved * OPACITY * (1.0 + 2.0);
            assert!(sums.emission < 0.01 * all_between, "{sums:?}");
        }
    }

    #[test]
    fn steps_close_to_others_or_to_the_ends_are_not_clean() {
        let pieces = pieces(1.0, 1.0);
        let pair = [pieces.all.at(0.3), pieces.all.at(0.5)];
        assert!(is_clean([0.9, 0.2], pair, 0.1) && !is_clean([0.9, 0.2], pair, 0.5));
        assert!(!is_clean([0.45, 0.0], pair, 0.1) && !is_clean([0.35, 0.9], pair, 0.1));
    }
}
