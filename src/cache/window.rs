//! The room of the memory map: one of the crate's three rooms of unsafe code (the others are
//! `lanes/x86.rs` and `allocator.rs`).

use std::fs::File;
use std::sync::atomic::{AtomicU64, Ordering};

use memmap2::{Mmap, MmapOptions};

/// A mapped part of a file, with a mark for each page that was found sound.
pub(super) struct Window {
    map: Mmap,
    verified: AtomicU64,
}

impl Window {
    /// Maps `length` bytes of `file` from `offset`. The caller has seen that the file is that
    /// long.
    pub(super) fn map(file: &File, offset: u64, length: usize) -> std::io::Result<Self> {
        // SAFETY: the mapping is read-only and never handed out as anything but bytes, every
        // value of which is valid. What remains is another process that truncates or rewrites
        // the file while it is mapped: its length is checked right before (`Index::window`), its
        // content by checksum, and the documentation tells users to replace caches by renaming,
        // as `ingest` does, and never to truncate one in use.
        let map = unsafe { MmapOptions::new().offset(offset).len(length).map(file)? };
        Ok(Self { map, verified: AtomicU64::new(0) })
    }

    /// The mapped bytes.
    pub(super) fn bytes(&self) -> &[u8] {
        &self.map
    }

    /// Whether page `page` of the window (at most 64) was marked sound.
    pub(super) fn is_verified(&self, page: usize) -> bool {
        self.verified.load(Ordering::Relaxed) >> page & 1 == 1
    }

    /// Marks page `page` of the window as sound.
    pub(super) fn set_verified(&self, page: usize) {
        self.verified.fetch_or(1 << page, Ordering::Relaxed);
    }
}
