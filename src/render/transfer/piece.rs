//! A piece of the transfer function, with one formula, and what happens between two.

use super::change::Change;
use super::pieces::ROUNDING;
use super::span::Span;

/// What happens at the start of a piece.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Step {
    /// By how much emission (any channel) and extinction step.
    pub(crate) jump: Change,
    /// By how much their slopes do, or the bounds of these.
    pub(crate) kink: Change,
    /// The larger half second derivative of the emission, of both sides.
    pub(crate) bend: f64,
}

impl Step {
    /// Whether neither values nor slopes step, and emission is straight on both sides.
    pub(crate) fn is_nothing(&self) -> bool {
        *self == Self::default()
    }

    /// What happens where `after` begins and `before` ends.
    pub(super) fn between(before: &Piece, after: &Piece) -> Self {
        let x = after.start;
        let largest = before.magnitude().max(after.magnitude());
        let (a, b) = (before.emission(x), after.emission(x));
        let most = |change: &dyn Fn(usize) -> f64| (0..3).map(change).fold(0.0, f64::max);
        let emission = most(&|c| (a[c] - b[c]).abs());
        let extinction = (before.extinction(x) - after.extinction(x)).abs();
        let kink = after.kink_from(before);
        let steeper = |n: usize| (before.slope[n] - after.slope[n]).abs();
        // Rounding of formulas that meet is no step.
        let rounded = |step: f64, scale: f64| if step <= ROUNDING * scale { 0.0 } else { step };
        Self {
            jump: Change {
                emission: rounded(emission, largest),
                extinction: rounded(extinction, before.extinction(x) + after.extinction(x)),
            },
            kink: Change {
                emission: kink.emission.max(steeper(0)),
                extinction: kink.extinction.max(steeper(1)),
            },
            bend: before.bend.max(after.bend),
        }
    }
}

/// What is so small a part of a piece's largest value may be rounding of 0.
const VANISHES: f64 = 1e-14;

/// An interval of x in which extinction is linear and emission quadratic.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Piece {
    /// Where the interval begins; the place belongs to it.
    pub(crate) start: f64,
    /// Where it ends; the place belongs to the next piece.
    pub(crate) end: f64,
    /// Whether nothing is emitted or absorbed in it.
    pub(crate) is_transparent: bool,
    /// Largest difference of any channel's emission to what the formulas below say, in radiance /
    /// code length: 0 but where entries of a colour map are taken together.
    pub(crate) deviation: f64,
    /// Largest slope of any channel's emission inside, and of the extinction.
    pub(crate) slope: [f64; 2],
    /// Largest |c2| of any channel's emission: half its second derivative.
    pub(crate) bend: f64,
    /// Largest error of the emission that integration may make within the piece.
    pub(crate) allowed: f64,
    /// How far the function steps, and its slopes, from the piece before.
    pub(crate) step: Step,
    /// Where the formulas' own variable d = x − origin is 0.
    pub(crate) origin: f64,
    /// κ = c0 + c1 d, 1 / code length.
    pub(crate) extinction: [f64; 2],
    /// j = c0 + c1 d + c2 d² for R, G and B: `emission[power][channel]`, 1 / code length.
    pub(crate) emission: [[f64; 3]; 3],
}

impl Piece {
    /// Extinction at `x`, 1 / code length, never below 0.
    #[inline]
    pub(crate) fn extinction(&self, x: f64) -> f64 {
        (self.extinction[0] + self.extinction[1] * (x - self.origin)).max(0.0)
    }

    /// Emission at `x`, radiance / code length.
    #[inline]
    pub(crate) fn emission(&self, x: f64) -> [f64; 3] {
        let d = x - self.origin;
        let [c0, c1, c2] = &self.emission;
        std::array::from_fn(|c| c0[c] + d * (c1[c] + d * c2[c]))
    }

    /// An upper bound of emission over extinction. Within a piece j is at most its largest value,
    /// and where κ and j vanish together their ratio is that of a quadratic and a linear function
    /// with a common root: bounded by the ratio of their steepest slopes. Where κ is constant but for
    /// rounding, that says nothing; and where the function `vanishes`, what its formulas leave by
    /// rounding is nothing.
    pub(super) fn brightest(&self, vanishes: impl Fn(f64) -> bool) -> f64 {
        if self.is_transparent {
            return 0.0;
        }
        let (left, right) = (self.start.max(0.0), self.end.clamp(0.0, 1.0));
        let at = |x: f64| (self.extinction(x), self.emission(x).into_iter().fold(0.0, f64::max));
        let (a, b) = (at(left), at(right));
        let largest = (f64::max(a.0, b.0), f64::max(a.1, b.1));
        let is_rounding =
            |(k, j): (f64, f64)| k <= VANISHES * largest.0 && j <= VANISHES * largest.1;
        let or_nothing = |x: f64, at| if vanishes(x) && is_rounding(at) { (0.0, 0.0) } else { at };
        let ((k0, j0), (k1, j1)) = (or_nothing(left, a), or_nothing(right, b));
        let ratio = |j: f64, k: f64| if j == 0.0 { 0.0 } else { j / k };
        let slopes = self.slope[0] / self.slope[1];
        // From an end at which κ is least: j ≤ j0 + s·d and κ = k0 + t·d, so j / κ is at most the
        // larger of j0 / k0 and s / t.
        let from =
            |j: f64, k: f64| if j == 0.0 && k == 0.0 { slopes } else { ratio(j, k).max(slopes) };
        let bound = match k0.total_cmp(&k1) {
            std::cmp::Ordering::Less => from(j0, k0),
            std::cmp::Ordering::Greater => from(j1, k1),
            std::cmp::Ordering::Equal => f64::INFINITY,
        };
        let bound = bound.min(ratio(j0 + self.slope[0] * (right - left), k0.min(k1)));
        if bound.is_nan() { f64::INFINITY } else { bound }
    }

