//! What rays a tile's pixels take: more, and through finer levels, until no pixel may be off by
//! more than the goal; where no number of rays would do for that, until none is by all likelihood.

use std::array::from_fn;

use super::cut::{Cut, ErrorCut};
use super::grade::Care;
use super::picture::Method;
use super::pixel::Pixel;
use super::ray_error::ErrorShares;
use super::rays::{BATCH_RAYS, PixelGrid, PixelRect, Square};
use super::waiting::{Found, GROUP_PIXELS, ToDo, Unevenness, Waiting};

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
/// A pixel is taken to need no more rays than this: cores that shine are refined where they are.
const MOST_NEEDED: f64 = 1024.0;
/// Bounds that fall with a larger power of the number of rays fall fast: squares leave something
/// behind that is small and bright.
const FAST: f64 = 2.0;
/// The slowest that bounds are taken to fall: with this power of the number of rays.
const SLOWEST: f64 = 0.05;
/// The parts of a tolerance that a mean of rays that stand for themselves may be off by, and that
/// are room for what these are off by themselves.
const MEAN_SHARE: f64 = 0.45;
const ALONE_SHARE: f64 = 0.6;
/// A quarter of a square stands out that may do more than this part of the square's harm, and more
/// than this part of the median pixel's.
const STANDS_OUT: f64 = 0.4;
const SMALL_HARM: f64 = 0.125;

/// How exact a picture must be.
#[derive(Debug, Clone, Copy)]
pub(super) struct Goal {
    /// The largest error of any channel of any pixel, in the picture's own unit.
    pub(super) tolerance: f64,
    /// Light that is expected from behind a brick.
    pub(super) behind: f64,
    /// Rays that a tile takes at most for each of its pixels, where these stand for areas.
    pub(super) rays_per_pixel: u64,
    /// The same with rays that stand for themselves.
    pub(super) alone_per_pixel: u64,
    /// Whether there is a prospect of the tolerance for all pixels' bounds, so that rays are spent
    /// on these.
    pub(super) certifies: bool,
    /// The power of the number of rays that bounds fall with, until a group of pixels knows its own.
    pub(super) power: f64,
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
    /// Whether they stand for their squares, not for themselves.
    pub(super) has_area: bool,
    /// What they are quarters of, in order; none where they are squares marched again.
    wholes: Vec<Found>,
}

/// How far a tile's worst pixel is off.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct TileError {
    /// At most, by cause.
    pub(super) shares: ErrorShares,
    /// In all likelihood, where that bound is above the tolerance.
    pub(super) estimate: f64,
    /// The power of the number of rays that bounds of areas have fallen with, and how many rays
    /// pixels need on average if they go on so.
    pub(super) power: f64,
    pub(super) rays_needed: f64,
}

/// Squares to be marched again, or others to be quartered.
#[derive(Default)]
struct Todo {
    again: Vec<Square>,
    wholes: Vec<Found>,
}

/// A tile's pixels while they are drawn.
#[derive(Default)]
pub(super) struct Sheet {
    pixels: Vec<Pixel>,
    /// Pixels of a row.
    width: usize,
    finished: Vec<[f32; 4]>,
    first: Option<Batch>,
    waiting: Waiting,
    goal: Option<Goal>,
    /// Rays marched: with accounts of what they stand for, and for themselves in areas.
    rays: u64,
    alone: u64,
    /// What squares that were quartered might be off by, and what their quarters may.
    fallen: [f64; 2],
    group: Option<GroupInHand>,
}

/// The pixels that are being refined.
#[derive(Debug, Clone, Copy)]
struct GroupInHand {
    number: usize,
    /// Rays marched before.
    begun: u64,
    /// What those of the last batch might be off by, and what their quarters may.
    fallen: [f64; 2],
    /// Where there is no prospect of the tolerance: what its pixels may be off by, in the median.
    /// What stands out is still scouted for.
    scouts: Option<f64>,
}

