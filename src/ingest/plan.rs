//! What ingest does with the memory it may use.

use super::cells::CHUNK_BYTES;
use super::store::BrickStore;
use crate::cache::BrickShape;
use crate::spelling::size;
use crate::{Error, Result};

/// The limit where none is given: 1 GiB.
pub const DEFAULT_MEMORY: u64 = 1 << 30;
/// The smallest limit.
const SMALLEST: usize = 64 << 20;
/// Caches and bricks of more than this speed nothing up.
const LARGEST: usize = 4 << 30;
/// Bytes for what grows with neither bricks nor threads: buffers, codecs, the source's library, and
/// what the allocator keeps.
const REST: usize = 24 << 20;
/// Bytes of source cells that a thread holds while it reads: a chunk, and what becomes of it.
const READING: usize = 2 * CHUNK_BYTES;
/// Bytes of source cells that are kept at least.
const FEWEST_SOURCE_CELLS: usize = 4 * CHUNK_BYTES;
/// Bricks that are worked on at a time, at least and at most.
const FEWEST_BRICKS: usize = 2;
const MOST_BRICKS: usize = 1024;

/// A memory limit, of which pass 1 takes its share before the bricks are known. Passes follow each
/// other, so each may use most of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Plan {
    memory: usize,
}

/// What passes 2 and 3 do with a memory limit: a third at most for the pass' cache, a sixth or more
/// for the bricks being worked on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Shares {
    /// Threads for which there is room.
    pub(super) threads: usize,
    /// Bytes of source cells (pass 2).
    pub(super) source_cells: usize,
    /// Bytes of stored bricks (pass 3).
    pub(super) stored_bricks: usize,
    /// Bricks to assemble at a time (pass 2).
    pub(super) assembled: usize,
    /// Bricks to complete at a time (pass 3).
    pub(super) completed: usize,
}

impl Plan {
    /// A plan for `memory` bytes.
    ///
    /// # Errors
    /// A limit in which no ingest works.
    pub(super) fn new(memory: u64) -> Result<Self> {
        let memory = usize::try_from(memory).unwrap_or(usize::MAX).min(isize::MAX as usize);
        if memory < SMALLEST {
            return Err(Error::request(format!(
                "--memory {} is too small to read an output: the smallest that works is {}MiB",
                size(memory as u64),
                SMALLEST >> 20
            )));
        }
        Ok(Self { memory })
    }

    /// Bytes for sorting (pass 1).
    pub(super) fn sort(&self) -> usize {
        self.memory.min(LARGEST) / 8
    }

    /// Divides what there is among at most `threads` threads that work on bricks of `shape` with
    /// `fields` fields.
    ///
    /// # Errors
    /// A limit that is too small for one thread.
    pub(super) fn shares(
        &self,
        threads: usize,
        shape: BrickShape,
        fields: usize,
    ) -> Result<Shares> {
        let memory = self.memory;
        let (assembly, completion) =
            (assembly_bytes(shape, fields), completion_bytes(shape, fields));
        let each = assembly.max(completion);
        let bricks = FEWEST_BRICKS.saturating_mul(each);
        let least = bricks.saturating_add(REST + READING + FEWEST_SOURCE_CELLS);
        if least > memory {
            return Err(Error::request(format!(
                "--memory {} is too small for {fields} fields in bricks of {}³: the smallest limit that \
                 works is {}MiB; fewer fields or smaller bricks take less",
                size(memory as u64),
                shape.edge(),
                least.div_ceil(1 << 20)
            )));
        }
        let shared = memory.min(LARGEST);
        let working = bricks.max(shared / 6);
        let left = memory.saturating_sub(REST + working);
        // One thread is in what is least.
        let threads = (1 + left / (READING + each)).clamp(1, threads.max(1));
        let cache = (shared / 3).min(left.saturating_sub(threads * READING));
        Ok(Shares {
            threads,
            source_cells: cache.max(FEWEST_SOURCE_CELLS),
            stored_bricks: cache,
            assembled: (working / assembly).clamp(FEWEST_BRICKS, MOST_BRICKS),
            completed: (working / completion).clamp(FEWEST_BRICKS, MOST_BRICKS),
        })
    }
}

/// What a brick takes while it is assembled: its children's averages, a draft and the result;
/// results of as many wait to be written, and averages for as many have been read.
fn assembly_bytes(shape: BrickShape, fields: usize) -> usize {
    let averages = fields.saturating_mul(17 * shape.cells());
    let stored = fields.saturating_mul(BrickStore::brick_bytes(shape, 1));
    averages.saturating_mul(3).saturating_add(stored.saturating_mul(2))
}

/// What a brick takes while it is completed: a stored brick beside it, and its payloads, while those
/// of as many are written.
fn completion_bytes(shape: BrickShape, fields: usize) -> usize {
    let stored = BrickStore::brick_bytes(shape, 1);
    let payloads = 2 * (shape.payload_bytes(3) + (4 << 10));
    fields.saturating_mul(stored + payloads)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cache::MAX_FIELDS;

    #[test]
    fn many_fields_leave_room_for_fewer_threads_and_at_last_for_none() {
        let plan = Plan::new(64 << 20).unwrap();
        let shape = BrickShape::new(16).unwrap();
        let threads = |fields| plan.shares(64, shape, fields).map(|shares| shares.threads).ok();
        assert!(threads(1) > threads(40), "{:?} {:?}", threads(1), threads(40));
        assert!(threads(40) < Some(4), "{:?}", threads(40));
        assert_eq!(threads(1000), None);
        let roomy = Plan::new(8 << 30).unwrap();
        assert_eq!(roomy.shares(64, shape, 1).unwrap().threads, 64);
    }

    #[test]
    fn shares_stay_within_the_limit() {
        for (memory, edge, fields) in [(64, 8, 1), (64, 16, 40), (256, 32, 30), (4096, 32, 300)] {
            let (plan, shape) = (Plan::new(memory << 20).unwrap(), BrickShape::new(edge).unwrap());
            let shares = plan.shares(64, shape, fields).unwrap();
            let assembly = assembly_bytes(shape, fields) * shares.assembled + shares.source_cells;
            let completion =
                completion_bytes(shape, fields) * shares.completed + shares.stored_bricks;
            for pass in [assembly, completion] {
                assert!(pass + shares.threads * READING <= plan.memory, "{shares:?}");
            }
        }
    }

    #[test]
    fn no_number_of_fields_overflows() {
        let (plan, shape) = (Plan::new(u64::MAX).unwrap(), BrickShape::new(32).unwrap());
        assert!(plan.shares(1, shape, usize::MAX).is_err());
    }

    #[test]
    fn the_limit_that_is_named_works() {
        let shape = BrickShape::new(32).unwrap();
        for fields in [30, MAX_FIELDS] {
            let refusal = Plan::new(64 << 20).unwrap().shares(8, shape, fields).unwrap_err();
            let refusal = refusal.to_string();
            assert!(refusal.starts_with("--memory 64MiB is too small for "), "{refusal}");
            let (_, named) = refusal.split_once("works is ").unwrap();
            let least: u64 = named.split_once("MiB").unwrap().0.parse().unwrap();
            assert!(Plan::new(least << 20).unwrap().shares(8, shape, fields).is_ok());
            assert!(Plan::new((least - 1) << 20).unwrap().shares(8, shape, fields).is_err());
        }
    }
}
