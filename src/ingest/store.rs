//! The assembled bricks of all levels between pass 2 and pass 3, on disk.

use std::path::Path;
use std::sync::Arc;

use super::assemble::{Counts, FieldCells};
use super::load_cache::LoadCache;
use super::spool::Spool;
use crate::Result;
use crate::cache::BrickShape;

/// Where a brick stands among those of its level, and what it has beneath.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Topology {
    /// Number of the first child within the next level.
    pub(super) first_child: u64,
    pub(super) child_mask: u8,
    pub(super) octant: u8,
    pub(super) counts: Counts,
}

impl Topology {
    const BYTES: usize = 24;

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
    topology: Spool,
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
        let topology = Spool::new(directory)?;
        Ok(Self { cells, topology, levels: Vec::new(), shape, fields, bricks: 0 })
    }

    /// Bytes of one brick's cells.
    pub(super) fn brick_bytes(shape: BrickShape, fields: usize) -> usize {
        fields * (4 + 5 * shape.cells())
    }

    /// Begins the next coarser level.
    pub(super) fn begin_level(&mut self) {
        self.levels.push(Level { first: self.bricks, count: 0 });
    }

    /// Appends a brick to the level begun last.
    pub(super) fn push(&mut self, topology: Topology, fields: &[FieldCells]) -> Result<()> {
        self.topology.append(&topology.to_bytes())?;
        if let Some(spool) = &mut self.cells {
            for field in fields {
                spool.append(&field.exponent.to_le_bytes())?;
                spool.append(&field.states)?;
                let bytes: Vec<u8> = field.values.iter().flat_map(|v| v.to_le_bytes()).collect();
                spool.append(&bytes)?;
            }
        }
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
        self.topology.flush()
    }

    /// Number of levels.
    pub(super) fn depth(&self) -> usize {
        self.levels.len()
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
        let place = self.number(level, brick) * Topology::BYTES as u64;
        self.topology.read(place, &mut bytes)?;
        Ok(Topology::from_bytes(&bytes))
    }

    /// All fields of brick `brick` of tree level `level`.
    fn cells(&self, level: usize, brick: u64) -> Result<Vec<FieldCells>> {
        let Some(spool) = &self.cells else { return Ok(Vec::new()) };
        let mut bytes = vec![0; Self::brick_bytes(self.shape, self.fields)];
        spool.read(self.number(level, brick) * bytes.len() as u64, &mut bytes)?;
        let cells = self.shape.cells();
        let field = |bytes: &[u8]| FieldCells {
            exponent: bytes[..4].try_into().map_or(0, i32::from_le_bytes),
            states: bytes[4..4 + cells].to_vec(),
            values: bytes[4 + cells..]
                .chunks_exact(4)
                .map(|word| word.try_into().map_or(0.0, f32::from_le_bytes))
                .collect(),
        };
        Ok(bytes.chunks_exact(bytes.len() / self.fields).map(field).collect())
    }
}

/// Reads stored bricks through a bounded cache, for several threads.
pub(super) struct StoredBricks<'s> {
    store: &'s BrickStore,
    cache: LoadCache<(usize, u64), Vec<FieldCells>>,
}

impl<'s> StoredBricks<'s> {
    pub(super) fn new(store: &'s BrickStore, memory: usize) -> Self {
        Self { store, cache: LoadCache::new(memory) }
    }

    /// All fields of brick `brick` of tree level `level`.
    pub(super) fn get(&self, level: usize, brick: u64) -> Result<Arc<Vec<FieldCells>>> {
        let bytes = BrickStore::brick_bytes(self.store.shape, self.store.fields);
        self.cache.get((level, brick), bytes, || self.store.cells(level, brick))
    }
}
