//! What rays a tile's pixels take: more, and through finer levels, until no pixel may be off by
//! more than the goal.

use super::cut::{Cut, ErrorCut};
use super::grade::Care;
use super::picture::Method;
use super::ray_error::ErrorShares;
use super::rays::{BATCH_RAYS, PixelGrid, PixelRect, Square};
use super::waiting::{Found, GROUP_PIXELS, ToDo, Waiting};

/// The part of the goal that a first batch leaves to a single brick: few bricks along a ray are
/// off by as much as the cut allows.
const FIRST_LIMIT: f64 = 0.3;
/// The part of a pixel's error that may come from levels, of what levels and area may be off by.
const LEVELS_SHARE: f64 = 0.5;
/// The part that may come from the march of packets, likewise.
const MARCH_SHARE: f64 = 0.4;
/// A cut is made finer by at least, and at most, these factors.
const FINER: [f64; 2] = [0.5, 1.0 / 32.0];
/// Cuts that allow less than this part of the goal for a brick are none.
const SMALLEST_LIMIT: f64 = 1e-7;
/// Squares are not halved more often: their centres are exact to f64 then.
const MOST_HALVINGS: u8 = 30;
/// Rays a pixel after which a group of pixels is looked at: whether more rays can do.
const TRIAL_RAYS: u64 = 16;
/// Pixels stand out that are off by more than this many times the median.
const STANDS_OUT: f64 = 2.0;

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
    pub(super) care: Care,
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
    waiting: Waiting,
    goal: Option<Goal>,
    /// Rays marched.
    rays: u64,
    group: Option<GroupInHand>,
}

/// The pixels that are being refined.
#[derive(Debug, Clone, Copy)]
struct GroupInHand {
    number: usize,
    /// Rays marched before.
    begun: u64,
    /// What its pixels may be off by, once that is settled: the tolerance, or more where there is
    /// no prospect of that.
    allowed: Option<f64>,
}

