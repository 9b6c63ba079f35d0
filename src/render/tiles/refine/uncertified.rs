//! Pixels whose bounds stay above the tolerance: squares in which something small may shine are still
//! scouted, the others are left to rays that stand for themselves.

use std::array::from_fn;

use super::{BATCH_RAYS, Batch, GROUP_PIXELS, MOST_HALVINGS, Next, TilePixels, movable};
use crate::render::bounds::grade::Care;
use crate::render::bounds::shares::{ErrorShares, LIKELY_OF_BOUND};
use crate::render::camera::rays::PixelGrid;
use crate::render::plan::goal::Goal;
use crate::render::tiles::pixel::Pixel;
use crate::render::tiles::unevenness::Unevenness;
use crate::render::tiles::waiting::{FEW_PIXELS, Found, ToDo, Urgency};

/// The parts of a tolerance that a mean of rays that stand for themselves may be off by, where
/// little else is and where much is, and that are room for what these are off by themselves.
const MEAN_SHARE: f64 = 0.7;
const LEAST_MEAN_SHARE: f64 = 0.1;
pub(super) const ALONE_SHARE: f64 = 0.6;
/// Where a pixel's mean will be off by more than the tolerance for want of rays, a tile's rays may be off by
/// such a part of that themselves.
const OF_OUT_OF_REACH: f64 = 0.5;
/// Pixels are dark that have no more than the tolerance, nor than this part of the light that is expected;
/// and may be bright by bounds of so many tolerances.
const DARK: f64 = 1.0 / 32.0;
const FAR: f64 = 4.0;
/// Rays of a square that is quartered.
const QUARTERS: u32 = 4;
/// The part of a square's variance that its quarters are expected to take off. Each is a quarter of it: were
/// all as uneven as their square, as much would go; along an edge half of them are even.
const FALLS_ALONE: f64 = 0.75;
/// Of what the pixels before have left of their rays, a few that are finished together may take one part
/// in so many: those that follow may need as many.
const OF_SAVED: u64 = 4;
/// A quarter of a square stands out that may do more than this part of the square's harm.
const STANDS_OUT_OF_SQUARE: f64 = 0.4;

impl TilePixels {
    /// The squares of `found` that are to be quartered for their pixels' mean, whose rays are counted;
    /// the others are taken as they are, wait on or, for want of rays, are put off, but for those that have
    /// been. Should rays end, pixels of few squares have theirs first.
    pub(super) fn still_unsure(
        &mut self,
        grid: &PixelGrid,
        mut found: Vec<Found>,
        to_do: &ToDo,
        is_last: bool,
    ) -> Vec<Found> {
        let mut left = Vec::with_capacity(found.len());
        found.sort_by_key(|found| found.square.pixel);
        let of_pixels = found.chunk_by_mut(|a, b| a.square.pixel == b.square.pixel);
        let mut of_pixels: Vec<_> = of_pixels.collect();
        of_pixels.sort_by_key(|found| found.len());
        for found in of_pixels {
            found.sort_by(|a, b| variance(grid, b).total_cmp(&variance(grid, a)));
            let before = left.len();
            let mut surplus = self.surplus(usize::from(found[0].square.pixel));
            for found in found.iter() {
                let may_wait = surplus <= 0.0 && left.len() > before && !is_last;
                if self.is_unsure_yet(grid, found, to_do, may_wait, is_last) {
                    surplus -= FALLS_ALONE * variance(grid, found);
                    left.push(*found);
                }
            }
        }
        left.sort_by_key(|found| found.square.pixel);
        left
    }

    /// Whether a square is one of these; it may wait on where others of its pixel are likely to do.
    fn is_unsure_yet(
        &mut self,
        grid: &PixelGrid,
        found: &Found,
        to_do: &ToDo,
        may_wait: bool,
        is_last: bool,
    ) -> bool {
        let pixel = usize::from(found.square.pixel);
        let weight = grid.weight(&found.square);
        if self.take_by_neighbours(found) {
            return false;
        }
        if found.square.halvings >= MOST_HALVINGS || self.is_likely(found) {
            self.pixels[pixel].draw(found, weight);
            return false;
        }
        if self.is_over_alone(pixel, is_last) {
            if is_last || !self.put_off(grid, found, to_do) {
                self.pixels[pixel].give_up(found, weight);
            }
            return false;
        }
        let urgency = self.urgency_alone(found, weight);
        if may_wait && !self.is_too_whole(found) && self.waiting.push(*found, urgency, to_do) {
            return false;
        }
        self.rays.add_alone(pixel, QUARTERS);
        self.pixels[pixel].rays_alone += QUARTERS;
        true
    }

