//! Refinement of a tile's pixels. After each batch of rays it decides which pixels are within the
//! goal, and which get more rays, finer levels, more digits or a more careful march. Where no
//! affordable number of rays brings bounds within the goal, pixels are refined until their estimated
//! error is.

mod batch;
mod border_rays;
mod first_rays;
mod neighbours;
mod next;
mod prospect;
mod ray_count;
mod sounding;
mod trial;
mod uncertified;

pub(crate) use self::batch::Batch;
use self::first_rays::FirstRays;
use self::next::{Next, movable};
use self::prospect::GroupInHand;
use self::ray_count::RayCount;
use self::sounding::Sounding;
use self::trial::Trial;
use super::pixel::Pixel;
use super::waiting::{Found, GROUP_PIXELS, ToDo, Urgency, Waiting};
use crate::render::bounds::grade::Care;
use crate::render::bounds::shares::ErrorShares;
use crate::render::camera::pixel_order::PixelOrder;
use crate::render::camera::rays::{BATCH_RAYS, PixelGrid, PixelRect, Square};
use crate::render::plan::cut::Cut;
use crate::render::plan::goal::{Goal, Method, TileError, power};

/// Squares are not halved more often: their centres are exact to f64 then.
const MOST_HALVINGS: u8 = 30;
/// A pixel is taken to need no more rays than this: cores that shine are refined where they are.
const MOST_NEEDED: f64 = 1024.0;

/// The part of a square's bound that goes once it is quartered, at least: three quarters of what is of
/// second order in its width.
const FALLS: f64 = 0.6;
/// Quarters stand out that may do more than this part of the median pixel's harm.
const SMALL_HARM: f64 = 0.125;

/// What squares of a pixel may be off by on average.
struct Mean {
    pixel: usize,
    shares: ErrorShares,
    /// What they may be beside what work cannot change.
    room: f64,
    /// Whether their pixel's bound is within the tolerance then.
    is_bound: bool,
}

/// Squares to be marched again, or others to be quartered; of a batch one of both is empty.
#[derive(Default)]
struct Chosen {
    again: Vec<Found>,
    wholes: Vec<Found>,
}

/// A tile's pixels while they are drawn.
#[derive(Default)]
pub(crate) struct TilePixels {
    pixels: Vec<Pixel>,
    rect: PixelRect,
    finished: Vec<[f32; 4]>,
    first: Option<Batch>,
    /// The cut that first rays are marched through.
    first_cut: Option<Cut>,
    sounding: Option<Sounding>,
    waiting: Waiting,
    goal: Option<Goal>,
    rays: RayCount,
    /// What squares that were quartered might be off by, and what their quarters may.
    fallen: [f64; 2],
    trial: Trial,
    group: Option<GroupInHand>,
    first_rays: FirstRays,
}

impl TilePixels {
    /// Bytes that these take: pixels, the batch in hand and what it finds, and squares that
    /// wait.
    pub(crate) const BYTES: u64 = Waiting::BYTES
        + FirstRays::BYTES
        + RayCount::BYTES
        + (BATCH_RAYS
            * (size_of::<Pixel>()
                + size_of::<[f32; 4]>()
                + 3 * size_of::<Square>()
                + 4 * size_of::<Found>())) as u64;

    /// Begins with the pixels of `rect`.
    pub(crate) fn start(&mut self, grid: &PixelGrid, rect: PixelRect, method: &Method) {
        self.pixels.clear();
        self.pixels.resize(rect.count(), Pixel::default());
        self.rect = rect;
        self.first_rays.clear(PixelOrder::of(&rect), rect.count());
        self.rays.clear(rect.count());
        let mut squares = Vec::new();
        grid.first_squares(&rect, &mut squares);
        self.sounding = None;
        let cut = match method {
            Method::Once { cut, .. } => {
                self.goal = None;
                cut.clone()
            }
            Method::Within(goal) => {
                self.goal = Some(*goal);
                self.sounding = Sounding::begin(goal, &mut squares);
                self.sounding.as_ref().map_or_else(|| goal.first_cut(), |_| goal.coarsest_cut())
            }
        };
        self.fallen = [0.0; 2];
        self.trial = Trial::default();
        self.group = None;
        self.waiting.clear();
        let has_area = grid.has_area();
        let (again, wholes) = Default::default();
        let [care, before] = [Care::Rough; 2];
        let first = Batch { squares, cut, care, before, has_area, is_border: false, again, wholes };
        self.first = Some(first);
    }

