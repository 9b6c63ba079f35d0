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
mod crossing;
pub mod cut;
mod fill;
pub mod frame;
mod grade;
pub mod interpolant;
#[cfg(test)]
mod interpolant_tests;
mod lanes;
mod ledger;
#[cfg(test)]
mod ledger_tests;
pub mod load;
pub mod march;
mod march_cell;
mod march_linear;
mod march_packets;
#[cfg(test)]
mod march_tests;
pub mod memory;
mod packet;
#[cfg(test)]
mod packet_tests;
mod picture;
mod piece;
mod polynomial;
mod preload;
mod probe;
pub mod ray_error;
pub mod ray_state;
pub mod rays;
mod refine;
mod relief;
pub mod scaled;
#[cfg(test)]
mod scaled_tests;
pub mod shading;
mod span;
mod span_tree;
pub mod stats;
mod steepness;
#[cfg(test)]
mod stress_tests;
#[cfg(test)]
mod test_data;
#[cfg(test)]
mod test_exact_light;
#[cfg(test)]
mod test_fixed;
#[cfg(test)]
mod test_scene;
#[cfg(test)]
mod test_tree;
mod tile;
mod touch;
pub mod transfer_pieces;
mod transfer_table;
pub mod tree_walk;
pub mod view;
#[cfg(test)]
mod view_tests;
mod waiting;
mod walk;
mod windows;

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use self::census::Census;
use self::cut::{Cut, FootprintCut};
use self::grade::PacketTransfer;
use self::load::BrickLoader;
use self::march::Light;
use self::memory::MemoryPlan;
use self::picture::{Method, Picture, lock};
pub use self::probe::{Found, Probe};
use self::ray_error::ErrorShares;
use self::ray_state::Ending;
use self::rays::PixelGrid;
use self::refine::Goal;
use self::shading::Shading;
use self::stats::Stats;
use self::transfer_pieces::{PieceList, TransferPieces};
use self::transfer_table::TransferTable;
use self::tree_walk::{FieldIndex, Scenery, Walk};
use self::view::View;
use crate::Result;
use crate::cache::{Cache, Header};
use crate::image::Film;
use crate::paging::{Budget, Counters, Pool, peak_rss_bytes};
use crate::scene::{Interpolation, Samples, Scene, Tolerance};
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
    let threads = options.threads.max(1);
    let shading = Shading::new(&scene.volume, scene.render.interpolation, header)?;
    let view = View::new(scene, &header.domain)?;
    let by_hand = |fixed: FixedSetting| Samples::Grid(fixed.rays_per_axis);
    let samples = options.fixed.map_or(scene.render.samples, by_hand);
    let pixels = PixelGrid::new(&view, samples);
    let plan = MemoryPlan::new(cache, &pixels, threads, options)?;
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
    let studio = Studio { cache, scene, shading, exact: &exact, pool: &pool, plan, threads };
    let mut samples = vec![0; header.levels.len()];
    let outcome = match options.fixed {
        Some(fixed) => studio.by_hand(&pixels, &fixed, options, &mut samples)?,
        None => studio.by_tolerance(&pixels, options, &mut samples)?,
    };
    drop(reserved);
    let mut stats = Stats { memory_limit_bytes: options.memory, threads, ..Stats::default() };
    stats.set_bricks(header.nodes(), &outcome.census, &counters);
    stats.set_levels(header, &counters, &samples);
    stats.rays = outcome.rays;
    stats.tolerance = absolute(scene.render.tolerance, &outcome.film);
    stats.error_bound = outcome.shares.map(|shares| shares.total());
    stats.error_shares = outcome.shares;
    stats.peak_rss_bytes = peak_rss_bytes();
    stats.load_seconds = load_seconds;
    stats.render_seconds = started.elapsed().as_secs_f64() - load_seconds;
    stats.set_opening(0.0);
    Ok(Rendered { film: outcome.film, stats })
}

/// A finished picture, before statistics are made of it.
struct Outcome {
    film: Film,
    /// How far its worst pixel may be off, if that is known.
    shares: Option<ErrorShares>,
    census: Census,
    rays: u64,
}

