//! The transfer function as a table of straight lines, with a corner in each if there is one: what
//! packets of rays look up.

use super::piece::Piece;
use super::pieces::{PieceList, TransferPieces};
use super::rounded::up;
use super::run_tree::{Run, RunTree};
use super::span::Smoothness;

/// Bins over [0, 1]; one more for what lies beyond. A multiple of 255, so that kinks of named colour
/// maps, of 256 entries, and of points with few decimals are where bins begin.
const BINS: usize = 16 * 255;
/// The corner of a bin that has none: beyond its end.
const NO_CORNER: f32 = 2.0;

/// Emission (R, G, B) and extinction over x, each relative to its largest value, in bins of equal
/// width: in each a straight line, or two that meet at a corner.
#[derive(Debug)]
pub(crate) struct TransferTable {
    /// Where each bin's corner is, of its width.
    pub(crate) corners: Vec<f32>,
    /// The first line of each bin: channel by channel at its start, where none is negative, and by
    /// how much they rise over it. The sign of the extinction at its start says whether there is a
    /// corner.
    pub(crate) lines: Vec<[f32; 8]>,
    /// The line behind the corner, or the first again.
    pub(crate) behind: Vec<[f32; 8]>,
    /// What emission is relative to, radiance / code length.
    pub(crate) emission: f64,
    /// What extinction is relative to, 1 / code length; 0 where nothing absorbs.
    pub(crate) extinction: f64,
    /// Largest difference of emission (any channel) and extinction to the lines', in absolute
    /// units, for each bin.
    deviation: RunTree<Deviation>,
    /// How the function bends, relative likewise.
    pub(crate) bends: Bends,
}

/// How far from linear the transfer function is over ranges of x, as packets look it up.
#[derive(Debug)]
pub(crate) struct Bends {
    /// Sums of steps of the slopes of emission and extinction, and of half the second derivative of
    /// the emission, below [`Bends::KINK_SCALE`]'s places, and a filler.
    pub(crate) kinks: Vec<[f32; 4]>,
    /// Where these steps are, and the sums behind each.
    steps: Vec<(f64, [f32; 4])>,
    /// Largest half second derivative of the emission, steepest slopes of emission and extinction,
    /// and a filler, within each of [`Bends::REACHES`] of places as far apart.
    pub(crate) near: Vec<[f32; 4]>,
    /// The same four numbers over all of [0, 1].
    pub(crate) anywhere: [f32; 4],
}

/// Parts of [0, 1] in which kinks are summed.
const KINK_PARTS: usize = 4096;

/// Rows of slopes within a reach of places from two before 0 to one behind 1.
const fn near_count(reach: f32) -> usize {
    (1.0 / reach) as usize + 4
}

const fn near_starts() -> [f32; 5] {
    let (mut starts, mut row, mut n) = ([0.0; 5], 0, 0);
    while n < starts.len() {
        starts[n] = row as f32 + Bends::NEAR_BEFORE;
        row += near_count(Bends::REACHES[n]);
        n += 1;
    }
    starts
}

impl Bends {
    /// Places of [`Bends::kinks`] to a unit of x: x has place `KINK_SCALE`·x + `KINK_OFFSET`, held
    /// to 0 and `KINK_LAST`. What lies between two x comes between the sum at the lower one's
    /// place, rounded down, and that after the upper one's.
    pub(crate) const KINK_SCALE: f32 = KINK_PARTS as f32;
    /// The place of x = 0 in [`Bends::kinks`].
    pub(crate) const KINK_OFFSET: f32 = 1.0;
    /// The last place in [`Bends::kinks`] that has one after it.
    pub(crate) const KINK_LAST: f32 = KINK_PARTS as f32 + 2.0;
    /// How far from x slopes are looked at, farthest first.
    pub(crate) const REACHES: [f32; 5] =
        [1.0 / 2.0, 1.0 / 8.0, 1.0 / 32.0, 1.0 / 128.0, 1.0 / 512.0];
    /// Where the rows of each reach begin: x is found x / reach behind that, rounded down, not
    /// before the row `NEAR_BEFORE` and not after the one `NEAR_AFTER` 1 / reach.
    pub(crate) const NEAR_STARTS: [f32; 5] = near_starts();
    /// Rows of each reach before that of x = 0.
    pub(crate) const NEAR_BEFORE: f32 = 2.0;
    /// Rows of each reach behind that of x = 1.
    pub(crate) const NEAR_AFTER: f32 = 1.0;