    /// The next rays to march; none when all pixels are known.
    pub(crate) fn next(&mut self, grid: &PixelGrid) -> Option<Batch> {
        let first = self.first.take();
        if let Some(batch) = &first {
            self.first_cut = Some(batch.cut.clone());
        }
        let batch = first.or_else(|| self.border_batch(grid)).or_else(|| self.most_urgent(grid))?;
        if batch.is_border {
            return Some(batch);
        }
        if batch.has_area || !grid.has_area() {
            self.rays.add_for_squares(batch.squares.len());
        }
        Some(batch)
    }

    /// The squares of the first pixels that harm these most, without those that have become good
    /// enough because others have turned out better than they had to be.
    fn most_urgent(&mut self, grid: &PixelGrid) -> Option<Batch> {
        while let Some((group, mut found, to_do)) = self.waiting.pop() {
            found.sort_by_key(|found| found.square.pixel);
            let Chosen { again, wholes } = if to_do.alone {
                let is_last = Urgency::is_last(group);
                let mut wholes = self.still_unsure(grid, found, &to_do, is_last);
                self.add_wholes(grid, &mut wholes, &to_do);
                Chosen { again: Vec::new(), wholes }
            } else {
                self.settle(grid, group, &found, !to_do.quartered);
                let Chosen { again, wholes } = self.still_bad(grid, group, &found, &to_do);
                let again = self.with_promise(grid, again, &to_do);
                self.of_one_kind(grid, Chosen { again, wholes }, &to_do)
            };
            let mut squares: Vec<_> = again.iter().map(|found| found.square).collect();
            let reach = |whole: &Found| if to_do.alone { self.scatter(whole) } else { 0.0 };
            let quarters = |whole: &Found| whole.square.scattered_quarters(reach(whole));
            squares.extend(wholes.iter().flat_map(quarters));
            if !squares.is_empty() {
                let ToDo { cut, before, care, alone, .. } = to_do;
                let (has_area, is_border) = (grid.has_area() && !alone, false);
                return Some(Batch {
                    squares,
                    cut,
                    care,
                    before,
                    has_area,
                    is_border,
                    again,
                    wholes,
                });
            }
        }
        None
    }

    /// Chooses from the squares `found` of a group of pixels those that are to be marched again, or
    /// quartered; the others are concluded.
    fn still_bad(
        &mut self,
        grid: &PixelGrid,
        group: usize,
        found: &[Found],
        to_do: &ToDo,
    ) -> Chosen {
        let Some(median) = self.scouts(group) else {
            return self.still_above(grid, group, found, to_do);
        };
        let is_over = self.is_over(grid, group);
        let mut chosen = Chosen::default();
        for found in found.chunk_by(|a, b| a.square.pixel == b.square.pixel) {
            let Mean { shares, room, .. } = self.mean(grid, found, to_do.before);
            let is_good = movable(&shares, to_do.before) <= room;
            for found in found {
                let bound = movable(&found.shares(), to_do.before);
                let harm = grid.weight(&found.square) * bound;
                let stands_out = match found.square.halvings {
                    _ if self.may_hide(harm, bound) => true,
                    0 => {
                        let pixel = usize::from(found.square.pixel);
                        harm > self.little(median) && self.first_rays.stands_out(pixel, bound)
                            || self.may_glint(found)
                    }
                    _ => harm > self.little(SMALL_HARM * median),
                };
                let again = !to_do.quartered && self.may_shine(bound);
                if is_over || is_good || bound <= room || !(again || stands_out) {
                    self.conclude(grid, found, to_do);
                } else if again {
                    chosen.again.push(*found);
                } else {
                    chosen.wholes.push(*found);
                }
            }
        }
        chosen
    }

    /// The same where bounds are sought. Of those to be quartered only as many of a pixel are, the worst
    /// first, as bring it within its bound if theirs fall as they should; the others wait.
    fn still_above(
        &mut self,
        grid: &PixelGrid,
        group: usize,
        found: &[Found],
        to_do: &ToDo,
    ) -> Chosen {
        let is_over = self.is_over(grid, group);
        let mut chosen = Chosen::default();
        for found in found.chunk_by(|a, b| a.square.pixel == b.square.pixel) {
            let Mean { shares, room, is_bound, .. } = self.mean(grid, found, to_do.before);
            let off = movable(&shares, to_do.before);
            let weight = |found: &Found| grid.weight(&found.square);
            let mut above = (off - room) * found.iter().map(weight).sum::<f64>();
            let bound = |found: &Found| movable(&found.shares(), to_do.before);
            // Without limit, all are above: what is left of it is NaN once one of them is taken off.
            let mut worst: Vec<_> = found.iter().map(|f| (weight(f) * bound(f), f)).collect();
            worst.sort_by(|a, b| b.0.total_cmp(&a.0));
            for (harm, found) in worst {
                let is_good = off <= room || bound(found) <= room;
                if is_good && is_bound {
                    self.take(grid, found);
                } else if is_good || is_over {
                    self.conclude(grid, found, to_do);
                } else if !to_do.quartered {
                    chosen.again.push(*found);
                } else if above > 0.0 || above.is_nan() || !self.may_wait(grid, found, to_do) {
                    above -= FALLS * harm;
                    chosen.wholes.push(*found);
                }
            }
        }
        chosen
    }