/// What all attempts at a picture share.
struct Studio<'s> {
    cache: &'s Cache,
    scene: &'s Scene,
    shading: &'s Shading,
    /// The transfer function without simplifications.
    exact: &'s TransferPieces,
    pool: &'s Pool<'s, BrickLoader<'s>>,
    plan: &'s MemoryPlan,
    threads: usize,
}

/// A glance is at most this many pixels wide or high.
const GLANCE_PIXELS: u32 = 64;
/// The part of a tolerance relative to the largest value of a glance that is tried first: what a
/// glance sees may be brighter than the picture's pixels.
const FIRST_TRY: f64 = 0.9;
/// Attempts at tiles that turn out to need a smaller tolerance.
const ATTEMPTS: u32 = 12;
/// What exact pictures are converged to, relative to their largest value.
const EXACT: f64 = 1e-6;
/// Rays of a picture whose pixels stand for areas, about, and of a pixel on average over a tile:
/// where the bound needs more, it stays above the tolerance, and says so.
const MOST_RAYS: u64 = 16_000_000;
const MOST_RAYS_PER_PIXEL: u64 = 64;
const FEWEST_RAYS_PER_PIXEL: u64 = 8;

impl<'s> Studio<'s> {
    /// By settings that ask nothing of the error.
    fn by_hand(
        &self,
        pixels: &PixelGrid,
        fixed: &FixedSetting,
        options: &RenderOptions<'_>,
        samples: &mut [u64],
    ) -> Result<Outcome> {
        let cut = self.footprint_cut(fixed.pixels_per_cell)?;
        let light = if fixed.relative_accuracy > 0.0 { self.glance()? } else { 0.0 };
        let off = fixed.relative_accuracy * light;
        let transfer = self.transfer(off);
        let pieces = self.pieces(&transfer);
        let census = self.census(pixels, &cut, pieces)?;
        let method = Method::Once { cut, accounts: false };
        let mut picture =
            self.picture(pixels, (&transfer, pieces), method, None, options.progress)?;
        if off > 0.0 {
            picture.light.packets = Some(self.packets(Some(off), light));
        }
        picture.draw((self.threads, self.plan.readers), &|_| true, samples)?;
        let rays = picture.rays.load(Ordering::Relaxed);
        Ok(Outcome { film: into_inner(picture.film), shares: None, census, rays })
    }

    /// So that no pixel is off by more than the scene's tolerance.
    fn by_tolerance(
        &self,
        pixels: &PixelGrid,
        options: &RenderOptions<'_>,
        samples: &mut [u64],
    ) -> Result<Outcome> {
        let tolerance = self.scene.render.tolerance;
        let is_exact = matches!(tolerance, Tolerance::Absolute(0.0) | Tolerance::Relative(0.0));
        let glance = if is_exact && !pixels.has_area() { 0.0 } else { self.glance()? };
        let mut goal = Goal {
            tolerance: match tolerance {
                _ if is_exact => EXACT * glance,
                Tolerance::Absolute(value) => value,
                Tolerance::Relative(part) if glance > 0.0 => FIRST_TRY * part * glance,
                Tolerance::Relative(_) => f64::MIN_POSITIVE,
            },
            behind: glance,
            rays_per_pixel: MOST_RAYS_PER_PIXEL
                .min(
                    MOST_RAYS
                        / (u64::from(pixels.view().width()) * u64::from(pixels.view().height())),
                )
                .max(FEWEST_RAYS_PER_PIXEL),
            all_levels: is_exact,
        };
        let transfer = self.transfer(if is_exact { 0.0 } else { goal.tolerance });
        let pieces = self.pieces(&transfer);
        let cut = goal.first_cut();
        let census = self.census(pixels, &cut, pieces)?;
        let method = if is_exact && !pixels.has_area() {
            Method::Once { cut: Cut::FullDepth, accounts: true }
        } else {
            Method::Within(goal)
        };
        let allowed = if is_exact { None } else { Some(goal.tolerance) };
        let mut picture =
            self.picture(pixels, (&transfer, pieces), method, allowed, options.progress)?;
        let part = match tolerance {
            Tolerance::Relative(part) if !is_exact => Some(part),
            _ => None,
        };
        if !is_exact {
            let off = PACKET_SHARE * goal.tolerance;
            picture.light.packets = Some(self.packets(Some(off), goal.behind));
        }
        self.draw_within(&mut picture, &mut goal, part, samples)?;
        let rays = picture.rays.load(Ordering::Relaxed);
        let shares = Some(worst(&lock(&picture.bounds)));
        Ok(Outcome { film: into_inner(picture.film), shares, census, rays })
    }

