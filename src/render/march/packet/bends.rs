//! Error bound of two-point Gauss–Legendre quadrature over a part of a cell in which the transfer
//! function is not linear in x.
//!
//! A way through a cell is cut into equal parts. About the middle of one, x is a cubic,
//! m + aσ + e·(σ² − ¼) + o·(σ³ − σ/4) for σ from −½ to ½, and covers a range of at most w ≥ |a|.
//! Let the emission be a quadratic in x with half the second derivative c, but for steps of its
//! slope (K in all over that range) and of c (C in all), and for a deviation d. Two nodes integrate
//! exactly what is linear in x. Added up are
//!
//! - for c·x², of which what is odd in σ vanishes in integral and rule alike:
//!   c·(a·o/90 + e²/180 + 0.0011·o²);
//! - for steps as the rule sees them, which sees the straight line through the nodes alone: wherever
//!   the step lies on that line, which covers a range of r, at most 0.0225·r·K + 0.0055·r²·C (found by
//!   trying all places, as the tests do again);
//! - for steps as the integral sees them besides. x is δ = e·(σ² − 1/12) + o·(σ³ − σ/12) from that
//!   line, at most D = e/6 + o/12, and nothing at the nodes. K counts times the integral of δ from the
//!   step to the part's end, at most 0.0161·e + 0.007·o; C times that of 2·(x − step)·δ, at most
//!   r·(0.0105·e + 0.0112·o), and D². Where x lies on the other side of a step than the line does,
//!   that is K·D·min(1, D/r) at most. All that steps make is never more than the distance from the
//!   chord, w·K/4 + w²·C/4;
//! - 2d;
//! - where light is absorbed over the part, by a depth of at most τ, what cancels above does so only
//!   to τ: τ·(w·K/4 + w²·C/4 + 0.0112·c·w·e), and for what is linear in x the slope times
//!   τ·(o/180 + τ·e/360);
//! - where weights of levels make a fourth power of x, a 180th of its coefficient times the slope.
//!
//! In front of a node, the optical depth is off where extinction is not linear between nodes. And
//! emission times transmittance is no polynomial: a fourth derivative f⁗ makes f⁗/4320.
#![allow(clippy::needless_range_loop)]

use super::PacketBrick;
use super::cube::Bend;
use super::rows::distance;
use crate::lanes::Lanes;
use crate::render::transfer::table::Bends;

/// What is known of a part's optical depth.
pub(super) struct Depths<L: Lanes> {
    /// The depth that the table's largest extinction makes.
    pub(super) thickness: L::Float,
    /// The depth that the mean of both nodes makes.
    pub(super) mean: L::Float,
    /// The larger extinction of both nodes.
    pub(super) extinction: L::Float,
}

/// What a part is off by.
pub(super) struct PartError<L: Lanes> {
    /// Emission, on average over the part.
    pub(super) emission: L::Float,
    /// Extinction, on average over the part.
    pub(super) extinction: L::Float,
    /// Extinction, at most, if taken to be linear along it.
    pub(super) most: L::Float,
    /// Light, relative, as emission times transmittance is no polynomial.
    pub(super) curved: L::Float,
    /// Its optical depth, at most.
    pub(super) depth: L::Float,
    /// What x is along it.
    pub(super) seen: PartValues<L>,
    /// Steepest slopes of emission and extinction that its values, and what they may be off by as
    /// they are stored, meet.
    pub(super) steepest: [L::Float; 2],
}

/// What x is along a part.
#[derive(Clone, Copy)]
pub(super) struct PartValues<L: Lanes> {
    /// The middle of the values that x may take.
    pub(super) middle: L::Float,
    /// Half the range of these: x is within `half` of `middle`.
    pub(super) half: L::Float,
    /// How far x is from the straight line through the nodes, at most.
    pub(super) off: L::Float,
    /// How far that line rises over the part.
    pub(super) rise: L::Float,
}

