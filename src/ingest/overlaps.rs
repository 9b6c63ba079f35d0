//! Pass 1: which grids lie in which bricks, from boxes alone.

use std::cmp::Ordering;
use std::path::Path;

use super::morton;
use super::sort::{Record, Sorted, Sorter};
use super::spool::Spool;
use crate::cache::BrickShape;
use crate::source::{GridBlock, GridRecord, Source};
use crate::space::{Domain, IndexBox, Levels};
use crate::{Error, Result};

/// Cells along an edge of the cubes that grids are first cut into: the smallest brick, of which
/// the larger ones are made.
pub(super) const CUBE_EDGE: u32 = 8;

/// Most cells of one grid: more than any code gives a process.
const MAX_GRID_CELLS: u128 = 1 << 36;
/// Larger grids are read once, at their last cell, before anything is laid out for them: so a size
/// that no data back up costs no more than the records of a grid of this size, 4096 cubes.
const TRUSTED_GRID_CELLS: u128 = 1 << 21;

/// One grid reaches into one cube of [`CUBE_EDGE`]³ cells of its level.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Overlap {
    /// Octree level.
    pub(super) octree: u32,
    /// Cube coordinates at that level.
    pub(super) cube: [u128; 3],
    /// Number of the grid in the [`GridTable`].
    pub(super) grid: u64,
}

impl Ord for Overlap {
    /// Finest level first, then Morton order, then the grids' own order.
    fn cmp(&self, other: &Self) -> Ordering {
        other
            .octree
            .cmp(&self.octree)
            .then_with(|| morton::compare(&self.cube, &other.cube))
            .then_with(|| self.grid.cmp(&other.grid))
    }
}

impl PartialOrd for Overlap {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Record for Overlap {
    const BYTES: usize = 60;

    fn put(&self, bytes: &mut [u8]) {
        bytes[..4].copy_from_slice(&self.octree.to_le_bytes());
        bytes[4..12].copy_from_slice(&self.grid.to_le_bytes());
        for (a, coordinate) in self.cube.iter().enumerate() {
            bytes[12 + 16 * a..28 + 16 * a].copy_from_slice(&coordinate.to_le_bytes());
        }
    }

    fn get(bytes: &[u8]) -> Self {
        let wide = |at: usize| bytes[at..at + 16].try_into().map_or(0, u128::from_le_bytes);
        Self {
            octree: bytes[..4].try_into().map_or(0, u32::from_le_bytes),
            grid: bytes[4..12].try_into().map_or(0, u64::from_le_bytes),
            cube: [wide(12), wide(28), wide(44)],
        }
    }
}

/// The grids' records, on disk.
pub(super) struct GridTable {
    spool: Spool,
}

impl GridTable {
    const BYTES: usize = 80;

    fn push(&mut self, grid: &GridRecord) -> Result<u64> {
        let mut bytes = [0; Self::BYTES];
        bytes[..8].copy_from_slice(&grid.id.to_le_bytes());
        bytes[8..16].copy_from_slice(&grid.locator.to_le_bytes());
        bytes[16..20].copy_from_slice(&grid.level.to_le_bytes());
        for a in 0..3 {
            bytes[20 + 16 * a..36 + 16 * a].copy_from_slice(&grid.lo[a].to_le_bytes());
            bytes[68 + 4 * a..72 + 4 * a].copy_from_slice(&grid.size[a].to_le_bytes());
        }
        Ok(self.spool.append(&bytes)? / Self::BYTES as u64)
    }