    /// How the function of `pieces` bends, relative to the scales of emission and extinction.
    fn new(pieces: &PieceList, scales: [f64; 2]) -> Self {
        let (mut sums, mut steps) = ([0.0_f32; 4], Vec::with_capacity(pieces.count()));
        for next in 1..pieces.count() {
            let (piece, before) = (pieces.piece(next), pieces.piece(next - 1));
            let kink = piece.kink_from(before);
            let added = [kink.emission / scales[0], kink.extinction / scales[1]];
            let added = [added[0], added[1], piece.bend_from(before) / scales[0]];
            for (sum, added) in sums.iter_mut().zip(added).filter(|(_, added)| *added > 0.0) {
                // Rounded up, so that no difference of sums is too small.
                *sum = up(f64::from(*sum) + added);
            }
            steps.push((piece.start, sums));
        }
        let below = |place: usize| {
            let x = (place as f64 - 1.0) / KINK_PARTS as f64;
            sum_of(&steps, |start| start < x)
        };
        let kinks = (0..KINK_PARTS + 4).map(below).collect();
        let near = |reach: f32, place: usize| {
            let reach = f64::from(reach);
            let x = (place as f64 - f64::from(Self::NEAR_BEFORE)) * reach;
            let beyond = reach + 1e-6;
            pieces.smoothness(x - beyond, x + reach + beyond)
        };
        let row = |Smoothness { bend, slope, .. }: Smoothness| {
            let values =
                [bend / scales[0], slope.emission / scales[0], slope.extinction / scales[1]];
            let [bend, emission, extinction] = values.map(up);
            [bend, emission, extinction, 0.0]
        };
        Self {
            kinks,
            steps,
            near: Self::REACHES
                .iter()
                .flat_map(|reach| (0..near_count(*reach)).map(|place| row(near(*reach, place))))
                .collect(),
            anywhere: row(pieces.smoothness(0.0, 1.0)),
        }
    }

    /// The sums at `low` and just below `high`: none between is beyond them.
    pub(crate) fn between(&self, low: f64, high: f64) -> [[f32; 4]; 2] {
        let low = sum_of(&self.steps, |start| start <= low);
        [low, sum_of(&self.steps, |start| start < high)]
    }
}

impl TransferTable {
    /// Number of bins over [0, 1].
    pub(crate) const BINS: f32 = BINS as f32;

    /// Bytes that the table of a function with so many knots takes, at most, and what making it does.
    pub(crate) fn bytes(knots: usize) -> u64 {
        let bin = size_of::<f32>() + 2 * size_of::<[f32; 8]>() + 3 * size_of::<Deviation>();
        let rows: usize = Bends::REACHES.iter().map(|reach| near_count(*reach)).sum();
        let rows = 2 * rows + KINK_PARTS + 4;
        let steps = TransferPieces::most(knots) * size_of::<(f64, [f32; 4])>();
        ((BINS + 1) * bin + rows * size_of::<[f32; 4]>() + steps) as u64
    }