    /// Squares that are to be marched again, or quartered: what a batch finds is of one kind. If there are
    /// both, the latter wait, as do those whose rays have no room in a batch.
    fn of_one_kind(&mut self, grid: &PixelGrid, mut chosen: Chosen, to_do: &ToDo) -> Chosen {
        let most = if chosen.again.is_empty() { BATCH_RAYS / 4 } else { 0 };
        let others = chosen.wholes.split_off(most.min(chosen.wholes.len()));
        self.wait(grid, &others, &ToDo { quartered: true, ..to_do.clone() });
        chosen
    }

    /// Whether no more rays may be marched that stand for squares of a group of pixels.
    fn is_over(&self, grid: &PixelGrid, group: usize) -> bool {
        let Some(goal) = &self.goal else { return true };
        grid.has_area() && self.rays.others() >= self.rays.most_of_group(group, goal)
    }

    /// What squares of a pixel may be off by on average.
    fn mean(&self, grid: &PixelGrid, found: &[Found], care: Care) -> Mean {
        let whole: f64 = found.iter().map(|found| grid.weight(&found.square)).sum();
        let mut shares = ErrorShares::default();
        for found in found {
            shares.add(&found.shares(), grid.weight(&found.square) / whole);
        }
        let pixel = usize::from(found[0].square.pixel);
        let allowed = self.goal.map_or(f64::INFINITY, |goal| goal.tolerance);
        // Beside what work cannot change, as much again, within the tolerance for itself.
        let done = if care == Care::Exact { shares.quadrature } else { 0.0 };
        let fixed = done + shares.storage + shares.termination + shares.rounding;
        let (within, as_much) = (self.pixels[pixel].rate(allowed) - fixed, fixed.min(allowed));
        Mean { pixel, shares, room: within.max(as_much), is_bound: within >= as_much }
    }

    /// What a pixel's rays may be off by at most, where it may be off by so much for that.
    fn room_of_rays(&self, room: f64) -> f64 {
        self.goal.map_or(room, |goal| goal.of_rays(room))
    }

    /// Takes what a batch has found: pixels that are close enough are known, the others' squares
    /// wait for more.
    pub(crate) fn judge(
        &mut self,
        grid: &PixelGrid,
        batch: &Batch,
        outcome: impl Iterator<Item = Found>,
    ) {
        let mut outcome: Vec<_> = outcome.collect();
        if batch.is_border {
            self.first_rays.note_border(&outcome);
            return;
        }
        if let Some(sounding) = self.sounding.take() {
            self.first = Some(self.sounded(grid, sounding, batch, &outcome));
            return;
        }
        let mut next = Next::default();
        let alone = grid.has_area() && !batch.has_area;
        if !alone && grid.has_area() {
            self.first_rays.note(batch, &outcome);
        }
        if !alone {
            batch.hand_down(grid, self, &mut outcome);
        }
        let scouts = self.group.and_then(|group| group.scouts);
        match scouts.filter(|_| !batch.wholes.is_empty()) {
            _ if alone => self.judge_quarters(grid, batch, &outcome, &mut next),
            Some(median) => self.judge_scouts(grid, batch, median, &outcome, &mut next),
            None => {
                self.compare(grid, batch, &outcome);
                self.trial.note(batch, &outcome);
                self.judge_squares(grid, batch, &outcome, &mut next);
            }
        }
        self.enqueue(grid, batch, &next, alone);
    }

