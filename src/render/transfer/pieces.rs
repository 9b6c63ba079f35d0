//! The transfer function cut where its formula changes: what exact integration walks along.

use super::change::Change;
use super::piece::{Piece, Step};
use super::run_tree::{Run, RunTree};
use super::span::{Smoothness, Span};
use crate::scene::TransferFunction;

/// Buckets of the look-up over [0, 1].
const BUCKETS: usize = 1024;
/// Entries of a named colour map, which bends at n / 255 without saying so.
const COLOR_MAP_ENTRIES: u32 = 256;
/// Differences below this share of what they are differences of are rounding.
pub(super) const ROUNDING: f64 = 1e-13;

/// Pieces over the whole axis of x; below 0 and from 1 on they are constant.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PieceList {
    pieces: Vec<Piece>,
    /// For each bucket the piece that holds its lower edge.
    first: Vec<u32>,
    /// What each piece does over all of it; of the outermost, which have no end, nothing.
    whole: RunTree<Span>,
}

impl PieceList {
    /// Bytes that a list of `count` pieces takes, at most: vectors are grown to twice what they hold.
    fn bytes(count: usize) -> u64 {
        let each = 2 * size_of::<Piece>() + 2 * size_of::<Span>();
        (count * each + BUCKETS * size_of::<u32>()) as u64
    }

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
        let whole = RunTree::new(pieces.iter().map(|piece| {
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
    pub(crate) fn over(&self, low: f64, high: f64) -> Span {
        let (first, last) = (self.find(low), self.find(high).max(self.find(low)));
        let ends = Span { jumps: Change::default(), ..self.pieces[first].over(low, high) };
        if first == last {
            return ends;
        }
        ends.and(self.whole.over(first + 1, last)).and(self.pieces[last].over(low, high))
    }

    /// How smooth the function is over [low, high].
    pub(crate) fn smoothness(&self, low: f64, high: f64) -> Smoothness {
        let Span { slope, jumps, most, .. } = self.over(low, high);
        let mut smoothness = Smoothness {
            slope,
            most,
            steps: jumps != Change::default(),
            least_extinction: f64::INFINITY,
            ..Smoothness::default()
        };
        let (first, last) = (self.find(low), self.find(high).max(self.find(low)));
        for piece in &self.pieces[first..=last] {
            let ends = [low.max(piece.start), high.min(piece.end)];
            let least = piece.extinction(ends[0]).min(piece.extinction(ends[1]));
            smoothness.least_extinction = smoothness.least_extinction.min(least);
            smoothness.bend = smoothness.bend.max(piece.bend);
            smoothness.deviation = smoothness.deviation.max(piece.deviation);
        }
        smoothness
    }

    /// What packets take emission and extinction relative to: the largest of each, or 1 where that
    /// is nothing.
    pub(crate) fn scales(&self) -> [f64; 2] {
        let most = self.over(0.0, 1.0).most;
        let relative_to = |most: f64| if most > 0.0 && most.is_finite() { most } else { 1.0 };
        [relative_to(most.emission), relative_to(most.extinction)]
    }

    /// Number of pieces.
    pub(super) fn count(&self) -> usize {
        self.pieces.len()
    }

    /// Piece number `index`.
    #[inline]
    pub(crate) fn piece(&self, index: usize) -> &Piece {
        &self.pieces[index.min(self.pieces.len() - 1)]
    }

    /// The number of the piece that holds `x`; NaN counts as 0.
    #[inline]
    pub(crate) fn find(&self, x: f64) -> usize {
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
    pub(crate) fn at(&self, x: f64) -> &Piece {
        self.piece(self.find(x))
    }
}

/// The transfer function, cut at all its bends and steps, and the same with entries of a colour
/// map taken together where that is close enough.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct TransferPieces {
    /// Cut at every bend.
    pub(crate) all: PieceList,
    /// The same function in as few pieces as the allowed deviation of its emission needs.
    pub(crate) merged: PieceList,
    largest_emission: f64,
    brightest: f64,
}

impl TransferPieces {
    /// Bytes that a function with so many [`TransferFunction::knots`] takes in pieces, at most.
    pub(crate) fn bytes(knots: usize) -> u64 {
        2 * PieceList::bytes(Self::most(knots))
    }

    /// Pieces of a function with so many knots, at most: between these and entries of a colour map,
    /// and beyond both ends.
    pub(super) fn most(knots: usize) -> usize {
        knots + COLOR_MAP_ENTRIES as usize + 3
    }

    /// Cuts `transfer` into its pieces, those of a named colour map included; `allowed` is the
    /// largest deviation of the emission where the extinction is at least what it is given.
    pub(crate) fn new(transfer: &TransferFunction, allowed: impl Fn(f64) -> f64) -> Self {
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
        let vanishes = |x: f64| sample(x) == (0.0, [0.0; 3]);
        let brightest = all.pieces.iter().map(|piece| piece.brightest(vanishes));
        let brightest = brightest.fold(0.0, f64::max);
        Self { all, merged, largest_emission: transfer.largest_emission(), brightest }
    }

    /// An upper bound of the emission of any channel, radiance / code length.
    pub(crate) fn largest_emission(&self) -> f64 {
        self.largest_emission
    }

    /// The largest emission over extinction: no light from behind is brighter, whatever the way
    /// it comes. Infinite where something emits that does not absorb.
    pub(crate) fn brightest(&self) -> f64 {
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
        fn nothing_is_brighter_than_the_brightest(x in -0.2..1.2_f64) {
            let emission = table(&[(0.25, 0.0), (0.25, 3.0), (0.7, 1.0), (1.5, 4.0)]);
            let map = ColorTable::Map(ColorMap::named("inferno").unwrap());
            let of = |absorption| TransferFunction::from_tables(&absorption, &emission, &map);
            let transfer = of(table(&[(0.1, 0.2), (0.3, 50.0), (0.3, 2.0), (0.9, 0.5)]));
            let brightest = TransferPieces::new(&transfer, |_| 1e-3).brightest();
            let k = transfer.extinction(x);
            for emitted in transfer.emission(x) {
                prop_assert!(emitted <= brightest * k * (1.0 + 1e-9) + 1e-9, "{brightest} {emitted}");
            }
            // No light is brighter than 4/0.5 there, and what nothing absorbs knows no limit.
            prop_assert!(brightest < 8.1);
            let clear = of(table(&[(0.3, 2.0), (0.9, 0.0)]));
            prop_assert!(TransferPieces::new(&clear, |_| 1e-3).brightest() == f64::INFINITY);
        }

        #[test]
        fn pieces_are_the_function(random in -0.2..1.2_f64, near in 0..10usize) {
            let map = ColorTable::Map(ColorMap::named("inferno").unwrap());
            let transfer = function(&map);
            let pieces = TransferPieces::new(&transfer, |_| 1e-3);
            let most = TransferPieces::most(transfer.knots().len());
            prop_assert!(pieces.all.count() <= most && most < 2 * pieces.all.count());
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
                }
                prop_assert_eq!(piece.is_transparent, transfer.is_transparent(
                    piece.start, piece.end.next_down().min(1.0).max(piece.start)));
            }
        }
    }

    #[test]
    fn functions_are_even_that_have_neither_steps_nor_peaks() {
        let white = ColorTable::List(PiecewiseLinear::new(&[(0.0, [1.0; 3])]).unwrap());
        let is_even = |absorption: &[(f64, f64)]| {
            let ramp = table(&[(0.0, 0.0), (1.0, 5.0)]);
            let transfer = TransferFunction::from_tables(&table(absorption), &ramp, &white);
            TransferPieces::new(&transfer, |_| 0.0).all.over(0.2, 0.8).is_even(0.6)
        };
        assert!(is_even(&[(0.0, 1.0), (1.0, 5.0)]) && is_even(&[(0.0, 2.0)]));
        assert!(is_even(&[(0.0, 0.0), (0.5, 1.0), (1.0, 4.0)]));
        assert!(!is_even(&[(0.5, 0.0), (0.5, 3.0)]));
        assert!(!is_even(&[(0.45, 0.0), (0.5, 3.0), (0.55, 0.0)]));
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
        // Little beside what the rest is, and not nothing.
        let bright = bound(&[(0.0, 1e10), (1.0, 1e30)], &[(0.0, 1e11), (1.0, 1e30)]);
        assert!(bright >= 10.0, "{bright}");
        // Emission is as much as absorption, and no colour more than 1, whatever rounding makes of
        // a constant.
        let map = ColorTable::Map(ColorMap::named("viridis").unwrap());
        let steep = [(0.3, 0.0), (0.3, 100.0)];
        for points in [&steep[..], &[(0.3, 0.0), (0.5, 3.0), (1.0, 20.0)]] {
            let transfer = TransferFunction::from_tables(&table(points), &table(points), &map);
            let brightest = TransferPieces::new(&transfer, |_| 0.0).brightest();
            assert!(brightest > 0.9 && brightest < 1.3, "{brightest}");
        }
    }

    /// Where formulas leave something of what is 0 at a shell's sides, that is rounding.
    #[test]
    fn shells_are_no_brighter_than_their_colour() {
        let map = ColorTable::Map(ColorMap::named("magma").unwrap());
        for n in 0..300 {
            let n = f64::from(n);
            let (start, half) = (0.05 + 0.002_713 * n, 0.004 + 0.000_117 * n);
            let height = 10_f64.powf(0.1 * n - 10.0);
            let shell = [(start, 0.0), (start + half, height), (start + 2.0 * half, 0.0)];
            let transfer = TransferFunction::from_tables(&table(&shell), &table(&shell), &map);
            let brightest = TransferPieces::new(&transfer, |_| 0.0).brightest();
            assert!(brightest > 0.0 && brightest < 1.3, "{n}: {brightest}");
        }
    }
}