    /// Draws `picture` within `goal`; where that is to be a part of the picture's largest value,
    /// which is known only then, tiles that have turned out too coarse are drawn again. Those
    /// whose levels and rays could not be brought within the goal are left: a smaller one changes
    /// nothing.
    fn draw_within(
        &self,
        picture: &mut Picture<'_, 's>,
        goal: &mut Goal,
        part: Option<f64>,
        samples: &mut [u64],
    ) -> Result<()> {
        let mut is_drawn_again = vec![true; lock(&picture.bounds).len()];
        let mut is_within = vec![true; is_drawn_again.len()];
        for _ in 0..ATTEMPTS {
            let wanted = |tile: u64| {
                let wanted = usize::try_from(tile).ok().and_then(|tile| is_drawn_again.get(tile));
                wanted.copied().unwrap_or(true)
            };
            picture.draw((self.threads, self.plan.readers), &wanted, samples)?;
            let Some(part) = part else { return Ok(()) };
            let shares = lock(&picture.bounds).clone();
            for (n, shares) in shares.iter().enumerate().filter(|(n, _)| is_drawn_again[*n]) {
                is_within[n] = shares.levels + shares.pixel_area <= goal.tolerance;
            }
            let bounds: Vec<f64> = shares.iter().map(ErrorShares::total).collect();
            let good = bounds.iter().zip(&is_within).filter(|(_, is_within)| **is_within);
            let bound = good.fold(0.0, |most, (bound, _)| bound.max(most));
            let largest = f64::from(lock(&picture.film).largest_value());
            let limit = part * (largest - bound).max(0.5 * largest);
            is_drawn_again =
                bounds.iter().zip(&is_within).map(|(b, within)| *within && *b > limit).collect();
            // Where the goal would be the same, what is left is not for more work to change.
            let is_settled = FIRST_TRY * limit >= 0.99 * goal.tolerance;
            if is_settled || !is_drawn_again.contains(&true) {
                return Ok(());
            }
            goal.tolerance = FIRST_TRY * limit;
            goal.behind = largest;
            if let Some(packets) = &mut picture.light.packets {
                packets.allowed = Some(PACKET_SHARE * goal.tolerance);
                packets.behind = goal.behind;
            }
            picture.method = Method::Within(*goal);
        }
        Ok(())
    }

    /// The largest value of a small picture, drawn without regard to its error.
    fn glance(&self) -> Result<f64> {
        let Scene { image, .. } = self.scene;
        let scale = f64::from(GLANCE_PIXELS) / f64::from(image.width.max(image.height));
        let mut scene = self.scene.clone();
        if scale < 1.0 {
            let scaled = |size: u32| ((f64::from(size) * scale).round() as u32).max(1);
            (scene.image.width, scene.image.height) = (scaled(image.width), scaled(image.height));
        }
        let view = View::new(&scene, &self.cache.header().domain)?;
        let pixels = PixelGrid::new(&view, Samples::Grid(1));
        let cut = Cut::Footprint(FootprintCut::new(
            1.0,
            &scene,
            &self.cache.header().domain,
            self.cache.header().shape,
        )?);
        let method = Method::Once { cut, accounts: false };
        let exact = (self.exact, self.pieces(self.exact));
        let mut picture = self.picture(&pixels, exact, method, None, None)?;
        picture.light.packets = Some(self.packets(None, 0.0));
        picture.draw((self.threads, self.plan.readers), &|_| true, &mut [])?;
        let film = into_inner(picture.film);
        Ok(f64::from(film.largest_value()))
    }

