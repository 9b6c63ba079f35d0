//! The transfer function in pieces, and light through a stretch along which the mapped value is
//! a polynomial.

use super::super::march_cell::{Gathered, OPAQUE};
use super::super::transfer::Transfer;
use super::polynomial::Polynomial;

/// Gauss–Legendre nodes and weights of 8 points on −1 … 1, for the positive nodes.
const GAUSS: [(f64, f64); 4] = [
    (0.183_434_642_495_649_8, 0.362_683_783_378_362),
    (0.525_532_409_916_329, 0.313_706_645_877_887_3),
    (0.796_666_477_413_626_7, 0.222_381_034_453_374_48),
    (0.960_289_856_497_536_3, 0.101_228_536_290_376_26),
];
/// Optical depth over which 8 nodes give the light of a cubic to about 1e-13.
const THIN: f64 = 1.0;
/// Degree of the mapped value from which on a stretch is halved first.
const HIGH_DEGREE: usize = 6;
/// Halvings after which a stretch is shorter than doubles can tell.
const MOST_HALVINGS: u32 = 60;

/// `value + slope · (x − near)`.
#[derive(Debug, Clone, Copy)]
struct Line {
    value: f64,
    slope: f64,
}

/// What the medium does between two kinks.
#[derive(Debug, Clone, Copy)]
struct Piece {
    near: f64,
    /// Where the piece begins and ends, from `near`.
    reach: [f64; 2],
    extinction: Line,
    emission: Line,
    color: [Line; 3],
    is_live: bool,
}

/// A transfer function between its kinks.
pub(crate) struct Medium {
    kinks: Vec<f64>,
    /// Below the first kink (0), between kinks, above the last (1).
    pieces: Vec<Piece>,
    /// Number of pieces before each that emit or absorb.
    live_before: Vec<usize>,
    /// Scaled value that maps to 0, and what one scaled unit maps to.
    low: f64,
    factor: f64,
}

/// Upper bounds over a range of values.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Strongest {
    /// Extinction, 1 / code length.
    pub(crate) extinction: f64,
    /// Radiance / code length of any channel.
    pub(crate) emission: f64,
}

impl Line {
    fn at(self, offset: f64) -> f64 {
        self.value + self.slope * offset
    }
}

impl Piece {
    /// Between two kinks, from two points strictly inside, where no table jumps; told from the
    /// lower kink on, so that x of 1e-20 is not lost beside those points.
    fn between(transfer: &Transfer, low: f64, high: f64) -> Self {
        let [near, far] = [0.25, 0.75].map(|part| low + part * (high - low));
        let (first, second) = (transfer.optics(near), transfer.optics(far));
        let line = |a: f64, b: f64| {
            let slope = (b - a) / (far - near);
            let value = a - slope * (near - low);
            let is_rounding = value.abs() <= 1e-14 * a.abs().max(b.abs());
            Line { value: if is_rounding { 0.0 } else { value }, slope }
        };
        Self {
            near: low,
            reach: [0.0, high - low],
            extinction: line(first.extinction, second.extinction),
            emission: line(first.emission, second.emission),
            color: std::array::from_fn(|c| line(first.color[c], second.color[c])),
            is_live: [first, second].iter().any(|o| o.extinction > 0.0 || o.emission > 0.0),
        }
    }

    /// Beyond the outermost kinks.
    fn constant(transfer: &Transfer, x: f64) -> Self {
        let optics = transfer.optics(x);
        let line = |value| Line { value, slope: 0.0 };
        Self {
            near: x,
            reach: [f64::NEG_INFINITY, f64::INFINITY],
            extinction: line(optics.extinction),
            emission: line(optics.emission),
            color: optics.color.map(line),
            is_live: optics.extinction > 0.0 || optics.emission > 0.0,
        }
    }
}

impl Medium {
    pub(crate) fn new(transfer: &Transfer) -> Self {
        let kinks = transfer.kinks();
        let mut pieces = vec![Piece::constant(transfer, 0.0)];
        pieces.extend(kinks.windows(2).map(|k| Piece::between(transfer, k[0], k[1])));
        pieces.push(Piece::constant(transfer, 1.0));
        let mut live_before = vec![0];
        for (n, piece) in pieces.iter().enumerate() {
            live_before.push(live_before[n] + usize::from(piece.is_live));
        }
        let [low, high] = transfer.bounds();
        Self { kinks, pieces, live_before, low, factor: 1.0 / (high - low) }
    }

    fn map(&self, scaled: f64) -> f64 {
        (scaled - self.low) * self.factor
    }

    fn piece(&self, x: f64) -> usize {
        self.kinks.partition_point(|kink| *kink <= x)
    }

    /// Whether any value of `low ..= high` (scaled, not mapped) emits or absorbs.
    pub(crate) fn is_live(&self, low: f64, high: f64) -> bool {
        let [low, high] = [low, high].map(|scaled| self.map(scaled));
        // A table's value at its kink may belong to either side.
        let first = self.kinks.partition_point(|kink| *kink < low);
        self.live_before[first] < self.live_before[self.piece(high) + 1]
    }

    /// Bounds over `low ..= high` (scaled, not mapped).
    pub(crate) fn strongest(&self, low: f64, high: f64) -> Strongest {
        let mut found = Strongest::default();
        if !self.is_live(low, high) {
            return found;
        }
        let [low, high] = [low, high].map(|scaled| self.map(scaled));
        let first = self.kinks.partition_point(|kink| *kink < low);
        for n in first..=self.piece(high) {
            let piece = &self.pieces[n];
            let begin = if n == 0 { low } else { low.max(self.kinks[n - 1]) };
            let end = if n == self.kinks.len() { high } else { high.min(self.kinks[n]) };
            let ends = [begin, end].map(|x| x - piece.near);
            let largest = |line: Line| line.at(ends[0]).max(line.at(ends[1])).max(0.0);
            found.extinction = found.extinction.max(largest(piece.extinction));
            let color = piece.color.map(largest).into_iter().fold(0.0, f64::max);
            found.emission = found.emission.max(largest(piece.emission) * color);
        }
        found
    }

