//! The transfer function cut where its formula changes: what exact integration walks along.

use super::ray_error::Change;
use super::span_tree::SpanTree;
use crate::scene::TransferFunction;

/// Buckets of the look-up over [0, 1].
const BUCKETS: usize = 1024;
/// Entries of a named colour map, which bends at n / 255 without saying so.
const COLOR_MAP_ENTRIES: u32 = 256;
/// Differences below this share of what they are differences of are rounding.
const ROUNDING: f64 = 1e-13;

/// What happens at the start of a piece.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Step {
    /// By how much emission (any channel) and extinction step.
    pub(super) jump: Change,
    /// By how much their slopes do, or the bounds of these.
    pub(super) kink: Change,
    /// The larger half second derivative of the emission, of both sides.
    pub(super) bend: f64,
}

impl Step {
    pub(super) fn is_nothing(&self) -> bool {
        *self == Self::default()
    }

    fn between(before: &Piece, after: &Piece) -> Self {
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

/// An interval of x in which extinction is linear and emission quadratic.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Piece {
    /// The interval: start belongs to it, end to the next.
    pub(super) start: f64,
    pub(super) end: f64,
    /// Whether nothing is emitted or absorbed in it.
    pub(super) is_transparent: bool,
    /// Largest difference of any channel's emission to what the formulas below say, in radiance /
    /// code length: 0 but where entries of a colour map are taken together.
    pub(super) deviation: f64,
    /// Largest slope of any channel's emission inside, and of the extinction.
    pub(super) slope: [f64; 2],
    /// Largest |c2| of any channel's emission: half its second derivative.
    pub(super) bend: f64,
    /// Largest error of the emission that integration may make within the piece.
    pub(super) allowed: f64,
    /// How far the function steps, and its slopes, from the piece before.
    pub(super) step: Step,
    /// Where the formulas' own variable d = x − origin is 0.
    pub(super) origin: f64,
    /// κ = c0 + c1 d, 1 / code length.
    pub(super) extinction: [f64; 2],
    /// j = c0 + c1 d + c2 d² for R, G and B: `emission[power][channel]`, 1 / code length.
    pub(super) emission: [[f64; 3]; 3],
}

impl Piece {
    /// Extinction at `x`, 1 / code length, never below 0.
    #[inline]
    pub(super) fn extinction(&self, x: f64) -> f64 {
        (self.extinction[0] + self.extinction[1] * (x - self.origin)).max(0.0)
    }

    /// Emission at `x`, radiance / code length.
    #[inline]
    pub(super) fn emission(&self, x: f64) -> [f64; 3] {
        let d = x - self.origin;
        let [c0, c1, c2] = &self.emission;
        std::array::from_fn(|c| c0[c] + d * (c1[c] + d * c2[c]))
    }