    /// By how much a pixel's variance is above what its mean may have. Without limit while four rays alike
    /// hide it, or where no variance is small enough.
    fn surplus(&self, number: usize) -> f64 {
        let pixel = &self.pixels[number];
        let room = self.room_for_mean(pixel.beside_mean());
        if pixel.changeable(0.0) <= room { f64::INFINITY } else { pixel.surplus(room) }
    }

    /// Whether no more rays may be marched that stand for themselves, for a pixel: its group and those
    /// before it have taken what they may, or, where pixels are finished a few at a time, these have;
    /// once all others are finished, in the last place, the tile has.
    fn is_over_alone(&self, pixel: usize, is_last: bool) -> bool {
        let Some(goal) = &self.goal else { return true };
        let of_group = (pixel / GROUP_PIXELS + 1) * GROUP_PIXELS;
        let pixels = if is_last { self.pixels.len() } else { of_group };
        self.rays.alone() >= self.rays.of_first(pixels, goal.alone_per_pixel)
            || !is_last && self.waiting.is_crowded() && self.is_over_among_few(goal, pixel)
    }

    /// The same of a few pixels alone, which have their own rays and some that those before have left.
    /// What the others of them have not taken yet, and may need, is left to these.
    fn is_over_among_few(&self, goal: &Goal, pixel: usize) -> bool {
        let few = pixel / FEW_PIXELS;
        let rays = |few| self.rays.of_first(few * FEW_PIXELS, goal.alone_per_pixel);
        let (before, own) = (rays(few), rays(few + 1) - rays(few));
        let saved = before.saturating_sub((0..few).map(|few| self.rays.alone_of_few(few)).sum());
        let others = self.pixels.iter().enumerate().skip(few * FEW_PIXELS).take(FEW_PIXELS);
        let others = others.filter(|(other, _)| *other != pixel).map(|(_, other)| other);
        let needed = others
            .filter(|other| other.changeable(0.0) > self.room_for_mean(other.beside_mean()))
            .map(|other| goal.alone_per_pixel.saturating_sub(other.rays_alone.into()));
        self.rays.alone_of_few(few) + needed.sum::<u64>() >= own + saved / OF_SAVED
    }

    /// Puts a square off until all others are finished, in the place of others that matter less should
    /// there be no room; false where there is none.
    fn put_off(&mut self, grid: &PixelGrid, found: &Found, to_do: &ToDo) -> bool {
        let urgency = Urgency::put_off(self.harm_alone(found, grid.weight(&found.square)));
        if self.waiting.push(*found, urgency, to_do) {
            return true;
        }
        for least in self.waiting.pop_less_urgent_last(&urgency) {
            let weight = grid.weight(&least.square);
            self.pixels[usize::from(least.square.pixel)].give_up(&least, weight);
        }
        self.waiting.push(*found, urgency, to_do)
    }

    /// Adds whole pixels of the groups that follow, where they are next, while there is room for their
    /// quarters in a batch. None follow witnesses, which are to be heard first.
    pub(super) fn add_wholes(&mut self, grid: &PixelGrid, wholes: &mut Vec<Found>, to_do: &ToDo) {
        let is_whole = |found: &Found| found.square.halvings == 0;
        let is_witness =
            |found: &Found| self.first_rays.is_witness(usize::from(found.square.pixel));
        if !wholes.iter().all(is_whole) || wholes.iter().any(is_witness) {
            return;
        }
        while wholes.len() + GROUP_PIXELS <= BATCH_RAYS / 4 {
            let Some(found) = self.waiting.pop_like(to_do, is_whole) else { break };
            wholes.extend(self.still_unsure(grid, found, to_do, false));
        }
        wholes.sort_by_key(|found| found.square.pixel);
    }

    /// What a pixel's mean may be off by where it is off by so much beside it.
    pub(super) fn room_for_mean(&self, beside: f64) -> f64 {
        let tolerance = self.goal.map_or(f64::INFINITY, |goal| goal.tolerance);
        (tolerance - beside).clamp(LEAST_MEAN_SHARE * tolerance, MEAN_SHARE * tolerance)
    }