/// The power of the number of rays that bounds fall with, of what they were before each square was
/// quartered and after: 1 where they are second order in the square's width, and far more where
/// what is small and bright leaves most of the quarters. None before any was.
fn power([before, after]: [f64; 2]) -> Option<f64> {
    (before > 0.0).then(|| ((before / after).ln() / 4f64.ln()).max(SLOWEST))
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
        self.width = rect.columns().len();
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
        (self.rays, self.alone) = (0, 0);
        self.fallen = [0.0; 2];
        self.group = None;
        self.waiting.clear();
        let has_area = grid.has_area();
        self.first = Some(Batch { squares, cut, care: Care::Rough, has_area, wholes: Vec::new() });
    }

    /// The next rays to march; none when all pixels are known.
    pub(super) fn next(&mut self, grid: &PixelGrid) -> Option<Batch> {
        let batch = self.first.take().or_else(|| self.most_urgent(grid))?;
        let is_alone = grid.has_area() && !batch.has_area;
        let rays = if is_alone { &mut self.alone } else { &mut self.rays };
        *rays += batch.squares.len() as u64;
        Some(batch)
    }

    /// The squares of the first pixels that harm these most, without those that have become good
    /// enough because others have turned out better than they had to be.
    fn most_urgent(&mut self, grid: &PixelGrid) -> Option<Batch> {
        while let Some((group, mut found, to_do)) = self.waiting.pop() {
            found.sort_by_key(|found| found.square.pixel);
            let Todo { again, wholes } = if to_do.alone {
                Todo { again: Vec::new(), wholes: self.still_unsure(grid, group, found) }
            } else {
                self.settle(grid, group, &found);
                self.still_bad(grid, group, &found, &to_do)
            };
            let mut squares = again;
            squares.extend(wholes.iter().flat_map(|whole| whole.square.quarters()));
            if !squares.is_empty() {
                let ToDo { cut, care, alone, .. } = to_do;
                let has_area = grid.has_area() && !alone;
                return Some(Batch { squares, cut, care, has_area, wholes });
            }
        }
        None
    }

    /// Of squares found of a group of pixels, those that are to be marched again, or quartered.
    fn still_bad(&mut self, grid: &PixelGrid, group: usize, found: &[Found], to_do: &ToDo) -> Todo {
        let is_over = self.is_over(grid, group);
        let scouts = self.scouts(group);
        let mut todo = Todo::default();
        for found in found.chunk_by(|a, b| a.square.pixel == b.square.pixel) {
            let (_, room, mean) = self.pixel(grid, found, to_do.before);
            let is_good = movable(&mean, to_do.before) <= room;
            for found in found {
                let bound = movable(&found.shares, to_do.before);
                let harm = grid.weight(&found.square) * bound;
                let stands_out = |median| match found.square.halvings {
                    0 => harm > median,
                    _ => harm > SMALL_HARM * median,
                };
                if is_over || is_good || bound <= room || !scouts.is_none_or(stands_out) {
                    self.conclude(grid, found, to_do);
                } else if to_do.quartered || scouts.is_some() {
                    todo.wholes.push(*found);
                } else {
                    todo.again.push(found.square);
                }
            }
        }
        todo
    }

    /// Those of a group's squares that are to be quartered for their pixels' mean.
    fn still_unsure(&mut self, grid: &PixelGrid, group: usize, found: Vec<Found>) -> Vec<Found> {
        let is_over = self.is_over_alone(group);
        let (taken, left): (Vec<_>, Vec<_>) = found.into_iter().partition(|found| {
            is_over || found.square.halvings >= MOST_HALVINGS || self.is_likely(found)
        });
        for found in taken {
            self.pixels[usize::from(found.square.pixel)].draw(&found, grid.weight(&found.square));
        }
        left
    }

    /// Whether a quarter's pixel is close enough in all likelihood. Four rays may be alike by
    /// accident: their pixel's neighbours are asked as well.
    fn is_likely(&self, found: &Found) -> bool {
        let pixel = usize::from(found.square.pixel);
        let least = if found.square.halvings == 1 { self.variance_around(pixel) } else { 0.0 };
        let tolerance = self.goal.map_or(f64::INFINITY, |goal| goal.tolerance);
        self.pixels[pixel].unlikely(least) <= MEAN_SHARE * tolerance
    }

    /// What a pixel and those beside it have as their first variance on average.
    fn variance_around(&self, pixel: usize) -> f64 {
        let [x, y] = [pixel % self.width, pixel / self.width];
        let rows = y.saturating_sub(1)..=y + 1;
        let columns = x.saturating_sub(1)..=(x + 1).min(self.width - 1);
        let around = rows.flat_map(|y| columns.clone().map(move |x| [x, y]));
        let known = around
            .filter_map(|[x, y]| self.pixels.get(y * self.width + x))
            .filter_map(Pixel::first_variance);
        let (count, sum) = known.fold((0.0, 0.0), |(n, sum), variance| (n + 1.0, sum + variance));
        if count > 0.0 { sum / count } else { 0.0 }
    }

    /// Takes a square as it is if its bound is as small as the tolerance asks; else its pixel's
    /// mean is left to rays that stand for themselves, if that may be.
    fn conclude(&mut self, grid: &PixelGrid, found: &Found, marched: &ToDo) {
        let weight = grid.weight(&found.square);
        let pixel = usize::from(found.square.pixel);
        let may_be = |goal: &Goal| {
            let is_bad = found.shares.total() > self.pixels[pixel].rate(goal.tolerance);
            is_bad && grid.has_area() && !goal.all_levels
        };
        if self.goal.as_ref().is_some_and(may_be) {
            let alone = ToDo { quartered: true, alone: true, ..marched.clone() };
            self.pixels[pixel].leave(found, weight);
            if !self.waiting.push(*found, Some(weight), &alone) {
                self.pixels[pixel].draw(found, weight);
            }
        } else {
            self.pixels[pixel].take(found, weight);
        }
    }

    /// Whether no more rays may be marched that stand for squares of a group of pixels.
    fn is_over(&self, grid: &PixelGrid, group: usize) -> bool {
        let Some(goal) = &self.goal else { return true };
        // Each pixel has taken one ray in the first batch.
        let others = self.rays.saturating_sub(self.pixels.len() as u64);
        grid.has_area() && others >= self.rays_up_to(group, goal.rays_per_pixel.saturating_sub(1))
    }

    /// The same for rays that stand for themselves.
    fn is_over_alone(&self, group: usize) -> bool {
        self.goal.is_none_or(|goal| self.alone >= self.rays_up_to(group, goal.alone_per_pixel))
    }

    /// Rays for the pixels of all groups up to this one.
    fn rays_up_to(&self, group: usize, per_pixel: u64) -> u64 {
        let pixels = ((group + 1) * GROUP_PIXELS).min(self.pixels.len());
        per_pixel.saturating_mul(pixels as u64)
    }

    /// Looks at whether most pixels of a group can come within the tolerance with the rays that are
    /// left, if bounds go on falling as they have. Where not, rays that stand for squares go only
    /// where something small may shine. `found` are squares that wait as well.
    fn settle(&mut self, grid: &PixelGrid, number: usize, found: &[Found]) {
        let Some(goal) = self.goal.filter(|goal| grid.has_area() && !goal.all_levels) else {
            return;
        };
        let begins = GroupInHand { number, begun: self.rays, fallen: [0.0; 2], scouts: None };
        let mut group = self.group.filter(|group| group.number == number).unwrap_or(begins);
        if group.scouts.is_none() {
            let count = GROUP_PIXELS.min(self.pixels.len() - number * GROUP_PIXELS);
            let taken = 1.0 + (self.rays - group.begun) as f64 / count as f64;
            let median = self.median_bound(grid, number, found);
            let power = power(group.fallen).unwrap_or(goal.power);
            let left = (goal.rays_per_pixel as f64 / taken).powf(power);
            // What falls as fast as that has not shown yet what will be left.
            let has_prospect = power > FAST || goal.certifies && median <= left * goal.tolerance;
            group.scouts = (!has_prospect).then_some(median);
        }
        self.group = Some(group);
    }

    /// The median of what a group's pixels are off by.
    fn median_bound(&self, grid: &PixelGrid, number: usize, found: &[Found]) -> f64 {
        let first = number * GROUP_PIXELS;
        let pixels = self.pixels.iter().skip(first).take(GROUP_PIXELS);
        let mut bounds: Vec<f64> = pixels.map(|pixel| pixel.shares.total()).collect();
        for Found { square, shares, .. } in self.waiting.of_group(number).chain(found) {
            bounds[usize::from(square.pixel) - first] += grid.weight(square) * shares.total();
        }
        bounds.sort_unstable_by(f64::total_cmp);
        bounds[bounds.len() / 2]
    }

    /// The median of what a group's pixels may be off by, if there is no prospect of less.
    fn scouts(&self, group: usize) -> Option<f64> {
        self.group.filter(|in_hand| in_hand.number == group).and_then(|group| group.scouts)
    }

    /// The pixel of what was found, what these squares may be off by on average beside what work
    /// cannot change, and what they are.
    fn pixel(&self, grid: &PixelGrid, found: &[Found], care: Care) -> (usize, f64, ErrorShares) {
        let whole: f64 = found.iter().map(|found| grid.weight(&found.square)).sum();
        let mut mean = ErrorShares::default();
        for Found { square, shares, .. } in found {
            mean.add(shares, grid.weight(square) / whole);
        }
        let pixel = usize::from(found[0].square.pixel);
        let allowed = self.goal.map_or(f64::INFINITY, |goal| goal.tolerance);
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
        let mut next = Next::default();
        let alone = grid.has_area() && !batch.has_area;
        let scouts = self.group.and_then(|group| group.scouts);
        match scouts.filter(|_| !batch.wholes.is_empty()) {
            _ if alone => self.judge_quarters(grid, batch, &outcome, &mut next),
            Some(median) => self.judge_scouts(grid, (batch, median), &outcome, &mut next),
            None => {
                self.compare(grid, batch, &outcome);
                self.judge_squares(grid, batch, &outcome, &mut next);
            }
        }
        let (before, cut) = (batch.care, batch.cut.clone());
        let to_do = ToDo { quartered: alone, cut, before, care: before.more(), alone };
        self.wait(grid, &next.careful, &to_do);
        self.wait(grid, &next.quartered, &ToDo { quartered: true, care: before, ..to_do });
        if let (Some(goal), false) = (self.goal, next.finer.is_empty()) {
            let cut = match &batch.cut {
                Cut::Error(cut) => {
                    let factor = (0.5 * LEVELS_SHARE / next.worst).clamp(FINER[1], FINER[0]);
                    // Few different cuts, so that many squares share one.
                    goal.cut(cut.limit * factor.log2().floor().exp2())
                }
                _ => Cut::FullDepth,
            };
            self.wait(
                grid,
                &next.finer,
                &ToDo { quartered: alone, cut, before, care: before, alone },
            );
        }
    }

    fn judge_squares(
        &mut self,
        grid: &PixelGrid,
        batch: &Batch,
        outcome: &[Found],
        next: &mut Next,
    ) {
        let (cut, care) = (batch.cut.clone(), batch.care);
        let marched = ToDo { quartered: false, cut, before: care, care, alone: false };
        let can_be_finer = !matches!(batch.cut, Cut::FullDepth);
        for found in outcome.chunk_by(|a, b| a.square.pixel == b.square.pixel) {
            let (pixel, room, mean) = self.pixel(grid, found, care);
            let is_good = movable(&mean, care) <= room;
            let is_taken = is_good || self.is_over(grid, pixel / GROUP_PIXELS);
            if !is_taken && next.takes(found, &mean, room, batch) {
                continue;
            }
            for found in found {
                let is_taken = is_taken || movable(&found.shares, care) <= room;
                if !is_taken && grid.has_area() && found.square.halvings < MOST_HALVINGS {
                    next.quartered.push(*found);
                } else if !is_taken && can_be_finer {
                    next.worst = next.worst.max(1.0);
                    next.finer.push(*found);
                } else {
                    self.conclude(grid, found, &marched);
                }
            }
        }
    }

    /// Of quarters in a group without prospect, whose pixels may be off by `median`: those are
    /// looked into further in which most of what their whole may be off by has stayed, or that may
    /// do more harm than that, as something small may be there that shines.
    fn judge_scouts(
        &mut self,
        grid: &PixelGrid,
        (batch, median): (&Batch, f64),
        outcome: &[Found],
        next: &mut Next,
    ) {
        let (cut, care) = (batch.cut.clone(), batch.care);
        let marched = ToDo { quartered: false, cut, before: care, care, alone: false };
        let tolerance = self.goal.map_or(f64::INFINITY, |goal| goal.tolerance);
        for (whole, quarters) in batch.wholes.iter().zip(outcome.chunks_exact(4)) {
            let uneven = Unevenness::of(whole, from_fn(|n| &quarters[n].value));
            let harm = |found: &Found| grid.weight(&found.square) * movable(&found.shares, care);
            let most = (STANDS_OUT * harm(whole)).min(median);
            for quarter in quarters {
                let shares = &quarter.shares;
                if harm(quarter) > most && quarter.square.halvings < MOST_HALVINGS {
                    next.quartered.push(*quarter);
                    continue;
                }
                // Rays that are off by too much themselves say nothing of others.
                let is_exact = shares.quadrature <= MARCH_SHARE * tolerance
                    && shares.levels <= LEVELS_SHARE * tolerance;
                let uneven = is_exact.then_some(uneven);
                self.conclude(grid, &Found { uneven, ..*quarter }, &marched);
            }
        }
    }

    /// Notes how far bounds have fallen from squares to their quarters.
    fn compare(&mut self, grid: &PixelGrid, batch: &Batch, outcome: &[Found]) {
        let bound = |found: &Found| grid.weight(&found.square) * movable(&found.shares, batch.care);
        if let (Some(group), false) = (&mut self.group, batch.wholes.is_empty()) {
            let fallen =
                [batch.wholes.iter().map(bound).sum(), outcome.iter().map(bound).sum::<f64>()];
            group.fallen = fallen;
            self.fallen.iter_mut().zip(fallen).for_each(|(sum, bound)| *sum += bound);
        }
    }

    /// Of rays that stand for themselves, in quarters of squares.
    fn judge_quarters(
        &mut self,
        grid: &PixelGrid,
        batch: &Batch,
        outcome: &[Found],
        next: &mut Next,
    ) {
        let room = self.goal.map_or(f64::INFINITY, |goal| ALONE_SHARE * goal.tolerance);
        for (whole, quarters) in batch.wholes.iter().zip(outcome.chunks_exact(4)) {
            let mut mean = ErrorShares::default();
            quarters.iter().for_each(|quarter| mean.add(&quarter.shares, 0.25));
            if next.takes(std::slice::from_ref(whole), &mean, room, batch) {
                continue;
            }
            let uneven = Unevenness::of(whole, from_fn(|n| &quarters[n].value));
            let pixel = &mut self.pixels[usize::from(whole.square.pixel)];
            pixel.learn(whole, &uneven, grid.weight(&whole.square), &mean);
            next.quartered
                .extend(quarters.iter().map(|quarter| Found { uneven: Some(uneven), ..*quarter }));
        }
    }

    /// Lets squares wait; what there is no room for is taken as it is.
    fn wait(&mut self, grid: &PixelGrid, squares: &[Found], to_do: &ToDo) {
        for found in squares {
            let weight = grid.weight(&found.square);
            let harms = grid.has_area().then_some(weight);
            if !self.waiting.push(*found, harms, to_do) {
                let pixel = &mut self.pixels[usize::from(found.square.pixel)];
                if to_do.alone {
                    pixel.draw(found, weight);
                } else {
                    pixel.take(found, weight);
                }
            }
        }
    }

    /// How far the tile's worst pixel is off.
    pub(super) fn error(&self) -> TileError {
        let tolerance = self.goal.map_or(f64::INFINITY, |goal| goal.tolerance);
        let power = power(self.fallen).unwrap_or(1.0);
        let taken = self.rays as f64 / self.pixels.len() as f64;
        let mut error = TileError { power, ..TileError::default() };
        for pixel in &self.pixels {
            let shares = pixel.bound();
            let total = shares.total();
            if error.shares.total() < total {
                error.shares = shares;
            }
            let likely = if total > tolerance { pixel.estimate() } else { total };
            error.estimate = error.estimate.max(likely);
            let times = (shares.pixel_area / tolerance).powf(power.recip());
            let rays = (taken * times).clamp(1.0, MOST_NEEDED);
            error.rays_needed += rays / self.pixels.len() as f64;
        }
        error
    }

    /// The tile's pixels, row by row: R, G, B, A.
    pub(super) fn pixels(&mut self) -> &[[f32; 4]] {
        self.finished.clear();
        self.finished.extend(self.pixels.iter().map(|p| p.value.map(|channel| channel as f32)));
        &self.finished
    }
}

/// What is to be done with the squares of a batch.
#[derive(Default)]
struct Next {
    careful: Vec<Found>,
    finer: Vec<Found>,
    quartered: Vec<Found>,
    /// The most that levels are off by, of the room that there is.
    worst: f64,
}

impl Next {
    /// Takes squares whose rays are off by so much, as `mean` of these rays has it, that they are
    /// to be marched with more care, or through finer levels.
    fn takes(&mut self, found: &[Found], mean: &ErrorShares, room: f64, batch: &Batch) -> bool {
        if batch.care != Care::Exact && mean.quadrature > MARCH_SHARE * room {
            self.careful.extend(found);
            return true;
        }
        let can_be_finer = !matches!(batch.cut, Cut::FullDepth);
        if can_be_finer && mean.levels > LEVELS_SHARE * room {
            self.worst = self.worst.max(mean.levels / room);
            self.finer.extend(found);
            return true;
        }
        false
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
