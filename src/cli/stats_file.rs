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

/// A file for statistics. It is begun before the work that they tell of, so that a place that cannot
/// be written is told at once.
pub(super) struct StatsFile(AtomicFile);

impl StatsFile {
    /// Begins to write `path`.
    ///
    /// # Errors
    /// A place that cannot be written.
    pub(super) fn begin(path: &Path) -> Result<Self> {
        AtomicFile::create(path).map(Self)
    }

    /// Writes `stats` in its place.
    ///
    /// # Errors
    /// What the system says.
    pub(super) fn write(self, stats: &impl Serialize) -> Result<()> {
        let text = json(stats)? + "\n";
        let mut file = self.0.file();
        file.write_all(text.as_bytes())
            .map_err(|source| Error::io(self.0.target(), "cannot write the stats", source))?;
        self.0.commit()
    }
}