    /// What rays may be off by themselves, which are likely off by `most`: no less than a part of what the worst
    /// pixel's mean will be off by, as far as pixels are known, and as these quarters tell. That falls with
    /// the number of rays, which has an end.
    fn room_for_rays(&self, grid: &PixelGrid, batch: &Batch, outcome: &[Found], most: f64) -> f64 {
        let Some(goal) = &self.goal else { return f64::INFINITY };
        let least = ALONE_SHARE * goal.tolerance;
        if most <= least {
            return least;
        }
        let in_the_end = |pixel: &Pixel| {
            let taken = f64::from(pixel.rays_alone) / goal.alone_per_pixel.max(1) as f64;
            taken.min(1.0) * pixel.changeable(0.0)
        };
        let known = self.pixels.iter().filter(|pixel| pixel.rays_alone > 0).map(in_the_end);
        let told = batch.wholes.iter().zip(outcome.chunks_exact(4)).map(|(whole, quarters)| {
            let mut pixel = self.pixels[usize::from(whole.square.pixel)];
            let uneven = self.unevenness(whole, quarters);
            pixel.learn(whole, &uneven, grid.weight(&whole.square), &ErrorShares::default());
            in_the_end(&pixel)
        });
        let worst = known.chain(told).filter(|off| off.is_finite()).fold(0.0, f64::max);
        least.max(OF_OUT_OF_REACH * worst)
    }

    /// How uneven each quarter of a square is, as rays of all four tell.
    fn unevenness(&self, whole: &Found, quarters: &[Found]) -> [Unevenness; 4] {
        let values = from_fn(|n| &quarters[n].value);
        let sides = |n: usize| self.first_rays.around(&quarters[n]);
        Unevenness::of_quarters(&whole.value, self.known(whole), values, sides, false)
    }

    /// Whether a quarter's pixel is close enough in all likelihood. Four rays may be alike by
    /// accident: while any of them stands for a quarter, their pixel's neighbours are asked as well.
    pub(super) fn is_likely(&self, found: &Found) -> bool {
        if self.is_too_whole(found) {
            return false;
        }
        let pixel = usize::from(found.square.pixel);
        let has_quarters = self.pixels[pixel].has_quarters();
        let least = if has_quarters { self.variance_around(pixel) } else { 0.0 };
        let pixel = &self.pixels[pixel];
        pixel.changeable(least) <= self.room_for_mean(pixel.beside_mean())
    }

    /// How far from their centres rays of a square's quarters are to be, as a part of the way to their
    /// sides.
    pub(super) fn scatter(&self, whole: &Found) -> f64 {
        self.known(whole).map_or(0.0, |uneven| uneven.scatter())
    }

    /// How uneven a square is. Five rays may be alike beside an edge that a pixel's neighbours see.
    pub(super) fn known(&self, whole: &Found) -> Option<Unevenness> {
        if whole.square.halvings == 0 {
            let pixel = usize::from(whole.square.pixel);
            self.first_rays
                .predict(pixel)
                .or_else(|| Some(Unevenness::of_edges(self.first_rays.edges(pixel))))
        } else {
            whole.uneven
        }
    }

    /// Whether a square is to be quartered whatever its rays tell.
    fn is_too_whole(&self, found: &Found) -> bool {
        self.goal.is_some_and(|goal| {
            let least = if self.may_glint(found) {
                let bound = self.first_rays.first_bound(usize::from(found.square.pixel));
                halvings_for_glints(bound / goal.tolerance).min(goal.glint_halvings)
            } else {
                0
            };
            found.square.halvings < goal.least_halvings.max(least)
        })
    }

    /// Whether a pixel whose area may be off by `bound` may hold what no ray has met: of part of it there
    /// is one ray alone, or all of them are dark.
    pub(super) fn is_unsure(&self, pixel: &Pixel, bound: f64) -> bool {
        self.goal.is_some_and(|goal| {
            let is_dark = pixel.value.iter().all(|&value| value <= darkness(&goal));
            bound > FAR * goal.tolerance && (is_dark || pixel.is_partly_unknown())
        })
    }

    /// Whether neither a pixel's first ray nor that of a square of it has met anything that counts, and
    /// yet something may be there that does: the tip of what shines covers little of its pixel, and
    /// none of those beside it.
    pub(super) fn may_glint(&self, found: &Found) -> bool {
        self.goal.is_some_and(|goal| {
            let is_dark = found.value.iter().all(|&value| value <= darkness(&goal));
            is_dark && self.is_dark_by_chance(&goal, usize::from(found.square.pixel))
        })
    }

