//! Temporary files that vanish with the process: created without a name, beside the target.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use crate::{Error, Result};

/// A nameless temporary file: appended to, read anywhere. Nothing is left of it however the
/// process ends.
pub(super) struct Spool {
    directory: PathBuf,
    writer: BufWriter<File>,
    length: u64,
}

impl Spool {
    /// A new one in the file system of `directory`.
    pub(super) fn new(directory: &Path) -> Result<Self> {
        let file = tempfile::tempfile_in(directory)
            .map_err(|source| Error::io(directory, "cannot write temporary files", source))?;
        Ok(Self {
            directory: directory.to_path_buf(),
            writer: BufWriter::with_capacity(256 << 10, file),
            length: 0,
        })
    }

    /// Appends `bytes`; where they begin.
    pub(super) fn append(&mut self, bytes: &[u8]) -> Result<u64> {
        let start = self.length;
        self.writer
            .write_all(bytes)
            .map_err(|source| Error::io(&self.directory, "cannot write temporary data", source))?;
        self.length += bytes.len() as u64;
        Ok(start)
    }

    /// Makes everything appended so far readable.
    pub(super) fn flush(&mut self) -> Result<()> {
        self.writer
            .flush()
            .map_err(|source| Error::io(&self.directory, "cannot write temporary data", source))
    }

    /// Bytes appended so far.
    pub(super) fn len(&self) -> u64 {
        self.length
    }

    /// Reads `bytes.len()` bytes from `offset`, which must have been flushed.
    pub(super) fn read(&self, offset: u64, bytes: &mut [u8]) -> Result<()> {
        self.writer
            .get_ref()
            .read_exact_at(bytes, offset)
            .map_err(|source| Error::io(&self.directory, "cannot read temporary data", source))
    }

    /// Overwrites `bytes.len()` bytes at `offset`, which must have been flushed.
    pub(super) fn overwrite(&self, offset: u64, bytes: &[u8]) -> Result<()> {
        self.writer
            .get_ref()
            .write_all_at(bytes, offset)
            .map_err(|source| Error::io(&self.directory, "cannot write temporary data", source))
    }

    /// Reads from `start` to `end` in order, `buffer` bytes at a time.
    pub(super) fn stream(&self, start: u64, end: u64, buffer: usize) -> Stream<'_> {
        Stream { spool: self, next: start, end, buffer: vec![0; buffer], filled: 0, used: 0 }
    }
}

/// Sequential reading of a part of a [`Spool`].
pub(super) struct Stream<'s> {
    spool: &'s Spool,
    next: u64,
    end: u64,
    buffer: Vec<u8>,
    filled: usize,
    used: usize,
}

impl Stream<'_> {
    /// Fills `bytes`; false at the end.
    pub(super) fn read(&mut self, bytes: &mut [u8]) -> Result<bool> {
        let mut done = 0;
        while done < bytes.len() {
            if self.used == self.filled && !self.refill()? {
                return Ok(false);
            }
            let count = (bytes.len() - done).min(self.filled - self.used);
            bytes[done..done + count].copy_from_slice(&self.buffer[self.used..self.used + count]);
            self.used += count;
            done += count;
        }
        Ok(true)
    }

    fn refill(&mut self) -> Result<bool> {
        let left = self.end - self.next;
        let count = self.buffer.len().min(usize::try_from(left).unwrap_or(usize::MAX));
        self.spool.read(self.next, &mut self.buffer[..count])?;
        self.next += count as u64;
        (self.filled, self.used) = (count, 0);
        Ok(count > 0)
    }
}