/// Largest half second derivative of the emission, steepest slopes of emission and extinction, and
/// a filler, where x is within `half` of `middle`.
#[inline(always)]
pub(super) fn slopes_near<L: Lanes>(
    l: L,
    brick: &PacketBrick<'_>,
    middle: L::Float,
    half: L::Float,
) -> [L::Float; 4] {
    let bends = &brick.table.bends;
    let mut scale = l.splat(Bends::REACHES[0].recip());
    let mut start = l.splat(Bends::NEAR_STARTS[0]);
    for n in 1..Bends::REACHES.len() {
        let fits = l.is_at_most(half, l.splat(Bends::REACHES[n]));
        scale = l.select(fits, l.splat(Bends::REACHES[n].recip()), scale);
        start = l.select(fits, l.splat(Bends::NEAR_STARTS[n]), start);
    }
    let place = l.max(l.floor(l.mul(middle, scale)), l.splat(-Bends::NEAR_BEFORE));
    let place = l.min(place, l.add(scale, l.splat(Bends::NEAR_AFTER)));
    let mut row = l.gather_row(&bends.near, l.index(l.add(start, place)));
    // Where no reach does, some row is looked up and not used.
    let fits = l.is_at_most(half, l.splat(Bends::REACHES[0]));
    for n in 0..3 {
        row[n] = l.select(fits, row[n], l.splat(bends.anywhere[n]));
    }
    row
}

/// Sums of kinks below the lower and above the upper of two x, within the brick's.
#[inline(always)]
pub(super) fn kinks_between<L: Lanes>(
    l: L,
    brick: &PacketBrick<'_>,
    [low, high]: [L::Float; 2],
) -> [[L::Float; 4]; 2] {
    let bends = &brick.table.bends;
    let mut low = l.gather_row(&bends.kinks, kink_place(l, low, 0.0));
    let mut high = l.gather_row(&bends.kinks, kink_place(l, high, 1.0));
    for n in 0..3 {
        low[n] = l.max(low[n], l.splat(brick.kinks[0][n]));
        high[n] = l.max(l.min(high[n], l.splat(brick.kinks[1][n])), low[n]);
    }
    [low, high]
}

/// What a part is off by along which x is `a` and `b` at the nodes and bends as `bend` says (see
/// [`crate::render::bounds::grade`]).
#[inline(always)]
pub(super) fn part_error<L: Lanes, const ABSORBS: bool>(
    l: L,
    brick: &PacketBrick<'_>,
    [a, b]: [L::Float; 2],
    bend: Bend<L>,
    depths: Depths<L>,
) -> PartError<L> {
    // The line through the nodes rises √3 times as far as between them.
    let (apart, off) = (distance(l, a, b), bend.distance(l));
    let rise = l.mul(apart, l.splat(1.733));
    let width = l.fma(off, l.splat(2.0), rise);
    let middle = l.mul(l.add(a, b), l.splat(0.5));
    let half = l.mul(width, l.splat(0.5));
    let [curved, slope, fade, _] =
        slopes_near(l, brick, middle, l.add(half, l.splat(brick.storage[0])));
    // Where x is no cubic nodes are off its mean by as much as it is off the line, and back.
    let mean = l.fma(bend.kink, l.splat(2.0), l.mul(bend.fourth, l.splat(1.0 / 180.0)));
    let odd = l.mul(bend.third, l.fma(bend.third, l.splat(0.0011), l.mul(width, l.splat(0.0112))));
    let even = l.fma(l.mul(bend.second, bend.second), l.splat(0.0056), odd);
    let smooth = l.mul(curved, l.fma(mean, l.add(width, bend.kink), even));
    let [low, high] = kinks_between(l, brick, [l.sub(middle, half), l.add(middle, half)]);
    let steps = [l.sub(high[0], low[0]), l.sub(high[1], low[1]), l.sub(high[2], low[2])];
    let [step_share, turn_share] = shares_of_steps(l, rise, bend);
    let stepped = l.fma(steps[0], step_share, l.mul(steps[2], turn_share));
    let emission = l.fma(mean, slope, l.add(smooth, stepped));
    let zero = l.splat(0.0);
    let error = PartError {
        emission,
        extinction: zero,
        most: zero,
        curved: zero,
        depth: zero,
        seen: PartValues { middle, half, off, rise },
        steepest: [slope, fade],
    };
    if !ABSORBS {
        return error;
    }
    let part = AbsorbingPart { width, mean, curved, steps, step_share, bend };
    part.error(l, &error, depths)
}

