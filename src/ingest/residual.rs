//! How far a brick's interpolant is from its parent's: an upper bound, from the payload alone.

use crate::cache::{Block, BrickShape, RawBrick, state};

/// Bounds |F_l − F_{l−1}| over the box of a brick, `F` as in `docs/ARCHITECTURE.md`, "Across
/// levels", of values mapped by `scale`. Infinite where NaN takes part; 0 for the root.
///
/// Where every cell around exists on both levels, F_l = T_l and F_{l−1} = T_{l−1}: both are
/// trilinear between half-integer coordinates of the finer level, so their difference takes its
/// extremes there, and is evaluated. Elsewhere both are convex combinations of values nearby,
/// whose range bounds it.
pub(super) fn bound(shape: BrickShape, raw: &RawBrick, scale: impl Fn(f32) -> f64) -> f64 {
    let [fine, coarse, ..] = raw.blocks.as_slice() else { return 0.0 };
    let mut mapped = Vec::with_capacity(raw.blocks.len());
    for block in &raw.blocks {
        let values: Vec<f64> = block.values.iter().map(|&value| scale(value)).collect();
        let exists = |(_, bits): &(&f64, &u8)| **bits & state::EXISTS != 0;
        if values.iter().zip(&block.states).filter(exists).any(|(value, _)| value.is_nan()) {
            return f64::INFINITY;
        }
        mapped.push(values);
    }
    let edge = shape.edge();
    let mut lattice = Lattice::new(edge);
    let mut bound = 0.0f64;
    for z in 0..edge {
        for y in 0..edge {
            for x in 0..edge {
                let (own, above) = ([x + 1, y + 1, z + 1], [x / 2 + 1, y / 2 + 1, z / 2 + 1]);
                if fine.states[fine.at(own[0], own[1], own[2])] & state::EXISTS == 0 {
                    continue;
                }
                if all_exist(fine, own) && all_exist(coarse, above) {
                    lattice.mark([x, y, z]);
                } else {
                    bound = bound.max(spread(raw, &mapped, own, above));
                }
            }
        }
    }
    bound.max(lattice.difference(fine, &mapped[0], coarse, &mapped[1]))
}

fn all_exist(block: &Block, [x, y, z]: [usize; 3]) -> bool {
    (z - 1..=z + 1).all(|z| {
        (y - 1..=y + 1).all(|y| {
            let start = block.at(x - 1, y, z);
            block.states[start..start + 3].iter().all(|bits| bits & state::EXISTS != 0)
        })
    })
}

/// Largest minus smallest value among what both interpolants can draw on beside a border: the
/// cells around on both levels and, while there are holes among those, the parents' of these and
/// theirs around.
fn spread(raw: &RawBrick, mapped: &[Vec<f64>], own: [usize; 3], above: [usize; 3]) -> f64 {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    let around = |cell: [usize; 3]| cell.map(|c| (c - 1, c + 1));
    // Blocks of one cell and its ghosts do not halve: there all count.
    let halves = raw.blocks[0].side.saturating_sub(2).checked_ilog2().unwrap_or(0) as usize;
    let mut reach = around(own);
    for (up, block) in raw.blocks.iter().enumerate() {
        reach = match up {
            0 => reach,
            1 => around(above),
            _ if up > halves => [(0, block.side - 1); 3],
            _ => reach.map(|(lo, hi)| (parent(lo) - 1, (parent(hi) + 1).min(block.side - 1))),
        };
        let mut has_holes = false;
        for z in reach[2].0..=reach[2].1 {
            for y in reach[1].0..=reach[1].1 {
                for x in reach[0].0..=reach[0].1 {
                    let at = block.at(x, y, z);
                    if block.states[at] & state::EXISTS != 0 {
                        (low, high) = (low.min(mapped[up][at]), high.max(mapped[up][at]));
                    } else {
                        has_holes |= block.states[at] & state::OUTSIDE == 0;
                    }
                }
            }
        }
        if up > 0 && !has_holes {
            break;
        }
    }
    high - low
}

/// A cell's parent, at least 1, both counted from their blocks' first ghosts: block cell 1 is the
/// first of the brick.
fn parent(cell: usize) -> usize {
    cell.div_ceil(2).max(1)
}

/// The points at half-integer coordinates in a brick, (2B + 1)³, and which of them count.
struct Lattice {
    edge: usize,
    marked: Vec<bool>,
    any: bool,
}

/// Along one axis: the value at a lattice point is `weights · values[first ..= first + 1]`.
type Tap = (usize, [f64; 2]);

impl Lattice {
    fn new(edge: usize) -> Self {
        Self { edge, marked: vec![false; (2 * edge + 1).pow(3)], any: false }
    }

    fn side(&self) -> usize {
        2 * self.edge + 1
    }

    /// Counts the 27 points of a cell.
    fn mark(&mut self, cell: [usize; 3]) {
        self.any = true;
        let side = self.side();
        for z in 2 * cell[2]..2 * cell[2] + 3 {
            for y in 2 * cell[1]..2 * cell[1] + 3 {
                let start = (z * side + y) * side + 2 * cell[0];
                self.marked[start..start + 3].fill(true);
            }
        }
    }

    /// Largest |T_l − T_{l−1}| over the marked points.
    fn difference(&self, fine: &Block, own: &[f64], coarse: &Block, above: &[f64]) -> f64 {
        if !self.any {
            return 0.0;
        }
        let own = resample(own, fine.side, &self.fine_taps());
        let above = resample(above, coarse.side, &self.coarse_taps());
        let marked = own.iter().zip(&above).zip(&self.marked).filter(|(_, marked)| **marked);
        marked.fold(0.0, |most, ((a, b), _)| most.max((a - b).abs()))
    }

    /// Even points lie on faces, odd ones at centres (block index = cell + 1).
    fn fine_taps(&self) -> Vec<Tap> {
        let tap = |h: usize| (h / 2, if h % 2 == 0 { [0.5, 0.5] } else { [0.0, 1.0] });
        (0..self.side()).map(tap).collect()
    }

    /// Points lie at quarters of coarser cells.
    fn coarse_taps(&self) -> Vec<Tap> {
        let tap = |h: usize| match h % 4 {
            0 => (h / 4, [0.5, 0.5]),
            1 => (h / 4, [0.25, 0.75]),
            2 => (h / 4, [0.0, 1.0]),
            _ => (h / 4 + 1, [0.75, 0.25]),
        };
        (0..self.side()).map(tap).collect()
    }
}

/// Interpolates a cube of `side`³ values at the tensor product of `taps`, one axis at a time.
fn resample(values: &[f64], side: usize, taps: &[Tap]) -> Vec<f64> {
    let count = taps.len();
    let mut along_x = Vec::with_capacity(side * side * count);
    for row in values.chunks_exact(side) {
        along_x.extend(taps.iter().map(|&(i, [a, b])| a * row[i] + b * row[i + 1]));
    }
    let along_y = blend_rows(&along_x, count, side, taps);
    blend_rows(&along_y, count * count, side, taps)
}

/// Interpolates between consecutive rows of `width` values, in groups of `side` rows.
fn blend_rows(values: &[f64], width: usize, side: usize, taps: &[Tap]) -> Vec<f64> {
    let mut blended = Vec::with_capacity(values.len() / side * taps.len());
    for group in values.chunks_exact(width * side) {
        for &(i, [a, b]) in taps {
            let (first, second) = (&group[i * width..], &group[(i + 1) * width..]);
            blended.extend(first[..width].iter().zip(second).map(|(p, q)| a * p + b * q));
        }
    }
    blended
}
