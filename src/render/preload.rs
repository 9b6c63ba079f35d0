//! All bricks before the first ray, as renderers have them that hold their data in memory.

use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::Builder;
use std::time::{Duration, Instant};

use super::brick::load::{BrickLoader, BrickRequest, BrickScratch};
use super::memory::STACK_BYTES;
use super::picture::finish;
use crate::cache::{Cache, Precision};
use crate::paging::Pool;
use crate::{Error, Result};

/// Loads every brick of field `field` into `pool`, which has a slot for each, on `threads`
/// threads; how long that took.
///
/// # Errors
/// The first of what any thread met: a damaged cache, or no thread to be had.
pub(crate) fn load_all(
    cache: &Cache,
    pool: &Pool<'_, BrickLoader<'_>>,
    field: usize,
    threads: usize,
) -> Result<Duration> {
    let started = Instant::now();
    let next = AtomicU64::new(0);
    let bricks = cache.header().nodes();
    std::thread::scope(|scope| {
        let work = || {
            let outcome = load_some(cache, pool, field, &next);
            if outcome.is_err() {
                next.fetch_max(bricks, Ordering::Relaxed);
            }
            outcome
        };
        let start = |_| {
            let builder = Builder::new().stack_size(STACK_BYTES);
            builder
                .spawn_scoped(scope, work)
                .map_err(|source| Error::io(cache.path(), "cannot start a thread to load", source))
        };
        let workers = (0..threads).map(start).collect::<Result<Vec<_>>>()?;
        workers.into_iter().try_for_each(finish)
    })?;
    Ok(started.elapsed())
}

/// Loads bricks until none is left that no thread has taken.
fn load_some(
    cache: &Cache,
    pool: &Pool<'_, BrickLoader<'_>>,
    field: usize,
    next: &AtomicU64,
) -> Result<()> {
    let (mut scratch, mut cursor) = (BrickScratch::new(cache)?, cache.cursor());
    let bricks = cache.header().nodes();
    loop {
        let node = next.fetch_add(1, Ordering::Relaxed);
        if node >= bricks {
            return Ok(());
        }
        let (record, described) = (cursor.node(node)?, cursor.field(node, field)?);
        // Nothing is stored of what was dropped.
        if !described.is_void() {
            let place = cursor.place(node)?;
            let (last_tile, precision) = (u64::MAX, Precision::Full);
            let request =
                BrickRequest { node, place, record, field: described, last_tile, precision };
            pool.load_ahead(&request, &mut scratch)?;
        }
    }
}
