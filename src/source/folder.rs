//! What lies in a folder.

use std::path::{Path, PathBuf};

use crate::{Error, Result};

/// The paths of all that lies in `folder`, in no order.
///
/// # Errors
/// A folder that cannot be listed.
pub(super) fn entries(folder: &Path) -> Result<Vec<PathBuf>> {
    let fault = |e| Error::io(folder, "cannot list the folder", e);
    let entries = std::fs::read_dir(folder).map_err(fault)?;
    entries.map(|entry| entry.map(|e| e.path()).map_err(fault)).collect()
}
