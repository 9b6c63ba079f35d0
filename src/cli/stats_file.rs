//! Statistics as JSON.

use std::fs::{self, FileType, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::output::Output;
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

/// Names of standard output.
const STANDARD_OUTPUT: [&str; 3] = ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"];

/// Where statistics go. It is begun before the work that they tell of, so that a place that cannot
/// be written is told at once.
pub(super) enum StatsFile {
    /// A file that is complete or not there.
    Whole(AtomicFile),
    /// Standard output.
    Printed,
    /// Standard error, or what else under `/dev` takes bytes as they come.
    Stream(Box<dyn Write>, PathBuf),
}

impl StatsFile {
    /// Begins to write `path`.
    ///
    /// # Errors
    /// A place that cannot be written.
    pub(super) fn begin(path: &Path) -> Result<Self> {
        if STANDARD_OUTPUT.iter().any(|name| path == Path::new(name)) {
            return Ok(Self::Printed);
        }
        match stream(path) {
            Some(stream) => stream
                .map(|stream| Self::Stream(stream, path.to_path_buf()))
                .map_err(|source| Error::io(path, "cannot write", source)),
            None => AtomicFile::create(path).map(Self::Whole),
        }
    }

    /// Writes `stats` in its place.
    ///
    /// # Errors
    /// What the system says.
    pub(super) fn write(self, stats: &impl Serialize) -> Result<()> {
        let text = json(stats)? + "\n";
        let write = |to: &mut dyn Write, path: &Path| {
            to.write_all(text.as_bytes())
                .and_then(|()| to.flush())
                .map_err(|source| Error::io(path, "cannot write the stats", source))
        };
        match self {
            Self::Whole(file) => {
                write(&mut file.file(), file.target())?;
                file.commit()
            }
            Self::Printed => Output::new().end_with(&text),
            Self::Stream(mut stream, path) => write(&mut *stream, &path),
        }
    }
}

/// What `path` means if that is no file of its own. A file behind the process' own output is written
/// where that stands: replaced, it would lose what others have written there.
fn stream(path: &Path) -> Option<io::Result<Box<dyn Write>>> {
    match path.to_str()? {
        "/dev/stderr" | "/dev/fd/2" | "/proc/self/fd/2" => Some(Ok(Box::new(io::stderr()))),
        _ => {
            // Never a disk.
            let takes_bytes = |kind: FileType| kind.is_char_device() || kind.is_fifo();
            let is_device = path.starts_with("/dev")
                && fs::metadata(path).is_ok_and(|found| takes_bytes(found.file_type()));
            let open = || OpenOptions::new().write(true).open(path);
            is_device.then(|| open().map(|file| Box::new(file) as Box<dyn Write>))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::ingest_stats::IngestStats;
    use crate::render::stats::Stats;

    const REFERENCE: &str = include_str!("../../docs/REFERENCE.md");

    #[test]
    fn the_reference_says_what_each_key_means() {
        for text in [json(&Stats::default()), json(&IngestStats::default())] {
            let keys: serde_json::Map<_, _> = serde_json::from_str(&text.unwrap()).unwrap();
            let untold: Vec<_> =
                keys.keys().filter(|key| !REFERENCE.contains(&format!("`{key}`"))).collect();
            assert!(keys.len() > 10 && untold.is_empty(), "{untold:?}");
        }
    }
}
