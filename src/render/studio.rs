//! One picture, from its plan to its film: the goal that a tolerance makes, the transfer function as
//! simple as that allows, and tiles that are drawn again where a relative tolerance asks for it.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use super::bounds::grade::PacketTransfer;
use super::brick::load::BrickLoader;
use super::camera::rays::PixelGrid;
use super::camera::view::View;
use super::film::Film;
use super::march::ray::Light;
use super::march::ray_state::Ending;
use super::memory::MemoryPlan;
use super::picture::{Method, Picture, lock};
use super::plan::census::Census;
use super::plan::cut::{Cut, FootprintCut};
use super::plan::effort::Effort;
use super::plan::goal::{Goal, TileError};
use super::plan::tree_walk::{FieldIndex, Scenery, Walk};
use super::transfer::pieces::{PieceList, TransferPieces};
use super::transfer::shading::Shading;
use super::transfer::table::TransferTable;
use super::{EXACT, FixedSetting, RenderOptions, largest_value};
use crate::Result;
use crate::cache::{Cache, Header};
use crate::paging::Pool;
use crate::scene::{Interpolation, Samples, Scene, Tolerance};
use crate::space::Domain;

/// A finished picture, before statistics are made of it.
pub(super) struct Outcome {
    pub(super) film: Film,
    /// How far its worst pixel may be off, if that is known.
    pub(super) error: Option<TileError>,
    pub(super) census: Census,
    pub(super) rays: u64,
}

/// What all attempts at a picture share.
pub(super) struct Studio<'s> {
    pub(super) cache: &'s Cache,
    pub(super) scene: &'s Scene,
    pub(super) shading: &'s Shading,
    /// The transfer function without simplifications.
    pub(super) exact: &'s TransferPieces,
    pub(super) pool: &'s Pool<'s, BrickLoader<'s>>,
    pub(super) plan: &'s MemoryPlan,
    /// Whether values may be read in fewer digits than are stored.
    pub(super) rounds: bool,
    pub(super) threads: usize,
}

/// A glance is at most this many pixels wide or high, or rays where it has fewer pixels.
const GLANCE_PIXELS: u32 = 64;
/// A glance that saw less than one part in so many of what rays meet was misled by means; and what these
/// rays may be off by, as a part of it.
const MISLED: f64 = 4.0;
const ROUGHLY: f64 = 0.25;
/// So many an outlook is taken from: enough for an average, and not enough to meet all bricks of a
/// large set.
const OUTLOOK_PIXELS: u32 = 24;
/// The part of a tolerance relative to the largest value of a glance that is tried first: what a
/// glance sees may be brighter than the picture's pixels.
const FIRST_TRY: f64 = 0.9;
/// What is sure of the picture's largest value is less by what it may be off by itself: the part of the
/// tolerance that is tried allows for that, and for a little more.
const SURE: f64 = 0.97;
/// Attempts at tiles that turn out to need a smaller tolerance.
const ATTEMPTS: u32 = 12;
/// Rays for each pixel, of either kind, where no glance has seen anything.
const SKETCH_RAYS: u64 = 16;
/// Rays for each of the pixels that an outlook is taken from.
const OUTLOOK_RAYS: u64 = 5;

/// Bytes that are kept for each tile of a picture.
pub(super) const TILE_BYTES: u64 =
    (size_of::<TileError>() + size_of::<State>() + size_of::<bool>()) as u64;

/// How a tile has turned out, beside the goal that it was drawn by.
#[derive(Debug, Clone, Copy)]
enum State {
    /// Within it.
    Within,
    /// Within it in all likelihood.
    Likely,
    /// Not within reach of the rays that there are.
    Beyond,
}

impl State {
    /// How a tile that may be off like this has turned out, beside a goal of so much `tolerance`.
    fn of(TileError { shares, estimate, .. }: &TileError, tolerance: f64) -> Self {
        if shares.levels + shares.pixel_area <= tolerance {
            Self::Within
        } else if *estimate <= tolerance {
            Self::Likely
        } else {
            Self::Beyond
        }
    }

    /// What the tile is off by, as far as more work changes it.
    fn off(self, error: &TileError) -> f64 {
        match self {
            Self::Within => error.shares.total(),
            Self::Likely => error.estimate,
            Self::Beyond => 0.0,
        }
    }
}

impl<'s> Studio<'s> {
    /// By settings that ask nothing of the error.
    pub(super) fn by_hand(
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
        Ok(Outcome { film: into_inner(picture.film), error: None, census, rays })
    }