impl Sheet {
    /// Bytes that a sheet takes: pixels, the batch in hand and what it finds, and squares that
    /// wait.
    pub(super) const BYTES: u64 = Waiting::BYTES
        + (BATCH_RAYS
            * (size_of::<Pixel>()
                + size_of::<[f32; 4]>()
                + 2 * size_of::<Square>()
                + 3 * size_of::<Found>())) as u64;

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
        self.group = None;
        self.waiting.clear();
        self.first = Some(Batch { squares, cut, care: Care::Rough });
    }

    /// The next rays to march; none when all pixels are known.
    pub(super) fn next(&mut self, grid: &PixelGrid) -> Option<Batch> {
        let batch = self.first.take().or_else(|| self.most_urgent(grid))?;
        self.rays += batch.squares.len() as u64;
        Some(batch)
    }

    /// The squares of the first pixels that harm these most, without those that have become good
    /// enough because others have turned out better than they had to be.
    fn most_urgent(&mut self, grid: &PixelGrid) -> Option<Batch> {
        while let Some((group, mut found, to_do)) = self.waiting.pop() {
            let is_over = self.is_over(grid, group);
            self.settle(grid, group, &found);
            found.sort_by_key(|(square, ..)| square.pixel);
            let mut squares = Vec::new();
            for found in found.chunk_by(|a, b| a.0.pixel == b.0.pixel) {
                let (pixel, room, mean) = self.pixel(grid, found, to_do.before);
                let is_good = movable(&mean, to_do.before) <= room;
                for found in found {
                    if is_over || is_good || movable(&found.2, to_do.before) <= room {
                        self.pixels[pixel].take(found, grid.weight(&found.0));
                    } else if to_do.quartered {
                        squares.extend(found.0.quarters());
                    } else {
                        squares.push(found.0);
                    }
                }
            }
            if !squares.is_empty() {
                let ToDo { cut, care, .. } = to_do;
                return Some(Batch { squares, cut, care });
            }
        }
        None
    }

    /// Whether no more rays may be marched for a group of pixels.
    fn is_over(&self, grid: &PixelGrid, group: usize) -> bool {
        let Some(Goal { rays_per_pixel, .. }) = self.goal else { return true };
        // Each pixel has taken one ray in the first batch.
        let pixels = ((group + 1) * GROUP_PIXELS).min(self.pixels.len()) as u64;
        let others = self.rays.saturating_sub(self.pixels.len() as u64);
        grid.has_area() && others >= rays_per_pixel.saturating_sub(1).saturating_mul(pixels)
    }

    /// After [`TRIAL_RAYS`] for each pixel of a group, looks at whether most of them can come within
    /// the tolerance with the rays that are left: bounds fall at best in proportion to rays. Where
    /// not, rays go to those alone that stand out. `found` are squares that wait as well.
    fn settle(&mut self, grid: &PixelGrid, number: usize, found: &[Found]) {
        let Some(goal) = self.goal.filter(|goal| grid.has_area() && !goal.all_levels) else {
            return;
        };
        let begun = match self.group {
            Some(GroupInHand { number: current, allowed, begun }) if current == number => {
                if allowed.is_some() {
                    return;
                }
                begun
            }
            _ => self.rays,
        };
        let mut allowed = None;
        let first = number * GROUP_PIXELS;
        let count = GROUP_PIXELS.min(self.pixels.len() - first);
        if self.rays - begun >= TRIAL_RAYS * count as u64 {
            let median = self.median_bound(grid, number, found);
            let left = goal.rays_per_pixel as f64 / TRIAL_RAYS as f64;
            let is_within_reach = median <= left * goal.tolerance;
            allowed = Some(if is_within_reach { goal.tolerance } else { STANDS_OUT * median });
        }
        self.group = Some(GroupInHand { number, begun, allowed });
    }

    /// The median of what a group's pixels are off by.
    fn median_bound(&self, grid: &PixelGrid, number: usize, found: &[Found]) -> f64 {
        let first = number * GROUP_PIXELS;
        let pixels = self.pixels.iter().skip(first).take(GROUP_PIXELS);
        let mut bounds: Vec<f64> = pixels.map(|pixel| pixel.shares.total()).collect();
        for (square, _, shares) in self.waiting.of_group(number).chain(found) {
            bounds[usize::from(square.pixel) - first] += grid.weight(square) * shares.total();
        }
        bounds.sort_unstable_by(f64::total_cmp);
        bounds[bounds.len() / 2]
    }

    /// What a pixel may be off by.
    fn allowed(&self, pixel: usize) -> f64 {
        let group = self.group.filter(|group| group.number == pixel / GROUP_PIXELS);
        match (self.goal, group.and_then(|group| group.allowed)) {
            (None, _) => f64::INFINITY,
            (Some(_), Some(allowed)) => allowed,
            (Some(goal), None) => goal.tolerance,
        }
    }

    /// The pixel of what was found, what these squares may be off by on average beside what work
    /// cannot change, and what they are.
    fn pixel(&self, grid: &PixelGrid, found: &[Found], care: Care) -> (usize, f64, ErrorShares) {
        let whole: f64 = found.iter().map(|(square, ..)| grid.weight(square)).sum();
        let mut mean = ErrorShares::default();
        for (square, _, shares) in found {
            mean.add(shares, grid.weight(square) / whole);
        }
        let pixel = usize::from(found[0].0.pixel);
        let allowed = self.allowed(pixel);
        // Beside what work cannot change, as much again, within the tolerance for itself.
        let done = if care == Care::Exact { mean.quadrature } else { 0.0 };
        let fixed = done + mean.storage + mean.termination + mean.rounding;
        let room = (self.pixels[pixel].rate(allowed) - fixed).max(fixed.min(allowed));
        (pixel, room, mean)
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
        let (mut quartered, mut finer, mut careful) = (Vec::new(), Vec::new(), Vec::new());
        let mut worst = 0.0_f64;
        let can_be_finer = !matches!(batch.cut, Cut::FullDepth);
        for found in outcome.chunk_by(|a, b| a.0.pixel == b.0.pixel) {
            let (pixel, room, mean) = self.pixel(grid, found, batch.care);
            let is_good = movable(&mean, batch.care) <= room;
            let is_taken = is_good || self.is_over(grid, pixel / GROUP_PIXELS);
            if !is_taken && batch.care != Care::Exact && mean.quadrature > MARCH_SHARE * room {
                careful.extend(found);
                continue;
            }
            if !is_taken && can_be_finer && mean.levels > LEVELS_SHARE * room {
                worst = worst.max(mean.levels / room);
                finer.extend(found);
                continue;
            }
            for found in found {
                let (square, _, shares) = found;
                let is_taken = is_taken || movable(shares, batch.care) <= room;
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
        let (before, cut) = (batch.care, batch.cut.clone());
        let to_do = ToDo { quartered: false, cut, before, care: before.more() };
        self.wait(grid, &careful, &to_do);
        self.wait(grid, &quartered, &ToDo { quartered: true, care: before, ..to_do });
        if let (Some(goal), false) = (self.goal, finer.is_empty()) {
            let cut = match &batch.cut {
                Cut::Error(cut) => {
                    let factor = (0.5 * LEVELS_SHARE / worst).clamp(FINER[1], FINER[0]);
                    // Few different cuts, so that many squares share one.
                    goal.cut(cut.limit * factor.log2().floor().exp2())
                }
                _ => Cut::FullDepth,
            };
            self.wait(grid, &finer, &ToDo { quartered: false, cut, before, care: before });
        }
    }

    /// Lets squares wait; what there is no room for is taken as it is.
    fn wait(&mut self, grid: &PixelGrid, squares: &[Found], to_do: &ToDo) {
        for found in squares {
            let weight = grid.weight(&found.0);
            let harms = grid.has_area().then_some(weight);
            if !self.waiting.push(*found, harms, to_do) {
                self.pixels[usize::from(found.0.pixel)].take(found, weight);
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

/// What finer levels, more rays or more care than `care` change.
fn movable(shares: &ErrorShares, care: Care) -> f64 {
    let march = if care == Care::Exact { 0.0 } else { shares.quadrature };
    shares.levels + shares.pixel_area + march
}

#[cfg(test)]
#[path = "refine_tests.rs"]
mod tests;
