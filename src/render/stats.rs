//! What a picture took, for the stats file.

use std::collections::BTreeMap;

use serde::Serialize;

use super::bounds::shares::ErrorShares;
use super::plan::census::Census;
use crate::cache::{Header, TreeLevel};
use crate::paging::Counters;

/// One level's part of the work.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct LevelStats {
    /// The simulation's level number. The averaged levels above the root grid have negative
    /// numbers, −1 the one right above it. The half of a factor-4 step holds averages of the
    /// finer of its two levels and counts there.
    pub level: i64,
    /// Bricks of the level that were loaded.
    pub bricks_visited: u64,
    /// Samples taken in them.
    pub samples: u64,
}

/// What a picture took. Bricks are counted once each, over the whole picture:
///
/// `bricks_total` = `bricks_in_view` + those beside the picture or behind the eye, and
/// `bricks_in_view` = `bricks_loaded` + `bricks_covered` + `bricks_skipped_resolution`
/// + `bricks_skipped_transparent` + `bricks_skipped_occluded`.
///
/// With all bricks loaded beforehand (`resident`) `bricks_loaded` counts all of the field's instead.
///
/// A subtree is out of view, or transparent, as a whole; single bricks beside the picture that
/// lie beneath transparent ones or beneath the cut count as in view.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Stats {
    /// Opening, loading and rendering, without writing the picture, seconds.
    pub wall_seconds: f64,
    /// Opening cache and scene, seconds: set by whoever opened them ([`Self::set_opening`]).
    pub open_seconds: f64,
    /// Loading all bricks before anything is drawn, where that was asked for; 0 otherwise, seconds.
    pub load_seconds: f64,
    /// Planning and drawing, with what is loaded meanwhile, seconds.
    pub render_seconds: f64,
    /// Time that marching threads lost: waiting for the file, or for bricks that another thread was
    /// loading, seconds of all threads together.
    pub wait_seconds: f64,
    /// Time that marching threads spent on decoding and preparing bricks that no reader had come to,
    /// seconds of all threads together.
    pub own_loading_seconds: f64,
    /// Time that the file took to deliver, seconds of all threads together, readers included.
    pub read_seconds: f64,
    /// Largest resident set of the process so far; null where the system does not say.
    pub peak_rss_bytes: Option<u64>,
    /// The memory limit.
    pub memory_limit_bytes: u64,
    /// Bricks in the cache.
    pub bricks_total: u64,
    /// Bricks in no subtree that is beside the picture or behind the eye.
    pub bricks_in_view: u64,
    /// Bricks that were loaded, each counted once.
    pub bricks_loaded: u64,
    /// Loads of bricks that had been loaded before and given up for others, for want of memory.
    pub bricks_reloaded: u64,
    /// Loads of bricks that had been loaded before in other digits alone, as for the small picture that a
    /// tolerance begins with.
    pub bricks_in_other_digits: u64,
    /// Bricks in view whose space in view bricks beneath them draw.
    pub bricks_covered: u64,
    /// Bricks finer than what is drawn in their place.
    pub bricks_skipped_resolution: u64,
    /// Bricks in which nothing emits or absorbs.
    pub bricks_skipped_transparent: u64,
    /// Bricks to be drawn that were never loaded, as no ray that needs light meets them: they lie
    /// behind opaque ones from everywhere, or between rays.
    pub bricks_skipped_occluded: u64,
    /// Bytes of payloads read.
    pub bytes_read: u64,
    /// Bytes of payloads after decompression.
    pub bytes_decompressed: u64,
    /// Samples taken: stretches of rays that were integrated.
    pub samples: u64,
    /// The levels with loaded bricks, coarsest first.
    pub levels: Vec<LevelStats>,
    /// The deepest level with loaded bricks; null if there is none.
    pub deepest_level_used: Option<i64>,
    /// The largest error of any channel that was asked for, in the picture's own unit: a
    /// relative one times the picture's largest channel value. Null for settings by hand.
    pub tolerance: Option<f64>,
    /// Rays marched.
    pub rays: u64,
    /// The certified bound of the largest error of any channel of any pixel, in the picture's own
    /// unit; null for settings by hand.
    pub error_bound: Option<f64>,
    /// What the bound of the worst pixel is made of.
    pub error_shares: Option<ErrorShares>,
    /// What the picture's pixels are off by as far as rays tell: where the bound of a pixel is above
    /// the tolerance, by the differences of its rays (three standard deviations); elsewhere the bound.
    /// No certificate. Null for settings by hand.
    pub error_estimate: Option<f64>,
    /// Pixels that may hold more than four tolerances of light that no ray has met, as far as bounds
    /// tell: all their rays are dark, or of part of them there is one ray alone, for want of more. The
    /// estimate of the former does not know of it. Null for settings by hand.
    pub pixels_unsure: Option<u64>,
    /// Threads that march.
    pub threads: usize,
}