    /// Adds a stretch of `length` code lengths along which the scaled value is constant.
    pub(crate) fn add_constant(&self, scaled: f64, length: f64, gathered: &mut Gathered) {
        let x = self.map(scaled);
        let piece = &self.pieces[self.piece(x)];
        if !piece.is_live {
            return;
        }
        let offset = x - piece.near;
        let depth = piece.extinction.at(offset).max(0.0) * length;
        let part = if depth > 0.0 { -(-depth).exp_m1() / depth } else { 1.0 };
        let seen = (-gathered.optical_depth).exp() * piece.emission.at(offset) * length * part;
        for (channel, color) in gathered.radiance.iter_mut().zip(piece.color) {
            *channel += seen * color.at(offset);
        }
        gathered.optical_depth += depth;
    }

    /// Adds a stretch along which the scaled value is `value`, within `low ..= high`.
    pub(crate) fn add(
        &self,
        value: &Polynomial,
        [low, high]: [f64; 2],
        length: f64,
        gathered: &mut Gathered,
    ) {
        if !self.is_live(low, high) {
            return;
        }
        let x = value.mapped(-self.low, self.factor);
        let (first, last) = (self.piece(self.map(low)), self.piece(self.map(high)));
        if first == last {
            Stretch::new(&self.pieces[first], x, length).add(gathered);
            return;
        }
        let mut begin = 0.0;
        let mut part = |end: f64| {
            if end > begin {
                let piece = &self.pieces[self.piece(x.at(0.5 * (begin + end)))];
                let inside = x.restricted(begin, end);
                Stretch::new(piece, inside, length * (end - begin)).add(gathered);
                begin = end;
            }
        };
        x.each_crossing(&self.kinks[first..last], &mut part);
        part(1.0);
    }
}

/// `e^(−depth)`: by its series where four terms of it are exact in a double.
fn dimmed(depth: f64) -> f64 {
    if depth.abs() < 1e-4 {
        1.0 - depth * (1.0 - depth / 2.0 * (1.0 - depth / 3.0))
    } else {
        (-depth).exp()
    }
}

/// A stretch of a ray within one piece of the transfer function.
struct Stretch<'a> {
    piece: &'a Piece,
    /// Mapped value from the piece's `near`.
    offset: Polynomial,
    /// Optical depth from the stretch's front.
    depth: Option<Polynomial>,
    length: f64,
}

impl<'a> Stretch<'a> {
    fn new(piece: &'a Piece, x: Polynomial, length: f64) -> Self {
        let offset = x.mapped(-piece.near, 1.0);
        let Line { value, slope } = piece.extinction;
        let absorbs = value != 0.0 || slope != 0.0;
        let extinction = || offset.mapped(0.0, slope).mapped(value, length);
        let depth = absorbs.then(|| extinction().integral());
        Self { piece, offset, depth, length }
    }

    fn depth_at(&self, s: f64) -> f64 {
        self.depth.as_ref().map_or(0.0, |depth| depth.at(s))
    }

    fn add(&self, gathered: &mut Gathered) {
        if !self.piece.is_live || self.length <= 0.0 {
            return;
        }
        let front = (-gathered.optical_depth).exp() * self.length;
        let whole = self.depth_at(1.0).max(0.0);
        let Line { value, slope } = self.piece.emission;
        if value != 0.0 || slope != 0.0 {
            let seen = self.seen([0.0, 1.0], [0.0, whole], MOST_HALVINGS);
            for (channel, radiance) in gathered.radiance.iter_mut().zip(seen) {
                *channel += front * radiance;
            }
        }
        gathered.optical_depth += whole;
    }

    /// Mean radiance / code length of `ends` that leaves at the stretch's front; `depths` are
    /// those at both ends.
    fn seen(&self, ends: [f64; 2], depths: [f64; 2], halvings: u32) -> [f64; 3] {
        if depths[0] > OPAQUE {
            return [0.0; 3];
        }
        let is_smooth = self.offset.degree() <= HIGH_DEGREE || ends[1] - ends[0] < 1.0;
        if halvings == 0 || (is_smooth && depths[1] - depths[0] <= THIN) {
            return self.gauss(ends);
        }
        let middle = 0.5 * (ends[0] + ends[1]);
        let depth = self.depth_at(middle);
        let near = self.seen([ends[0], middle], [depths[0], depth], halvings - 1);
        let far = self.seen([middle, ends[1]], [depth, depths[1]], halvings - 1);
        [0, 1, 2].map(|c| near[c] + far[c])
    }

    fn gauss(&self, [low, high]: [f64; 2]) -> [f64; 3] {
        let (centre, half) = (0.5 * (low + high), 0.5 * (high - low));
        let mut sum = [0.0; 3];
        for (node, weight) in GAUSS {
            for s in [centre - half * node, centre + half * node] {
                // Rounding must not leave the piece: slopes of emission may be 1e12.
                let [low, high] = self.piece.reach;
                let offset = self.offset.at(s).clamp(low, high);
                let left = self.depth.as_ref().map_or(1.0, |depth| dimmed(depth.at(s)));
                let factor = weight * half * left * self.piece.emission.at(offset);
                for (channel, color) in sum.iter_mut().zip(self.piece.color) {
                    *channel += factor * color.at(offset);
                }
            }
        }
        sum
    }
}
