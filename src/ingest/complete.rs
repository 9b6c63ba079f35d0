//! Pass 3: payloads with ghosts and ancestors' blocks, then the index.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;

use super::Progress;
use super::build::upper_levels;
use super::drafts::{Draft, Drafts, FieldDraft, field_record};
use super::gather::{Gatherer, is_void};
use super::neighbourhood::{Neighbourhood, Walk};
use super::range::range;
use super::residual::{Residual, Scale};
use super::store::{BrickStore, StoredBricks};
use crate::atomic_file::AtomicFile;
use crate::cache::{Encoder, FieldRecord, Header, NodeRecord, Payload, RawBrick, Writer};
use crate::{Error, Result};

/// A brick ready to be written: its records, and each field's payload, where it has one.
struct Finished {
    draft: Draft,
    payloads: Vec<Option<Payload>>,
    blocks: usize,
}

/// What pass 3 needs.
pub(super) struct Completion<'s> {
    /// The bricks of pass 2.
    pub(super) store: &'s BrickStore,
    /// The cache's header, complete but for where things lie in the file and for the largest number
    /// of ancestors' blocks.
    pub(super) header: Header,
    /// The cache's path, for messages.
    pub(super) target: &'s Path,
    /// Where temporary files go.
    pub(super) directory: &'s Path,
    /// Bytes of stored bricks to keep in memory.
    pub(super) memory: usize,
    /// Bricks to complete at a time.
    pub(super) batch: usize,
    /// Buffers that no thread uses.
    pub(super) scratch: Spare,
}

