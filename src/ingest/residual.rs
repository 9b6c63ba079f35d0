//! How far a brick's interpolant is from its parent's: an upper bound, from the payload alone.

use crate::cache::{Block, BrickShape, RawBrick, state};

/// Where in a brick F_l − F_{l−1} is known closely, and where only bounded; `F` as in
/// `docs/ARCHITECTURE.md`, "Across levels".
///
/// Where every cell around exists on both levels, F_l = T_l and F_{l−1} = T_{l−1}: both are
/// trilinear between half-integer coordinates of the finer level, so their difference takes its
/// extremes there, and is evaluated. Elsewhere both are convex combinations of values nearby,
/// whose range bounds it.
pub(super) struct Residual<'r> {
    raw: &'r RawBrick,
    lattice: Lattice,
    /// Existing cells beside borders.
    beside: Vec<[usize; 3]>,
}

impl<'r> Residual<'r> {
    /// Looks at the cells' states; none for the root, which has no parent.
    pub(super) fn new(shape: BrickShape, raw: &'r RawBrick) -> Option<Self> {
        let [fine, coarse, ..] = raw.blocks.as_slice() else { return None };
        let edge = shape.edge();
        let (mut lattice, mut beside) = (Lattice::new(edge), Vec::new());
        let exists = |block: &Block| block.states.iter().all(|bits| bits & state::EXISTS != 0);
        if exists(fine) && exists(coarse) {
            return Some(Self { raw, lattice, beside });
        }
        lattice.marked = Some(vec![false; lattice.side().pow(3)]);
        let (inner, above) = (surrounded(fine), surrounded(coarse));
        for z in 0..edge {
            for y in 0..edge {
                for x in 0..edge {
                    let own = fine.at(x + 1, y + 1, z + 1);
                    let parent = coarse.at(x / 2 + 1, y / 2 + 1, z / 2 + 1);
                    if inner[own] && above[parent] {
                        lattice.mark([x, y, z]);
                    } else if fine.states[own] & state::EXISTS != 0 {
                        beside.push([x, y, z]);
                    }
                }
            }
        }
        Some(Self { raw, lattice, beside })
    }

    /// Bounds |F_l − F_{l−1}| over the brick's box, of values mapped by `scale`. Infinite where
    /// NaN takes part.
    pub(super) fn bound(&self, scale: impl Fn(f32) -> f64) -> f64 {
        let mut mapped = Vec::with_capacity(self.raw.blocks.len());
        for block in &self.raw.blocks {
            let values: Vec<f64> = block.values.iter().map(|&value| scale(value)).collect();
            let exists = |(_, bits): &(&f64, &u8)| **bits & state::EXISTS != 0;
            if values.iter().zip(&block.states).filter(exists).any(|(value, _)| value.is_nan()) {
                return f64::INFINITY;
            }
            mapped.push(values);
        }
        let [fine, coarse, ..] = self.raw.blocks.as_slice() else { return 0.0 };
        let inside = self.lattice.difference(fine, &mapped[0], coarse, &mapped[1]);
        self.beside.iter().fold(inside, |bound, cell| {
            let (own, above) = (cell.map(|c| c + 1), cell.map(|c| c / 2 + 1));
            bound.max(spread(self.raw, &mapped, own, above))
        })
    }
}

/// For each cell of a block whether it and all 26 around it exist; never at the block's edge.
fn surrounded(block: &Block) -> Vec<bool> {
    let mut exist: Vec<bool> = block.states.iter().map(|bits| bits & state::EXISTS != 0).collect();
    let last = exist.len();
    for stride in [1, block.side, block.side * block.side] {
        let before = exist.clone();
        for (at, exists) in exist.iter_mut().enumerate() {
            let inside = (at / stride) % block.side != 0 && (at / stride + 1) % block.side != 0;
            *exists = inside && at + stride < last && {
                before[at - stride] && before[at] && before[at + stride]
            };
        }
    }
    exist
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

/// The points at half-integer coordinates in a brick, (2B + 1)³, and which of them count (none
/// said: all).
struct Lattice {
    edge: usize,
    marked: Option<Vec<bool>>,
}

/// Along one axis: the value at a lattice point is `weights · values[first ..= first + 1]`.
type Tap = (usize, [f64; 2]);

impl Lattice {
    fn new(edge: usize) -> Self {
        Self { edge, marked: None }
    }

    fn side(&self) -> usize {
        2 * self.edge + 1
    }

    /// Counts the 27 points of a cell.
    fn mark(&mut self, cell: [usize; 3]) {
        let side = self.side();
        let Some(marked) = &mut self.marked else { return };
        for z in 2 * cell[2]..2 * cell[2] + 3 {
            for y in 2 * cell[1]..2 * cell[1] + 3 {
                let start = (z * side + y) * side + 2 * cell[0];
                marked[start..start + 3].fill(true);
            }
        }
    }

    /// Largest |T_l − T_{l−1}| over the marked points.
    fn difference(&self, fine: &Block, own: &[f64], coarse: &Block, above: &[f64]) -> f64 {
        if self.marked.as_ref().is_some_and(|marked| !marked.contains(&true)) {
            return 0.0;
        }
        let own = resample(own, fine.side, &self.fine_taps());
        let above = resample(above, coarse.side, &self.coarse_taps());
        let differences = own.iter().zip(&above).map(|(a, b)| (a - b).abs());
        match &self.marked {
            None => differences.fold(0.0, f64::max),
            Some(marked) => {
                let counted = differences.zip(marked).filter(|(_, marked)| **marked);
                counted.fold(0.0, |most, (difference, _)| most.max(difference))
            }
        }
    }

    /// Even points lie on faces, odd ones at centres (block index = cell + 1).
    fn fine_taps(&self) -> Vec<Tap> {
        let tap = |h: usize| (h / 2, if h.is_multiple_of(2) { [0.5, 0.5] } else { [0.0, 1.0] });
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