    /// By how much slopes step from the piece before: of emission (any channel), extinction.
    pub(super) fn kink_from(&self, before: &Self) -> Change {
        let x = self.start;
        let kink = |c| (before.emission_slope(c, x) - self.emission_slope(c, x)).abs();
        Change {
            emission: (0..3).map(kink).fold(0.0, f64::max),
            extinction: (before.extinction[1] - self.extinction[1]).abs(),
        }
    }

    /// By how much half the second derivative of the emission (any channel) steps from the piece
    /// before.
    pub(super) fn bend_from(&self, before: &Self) -> f64 {
        let step = |c: usize| (before.emission[2][c] - self.emission[2][c]).abs();
        (0..3).map(step).fold(0.0, f64::max)
    }

    /// Its steepest slope.
    pub(crate) fn steepest(&self) -> Change {
        Change { emission: self.slope[0], extinction: self.slope[1] }
    }

    /// What the function does in the part of [low, high] that lies in the piece, which it reaches
    /// from below.
    pub(super) fn over(&self, low: f64, high: f64) -> Span {
        let slope = self.steepest();
        let (left, right) = (low.max(self.start), high.min(self.end));
        let width = (right - left).max(0.0);
        let most = |x: f64| self.emission(x).into_iter().fold(0.0, f64::max);
        // A quadratic exceeds its ends by at most a quarter of bend · width².
        let bulge = 0.25 * self.bend * width * width;
        Span {
            slope,
            variation: slope.times(width),
            jumps: self.step.jump,
            most: Change {
                emission: most(left).max(most(right)) + bulge + self.deviation,
                extinction: self.extinction(left).max(self.extinction(right)),
            },
        }
    }

    /// A piece from `start` to `end` along which extinction is `k` and emission `j`.
    pub(super) fn constant(start: f64, end: f64, (k, j): (f64, [f64; 3])) -> Self {
        Self {
            start,
            end,
            is_transparent: k == 0.0 && j == [0.0; 3],
            deviation: 0.0,
            slope: [0.0; 2],
            bend: 0.0,
            allowed: 0.0,
            step: Step::default(),
            origin: start.max(0.0),
            extinction: [k, 0.0],
            emission: [j, [0.0; 3], [0.0; 3]],
        }
    }

    /// Slope of emission channel `c` at `x`.
    pub(super) fn emission_slope(&self, c: usize, x: f64) -> f64 {
        self.emission[1][c] + 2.0 * (x - self.origin) * self.emission[2][c]
    }

    /// The largest value that occurs in working out the emission within the piece, which its
    /// rounding is relative to.
    pub(super) fn magnitude(&self) -> f64 {
        let width = if self.end.is_finite() { self.end - self.origin } else { 0.0 };
        let [c0, c1, c2] = &self.emission;
        (0..3)
            .map(|c| c0[c].abs() + width * (c1[c].abs() + width * c2[c].abs()))
            .fold(0.0, f64::max)
    }

    /// Fills in what follows from the formulas.
    pub(super) fn with_slopes(mut self) -> Self {
        let steepest = |c: usize| {
            self.emission_slope(c, self.start).abs().max(self.emission_slope(c, self.end).abs())
        };
        self.slope = [(0..3).map(steepest).fold(0.0, f64::max), self.extinction[1].abs()];
        self.bend = self.emission[2].iter().fold(0.0, |most, c2| c2.abs().max(most));
        self
    }

    /// Largest difference of any channel's emission to that of `other`, a piece within this one.
    pub(super) fn difference(&self, other: &Self) -> f64 {
        let at = |x: f64| {
            let (a, b) = (self.emission(x), other.emission(x));
            (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f64::max)
        };
        let vertex = |c: usize| {
            let slope = |x: f64| self.emission_slope(c, x) - other.emission_slope(c, x);
            let (left, right) = (slope(other.start), slope(other.end));
            let t = if left == right { 0.5 } else { (left / (left - right)).clamp(0.0, 1.0) };
            other.start + t * (other.end - other.start)
        };
        let inside = (0..3).map(|c| at(vertex(c))).fold(0.0, f64::max);
        inside.max(at(other.start)).max(at(other.end))
    }

    /// The piece through the function's values at both ends and in the middle.
    pub(super) fn between(start: f64, end: f64, sample: &impl Fn(f64) -> (f64, [f64; 3])) -> Self {
        // The last place before the end: far from it in a piece of a few floats.
        let last = end.next_down();
        let middle = 0.5 * (start + last);
        if !(middle > start && middle < last) {
            return Self::constant(start, end, sample(start));
        }
        let ((k0, j0), (_, jm), (k1, j1)) = (sample(start), sample(middle), sample(last));
        let (left, right) = (middle - start, last - middle);
        let bend = |c: usize| ((j1[c] - jm[c]) / right - (jm[c] - j0[c]) / left) / (last - start);
        let quadratic: [f64; 3] = std::array::from_fn(bend);
        let linear = |c: usize| (jm[c] - j0[c]) / left - quadratic[c] * left;
        Self {
            start,
            end,
            is_transparent: [k0, k1] == [0.0; 2] && [j0, jm, j1] == [[0.0; 3]; 3],
            deviation: 0.0,
            slope: [0.0; 2],
            bend: 0.0,
            allowed: 0.0,
            step: Step::default(),
            origin: start,
            extinction: [k0, (k1 - k0) / (last - start)],
            emission: [j0, std::array::from_fn(linear), quadratic],
        }
        .with_slopes()
    }
}
