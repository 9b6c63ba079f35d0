//! Rendering: the tree of bricks is walked front to back for each tile of the picture, bricks
//! stream through a pool of fixed size, and rays gather light in them.
//!
//! [`render`] is the way in. `memory.rs` divides the limit, and `renderer.rs` makes one picture: from
//! the scene's tolerance follows what its pixels may be off by, and one walk of the index counts
//! what it will need. `picture.rs` holds the threads that draw its tiles: each walks the tree for
//! its rays, a few steps ahead of the march, so that bricks can be read ahead.
//!
//! - `camera`: exact positions, a brick's view of the camera, pixels and rays.
//! - `transfer`: from values to light.
//! - `brick`: bricks as rays march through them.
//! - `bounds`: what rays may be off by.
//! - `march`: rays through bricks.
//! - `plan`: the cut, and the walk of the tree.
//! - `tiles`: rays that walk the tree together, and which rays pixels need.

mod bounds;
mod brick;
mod camera;
mod film;
mod march;
pub(crate) mod memory;
mod picture;
mod plan;
mod preload;
mod probe;
mod renderer;
pub mod stats;
#[cfg(test)]
mod testing;
mod tiles;
mod transfer;

use std::time::Instant;

use self::brick::load::BrickLoader;
pub use self::brick::{interpolant, scaled};
use self::camera::rays::PixelGrid;
pub use self::camera::view;
use self::camera::view::View;
pub use self::film::Film;
pub use self::memory::MOST_WRITERS;
use self::memory::MemoryPlan;
pub use self::plan::cut;
pub use self::probe::{Found, Probe};
use self::renderer::Renderer;
use self::stats::Stats;
use self::transfer::pieces::TransferPieces;
use self::transfer::shading::Shading;
use crate::cache::Cache;
use crate::paging::{Budget, Counters, Pool, peak_rss_bytes};
use crate::scene::{Samples, Scene, Tolerance};
use crate::{Error, Result};

/// What exact pictures are converged to, relative to their largest value.
pub const EXACT: f64 = 1e-6;

/// How a picture is made, beside what it shows. The picture depends on none of it but `fixed`, and on
/// `resident` within its tolerance.
#[derive(Clone, Copy)]
pub struct RenderOptions<'o> {
    /// The memory limit of the whole process, bytes.
    pub memory: u64,
    /// Threads that march, at least 1; where none are given as many as there are cores, and as leave
    /// half of `memory` to bricks, or two if these fit.
    pub threads: Option<usize>,
    /// Hears of progress, from any thread: tiles done, and how many there are.
    pub progress: Option<&'o (dyn Fn(u64, u64) + Sync)>,
    /// Draws by these settings instead of the scene's tolerance and samples, without a bound of
    /// the error.
    pub fixed: Option<FixedSetting>,
    /// Loads all bricks of the field before anything is drawn, for comparison with renderers that
    /// hold all data in memory: the limit must have room for them.
    pub resident: bool,
}

/// The settings of a renderer that knows nothing of its error, as its user picks them by hand:
/// what a picture by tolerance is compared with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FixedSetting {
    /// Bricks are opened while their cells are larger than this many pixels; 0: all levels.
    pub pixels_per_cell: f64,
    /// n for n×n rays a pixel, whatever the scene's samples are.
    pub rays_per_axis: u32,
    /// How far emission may be off for simpler formulas, as a part of the picture's largest value
    /// over the domain's diagonal; 0: exact.
    pub relative_accuracy: f64,
}

/// A picture and what it took.
#[derive(Debug)]
pub struct Rendered {
    /// The picture.
    pub film: Film,
    /// What it took.
    pub stats: Stats,
    /// On how many threads it may be written within the limit.
    pub writers: usize,
}