    /// So that no pixel is off by more than the scene's tolerance.
    pub(super) fn by_tolerance(
        &self,
        pixels: &PixelGrid,
        options: &RenderOptions<'_>,
        samples: &mut [u64],
    ) -> Result<Outcome> {
        let tolerance = self.scene.render.tolerance;
        let is_exact = matches!(tolerance, Tolerance::Absolute(0.0) | Tolerance::Relative(0.0));
        let effort = Effort::of(pixels.whole().count() as u64);
        let mut goal = self.first_goal(pixels, &effort, is_exact)?;
        let transfer = self.transfer(if is_exact { 0.0 } else { goal.tolerance });
        let pieces = self.pieces(&transfer);
        if pixels.has_area() && !is_exact {
            self.look_out(&mut goal, &effort, (&transfer, pieces))?;
        }
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
            picture.light.packets = Some(self.packets_for(&goal));
        }
        if let (Some(part), true) = (part, pixels.has_area() && goal.behind == 0.0) {
            self.sketch(&mut picture, &mut goal, part, samples)?;
        }
        self.draw_within(&mut picture, &mut goal, part, samples)?;
        let rays = picture.rays.load(Ordering::Relaxed);
        let error = Some(worst(&lock(&picture.errors)));
        Ok(Outcome { film: into_inner(picture.film), error, census, rays })
    }

    /// The goal by a glance, before anything is known of pixels' areas.
    fn first_goal(&self, pixels: &PixelGrid, effort: &Effort, is_exact: bool) -> Result<Goal> {
        let glance = if is_exact && !pixels.has_area() { 0.0 } else { self.glance()? };
        let goal = self.goal_for(glance, effort, is_exact);
        if is_exact || !pixels.has_area() {
            return Ok(goal);
        }
        // Areas take many rays where the goal is too small.
        let rays = self.second_glance(&goal)?;
        let is_misled = rays > MISLED * glance;
        Ok(if is_misled { self.goal_for(0.5 * rays, effort, is_exact) } else { goal })
    }

    fn goal_for(&self, glance: f64, effort: &Effort, is_exact: bool) -> Goal {
        Goal {
            tolerance: match self.scene.render.tolerance {
                _ if is_exact => EXACT * glance,
                Tolerance::Absolute(value) => value,
                Tolerance::Relative(part) if glance > 0.0 => {
                    FIRST_TRY.min(SURE / (1.0 + part)) * part * glance
                }
                Tolerance::Relative(_) => f64::MIN_POSITIVE,
            },
            behind: glance,
            rays_per_pixel: effort.most,
            alone_per_pixel: effort.most_alone,
            least_halvings: effort.least_halvings,
            certifies: true,
            power: f64::INFINITY,
            all_levels: is_exact,
        }
    }

    /// Decides whether pixels' areas are to be certified, and how many rays that may take.
    fn look_out(
        &self,
        goal: &mut Goal,
        effort: &Effort,
        transfer: (&TransferPieces, &PieceList),
    ) -> Result<()> {
        let outlook = self.outlook(goal, transfer)?;
        let is_worthwhile = outlook.rays_needed <= effort.worthwhile as f64;
        goal.certifies = outlook.beyond == 0.0 && is_worthwhile;
        goal.rays_per_pixel = if goal.certifies { effort.most_certified } else { effort.scouting };
        goal.power = outlook.power;
        Ok(())
    }

    /// Draws a `picture` of which no glance has seen anything with few rays a pixel, for a `goal` that is
    /// `part` of what they find: without one all that may be there would be worth every ray.
    fn sketch(
        &self,
        picture: &mut Picture<'_, 's>,
        goal: &mut Goal,
        part: f64,
        samples: &mut [u64],
    ) -> Result<()> {
        let few = |rays: u64| rays.min(SKETCH_RAYS);
        let (rays_per_pixel, alone_per_pixel) =
            (few(goal.rays_per_pixel), few(goal.alone_per_pixel));
        picture.method = Method::Within(Goal { rays_per_pixel, alone_per_pixel, ..*goal });
        picture.draw((self.threads, self.plan.readers), &|_| true, samples)?;
        let found = largest_value(&lock(&picture.film))?;
        // Few rays may have found too much.
        let tolerance = if found > 0.0 { 0.5 * part * found } else { goal.tolerance };
        Self::aim(picture, goal, tolerance, found);
        Ok(())
    }

    /// Draws `picture` within `goal`; where that is to be a part of the picture's largest value,
    /// which is known only then, tiles that have turned out too coarse are drawn again. Those that
    /// could not be brought within the goal are left: a smaller one changes nothing.
    fn draw_within(
        &self,
        picture: &mut Picture<'_, 's>,
        goal: &mut Goal,
        part: Option<f64>,
        samples: &mut [u64],
    ) -> Result<()> {
        let mut is_drawn_again = vec![true; lock(&picture.errors).len()];
        let mut states = vec![State::Within; is_drawn_again.len()];
        for _ in 0..ATTEMPTS {
            let wanted = |tile: u64| {
                let wanted = usize::try_from(tile).ok().and_then(|tile| is_drawn_again.get(tile));
                wanted.copied().unwrap_or(true)
            };
            picture.draw((self.threads, self.plan.readers), &wanted, samples)?;
            let Some(part) = part else { return Ok(()) };
            let errors = lock(&picture.errors);
            for (n, error) in errors.iter().enumerate().filter(|(n, _)| is_drawn_again[*n]) {
                states[n] = State::of(error, goal.tolerance);
            }
            let bounds = || errors.iter().zip(&states).map(|(error, state)| state.off(error));
            let bound = bounds().fold(0.0, f64::max);
            let largest = largest_value(&lock(&picture.film))?;
            let limit = part * (largest - bound).max(0.5 * largest);
            for (again, bound) in is_drawn_again.iter_mut().zip(bounds()) {
                *again = bound > limit;
            }
            drop(errors);
            // Where the goal would be the same, what is left is not for more work to change.
            let is_settled = FIRST_TRY * limit >= 0.99 * goal.tolerance;
            if is_settled || !is_drawn_again.contains(&true) {
                return Ok(());
            }
            Self::aim(picture, goal, FIRST_TRY * limit, largest);
        }
        Ok(())
    }

    /// Gives `picture` another `goal`.
    fn aim(picture: &mut Picture<'_, 's>, goal: &mut Goal, tolerance: f64, behind: f64) {
        (goal.tolerance, goal.behind) = (tolerance, behind);
        if let Some(packets) = &mut picture.light.packets {
            packets.aim(PACKET_SHARE * goal.tolerance, goal.behind);
        }
        picture.method = Method::Within(*goal);
    }

    /// The largest value of a small picture, drawn without regard to its error: through cells as wide as
    /// its pixels, and if these show nothing through all levels. What shines may do so at values that no
    /// mean has.
    fn glance(&self) -> Result<f64> {
        let largest = self.glance_through(|cut| Cut::Footprint(cut.in_short()))?;
        if largest > 0.0 { Ok(largest) } else { self.glance_through(|_| Cut::FullDepth) }
    }

    fn glance_through(&self, levels: impl Fn(FootprintCut) -> Cut) -> Result<f64> {
        let (scene, _) = self.small(GLANCE_PIXELS);
        let view = View::new(&scene, &self.cache.header().domain)?;
        let most = (GLANCE_PIXELS / scene.image.width.max(scene.image.height)).max(1);
        let rays = match self.scene.render.samples {
            Samples::Grid(rays) => rays.min(most),
            Samples::Area => most,
        };
        let pixels = PixelGrid::new(&view, Samples::Grid(rays));
        let Header { domain, shape, .. } = self.cache.header();
        let cut = FootprintCut::new(f64::from(rays).recip(), &scene, domain, *shape)?;
        let method = Method::Once { cut: levels(cut), accounts: false };
        let exact = (self.exact, self.pieces(self.exact));
        let mut picture = self.picture(&pixels, exact, method, None, None)?;
        picture.light.packets = Some(self.packets(None, 0.0));
        picture.draw((self.threads, self.plan.readers), &|_| true, &mut [])?;
        largest_value(&into_inner(picture.film))
    }

    /// The largest value of a small picture of single rays that are roughly right.
    fn second_glance(&self, goal: &Goal) -> Result<f64> {
        let (scene, _) = self.small(GLANCE_PIXELS);
        let view = View::new(&scene, &self.cache.header().domain)?;
        let pixels = PixelGrid::new(&view, Samples::Grid(1));
        let tolerance = ROUGHLY * goal.behind.max(f64::MIN_POSITIVE);
        let mut goal = Goal { tolerance, ..*goal };
        let transfer = self.transfer(tolerance);
        let pieces = self.pieces(&transfer);
        let method = Method::Within(goal);
        let mut picture =
            self.picture(&pixels, (&transfer, pieces), method, Some(tolerance), None)?;
        picture.light.packets = Some(self.packets_for(&goal));
        self.draw_within(&mut picture, &mut goal, Some(ROUGHLY), &mut [])?;
        largest_value(&into_inner(picture.film))
    }

    /// The scene, in a picture of at most so many pixels along an edge, no more than a tile has. And
    /// how wide the scene's own pixels are in it.
    fn small(&self, pixels: u32) -> (Scene, f64) {
        let Scene { image, .. } = self.scene;
        let scale = f64::from(pixels) / f64::from(image.width.max(image.height));
        let mut scene = self.scene.clone();
        if scale >= 1.0 {
            return (scene, 1.0);
        }
        let scaled = |size: u32| ((f64::from(size) * scale).round() as u32).max(1);
        (scene.image.width, scene.image.height) = (scaled(image.width), scaled(image.height));
        (scene, scale)
    }

    /// What a few pixels, quartered once, say of how bounds of pixels' areas will fall.
    fn outlook(&self, goal: &Goal, transfer: (&TransferPieces, &PieceList)) -> Result<TileError> {
        let (scene, part) = self.small(OUTLOOK_PIXELS);
        let view = View::new(&scene, &self.cache.header().domain)?;
        let pixels = PixelGrid::sparse(&view, part);
        let quartered = Goal { rays_per_pixel: OUTLOOK_RAYS, alone_per_pixel: 1, ..*goal };
        let mut picture =
            self.picture(&pixels, transfer, Method::Within(quartered), Some(goal.tolerance), None)?;
        picture.light.packets = Some(self.packets_for(goal));
        picture.draw((self.threads, self.plan.readers), &|_| true, &mut [])?;
        // It is one tile.
        Ok(worst(&lock(&picture.errors)))
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

    /// What packets march by towards a goal.
    fn packets_for(&self, goal: &Goal) -> PacketTransfer {
        self.packets(Some(PACKET_SHARE * goal.tolerance), goal.behind)
    }

    /// What packets march by, which may be off by `allowed` along a ray.
    fn packets(&self, allowed: Option<f64>, behind: f64) -> PacketTransfer {
        let close = self.transfer(CLOSE * allowed.unwrap_or(0.0));
        let longest = diagonal(&self.cache.header().domain);
        let table = TransferTable::new(&self.exact.all, &close.merged);
        PacketTransfer::new((table, close), (allowed, behind), longest)
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
            scenery: self.scenery(pixels, pieces),
            method,
            exact: &self.exact.all,
            pool: self.pool,
            thinned: self.plan.thinned,
            film: Mutex::new(Film::new(view.width(), view.height())?),
            errors: Mutex::new(vec![TileError::default(); tiles]),
            progress,
            turns: Mutex::default(),
            tiles_done: AtomicU64::new(0),
            rays: AtomicU64::new(0),
            is_stopped: AtomicBool::new(false),
        })
    }

    fn scenery<'p>(&'p self, pixels: &'p PixelGrid, bounds: &'p PieceList) -> Scenery<'p> {
        Scenery {
            header: self.cache.header(),
            view: pixels.view(),
            pixels,
            shading: self.shading,
            bounds,
            rounds: self.rounds,
        }
    }

    /// One walk of the index over the whole picture.
    fn census(&self, pixels: &PixelGrid, cut: &Cut, bounds: &PieceList) -> Result<Census> {
        let scenery = self.scenery(pixels, bounds);
        let mut index = FieldIndex { cursor: self.cache.cursor(), field: self.shading.field };
        let mut walk = Walk::new(&scenery, &mut index, Census::default(), cut, pixels.whole());
        while walk.next(|_, _| 1.0)?.is_some() {}
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
fn worst(errors: &[TileError]) -> TileError {
    errors.iter().fold(TileError::default(), |most, error| TileError {
        shares: if most.shares.total() >= error.shares.total() {
            most.shares
        } else {
            error.shares
        },
        estimate: most.estimate.max(error.estimate),
        power: most.power.max(error.power),
        rays_needed: most.rays_needed.max(error.rays_needed),
        beyond: most.beyond.max(error.beyond),
    })
}

/// The domain's diagonal, code length.
fn diagonal(domain: &Domain) -> f64 {
    domain.difference(&domain.upper(), &domain.cell_corner(0, [0; 3])).length()
}