    /// The same of a whole pixel's first ray.
    pub(super) fn is_dark_by_chance(&self, goal: &Goal, pixel: usize) -> bool {
        goal.glint_halvings > 0
            && self.first_rays.first_bound(pixel) > FAR * goal.tolerance
            && self.first_rays.is_first_dark(pixel, darkness(goal))
    }

    /// What a square's rays are taken to spread by: those of a pixel's quarters by no less than those of the
    /// pixels around it do. That decides on their pixel, so their turn must come before others are taken as
    /// they are.
    fn spread(&self, found: &Found, uneven: &Unevenness) -> f64 {
        let pixel = usize::from(found.square.pixel);
        let is_quarter = found.square.halvings == 1;
        let least = if is_quarter { 2.0 * self.variance_around(pixel).sqrt() } else { 0.0 };
        uneven.spread().max(least)
    }

    /// What a pixel and those beside it have as their first variance on average.
    pub(super) fn variance_around(&self, pixel: usize) -> f64 {
        let near = self.first_rays.near(pixel).filter_map(|number| self.pixels.get(number));
        let known = near.filter_map(Pixel::first_variance);
        let (count, sum) = known.fold((0.0, 0.0), |(n, sum), variance| (n + 1.0, sum + variance));
        if count > 0.0 { sum / count } else { 0.0 }
    }

    /// Takes a square as it is, whose pixel's bound allows it.
    pub(super) fn take(&mut self, grid: &PixelGrid, found: &Found) {
        self.pixels[usize::from(found.square.pixel)].take(found, grid.weight(&found.square));
    }

    /// Takes a square as it is if its bound is as small as the tolerance asks; else its pixel's
    /// mean is left to rays that stand for themselves, if that may be.
    pub(super) fn conclude(&mut self, grid: &PixelGrid, found: &Found, marched: &ToDo) {
        let weight = grid.weight(&found.square);
        let pixel = usize::from(found.square.pixel);
        let may_be = |goal: &Goal| {
            // What is saved on squares is of use to others of their pixel only if it is certified.
            let has_prospect = self.scouts(pixel / GROUP_PIXELS).is_none();
            let allowed = if has_prospect {
                self.pixels[pixel].rate(goal.tolerance)
            } else {
                (1.0 - LEAST_MEAN_SHARE) * goal.tolerance
            };
            found.shares().total() > allowed && grid.has_area()
        };
        if self.goal.as_ref().is_some_and(may_be) {
            let alone = ToDo { quartered: true, alone: true, care: Care::Rough, ..marched.clone() };
            self.pixels[pixel].leave(found, weight);
            self.wait_alone(grid, found, &alone);
        } else {
            self.pixels[pixel].take(found, weight);
        }
    }

    /// Lets a square wait for rays that stand for themselves; if there is no room, those that matter
    /// least are drawn as they are.
    pub(super) fn wait_alone(&mut self, grid: &PixelGrid, found: &Found, to_do: &ToDo) {
        let weight = grid.weight(&found.square);
        let urgency = self.urgency_alone(found, weight);
        if !self.waiting.push(*found, urgency, to_do) {
            for least in self.waiting.pop_least_alone() {
                let weight = grid.weight(&least.square);
                self.pixels[usize::from(least.square.pixel)].give_up(&least, weight);
            }
            if !self.waiting.push(*found, urgency, to_do) {
                self.pixels[usize::from(found.square.pixel)].give_up(found, weight);
            }
        }
    }

    /// After all squares that bounds are sought of come witnesses, then groups of pixels in turn:
    /// first what little is known of, the largest of it first, then the worst.
    fn urgency_alone(&self, found: &Found, weight: f64) -> Urgency {
        const WITNESSES: usize = BATCH_RAYS / GROUP_PIXELS;
        let pixel = usize::from(found.square.pixel);
        let is_whole = found.square.halvings == 0;
        if is_whole && self.first_rays.is_witness(pixel) {
            return Urgency::new(WITNESSES, f64::INFINITY);
        }
        let group = WITNESSES + 1 + pixel / GROUP_PIXELS;
        let urgency = Urgency::new(group, self.harm_alone(found, weight));
        if is_whole && found.uneven.is_none() { urgency } else { urgency.among_few(pixel) }
    }

