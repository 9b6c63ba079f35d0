//! Checking every byte of a cache.

use std::collections::BTreeSet;
use std::os::unix::fs::FileExt;

use xxhash_rust::xxh3::xxh3_64;

use super::brick::{BrickPlace, RawBrick};
use super::codec::Decoder;
use super::digits::Precision;
use super::header::TreeLevel;
use super::index::{Cursor, PAGE_BYTES};
use super::reader::Cache;
use super::record::{BrickEntry, NodeRecord};
use crate::{Error, Result};

/// Most damaged places that a report lists one by one.
const LISTED: usize = 1000;

/// What of a cache is damaged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// A brick.
    Brick {
        /// Its octree level.
        octree: i32,
        /// The field concerned; none where all are.
        field: Option<usize>,
    },
    /// A page of the index, with all that it says of bricks and their fields.
    Page,
    /// Bytes that belong to no brick: no field lacks anything.
    Between,
}

/// One damaged place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Damage {
    /// Where it is.
    pub part: Part,
    /// What is wrong.
    pub reason: String,
}

/// What [`verify`] found.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Report {
    /// Bricks in the cache.
    pub bricks: u64,
    /// Payloads read.
    pub payloads: u64,
    /// Payload bytes read.
    pub bytes: u64,
    /// Number of damaged places.
    pub damaged: u64,
    /// The first thousand of them.
    pub listed: Vec<Damage>,
    /// Bricks that cannot be reached: a damaged page holds what the index says of them, of their
    /// children or of those above them.
    pub unreachable: u64,
}

impl Report {
    fn add(&mut self, part: Part, reason: String) {
        self.damaged += 1;
        if self.listed.len() < LISTED {
            self.listed.push(Damage { part, reason });
        }
    }
}

/// Reads everything in `cache`, whose header and table of checksums were checked when it was
/// opened, and checks it: every page, every record, every payload, and the bytes between.
///
/// # Errors
/// Only what keeps the check itself from running; damage goes into the report.
pub fn verify(cache: &Cache, progress: &mut dyn FnMut(u64, u64)) -> Result<Report> {
    let header = cache.header();
    let mut report = Report { bricks: header.nodes(), ..Report::default() };
    let mut check = Check {
        cache,
        cursor: cache.cursor(),
        decoder: Decoder::new()
            .map_err(|source| Error::io(cache.path(), "cannot set up the codec", source))?,
        brick: RawBrick::default(),
        children_end: None,
        cells: 0,
        leaf_cells: 0,
        extents: Extents::default(),
        damaged_pages: BTreeSet::new(),
        is_reachable: true,
        has_all_records: true,
    };
    for depth in 0..header.levels.len() {
        check.level(depth, &mut report, progress);
    }
    check.gaps(&mut report)?;
    Ok(report)
}

struct Check<'c> {
    cache: &'c Cache,
    cursor: Cursor<'c>,
    decoder: Decoder,
    brick: RawBrick,
    /// One past the last child seen: children follow each other without gaps.
    children_end: Option<u64>,
    /// Cells and leaf cells of the level's bricks so far.
    cells: u64,
    leaf_cells: u64,
    extents: Extents,
    /// Damaged pages that are in the report: each is one place, however many bricks need it.
    damaged_pages: BTreeSet<u64>,
    /// Whether no damaged page stood in the way of the brick at hand.
    is_reachable: bool,
    /// Whether all bricks have told where their payloads lie.
    has_all_records: bool,
}

/// Whether extents of a file lie one behind the other without gaps or overlaps, in whatever order
/// they are told: then all ends but the last are beginnings as well. What hashes of beginnings exceed
/// those of ends by says so, but for accidents of one in 2⁶⁴.
#[derive(Default)]
struct Extents(u64);

impl Extents {
    fn add(&mut self, begin: u64, length: u64) {
        self.0 = self.0.wrapping_add(Self::hash(begin)).wrapping_sub(Self::hash(begin + length));
    }

    fn fill(&self, begin: u64, length: u64) -> bool {
        self.0 == Self::hash(begin).wrapping_sub(Self::hash(begin + length))
    }

    fn hash(place: u64) -> u64 {
        xxh3_64(&place.to_le_bytes())
    }
}

