//! Statistics as JSON.

use std::io::Write;
use std::path::Path;

use serde::Serialize;

use crate::atomic_file::AtomicFile;
use crate::{Error, Result};

/// `stats` as indented JSON.
///
/// # Errors
/// Numbers that JSON cannot hold.
pub(super) fn json(stats: &impl Serialize) -> Result<String> {
    serde_json::to_string_pretty(stats)
        .map_err(|error| Error::request(format!("cannot write the stats: {error}")))
}

/// Writes `stats` to `path`.
///
/// # Errors
/// What the system says.
pub(super) fn write_stats(path: &Path, stats: &impl Serialize) -> Result<()> {
    let text = json(stats)? + "\n";
    let file = AtomicFile::create(path)?;
    file.file()
        .write_all(text.as_bytes())
        .map_err(|source| Error::io(path, "cannot write the stats", source))?;
    file.commit()
}