    /// What a square may add to its pixel's error: more than any other where it is to be quartered whatever
    /// its rays tell, or little is known of it, and without limit where that is all of the pixel.
    fn harm_alone(&self, found: &Found, weight: f64) -> f64 {
        const UNKNOWN: f64 = 1e200;
        match found.uneven {
            None if found.square.halvings == 0 => f64::INFINITY,
            Some(uneven) if !self.is_too_whole(found) => weight * self.spread(found, &uneven),
            _ => weight * UNKNOWN,
        }
    }

    /// Decides on quarters in a group without prospect, whose pixels may be off by `median`: those
    /// are looked into further in which most of what their whole may be off by has stayed, or that
    /// may do more harm than that, as something small may be there that shines.
    pub(super) fn judge_scouts(
        &mut self,
        grid: &PixelGrid,
        batch: &Batch,
        median: f64,
        outcome: &[Found],
        next: &mut Next,
    ) {
        let (cut, care) = (batch.cut.clone(), batch.care);
        let marched = ToDo { quartered: false, cut, before: care, care, alone: false };
        for (whole, quarters) in batch.wholes.iter().zip(outcome.chunks_exact(4)) {
            let harm = |found: &Found| grid.weight(&found.square) * movable(&found.shares(), care);
            let most = STANDS_OUT_OF_SQUARE * harm(whole);
            for quarter in quarters {
                let (harm, bound) = (harm(quarter), movable(&quarter.shares(), care));
                let little = self.little(most.min(median));
                let is_little = harm <= little && !self.may_hide(harm, bound);
                if is_little || quarter.square.halvings >= MOST_HALVINGS {
                    self.conclude(grid, quarter, &marched);
                    continue;
                }
                // What shines in cells that are drawn too coarse, or is marched too roughly, can be
                // anywhere in them.
                if next.takes(std::slice::from_ref(quarter), &quarter.shares(), bound, batch) {
                    continue;
                }
                next.quartered.push(*quarter);
            }
        }
    }

    /// Decides on quarters of squares whose rays stand for themselves.
    pub(super) fn judge_quarters(
        &mut self,
        grid: &PixelGrid,
        batch: &Batch,
        outcome: &[Found],
        next: &mut Next,
    ) {
        let means: Vec<_> = outcome.chunks_exact(4).map(mean).collect();
        let likely = |mean: &ErrorShares| LIKELY_OF_BOUND * movable(mean, batch.care);
        let most = means.iter().map(likely).fold(0.0, f64::max);
        let room = self.room_for_rays(grid, batch, outcome, most);
        let of_wholes = batch.wholes.iter().zip(outcome.chunks_exact(4));
        for ((whole, quarters), mean) in of_wholes.zip(means) {
            let pixel = &self.pixels[usize::from(whole.square.pixel)];
            let is_good = likely(&mean) <= room
                || pixel.beside_mean_with(whole, grid.weight(&whole.square), &mean) <= room;
            let most = room / LIKELY_OF_BOUND;
            if !is_good && next.takes(std::slice::from_ref(whole), &mean, most, batch) {
                continue;
            }
            self.first_rays.doubt(whole, from_fn(|n| &quarters[n].value));
            let uneven = self.unevenness(whole, quarters);
            let pixel = &mut self.pixels[usize::from(whole.square.pixel)];
            pixel.learn(whole, &uneven, grid.weight(&whole.square), &mean);
            let uneven_quarter =
                |(found, uneven): (&Found, Unevenness)| Found { uneven: Some(uneven), ..*found };
            next.quartered.extend(quarters.iter().zip(uneven).map(uneven_quarter));
        }
    }
}

/// What a square adds to its pixel's variance, as far as that is known.
fn variance(grid: &PixelGrid, found: &Found) -> f64 {
    found.uneven.map_or(f64::INFINITY, |uneven| uneven.variance(grid.weight(&found.square)))
}

/// The most that is dark beside a goal.
fn darkness(goal: &Goal) -> f64 {
    goal.tolerance.min(DARK * goal.behind)
}

/// How often a dark pixel is halved that may be bright by so many tolerances. What makes more than the
/// tolerance of it covers no less than one part in so many: a ray meets it, or more, up to four.
fn halvings_for_glints(tolerances: f64) -> u8 {
    (2.0 * tolerances).log(f64::from(QUARTERS)).round() as u8
}

/// What the rays of a square's quarters may be off by on average.
fn mean(quarters: &[Found]) -> ErrorShares {
    let mut mean = ErrorShares::default();
    quarters.iter().for_each(|quarter| mean.add(&quarter.shares(), 0.25));
    mean
}
