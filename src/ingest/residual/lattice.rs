//! The difference of two trilinear interpolants at the points where it takes its extremes.

use crate::cache::Block;

/// Differences that are compared side by side.
const LANES: usize = 8;

/// The points at half-integer coordinates in a brick, (2B + 1)³, and which of them count. Memory
/// is reused.
#[derive(Debug, Default)]
pub(super) struct Lattice {
    edge: usize,
    /// Where points lie along an axis, in half cells.
    places: Vec<usize>,
    /// All bits where a point counts, none elsewhere; empty: all count.
    counted: Vec<u64>,
    is_empty: bool,
    fine: Columns,
    coarse: Columns,
}

/// Along one axis: the value at a lattice point is `weights · values[first ..= first + 1]`.
type Tap = (usize, [f64; 2]);

impl Lattice {
    /// Counts all points in a brick of `edge` cells. Coarser cells' faces within the brick need
    /// not be looked at then: both interpolants are linear across them, between the centres of
    /// the finer cells beside them.
    pub(super) fn count_all(&mut self, edge: usize) {
        self.edge = edge;
        self.places.clear();
        let bends = |h: &usize| !h.is_multiple_of(4) || *h == 0 || *h == 2 * edge;
        self.places.extend((0..=2 * edge).filter(bends));
        self.counted.clear();
        self.is_empty = false;
    }

    /// Counts no points.
    pub(super) fn count_none(&mut self, edge: usize) {
        self.edge = edge;
        self.places.clear();
        self.places.extend(0..=2 * edge);
        self.counted.clear();
        self.counted.resize(self.places.len().pow(3), 0);
        self.is_empty = true;
    }

    /// Counts the 27 points of a cell.
    pub(super) fn count(&mut self, cell: [usize; 3]) {
        let side = self.places.len();
        self.is_empty = false;
        for z in 2 * cell[2]..2 * cell[2] + 3 {
            for y in 2 * cell[1]..2 * cell[1] + 3 {
                let start = (z * side + y) * side + 2 * cell[0];
                self.counted[start..start + 3].fill(u64::MAX);
            }
        }
    }

    /// Largest |T_l − T_{l−1}| over the points that count, of values mapped by `scale`.
    pub(super) fn difference(
        &mut self,
        fine: &Block,
        coarse: &Block,
        scale: &impl Fn(f32) -> f64,
    ) -> f64 {
        if self.is_empty {
            return 0.0;
        }
        let taps = |tap: fn(usize) -> Tap| self.places.iter().map(|&h| tap(h)).collect::<Vec<_>>();
        let (own, above) = (taps(fine_tap), taps(coarse_tap));
        self.fine.interpolate(fine, &own, scale);
        self.coarse.interpolate(coarse, &above, scale);
        let plane = own.len() * own.len();
        let all = vec![u64::MAX; if self.counted.is_empty() { plane } else { 0 }];
        let planes = own.iter().zip(&above).enumerate();
        planes.fold(0.0, |most: f64, (number, (own, above))| {
            let counted = self.counted.get(number * plane..(number + 1) * plane).unwrap_or(&all);
            let pairs = [self.fine.pair(plane, own), self.coarse.pair(plane, above)];
            most.max(largest_difference(&pairs, counted))
        })
    }
}

/// Even points lie on faces, odd ones at centres (block index = cell + 1).
fn fine_tap(h: usize) -> Tap {
    (h / 2, if h.is_multiple_of(2) { [0.5, 0.5] } else { [0.0, 1.0] })
}

/// Points lie at quarters of coarser cells.
fn coarse_tap(h: usize) -> Tap {
    match h % 4 {
        0 => (h / 4, [0.5, 0.5]),
        1 => (h / 4, [0.25, 0.75]),
        2 => (h / 4, [0.0, 1.0]),
        _ => (h / 4 + 1, [0.75, 0.25]),
    }
}

/// A block's values, interpolated along x and y.
#[derive(Debug, Default)]
struct Columns {
    mapped: Vec<f64>,
    along_x: Vec<f64>,
    along_y: Vec<f64>,
}

/// Two planes of values and their weights.
type Pair<'c> = ([&'c [f64]; 2], [f64; 2]);

