//! The index: pages of records, mapped in windows whose number is bounded, each page checked
//! against its checksum when it is first touched.

use std::collections::HashMap;
use std::fs::File;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use super::brick::BrickPlace;
use super::bytes::ByteReader;
use super::checksum::checksum_at;
use super::digits::Precision;
use super::header::{Header, MAX_FIELDS};
use super::record::{FieldRecord, NodeRecord};
use super::window::Window;
use crate::{Error, Result};

/// Bytes of an index page, the unit of its checksums.
pub(crate) const PAGE_BYTES: usize = 64 << 10;
/// Pages that are mapped together.
const PAGES_PER_WINDOW: u64 = 4;
/// Bytes of an index window: what one costs a memory limit.
pub const WINDOW_BYTES: u64 = PAGES_PER_WINDOW * PAGE_BYTES as u64;

/// Most windows that a cursor holds.
const CURSOR_WINDOWS: usize = 4;
/// Most windows at a time: Linux lets a process have 65,530 mappings (`vm.max_map_count`).
const MOST_WINDOWS: usize = 1 << 14;

/// Bytes of one brick's records with `fields` fields.
pub(super) fn record_bytes(fields: usize) -> usize {
    NodeRecord::BYTES + fields * FieldRecord::BYTES
}

const _: () = assert!(NodeRecord::BYTES + MAX_FIELDS * FieldRecord::BYTES <= PAGE_BYTES);

/// Bricks in one page with `fields` fields; records never straddle pages.
pub(super) fn records_per_page(fields: usize) -> usize {
    PAGE_BYTES / record_bytes(fields)
}

/// The index of an open cache.
pub(super) struct Index {
    file: File,
    path: PathBuf,
    page_checksums: Vec<u64>,
    windows: Mutex<Windows>,
}

/// A window, and whether it was asked for since the clock's hand passed it.
struct Mapped {
    window: Arc<Window>,
    is_recent: bool,
}

/// The mapped windows: a clock over those in use.
struct Windows {
    mapped: HashMap<u64, Mapped>,
    clock: Vec<u64>,
    hand: usize,
    limit: usize,
}

impl Index {
    /// The index in `file`, whose pages have these checksums; at most `limit` windows (at least
    /// one) are mapped at a time.
    pub(super) fn new(file: File, path: PathBuf, page_checksums: Vec<u64>, limit: usize) -> Self {
        let limit = limit.clamp(1, MOST_WINDOWS);
        let windows = Windows { mapped: HashMap::new(), clock: Vec::new(), hand: 0, limit };
        Self { file, path, page_checksums, windows: Mutex::new(windows) }
    }

    /// Sets how many windows may be mapped at a time, at least one; those beyond that many are
    /// closed unless they are in use.
    pub(super) fn set_limit(&self, limit: usize) {
        let mut windows = self.windows.lock().unwrap_or_else(PoisonError::into_inner);
        windows.limit = limit.clamp(1, MOST_WINDOWS);
        while windows.mapped.len() > windows.limit && windows.evict() {}
    }

    /// Window `number`, mapped if it is not yet.
    fn window(&self, number: u64, header: &Header) -> Result<Arc<Window>> {
        let mut windows = self.windows.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(window) = windows.touch(number) {
            return Ok(window);
        }
        if windows.mapped.len() >= windows.limit && !windows.evict() {
            return Err(Error::request("all index windows are in use: raise --memory"));
        }
        let first_page = number.saturating_mul(PAGES_PER_WINDOW);
        let pages = PAGES_PER_WINDOW.min(header.index_pages.saturating_sub(first_page));
        if pages == 0 {
            return Err(Error::invalid(self.path.display(), "a brick beyond the index"));
        }
        let failed = |source| Error::io(&self.path, "cannot map the index", source);
        let offset = header.index_offset + first_page * PAGE_BYTES as u64;
        let length = pages * PAGE_BYTES as u64;
        if self.file.metadata().map_err(failed)?.len() < offset + length {
            return Err(Error::invalid(self.path.display(), "the cache was truncated while open"));
        }
        let length = usize::try_from(length).unwrap_or(0);
        let window = Arc::new(Window::map(&self.file, offset, length).map_err(failed)?);
        let mapped = Mapped { window: Arc::clone(&window), is_recent: true };
        windows.mapped.insert(number, mapped);
        windows.clock.push(number);
        Ok(window)
    }