    /// The table of `pieces`, which leave nothing out; its bends are bounded by `merged`.
    pub(crate) fn new(pieces: &PieceList, merged: &PieceList) -> Self {
        let (span, scales) = (pieces.over(0.0, 1.0), pieces.scales());
        let mut table = Self {
            corners: Vec::with_capacity(BINS + 1),
            lines: Vec::with_capacity(BINS + 1),
            behind: Vec::with_capacity(BINS + 1),
            emission: scales[0],
            extinction: if span.most.extinction == 0.0 { 0.0 } else { scales[1] },
            deviation: RunTree::default(),
            bends: Bends::new(merged, scales),
        };
        let mut deviation = Vec::with_capacity(BINS + 1);
        for bin in 0..BINS {
            let ends = [bin, bin + 1].map(|n| n as f64 / BINS as f64);
            deviation.push(table.add_bin(pieces, ends, scales));
        }
        let last = channels(pieces.at(1.0), 1.0);
        table.add_lines([1.0, 2.0, 2.0], [last; 4], scales);
        deviation.push(Deviation::default());
        table.deviation = RunTree::new(deviation.into_iter());
        table
    }

    /// Adds the bin between two x; returns how far the function is from it.
    fn add_bin(&mut self, pieces: &PieceList, [from, to]: [f64; 2], scales: [f64; 2]) -> Deviation {
        let (first, last) = (pieces.find(from), pieces.find(to.next_down()));
        let kink = |index: usize| {
            let kink = pieces.piece(index).kink_from(pieces.piece(index - 1));
            (kink.emission / scales[0]).max(kink.extinction / scales[1])
        };
        let sharpest = (first + 1..=last).max_by(|a, b| kink(*a).total_cmp(&kink(*b)));
        let (corner, [before, after]) = match sharpest {
            Some(index) => {
                let x = pieces.piece(index).start;
                (x, [index - 1, index].map(|index| channels(pieces.piece(index), x)))
            }
            None => (to, [channels(pieces.piece(last), to); 2]),
        };
        let start = channels(pieces.piece(first), from);
        let end = channels(pieces.piece(last), to);
        let ends = [start, before, after, end];
        self.add_lines([from, corner, to], ends, scales);
        let mut off = Deviation::default();
        for index in first..=last {
            let piece = pieces.piece(index);
            let is_after = sharpest.is_some_and(|sharpest| index >= sharpest);
            let line = if is_after {
                [(corner, after), (to, end)]
            } else {
                [(from, start), (corner, before)]
            };
            let ends = [piece.start.max(from), piece.end.min(to)];
            off = off.and(Deviation(off_line(piece, line, ends)));
        }
        off
    }

    /// Adds the lines of a bin from `places[0]` to `places[2]` with a corner at `places[1]`, whose
    /// ends are `ends`.
    fn add_lines(&mut self, places: [f64; 3], ends: [[f64; 4]; 4], scales: [f64; 2]) {
        let [from, corner, to] = places;
        let width = to - from;
        let has_corner = corner < to;
        self.corners.push(if has_corner { ((corner - from) / width) as f32 } else { NO_CORNER });
        let [start, before, after, end] = ends;
        let row = |line: [(f64, [f64; 4]); 2]| {
            let is_empty = line[0].0 >= line[1].0;
            let at = |x: f64| if is_empty { line[1].1 } else { between(line, x) };
            let (start, end) = (at(from), at(to));
            std::array::from_fn(|n| {
                let c = n % 4;
                let value = if n < 4 { start[c] } else { end[c] - start[c] };
                (value / scales[usize::from(c == 3)]) as f32
            })
        };
        let mut first: [f32; 8] = row([(from, start), (corner, before)]);
        self.behind.push(if has_corner { row([(corner, after), (to, end)]) } else { first });
        first[3] = if has_corner { -first[3] } else { first[3] };
        self.lines.push(first);
    }

    /// Largest difference of emission (radiance / code length) and extinction (1 / code length) to
    /// the table's, for x in [`low`, `high`].
    pub(crate) fn deviation(&self, low: f64, high: f64) -> [f64; 2] {
        let bin = |x: f64| (x.clamp(0.0, 1.0) * BINS as f64) as usize;
        // Rounding to f32 may choose the bin beside.
        let (first, last) = (bin(low).saturating_sub(1), (bin(high) + 1).min(BINS));
        self.deviation.over(first, last + 1).0
    }
}