/// What is known of a part over which light is absorbed.
struct AbsorbingPart<L: Lanes> {
    /// The most that x ranges over.
    width: L::Float,
    /// How far the nodes' mean may be from that of x.
    mean: L::Float,
    /// Half the second derivative of the emission.
    curved: L::Float,
    /// Steps of the slopes of emission and extinction, and of half the emission's second derivative.
    steps: [L::Float; 3],
    /// What a unit step of a slope makes.
    step_share: L::Float,
    bend: Bend<L>,
}

impl<L: Lanes> AbsorbingPart<L> {
    /// What the part is off by, where without absorption that would be `error`.
    #[inline(always)]
    fn error(
        &self,
        l: L,
        error: &PartError<L>,
        Depths { thickness, mean: depth, extinction }: Depths<L>,
    ) -> PartError<L> {
        let (width, curved, bend) = (self.width, self.curved, self.bend);
        let [slope, fade] = error.steepest;
        let quarter = l.mul(width, l.splat(0.25));
        let mean = l.fma(self.mean, fade, l.mul(self.steps[1], self.step_share));
        let most = l.fma(error.seen.off, fade, l.mul(self.steps[1], quarter));
        // Extinction that is linear, and not negative, is at most 2.74 times its mean at the nodes;
        // and nowhere is x farther from that at a node than half the width.
        let leaning = l.mul(l.mul(fade, width), thickness);
        let straight = l.mul(l.fma(thickness, most, depth), l.splat(2.74));
        let depth = l.min(straight, l.fma(extinction, thickness, l.mul(leaning, l.splat(0.5))));
        // What cancels between the part's ends, or with what is linear, does so no better than the
        // transmittance is the same there; which leaves of a cubic x itself a share by nodes.
        let steps = l.fma(self.steps[2], width, self.steps[0]);
        let rise = l.mul(curved, width);
        let bent = l.mul(rise, l.mul(bend.second, l.splat(0.0112)));
        let cubic =
            l.fma(l.mul(depth, bend.second), l.splat(0.0028), l.mul(bend.third, l.splat(0.0056)));
        let coupled = l.fma(slope, cubic, l.fma(steps, quarter, bent));
        // Fourth derivatives, by those of the transmittance: of the emission itself, which rises by
        // no more than its slope says, of its slope, and of its own second derivative.
        let square = l.mul(depth, depth);
        let third = l.mul(depth, l.fma(leaning, l.splat(3.0), square));
        let sixth = l.add(square, l.mul(leaning, l.splat(6.0)));
        let fourth = l.fma(square, sixth, l.mul(l.mul(leaning, leaning), l.splat(3.0)));
        let rising = l.mul(l.mul(slope, width), l.fma(third, l.splat(4.0), fourth));
        let turning = l.mul(l.mul(rise, width), l.mul(l.add(square, leaning), l.splat(12.0)));
        let share = l.splat(1.0 / 4320.0);
        let all = l.fma(depth, coupled, l.fma(l.add(rising, turning), share, error.emission));
        // From the part's near end, not on average: e^depth up to 1 is at most 1 + 1.72·depth.
        let near = l.fma(depth, l.splat(1.72), l.splat(1.0));
        PartError {
            emission: l.mul(all, near),
            extinction: mean,
            most,
            curved: l.mul(l.mul(fourth, share), near),
            depth,
            seen: error.seen,
            steepest: error.steepest,
        }
    }
}

