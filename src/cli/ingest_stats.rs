//! What an ingest took, for `ingest --stats`.

use std::time::Instant;

use serde::{Deserialize, Serialize};

use crate::cache::Header;
use crate::ingest::Stage;
use crate::paging::peak_rss_bytes;
use crate::source::Source;
use crate::{Error, Result};

/// What an ingest took.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct IngestStats {
    /// Opening the source excepted, seconds.
    pub(super) wall_seconds: f64,
    /// Reading and sorting the hierarchy, seconds.
    pub(super) hierarchy_seconds: f64,
    /// Assembling bricks from cells, and averaging, seconds.
    pub(super) cells_seconds: f64,
    /// Completing, compressing and writing, seconds.
    pub(super) write_seconds: f64,
    /// Largest resident set of the process; null where the system does not say.
    pub(super) peak_rss_bytes: Option<u64>,
    /// The memory limit.
    pub(super) memory_limit_bytes: u64,
    /// Files that hold the source's values.
    pub(super) source_bytes: u64,
    /// The cache.
    pub(super) cache_bytes: u64,
    /// Bricks in it.
    pub(super) bricks: u64,
    /// Levels of the simulation.
    pub(super) levels: usize,
    /// Cells that no finer level covers.
    pub(super) leaf_cells: u64,
}

/// Listens to an ingest's stages.
pub(super) struct Stopwatch {
    started: Instant,
    stage: (Stage, Instant),
    stats: IngestStats,
}

impl Stopwatch {
    /// Starts now.
    pub(super) fn start() -> Self {
        let now = Instant::now();
        Self { started: now, stage: (Stage::Hierarchy, now), stats: IngestStats::default() }
    }

    /// The ingest is at `stage`.
    pub(super) fn hear(&mut self, stage: Stage) {
        if stage != self.stage.0 {
            self.end_stage();
            self.stage = (stage, Instant::now());
        }
    }

    fn end_stage(&mut self) {
        let seconds = self.stage.1.elapsed().as_secs_f64();
        match self.stage.0 {
            Stage::Hierarchy => self.stats.hierarchy_seconds += seconds,
            Stage::Cells => self.stats.cells_seconds += seconds,
            Stage::Write => self.stats.write_seconds += seconds,
        }
    }

    /// The ingest of `source` within `memory` bytes is done.
    ///
    /// # Errors
    /// Files of the source that are gone.
    pub(super) fn stop(
        mut self,
        source: &dyn Source,
        memory: u64,
        header: &Header,
    ) -> Result<IngestStats> {
        self.end_stage();
        let levels = header.levels.iter();
        Ok(IngestStats {
            wall_seconds: self.started.elapsed().as_secs_f64(),
            peak_rss_bytes: peak_rss_bytes(),
            memory_limit_bytes: memory,
            source_bytes: size_of_files(source)?,
            cache_bytes: header.file_bytes,
            bricks: header.nodes(),
            levels: levels.clone().filter(|level| level.simulation.is_some()).count(),
            leaf_cells: levels.map(|level| level.leaf_cells).sum(),
            ..self.stats
        })
    }
}

fn size_of_files(source: &dyn Source) -> Result<u64> {
    let size = |path: &std::path::PathBuf| {
        let metadata = std::fs::metadata(path);
        metadata.map(|m| m.len()).map_err(|e| Error::io(path, "cannot read the size", e))
    };
    source.data_files()?.iter().map(size).sum()
}
