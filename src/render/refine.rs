//! What rays a tile's pixels take: more, and through finer levels, until no pixel may be off by
//! more than the goal.

use std::collections::VecDeque;

use super::cut::{Cut, ErrorCut};
use super::picture::Method;
use super::ray_error::ErrorShares;
use super::rays::{BATCH_RAYS, PixelGrid, PixelRect, Square};

/// The part of the goal that a first batch leaves to a single brick: few bricks along a ray are
/// off by as much as the cut allows.
const FIRST_LIMIT: f64 = 0.3;
/// The part of a pixel's error that may come from levels, of what levels and area may be off by.
const LEVELS_SHARE: f64 = 0.5;
/// A cut is made finer by at least, and at most, these factors.
const FINER: [f64; 2] = [0.5, 1.0 / 32.0];
/// Cuts that allow less than this part of the goal for a brick are none.
const SMALLEST_LIMIT: f64 = 1e-7;
/// Squares are not halved more often: their centres are exact to f64 then.
const MOST_HALVINGS: u8 = 30;
/// Batches that wait while coarser squares go first; beyond that finer ones do, so that few more
/// can come.
const MOST_WAITING: usize = 48;

/// How exact a picture must be.
#[derive(Debug, Clone, Copy)]
pub(super) struct Goal {
    /// The largest error of any channel of any pixel, in the picture's own unit.
    pub(super) tolerance: f64,
    /// Light that is expected from behind a brick.
    pub(super) behind: f64,
    /// Rays that a tile takes at most for each of its pixels, where these stand for areas.
    pub(super) rays_per_pixel: u64,
    /// Whether all levels are drawn whatever the tolerance.
    pub(super) all_levels: bool,
}

impl Goal {
    /// The cut that pixels begin with.
    pub(super) fn first_cut(&self) -> Cut {
        self.cut(FIRST_LIMIT * self.tolerance)
    }

    fn cut(&self, limit: f64) -> Cut {
        if self.all_levels || limit.is_nan() || limit <= SMALLEST_LIMIT * self.tolerance {
            Cut::FullDepth
        } else {
            Cut::Error(ErrorCut { limit, behind: self.behind })
        }
    }
}

/// Rays that are marched together.
pub(super) struct Batch {
    /// Pixel by pixel.
    pub(super) squares: Vec<Square>,
    pub(super) cut: Cut,
}

/// Squares that wait for their turn: to be quartered first, or as they are.
struct Waiting {
    squares: Vec<Square>,
    quartered: bool,
    cut: Cut,
}

/// What is known of a pixel so far.
#[derive(Debug, Clone, Copy, Default)]
struct Pixel {
    value: [f64; 4],
    shares: ErrorShares,
    /// The part of it that is known.
    weight: f64,
}

/// A tile's pixels while they are drawn.
#[derive(Default)]
pub(super) struct Sheet {
    pixels: Vec<Pixel>,
    finished: Vec<[f32; 4]>,
    /// Coarser squares first, as long as not too many wait.
    waiting: VecDeque<Waiting>,
    goal: Option<Goal>,
    /// Rays marched.
    rays: u64,
}

impl Sheet {
    /// Bytes that a sheet takes: pixels, the batch in hand and what a batch finds, and batches
    /// that wait: beyond the limit at most four for every halving.
    pub(super) const BYTES: u64 = (BATCH_RAYS
        * (size_of::<Pixel>()
            + size_of::<[f32; 4]>()
            + 3 * size_of::<Square>()
            + size_of::<(Square, [f64; 4], ErrorShares)>())
        + (MOST_WAITING + 4 * MOST_HALVINGS as usize) * BATCH_RAYS / 4 * size_of::<Square>())
        as u64;

    /// Begins with the pixels of `rect`.
    pub(super) fn start(&mut self, grid: &PixelGrid, rect: PixelRect, method: &Method) {
        self.pixels.clear();
        self.pixels.resize(rect.count(), Pixel::default());
        let mut squares = Vec::new();
        grid.first_squares(&rect, &mut squares);
        let cut = match method {
            Method::Once { cut, .. } => {
                self.goal = None;
                cut.clone()
            }
            Method::Within(goal) => {
                self.goal = Some(*goal);
                goal.first_cut()
            }
        };
        self.rays = 0;
        self.waiting.clear();
        self.waiting.push_back(Waiting { squares, quartered: false, cut });
    }

    /// The next rays to march; none when all pixels are known.
    pub(super) fn next(&mut self, grid: &PixelGrid) -> Option<Batch> {
        let next = if self.waiting.len() < MOST_WAITING {
            self.waiting.pop_front()
        } else {
            self.waiting.pop_back()
        };
        let Waiting { squares, quartered, cut } = next?;
        debug_assert!(grid.has_area() || !quartered);
        let squares =
            if quartered { squares.iter().flat_map(Square::quarters).collect() } else { squares };
        self.rays += squares.len() as u64;
        Some(Batch { squares, cut })
    }