    /// Lets squares wait for what is to be done with them; `alone`: by rays that stand for themselves.
    fn enqueue(&mut self, grid: &PixelGrid, batch: &Batch, next: &Next, alone: bool) {
        let (before, cut) = (batch.care, batch.cut.clone());
        let to_do = ToDo { quartered: alone, cut, before, care: before.more(), alone };
        self.wait(grid, &next.careful, &to_do);
        self.wait(grid, &next.exact, &ToDo { care: Care::Exact, ..to_do.clone() });
        let quartered = ToDo { quartered: true, care: before, ..to_do.clone() };
        self.wait(grid, &next.quartered, &quartered);
        if let (Some(goal), false) = (self.goal, next.finer.is_empty()) {
            let cut = next.finer_cut(&goal, &batch.cut);
            self.wait(grid, &next.finer, &ToDo { cut, care: before, ..to_do });
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
            let Mean { pixel, shares, room, is_bound } = self.mean(grid, found, care);
            let is_good = movable(&shares, care) <= room;
            let is_over = self.is_over(grid, pixel / GROUP_PIXELS);
            let of_rays = self.room_of_rays(room);
            if !is_good && !is_over && next.takes(found, &shares, of_rays, batch) {
                continue;
            }
            let is_taken_so = is_bound && self.scouts(pixel / GROUP_PIXELS).is_none();
            for found in found {
                let is_good = is_good || movable(&found.shares(), care) <= room;
                let is_last = |goal: Goal| found.square.halvings >= goal.most_halvings;
                let is_taken = is_good || is_over || self.goal.is_some_and(is_last);
                if is_good && is_taken_so {
                    self.take(grid, found);
                } else if !is_taken && grid.has_area() && found.square.halvings < MOST_HALVINGS {
                    next.quartered.push(*found);
                } else if !is_taken && can_be_finer {
                    next.worst = next.worst.map(|worst| worst.max(1.0));
                    next.finer.push(*found);
                } else {
                    self.conclude(grid, found, &marched);
                }
            }
        }
    }

    /// Lets squares wait; there need not be room for all.
    fn wait(&mut self, grid: &PixelGrid, squares: &[Found], to_do: &ToDo) {
        for found in squares {
            if to_do.alone {
                self.wait_alone(grid, found, to_do);
            } else if !self.may_wait(grid, found, to_do) {
                self.conclude(grid, found, to_do);
            }
        }
    }

    /// Lets a square wait, for a ray that stands for it; false where there is no room.
    fn may_wait(&mut self, grid: &PixelGrid, found: &Found, to_do: &ToDo) -> bool {
        let harm = grid.weight(&found.square) * found.shares().total();
        let group = usize::from(found.square.pixel) / GROUP_PIXELS;
        let urgency = if grid.has_area() { Urgency::new(group, harm) } else { Urgency::default() };
        self.waiting.push(*found, urgency, to_do)
    }

    /// How far the tile's worst pixel is off.
    pub(crate) fn error(&self) -> TileError {
        let tolerance = self.goal.map_or(f64::INFINITY, |goal| goal.tolerance);
        let power = power(self.fallen).unwrap_or(1.0);
        let mut error = TileError { fallen: self.fallen, ..TileError::default() };
        for (n, pixel) in self.pixels.iter().enumerate() {
            let shares = pixel.bound();
            let total = shares.total();
            if error.shares.total() < total {
                error.shares = shares;
            }
            let likely = if total > tolerance { pixel.estimate() } else { total };
            error.estimate = error.estimate.max(likely);
            let rays = self.foreseen(n, shares.pixel_area, power);
            error.rays_needed += rays.clamp(1.0, MOST_NEEDED);
            error.beyond += u64::from(rays > MOST_NEEDED);
            error.unsure += u64::from(self.is_unsure(pixel, shares.pixel_area));
        }
        error
    }

    /// Rays that a pixel takes in all if its bound goes on to fall from this to the tolerance with this
    /// power of their number.
    fn foreseen(&self, pixel: usize, bound: f64, power: f64) -> f64 {
        let tolerance = self.goal.map_or(f64::INFINITY, |goal| goal.tolerance);
        self.first_rays.marched(pixel) * (bound / tolerance).powf(power.recip())
    }

    /// The tile's pixels, row by row: R, G, B, A.
    pub(crate) fn pixels(&mut self) -> &[[f32; 4]] {
        self.finished.clear();
        self.finished.resize(self.pixels.len(), [0.0; 4]);
        let width = self.rect.columns().len();
        for (number, pixel) in self.pixels.iter().enumerate() {
            let [x, y] = self.first_rays.place(number);
            let place = y as usize * width + x as usize;
            // Light is not negative, but by the rounding of sums.
            self.finished[place] = pixel.value.map(|c| if c < 0.0 { 0.0 } else { c as f32 });
        }
        &self.finished
    }
}

#[cfg(test)]
#[path = "refine_tests.rs"]
mod tests;
