//! How coarse a cut does for a tile whose finest cells are narrower than pixels. What these bricks may be
//! off by adds up along rays, mostly to far less than the index says, and sometimes not: in a smooth
//! medium most of them need not be read, in a rough one rays that miss the tolerance are marched again. So
//! a few pixels of a tile are drawn first, by a larger limit for such bricks, and tell which one the
//! others begin with.

use super::next::{LEVELS_SHARE, movable};
use super::{Batch, Mean, TilePixels};
use crate::render::camera::rays::{PixelGrid, Square};
use crate::render::plan::cut::Cut;
use crate::render::plan::goal::{Goal, MOST_OF_NARROW};
use crate::render::tiles::waiting::Found;

/// One pixel in so many is drawn first, where there are so many rays.
const ONE_IN: usize = 64;
const FEWEST_RAYS: usize = 1024;
/// The part of the pixels drawn first that may need more than a first batch. Each ray that does reads
/// bricks for itself, in small pictures all of those that its neighbours spare.
const MISSING: f64 = 1.0 / 48.0;

/// The rays of a tile that wait while a few others are marched.
pub(super) struct Sounding {
    others: Vec<Square>,
}

impl Sounding {
    /// Leaves of `squares` those that are marched first, if that is worthwhile.
    pub(super) fn begin(goal: &Goal, squares: &mut Vec<Square>) -> Option<Self> {
        if !goal.sounds || squares.len() < FEWEST_RAYS {
            return None;
        }
        let is_first = |square: &Square| usize::from(square.pixel) % ONE_IN == ONE_IN / 2;
        let others: Vec<_> = squares.iter().filter(|square| !is_first(square)).copied().collect();
        if others.len() == squares.len() {
            return None;
        }
        squares.retain(is_first);
        Some(Self { others })
    }
}

impl TilePixels {
    /// The batch of all rays that are not known once a few are. Of pixels that stand for themselves those
    /// are taken that are good enough; areas need to be known one beside the other.
    pub(super) fn sounded(
        &mut self,
        grid: &PixelGrid,
        Sounding { others: mut squares }: Sounding,
        batch: &Batch,
        outcome: &[Found],
    ) -> Batch {
        let mut parts = Vec::with_capacity(outcome.len());
        for found in outcome.chunk_by(|a, b| a.square.pixel == b.square.pixel) {
            let Mean { shares, room, is_bound, .. } = self.mean(grid, found, batch.care);
            parts.push((shares.levels + shares.proxies) / self.room_of_rays(room));
            let is_good = is_bound && movable(&shares, batch.care) <= room;
            if is_good && !grid.has_area() {
                found.iter().for_each(|found| self.take(grid, found));
            } else {
                squares.extend(found.iter().map(|found| found.square));
            }
        }
        squares.sort_by_key(|square| square.pixel);
        let cut = self.goal.map_or(Cut::FullDepth, |goal| goal.coarser_cut(times(&mut parts)));
        let (again, wholes) = Default::default();
        Batch { squares, cut, again, wholes, ..*batch }
    }
}

/// How many times the limit bricks of narrow cells may have for but a few pixels to be off by no more
/// than they may be, which were so large `parts` of their room by [`MOST_OF_NARROW`] times the limit.
fn times(parts: &mut [f64]) -> f64 {
    parts.sort_by(f64::total_cmp);
    let few = (parts.len() as f64 * MISSING) as usize;
    let Some(worst) = parts.iter().rev().nth(few) else { return 1.0 };
    // Few different cuts, so that neighbouring tiles share bricks.
    let times = (MOST_OF_NARROW * LEVELS_SHARE / worst).log2().floor().exp2();
    if times.is_nan() { 1.0 } else { times.clamp(1.0, MOST_OF_NARROW) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_as_large_as_but_a_few_pixels_let_them_be() {
        assert_eq!(times(&mut [0.0; 64]), MOST_OF_NARROW);
        let mut parts = [0.4; 64];
        parts[3] = f64::NAN;
        assert_eq!(times(&mut parts), MOST_OF_NARROW);
        parts[..2].fill(1.9);
        assert_eq!(times(&mut parts), 2.0);
        parts.fill(100.0);
        assert_eq!((times(&mut parts), times(&mut [])), (1.0, 1.0));
        assert_eq!(times(&mut [f64::NAN; 64]), 1.0);
    }
}