impl Columns {
    fn interpolate(&mut self, block: &Block, taps: &[Tap], scale: &impl Fn(f32) -> f64) {
        self.mapped.clear();
        self.mapped.extend(block.values.iter().map(|&value| scale(value)));
        self.along_x.clear();
        for row in self.mapped.chunks_exact(block.side) {
            self.along_x.extend(taps.iter().map(|&(i, [a, b])| a * row[i] + b * row[i + 1]));
        }
        self.along_y.clear();
        let width = taps.len();
        for group in self.along_x.chunks_exact(width * block.side) {
            for &(i, [a, b]) in taps {
                let (first, second) = (&group[i * width..], &group[(i + 1) * width..]);
                let rows = first[..width].iter().zip(second);
                self.along_y.extend(rows.map(|(p, q)| a * p + b * q));
            }
        }
    }

    /// The planes of `plane` values between which the points of `tap` lie along z.
    fn pair(&self, plane: usize, &(i, weights): &Tap) -> Pair<'_> {
        let at = |i: usize| &self.along_y[i * plane..(i + 1) * plane];
        ([at(i), at(i + 1)], weights)
    }
}

/// Largest |own − above| of those points of a plane that are `counted`.
fn largest_difference([(own, a), (above, b)]: &[Pair<'_>; 2], counted: &[u64]) -> f64 {
    let weights = [a[0], a[1], b[0], b[1]];
    let planes = [own[0], own[1], above[0], above[1]].map(<[f64]>::as_chunks::<LANES>);
    let (counted, counted_rest) = counted.as_chunks::<LANES>();
    let rest = planes.map(|(_, rest)| rest.as_chunks::<1>().0);
    let most = largest(planes.map(|(chunks, _)| chunks), weights, counted);
    most.max(largest(rest, weights, counted_rest.as_chunks::<1>().0))
}

fn largest<const N: usize>(
    [p, q, r, s]: [&[[f64; N]]; 4],
    [a, b, c, d]: [f64; 4],
    counted: &[[u64; N]],
) -> f64 {
    let mut most = [0.0; N];
    for ((((p, q), r), s), counted) in p.iter().zip(q).zip(r).zip(s).zip(counted) {
        for n in 0..N {
            let difference = (a * p[n] + b * q[n]) - (c * r[n] + d * s[n]);
            let difference = f64::from_bits(difference.to_bits() & counted[n]).abs();
            most[n] = if difference > most[n] { difference } else { most[n] };
        }
    }
    most.into_iter().fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(side: usize, seed: u64) -> Block {
        let value = |i: u64| (((i + 7) * seed) % 1009) as f32 / 100.0;
        let values: Vec<f32> = (0..side.pow(3) as u64).map(value).collect();
        Block { side, states: vec![1; values.len()], values }
    }

    #[test]
    fn points_that_are_left_out_hold_no_extreme() {
        for edge in [8, 16] {
            for seed in [31, 77, 1003] {
                let (fine, coarse) = (block(edge + 2, seed), block(edge / 2 + 2, seed + 4));
                let (mut few, mut all) = (Lattice::default(), Lattice::default());
                few.count_all(edge);
                all.count_none(edge);
                for at in 0..edge.pow(3) {
                    all.count([at % edge, at / edge % edge, at / edge / edge]);
                }
                let scale = |value| f64::from(value);
                let [few, all] =
                    [few, all].map(|mut lattice| lattice.difference(&fine, &coarse, &scale));
                assert!((few - all).abs() <= 1e-12 * all && all > 1.0, "{edge}: {few} {all}");
            }
        }
    }

    #[test]
    fn only_counted_cells_count() {
        let (fine, mut coarse) = (block(10, 0), block(6, 0));
        coarse.values[3 * 36 + 3 * 6 + 3] = 8.0;
        let mut lattice = Lattice::default();
        lattice.count_none(8);
        let scale = |value| f64::from(value);
        assert_eq!(lattice.difference(&fine, &coarse, &scale), 0.0);
        lattice.count([0, 0, 0]);
        assert_eq!(lattice.difference(&fine, &coarse, &scale), 0.0);
        lattice.count([4, 4, 4]);
        // A corner of this cell is the centre of the coarser cell that differs.
        assert_eq!(lattice.difference(&fine, &coarse, &scale), 8.0);
    }
}
