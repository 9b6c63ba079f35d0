//! One picture, from its plan to its film: the goal that a tolerance makes, the transfer function as
//! simple as that allows, and tiles that are drawn again where a relative tolerance asks for it.

mod glance;

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use super::bounds::grade::PacketTransfer;
use super::brick::load::BrickLoader;
use super::camera::rays::PixelGrid;
use super::film::Film;
use super::march::ray::Light;
use super::march::ray_state::Ending;
use super::memory::MemoryPlan;
use super::picture::{Picture, Round, lock};
use super::plan::census::Census;
use super::plan::cut::{Cut, FootprintCut};
use super::plan::effort::Effort;
use super::plan::goal::{Goal, Method, TileError};
use super::plan::tree_walk::{FieldIndex, Walk};
use super::plan::walk_context::{Unseen, WalkContext};
use super::transfer::change::Change;
use super::transfer::pieces::{PieceList, TransferPieces};
use super::transfer::shading::Shading;
use super::transfer::table::TransferTable;
use super::{FixedSetting, RenderOptions, largest_value};
use crate::Result;
use crate::cache::{Cache, Header};
use crate::paging::Pool;
use crate::scene::{Interpolation, Scene, Tolerance};
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
pub(super) struct Renderer<'s> {
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

/// The part of a tolerance relative to the largest value that is known so far that is tried: there may
/// be less.
const FIRST_TRY: f64 = 0.9;
/// Attempts at tiles that turn out to need a smaller tolerance.
const ATTEMPTS: u32 = 12;
/// About so many tiles tell first whether a picture can be certified, and then so many times as many.
const FIRST_TILES: f64 = 4.0;
const MORE_TILES: f64 = 8.0;
/// Few rays of each tile are marched first where a coarser cut may draw no more than this part of the
/// bricks.
const WORTH_SOUNDING: f64 = 0.9;
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
        if shares.levels + shares.digits + shares.pixel_area + shares.proxies <= tolerance {
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

impl<'s> Renderer<'s> {
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
        let census = self.census(pixels, &cut, self.pieces(&transfer))?;
        let method = Method::Once { cut, accounts: false };
        let mut picture = self.picture(pixels, &transfer, method, None, options.progress)?;
        if off > 0.0 {
            picture.light.packets = Some(self.packets(Some(off), light));
        }
        picture.draw(self.threads, self.plan.readers, &Round::WHOLE, samples)?;
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
        if pixels.has_area() && is_exact {
            goal.give_up_certificates();
            goal.power = 1.0;
        } else if pixels.has_area() {
            self.look_out(&mut goal, &effort, &transfer)?;
        }
        let census = self.census(pixels, &goal.first_cut(), self.pieces(&transfer))?;
        if !is_exact {
            let coarser = self.census(pixels, &goal.coarsest_cut(), self.pieces(&transfer))?;
            goal.sounds = (coarser.drawn as f64) < WORTH_SOUNDING * census.drawn as f64;
        }
        let is_once = is_exact && !pixels.has_area();
        let method = if is_once {
            Method::Once { cut: Cut::FullDepth, accounts: true }
        } else {
            Method::Within(goal)
        };
        let allowed = if is_exact { None } else { Some(goal.tolerance) };
        let mut picture = self.picture(pixels, &transfer, method, allowed, options.progress)?;
        let part = match tolerance {
            Tolerance::Relative(part) if !is_exact => Some(part),
            _ => None,
        };
        if !is_once {
            picture.light.packets = Some(self.packets_for(&goal));
        }
        self.draw_within(&mut picture, &mut goal, part, samples)?;
        let rays = picture.rays.load(Ordering::Relaxed);
        let error = Some(worst(&lock(&picture.errors)));
        Ok(Outcome { film: into_inner(picture.film), error, census, rays })
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
            self.draw_tiles(picture, goal, &is_drawn_again, samples)?;
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
            let smaller = FIRST_TRY * limit / goal.tolerance;
            picture.context.unseen = picture.context.unseen.map(|unseen| unseen.times(smaller));
            goal.tolerance = FIRST_TRY * limit;
            goal.behind = largest;
            let brightest = picture.light.ending.brightest;
            picture.light.ending = Ending::new(brightest, ENDING_SHARE * goal.tolerance);
            if let Some(packets) = &mut picture.light.packets {
                packets.aim(goal.of_packets(), goal.behind);
            }
            picture.method = Method::Within(*goal);
        }
        Ok(())
    }

    /// Draws the tiles that `wanted` says. Where they are to be certified, few of them first, spread over
    /// the picture, and more and more: if one cannot be, the picture is not, and no other pays for it.
    fn draw_tiles(
        &self,
        picture: &mut Picture<'_, 's>,
        goal: &mut Goal,
        wanted: &[bool],
        samples: &mut [u64],
    ) -> Result<()> {
        let unwanted = wanted.iter().filter(|wanted| !**wanted).count();
        picture.tiles_done.store(unwanted as u64, Ordering::Relaxed);
        let mut part = FIRST_TILES / wanted.len() as f64;
        let mut done = 0.0;
        while done < 1.0 {
            let is_tried = goal.has_area && goal.certifies && part < 1.0 / MORE_TILES;
            let parts = done..if is_tried { part } else { 1.0 };
            let is_due = |tile: usize| {
                wanted.get(tile).is_none_or(|wanted| *wanted)
                    && parts.contains(&place_in_order(tile))
            };
            let round = Round {
                wanted: &|tile| usize::try_from(tile).map_or(true, is_due),
                is_last: !is_tried,
            };
            picture.draw(self.threads, self.plan.readers, &round, samples)?;
            let errors = lock(&picture.errors);
            let is_within =
                |error: &TileError| matches!(State::of(error, goal.tolerance), State::Within);
            let is_lost = errors.iter().enumerate().any(|(n, e)| is_due(n) && !is_within(e));
            drop(errors);
            if is_tried && is_lost {
                goal.give_up_certificates();
                picture.method = Method::Within(*goal);
            }
            done = parts.end;
            part *= MORE_TILES;
        }
        Ok(())
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
        self.packets(Some(goal.of_packets()), goal.behind)
    }

    /// What packets march by, which may be off by `allowed` along a ray.
    fn packets(&self, allowed: Option<f64>, behind: f64) -> PacketTransfer {
        let close = self.transfer(CLOSE * allowed.unwrap_or(0.0));
        let longest = diagonal(&self.cache.header().domain);
        let table = TransferTable::new(&self.exact.all, &close.merged);
        PacketTransfer::new(table, close, allowed, behind, longest)
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
        transfer: &'p TransferPieces,
        method: Method,
        allowed: Option<f64>,
        progress: Option<&'p (dyn Fn(u64, u64) + Sync)>,
    ) -> Result<Picture<'p, 's>> {
        let (header, pieces) = (self.cache.header(), self.pieces(transfer));
        let view = pixels.view();
        let longest = diagonal(&header.domain);
        let brightest = transfer.brightest().min(transfer.largest_emission() * longest);
        let tiles = usize::try_from(pixels.tiles()).unwrap_or(usize::MAX);
        let unseen = self.unseen(&method, allowed.unwrap_or(0.0), brightest);
        Ok(Picture {
            cache: self.cache,
            light: Light {
                pieces,
                ending: Ending::new(brightest, ENDING_SHARE * allowed.unwrap_or(0.0)),
                packets: None,
            },
            context: WalkContext { unseen, ..self.context(pixels, pieces) },
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

    fn context<'p>(&'p self, pixels: &'p PixelGrid, bounds: &'p PieceList) -> WalkContext<'p> {
        WalkContext {
            header: self.cache.header(),
            view: pixels.view(),
            pixels,
            shading: self.shading,
            bounds,
            unseen: None,
            rounds: self.rounds,
        }
    }

    /// What may be left out where only what is stored is transparent: so much that rays are off by
    /// little over the longest way. Without accounts nobody asks for it, and exact values need none.
    fn unseen(&self, method: &Method, tolerance: f64, brightest: f64) -> Option<Unseen<'_>> {
        if matches!(method, Method::Once { accounts: false, .. }) || self.shading.is_exact() {
            return None;
        }
        let off = UNSEEN_SHARE * tolerance;
        let emission = 0.5 * off / diagonal(&self.cache.header().domain);
        let limit = Change { emission, extinction: emission / brightest.max(1.0) };
        Some(Unseen { exact: &self.exact.all, limit, off })
    }

    /// One walk of the index over the whole picture.
    fn census(&self, pixels: &PixelGrid, cut: &Cut, bounds: &PieceList) -> Result<Census> {
        let context = self.context(pixels, bounds);
        let mut index = FieldIndex { cursor: self.cache.cursor(), field: self.shading.field };
        let mut walk = Walk::new(&context, &mut index, Census::default(), cut, pixels.whole());
        while walk.next(|_, _| 1.0)?.is_some() {}
        Ok(walk.into_tally())
    }
}

