//! What the rays of neighbouring pixels tell of a pixel whose bound stays above the tolerance. Where
//! its first ray and those around it lie on a smooth surface, it takes no more: the surface says how
//! far its mean is from its centre, and what is left beside the surface how far both may be off it.
//!
//! Rays as far apart as pixels cannot see what is alike in all of these. So in each block of pixels
//! one, a *witness*, is quartered whatever its neighbours say. Where its quarters have another mean
//! than they foretold, those around it are believed by as much less.

use super::alone::ALONE_SHARE;
use super::rim::SIDES;
use super::{Batch, Sheet};
use crate::render::bounds::ray_error::ErrorShares;
use crate::render::camera::pixel_order::BLOCK;
use crate::render::camera::rays::TILE_SIDE;
use crate::render::tiles::unevenness::{SquareSides, Unevenness};
use crate::render::tiles::waiting::Found;

/// A pixel stands out whose bound is so many times the median of those around it: something may be
/// in it that is not in these.
const STANDS_OUT: f64 = 1.5;
/// Neighbours tell little of a pixel that may be off by this many times the light that was expected
/// of all of the picture.
const UNKNOWN: f64 = 4.0;
/// Bounds around a pixel, of which fewer have no median to go by.
const FEWEST_AROUND: usize = 3;
/// What neighbours have missed in a witness counts this many times beside what they foretell of
/// others.
const DOUBTS: f64 = 2.0;
/// Blocks of a tile at most.
pub(super) const MOST_BLOCKS: usize = (TILE_SIDE / BLOCK).pow(2) as usize;
/// What a mean is farther from its centre than those of its quarters are, where values bend.
const OF_QUARTERS: f64 = 0.75;

/// What the first ray of a pixel has found, what its square may be off by, and how many rays stood for
/// squares of it.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct First {
    value: [f32; 4],
    bound: f64,
    marched: u32,
}

impl Sheet {
    /// Counts rays that stand for squares, and notes what those of whole pixels have found.
    pub(super) fn note(&mut self, batch: &Batch, outcome: &[Found]) {
        // Those that are marched again come first.
        let again = batch.again.len();
        for (n, found) in outcome.iter().enumerate() {
            let first = &mut self.firsts[usize::from(found.square.pixel)];
            first.marched += u32::from(n >= again);
            if found.square.halvings == 0 {
                first.value = found.value.map(|channel| channel as f32);
                first.bound = found.shares().total();
            }
        }
    }

    /// Rays of a pixel that stood for squares.
    pub(super) fn marched(&self, pixel: usize) -> f64 {
        f64::from(self.firsts[pixel].marched)
    }

    /// Columns and rows of blocks of pixels.
    fn blocks(&self) -> [u32; 2] {
        [self.order.width(), self.order.height()].map(|side| side.div_ceil(BLOCK))
    }

    /// Nothing is in doubt.
    pub(super) fn clear_doubts(&mut self) {
        let [columns, rows] = self.blocks();
        self.doubts.clear();
        self.doubts.resize((columns * rows) as usize, 0.0);
    }

    /// The number of the block with a pixel, and where it begins.
    fn block_of(&self, pixel: usize) -> (u32, [u32; 2]) {
        let first = self.order.place(pixel).map(|n| n / BLOCK);
        (first[1] * self.blocks()[0] + first[0], first.map(|n| n * BLOCK))
    }

    /// Whether a pixel is the witness of its block; which of its pixels that is follows no pattern.
    pub(super) fn is_witness(&self, pixel: usize) -> bool {
        let (block, [x, y]) = self.block_of(pixel);
        let hash = block.wrapping_mul(0x9e37_79b9) >> 16;
        let size = [self.order.width() - x, self.order.height() - y].map(|n| n.min(BLOCK));
        let place = [x + hash % BLOCK % size[0], y + hash / BLOCK % BLOCK % size[1]];
        self.order.place(pixel) == place
    }

