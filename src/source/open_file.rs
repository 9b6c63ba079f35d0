//! Files that are read at places.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use crate::{Error, Result, regular_file};

/// An open file, with its path for messages.
#[derive(Debug)]
pub(super) struct OpenFile {
    path: PathBuf,
    file: File,
}

impl OpenFile {
    /// Opens the file at `path`.
    ///
    /// # Errors
    /// A file that cannot be opened.
    pub(super) fn open(path: &Path) -> Result<Self> {
        let file = regular_file::open(path).map_err(|e| Error::io(path, "cannot open", e))?;
        Ok(Self { path: path.to_owned(), file })
    }

    /// What was opened.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Size, bytes.
    ///
    /// # Errors
    /// A size that the operating system does not tell.
    pub(super) fn length(&self) -> Result<u64> {
        let metadata = self.file.metadata();
        Ok(metadata.map_err(|e| Error::io(&self.path, "cannot read the size", e))?.len())
    }

    /// Reads from byte `at` on as much as there is, up to all of `bytes`; how much that is, 0 at the
    /// file's end.
    ///
    /// # Errors
    /// Whatever the operating system refuses.
    pub(super) fn read_at(&self, bytes: &mut [u8], at: u64) -> Result<usize> {
        self.file.read_at(bytes, at).map_err(|e| Error::io(&self.path, "cannot read", e))
    }

    /// Fills `bytes` from byte `at` on.
    ///
    /// # Errors
    /// A file that ends before, and whatever the operating system refuses.
    pub(super) fn read_exact_at(&self, bytes: &mut [u8], at: u64) -> Result<()> {
        self.file.read_exact_at(bytes, at).map_err(|e| Error::io(&self.path, "cannot read", e))
    }
}