/// The part of a tolerance that simpler formulas along rays may take.
const QUADRATURE_SHARE: f64 = 0.05;
/// How much closer the transfer function is followed where packets bound its bends.
const CLOSE: f64 = 0.02;
/// The part of a tolerance that may be lost with bricks that are transparent as they are stored.
const UNSEEN_SHARE: f64 = 0.01;
/// The part of a tolerance that may be lost behind a ray's end.
const ENDING_SHARE: f64 = 0.02;

fn into_inner<T>(mutex: Mutex<T>) -> T {
    mutex.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// The largest of the tiles' errors, and what their pixels need together.
fn worst(errors: &[TileError]) -> TileError {
    errors.iter().fold(TileError::default(), |most, error| TileError {
        shares: if most.shares.total() >= error.shares.total() {
            most.shares
        } else {
            error.shares
        },
        estimate: most.estimate.max(error.estimate),
        fallen: std::array::from_fn(|n| most.fallen[n] + error.fallen[n]),
        rays_needed: most.rays_needed + error.rays_needed,
        beyond: most.beyond + error.beyond,
        unsure: most.unsure + error.unsure,
    })
}

/// Where in the order of tiles that tell of the others one is, of 0 to 1: any first part of them is spread
/// evenly over the picture.
fn place_in_order(tile: usize) -> f64 {
    (tile as f64 * std::f64::consts::GOLDEN_RATIO).fract()
}

/// The domain's diagonal, code length.
fn diagonal(domain: &Domain) -> f64 {
    domain.difference(&domain.upper(), &domain.cell_corner(0, [0; 3])).length()
}
