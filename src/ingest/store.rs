//! The assembled bricks of all levels between pass 2 and pass 3, on disk.

use std::path::Path;
use std::sync::Arc;

use super::assemble::{Counts, FieldCells};
use super::load_cache::LoadCache;
use super::packed::unpack;
use super::spool::Spool;
use crate::Result;
use crate::cache::BrickShape;

/// Where a brick stands among those of its level, and what it has beneath.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Topology {
    /// Number of the first child within the next level.
    pub(super) first_child: u64,
    /// Which octants have a child: bit `x + 2y + 4z`.
    pub(super) child_mask: u8,
    /// The brick's own octant in its parent, `x + 2y + 4z`.
    pub(super) octant: u8,
    /// Its cells, by kind.
    pub(super) counts: Counts,
}

impl Topology {
    const BYTES: usize = 22;

    fn to_bytes(self) -> [u8; Self::BYTES] {
        let mut bytes = [0; Self::BYTES];
        bytes[..8].copy_from_slice(&self.first_child.to_le_bytes());
        let counts = [self.counts.existing, self.counts.refined, self.counts.leaf];
        for (i, count) in counts.into_iter().enumerate() {
            bytes[8 + 4 * i..12 + 4 * i].copy_from_slice(&count.to_le_bytes());
        }
        (bytes[20], bytes[21]) = (self.child_mask, self.octant);
        bytes
    }

    fn from_bytes(bytes: &[u8]) -> Self {
        let word = |at: usize| bytes[at..at + 4].try_into().map_or(0, u32::from_le_bytes);
        Self {
            first_child: bytes[..8].try_into().map_or(0, u64::from_le_bytes),
            counts: Counts { existing: word(8), refined: word(12), leaf: word(16) },
            child_mask: bytes[20],
            octant: bytes[21],
        }
    }
}

/// One level's bricks in the spools.
#[derive(Debug, Clone, Copy)]
struct Level {
    first: u64,
    count: u64,
}

/// Bricks of all levels, addressed by level and number within it.
pub(super) struct BrickStore {
    cells: Option<Spool>,
    /// An entry a brick.
    table: Spool,
    /// Finest level first, as they were made.
    levels: Vec<Level>,
    shape: BrickShape,
    fields: usize,
    bricks: u64,
}

impl BrickStore {
    /// An empty store; without `keep_cells` it holds the topology only.
    pub(super) fn new(
        directory: &Path,
        shape: BrickShape,
        fields: usize,
        keep_cells: bool,
    ) -> Result<Self> {
        let cells = keep_cells.then(|| Spool::new(directory)).transpose()?;
        let table = Spool::new(directory)?;
        Ok(Self { cells, table, levels: Vec::new(), shape, fields, bricks: 0 })
    }

    /// Bytes of an entry of the table of bricks: topology, and where the packed cells lie.
    const ENTRY: u64 = Topology::BYTES as u64 + 12;

    /// Bytes of one brick's cells in memory.
    pub(super) fn brick_bytes(shape: BrickShape, fields: usize) -> usize {
        fields * (4 + 5 * shape.cells())
    }

    /// Begins the next coarser level.
    pub(super) fn begin_level(&mut self) {
        self.levels.push(Level { first: self.bricks, count: 0 });
    }

    /// Appends a brick to the level begun last, with all its fields [packed](super::packed).
    pub(super) fn push(&mut self, topology: Topology, packed: &[u8]) -> Result<()> {
        let place = match &mut self.cells {
            Some(spool) => spool.append(packed)?,
            None => 0,
        };
        let mut entry = [0; Self::ENTRY as usize];
        let (of_topology, of_cells) = entry.split_at_mut(Topology::BYTES);
        of_topology.copy_from_slice(&topology.to_bytes());
        of_cells[..8].copy_from_slice(&place.to_le_bytes());
        let length = u32::try_from(packed.len()).unwrap_or(u32::MAX);
        of_cells[8..].copy_from_slice(&length.to_le_bytes());
        self.table.append(&entry)?;
        self.bricks += 1;
        if let Some(level) = self.levels.last_mut() {
            level.count += 1;
        }
        Ok(())
    }

    /// All bricks are in.
    pub(super) fn flush(&mut self) -> Result<()> {
        if let Some(spool) = &mut self.cells {
            spool.flush()?;
        }
        self.table.flush()
    }

    /// Number of bricks at tree level `level` (0 = root).
    pub(super) fn bricks(&self, level: usize) -> u64 {
        self.level(level).map_or(0, |level| level.count)
    }

    fn level(&self, level: usize) -> Option<&Level> {
        self.levels.get(self.levels.len().checked_sub(level + 1)?)
    }

    fn number(&self, level: usize, brick: u64) -> u64 {
        self.level(level).map_or(0, |level| level.first) + brick
    }

    /// Topology of brick `brick` of tree level `level`.
    pub(super) fn topology(&self, level: usize, brick: u64) -> Result<Topology> {
        let mut bytes = [0; Topology::BYTES];
        self.table.read(self.number(level, brick) * Self::ENTRY, &mut bytes)?;
        Ok(Topology::from_bytes(&bytes))
    }

    /// All fields of brick `brick` of tree level `level`.
    fn cells(&self, level: usize, brick: u64) -> Result<Vec<FieldCells>> {
        let Some(spool) = &self.cells else { return Ok(Vec::new()) };
        let mut place = [0; 12];
        let entry = self.number(level, brick) * Self::ENTRY;
        self.table.read(entry + Topology::BYTES as u64, &mut place)?;
        let (start, length) = place.split_at(8);
        let start = start.try_into().map_or(0, u64::from_le_bytes);
        let length = length.try_into().map_or(0, u32::from_le_bytes);
        let mut packed = vec![0; length as usize];
        spool.read(start, &mut packed)?;
        let mut rest = packed.as_slice();
        (0..self.fields).map(|_| unpack(self.shape, &mut rest)).collect()
    }
}

/// Reads stored bricks through a bounded cache, for several threads.
pub(super) struct StoredBricks<'s> {
    store: &'s BrickStore,
    cache: LoadCache<(usize, u64), Vec<FieldCells>>,
}

impl<'s> StoredBricks<'s> {
    /// A cache in front of `store` that keeps up to `memory` bytes of bricks.
    pub(super) fn new(store: &'s BrickStore, memory: usize) -> Self {
        Self { store, cache: LoadCache::new(memory) }
    }

    /// All fields of brick `brick` of tree level `level`.
    pub(super) fn get(&self, level: usize, brick: u64) -> Result<Arc<Vec<FieldCells>>> {
        let bytes = BrickStore::brick_bytes(self.store.shape, self.store.fields);
        self.cache.get((level, brick), bytes, || self.store.cells(level, brick))
    }
}