    /// An upper bound of emission over extinction. Within a piece j is at most its largest value,
    /// and where κ and j vanish together their ratio is that of a quadratic and a linear function
    /// with a common root: bounded by the ratio of their steepest slopes.
    fn brightest(&self) -> f64 {
        if self.is_transparent {
            return 0.0;
        }
        let (left, right) = (self.start.max(0.0), self.end.clamp(0.0, 1.0));
        let most = |x: f64| self.emission(x).into_iter().fold(0.0, f64::max);
        let (k0, k1) = (self.extinction(left), self.extinction(right));
        let (j0, j1) = (most(left), most(right));
        let ratio = |j: f64, k: f64| if j == 0.0 { 0.0 } else { j / k };
        let slopes = self.slope[0] / self.slope[1];
        // From an end at which κ is least: j ≤ j0 + s·d and κ = k0 + t·d, so j / κ is at most the
        // larger of j0 / k0 and s / t.
        let from =
            |j: f64, k: f64| if j == 0.0 && k == 0.0 { slopes } else { ratio(j, k).max(slopes) };
        let bound = match k0.total_cmp(&k1) {
            std::cmp::Ordering::Less => from(j0, k0),
            std::cmp::Ordering::Greater => from(j1, k1),
            std::cmp::Ordering::Equal => ratio(j0 + self.slope[0] * (right - left), k0),
        };
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

    /// What the function does in the part of [low, high] that lies in the piece, which it reaches
    /// from below.
    fn over(&self, low: f64, high: f64) -> Span {
        let slope = Change { emission: self.slope[0], extinction: self.slope[1] };
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

    fn constant(start: f64, end: f64, (k, j): (f64, [f64; 3])) -> Self {
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
    fn emission_slope(&self, c: usize, x: f64) -> f64 {
        self.emission[1][c] + 2.0 * (x - self.origin) * self.emission[2][c]
    }

    /// The largest value that occurs in working out the emission within the piece, which its
    /// rounding is relative to.
    fn magnitude(&self) -> f64 {
        let width = if self.end.is_finite() { self.end - self.origin } else { 0.0 };
        let [c0, c1, c2] = &self.emission;
        (0..3)
            .map(|c| c0[c].abs() + width * (c1[c].abs() + width * c2[c].abs()))
            .fold(0.0, f64::max)
    }

    /// Fills in what follows from the formulas.
    fn with_slopes(mut self) -> Self {
        let steepest = |c: usize| {
            self.emission_slope(c, self.start).abs().max(self.emission_slope(c, self.end).abs())
        };
        self.slope = [(0..3).map(steepest).fold(0.0, f64::max), self.extinction[1].abs()];
        self.bend = self.emission[2].iter().fold(0.0, |most, c2| c2.abs().max(most));
        self
    }

    /// Largest difference of any channel's emission to that of `other`, a piece within this one.
    fn difference(&self, other: &Self) -> f64 {
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
    fn between(start: f64, end: f64, sample: &impl Fn(f64) -> (f64, [f64; 3])) -> Self {
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

/// What the transfer function does over a range of x.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Span {
    /// Steepest slopes.
    pub(super) slope: Change,
    /// Sum of changes but for steps, upward and downward ones all positive.
    pub(super) variation: Change,
    /// Sum of steps.
    pub(super) jumps: Change,
    /// Largest emission of any channel, and largest extinction.
    pub(super) most: Change,
}

impl Span {
    /// Of both ranges together, which meet.
    pub(super) fn and(self, other: Self) -> Self {
        Self {
            slope: self.slope.max(other.slope),
            variation: self.variation.plus(other.variation),
            jumps: self.jumps.plus(other.jumps),
            most: self.most.max(other.most),
        }
    }

    /// The larger of each.
    pub(super) fn max(self, other: Self) -> Self {
        Self {
            slope: self.slope.max(other.slope),
            variation: self.variation.max(other.variation),
            jumps: self.jumps.max(other.jumps),
            most: self.most.max(other.most),
        }
    }
}

/// How far the transfer function is from linear over a range of x.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Smoothness {
    /// Whether it steps.
    pub(super) steps: bool,
    /// Steepest slopes.
    pub(super) slope: Change,
    /// Sum of steps of the slopes.
    pub(super) kink: Change,
    /// Largest half second derivative of the emission.
    pub(super) bend: f64,
    /// Largest difference of emission to what the pieces say.
    pub(super) deviation: f64,
    /// Largest emission of any channel, and largest extinction.
    pub(super) most: Change,
    /// Least extinction.
    pub(super) least_extinction: f64,
}

/// Pieces over the whole axis of x; below 0 and from 1 on they are constant.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PieceList {
    pieces: Vec<Piece>,
    /// For each bucket the piece that holds its lower edge.
    first: Vec<u32>,
    /// What each piece does over all of it; of the outermost, which have no end, nothing.
    whole: SpanTree,
}

impl PieceList {
    fn new(cuts: &[f64], sample: &impl Fn(f64) -> (f64, [f64; 3])) -> Self {
        let mut pieces = vec![Piece::constant(f64::NEG_INFINITY, 0.0, sample(0.0))];
        pieces.extend(cuts.windows(2).map(|ends| Piece::between(ends[0], ends[1], sample)));
        pieces.push(Piece::constant(1.0, f64::INFINITY, sample(1.0)));
        Self::index(pieces)
    }

    fn index(mut pieces: Vec<Piece>) -> Self {
        for index in 1..pieces.len() {
            pieces[index].step = Step::between(&pieces[index - 1], &pieces[index]);
        }
        let first = (0..BUCKETS)
            .map(|bucket| bucket as f64 / BUCKETS as f64)
            .map(|edge| pieces.partition_point(|p| p.start <= edge).saturating_sub(1))
            .map(|index| u32::try_from(index).unwrap_or(u32::MAX))
            .collect();
        let whole = SpanTree::new(pieces.iter().map(|piece| {
            let has_ends = piece.start.is_finite() && piece.end.is_finite();
            if has_ends { piece.over(piece.start, piece.end) } else { Span::default() }
        }));
        Self { pieces, first, whole }
    }

    /// Takes neighbours together where one quadratic says their emission to within what
    /// `allowed` allows of the least extinction among them; never across `knots`.
    fn merged(
        &self,
        knots: &[f64],
        sample: &impl Fn(f64) -> (f64, [f64; 3]),
        allowed: impl Fn(f64) -> f64,
    ) -> Self {
        let inner = 1..self.pieces.len() - 1;
        let thinnest =
            |piece: &Piece| piece.extinction(piece.start).min(piece.extinction(piece.end));
        let (mut merged, mut next) = (vec![self.pieces[0].clone()], inner.start);
        while next < inner.end {
            let (mut best, mut last) = (self.pieces[next].clone(), next);
            while last + 1 < inner.end
                && knots.binary_search_by(|k| k.total_cmp(&best.end)).is_err()
            {
                let mut joined = Piece::between(best.start, self.pieces[last + 1].end, sample);
                let parts = &self.pieces[next..=last + 1];
                joined.deviation =
                    parts.iter().map(|part| joined.difference(part)).fold(0.0, f64::max);
                joined.is_transparent = parts.iter().all(|part| part.is_transparent);
                if joined.deviation.is_nan() || joined.deviation > allowed(thinnest(&joined)) {
                    break;
                }
                (best, last) = (joined, last + 1);
            }
            best.allowed = allowed(thinnest(&best));
            merged.push(best);
            next = last + 1;
        }
        merged.push(self.pieces[inner.end].clone());
        Self::index(merged)
    }

    /// What the function does over [low, high].
    pub(super) fn over(&self, low: f64, high: f64) -> Span {
        let (first, last) = (self.find(low), self.find(high).max(self.find(low)));
        let ends = Span { jumps: Change::default(), ..self.pieces[first].over(low, high) };
        if first == last {
            return ends;
        }
        ends.and(self.whole.over(first + 1, last)).and(self.pieces[last].over(low, high))
    }

    /// How smooth the function is over [low, high].
    pub(super) fn smoothness(&self, low: f64, high: f64) -> Smoothness {
        let Span { slope, jumps, most, .. } = self.over(low, high);
        let mut smoothness = Smoothness {
            slope,
            most,
            steps: jumps != Change::default(),
            least_extinction: f64::INFINITY,
            ..Smoothness::default()
        };
        let (first, last) = (self.find(low), self.find(high).max(self.find(low)));
        for (n, piece) in self.pieces[first..=last].iter().enumerate() {
            let ends = [low.max(piece.start), high.min(piece.end)];
            let least = piece.extinction(ends[0]).min(piece.extinction(ends[1]));
            smoothness.least_extinction = smoothness.least_extinction.min(least);
            smoothness.bend = smoothness.bend.max(piece.bend);
            smoothness.deviation = smoothness.deviation.max(piece.deviation);
            if n > 0 {
                smoothness.kink = smoothness.kink.plus(piece.step.kink);
            }
        }
        smoothness
    }

    /// Number of pieces.
    pub(super) fn count(&self) -> usize {
        self.pieces.len()
    }

    /// Piece number `index`.
    #[inline]
    pub(super) fn piece(&self, index: usize) -> &Piece {
        &self.pieces[index.min(self.pieces.len() - 1)]
    }

    /// The number of the piece that holds `x`; NaN counts as 0.
    #[inline]
    pub(super) fn find(&self, x: f64) -> usize {
        if x >= 1.0 {
            return self.pieces.len() - 1;
        }
        if x < 0.0 {
            return 0;
        }
        let bucket = ((x * BUCKETS as f64) as usize).min(BUCKETS - 1);
        let mut index = self.first[bucket] as usize;
        while self.pieces[index].end <= x {
            index += 1;
        }
        index
    }

    /// The piece that holds `x`.
    #[inline]
    pub(super) fn at(&self, x: f64) -> &Piece {
        self.piece(self.find(x))
    }
}

/// The transfer function, cut at all its bends and steps, and the same with entries of a colour
/// map taken together where that is close enough.
#[derive(Debug, Clone, PartialEq)]
pub struct TransferPieces {
    /// Cut at every bend.
    pub(super) all: PieceList,
    /// As few pieces as the allowed deviation needs.
    pub(super) merged: PieceList,
    largest_emission: f64,
    brightest: f64,
}

impl TransferPieces {
    /// Cuts `transfer` into its pieces, those of a named colour map included; `allowed` is the
    /// largest deviation of the emission where the extinction is at least what it is given.
    pub fn new(transfer: &TransferFunction, allowed: impl Fn(f64) -> f64) -> Self {
        let sample = |x: f64| (transfer.extinction(x), transfer.emission(x));
        let inside = |x: &f64| *x > 0.0 && *x < 1.0;
        let mut cuts = vec![0.0, 1.0];
        cuts.extend(transfer.knots().iter().copied().filter(inside));
        sort(&mut cuts);
        let mut all_cuts = cuts.clone();
        all_cuts.extend(
            (1..COLOR_MAP_ENTRIES - 1)
                .map(|n| f64::from(n) / f64::from(COLOR_MAP_ENTRIES - 1))
                .filter(|x| bends_at(*x, &cuts, &sample)),
        );
        sort(&mut all_cuts);
        let all = PieceList::new(&all_cuts, &sample);
        let merged = all.merged(&cuts, &sample, allowed);
        let brightest = all.pieces.iter().map(Piece::brightest).fold(0.0, f64::max);
        Self { all, merged, largest_emission: transfer.largest_emission(), brightest }
    }

    /// An upper bound of the emission of any channel, radiance / code length.
    pub fn largest_emission(&self) -> f64 {
        self.largest_emission
    }

    /// The largest emission over extinction: no light from behind is brighter, whatever the way
    /// it comes. Infinite where something emits that does not absorb.
    pub fn brightest(&self) -> f64 {
        self.brightest
    }
}

fn sort(cuts: &mut Vec<f64>) {
    cuts.sort_by(f64::total_cmp);
    cuts.dedup();
}

/// Whether the emission stops being one quadratic at `x`, a place between `cuts`.
fn bends_at(x: f64, cuts: &[f64], sample: &impl Fn(f64) -> (f64, [f64; 3])) -> bool {
    let next = cuts.partition_point(|cut| *cut <= x);
    let room = (x - cuts[next - 1]).min(cuts.get(next).map_or(1.0, |cut| cut - x));
    let h = (0.4 * room).min(0.25 / f64::from(COLOR_MAP_ENTRIES));
    let j = |n: f64| sample(x + n * h).1;
    let (before, at, after, beyond) = (j(-1.0), j(0.0), j(1.0), j(2.0));
    // The third difference of a quadratic vanishes.
    let third = |c: usize| beyond[c] - 3.0 * after[c] + 3.0 * at[c] - before[c];
    // That of values, and of x where they are steep.
    let rounding = |c: usize| {
        let values = before[c].abs().max(beyond[c].abs()).max(at[c].abs()).max(after[c].abs());
        ROUNDING * values + 16.0 * f64::EPSILON * (beyond[c] - before[c]).abs() / h
    };
    h > 0.0 && (0..3).any(|c| third(c).abs() > rounding(c))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::scene::{ColorMap, ColorTable, PiecewiseLinear};

    fn table(points: &[(f64, f64)]) -> PiecewiseLinear {
        PiecewiseLinear::new(&points.iter().map(|&(x, y)| (x, [y])).collect::<Vec<_>>()).unwrap()
    }

    fn function(color: &ColorTable) -> TransferFunction {
        let absorption = table(&[(0.1, 0.0), (0.3, 1e20), (0.3, 2.0), (0.9, 0.0)]);
        let emission = table(&[(0.25, 0.0), (0.25, 3.0), (0.7, 1.0), (1.5, 4.0)]);
        TransferFunction::from_tables(&absorption, &emission, color)
    }

    proptest! {
        #[test]
        fn pieces_are_the_function(random in -0.2..1.2_f64, near in 0..10usize) {
            let map = ColorTable::Map(ColorMap::named("inferno").unwrap());
            let transfer = function(&map);
            let pieces = TransferPieces::new(&transfer, |_| 1e-3);
            let knot = [0.1, 0.25, 0.3, 0.7, 0.9, 1.0, 0.0, 1.0 / 255.0, 128.0 / 255.0, 2.0][near];
            for x in [random, knot, knot.next_up()] {
                let (piece, cut) = (pieces.all.at(x), pieces.merged.at(x));
                let k = transfer.extinction(x);
                prop_assert!((piece.extinction(x) - k).abs() <= 1e-9 * k + 1e-12, "κ({x})");
                prop_assert!((cut.extinction(x) - k).abs() <= 1e-9 * k + 1e-12);
                for (found, expected) in piece.emission(x).iter().zip(transfer.emission(x)) {
                    prop_assert!((found - expected).abs() < 1e-9, "j({x}): {found} {expected}");
                }
                prop_assert!(cut.deviation <= 1e-3);
                for (found, expected) in cut.emission(x).iter().zip(transfer.emission(x)) {
                    prop_assert!((found - expected).abs() <= cut.deviation + 1e-9);
                    let bound = pieces.brightest() * k * (1.0 + 1e-9) + 1e-9;
                    prop_assert!(expected <= bound || bound.is_nan());
                }
                prop_assert_eq!(piece.is_transparent, transfer.is_transparent(
                    piece.start, piece.end.next_down().min(1.0).max(piece.start)));
            }
        }
    }

    #[test]
    fn entries_of_colour_maps_are_taken_together() {
        let list = [(0.0, [1.0, 0.0, 0.0]), (0.5, [0.0, 1.0, 0.5]), (1.0, [0.2, 0.2, 0.2])];
        let list = ColorTable::List(PiecewiseLinear::new(&list).unwrap());
        let list = TransferPieces::new(&function(&list), |_| 1e-3);
        assert_eq!(list.all.pieces.len(), list.merged.pieces.len());
        let map = function(&ColorTable::Map(ColorMap::named("viridis").unwrap()));
        let exact = TransferPieces::new(&map, |_| 0.0);
        assert!(exact.all.pieces.len() > 150 && exact.merged.pieces.len() > 150);
        assert!(TransferPieces::new(&map, |_| 1e-2).merged.pieces.len() < 40);
    }

    #[test]
    fn nothing_is_brighter_than_emission_over_extinction() {
        let white = ColorTable::List(PiecewiseLinear::new(&[(0.0, [1.0, 0.5, 0.0])]).unwrap());
        let bound = |absorption: &[(f64, f64)], emission: &[(f64, f64)]| {
            let (absorption, emission) = (table(absorption), table(emission));
            let transfer = TransferFunction::from_tables(&absorption, &emission, &white);
            TransferPieces::new(&transfer, |_| 0.0).brightest()
        };
        let ramp = [(0.0, 0.0), (1.0, 5.0)];
        assert!((bound(&ramp, &[(0.0, 0.0), (1.0, 15.0)]) - 3.0).abs() < 1e-12);
        assert_eq!(bound(&[(0.0, 0.0)], &ramp), f64::INFINITY);
        assert_eq!(bound(&ramp, &[(0.0, 1.0)]), f64::INFINITY);
        assert!((bound(&[(0.0, 2.0)], &ramp) - 2.5).abs() < 1e-12);
    }
}
