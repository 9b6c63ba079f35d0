//! Source cells through a bounded cache.

use super::advice;
use super::load_cache::LoadCache;
use super::overlaps::GridTable;
use crate::source::{GridBlock, GridRecord, Source};
use crate::space::IndexBox;
use crate::{Error, Result};

/// Takes a row of cells along x: the first cell's level index, and the values.
pub(super) type RowVisitor<'v> = dyn FnMut([i128; 3], &[f64]) -> Result<()> + 'v;

/// Cells along an edge of what is read from a grid at a time: large enough for long rows.
const CHUNK_EDGE: u32 = 64;

/// Bytes of the largest chunk.
pub(super) const CHUNK_BYTES: usize = 8 * (CHUNK_EDGE as usize).pow(3);

/// The blocks that `grid` is read in.
pub fn chunks(grid: &GridRecord) -> impl Iterator<Item = GridBlock> {
    let grid = *grid;
    let [nx, ny, nz] = grid.size.map(|n| n.div_ceil(CHUNK_EDGE));
    let rows = (0..nz).flat_map(move |z| (0..ny).map(move |y| [y, z]));
    rows.flat_map(move |[y, z]| (0..nx).map(move |x| chunk(&grid, [x, y, z])))
}

/// The block of `grid` that is the `number`th along each axis.
fn chunk(grid: &GridRecord, number: [u32; 3]) -> GridBlock {
    let lo = number.map(|n| n * CHUNK_EDGE);
    GridBlock { lo, size: std::array::from_fn(|a| CHUNK_EDGE.min(grid.size[a] - lo[a])) }
}

/// Reads source cells by level index, in chunks of up to 64³ cells.
pub(super) struct SourceCells<'s> {
    source: &'s dyn Source,
    grids: &'s GridTable,
    fields: &'s [usize],
    records: LoadCache<u64, GridRecord>,
    chunks: LoadCache<(u64, usize, [u32; 3]), Vec<f64>>,
}

impl<'s> SourceCells<'s> {
    /// The name of a field, by its number among those that are read.
    pub(super) fn field_name(&self, field: usize) -> &str {
        &self.source.hierarchy().fields[self.fields[field]].name
    }

    /// How to bring values of a field between bounds, by its number among those that are read.
    pub(super) fn advice(&self, field: usize, bounded: fn(&str) -> String) -> String {
        advice::to_limit(self.source, self.fields[field], bounded)
    }

    /// Reads `fields` (indices into the source's) of `grids`, keeping `memory` bytes of them.
    pub(super) fn new(
        source: &'s dyn Source,
        grids: &'s GridTable,
        fields: &'s [usize],
        memory: usize,
    ) -> Self {
        let records = LoadCache::new(1 << 20);
        Self { source, grids, fields, records, chunks: LoadCache::new(memory) }
    }

    /// The record of grid `number`.
    pub(super) fn grid(&self, number: u64) -> Result<std::sync::Arc<GridRecord>> {
        self.records.get(number, size_of::<GridRecord>(), || self.grids.get(number))
    }

    /// Hands every row of cells (along x) of grid `number` inside `wanted` (level indices) to
    /// `row`: its first cell's index and its values of field `field` (of those to be ingested).
    pub(super) fn rows(
        &self,
        number: u64,
        field: usize,
        wanted: &IndexBox,
        row: &mut RowVisitor<'_>,
    ) -> Result<()> {
        let grid = self.grid(number)?;
        let part = wanted.intersection(&grid.cells());
        if part.is_empty() {
            return Ok(());
        }
        let local = |edge: [i128; 3]| -> [u32; 3] {
            std::array::from_fn(|a| u32::try_from(edge[a] - grid.lo[a]).unwrap_or(0))
        };
        let (lo, hi) = (local(part.lo), local(part.hi));
        let part = GridBlock { lo, size: std::array::from_fn(|a| hi[a] - lo[a]) };
        let chunks = |a: usize| lo[a] / CHUNK_EDGE..=(hi[a] - 1) / CHUNK_EDGE;
        for z in chunks(2) {
            for y in chunks(1) {
                for x in chunks(0) {
                    self.chunk_rows(&grid, number, field, [x, y, z], part, row)?;
                }
            }
        }
        Ok(())
    }

    /// What [`Self::rows`] does, for what of a grid's `part` lies in the chunk numbered `at`.
    fn chunk_rows(
        &self,
        grid: &GridRecord,
        number: u64,
        field: usize,
        at: [u32; 3],
        part: GridBlock,
        row: &mut RowVisitor<'_>,
    ) -> Result<()> {
        let block = chunk(grid, at);
        let GridBlock { lo: first, size } = block;
        let values = self.chunks.get((number, field, at), 8 * block.len(), || {
            let mut values = vec![0.0; block.len()];
            let name = self.fields.get(field).copied();
            let name = name.ok_or_else(|| Error::request("a field that is not ingested"))?;
            self.source.read(grid, name, block, &mut values)?;
            Ok(values)
        })?;
        let from: [u32; 3] = std::array::from_fn(|a| part.lo[a].max(first[a]));
        let to: [u32; 3] =
            std::array::from_fn(|a| (part.lo[a] + part.size[a]).min(first[a] + size[a]));
        let width = (to[0] - from[0]) as usize;
        for z in from[2]..to[2] {
            for y in from[1]..to[1] {
                let start = (((z - first[2]) * size[1] + y - first[1]) * size[0]) as usize;
                let start = start + (from[0] - first[0]) as usize;
                let cell = [from[0], y, z];
                let index = std::array::from_fn(|a| grid.lo[a] + i128::from(cell[a]));
                row(index, &values[start..start + width])?;
            }
        }
        Ok(())
    }
}
