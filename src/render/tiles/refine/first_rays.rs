//! What the rays of neighbouring pixels tell of a pixel whose bound stays above the tolerance. Where
//! its first ray and those around it lie on a smooth surface, it takes no more: the surface says how
//! far its mean is from its centre, and what is left beside the surface how far both may be off it.
//!
//! Rays as far apart as pixels cannot see what is alike in all of these. So in each block of pixels
//! one, a *witness*, is quartered whatever its neighbours say. Where its quarters have another mean
//! than they predicted, those around it are believed by as much less.

use super::Batch;
use super::border_rays::{BorderRays, SIDES};
use crate::render::camera::pixel_order::{BLOCK, PixelOrder};
use crate::render::camera::rays::{BATCH_RAYS, TILE_SIDE};
use crate::render::tiles::unevenness::{SquareSides, Unevenness};
use crate::render::tiles::waiting::Found;

/// A pixel stands out whose bound is so many times the median of those around it: something may be
/// in it that is not in these.
const STANDS_OUT_OF_NEIGHBOURS: f64 = 1.5;
/// Bounds around a pixel, of which fewer have no median to go by.
const FEWEST_AROUND: usize = 3;
/// Blocks of a tile at most.
const MOST_BLOCKS: usize = (TILE_SIDE / BLOCK).pow(2) as usize;
/// What a mean is farther from its centre than those of its quarters are, where values bend.
const OF_QUARTERS: f64 = 0.75;

/// What the first ray of a pixel has found, what its square may be off by, and how many rays stood for
/// squares of it.
#[derive(Debug, Clone, Copy, Default)]
struct First {
    value: [f32; 4],
    bound: f64,
    marched: u32,
}

/// What the first ray of each pixel of a tile has found, and rays on the tile's outer sides.
#[derive(Default)]
pub(super) struct FirstRays {
    /// Where each pixel lies in the tile.
    pub(super) order: PixelOrder,
    /// Of each pixel.
    each: Vec<First>,
    /// By how much, in each block of pixels, a mean has differed from what neighbours predicted.
    doubts: Vec<f64>,
    /// What lies on the tile's outer sides.
    pub(super) border: BorderRays,
}

impl FirstRays {
    /// Bytes that it takes.
    pub(super) const BYTES: u64 = BorderRays::BYTES
        + (BATCH_RAYS * size_of::<First>() + MOST_BLOCKS * size_of::<f64>()) as u64;

    /// Forgets what it knows, for so many pixels in this order.
    pub(super) fn clear(&mut self, order: PixelOrder, count: usize) {
        self.order = order;
        self.border.clear([order.width(), order.height()]);
        self.each.clear();
        self.each.resize(count, First::default());
        let [columns, rows] = self.blocks();
        self.doubts.clear();
        self.doubts.resize((columns * rows) as usize, 0.0);
    }

    /// Where a pixel lies in the tile.
    pub(super) fn place(&self, pixel: usize) -> [u32; 2] {
        self.order.place(pixel)
    }

    /// Counts rays that stand for squares, and notes what those of whole pixels have found.
    pub(super) fn note(&mut self, batch: &Batch, outcome: &[Found]) {
        // Those that are marched again come first.
        let again = batch.again.len();
        for (n, found) in outcome.iter().enumerate() {
            let first = &mut self.each[usize::from(found.square.pixel)];
            first.marched += u32::from(n >= again);
            if found.square.halvings == 0 {
                first.value = found.value.map(|channel| channel as f32);
                first.bound = found.shares().total();
            }
        }
    }

    /// Rays of a pixel that stood for squares.
    pub(super) fn marched(&self, pixel: usize) -> f64 {
        f64::from(self.each[pixel].marched)
    }

    /// Columns and rows of blocks of pixels.
    fn blocks(&self) -> [u32; 2] {
        [self.order.width(), self.order.height()].map(|side| side.div_ceil(BLOCK))
    }

    /// The number of the block with a pixel, and where it begins.
    fn block_of(&self, pixel: usize) -> (u32, [u32; 2]) {
        let first = self.order.place(pixel).map(|n| n / BLOCK);
        (first[1] * self.blocks()[0] + first[0], first.map(|n| n * BLOCK))
    }

    /// Whether a pixel is the witness of its block; which of its pixels that is follows no pattern. Every
    /// other block has one, as a chessboard has black squares.
    pub(super) fn is_witness(&self, pixel: usize) -> bool {
        let (block, [x, y]) = self.block_of(pixel);
        if (x + y) / BLOCK % 2 == 1 {
            return false;
        }
        let hash = block.wrapping_mul(0x9e37_79b9) >> 16;
        let size = [self.order.width() - x, self.order.height() - y].map(|n| n.min(BLOCK));
        let place = [x + hash % BLOCK % size[0], y + hash / BLOCK % BLOCK % size[1]];
        self.order.place(pixel) == place
    }

    /// How the first rays of a pixel and of those around it vary: at the tile's edges, of the nearest
    /// nine with it among them.
    pub(super) fn predict(&self, pixel: usize) -> Option<Unevenness> {
        let size = [self.order.width(), self.order.height()];
        if size.iter().any(|n| *n < 3) {
            return None;
        }
        let place = self.order.place(pixel);
        let middle: [u32; 2] = std::array::from_fn(|a| place[a].clamp(1, size[a] - 2));
        let mut values = [[0.0; 4]; 9];
        for (n, value) in (0..9).zip(&mut values) {
            let number = self.order.number([middle[0] + n % 3 - 1, middle[1] + n / 3 - 1])?;
            *value = self.each[number].value.map(f64::from);
        }
        Some(Unevenness::around(&values).with_edges(self.edges(pixel)))
    }

