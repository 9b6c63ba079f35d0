//! Pass 2: all bricks of all levels, from the finest level to the root.

use std::path::Path;

use rayon::prelude::*;

use super::Progress;
use super::assemble::{Assembled, Assembler, Job};
use super::morton;
use super::overlaps::{CUBE_EDGE, Layout, Overlap};
use super::sort::Merge;
use super::spool::Spool;
use super::store::{BrickStore, Topology};
use super::tally::Tally;
use super::upward::{UpwardLevel, UpwardReader, octant};
use crate::Result;
use crate::cache::BrickShape;
use crate::space::Domain;

/// Cells of one level.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct LevelCells {
    /// Cells at which the level has data, refined further or not.
    pub(super) existing: u64,
    /// Cells that no finer level covers.
    pub(super) leaf: u64,
}

/// What pass 2 found.
pub(super) struct Built {
    /// The assembled bricks of all levels.
    pub(super) store: BrickStore,
    /// Cells of each tree level, the root's first.
    pub(super) cells: Vec<LevelCells>,
    /// Per field.
    pub(super) tallies: Vec<Tally>,
}

/// Number of averaged levels above the root grid: as many as a single brick needs to cover the
/// domain.
pub(super) fn upper_levels(shape: BrickShape, root_cells: [u64; 3]) -> u32 {
    let most = root_cells.into_iter().max().unwrap_or(1);
    let bricks = most.div_ceil(shape.edge() as u64);
    bricks.next_power_of_two().trailing_zeros()
}

/// Assembles everything. `batch` bricks are in memory at a time.
pub(super) fn build(
    layout: &Layout,
    assembler: &Assembler<'_>,
    domain: &Domain,
    directory: &Path,
    batch: usize,
    progress: &mut Progress<'_>,
) -> Result<Built> {
    let shape = assembler.shape;
    let deepest = layout.grids_per_level.len() as i32 - 1;
    let upper = upper_levels(shape, domain.root_cells()) as i32;
    let mut built = Built {
        store: BrickStore::new(directory, shape, assembler.fields, assembler.keeps_cells)?,
        cells: Vec::new(),
        tallies: vec![Tally::default(); assembler.fields],
    };
    let mut overlaps = layout.overlaps.iter()?;
    let mut below = UpwardLevel::new(Spool::new(directory)?, shape, assembler.fields);
    for octree in (-upper..=deepest).rev() {
        built.store.begin_level();
        built.cells.push(LevelCells::default());
        let above = UpwardLevel::new(Spool::new(directory)?, shape, assembler.fields);
        let mut level = LevelBuilder {
            octree,
            shape,
            volume: domain.cell_width(octree).element_product(),
            children: below.reader()?,
            children_taken: 0,
            above,
        };
        let mut jobs = level.next_jobs(&mut overlaps, batch)?;
        let mut done = Vec::new();
        // Bricks are assembled while those before them are filed and those after them found.
        while !(jobs.is_empty() && done.is_empty()) {
            let assemble = || -> Vec<Result<Assembled>> {
                jobs.par_iter().map(|job| assembler.assemble(job)).collect()
            };
            let (assembled, next) = rayon::join(assemble, || {
                level.take_all(done, &mut built)?;
                level.next_jobs(&mut overlaps, batch)
            });
            progress.advance(jobs.len() as u64);
            let bricks = jobs.iter().map(BuiltBrick::of).collect::<Vec<_>>();
            done = bricks.into_iter().zip(assembled).collect();
            jobs = next?;
        }
        level.above.flush()?;
        below = level.above;
    }
    built.store.flush()?;
    built.cells.reverse();
    Ok(built)
}

/// The bricks of one level, in Morton order.
struct LevelBuilder<'b> {
    octree: i32,
    shape: BrickShape,
    volume: f64,
    children: UpwardReader<'b>,
    children_taken: u64,
    above: UpwardLevel,
}

impl LevelBuilder<'_> {
    /// The next bricks, up to `batch`: those that grids reach into and those that have children.
    fn next_jobs(&mut self, overlaps: &mut Merge<'_, Overlap>, batch: usize) -> Result<Vec<Job>> {
        let mut jobs = Vec::with_capacity(batch);
        while jobs.len() < batch {
            let from_grids = overlaps
                .peek()
                .filter(|overlap| i64::from(overlap.octree) == i64::from(self.octree))
                .map(|overlap| self.brick_of(overlap));
            let from_children = self.children.peek().map(super::upward::Upward::parent);
            let coordinates = match (from_grids, from_children) {
                (None, None) => break,
                (Some(one), None) | (None, Some(one)) => one,
                (Some(a), Some(b)) => {
                    if morton::compare(&a, &b).is_le() {
                        a
                    } else {
                        b
                    }
                }
            };
            jobs.push(self.job(coordinates, overlaps)?);
        }
        Ok(jobs)
    }

    fn brick_of(&self, overlap: &Overlap) -> [u128; 3] {
        let shift = self.shape.edge().trailing_zeros() - CUBE_EDGE.trailing_zeros();
        overlap.cube.map(|c| c >> shift)
    }

    fn job(&mut self, coordinates: [u128; 3], overlaps: &mut Merge<'_, Overlap>) -> Result<Job> {
        let mut job =
            Job { octree: self.octree, coordinates, grids: Vec::new(), children: Vec::new() };
        while overlaps.peek().is_some_and(|overlap| {
            i64::from(overlap.octree) == i64::from(self.octree)
                && self.brick_of(overlap) == coordinates
        }) {
            if let Some(overlap) = overlaps.next()? {
                job.grids.push(overlap.grid);
            }
        }
        job.grids.sort_unstable();
        job.grids.dedup();
        while self.children.peek().is_some_and(|child| child.parent() == coordinates) {
            job.children.extend(self.children.next()?);
        }
        Ok(job)
    }

    /// Files assembled bricks in their order.
    fn take_all(
        &mut self,
        done: Vec<(BuiltBrick, Result<Assembled>)>,
        built: &mut Built,
    ) -> Result<()> {
        done.into_iter().try_for_each(|(brick, assembled)| self.take(&brick, &assembled?, built))
    }

    /// Files an assembled brick.
    fn take(&mut self, brick: &BuiltBrick, assembled: &Assembled, built: &mut Built) -> Result<()> {
        let topology = Topology {
            first_child: self.children_taken,
            child_mask: brick.child_mask,
            octant: brick.octant,
            counts: assembled.counts,
        };
        self.children_taken += u64::from(brick.child_mask.count_ones());
        built.store.push(topology, &assembled.packed)?;
        self.above.push(&assembled.upward)?;
        for (tally, brick) in built.tallies.iter_mut().zip(&assembled.tallies) {
            tally.merge(brick, self.volume);
        }
        if let Some(cells) = built.cells.last_mut() {
            cells.existing += u64::from(assembled.counts.existing);
            cells.leaf += u64::from(assembled.counts.leaf);
        }
        Ok(())
    }
}

/// A brick among others: what of a job is needed once it is done.
struct BuiltBrick {
    child_mask: u8,
    octant: u8,
}

impl BuiltBrick {
    fn of(job: &Job) -> Self {
        let child_mask = job.children.iter().fold(0, |mask, child| mask | 1 << child.octant());
        Self { child_mask, octant: octant(&job.coordinates) }
    }
}
