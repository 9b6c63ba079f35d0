//! Rendering: the tree of bricks is walked front to back for each tile of the picture, bricks
//! stream through a pool of fixed size, and rays gather light in them.
//!
//! [`render`] is the way in. A picture is planned first: [`memory`] divides the limit, [`cut`]
//! says where the descent ends, and one walk of the index ([`tree_walk`]) counts what the picture
//! will need ([`census`]). Then [`picture`] draws tiles: each walks the tree for its rays
//! ([`rays`], [`tile`]), a few steps ahead of the march so that bricks can be read ahead
//! ([`load`]). [`view`] and [`frame`] hold the exact camera, [`march`] a ray's way through a
//! brick.

mod absorb;
mod axis;
mod blend;
pub mod census;
pub mod cut;
mod fill;
pub mod frame;
pub mod interpolant;
#[cfg(test)]
mod interpolant_tests;
pub mod load;
pub mod march;
mod march_cell;
mod march_linear;
#[cfg(test)]
mod march_tests;
pub mod memory;
mod picture;
mod polynomial;
mod probe;
pub mod ray_state;
pub mod rays;
pub mod scaled;
#[cfg(test)]
mod scaled_tests;
pub mod shading;
pub mod stats;
#[cfg(test)]
mod test_data;
#[cfg(test)]
mod test_scene;
#[cfg(test)]
mod test_tree;
pub mod tile;
pub mod transfer_pieces;
pub mod tree_walk;
pub mod view;
#[cfg(test)]
mod view_tests;
mod walk;

use std::sync::atomic::{AtomicBool, AtomicU64};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use self::census::Census;
use self::cut::Cut;
use self::load::BrickLoader;
use self::memory::MemoryPlan;
use self::picture::Picture;
pub use self::probe::{Found, Probe};
use self::ray_state::Accuracy;
use self::rays::RayGrid;
use self::shading::Shading;
use self::stats::Stats;
use self::tile::Light;
use self::transfer_pieces::TransferPieces;
use self::tree_walk::{FieldIndex, Scenery, Walk};
use self::view::View;
use crate::Result;
use crate::cache::{Cache, Header};
use crate::image::Film;
use crate::paging::{Budget, Counters, Pool, peak_rss_bytes};
use crate::scene::{Samples, Scene, Tolerance};
use crate::space::Domain;

/// How a picture is made, beside what it shows. The picture depends on none of it but `fixed`.
#[derive(Clone, Copy)]
pub struct RenderOptions<'o> {
    /// The memory limit of the whole process, bytes.
    pub memory: u64,
    /// Threads that march; at least 1.
    pub threads: usize,
    /// Hears of progress, from any thread: tiles done, and how many there are.
    pub progress: Option<&'o (dyn Fn(u64, u64) + Sync)>,
    /// Draws by these settings instead of the scene's tolerance and samples, without a bound of
    /// the error.
    pub fixed: Option<FixedSetting>,
}

/// The settings of a renderer that knows nothing of its error, as its user picks them by hand:
/// what a picture by tolerance is compared with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FixedSetting {
    /// Bricks are opened while their cells are larger than this many pixels; 0: all levels.
    pub pixels_per_cell: f64,
    /// n for n×n rays a pixel, whatever the scene's samples are.
    pub rays_per_axis: u32,
    /// [`Accuracy::relative`] of the march.
    pub relative_accuracy: f64,
}

/// A picture and what it took.
#[derive(Debug)]
pub struct Rendered {
    /// The picture.
    pub film: Film,
    /// What it took.
    pub stats: Stats,
}

/// Renders `scene` from `cache` within a memory limit.
///
/// # Errors
/// A field that the cache does not hold, units that its source does not have, a camera that has
/// no view, a limit that is too small (the message names the smallest that works), and damage in
/// the cache.
pub fn render(cache: &Cache, scene: &Scene, options: &RenderOptions<'_>) -> Result<Rendered> {
    let started = Instant::now();
    let header = cache.header();
    let (width, height) = (scene.image.width, scene.image.height);
    let threads = options.threads.max(1);
    let shading = Shading::new(&scene.volume, scene.render.interpolation, header)?;
    let view = View::new(scene, &header.domain)?;
    let cut = match &options.fixed {
        Some(fixed) => Cut::of_pixels(fixed.pixels_per_cell, scene, &header.domain, header.shape)?,
        None => Cut::new(scene, &header.domain, header.shape)?,
    };
    let by_hand = |fixed: FixedSetting| Samples::Grid(fixed.rays_per_axis);
    let rays = RayGrid::new(&view, options.fixed.map_or(scene.render.samples, by_hand));
    let plan = MemoryPlan::new(cache, width, height, threads, options.memory)?;
    let reserved = plan.reserve(&Budget::new(options.memory))?;
    cache.set_index_windows(plan.windows);
    let scenery = Scenery { header, view: &view, rays: &rays, cut: &cut, shading: &shading };
    let census = take_census(cache, &scenery)?;
    let counters = Counters::new(header.nodes(), header.levels.len());
    let loader = BrickLoader { cache, shading: &shading };
    let picture = Picture {
        cache,
        light: light(&shading, relative_accuracy(scene.render.tolerance, options), header),
        scenery,
        pool: Pool::new(plan.slots, &loader, &counters),
        film: Mutex::new(Film::new(width, height)?),
        progress: options.progress,
        next_tile: AtomicU64::new(0),
        tiles_done: AtomicU64::new(0),
        is_stopped: AtomicBool::new(false),
    };
    let samples = picture.draw(threads, plan.readers)?;
    let film = picture.film.into_inner().unwrap_or_else(PoisonError::into_inner);
    drop((picture.pool, reserved));
    let mut stats = Stats { memory_limit_bytes: options.memory, threads, ..Stats::default() };
    stats.set_bricks(header.nodes(), &census, &counters);
    stats.set_levels(header, &counters, &samples);
    stats.tolerance = absolute(scene.render.tolerance, &film);
    stats.peak_rss_bytes = peak_rss_bytes();
    stats.render_seconds = started.elapsed().as_secs_f64();
    stats.set_opening(0.0);
    Ok(Rendered { film, stats })
}

/// One walk of the index over the whole picture.
fn take_census(cache: &Cache, scenery: &Scenery<'_>) -> Result<Census> {
    let mut index = FieldIndex { cursor: cache.cursor(), field: scenery.shading.field };
    let mut walk = Walk::new(scenery, &mut index, Census::default(), scenery.rays.whole());
    while walk.next(|_| true)?.is_some() {}
    Ok(walk.into_tally())
}

/// An absolute tolerance says nothing of a ray before the picture is known: rays are then exact.
fn relative_accuracy(tolerance: Tolerance, options: &RenderOptions<'_>) -> f64 {
    match (options.fixed, tolerance) {
        (Some(fixed), _) => fixed.relative_accuracy,
        (None, Tolerance::Relative(part)) => part,
        (None, Tolerance::Absolute(_)) => 0.0,
    }
}

fn light(shading: &Shading, relative: f64, header: &Header) -> Light {
    Light {
        pieces: TransferPieces::new(&shading.transfer),
        accuracy: Accuracy { relative, longest_path: diagonal(&header.domain) },
    }
}

/// The domain's diagonal, code length.
fn diagonal(domain: &Domain) -> f64 {
    domain.difference(&domain.upper(), &domain.cell_corner(0, [0; 3])).length()
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