    fn footprint_cut(&self, pixels_per_cell: f64) -> Result<Cut> {
        if pixels_per_cell == 0.0 {
            return Ok(Cut::FullDepth);
        }
        let Header { domain, shape, .. } = self.cache.header();
        FootprintCut::new(pixels_per_cell, self.scene, domain, *shape).map(Cut::Footprint)
    }

    /// The transfer function, by formulas that let light be off by at most a twentieth of
    /// `tolerance`: by emission times the longest way, or times the way that absorption leaves.
    fn transfer(&self, tolerance: f64) -> TransferPieces {
        let longest = diagonal(&self.cache.header().domain);
        TransferPieces::new(&self.shading.transfer, |extinction| {
            QUADRATURE_SHARE * tolerance * longest.recip().max(extinction)
        })
    }

    /// What packets march by, which may be off by `allowed` along a ray.
    fn packets(&self, allowed: Option<f64>, behind: f64) -> PacketTransfer {
        let close = self.transfer(CLOSE * allowed.unwrap_or(0.0));
        let longest = diagonal(&self.cache.header().domain);
        let table = TransferTable::new(&self.exact.all, &close.merged);
        PacketTransfer { table, close, allowed, longest, behind }
    }

    /// Values that are constant in each cell need no simpler formulas.
    fn pieces<'t>(&self, transfer: &'t TransferPieces) -> &'t PieceList {
        match self.shading.interpolation {
            Interpolation::Linear => &transfer.merged,
            Interpolation::Cell => &transfer.all,
        }
    }

    fn picture<'p>(
        &'p self,
        pixels: &'p PixelGrid,
        (transfer, pieces): (&TransferPieces, &'p PieceList),
        method: Method,
        allowed: Option<f64>,
        progress: Option<&'p (dyn Fn(u64, u64) + Sync)>,
    ) -> Result<Picture<'p, 's>> {
        let header = self.cache.header();
        let view = pixels.view();
        let longest = diagonal(&header.domain);
        let brightest = transfer.brightest().min(transfer.largest_emission() * longest);
        let tiles = usize::try_from(pixels.tiles()).unwrap_or(usize::MAX);
        Ok(Picture {
            cache: self.cache,
            light: Light {
                pieces,
                ending: Ending::new(brightest, ENDING_SHARE * allowed.unwrap_or(0.0)),
                packets: None,
            },
            scenery: Scenery { header, view, pixels, shading: self.shading, bounds: pieces },
            method,
            pool: self.pool,
            film: Mutex::new(Film::new(view.width(), view.height())?),
            bounds: Mutex::new(vec![ErrorShares::default(); tiles]),
            progress,
            next_tile: AtomicU64::new(0),
            tiles_done: AtomicU64::new(0),
            rays: AtomicU64::new(0),
            is_stopped: AtomicBool::new(false),
        })
    }

    /// One walk of the index over the whole picture.
    fn census(&self, pixels: &PixelGrid, cut: &Cut, bounds: &PieceList) -> Result<Census> {
        let header = self.cache.header();
        let scenery =
            Scenery { header, view: pixels.view(), pixels, shading: self.shading, bounds };
        let mut index = FieldIndex { cursor: self.cache.cursor(), field: self.shading.field };
        let mut walk = Walk::new(&scenery, &mut index, Census::default(), cut, pixels.whole());
        while walk.next(|_| 1.0)?.is_some() {}
        Ok(walk.into_tally())
    }
}

/// The part of a tolerance that simpler formulas along rays may take.
const QUADRATURE_SHARE: f64 = 0.05;
/// How much closer the transfer function is followed where packets bound its bends.
const CLOSE: f64 = 0.02;
/// The part of a tolerance that the march of packets may take.
const PACKET_SHARE: f64 = 0.25;
/// The part of a tolerance that may be lost behind a ray's end.
const ENDING_SHARE: f64 = 0.02;

fn into_inner<T>(mutex: Mutex<T>) -> T {
    mutex.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// The largest of the tiles' errors.
fn worst(bounds: &[ErrorShares]) -> ErrorShares {
    let largest = |a: ErrorShares, b: &ErrorShares| if a.total() >= b.total() { a } else { *b };
    bounds.iter().fold(ErrorShares::default(), largest)
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