/// What two nodes make, at most, of a unit step of the slope, and of half the second derivative,
/// anywhere along a part where x bends about a line that rises so far: of the line's own; of what
/// x is off it on one side of the step; and of what lies on the other side than the line does.
/// Never more than x's distance from a chord.
#[inline(always)]
fn shares_of_steps<L: Lanes>(l: L, rise: L::Float, bend: Bend<L>) -> [L::Float; 2] {
    let (off, aside) = (bend.distance(l), bend.aside(l));
    let width = l.fma(off, l.splat(2.0), rise);
    let quarter = l.mul(width, l.splat(0.25));
    let crossed = l.div(off, l.max(rise, l.splat(f32::MIN_POSITIVE)));
    let astray = l.fma(off, l.min(crossed, l.splat(1.0)), aside);
    let kink = l.fma(rise, l.splat(0.0225), astray);
    let along = l.fma(rise, l.splat(0.0055), l.mul(aside, l.splat(1.6)));
    let turn = l.fma(rise, along, l.mul(off, off));
    [l.min(quarter, kink), l.min(l.mul(width, quarter), turn)]
}

/// Where x is among the sums of kinks, or what comes `after` it.
#[inline(always)]
fn kink_place<L: Lanes>(l: L, x: L::Float, after: f32) -> L::Index {
    let place = l.fma(x, l.splat(Bends::KINK_SCALE), l.splat(Bends::KINK_OFFSET));
    let place = l.min(l.max(place, l.splat(0.0)), l.splat(Bends::KINK_LAST));
    l.index(l.add(place, l.splat(after)))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::lanes::Portable;

    /// Gauss–Legendre nodes from −½ to ½.
    const NODE: f64 = 0.288_675_134_594_812_9;

    /// By how much the mean over −½ to ½ is missed by two nodes.
    fn missed(f: impl Fn(f64) -> f64) -> f64 {
        const COUNT: u32 = 4000;
        let places = (0..COUNT).map(|n| (f64::from(n) + 0.5) / f64::from(COUNT) - 0.5);
        let mean = places.map(&f).sum::<f64>() / f64::from(COUNT);
        (mean - 0.5 * (f(-NODE) + f(NODE))).abs()
    }

    fn coefficient() -> impl Strategy<Value = f64> {
        (prop::sample::select(vec![0.0, 0.01, 0.1, 1.0]), -1.0..1.0_f64).prop_map(|(a, b)| a * b)
    }

    fn row(x: f64) -> [f32; 8] {
        [x.abs() as f32; 8]
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 2000, ..ProptestConfig::default() })]

        #[test]
        fn steps_are_missed_by_no_more_than_their_shares(
            powers in prop::array::uniform4(coefficient()),
            place in prop_oneof![3 => -0.5..0.5_f64, 1 => Just(NODE), 1 => Just(0.5)],
        ) {
            let [a, e, o, f] = powers;
            let x = |s: f64| s * (a + s * (e + s * (o + s * f)));
            let step = x(place);
            let above = |s: f64| (x(s) - step).max(0.0);
            let l = Portable;
            let rise = 3.0_f64.sqrt() * (x(NODE) - x(-NODE)).abs();
            let bend = Bend { second: row(e), third: row(o), fourth: row(f), kink: row(0.0) };
            let [kink, turn] = shares_of_steps(l, row(1.0001 * rise), bend);
            let (kink, turn) = (f64::from(kink[0]), f64::from(turn[0]));
            prop_assert!(missed(above) <= 1.001 * kink + 1e-6, "{} {}", missed(above), kink);
            let square = |s: f64| above(s).powi(2);
            prop_assert!(missed(square) <= 1.001 * turn + 1e-6, "{} {}", missed(square), turn);
            // Where x is as good as straight shares are those of a straight line.
            let zero = row(0.0);
            let nearly = Bend { second: row(1e-3), third: zero, fourth: zero, kink: zero };
            let [alone, _] = shares_of_steps(l, row(1.0), nearly);
            prop_assert!(alone[0] < 0.023);
        }
    }
}
