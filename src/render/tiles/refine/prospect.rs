//! Whether rays can bring the bounds of pixels' areas within the tolerance.

use super::{Batch, GROUP_PIXELS, Goal, MOST_HALVINGS, MOST_NEEDED, TilePixels, movable};
use crate::render::camera::rays::PixelGrid;
use crate::render::plan::goal::power;
use crate::render::tiles::waiting::Found;

/// Bounds that fall with a larger power of the number of rays fall fast: squares leave something
/// behind that is small and bright.
const FAST: f64 = 2.0;
/// Bounds of this many times the light that was expected say that something may shine that has not
/// been seen.
const MAY_SHINE: f64 = 10.0;

/// After so many squares were quartered, how bounds fell before that counts half as much.
const FORGOTTEN: f64 = 64.0;
/// So many of them tell how those that follow will.
const TELLING: f64 = 16.0;
/// A group of pixels has no prospect whose bounds predict so many times the rays that are left.
const AT_WORST: f64 = 2.0;

/// A pixel is lost to its certificate once squares that will not be quartered make so many tolerances: for
/// want of room some had to be left.
const LOST: f64 = 2.0;

/// What a square may do to its pixel without being scouted, as a part of the tolerance; and as a part of
/// the light that was expected, since pixels without a certificate come no closer.
const LITTLE: f64 = 0.25;
const LITTLE_OF_LIGHT: f64 = 1e-4;

/// The pixels that are being refined.
#[derive(Debug, Clone, Copy)]
pub(super) struct GroupInHand {
    /// The group's number.
    pub(super) number: usize,
    /// What those that were quartered last might be off by, and what their quarters may.
    pub(super) fallen: [f64; 2],
    /// How many these are.
    quartered: f64,
    /// Where there is no prospect of the tolerance: what its pixels may be off by, in the median.
    /// What stands out is still scouted for.
    pub(super) scouts: Option<f64>,
}

impl TilePixels {
    /// Looks at whether bounds of the group of pixels of this number are sought, and fall fast enough.
    /// Where not, rays that stand for squares go only where something small may shine. `found` are
    /// squares that wait as well, to be marched `again` or quartered.
    pub(super) fn settle(&mut self, grid: &PixelGrid, number: usize, found: &[Found], again: bool) {
        let Some(goal) = self.goal.filter(|_| grid.has_area()) else {
            return;
        };
        let begins = GroupInHand { number, fallen: [0.0; 2], quartered: 0.0, scouts: None };
        let mut group = self.group.filter(|group| group.number == number).unwrap_or(begins);
        if group.scouts.is_none() {
            let mut bounds = self.bounds(grid, number, found);
            let is_known = group.quartered >= TELLING;
            let power = power(group.fallen).filter(|_| is_known);
            let needed = power.map(|power| self.needed(number, &bounds, power));
            let most = AT_WORST * self.rays.most_of_group(number, &goal) as f64;
            bounds.sort_unstable_by(f64::total_cmp);
            let median = bounds[bounds.len() / 2];
            // What falls as fast as that has not shown yet what will be left.
            let is_fast = power.unwrap_or(goal.power) > FAST;
            let is_within_reach = goal.certifies && needed.is_none_or(|rays| rays <= most);
            let has_prospect = (is_within_reach || is_fast || again && self.may_shine(median))
                && !self.is_lost(number, &goal);
            group.scouts = (!has_prospect).then_some(median);
            if !has_prospect {
                self.give_up_certificate(number);
            }
        }
        self.group = Some(group);
    }

    /// Whether a pixel of a group will not have its certificate, whatever rays it still takes. (Where
    /// squares are not to be halved on, they are left without that.)
    fn is_lost(&self, number: usize, goal: &Goal) -> bool {
        let mut pixels = self.pixels.iter().skip(number * GROUP_PIXELS).take(GROUP_PIXELS);
        goal.most_halvings >= MOST_HALVINGS
            && pixels.any(|pixel| pixel.shares.pixel_area > LOST * goal.tolerance)
    }