    /// Takes what a batch has found: pixels that are close enough are known, the others' squares
    /// wait for more.
    pub(super) fn judge(
        &mut self,
        grid: &PixelGrid,
        batch: &Batch,
        outcome: impl Iterator<Item = (Square, [f64; 4], ErrorShares)>,
    ) {
        let outcome: Vec<_> = outcome.collect();
        let (mut quartered, mut finer) = (Vec::new(), Vec::new());
        let mut worst = 0.0_f64;
        let most = |goal: &Goal| goal.rays_per_pixel.saturating_mul(self.pixels.len() as u64);
        let can_go_on =
            self.goal.as_ref().is_some_and(|goal| !grid.has_area() || self.rays < most(goal));
        for found in outcome.chunk_by(|a, b| a.0.pixel == b.0.pixel) {
            let Some(pixel) = self.pixels.get_mut(usize::from(found[0].0.pixel)) else { continue };
            let weight = |square: &Square| grid.weight(square);
            let whole: f64 = found.iter().map(|(square, ..)| weight(square)).sum();
            let mut mean = ErrorShares::default();
            for (square, _, shares) in found {
                mean.add(shares, weight(square) / whole);
            }
            let allowed = self.goal.as_ref().map_or(f64::INFINITY, |goal| goal.tolerance);
            // What neither finer levels nor more rays change: no work is spent far below it.
            let fixed = mean.total() - mean.levels - mean.pixel_area;
            let rate = pixel.rate(allowed).max(2.0 * fixed);
            if mean.total() <= rate || !can_go_on {
                found.iter().for_each(|found| pixel.take(found, weight(&found.0)));
                continue;
            }
            let can_be_finer = !matches!(batch.cut, Cut::FullDepth);
            let room = rate - fixed;
            if can_be_finer && mean.levels > LEVELS_SHARE * room {
                worst = worst.max(mean.levels / room);
                finer.extend(found.iter().map(|(square, ..)| *square));
                continue;
            }
            for found in found {
                let (square, _, shares) = found;
                let small = shares.total() <= rate;
                if small || !grid.has_area() || square.halvings >= MOST_HALVINGS {
                    if !small && can_be_finer {
                        worst = worst.max(1.0);
                        finer.push(*square);
                    } else {
                        pixel.take(found, weight(square));
                    }
                } else {
                    quartered.push(*square);
                }
            }
        }
        self.wait(&quartered, BATCH_RAYS / 4, true, &batch.cut);
        if let (Some(goal), false) = (self.goal, finer.is_empty()) {
            let cut = match &batch.cut {
                Cut::Error(cut) => {
                    let factor = (0.5 * LEVELS_SHARE / worst).clamp(FINER[1], FINER[0]);
                    goal.cut(cut.limit * factor)
                }
                _ => Cut::FullDepth,
            };
            self.wait(&finer, BATCH_RAYS, false, &cut);
        }
    }

    fn wait(&mut self, squares: &[Square], most: usize, quartered: bool, cut: &Cut) {
        for squares in squares.chunks(most) {
            self.waiting.push_back(Waiting {
                squares: squares.to_vec(),
                quartered,
                cut: cut.clone(),
            });
        }
    }

    /// The largest of each share over the tile's pixels.
    pub(super) fn shares(&self) -> ErrorShares {
        let largest =
            |a: &ErrorShares, b: &ErrorShares| if a.total() < b.total() { *b } else { *a };
        self.pixels.iter().fold(ErrorShares::default(), |most, pixel| largest(&most, &pixel.shares))
    }

    /// The tile's pixels, row by row: R, G, B, A.
    pub(super) fn pixels(&mut self) -> &[[f32; 4]] {
        self.finished.clear();
        self.finished.extend(self.pixels.iter().map(|p| p.value.map(|channel| channel as f32)));
        &self.finished
    }
}

impl Pixel {
    /// The error that a square of what is not known yet may have on average, where the whole may
    /// have `allowed`.
    fn rate(&self, allowed: f64) -> f64 {
        let open = 1.0 - self.weight;
        if open > 1e-9 { ((allowed - self.shares.total()) / open).max(allowed) } else { allowed }
    }

    fn take(&mut self, (_, value, shares): &(Square, [f64; 4], ErrorShares), weight: f64) {
        for (sum, value) in self.value.iter_mut().zip(value) {
            *sum += weight * value;
        }
        self.shares.add(shares, weight);
        self.weight += weight;
    }
}

#[cfg(test)]
#[path = "refine_tests.rs"]
mod tests;