/// The sum behind the last of the steps that begin where `counts` says.
fn sum_of(steps: &[(f64, [f32; 4])], counts: impl Fn(f64) -> bool) -> [f32; 4] {
    let count = steps.partition_point(|(start, _)| counts(*start));
    count.checked_sub(1).map_or([0.0; 4], |last| steps[last].1)
}

/// R, G, B of the emission, and the extinction.
fn channels(piece: &Piece, x: f64) -> [f64; 4] {
    let [r, g, b] = piece.emission(x);
    [r, g, b, piece.extinction(x)]
}

/// How far a piece's emission (any channel) and extinction are from a line between two x.
fn off_line(piece: &Piece, line: [(f64, [f64; 4]); 2], [low, high]: [f64; 2]) -> [f64; 2] {
    let mut off = [0.0_f64; 2];
    for x in [low, high] {
        let pairs = channels(piece, x).into_iter().zip(between(line, x));
        for (c, (found, drawn)) in pairs.enumerate() {
            let channel = usize::from(c == 3);
            off[channel] = off[channel].max((found - drawn).abs());
        }
    }
    [off[0].max(piece.deviation) + 0.25 * piece.bend * (high - low).powi(2), off[1]]
}

/// The line through two places at `x`.
fn between([(from, start), (to, end)]: [(f64, [f64; 4]); 2], x: f64) -> [f64; 4] {
    let share = if to > from { (x - from) / (to - from) } else { 0.0 };
    std::array::from_fn(|c| start[c] + share * (end[c] - start[c]))
}

/// Largest differences, of emission and extinction.
#[derive(Debug, Clone, Copy, Default)]
struct Deviation([f64; 2]);

impl Run for Deviation {
    fn and(self, Self(other): Self) -> Self {
        Self([self.0[0].max(other[0]), self.0[1].max(other[1])])
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::scene::{ColorMap, ColorTable, PiecewiseLinear, TransferFunction};

    fn function() -> TransferFunction {
        let table = |points: &[(f64, f64)]| {
            let points: Vec<_> = points.iter().map(|&(x, y)| (x, [y])).collect();
            PiecewiseLinear::new(&points).unwrap()
        };
        let absorption = table(&[(0.1, 0.0), (0.3, 20.0), (0.3, 2.0), (0.9, 0.0)]);
        let emission = table(&[(0.25, 0.0), (0.25, 3e-33), (0.7, 1e-33), (1.5, 4e-33)]);
        let color = ColorTable::Map(ColorMap::named("viridis").unwrap());
        TransferFunction::from_tables(&absorption, &emission, &color)
    }

    proptest! {
        #[test]
        fn lines_are_the_function_but_for_the_deviation(x in -0.1..1.1_f64, width in 0.0..0.3_f64) {
            let transfer = function();
            let table = {
                let pieces = TransferPieces::new(&transfer, |_| 0.0);
                TransferTable::new(&pieces.all, &pieces.merged)
            };
            let place = (x as f32).clamp(0.0, 1.0) * TransferTable::BINS;
            let (bin, rest) = (place as usize, place.fract());
            let mut line = table.lines[bin];
            prop_assert_eq!(line[3].is_sign_negative(), table.corners[bin] <= 1.0);
            line[3] = line[3].abs();
            if table.corners[bin] <= rest {
                line = table.behind[bin];
            }
            let [emission, extinction] = table.deviation(x - width, x + width);
            let [alone, _] = table.deviation(x, x);
            prop_assert!(alone <= emission && emission < 2e-33);
            let value = |c: usize| {
                f64::from(line[c]) + f64::from(rest * line[4 + c])
            };
            for (c, expected) in transfer.emission(x).into_iter().enumerate() {
                let off = (value(c) * table.emission - expected).abs();
                prop_assert!(off <= emission + 1e-6 * table.emission, "j({x}): {off}");
            }
            let off = (value(3) * table.extinction - transfer.extinction(x)).abs();
            prop_assert!(off <= extinction + 1e-4 * table.extinction, "κ({x}): {off} {extinction}");
        }
    }
}
