//! The transfer function cut where its formula changes: what exact integration walks along.

use crate::scene::TransferFunction;

/// Buckets of the look-up over [0, 1].
const BUCKETS: usize = 1024;
/// Entries of a named colour map, which bends at n / 255 without saying so.
const COLOR_MAP_ENTRIES: u32 = 256;
/// Differences of the emission below this share of its largest value are rounding.
const ROUNDING: f64 = 1e-13;

/// An interval of x in which extinction is linear and emission quadratic.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Piece {
    /// The interval: start belongs to it, end to the next.
    pub(super) start: f64,
    pub(super) end: f64,
    /// Whether nothing is emitted or absorbed in it.
    pub(super) is_transparent: bool,
    /// Whether the emission bends inside, so that `emission` is not what it is.
    pub(super) bends: bool,
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

    fn constant(start: f64, end: f64, (k, j): (f64, [f64; 3])) -> Self {
        Self {
            start,
            end,
            is_transparent: k == 0.0 && j == [0.0; 3],
            bends: false,
            origin: start.max(0.0),
            extinction: [k, 0.0],
            emission: [j, [0.0; 3], [0.0; 3]],
        }
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
            bends: false,
            origin: start,
            extinction: [k0, (k1 - k0) / (last - start)],
            emission: [j0, std::array::from_fn(linear), quadratic],
        }
    }
}

/// Pieces over the whole axis of x; below 0 and from 1 on they are constant.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PieceList {
    pieces: Vec<Piece>,
    /// For each bucket the piece that holds its lower edge.
    first: Vec<u32>,
}

impl PieceList {
    fn new(cuts: &[f64], sample: &impl Fn(f64) -> (f64, [f64; 3])) -> Self {
        let mut pieces = vec![Piece::constant(f64::NEG_INFINITY, 0.0, sample(0.0))];
        pieces.extend(cuts.windows(2).map(|ends| Piece::between(ends[0], ends[1], sample)));
        pieces.push(Piece::constant(1.0, f64::INFINITY, sample(1.0)));
        let first = (0..BUCKETS)
            .map(|bucket| bucket as f64 / BUCKETS as f64)
            .map(|edge| pieces.partition_point(|p| p.start <= edge).saturating_sub(1))
            .map(|index| u32::try_from(index).unwrap_or(u32::MAX))
            .collect();
        Self { pieces, first }
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

/// The transfer function, cut at all its bends and steps, and at those of a colour map's entries
/// apart from the rest.
#[derive(Debug, Clone, PartialEq)]
pub struct TransferPieces {
    /// Cut at every bend.
    pub(super) all: PieceList,
    /// Cut at the scene's own knots alone: what pieces say of emission is true only if their
    /// emission does not bend.
    pub(super) knots: PieceList,
    largest_emission: f64,
}

impl TransferPieces {
    /// Cuts `transfer` into its pieces, those of a named colour map included.
    pub fn new(transfer: &TransferFunction) -> Self {
        let sample = |x: f64| (transfer.extinction(x), transfer.emission(x));
        let inside = |x: &f64| *x > 0.0 && *x < 1.0;
        let mut cuts = vec![0.0, 1.0];
        cuts.extend(transfer.knots().iter().copied().filter(inside));
        sort(&mut cuts);
        let mut all_cuts = cuts.clone();
        all_cuts.extend(
            (1..COLOR_MAP_ENTRIES - 1)
                .map(|n| f64::from(n) / f64::from(COLOR_MAP_ENTRIES - 1))
                .filter(|x| bends_at(*x, &cuts, &sample, transfer.largest_emission())),
        );
        sort(&mut all_cuts);
        let mut knots = PieceList::new(&cuts, &sample);
        for piece in &mut knots.pieces {
            let next = all_cuts.partition_point(|cut| *cut <= piece.start);
            piece.bends = all_cuts.get(next).is_some_and(|cut| *cut < piece.end && *cut > 0.0);
            // Emission may vanish at the ends and in the middle of a piece that bends.
            piece.is_transparent &= transfer
                .is_transparent(piece.start, piece.end.min(1.0).next_down().max(piece.start));
        }
        let all = PieceList::new(&all_cuts, &sample);
        Self { all, knots, largest_emission: transfer.largest_emission() }
    }

    /// An upper bound of the emission of any channel, radiance / code length.
    pub fn largest_emission(&self) -> f64 {
        self.largest_emission
    }
}

fn sort(cuts: &mut Vec<f64>) {
    cuts.sort_by(f64::total_cmp);
    cuts.dedup();
}

/// Whether the emission stops being one quadratic at `x`, a place between `cuts`.
fn bends_at(x: f64, cuts: &[f64], sample: &impl Fn(f64) -> (f64, [f64; 3]), largest: f64) -> bool {
    let next = cuts.partition_point(|cut| *cut <= x);
    let room = (x - cuts[next - 1]).min(cuts.get(next).map_or(1.0, |cut| cut - x));
    let h = (0.4 * room).min(0.25 / f64::from(COLOR_MAP_ENTRIES));
    let j = |n: f64| sample(x + n * h).1;
    let (before, at, after, beyond) = (j(-1.0), j(0.0), j(1.0), j(2.0));
    // The third difference of a quadratic vanishes.
    let third = |c: usize| beyond[c] - 3.0 * after[c] + 3.0 * at[c] - before[c];
    h > 0.0 && (0..3).any(|c| third(c).abs() > ROUNDING * largest)
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
            let pieces = TransferPieces::new(&transfer);
            let knot = [0.1, 0.25, 0.3, 0.7, 0.9, 1.0, 0.0, 1.0 / 255.0, 128.0 / 255.0, 2.0][near];
            for x in [random, knot, knot.next_up()] {
                let (piece, cut) = (pieces.all.at(x), pieces.knots.at(x));
                let k = transfer.extinction(x);
                prop_assert!((piece.extinction(x) - k).abs() <= 1e-9 * k + 1e-12, "κ({x})");
                prop_assert!((cut.extinction(x) - k).abs() <= 1e-9 * k + 1e-12);
                for (found, expected) in piece.emission(x).iter().zip(transfer.emission(x)) {
                    prop_assert!((found - expected).abs() < 1e-9, "j({x}): {found} {expected}");
                }
                prop_assert_eq!(piece.is_transparent, transfer.is_transparent(
                    piece.start, piece.end.next_down().min(1.0).max(piece.start)));
            }
        }
    }

    #[test]
    fn only_colour_maps_bend_unannounced() {
        let list = [(0.0, [1.0, 0.0, 0.0]), (0.5, [0.0, 1.0, 0.5]), (1.0, [0.2, 0.2, 0.2])];
        let list =
            TransferPieces::new(&function(&ColorTable::List(PiecewiseLinear::new(&list).unwrap())));
        assert_eq!(list.all, list.knots);
        let map = ColorTable::Map(ColorMap::named("viridis").unwrap());
        let map = TransferPieces::new(&function(&map));
        assert!(map.all.pieces.len() > 150);
        assert!(map.knots.at(0.5).bends && !map.all.at(0.5).bends);
    }
}