    /// How the first rays of a pixel and of those around it vary: at the tile's edges, of the nearest
    /// nine with it among them.
    pub(super) fn foretell(&self, pixel: usize) -> Option<Unevenness> {
        let size = [self.order.width(), self.order.height()];
        if size.iter().any(|n| *n < 3) {
            return None;
        }
        let place = self.order.place(pixel);
        let middle: [u32; 2] = std::array::from_fn(|a| place[a].clamp(1, size[a] - 2));
        let mut values = [[0.0; 4]; 9];
        for (n, value) in (0..9).zip(&mut values) {
            let number = self.order.number([middle[0] + n % 3 - 1, middle[1] + n / 3 - 1])?;
            *value = self.firsts[number].value.map(f64::from);
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
        self.firsts[pixel].bound
    }

    /// Whether the first ray of a pixel has met no more than `limit`.
    pub(super) fn is_first_dark(&self, pixel: usize, limit: f64) -> bool {
        self.firsts[pixel].value.iter().all(|&value| f64::from(value) <= limit)
    }

    /// What the first ray of the pixel so many steps beside the one at `place` has found.
    pub(super) fn first(&self, place: [u32; 2], steps: [i32; 2]) -> Option<[f64; 4]> {
        let number = self.order.beside(place, steps)?;
        Some(self.firsts[number].value.map(f64::from))
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
        let Some(foretold) = self.foretell(pixel) else { return };
        let missed = |c: usize| {
            let mean = 0.25 * quarters.iter().map(|value| value[c]).sum::<f64>();
            (mean - whole.value[c] - OF_QUARTERS * foretold.bend(c)).abs()
        };
        let missed = (0..4).map(missed).fold(0.0, f64::max) - foretold.likely();
        let block = self.block_of(pixel).0 as usize;
        self.doubts[block] = self.doubts[block].max(missed);
    }

    /// What neighbours have missed in the blocks around a pixel, at most.
    fn doubt_around(&self, pixel: usize) -> f64 {
        let (_, place) = self.block_of(pixel);
        let [x, y] = place.map(|n| n / BLOCK);
        let [columns, rows] = self.blocks();
        let near = |n: u32, count: u32| n.saturating_sub(1)..(n + 2).min(count);
        let around = near(y, rows).flat_map(|y| near(x, columns).map(move |x| [x, y]));
        around.map(|[x, y]| self.doubts[(y * columns + x) as usize]).fold(0.0, f64::max)
    }

    /// Takes a whole pixel by its first ray if its neighbours tell that its mean is close enough to
    /// it. Returns whether they do.
    pub(super) fn take_by_neighbours(&mut self, found: &Found) -> bool {
        let pixel = usize::from(found.square.pixel);
        let is_asked = found.square.halvings == 0 && !self.is_witness(pixel);
        if !is_asked || self.is_unknown(pixel) || self.is_off_itself(found) {
            return false;
        }
        let Some(foretold) = self.foretell(pixel) else { return false };
        let doubt = DOUBTS * self.doubt_around(pixel);
        let beside = self.pixels[pixel].beside_mean() + found.own();
        if foretold.likely() + foretold.most_bend() + doubt > self.room_for_mean(beside) {
            return false;
        }
        self.pixels[pixel].take_as_foretold(found, &foretold, doubt);
        true
    }

    /// Whether a ray may be off by so much itself that it does not stand for others: rays of its quarters are
    /// marched with more care, or through finer levels, should they be as well.
    fn is_off_itself(&self, found: &Found) -> bool {
        let ErrorShares { levels, digits, quadrature, .. } = found.shares();
        self.goal.is_some_and(|goal| levels + digits + quadrature > ALONE_SHARE * goal.tolerance)
    }

    /// Whether a pixel's neighbours say little: far more light may be in it than is known of, or pixels are
    /// so few that more rays are taken of each.
    fn is_unknown(&self, pixel: usize) -> bool {
        self.goal.is_none_or(|goal| {
            goal.least_halvings > 0
                || self.firsts[pixel].bound > UNKNOWN * goal.behind
                || self.is_dark_by_chance(&goal, pixel)
        })
    }

    /// Whether a whole pixel's bound is far above those of the pixels around it.
    pub(super) fn stands_out(&self, pixel: usize, bound: f64) -> bool {
        let place = self.order.place(pixel);
        let mut around = Vec::with_capacity(9);
        for n in (0..9).filter(|n| *n != 4) {
            let beside = [place[0] + n % 3, place[1] + n / 3].map(|n| n.checked_sub(1));
            let [Some(x), Some(y)] = beside else { continue };
            around.extend(self.order.number([x, y]).map(|number| self.firsts[number].bound));
        }
        around.sort_unstable_by(f64::total_cmp);
        around.len() < FEWEST_AROUND || bound > STANDS_OUT * around[around.len() / 2]
    }
}
