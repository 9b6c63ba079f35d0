//! What rays a tile's pixels take: more, and through finer levels, until no pixel may be off by
//! more than the goal.

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
/// Squares that may wait while those go first whose pixels they harm most; beyond that those go
/// first that harm least, so that few more can come.
const MOST_WAITING: usize = 16 << 10;
/// Beyond this squares are taken as they are.
const WAITING_LIMIT: usize = 2 * MOST_WAITING;

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

/// What a ray has found: its square, radiance and opacity, and what they may be off by.
type Found = (Square, [f64; 4], ErrorShares);

/// Squares that wait for their turn, alike in what is to be done with them and in the harm that
/// they do.
struct Waiting {
    found: Vec<Found>,
    /// To be quartered first, or marched as they are.
    quartered: bool,
    cut: Cut,
    harm: i32,
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
    first: Option<Batch>,
    waiting: Vec<Waiting>,
    goal: Option<Goal>,
    /// Rays marched.
    rays: u64,
}

impl Sheet {
    /// Bytes that a sheet takes: pixels, the batch in hand and what it finds, and squares that
    /// wait, in vectors that have grown to at most twice what they hold.
    pub(super) const BYTES: u64 =
        (BATCH_RAYS * (size_of::<Pixel>() + size_of::<[f32; 4]>() + 2 * size_of::<Square>())
            + (3 * BATCH_RAYS + 2 * WAITING_LIMIT) * size_of::<Found>()) as u64;

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
        self.first = Some(Batch { squares, cut });
    }

    /// The next rays to march; none when all pixels are known.
    pub(super) fn next(&mut self, grid: &PixelGrid) -> Option<Batch> {
        let batch = self.first.take().or_else(|| self.most_urgent(grid))?;
        self.rays += batch.squares.len() as u64;
        Some(batch)
    }

    /// The squares that wait and harm their pixels most, without those that have become good
    /// enough because others have turned out better than they had to be.
    fn most_urgent(&mut self, grid: &PixelGrid) -> Option<Batch> {
        let is_full = self.waiting() >= MOST_WAITING;
        let urgency =
            |group: &Waiting| if is_full { group.harm.saturating_neg() } else { group.harm };
        while let Some(number) = (0..self.waiting.len()).max_by_key(|n| urgency(&self.waiting[*n]))
        {
            let Waiting { mut found, quartered, cut, .. } = self.waiting.swap_remove(number);
            found.sort_by_key(|(square, ..)| square.pixel);
            let mut squares = Vec::new();
            for found in found.chunk_by(|a, b| a.0.pixel == b.0.pixel) {
                let (pixel, rate, mean) = self.pixel(grid, found);
                for found in found {
                    if self.is_over(grid) || mean.total().min(found.2.total()) <= rate {
                        self.pixels[pixel].take(found, grid.weight(&found.0));
                    } else if quartered {
                        squares.extend(found.0.quarters());
                    } else {
                        squares.push(found.0);
                    }
                }
            }
            if !squares.is_empty() {
                return Some(Batch { squares, cut });
            }
        }
        None
    }

    /// Squares that wait.
    fn waiting(&self) -> usize {
        self.waiting.iter().map(|group| group.found.len()).sum()
    }

    /// Whether no more rays may be marched.
    fn is_over(&self, grid: &PixelGrid) -> bool {
        let most = |goal: Goal| goal.rays_per_pixel.saturating_mul(self.pixels.len() as u64);
        self.goal.is_none_or(|goal| grid.has_area() && self.rays >= most(goal))
    }

    /// The pixel of what was found, what these squares may be off by on average, and what they
    /// are.
    fn pixel(&self, grid: &PixelGrid, found: &[Found]) -> (usize, f64, ErrorShares) {
        let whole: f64 = found.iter().map(|(square, ..)| grid.weight(square)).sum();
        let mut mean = ErrorShares::default();
        for (square, _, shares) in found {
            mean.add(shares, grid.weight(square) / whole);
        }
        let pixel = usize::from(found[0].0.pixel);
        let allowed = self.goal.map_or(f64::INFINITY, |goal| goal.tolerance);
        // No work is spent far below what it cannot change.
        (pixel, self.pixels[pixel].rate(allowed).max(2.0 * fixed(&mean)), mean)
    }

    /// Takes what a batch has found: pixels that are close enough are known, the others' squares
    /// wait for more.
    pub(super) fn judge(
        &mut self,
        grid: &PixelGrid,
        batch: &Batch,
        outcome: impl Iterator<Item = Found>,
    ) {
        let outcome: Vec<_> = outcome.collect();
        let (mut quartered, mut finer) = (Vec::new(), Vec::new());
        let mut worst = 0.0_f64;
        let can_be_finer = !matches!(batch.cut, Cut::FullDepth);
        for found in outcome.chunk_by(|a, b| a.0.pixel == b.0.pixel) {
            let (pixel, rate, mean) = self.pixel(grid, found);
            let is_taken = mean.total() <= rate || self.is_over(grid);
            let room = rate - fixed(&mean);
            if !is_taken && can_be_finer && mean.levels > LEVELS_SHARE * room {
                worst = worst.max(mean.levels / room);
                finer.extend(found);
                continue;
            }
            for found in found {
                let (square, _, shares) = found;
                let is_taken = is_taken || shares.total() <= rate;
                if !is_taken && grid.has_area() && square.halvings < MOST_HALVINGS {
                    quartered.push(*found);
                } else if !is_taken && can_be_finer {
                    worst = worst.max(1.0);
                    finer.push(*found);
                } else {
                    self.pixels[pixel].take(found, grid.weight(square));
                }
            }
        }
        self.wait(grid, &quartered, true, &batch.cut);
        if let (Some(goal), false) = (self.goal, finer.is_empty()) {
            let cut = match &batch.cut {
                Cut::Error(cut) => {
                    let factor = (0.5 * LEVELS_SHARE / worst).clamp(FINER[1], FINER[0]);
                    // Few different cuts, so that many squares share one.
                    goal.cut(cut.limit * factor.log2().floor().exp2())
                }
                _ => Cut::FullDepth,
            };
            self.wait(grid, &finer, false, &cut);
        }
    }

    fn wait(&mut self, grid: &PixelGrid, squares: &[Found], quartered: bool, cut: &Cut) {
        let mut room = WAITING_LIMIT.saturating_sub(self.waiting());
        let most = if quartered { BATCH_RAYS / 4 } else { BATCH_RAYS };
        for found in squares {
            let weight = grid.weight(&found.0);
            if room == 0 {
                self.pixels[usize::from(found.0.pixel)].take(found, weight);
                continue;
            }
            room -= 1;
            let harm = harm(weight * found.2.total());
            let is_alike = |group: &&mut Waiting| {
                (group.quartered, group.harm) == (quartered, harm)
                    && group.cut == *cut
                    && group.found.len() < most
            };
            match self.waiting.iter_mut().find(is_alike) {
                Some(group) => group.found.push(*found),
                None => {
                    let (found, cut) = (vec![*found], cut.clone());
                    self.waiting.push(Waiting { found, quartered, cut, harm });
                }
            }
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

    fn take(&mut self, (_, value, shares): &Found, weight: f64) {
        for (sum, value) in self.value.iter_mut().zip(value) {
            *sum += weight * value;
        }
        self.shares.add(shares, weight);
        self.weight += weight;
    }
}

/// What neither finer levels nor more rays change.
fn fixed(shares: &ErrorShares) -> f64 {
    shares.total() - shares.levels - shares.pixel_area
}

/// Orders squares by what they may add to their pixels' errors, in powers of four.
fn harm(error: f64) -> i32 {
    if error.is_finite() { (0.5 * error.log2()).floor() as i32 } else { i32::MAX }
}

#[cfg(test)]
#[path = "refine_tests.rs"]
mod tests;