    /// Checks page `page` against its checksum, once per mapping.
    fn verified_page<'w>(&self, window: &'w Window, page: u64) -> Result<&'w [u8]> {
        let within = usize::try_from(page % PAGES_PER_WINDOW).unwrap_or(0);
        let bytes = window.bytes().get(within * PAGE_BYTES..(within + 1) * PAGE_BYTES);
        let expected = usize::try_from(page).ok().and_then(|p| self.page_checksums.get(p));
        let (Some(bytes), Some(&expected)) = (bytes, expected) else {
            return Err(Error::invalid(self.path.display(), "a brick beyond the index"));
        };
        if !window.is_verified(within) {
            if checksum_at(page, bytes) != expected {
                return Err(Error::invalid(
                    self.path.display(),
                    format!("index page {page} is damaged (checksum): ingest the data again"),
                ));
            }
            window.set_verified(within);
        }
        Ok(bytes)
    }
}

impl Windows {
    fn touch(&mut self, number: u64) -> Option<Arc<Window>> {
        let mapped = self.mapped.get_mut(&number)?;
        mapped.is_recent = true;
        Some(Arc::clone(&mapped.window))
    }

    /// Unmaps one window that nobody holds; false when all are held.
    fn evict(&mut self) -> bool {
        for _ in 0..2 * self.clock.len() {
            self.hand = if self.hand < self.clock.len() { self.hand } else { 0 };
            let number = self.clock[self.hand];
            match self.mapped.get_mut(&number) {
                Some(mapped) if mapped.is_recent || Arc::strong_count(&mapped.window) > 1 => {
                    mapped.is_recent = false;
                    self.hand += 1;
                }
                _ => {
                    self.mapped.remove(&number);
                    self.clock.swap_remove(self.hand);
                    return true;
                }
            }
        }
        false
    }
}

/// Reads records for one thread. Holds on to the windows it used last, so that most reads take
/// no lock.
pub struct Cursor<'c> {
    index: &'c Index,
    header: &'c Header,
    held: [Option<(u64, Arc<Window>)>; CURSOR_WINDOWS],
    next: usize,
    damaged_page: Option<u64>,
}

impl<'c> Cursor<'c> {
    /// Most windows that a cursor holds.
    pub const WINDOWS: usize = CURSOR_WINDOWS;

    /// A cursor that holds no windows yet.
    pub(super) fn new(index: &'c Index, header: &'c Header) -> Self {
        Self { index, header, held: Default::default(), next: 0, damaged_page: None }
    }

    /// The damaged page, if that is what the last error was of: it is told once.
    pub(super) fn take_damaged_page(&mut self) -> Option<u64> {
        self.damaged_page.take()
    }

    /// The records of brick `node`.
    ///
    /// # Errors
    /// A damaged page, or records that contradict the tree.
    pub fn node(&mut self, node: u64) -> Result<NodeRecord> {
        let record = self.unchecked_node(node)?;
        let level = self.header.level_of(node);
        self.check_children(node, level, &record)?;
        Ok(record)
    }

    /// What the index says of field `field` in brick `node`.
    ///
    /// # Errors
    /// A damaged page, or a record that contradicts itself or the file's size.
    pub fn field(&mut self, node: u64, field: usize) -> Result<FieldRecord> {
        let place = NodeRecord::BYTES + field * FieldRecord::BYTES;
        let record = self
            .with_record(node, |bytes| {
                FieldRecord::read(&mut ByteReader::new(bytes.get(place..)?))
            })?
            .ok_or_else(|| {
                self.contradiction(node, "its field record is none that ingest writes")
            })?;
        let is_inside = |(_, offset, length): (usize, u64, usize)| {
            offset.checked_add(length as u64).is_some_and(|end| end <= self.header.index_offset)
        };
        if !record.parts(Precision::Full).all(is_inside)
            || record.is_void() == (record.lengths[0] != 0)
            || record.parent_blocks > self.header.max_parent_blocks
        {
            return Err(self.contradiction(node, "its payload lies nowhere"));
        }
        Ok(record)
    }

