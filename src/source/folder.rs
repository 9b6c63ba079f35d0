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

/// Why the file at `path`, or one in the folder there, is of no known format, if that is that it may not
/// be read.
pub(super) fn unreadable(path: &Path) -> Option<Error> {
    let denied = |path: &Path, error: io::Error| {
        let is_denied = error.kind() == io::ErrorKind::PermissionDenied;
        is_denied.then(|| Error::io(path, "cannot open the input", error))
    };
    let of_file = |file: &Path| denied(file, regular_file::open(file).err()?);
    if path.is_file() {
        return of_file(path);
    }
    let entries = match std::fs::read_dir(path) {
        Ok(entries) => entries,
        Err(error) => return denied(path, error),
    };
    let files = entries.flatten().map(|entry| entry.path()).filter(|entry| entry.is_file());
    files.take(MOST_TRIED).find_map(|file| of_file(&file))
}
