//! What lies in a folder.

use std::io;
use std::path::{Path, PathBuf};

use crate::{Error, Result, regular_file};

/// Files of a folder that are looked at for whether they may be read.
const MOST_TRIED: usize = 1000;

/// The paths of all that lies in `folder`, in no order.
///
/// # Errors
/// A folder that cannot be listed.
pub(super) fn entries(folder: &Path) -> Result<Vec<PathBuf>> {
    let fault = |e| Error::io(folder, "cannot list the folder", e);
    let entries = std::fs::read_dir(folder).map_err(fault)?;
    entries.map(|entry| entry.map(|e| e.path()).map_err(fault)).collect()
}

/// Why the file or folder at `path` is of no known format, if that is that it may not be read.
pub(super) fn denied(path: &Path) -> Option<Error> {
    let opened = if path.is_dir() {
        std::fs::read_dir(path).map(|_| ())
    } else {
        regular_file::open(path).map(|_| ())
    };
    let error = opened.err().filter(|error| error.kind() == io::ErrorKind::PermissionDenied)?;
    Some(Error::io(path, "cannot open the input", error))
}

/// The first file in `folder` that may not be read, if it is a folder.
pub(super) fn denied_within(folder: &Path) -> Option<PathBuf> {
    let entries = std::fs::read_dir(folder).ok()?;
    let files = entries.flatten().map(|entry| entry.path()).filter(|entry| entry.is_file());
    files.take(MOST_TRIED).find(|file| denied(file).is_some())
}