    fn unchecked_node(&mut self, node: u64) -> Result<NodeRecord> {
        self.with_record(node, |bytes| NodeRecord::read(&mut ByteReader::new(bytes)))?
            .ok_or_else(|| self.contradiction(node, "its record is none that ingest writes"))
    }

    /// Children lie in the next level and have this parent and the octants that the mask names:
    /// so no damage, however it came about, makes a walk visit a brick twice.
    fn check_children(&mut self, node: u64, level: usize, record: &NodeRecord) -> Result<()> {
        let count = u64::from(record.child_mask.count_ones());
        if count == 0 {
            let sound = record.first_child == 0 && record.descendants == 0 && record.depth == 0;
            return if sound { Ok(()) } else { Err(self.contradiction(node, "a child too many")) };
        }
        let next =
            self.header.levels.get(level + 1).map(|l| (l.first_node, l.first_node + l.nodes));
        let end = record.first_child.checked_add(count);
        let inside = next.is_some_and(|(first, last)| {
            record.first_child >= first && end.is_some_and(|end| end <= last)
        });
        if !inside {
            return Err(self.contradiction(node, "its children lie outside their level"));
        }
        let (mut descendants, mut depth) = (0u64, 0);
        for octant in 0..8 {
            let Some(child) = record.child(octant) else { continue };
            let found = self.unchecked_node(child)?;
            if found.parent != node || found.octant != octant {
                return Err(self.contradiction(child, "it is another brick's child"));
            }
            descendants = descendants.saturating_add(found.descendants).saturating_add(1);
            depth = depth.max(found.depth.saturating_add(1));
        }
        if record.descendants != descendants || record.depth != depth {
            return Err(self.contradiction(node, "it counts other bricks beneath than it has"));
        }
        Ok(())
    }

    /// Where brick `node` lies, found by climbing to the root.
    ///
    /// # Errors
    /// A damaged page, or records that contradict the tree.
    pub fn place(&mut self, node: u64) -> Result<BrickPlace> {
        let tree_level = self.header.level_of(node);
        let (mut coordinates, mut climbing) = ([0; 3], node);
        for step in 0..tree_level {
            let record = self.unchecked_node(climbing)?;
            for (a, coordinate) in coordinates.iter_mut().enumerate() {
                *coordinate |= i128::from(record.octant >> a & 1) << step;
            }
            if self.header.level_of(record.parent) != tree_level - step - 1 {
                return Err(self.contradiction(climbing, "its parent lies at another level"));
            }
            climbing = record.parent;
        }
        Ok(BrickPlace { tree_level, octree: self.header.levels[tree_level].octree, coordinates })
    }

    fn contradiction(&self, node: u64, reason: &str) -> Error {
        Error::invalid(
            self.index.path.display(),
            format!("brick {node} contradicts the index: {reason}; ingest the data again"),
        )
    }

    fn with_record<T>(&mut self, node: u64, read: impl FnOnce(&[u8]) -> T) -> Result<T> {
        let fields = self.header.fields.len();
        let per_page = records_per_page(fields) as u64;
        let page = node / per_page;
        let start = usize::try_from(node % per_page).unwrap_or(0) * record_bytes(fields);
        let slot = self.hold(page / PAGES_PER_WINDOW)?;
        let Some((_, window)) = &self.held[slot] else {
            return Err(self.contradiction(node, "it is beyond the index"));
        };
        let checked = self.index.verified_page(window, page);
        self.damaged_page = checked.is_err().then_some(page);
        let bytes = checked?;
        Ok(read(&bytes[start..start + record_bytes(fields)]))
    }

    fn hold(&mut self, number: u64) -> Result<usize> {
        let held = |slot: &Option<(u64, _)>| slot.as_ref().is_some_and(|(n, _)| *n == number);
        if let Some(slot) = self.held.iter().position(held) {
            return Ok(slot);
        }
        let slot = self.next;
        self.next = (self.next + 1) % Self::WINDOWS;
        self.held[slot] = None;
        self.held[slot] = Some((number, self.index.window(number, self.header)?));
        Ok(slot)
    }
}