    /// By how much values may change at the sides of a pixel, as far as first rays tell.
    pub(super) fn edges(&self, pixel: usize) -> [f64; 4] {
        let place = self.order.place(pixel);
        std::array::from_fn(|side| self.edge(place, side))
    }

    /// What the first ray of a pixel may be off by for its square.
    pub(super) fn first_bound(&self, pixel: usize) -> f64 {
        self.each[pixel].bound
    }

    /// Whether the first ray of a pixel has met no more than `limit`.
    pub(super) fn is_first_dark(&self, pixel: usize, limit: f64) -> bool {
        self.each[pixel].value.iter().all(|&value| f64::from(value) <= limit)
    }

    /// What the first ray of the pixel so many steps beside the one at `place` has found.
    pub(super) fn first(&self, place: [u32; 2], steps: [i32; 2]) -> Option<[f64; 4]> {
        let number = self.order.beside(place, steps)?;
        Some(self.each[number].value.map(f64::from))
    }

    /// What is known at a square's sides.
    pub(super) fn around(&self, found: &Found) -> SquareSides {
        let place = self.order.place(usize::from(found.square.pixel));
        let beyond = std::array::from_fn(|side| match self.first(place, SIDES[side]) {
            Some(next) => (0..4).map(|c| (next[c] - found.value[c]).abs()).fold(0.0, f64::max),
            None => self.beyond_rim(place, side, &found.value),
        });
        SquareSides { beyond, own: found.square.sides_of_pixel() }
    }

    /// By how much first rays change at an edge between a pixel's and the next one's on a side: such
    /// an edge may run beside all rays of both, and of all pixels along it. What varies smoothly
    /// changes alike from pixel to pixel, and has a third difference of nearly 0, where an edge has
    /// two of once and one of twice its height.
    fn edge(&self, place: [u32; 2], side: usize) -> f64 {
        let first = |steps: i32| self.first(place, SIDES[side].map(|towards| steps * towards));
        let [before, own, next, behind] = [-1, 0, 1, 2].map(first);
        let (Some(own), Some(next)) = (own, next) else { return self.edge_at_rim(place, side) };
        let third = |values: [[f64; 4]; 4], c: usize| {
            (values[3][c] - 3.0 * values[2][c] + 3.0 * values[1][c] - values[0][c]).abs()
        };
        let rough = |c: usize| match (first(-2), before, behind, first(3)) {
            (_, Some(before), Some(behind), _) => 0.5 * third([before, own, next, behind], c),
            (Some(far), Some(before), None, _) => third([far, before, own, next], c),
            (_, None, Some(behind), Some(far)) => third([own, next, behind, far], c),
            _ => f64::INFINITY,
        };
        (0..4).map(|c| (next[c] - own[c]).abs().min(rough(c))).fold(0.0, f64::max)
    }

    /// Learns from the quarters of a witness, or of any other pixel, whether neighbours tell enough.
    pub(super) fn doubt(&mut self, whole: &Found, quarters: [&[f64; 4]; 4]) {
        let pixel = usize::from(whole.square.pixel);
        if whole.square.halvings > 0 {
            return;
        }
        let Some(predicted) = self.predict(pixel) else { return };
        let missed = |c: usize| {
            let mean = 0.25 * quarters.iter().map(|value| value[c]).sum::<f64>();
            (mean - whole.value[c] - OF_QUARTERS * predicted.bend(c)).abs()
        };
        let missed = (0..4).map(missed).fold(0.0, f64::max) - predicted.likely();
        let block = self.block_of(pixel).0 as usize;
        self.doubts[block] = self.doubts[block].max(missed);
    }

    /// What neighbours have missed in the blocks around a pixel, at most.
    pub(super) fn doubt_around(&self, pixel: usize) -> f64 {
        let (_, place) = self.block_of(pixel);
        let [x, y] = place.map(|n| n / BLOCK);
        let [columns, rows] = self.blocks();
        let near = |n: u32, count: u32| n.saturating_sub(1)..(n + 2).min(count);
        let around = near(y, rows).flat_map(|y| near(x, columns).map(move |x| [x, y]));
        around.map(|[x, y]| self.doubts[(y * columns + x) as usize]).fold(0.0, f64::max)
    }

    /// A pixel and those beside it.
    pub(super) fn near(&self, pixel: usize) -> impl Iterator<Item = usize> {
        let place = self.order.place(pixel);
        (0..9).filter_map(move |n| self.order.beside(place, [n % 3 - 1, n / 3 - 1]))
    }

    /// Whether a whole pixel's bound is far above those of the pixels around it.
    pub(super) fn stands_out(&self, pixel: usize, bound: f64) -> bool {
        let others = self.near(pixel).filter(|other| *other != pixel);
        let mut around: Vec<_> = others.map(|other| self.each[other].bound).collect();
        around.sort_unstable_by(f64::total_cmp);
        around.len() < FEWEST_AROUND || bound > STANDS_OUT_OF_NEIGHBOURS * around[around.len() / 2]
    }
}