    /// One group without prospect is enough: no other pays for a certificate that the tile will not have.
    /// What those before `number` have taken for theirs is not what these have to scout with.
    fn give_up_certificate(&mut self, number: usize) {
        if let Some(goal) = self.goal.as_mut().filter(|goal| goal.certifies) {
            goal.give_up_certificates();
            let scouting = goal.rays_per_pixel.saturating_sub(1);
            self.rays.forget_beyond(number * GROUP_PIXELS, scouting);
        }
    }

    /// Rays beside the first that stand for squares, of this group of pixels and those before it, if the
    /// group's go on to fall like that from these `bounds`.
    fn needed(&self, number: usize, bounds: &[f64], power: f64) -> f64 {
        let first = number * GROUP_PIXELS;
        let still = bounds.iter().enumerate().map(|(n, bound)| {
            let marched = self.first_rays.marched(first + n);
            (self.foreseen(first + n, *bound, power).min(MOST_NEEDED) - marched).max(0.0)
        });
        self.rays.others() as f64 + still.sum::<f64>()
    }

    /// Whether what is off by so much may be something bright that no ray has met. Where it is shows
    /// only in what rays are off by that are marched with care, through finer levels.
    pub(super) fn may_shine(&self, bound: f64) -> bool {
        self.goal.is_some_and(|goal| bound > MAY_SHINE * goal.behind)
    }

    /// Harm that need not be scouted for, where others do so much: a part of the tolerance at least.
    pub(super) fn little(&self, others: f64) -> f64 {
        let little =
            |goal: Goal| (LITTLE * goal.tolerance).max(LITTLE_OF_LIGHT * goal.behind).max(others);
        self.goal.map_or(others, little)
    }

    /// Whether a square of which so much is known may hold something that shines, and that matters to
    /// its pixel.
    pub(super) fn may_hide(&self, harm: f64, bound: f64) -> bool {
        self.may_shine(bound) && self.goal.is_some_and(|goal| harm > goal.tolerance)
    }

    /// What a group's pixels may be off by.
    fn bounds(&self, grid: &PixelGrid, number: usize, found: &[Found]) -> Vec<f64> {
        let first = number * GROUP_PIXELS;
        let pixels = self.pixels.iter().skip(first).take(GROUP_PIXELS);
        let mut bounds: Vec<f64> = pixels.map(|pixel| pixel.shares.total()).collect();
        for found in self.waiting.of_group(number).chain(found) {
            bounds[usize::from(found.square.pixel) - first] +=
                grid.weight(&found.square) * found.shares().total();
        }
        bounds
    }

    /// The median of what a group's pixels may be off by, if there is no prospect of less.
    pub(super) fn scouts(&self, group: usize) -> Option<f64> {
        self.group.filter(|in_hand| in_hand.number == group).and_then(|group| group.scouts)
    }

    /// Notes how far bounds have fallen from squares to their quarters.
    pub(super) fn compare(&mut self, grid: &PixelGrid, batch: &Batch, outcome: &[Found]) {
        let bound =
            |found: &Found| grid.weight(&found.square) * movable(&found.shares(), batch.care);
        if let (Some(group), false) = (&mut self.group, batch.wholes.is_empty()) {
            let fallen =
                [batch.wholes.iter().map(bound).sum(), outcome.iter().map(bound).sum::<f64>()];
            let count = batch.wholes.len() as f64;
            // What had no limit would be all that there is for ever.
            let was_limited = group.fallen.iter().all(|bound| bound.is_finite());
            let kept = (-count / FORGOTTEN).exp2();
            group.quartered = kept * group.quartered + count;
            let before =
                if was_limited { group.fallen.map(|bound| kept * bound) } else { [0.0; 2] };
            group.fallen = std::array::from_fn(|n| before[n] + fallen[n]);
            let area = |found: &Found| grid.weight(&found.square) * found.shares().pixel_area;
            let of_areas: [f64; 2] =
                [&batch.wholes[..], outcome].map(|found| found.iter().map(area).sum());
            if of_areas.iter().all(|bound| bound.is_finite()) {
                self.fallen.iter_mut().zip(of_areas).for_each(|(sum, bound)| *sum += bound);
            }
        }
    }
}
