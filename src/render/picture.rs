//! The threads that draw a picture's tiles, and those that read ahead of them.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::{Builder, Scope, ScopedJoinHandle};

use super::brick::load::{BrickLoader, BrickRequest, BrickScratch};
use super::brick::scaled::ScaledBrick;
use super::camera::rays::PixelRect;
use super::film::Film;
use super::march::ray::Light;
use super::memory::STACK_BYTES;
use super::plan::cut::{Cut, ErrorCut};
use super::plan::goal::{Method, TileError};
use super::plan::tree_walk::{FieldIndex, Step, Walk};
use super::plan::turns::Turns;
use super::plan::walk_context::WalkContext;
use super::tiles::ray_batch::{RayBatch, Settings, Thinning};
use super::tiles::refine::{Batch, TilePixels};
use super::transfer::pieces::PieceList;
use crate::cache::Cache;
use crate::paging::{Pinned, Pool, ReadAhead, Request, run_reader};
use crate::{Error, Result};

/// Steps that a tile's walk is ahead of its march. More would read more of what turns out to be
/// hidden; so many keep the reader threads busy (one a marching thread, at most four).
const STEPS_AHEAD: usize = 4;

/// A picture being drawn: what its threads share.
pub(super) struct Picture<'r, 's> {
    /// The cache that is drawn.
    pub(super) cache: &'r Cache,
    /// What the tree is walked by.
    pub(super) context: WalkContext<'r>,
    /// What rays march by.
    pub(super) light: Light<'r>,
    /// How tiles are drawn.
    pub(super) method: Method,
    /// The transfer function without simplifications, by which bricks are surveyed.
    pub(super) exact: &'r PieceList,
    /// The decoded bricks.
    pub(super) pool: &'r Pool<'s, BrickLoader<'s>>,
    /// Bricks of which each marching thread may keep thinner ones.
    pub(super) thinned: usize,
    /// The picture so far.
    pub(super) film: Mutex<Film>,
    /// How far each tile may be off.
    pub(super) errors: Mutex<Vec<TileError>>,
    /// Gets the tiles done and the tiles in all.
    pub(super) progress: Option<&'r (dyn Fn(u64, u64) + Sync)>,
    /// Which tiles are in hand, and which is next.
    pub(super) turns: Mutex<Turns>,
    /// Tiles done.
    pub(super) tiles_done: AtomicU64,
    /// Rays marched.
    pub(super) rays: AtomicU64,
    /// Whether threads are to stop, since one has failed.
    pub(super) is_stopped: AtomicBool,
}

/// Some of a picture's tiles, which are drawn together.
pub(super) struct Round<'w> {
    /// Whether a tile is one of them.
    pub(super) wanted: &'w (dyn Fn(u64) -> bool + Sync),
    /// Whether no others follow that may need the same bricks.
    pub(super) is_last: bool,
}

impl Round<'static> {
    /// All tiles.
    pub(super) const WHOLE: Self = Self { wanted: &|_| true, is_last: true };
}

impl Picture<'_, '_> {
    /// Draws the tiles of `round` on `threads` threads, with `readers` more that
    /// read ahead. Adds the samples taken at each level of the tree to `samples`.
    ///
    /// # Errors
    /// The first of what any thread met: all others stop.
    pub(super) fn draw(
        &self,
        threads: usize,
        readers: usize,
        round: &Round<'_>,
        samples: &mut [u64],
    ) -> Result<()> {
        *lock(&self.turns) = Turns::default();
        self.pool.begin_turns();
        let workers = std::thread::scope(|scope| {
            let workers = self.launch(scope, threads, readers, round);
            if workers.is_err() {
                self.is_stopped.store(true, Ordering::Relaxed);
            }
            Ok::<_, Error>(workers?.into_iter().map(finish).collect::<Vec<_>>())
        })?;
        for worker in workers {
            for (sum, samples) in samples.iter_mut().zip(worker?) {
                *sum += samples;
            }
        }
        Ok(())
    }

