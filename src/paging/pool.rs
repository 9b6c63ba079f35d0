//! A fixed number of slots for bricks, filled as they are asked for and reused by a clock hand.

use std::ops::Deref;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use super::clock::{Claim, Clock, Found};
use super::{Counters, Loaded, Loader, Request};
use crate::{Error, Result};

/// A brick in use: its slot is not reused while this lives.
#[derive(Debug)]
pub(crate) struct Pinned<B>(Arc<B>);

impl<B> Deref for Pinned<B> {
    type Target = B;

    fn deref(&self) -> &B {
        &self.0
    }
}

/// Bricks in at most `slots` slots, each created when first needed and then reused.
///
/// A thread that asks for a brick that another one is loading waits for it. If that load fails,
/// the waiting thread tries itself, so that each gets its own error, and the pool goes on.
/// Nothing ever waits for a slot: those who pin must be few enough (see [`Self::get`]).
pub(crate) struct Pool<'l, L: Loader> {
    loader: L,
    counters: &'l Counters,
    clock: Mutex<Clock<L::Brick>>,
    changed: Condvar,
}

impl<'l, L: Loader> Pool<'l, L> {
    /// A pool of at most `slots` slots that `loader` fills; loads are counted in `counters`.
    pub(crate) fn new(slots: usize, loader: L, counters: &'l Counters) -> Self {
        Self { loader, counters, clock: Mutex::new(Clock::new(slots)), changed: Condvar::new() }
    }

    /// Bytes of the pool's own for each slot, beside the brick in it.
    pub(crate) const fn slot_overhead() -> u64 {
        Clock::<L::Brick>::slot_bytes()
    }

    /// The brick that `request` names, loaded if it is not there.
    ///
    /// # Errors
    /// What the loader says; and when every slot is pinned or being filled, which cannot happen
    /// if there are as many slots as all threads together pin and fill at a time.
    pub(crate) fn get(
        &self,
        request: &L::Request,
        scratch: &mut L::Scratch,
    ) -> Result<Pinned<L::Brick>> {
        let mut clock = self.lock();
        let (key, last_turn) = (request.key(), request.last_turn());
        loop {
            match clock.find(key, last_turn) {
                Found::Ready(brick) => return Ok(Pinned(brick)),
                Found::Loading => clock = self.wait(clock),
                Found::Absent => {
                    let claim =
                        clock.claim(key, || self.loader.new_brick()).ok_or_else(all_in_use)?;
                    drop(clock);
                    return self.fill_for_use(request, claim, scratch).map(Pinned);
                }
            }
        }
    }

    /// Waits until some brick has been loaded, or could not be.
    fn wait<'c>(&self, clock: MutexGuard<'c, Clock<L::Brick>>) -> MutexGuard<'c, Clock<L::Brick>> {
        let started = Instant::now();
        let clock = self.changed.wait(clock).unwrap_or_else(PoisonError::into_inner);
        self.counters.count_wait(started.elapsed());
        clock
    }

    /// Fills a slot for the thread that needs it: the file's part of that is waiting, the rest work.
    fn fill_for_use(
        &self,
        request: &L::Request,
        claim: Claim<L::Brick>,
        scratch: &mut L::Scratch,
    ) -> Result<Arc<L::Brick>> {
        let started = Instant::now();
        let (brick, loaded) = self.fill(request, claim, scratch, true)?;
        self.counters.count_wait(loaded.reading);
        self.counters.count_work(started.elapsed().saturating_sub(loaded.reading));
        Ok(brick)
    }

    /// Turns begin anew: none is over.
    pub(crate) fn begin_turns(&self) {
        self.lock().forget_turns();
    }

    /// All turns before `turn` are over: slots of bricks that only these need are the first to be
    /// reused, before new ones are made.
    pub(crate) fn turns_are_over(&self, turn: u64) {
        self.lock().turns_are_over(turn);
    }

    /// Whether the brick of `key` is there or on its way.
    pub(crate) fn holds(&self, key: u64) -> bool {
        self.lock().holds(key)
    }

    /// Says that a brick will be asked for soon; whether it has to be loaded for that.
    pub(super) fn announce(&self, request: &L::Request) -> bool {
        let absent = !self.holds(request.key());
        if absent {
            self.loader.announce(request);
        }
        absent
    }

    /// Loads the brick ahead of its use. Does nothing if the pool holds it, if who asked for it did not
    /// wait and no turn to come needs it, or if every free slot holds a brick that others will need
    /// sooner. The brick is not pinned, but kept longer than bricks already used.
    ///
    /// # Errors
    /// What the loader says. Who then asks for the brick gets the error again.
    pub(crate) fn load_ahead(&self, request: &L::Request, scratch: &mut L::Scratch) -> Result<()> {
        let mut clock = self.lock();
        if clock.holds(request.key()) || clock.is_over(request.last_turn()) {
            return Ok(());
        }
        let Some(claim) = clock.claim_idle(request.key(), || self.loader.new_brick()) else {
            return Ok(());
        };
        drop(clock);
        self.fill(request, claim, scratch, false).map(drop)
    }

    fn fill(
        &self,
        request: &L::Request,
        claim: Claim<L::Brick>,
        scratch: &mut L::Scratch,
        used: bool,
    ) -> Result<(Arc<L::Brick>, Loaded)> {
        let key = request.key();
        let Claim { place, brick } = claim;
        let mut filling = Filling { pool: self, key, place, brick: Some(brick) };
        let brick = filling.brick.as_mut().and_then(Arc::get_mut).ok_or_else(all_in_use)?;
        let loaded = self.loader.load(request, scratch, brick)?;
        let (brick, form) = (request.brick(), request.form());
        self.counters.count_load(brick, form, request.level(), &loaded);
        let brick = filling.publish(used, request.last_turn()).ok_or_else(all_in_use)?;
        Ok((brick, loaded))
    }

    fn lock(&self) -> MutexGuard<'_, Clock<L::Brick>> {
        self.clock.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A slot being filled. Dropped before it is published (an error, a panic), it frees the slot
/// and wakes those who wait for the brick.
struct Filling<'p, 'l, L: Loader> {
    pool: &'p Pool<'l, L>,
    key: u64,
    place: usize,
    brick: Option<Arc<L::Brick>>,
}

impl<L: Loader> Filling<'_, '_, L> {
    fn publish(mut self, used: bool, last_turn: u64) -> Option<Arc<L::Brick>> {
        let brick = self.brick.take()?;
        self.pool.lock().publish(self.place, Arc::clone(&brick), used, last_turn);
        self.pool.changed.notify_all();
        Some(brick)
    }
}

impl<L: Loader> Drop for Filling<'_, '_, L> {
    fn drop(&mut self) {
        if let Some(brick) = self.brick.take() {
            self.pool.lock().release(self.place, self.key, brick);
            self.pool.changed.notify_all();
        }
    }
}

fn all_in_use() -> Error {
    Error::request("every slot of the brick pool is in use: raise --memory or lower --threads")
}

#[cfg(test)]
#[path = "pool_tests.rs"]
mod tests;
