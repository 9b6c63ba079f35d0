//! What ingest does with the memory it may use.

use super::cells::CHUNK_BYTES;
use super::store::BrickStore;
use crate::cache::BrickShape;
use crate::{Error, Result};

/// The limit where none is given: 1 GiB.
pub const DEFAULT_MEMORY: u64 = 1 << 30;
/// The smallest limit: a few chunks of source cells and bricks for each thread.
const SMALLEST: u64 = 64 << 20;

/// Shares of a memory limit. Passes follow each other, so each may use most of it: half for the
/// pass' cache, a quarter for the bricks being worked on, and a quarter for everything else
/// (sorting, buffers, codecs, the source's library, the allocator).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Plan {
    /// Bytes for sorting (pass 1).
    pub(super) sort: usize,
    /// Bytes of source cells (pass 2).
    pub(super) source_cells: usize,
    /// Bytes of stored bricks (pass 3).
    pub(super) stored_bricks: usize,
    /// Bytes of bricks being worked on.
    working: usize,
}

impl Plan {
    /// Divides `memory` bytes.
    pub(super) fn new(memory: u64) -> Result<Self> {
        if memory < SMALLEST {
            return Err(Error::request(format!(
                "--memory is too small for ingest: the smallest limit that works is {}MiB",
                SMALLEST >> 20
            )));
        }
        let memory = usize::try_from(memory).unwrap_or(usize::MAX);
        // More than this speeds nothing up.
        let memory = memory.min(4 << 30);
        Ok(Self {
            sort: memory / 8,
            source_cells: (memory / 3).max(4 * CHUNK_BYTES),
            stored_bricks: memory / 3,
            working: memory / 6,
        })
    }

    /// Bricks to assemble at a time: each holds its children's averages, a draft and the result;
    /// results of as many wait to be written, and averages for as many have been read.
    pub(super) fn assembly_batch(&self, shape: BrickShape, fields: usize) -> usize {
        let averages = fields * 17 * shape.cells();
        let each = 3 * averages + 2 * BrickStore::brick_bytes(shape, fields);
        (self.working / each).clamp(2, 1024)
    }

    /// Bricks to complete at a time: each holds its stored payloads, while as many are written.
    pub(super) fn completion_batch(&self, shape: BrickShape, fields: usize) -> usize {
        let each = 2 * (fields * shape.payload_bytes(3) + (4 << 10));
        (self.working / each).clamp(2, 1024)
    }
}