    /// Starts the threads. The readers end when no one is left to ask, so they do when starting
    /// another thread fails.
    fn launch<'s>(
        &'s self,
        scope: &'s Scope<'s, '_>,
        threads: usize,
        readers: usize,
        round: &'s Round<'_>,
    ) -> Result<Vec<ScopedJoinHandle<'s, Result<Vec<u64>>>>> {
        let (ahead, requests) = ReadAhead::new(STEPS_AHEAD * threads);
        for _ in 0..readers {
            let (mut scratch, requests) = (BrickScratch::new(self.cache)?, requests.clone());
            self.start(scope, move || run_reader(self.pool, &requests, &mut scratch))?;
        }
        let start = |_| {
            let worker = Worker::new(self, ahead.clone(), BrickScratch::new(self.cache)?);
            self.start(scope, move || worker.run(round))
        };
        (0..threads).map(start).collect()
    }

    fn start<'s, T: Send + 's>(
        &'s self,
        scope: &'s Scope<'s, '_>,
        work: impl FnOnce() -> T + Send + 's,
    ) -> Result<ScopedJoinHandle<'s, T>> {
        Builder::new().stack_size(STACK_BYTES).spawn_scoped(scope, work).map_err(|source| {
            Error::io(self.cache.path(), "cannot start a thread to render", source)
        })
    }

    /// What bricks may be off by that a batch draws in fewer cells.
    fn thinning(&self, batch: &Batch) -> Option<Thinning<'_>> {
        match batch.cut {
            Cut::Error(ErrorCut { limit, behind, .. }) if self.method.keeps_accounts() => {
                let (limit, room) = (THIN_SHARE * limit, PROXIES_SHARE * limit);
                Some(Thinning { pieces: self.exact, limit, room, behind })
            }
            _ => None,
        }
    }

    fn is_stopped(&self) -> bool {
        self.is_stopped.load(Ordering::Relaxed)
    }
}

/// Waits for a thread and takes on its panic, if it has any.
pub(super) fn finish<T>(thread: ScopedJoinHandle<'_, T>) -> T {
    thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

/// A thread that draws tiles.
struct Worker<'p, 'r, 's> {
    picture: &'p Picture<'r, 's>,
    ahead: ReadAhead<BrickRequest>,
    scratch: BrickScratch,
    rays: RayBatch,
    queue: VecDeque<Step>,
    pins: Pins,
    samples: Vec<u64>,
}

/// The end of a thread's work: if it is an error, or a panic, the others stop too.
struct End<'p> {
    is_stopped: &'p AtomicBool,
    is_good: bool,
}

impl Drop for End<'_> {
    fn drop(&mut self) {
        if !self.is_good {
            self.is_stopped.store(true, Ordering::Relaxed);
        }
    }
}

impl<'p, 'r, 's> Worker<'p, 'r, 's> {
    fn new(
        picture: &'p Picture<'r, 's>,
        ahead: ReadAhead<BrickRequest>,
        scratch: BrickScratch,
    ) -> Self {
        let levels = picture.context.header.levels.len();
        Self {
            picture,
            ahead,
            scratch,
            rays: RayBatch::new(picture.thinned),
            queue: VecDeque::with_capacity(STEPS_AHEAD),
            pins: Pins::new(levels),
            samples: vec![0; levels],
        }
    }

    fn run(mut self, round: &Round<'_>) -> Result<Vec<u64>> {
        let mut end = End { is_stopped: &self.picture.is_stopped, is_good: false };
        self.draw_tiles(round)?;
        end.is_good = true;
        Ok(self.samples)
    }

    fn draw_tiles(&mut self, round: &Round<'_>) -> Result<()> {
        let picture = self.picture;
        let total = picture.context.pixels.tiles();
        let mut tile_pixels = TilePixels::default();
        loop {
            let tile = lock(&picture.turns).take();
            if tile >= total || picture.is_stopped() {
                return Ok(());
            }
            let is_wanted = (round.wanted)(tile);
            if is_wanted {
                self.draw_tile(tile, &mut tile_pixels)?;
            }
            let over = lock(&picture.turns).finish(tile);
            if round.is_last {
                picture.pool.turns_are_over(over);
            }
            if is_wanted {
                let done = picture.tiles_done.fetch_add(1, Ordering::Relaxed) + 1;
                if let Some(progress) = picture.progress {
                    progress(done, total);
                }
            }
        }
    }

    fn draw_tile(&mut self, tile: u64, tile_pixels: &mut TilePixels) -> Result<()> {
        let picture = self.picture;
        let rect = picture.context.pixels.tile(tile);
        tile_pixels.start(picture.context.pixels, rect, &picture.method);
        while let Some(batch) = tile_pixels.next(picture.context.pixels) {
            let unseen = self.draw_batch(rect, &batch)?;
            if picture.is_stopped() {
                return Ok(());
            }
            let outcome = self.rays.outcome(&picture.light, unseen);
            tile_pixels.judge(picture.context.pixels, &batch, outcome);
        }
        let number = usize::try_from(tile).unwrap_or(usize::MAX);
        if let Some(error) = lock(&picture.errors).get_mut(number) {
            *error = tile_pixels.error();
        }
        let width = rect.hi[0] - rect.lo[0];
        lock(&picture.film).write_rectangle(rect.lo[0], rect.lo[1], width, tile_pixels.pixels())
    }