/// Renders `scene` from `cache` within a memory limit.
///
/// # Errors
/// A field that the cache does not hold, units that its source does not have, a camera that has
/// no view, a limit that is too small (the message names the smallest that works), light beyond what
/// 32-bit floats hold, and damage in the cache.
pub fn render(cache: &Cache, scene: &Scene, options: &RenderOptions<'_>) -> Result<Rendered> {
    let started = Instant::now();
    let header = cache.header();
    let shading = Shading::new(&scene.volume, scene.render.interpolation, header)?;
    let view = View::new(scene, &header.domain)?;
    let by_hand = |fixed: FixedSetting| Samples::Grid(fixed.rays_per_axis);
    let samples = options.fixed.map_or(scene.render.samples, by_hand);
    let pixels = PixelGrid::new(&view, samples).among(header.nodes());
    let plan = MemoryPlan::new(cache, &shading, &pixels, options)?;
    let threads = plan.threads;
    let reserved = plan.reserve(&Budget::new(options.memory))?;
    cache.set_index_windows(plan.windows);
    let counters = Counters::new(header.nodes(), header.levels.len());
    let exact = TransferPieces::new(&shading.transfer, |_| 0.0);
    let surveys = options.fixed.is_none_or(|fixed| fixed.relative_accuracy > 0.0);
    let accounts = surveys.then_some(&exact.all);
    let loader = BrickLoader { cache, shading: &shading, accounts };
    let pool = Pool::new(plan.slots, loader, &counters);
    let load_seconds = if options.resident {
        preload::load_all(cache, &pool, shading.field, threads)?.as_secs_f64()
    } else {
        0.0
    };
    let (shading, plan) = (&shading, &plan);
    // Where all bricks are to stay, each is there once.
    let rounds = shading.has_all_digits() && !options.resident;
    let (exact, pool) = (&exact, &pool);
    let renderer = Renderer { cache, scene, shading, exact, pool, plan, rounds, threads };
    let mut samples = vec![0; header.levels.len()];
    let outcome = match options.fixed {
        Some(fixed) => renderer.by_hand(&pixels, &fixed, options, &mut samples)?,
        None => renderer.by_tolerance(&pixels, options, &mut samples)?,
    };
    drop(reserved);
    largest_value(&outcome.film)?;
    let mut stats = Stats { memory_limit_bytes: options.memory, threads, ..Stats::default() };
    stats.set_bricks(header.nodes(), &outcome.census, &counters);
    stats.set_levels(header, &counters, &samples);
    stats.rays = outcome.rays;
    let by_tolerance = options.fixed.is_none();
    stats.tolerance = by_tolerance.then(|| absolute(scene.render.tolerance, &outcome.film));
    stats.error_bound = outcome.error.map(|error| error.shares.total());
    stats.error_shares = outcome.error.map(|error| error.shares);
    stats.error_estimate = outcome.error.map(|error| error.estimate);
    stats.pixels_unsure = outcome.error.map(|error| error.unsure);
    stats.peak_rss_bytes = peak_rss_bytes();
    stats.load_seconds = load_seconds;
    stats.render_seconds = started.elapsed().as_secs_f64() - load_seconds;
    stats.set_opening(0.0);
    Ok(Rendered { film: outcome.film, stats, writers: plan.writers })
}

/// The largest channel of any pixel.
///
/// # Errors
/// Light that 32-bit floats do not hold, or that has overflowed to no number.
fn largest_value(film: &Film) -> Result<f64> {
    let largest = film.largest_value();
    if largest.is_finite() {
        return Ok(f64::from(largest));
    }
    Err(Error::request(
        "a pixel is brighter than 32-bit floats can hold (3.4e38): give emission or color smaller \
         values",
    ))
}

fn absolute(tolerance: Tolerance, film: &Film) -> f64 {
    match tolerance {
        Tolerance::Absolute(value) => value,
        Tolerance::Relative(part) => part * f64::from(film.largest_value()),
    }
}

#[cfg(test)]
#[path = "render_tests.rs"]
mod tests;
