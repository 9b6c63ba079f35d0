//! The index' records while they are made: on disk, each brick's by its number.

use std::path::Path;

use super::spool::Spool;
use crate::cache::bytes::{ByteReader, ByteWriter};
use crate::cache::{EMPTY_RANGE, FieldRecord, Header, NodeRecord};
use crate::{Error, Result};

/// A field's record, and how far the brick's interpolants are from its parent's.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct FieldDraft {
    /// The record as it will stand in the index; until [`Drafts::complete`] without what lies
    /// beneath.
    pub(super) record: FieldRecord,
    /// Bounds of |F − F of the parent| over the brick's box: unscaled, and of log10.
    pub(super) to_parent: [f64; 2],
    /// Whether the parent's cells show something where the brick's are void.
    pub(super) parent_fills_void: bool,
}

/// A brick's records.
#[derive(Debug, Clone, Default)]
pub(super) struct Draft {
    /// The record that holds for all fields.
    pub(super) node: NodeRecord,
    /// One for each field.
    pub(super) fields: Vec<FieldDraft>,
}

/// All bricks' records.
pub(super) struct Drafts {
    spool: Spool,
    fields: usize,
}

impl Drafts {
    /// No records yet, of bricks with `fields` fields, in a nameless temporary file in `directory`.
    ///
    /// # Errors
    /// A file that cannot be made.
    pub(super) fn new(directory: &Path, fields: usize) -> Result<Self> {
        Ok(Self { spool: Spool::new(directory)?, fields })
    }

    fn bytes(&self) -> usize {
        NodeRecord::BYTES + self.fields * (FieldRecord::BYTES + 17)
    }

    /// Writes the records of brick `node`, its number in the index.
    ///
    /// # Errors
    /// Temporary data that cannot be written.
    pub(super) fn put(&self, node: u64, draft: &Draft) -> Result<()> {
        let mut bytes = ByteWriter::default();
        draft.node.write(&mut bytes);
        for field in &draft.fields {
            field.record.write(&mut bytes);
            field.to_parent.iter().for_each(|&bound| bytes.f64(bound));
            bytes.u8(field.parent_fills_void.into());
        }
        self.spool.overwrite(node * self.bytes() as u64, &bytes.bytes)
    }

    /// Reads the records of brick `node`, which must have been written.
    ///
    /// # Errors
    /// Temporary data that cannot be read or are no records any more.
    pub(super) fn get(&self, node: u64) -> Result<Draft> {
        let mut bytes = vec![0; self.bytes()];
        self.spool.read(node * bytes.len() as u64, &mut bytes)?;
        let mut reader = ByteReader::new(&bytes);
        let mut read = || {
            let node = NodeRecord::read(&mut reader)?;
            let mut fields = Vec::with_capacity(self.fields);
            for _ in 0..self.fields {
                let record = FieldRecord::read(&mut reader)?;
                let to_parent = [reader.f64()?, reader.f64()?];
                let parent_fills_void = reader.u8()? != 0;
                fields.push(FieldDraft { record, to_parent, parent_fills_void });
            }
            Some(Draft { node, fields })
        };
        read().ok_or_else(|| Error::request("temporary data were changed by another program"))
    }

    /// Completes the records from the finest level up: parents, counts and bounds of what lies
    /// beneath.
    pub(super) fn complete(&self, header: &Header) -> Result<()> {
        for level in header.levels.iter().rev() {
            for node in level.first_node..level.first_node + level.nodes {
                let mut draft = self.get(node)?;
                for octant in 0..8 {
                    let Some(child) = draft.node.child(octant) else { continue };
                    let mut beneath = self.get(child)?;
                    beneath.node.parent = node;
                    self.put(child, &beneath)?;
                    draft.take_in(&beneath);
                }
                self.put(node, &draft)?;
            }
        }
        Ok(())
    }
}

impl Draft {
    fn take_in(&mut self, child: &Self) {
        self.node.descendants += 1 + child.node.descendants;
        self.node.depth = self.node.depth.max(child.node.depth + 1);
        for (own, beneath) in self.fields.iter_mut().zip(&child.fields) {
            own.take_in(beneath);
        }
    }
}

impl FieldDraft {
    fn take_in(&mut self, child: &Self) {
        let (own, beneath) = (&mut self.record, &child.record);
        if beneath.is_void() {
            return;
        }
        own.flags |= beneath.flags & (FieldRecord::NAN_TREE | FieldRecord::FILLS_VOID);
        own.flags |= u8::from(child.parent_fills_void) * FieldRecord::FILLS_VOID;
        own.tree = [own.tree[0].min(beneath.tree[0]), own.tree[1].max(beneath.tree[1])];
        let total = |own: f32, bound: f64, child: f32| own.max(up(bound + f64::from(child)));
        own.residual_linear =
            total(own.residual_linear, child.to_parent[0], beneath.residual_linear);
        own.residual_log10 = total(own.residual_log10, child.to_parent[1], beneath.residual_log10);
    }
}

/// An f32 that is no smaller, whatever was rounded on the way.
fn up(bound: f64) -> f32 {
    ((bound * (1.0 + 1e-6)) as f32).next_up()
}

/// The record of a field of a brick before it has a payload and children.
pub(super) fn field_record(range: [f32; 2], nan: bool, void: bool, blocks: usize) -> FieldRecord {
    let range = if void { EMPTY_RANGE } else { range };
    let nan_flags = FieldRecord::NAN_OWN | FieldRecord::NAN_TREE;
    FieldRecord {
        own: range,
        tree: range,
        flags: if void { FieldRecord::VOID } else { u8::from(nan) * nan_flags },
        parent_blocks: if void { 0 } else { blocks.saturating_sub(1) as u8 },
        ..FieldRecord::default()
    }
}
