//! Pass 3: payloads with ghosts and ancestors' blocks, then the index.

use std::path::Path;
use std::sync::Arc;

use rayon::prelude::*;

use super::Progress;
use super::build::upper_levels;
use super::drafts::{Draft, Drafts, FieldDraft, field_record};
use super::gather::{Gatherer, is_void, range};
use super::hood::{Hood, Walk};
use super::residual::Residual;
use super::store::{BrickStore, StoredBricks};
use crate::atomic_file::AtomicFile;
use crate::cache::{Encoder, FieldRecord, Header, NodeRecord, RawBrick, Writer};
use crate::{Error, Result};

/// A brick ready to be written: its records, and each field's payload (empty: none).
struct Finished {
    draft: Draft,
    payloads: Vec<Vec<u8>>,
    blocks: usize,
}

/// What pass 3 needs.
pub(super) struct Completion<'s> {
    pub(super) store: &'s BrickStore,
    pub(super) header: Header,
    pub(super) target: &'s Path,
    pub(super) directory: &'s Path,
    /// Bytes of stored bricks to keep in memory.
    pub(super) memory: usize,
    /// Bricks in memory at a time.
    pub(super) batch: usize,
}

impl Completion<'_> {
    /// Writes the cache.
    pub(super) fn run(mut self, file: AtomicFile, progress: &mut Progress<'_>) -> Result<Header> {
        let drafts = Drafts::new(self.directory, self.header.fields.len())?;
        let mut writer = Writer::new(self.target, file, &self.header)?;
        let bricks = StoredBricks::new(self.store, self.memory);
        let upper = upper_levels(self.header.shape, self.header.domain.root_cells());
        let mut walk = Walk::new(self.store, upper);
        loop {
            let mut hoods = Vec::with_capacity(self.batch);
            while hoods.len() < self.batch
                && let Some(hood) = walk.next()?
            {
                hoods.push(hood);
            }
            if hoods.is_empty() {
                break;
            }
            let finished: Vec<Result<Finished>> = hoods
                .par_iter()
                .map_init(Scratch::default, |scratch, hood| self.finish(hood, &bricks, scratch))
                .collect();
            for (hood, finished) in hoods.iter().zip(finished) {
                let blocks = self.write(hood, finished?, &mut writer, &drafts)?;
                self.header.max_parent_blocks = self.header.max_parent_blocks.max(blocks);
            }
            progress.advance(hoods.len() as u64);
        }
        drafts.complete(&self.header)?;
        writer.finish(self.header, |node, fields| {
            let draft = drafts.get(node)?;
            fields.extend(draft.fields.iter().map(|field| field.record));
            Ok(draft.node)
        })
    }

    fn finish(
        &self,
        hood: &Arc<Hood>,
        bricks: &StoredBricks<'_>,
        scratch: &mut Scratch,
    ) -> Result<Finished> {
        let mut finished = Finished { draft: Draft::default(), payloads: Vec::new(), blocks: 0 };
        finished.draft.node = self.node_record(hood)?;
        for field in 0..self.header.fields.len() {
            let gatherer = Gatherer {
                bricks,
                shape: self.header.shape,
                root_cells: self.header.domain.root_cells(),
                field,
                exponent: self.header.fields[field].exponent,
            };
            scratch.raw.blocks.clear();
            gatherer.gather(hood, &mut scratch.raw)?;
            let void = is_void(self.header.shape, &scratch.raw);
            let (range, nan) = range(&scratch.raw);
            let record = field_record(range, nan, void, scratch.raw.blocks.len());
            let to_parent = if void { [0.0; 2] } else { self.to_parent(field, &scratch.raw) };
            finished.draft.fields.push(FieldDraft { record, to_parent });
            if !void {
                finished.blocks = finished.blocks.max(scratch.raw.blocks.len());
            }
            finished.payloads.push(if void { Vec::new() } else { scratch.encode(self.target)? });
        }
        Ok(finished)
    }

    fn node_record(&self, hood: &Hood) -> Result<NodeRecord> {
        let level = hood.place.tree_level;
        let topology = self.store.topology(level, hood.brick())?;
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

    fn to_parent(&self, field: usize, raw: &RawBrick) -> [f64; 2] {
        let field = &self.header.fields[field];
        let Some(residual) = Residual::new(self.header.shape, raw) else { return [0.0; 2] };
        let factor = f64::from(field.exponent).exp2();
        let linear = residual.bound(|stored| f64::from(stored) * factor);
        let Some(floor) = field.smallest_positive else { return [linear, f64::INFINITY] };
        let log10 = residual.bound(|stored| {
            let value = f64::from(stored) * factor;
            if value.is_nan() { value } else { value.max(floor).log10() }
        });
        [linear, log10]
    }

    fn write(
        &self,
        hood: &Hood,
        mut finished: Finished,
        writer: &mut Writer,
        drafts: &Drafts,
    ) -> Result<u8> {
        let node = self.header.levels[hood.place.tree_level].first_node + hood.brick();
        for (field, payload) in finished.payloads.iter().enumerate() {
            if !payload.is_empty() {
                let record: &mut FieldRecord = &mut finished.draft.fields[field].record;
                writer.payload(node, field, payload, record)?;
            }
        }
        drafts.put(node, &finished.draft)?;
        Ok(finished.blocks.saturating_sub(1) as u8)
    }
}

/// A thread's buffers.
#[derive(Default)]
struct Scratch {
    raw: RawBrick,
    encoder: Option<Encoder>,
}

impl Scratch {
    fn encode(&mut self, target: &Path) -> Result<Vec<u8>> {
        let failed = |source| Error::io(target, "cannot compress a brick", source);
        let encoder = match &mut self.encoder {
            Some(encoder) => encoder,
            none => none.insert(Encoder::new().map_err(failed)?),
        };
        encoder.encode(&self.raw).map_err(failed)
    }
}