    /// Marches all rays of a batch; returns what they may be off by for what was left out as transparent.
    fn draw_batch(&mut self, rect: PixelRect, batch: &Batch) -> Result<f64> {
        let picture = self.picture;
        let mut index =
            FieldIndex { cursor: picture.cache.cursor(), field: picture.context.shading.field };
        picture.rays.fetch_add(batch.squares.len() as u64, Ordering::Relaxed);
        self.rays.start(picture.context.pixels, rect, &batch.squares, batch.has_area);
        let mut walk = Walk::new(&picture.context, &mut index, (), &batch.cut, rect);
        while !picture.is_stopped() {
            self.look_ahead(&mut walk)?;
            let Some(step) = self.queue.pop_front() else { break };
            self.draw_step(&step, batch)?;
        }
        self.queue.clear();
        self.pins.release(0);
        Ok(walk.unseen_error())
    }

    /// Walks on until enough steps wait, and asks for their bricks.
    fn look_ahead(&mut self, walk: &mut Walk<'_, FieldIndex<'_>, ()>) -> Result<()> {
        while self.queue.len() < STEPS_AHEAD {
            let rays = &self.rays;
            let needed = |pixels: &_, footprint: &_| rays.needs(pixels, footprint);
            let Some(step) = walk.next(needed)? else { return Ok(()) };
            if !self.pins.holds(&step.request) {
                self.ahead.request(self.picture.pool, step.request);
            }
            self.queue.push_back(step);
        }
        Ok(())
    }

    fn draw_step(&mut self, step: &Step, batch: &Batch) -> Result<()> {
        let level = step.request.place.tree_level;
        // The walk has left whatever lies deeper.
        self.pins.release(level + 1);
        if self.rays.needs(&step.pixels, &step.footprint) > 0.0 {
            let Picture { pool, context, light, method, .. } = self.picture;
            let brick = self.pins.hold(&step.request, pool, &mut self.scratch)?;
            let drawn = batch.cut.drawn_neighbours(&step.request.place);
            let settings = Settings {
                light,
                grid: context.pixels,
                accounts: method.keeps_accounts(),
                care: batch.care,
                thinning: self.picture.thinning(batch),
            };
            self.samples[level] += self.rays.draw(step, brick, drawn, settings);
        }
        if step.is_last {
            self.pins.release(level);
        }
        Ok(())
    }
}

/// What a brick may be off by because it is drawn in fewer cells than it has, as a part of what a cut
/// lets it be off by: many such bricks lie along a ray.
const THIN_SHARE: f64 = 1.0 / 4.0;
/// What a ray may be off by in all because others are marched in its place, as a part of what a cut lets
/// a brick be off by: three fifths of the tolerance at first. It is what gains most by it, so that
/// little is left unused.
const PROXIES_SHARE: f64 = 4.0;

/// Locks `mutex`, also after a panic of another thread.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The bricks on a walk's way down: one at each level of the tree at most.
struct Pins {
    levels: Vec<Option<(u64, Pinned<ScaledBrick>)>>,
}

impl Pins {
    fn new(levels: usize) -> Self {
        Self { levels: (0..levels).map(|_| None).collect() }
    }

    fn holds(&self, request: &BrickRequest) -> bool {
        let pin = self.levels.get(request.place.tree_level).and_then(Option::as_ref);
        pin.is_some_and(|(key, _)| *key == request.key())
    }

    /// Lets go of the bricks from level `level` down.
    fn release(&mut self, level: usize) {
        for pin in self.levels.iter_mut().skip(level) {
            *pin = None;
        }
    }

    fn hold<'b>(
        &'b mut self,
        request: &BrickRequest,
        pool: &Pool<'_, BrickLoader<'_>>,
        scratch: &mut BrickScratch,
    ) -> Result<&'b ScaledBrick> {
        let held = self.holds(request);
        let beyond = || Error::request("a brick lies deeper than the tree; ingest the data again");
        let pin = self.levels.get_mut(request.place.tree_level).ok_or_else(beyond)?;
        if !held {
            *pin = None;
            *pin = Some((request.key(), pool.get(request, scratch)?));
        }
        pin.as_ref().map(|(_, brick)| &**brick).ok_or_else(beyond)
    }
}