impl Check<'_> {
    fn level(&mut self, depth: usize, report: &mut Report, progress: &mut dyn FnMut(u64, u64)) {
        let header = self.cache.header();
        let level = header.levels[depth];
        let next = header.levels.get(depth + 1);
        self.children_end = Some(next.map_or(0, |next| next.first_node));
        (self.cells, self.leaf_cells) = (0, 0);
        for node in level.first_node..level.first_node + level.nodes {
            self.is_reachable = true;
            self.node(node, &level, report);
            report.unreachable += u64::from(!self.is_reachable);
            progress(node + 1, header.nodes());
        }
        if report.damaged > 0 {
            return;
        }
        let all_fields = Part::Brick { octree: level.octree, field: None };
        if self.children_end != Some(next.map_or(0, |next| next.first_node + next.nodes)) {
            report.add(all_fields, "bricks of the next level have no parent".into());
        }
        if (self.cells, self.leaf_cells) != (level.cells, level.leaf_cells) {
            let reason = "the header counts other cells than the level's bricks have";
            report.add(all_fields, reason.into());
        }
    }

    /// Takes in why a brick could not be checked.
    fn fail(&mut self, part: Part, error: &Error, report: &mut Report) {
        let Some(page) = self.cursor.take_damaged_page() else {
            return report.add(part, error.to_string());
        };
        self.is_reachable = false;
        if self.damaged_pages.insert(page) {
            report.add(Part::Page, error.to_string());
        }
    }

    fn node(&mut self, node: u64, level: &TreeLevel, report: &mut Report) {
        let part = |field| Part::Brick { octree: level.octree, field };
        let record = match self.cursor.node(node) {
            Ok(record) => record,
            Err(error) => {
                (self.children_end, self.has_all_records) = (None, false);
                return self.fail(part(None), &error, report);
            }
        };
        let mut wrong = |what| report.add(part(None), format!("brick {node}'s {what}"));
        if record.child_mask != 0 {
            if self.children_end.is_some_and(|end| end != record.first_child) {
                wrong("children are out of order");
            }
            let children = u64::from(record.child_mask.count_ones());
            self.children_end = Some(record.first_child.saturating_add(children));
        }
        if node == 0 && (record.parent, record.octant) != (0, 0) {
            wrong("parent cannot be: it is the root");
        }
        if record.existing_cells.checked_sub(record.refined_cells) != Some(record.leaf_cells) {
            wrong("counts of cells contradict each other");
        }
        self.cells += u64::from(record.existing_cells);
        self.leaf_cells += u64::from(record.leaf_cells);
        let place = self.cursor.place(node);
        if let Err(error) = &place {
            self.fail(part(None), error, report);
        }
        for field in 0..self.cache.header().fields.len() {
            if let Err(error) = self.field((node, &record, place.as_ref().ok()), field, report) {
                self.fail(part(Some(field)), &error, report);
            }
        }
    }

    fn field(
        &mut self,
        (node, node_record, place): (u64, &NodeRecord, Option<&BrickPlace>),
        field: usize,
        report: &mut Report,
    ) -> Result<()> {
        let record =
            self.cursor.field(node, field).inspect_err(|_| self.has_all_records = false)?;
        if !record.is_void() {
            report.payloads += 1;
            report.bytes += record.stored_bytes(Precision::Full);
            if (node == 0) != (record.parent_blocks == 0) {
                let place = self.cache.path().display();
                let has = if node == 0 {
                    "ancestors' blocks, though it is the root"
                } else {
                    "no ancestors' blocks"
                };
                return Err(Error::invalid(place, format!("brick {node} has {has}")));
            }
            let entry = BrickEntry { node, field, node_record, field_record: &record };
            let (decoder, brick) = (&mut self.decoder, &mut self.brick);
            self.cache.read_brick(&entry, Precision::Full, decoder, brick)?;
            for (_, offset, length) in record.parts(Precision::Full) {
                self.extents.add(offset, length as u64);
            }
            if self.brick.rounding_errors() != record.errors {
                let place = self.cache.path().display();
                let reason =
                    format!("brick {node}'s rounded values are off by more or less than it says");
                return Err(Error::invalid(place, reason));
            }
            if let Some(place) = place {
                self.cache.check_place(node, field, place, &self.brick)?;
            }
            self.check_void(node, node_record, field)?;
        }
        for child in (0..8).filter_map(|octant| node_record.child(octant)) {
            if !record.encloses(&self.cursor.field(child, field)?) {
                let place = self.cache.path().display();
                let reason = format!("brick {node}'s range leaves out what brick {child} holds");
                return Err(Error::invalid(place, reason));
            }
        }
        Ok(())
    }

    /// The record of a brick's parent must say where that one shows something and this one nothing.
    fn check_void(&mut self, node: u64, record: &NodeRecord, field: usize) -> Result<()> {
        let fills = node != 0 && self.brick.parent_fills_void(self.cache.header().shape);
        if fills && !self.cursor.field(record.parent, field)?.fills_void() {
            let place = self.cache.path().display();
            let reason = format!("brick {} does not say that brick {node} has void", record.parent);
            return Err(Error::invalid(place, reason));
        }
        Ok(())
    }

    /// Payloads fill the space before the index but for its padding, which is zero.
    fn gaps(&mut self, report: &mut Report) -> Result<()> {
        // Else nobody knows where the payloads end.
        if !self.has_all_records {
            return Ok(());
        }
        let header = self.cache.header();
        let begin = self.cache.header_bytes();
        let end = begin + report.bytes;
        let gap = header.index_offset.checked_sub(end).filter(|&gap| gap < PAGE_BYTES as u64);
        let Some(gap) = gap else {
            if report.damaged == 0 {
                report.add(Part::Between, "bytes between the payloads belong to no brick".into());
            }
            return Ok(());
        };
        if report.damaged == 0 && !self.extents.fill(begin, report.bytes) {
            report.add(
                Part::Between,
                "payloads overlap, or bytes between them are no brick's".into(),
            );
        }
        let mut bytes = vec![0; usize::try_from(gap).unwrap_or(0)];
        self.cache
            .file()
            .read_exact_at(&mut bytes, end)
            .map_err(|source| Error::io(self.cache.path(), "cannot read", source))?;
        if bytes.iter().any(|&byte| byte != 0) {
            report.add(Part::Between, "the padding before the index is not empty".into());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extents_fill_a_file_in_any_order_and_only_without_overlaps() {
        let filled = |extents: &[(u64, u64)]| {
            let mut all = Extents::default();
            extents.iter().for_each(|&(begin, length)| all.add(begin, length));
            all.fill(100, 60)
        };
        assert!(filled(&[(130, 30), (100, 10), (110, 20)]));
        // As long together, with an overlap and a hole.
        assert!(!filled(&[(130, 30), (100, 10), (105, 20)]));
        assert!(!filled(&[(100, 30), (100, 30)]));
        assert!(!filled(&[(100, 10), (110, 20)]));
    }
}