/// What of the statistics is the same in every run of one picture, whatever the time, the memory and the
/// threads that it took; each as in [`Stats`].
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Accuracy {
    /// The largest error that was asked for.
    pub tolerance: Option<f64>,
    /// The certified bound of the largest error.
    pub error_bound: Option<f64>,
    /// What that is made of.
    pub error_shares: Option<ErrorShares>,
    /// The error as far as rays tell.
    pub error_estimate: Option<f64>,
    /// Pixels that may hold what no ray has met.
    pub pixels_unsure: Option<u64>,
    /// Rays marched.
    pub rays: u64,
    /// Samples taken.
    pub samples: u64,
}

impl Stats {
    /// What the picture's own file may say of it.
    pub fn accuracy(&self) -> Accuracy {
        let Self { tolerance, error_bound, error_shares, error_estimate, pixels_unsure, .. } =
            *self;
        let Self { rays, samples, .. } = *self;
        Accuracy {
            tolerance,
            error_bound,
            error_shares,
            error_estimate,
            pixels_unsure,
            rays,
            samples,
        }
    }

    /// Says how long opening took, seconds.
    pub fn set_opening(&mut self, seconds: f64) {
        self.open_seconds = seconds;
        self.wall_seconds = seconds + self.load_seconds + self.render_seconds;
    }

    /// Takes in what became of bricks: how many there are in all, what the walk left out, and what
    /// was loaded.
    pub(super) fn set_bricks(&mut self, total: u64, census: &Census, counters: &Counters) {
        self.bricks_total = total;
        self.bricks_in_view = total.saturating_sub(census.out_of_view);
        self.bricks_loaded = counters.distinct();
        self.bricks_reloaded = counters.reloaded();
        self.bricks_in_other_digits = counters.in_other_forms();
        // Where tiles are drawn again with a finer cut, bricks are loaded that the first one left out.
        let mut finer = self.bricks_loaded.saturating_sub(census.drawn);
        let mut rest = |bricks: u64| {
            let loaded = finer.min(bricks);
            finer -= loaded;
            bricks - loaded
        };
        self.bricks_skipped_resolution = rest(census.coarser);
        self.bricks_covered = rest(census.covered);
        self.bricks_skipped_transparent = rest(census.transparent);
        self.bricks_skipped_occluded = census.drawn.saturating_sub(self.bricks_loaded);
        let loaded = counters.loaded();
        (self.bytes_read, self.bytes_decompressed) = (loaded.read, loaded.decompressed);
        self.read_seconds = loaded.reading.as_secs_f64();
        self.wait_seconds = counters.waited().as_secs_f64();
        self.own_loading_seconds = counters.worked().as_secs_f64();
    }

    /// `samples` are those of each level of the tree.
    pub(super) fn set_levels(&mut self, header: &Header, counters: &Counters, samples: &[u64]) {
        let mut levels = BTreeMap::<i64, LevelStats>::new();
        for (index, samples) in samples.iter().enumerate().take(header.levels.len()) {
            let level = shown_level(&header.levels, index);
            let entry = levels.entry(level).or_default();
            entry.level = level;
            entry.bricks_visited += counters.distinct_at(index);
            entry.samples += samples;
        }
        self.samples = samples.iter().sum();
        self.levels = levels.into_values().filter(|level| level.bricks_visited > 0).collect();
        self.deepest_level_used = self.levels.last().map(|level| level.level);
    }
}

/// The number that level `index` of the tree is shown by.
fn shown_level(levels: &[TreeLevel], index: usize) -> i64 {
    let octree = i64::from(levels[index].octree);
    if octree < 0 {
        return octree;
    }
    let from_here = levels[index..].iter();
    from_here.filter_map(|level| level.simulation).map(i64::from).next().unwrap_or(octree)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paging::Loaded;

    #[test]
    fn levels_are_the_simulations() {
        let level = |octree, simulation| TreeLevel {
            octree,
            simulation,
            first_node: 0,
            nodes: 0,
            grids: 0,
            cells: 0,
            leaf_cells: 0,
        };
        let simulation = [None, None, Some(0), Some(1), None, Some(2), Some(3)];
        let levels: Vec<_> = (-2..5).zip(simulation).map(|(o, s)| level(o, s)).collect();
        let shown: Vec<i64> = (0..7).map(|index| shown_level(&levels, index)).collect();
        assert_eq!(shown, [-2, -1, 0, 1, 2, 2, 3]);
    }

    #[test]
    fn bricks_that_a_finer_cut_loads_count_once() {
        let counters = Counters::new(100, 1);
        let census = Census { coarser: 40, covered: 5, drawn: 10, ..Census::default() };
        let counted = |loaded: u64| {
            for key in counters.distinct()..loaded {
                counters.count_load(key, 0, 0, &Loaded::default());
            }
            let mut stats = Stats::default();
            stats.set_bricks(60, &census, &counters);
            [
                stats.bricks_loaded,
                stats.bricks_skipped_occluded,
                stats.bricks_skipped_resolution,
                stats.bricks_covered,
            ]
        };
        assert_eq!(counted(8), [8, 2, 40, 5]);
        assert_eq!(counted(30), [30, 0, 20, 5]);
        assert_eq!(counted(52), [52, 0, 0, 3]);
    }
}