impl Completion<'_> {
    /// Writes the cache.
    pub(super) fn run(mut self, file: AtomicFile, progress: &mut Progress<'_>) -> Result<Header> {
        let drafts = Drafts::new(self.directory, self.header.fields.len())?;
        let mut writer = Writer::new(self.target, file, &self.header)?;
        let bricks = StoredBricks::new(self.store, self.memory);
        let upper = upper_levels(self.header.shape, self.header.domain.root_cells());
        let mut walk = Walk::new(self.store, upper);
        let mut batch = self.next_batch(&mut walk)?;
        let mut done = Vec::new();
        // Bricks are completed while those before them are written and those after them found.
        while !(batch.is_empty() && done.is_empty()) {
            let finish = || self.finish_batch(&batch, &bricks);
            let (finished, others) = rayon::join(finish, || {
                let blocks = self.write_batch(done, &mut writer, &drafts)?;
                Ok::<_, Error>((blocks, self.next_batch(&mut walk)?))
            });
            let (blocks, next) = others?;
            self.header.max_parent_blocks = self.header.max_parent_blocks.max(blocks);
            progress.advance(batch.len() as u64);
            done = batch.into_iter().zip(finished).collect();
            batch = next;
        }
        drafts.complete(&self.header)?;
        writer.finish(self.header, |node, fields| {
            let draft = drafts.get(node)?;
            fields.extend(draft.fields.iter().map(|field| field.record));
            Ok(draft.node)
        })
    }

    /// The next bricks of the walk; none after the last.
    fn next_batch(&self, walk: &mut Walk<'_>) -> Result<Vec<Arc<Neighbourhood>>> {
        let mut batch = Vec::with_capacity(self.batch);
        while batch.len() < self.batch
            && let Some(neighbours) = walk.next()?
        {
            batch.push(neighbours);
        }
        Ok(batch)
    }

    /// The bricks of `batch` on all threads, in their order.
    fn finish_batch(
        &self,
        batch: &[Arc<Neighbourhood>],
        bricks: &StoredBricks<'_>,
    ) -> Vec<Result<Finished>> {
        let finish = |neighbours| {
            let mut scratch = self.scratch.take();
            let finished = self.finish(neighbours, bricks, &mut scratch);
            self.scratch.put(scratch);
            finished
        };
        batch.par_iter().map(finish).collect()
    }

    /// Writes bricks in their order; the most ancestors' blocks that any has.
    fn write_batch(
        &self,
        done: Vec<(Arc<Neighbourhood>, Result<Finished>)>,
        writer: &mut Writer,
        drafts: &Drafts,
    ) -> Result<u8> {
        done.into_iter().try_fold(0, |most, (neighbours, finished)| {
            Ok(most.max(self.write(&neighbours, finished?, writer, drafts)?))
        })
    }

    fn finish(
        &self,
        neighbours: &Arc<Neighbourhood>,
        bricks: &StoredBricks<'_>,
        scratch: &mut Scratch,
    ) -> Result<Finished> {
        let mut finished = Finished { draft: Draft::default(), payloads: Vec::new(), blocks: 0 };
        finished.draft.node = self.node_record(neighbours)?;
        for field in 0..self.header.fields.len() {
            let gatherer = Gatherer {
                bricks,
                shape: self.header.shape,
                root_cells: self.header.domain.root_cells(),
                field,
                exponent: self.header.fields[field].exponent,
            };
            gatherer.gather(neighbours, &mut scratch.raw)?;
            let void = is_void(self.header.shape, &scratch.raw);
            let (range, nan) = range(&scratch.raw);
            let record = field_record(range, nan, void, scratch.raw.blocks.len());
            let to_parent = if void { [0.0; 2] } else { self.to_parent(field, nan, scratch) };
            let parent_fills_void = !void && scratch.raw.parent_fills_void(self.header.shape);
            finished.draft.fields.push(FieldDraft { record, to_parent, parent_fills_void });
            if !void {
                finished.blocks = finished.blocks.max(scratch.raw.blocks.len());
            }
            finished.payloads.push(if void { None } else { Some(scratch.encode(self.target)?) });
        }
        Ok(finished)
    }

    fn node_record(&self, neighbours: &Neighbourhood) -> Result<NodeRecord> {
        let level = neighbours.place.tree_level;
        let topology = self.store.topology(level, neighbours.brick())?;
        let next = self.header.levels.get(level + 1).map_or(0, |next| next.first_node);
        let children = topology.child_mask != 0;
        Ok(NodeRecord {
            first_child: if children { next + topology.first_child } else { 0 },
            leaf_cells: topology.counts.leaf,
            existing_cells: topology.counts.existing,
            refined_cells: topology.counts.refined,
            child_mask: topology.child_mask,
            octant: if level == 0 { 0 } else { topology.octant },
            ..NodeRecord::default()
        })
    }

    /// Bounds of the difference to the parent's interpolant: of values as stored, and of log10 of the
    /// field's.
    fn to_parent(&self, field: usize, has_nan: bool, scratch: &mut Scratch) -> [f64; 2] {
        let field = &self.header.fields[field];
        let Scratch { raw, residual, .. } = scratch;
        if !residual.look_at(self.header.shape, raw, has_nan) {
            return [0.0; 2];
        }
        let linear = residual.bound(Scale::Linear);
        let Some(floor) = field.smallest_positive else { return [linear, f64::INFINITY] };
        let factor = f64::from(field.exponent).exp2();
        let log10 = residual.bound(Scale::Log10 { factor, floor });
        [linear, log10]
    }

    fn write(
        &self,
        neighbours: &Neighbourhood,
        mut finished: Finished,
        writer: &mut Writer,
        drafts: &Drafts,
    ) -> Result<u8> {
        let node = self.header.levels[neighbours.place.tree_level].first_node + neighbours.brick();
        for (field, payload) in finished.payloads.iter().enumerate() {
            if let Some(payload) = payload {
                let record: &mut FieldRecord = &mut finished.draft.fields[field].record;
                writer.payload(node, field, payload, record)?;
            }
        }
        drafts.put(node, &finished.draft)?;
        Ok(finished.blocks.saturating_sub(1) as u8)
    }
}

/// Buffers that wait for a thread: as many as there were threads at a time.
#[derive(Default)]
pub(super) struct Spare {
    waiting: Mutex<Vec<Scratch>>,
}

impl Spare {
    fn take(&self) -> Scratch {
        let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        waiting.pop().unwrap_or_default()
    }

    fn put(&self, scratch: Scratch) {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner).push(scratch);
    }
}

/// A thread's buffers.
#[derive(Default)]
struct Scratch {
    raw: RawBrick,
    residual: Residual,
    encoder: Option<Encoder>,
}

impl Scratch {
    fn encode(&mut self, target: &Path) -> Result<Payload> {
        let failed = |source| Error::io(target, "cannot compress a brick", source);
        let encoder = match &mut self.encoder {
            Some(encoder) => encoder,
            none => none.insert(Encoder::new().map_err(failed)?),
        };
        encoder.encode(&self.raw).map_err(failed)
    }
}