    /// Grid number `number`.
    pub(super) fn get(&self, number: u64) -> Result<GridRecord> {
        let mut bytes = [0; Self::BYTES];
        self.spool.read(number * Self::BYTES as u64, &mut bytes)?;
        let wide = |at: usize| bytes[at..at + 16].try_into().map_or(0, i128::from_le_bytes);
        let long = |at: usize| bytes[at..at + 8].try_into().map_or(0, u64::from_le_bytes);
        let word = |at: usize| bytes[at..at + 4].try_into().map_or(0, u32::from_le_bytes);
        Ok(GridRecord {
            id: long(0),
            locator: long(8),
            level: word(16),
            lo: [wide(20), wide(36), wide(52)],
            size: [word(68), word(72), word(76)],
        })
    }
}

/// What pass 1 found.
pub(super) struct Layout {
    /// All grids.
    pub(super) grids: GridTable,
    /// Grids per cube, in the order that pass 2 works.
    pub(super) overlaps: Sorted<Overlap>,
    /// Grids at each octree level from 0 down to the deepest that has any.
    pub(super) grids_per_level: Vec<u64>,
    /// Cubes of each size (8³, 16³, 32³ cells) that hold data, over all levels.
    pub(super) cubes: [u64; 3],
}

/// Reads the hierarchy of `source`, leaving out grids deeper than simulation level `max_level`.
/// `field` is one that will be ingested.
pub(super) fn lay_out(
    source: &dyn Source,
    field: usize,
    max_level: Option<u32>,
    directory: &Path,
    memory: usize,
) -> Result<Layout> {
    let hierarchy = source.hierarchy();
    let mut sorter = Sorter::new(directory, memory)?;
    let mut grids = GridTable { spool: Spool::new(directory)? };
    let mut grids_per_level = Vec::new();
    source.for_each_grid(&mut |grid| {
        if max_level.is_some_and(|most| grid.level > most) {
            return Ok(());
        }
        let octree = check_grid(source, field, &hierarchy.domain, &hierarchy.levels, &grid)?;
        let number = grids.push(&grid)?;
        let at = octree as usize;
        if grids_per_level.len() <= at {
            grids_per_level.resize(at + 1, 0);
        }
        grids_per_level[at] += 1;
        cut_into_cubes(&grid, octree, number, &mut sorter)
    })?;
    grids.spool.flush()?;
    if grids_per_level.is_empty() {
        return Err(Error::invalid(source.path().display(), "the output has no grids"));
    }
    let overlaps = sorter.finish()?;
    let cubes = count_cubes(&overlaps)?;
    Ok(Layout { grids, overlaps, grids_per_level, cubes })
}

/// The grid's octree level, once its box is seen to lie in the domain.
fn check_grid(
    source: &dyn Source,
    field: usize,
    domain: &Domain,
    levels: &Levels,
    grid: &GridRecord,
) -> Result<u32> {
    let refuse = |reason: String| {
        Err(Error::invalid(source.path().display(), format!("grid {}: {reason}", grid.id)))
    };
    let Some(octree) = levels.octree(grid.level as usize) else {
        return refuse(format!("level {} is beyond the output's levels", grid.level));
    };
    let all = IndexBox { lo: [0; 3], hi: domain.root_cells().map(|n| i128::from(n) << octree) };
    if grid.cells().is_empty() || !all.contains(&grid.cells()) {
        return refuse(format!(
            "cells {:?} to {:?} of level {} do not lie in the domain",
            grid.cells().lo,
            grid.cells().hi,
            grid.level
        ));
    }
    let cells: u128 = grid.size.iter().map(|&n| u128::from(n)).product();
    if cells > MAX_GRID_CELLS {
        return refuse(format!("{cells} cells: grids of at most 2^36 cells are supported"));
    }
    if cells > TRUSTED_GRID_CELLS {
        let last = GridBlock { lo: grid.size.map(|n| n - 1), size: [1; 3] };
        source.read(grid, field, last, &mut [0.0])?;
    }
    Ok(octree)
}

fn cut_into_cubes(
    grid: &GridRecord,
    octree: u32,
    number: u64,
    sorter: &mut Sorter<Overlap>,
) -> Result<()> {
    let cubes = grid.cells().coarsened(CUBE_EDGE.trailing_zeros());
    let range = |a: usize| cubes.lo[a].unsigned_abs()..cubes.hi[a].unsigned_abs();
    for z in range(2) {
        for y in range(1) {
            for x in range(0) {
                sorter.push(Overlap { octree, cube: [x, y, z], grid: number })?;
            }
        }
    }
    Ok(())
}

/// Distinct cubes of 8³, 16³ and 32³ cells. Larger ones follow each other in the same order.
fn count_cubes(overlaps: &Sorted<Overlap>) -> Result<[u64; 3]> {
    let mut counts = [0; 3];
    let mut last: [Option<(u32, [u128; 3])>; 3] = [None; 3];
    let mut merge = overlaps.iter()?;
    while let Some(overlap) = merge.next()? {
        for (shift, (last, count)) in last.iter_mut().zip(&mut counts).enumerate() {
            let key = (overlap.octree, overlap.cube.map(|c| c >> shift));
            if *last != Some(key) {
                *count += 1;
                *last = Some(key);
            }
        }
    }
    Ok(counts)
}

/// What a cell of a brick costs, by brick size (8³, 16³), beside its share of ghosts and ancestors'
/// blocks: small bricks cost more seeks and records each. Bricks of 32³, whose cells cost 1.3, are
/// never chosen: eight of 16³ that hold the same cost less. Decoded they are 0.4 MB, leave the
/// second-level cache, and are read whole where a part would do (`cargo bench` shows that).
const CELL_COST: [f64; 2] = [1.1, 1.0];

/// The brick size that costs least for the cubes that hold data: how well grids fill bricks, how
/// much ghosts add, and what bricks of that size cost to march through.
pub(super) fn choose_shape(cubes: [u64; 3]) -> Result<BrickShape> {
    let mut best: Option<(f64, BrickShape)> = None;
    for ((edge, count), cell_cost) in [8, 16].into_iter().zip(cubes).zip(CELL_COST) {
        let shape = BrickShape::new(edge)?;
        let cost = count as f64 * shape.cells_in_blocks(2) as f64 * cell_cost;
        if best.is_none_or(|(least, _)| cost < least) {
            best = Some((cost, shape));
        }
    }
    best.map(|(_, shape)| shape).ok_or_else(|| Error::request("no brick size fits"))
}
