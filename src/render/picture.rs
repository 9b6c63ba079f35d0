//! The threads that draw a picture's tiles, and those that read ahead of them.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread::{Builder, Scope, ScopedJoinHandle};

use crossbeam::channel::Receiver;

use super::load::{BrickLoader, BrickRequest, BrickScratch};
use super::memory::STACK_BYTES;
use super::scaled::ScaledBrick;
use super::tile::{Light, Tile};
use super::tree_walk::{FieldIndex, Scenery, Step, Walk};
use crate::cache::Cache;
use crate::image::Film;
use crate::paging::{Pinned, Pool, ReadAhead, run_reader};
use crate::{Error, Result};

/// Steps that a tile's walk is ahead of its march. More would read more of what turns out to be
/// hidden; each marching thread has one reader, which these keep busy.
const STEPS_AHEAD: usize = 4;

/// A picture being drawn: what its threads share.
pub(super) struct Picture<'r> {
    pub(super) cache: &'r Cache,
    pub(super) scenery: Scenery<'r>,
    pub(super) light: Light,
    pub(super) pool: Pool<'r, BrickLoader<'r>>,
    pub(super) film: Mutex<Film>,
    pub(super) progress: Option<&'r (dyn Fn(u64, u64) + Sync)>,
    pub(super) next_tile: AtomicU64,
    pub(super) tiles_done: AtomicU64,
    pub(super) is_stopped: AtomicBool,
}

impl Picture<'_> {
    /// Draws all tiles on `threads` threads, with `readers` more that read ahead. Returns the
    /// samples taken at each level of the tree.
    ///
    /// # Errors
    /// The first of what any thread met: all others stop.
    pub(super) fn draw(&self, threads: usize, readers: usize) -> Result<Vec<u64>> {
        let (ahead, requests) = ReadAhead::new(STEPS_AHEAD * threads);
        let samples = std::thread::scope(|scope| {
            let workers = self.launch(scope, threads, (ahead, readers, requests));
            if workers.is_err() {
                self.is_stopped.store(true, Ordering::Relaxed);
            }
            Ok::<_, Error>(workers?.into_iter().map(finish).collect::<Vec<_>>())
        })?;
        let mut sums = vec![0; self.scenery.header.levels.len()];
        for worker in samples {
            for (sum, samples) in sums.iter_mut().zip(worker?) {
                *sum += samples;
            }
        }
        Ok(sums)
    }

    /// Starts the threads. The readers end when no one is left to ask, so they do when starting
    /// another thread fails.
    fn launch<'s>(
        &'s self,
        scope: &'s Scope<'s, '_>,
        threads: usize,
        (ahead, readers, requests): (ReadAhead<BrickRequest>, usize, Receiver<BrickRequest>),
    ) -> Result<Vec<ScopedJoinHandle<'s, Result<Vec<u64>>>>> {
        for _ in 0..readers {
            let (mut scratch, requests) = (BrickScratch::new(self.cache)?, requests.clone());
            self.start(scope, move || run_reader(&self.pool, &requests, &mut scratch))?;
        }
        let start = |_| {
            let worker = Worker::new(self, ahead.clone(), BrickScratch::new(self.cache)?);
            self.start(scope, move || worker.run())
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

    fn is_stopped(&self) -> bool {
        self.is_stopped.load(Ordering::Relaxed)
    }
}

fn finish<T>(thread: ScopedJoinHandle<'_, T>) -> T {
    thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

/// A thread that draws tiles.
struct Worker<'p, 'r> {
    picture: &'p Picture<'r>,
    ahead: ReadAhead<BrickRequest>,
    scratch: BrickScratch,
    tile: Tile,
    queue: VecDeque<Step>,
    pins: Pins,
    samples: Vec<u64>,
}

impl<'p, 'r> Worker<'p, 'r> {
    fn new(
        picture: &'p Picture<'r>,
        ahead: ReadAhead<BrickRequest>,
        scratch: BrickScratch,
    ) -> Self {
        let levels = picture.scenery.header.levels.len();
        Self {
            picture,
            ahead,
            scratch,
            tile: Tile::new(),
            queue: VecDeque::with_capacity(STEPS_AHEAD),
            pins: Pins::new(levels),
            samples: vec![0; levels],
        }
    }

    fn run(mut self) -> Result<Vec<u64>> {
        let outcome = self.draw_tiles();
        if outcome.is_err() {
            self.picture.is_stopped.store(true, Ordering::Relaxed);
        }
        outcome.map(|()| self.samples)
    }

    fn draw_tiles(&mut self) -> Result<()> {
        let picture = self.picture;
        let total = picture.scenery.rays.tiles();
        let field = picture.scenery.shading.field;
        let mut index = FieldIndex { cursor: picture.cache.cursor(), field };
        loop {
            let tile = picture.next_tile.fetch_add(1, Ordering::Relaxed);
            if tile >= total || picture.is_stopped() {
                return Ok(());
            }
            self.draw_tile(tile, &mut index)?;
            let done = picture.tiles_done.fetch_add(1, Ordering::Relaxed) + 1;
            if let Some(progress) = picture.progress {
                progress(done, total);
            }
        }
    }

    fn draw_tile(&mut self, tile: u64, index: &mut FieldIndex<'_>) -> Result<()> {
        let (picture, rays) = (self.picture, self.picture.scenery.rays);
        let rect = rays.tile(tile);
        self.tile.start(rays, rect);
        let mut walk = Walk::new(&picture.scenery, index, (), rect);
        while !picture.is_stopped() {
            self.look_ahead(&mut walk)?;
            let Some(step) = self.queue.pop_front() else { break };
            self.draw_step(&step)?;
        }
        self.queue.clear();
        self.pins.release(0);
        let [left, top] = rect.lo.map(|ray| ray / rays.per_axis());
        let width = rect.columns().len() as u32 / rays.per_axis();
        let pixels = self.tile.pixels(rays);
        let mut film = picture.film.lock().unwrap_or_else(PoisonError::into_inner);
        film.write_rectangle(left, top, width, pixels)
    }

    /// Walks on until enough steps wait, and asks for their bricks.
    fn look_ahead(&mut self, walk: &mut Walk<'_, FieldIndex<'_>, ()>) -> Result<()> {
        while self.queue.len() < STEPS_AHEAD {
            let tile = &self.tile;
            let Some(step) = walk.next(|rays| tile.needs(rays))? else { return Ok(()) };
            if !self.pins.holds(&step.request) {
                self.ahead.request(&self.picture.pool, step.request);
            }
            self.queue.push_back(step);
        }
        Ok(())
    }

    fn draw_step(&mut self, step: &Step) -> Result<()> {
        let level = step.request.place.tree_level;
        // The walk has left whatever lies deeper.
        self.pins.release(level + 1);
        if self.tile.needs(&step.rays) {
            let Picture { pool, scenery, light, .. } = self.picture;
            let brick = self.pins.hold(&step.request, pool, &mut self.scratch)?;
            let drawn = scenery.cut.drawn_neighbours(&step.request.place);
            self.samples[level] += self.tile.draw(step, brick, drawn, light);
        }
        if step.is_last {
            self.pins.release(level);
        }
        Ok(())
    }
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
        pin.is_some_and(|(node, _)| *node == request.node)
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
            *pin = Some((request.node, pool.get(request, scratch)?));
        }
        pin.as_ref().map(|(_, brick)| &**brick).ok_or_else(beyond)
    }
}
