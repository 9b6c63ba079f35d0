//! Checking every byte of a cache.

use std::os::unix::fs::FileExt;

use super::brick::RawBrick;
use super::codec::Decoder;
use super::reader::Cache;
use super::record::NodeRecord;
use crate::{Error, Result};

/// Most damaged places that a report lists one by one.
const LISTED: usize = 1000;

/// One damaged place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Damage {
    /// The simulation-side octree level of the brick, if a brick is damaged.
    pub octree: Option<i32>,
    /// The field concerned; none where all are.
    pub field: Option<usize>,
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
}

impl Report {
    fn add(&mut self, octree: Option<i32>, field: Option<usize>, reason: String) {
        self.damaged += 1;
        if self.listed.len() < LISTED {
            self.listed.push(Damage { octree, field, reason });
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
        decoder: Decoder::new()
            .map_err(|source| Error::io(cache.path(), "cannot set up the codec", source))?,
        brick: RawBrick::default(),
        children_end: 0,
    };
    for (depth, level) in header.levels.iter().enumerate() {
        check.children_end = header.levels.get(depth + 1).map_or(0, |next| next.first_node);
        for node in level.first_node..level.first_node + level.nodes {
            check.node(node, level.octree, &mut report);
            progress(node + 1, header.nodes());
        }
        let end = header.levels.get(depth + 1).map_or(0, |next| next.first_node + next.nodes);
        if check.children_end != end && report.damaged == 0 {
            report.add(Some(level.octree), None, "bricks of the next level have no parent".into());
        }
    }
    check.gaps(&mut report)?;
    Ok(report)
}

struct Check<'c> {
    cache: &'c Cache,
    decoder: Decoder,
    brick: RawBrick,
    /// One past the last child seen: children follow each other without gaps.
    children_end: u64,
}

impl Check<'_> {
    fn node(&mut self, node: u64, octree: i32, report: &mut Report) {
        let mut cursor = self.cache.cursor();
        let record = match cursor.node(node) {
            Ok(record) => record,
            Err(error) => return report.add(Some(octree), None, error.to_string()),
        };
        if record.child_mask != 0 && record.first_child != self.children_end {
            report.add(Some(octree), None, format!("brick {node}'s children are out of order"));
        }
        self.children_end += u64::from(record.child_mask.count_ones());
        for field in 0..self.cache.header().fields.len() {
            if let Err(error) = self.payload(node, &record, field, &mut cursor, report) {
                report.add(Some(octree), Some(field), error.to_string());
            }
        }
    }

    fn payload(
        &mut self,
        node: u64,
        node_record: &NodeRecord,
        field: usize,
        cursor: &mut super::Cursor<'_>,
        report: &mut Report,
    ) -> Result<()> {
        let record = cursor.field(node, field)?;
        if record.is_void() {
            return Ok(());
        }
        report.payloads += 1;
        report.bytes += u64::from(record.stored_bytes);
        let (decoder, brick) = (&mut self.decoder, &mut self.brick);
        self.cache.read_brick(node, node_record, field, &record, decoder, brick)
    }

    /// Payloads fill the space before the index but for its padding, which is zero.
    fn gaps(&mut self, report: &mut Report) -> Result<()> {
        let header = self.cache.header();
        let end = self.cache.header_bytes() + report.bytes;
        let gap = header.index_offset.checked_sub(end).filter(|&gap| gap < 64 << 10);
        let Some(gap) = gap else {
            if report.damaged == 0 {
                report.add(None, None, "bytes between the payloads belong to no brick".into());
            }
            return Ok(());
        };
        let mut bytes = vec![0; usize::try_from(gap).unwrap_or(0)];
        self.cache
            .file()
            .read_exact_at(&mut bytes, end)
            .map_err(|source| Error::io(self.cache.path(), "cannot read", source))?;
        if bytes.iter().any(|&byte| byte != 0) {
            report.add(None, None, "the padding before the index is not empty".into());
        }
        Ok(())
    }
}
