//! What `deepfield bench scaling` measures: data sets given or made, ingested in processes of
//! their own.

use std::path::{Path, PathBuf};

use super::cpu::timed;
use super::viewpoints;
use crate::Result;
use crate::atomic_file;
use crate::cache::{Cache, Cursor};
use crate::cli::ingest_stats::IngestStats;
use crate::cli::itself;
use crate::cli::progress::Bar;
use crate::leftovers::ScratchFolder;
use crate::synth::{self, Recipe};

const RECIPE: &str = include_str!("../../../datasets_synthetic/scaling.toml");
const SCENES: [(&str, &str); 2] = [
    ("outside", include_str!("../../../datasets_synthetic/scaling-outside.toml")),
    ("inside", include_str!("../../../datasets_synthetic/scaling-inside.toml")),
];

/// A data set.
#[derive(Debug)]
pub(super) enum Data {
    /// A simulation output or a cache.
    Given(PathBuf),
    /// The recipe, at a scale.
    Made(f64),
}

impl Data {
    /// What it is called.
    pub(super) fn name(&self) -> String {
        match self {
            Self::Given(path) => path.display().to_string(),
            Self::Made(scale) => format!("scaling.toml at {scale}"),
        }
    }
}

/// A data set's cache, and what making it took.
#[derive(Debug)]
pub(super) struct Prepared {
    /// The cache's path.
    pub(super) cache: PathBuf,
    /// None where the cache was given.
    pub(super) ingest: Option<IngestStats>,
    /// Processor time of making it, seconds.
    pub(super) cpu_seconds: Option<f64>,
    /// Holds the cache, where it was made.
    _folder: Option<ScratchFolder>,
}

/// Makes data sets and caches.
#[derive(Debug)]
pub(super) struct DataMaker {
    folder: ScratchFolder,
    options: Vec<String>,
}

impl DataMaker {
    /// One that ingests within `memory` bytes on `threads` threads, in a folder within `folder`.
    ///
    /// # Errors
    /// A folder that cannot be made.
    pub(super) fn new(folder: Option<&Path>, memory: u64, threads: Option<u32>) -> Result<Self> {
        let parent = folder.map_or_else(std::env::temp_dir, Path::to_path_buf);
        let mut options = vec![format!("--memory={memory}")];
        options.extend(threads.map(|threads| format!("--threads={threads}")));
        Ok(Self { folder: ScratchFolder::new_in(&parent)?, options })
    }

    /// The data set's cache; a source that was made for it is gone again.
    ///
    /// # Errors
    /// Whatever is wrong with it, and a full disk.
    pub(super) fn prepare(&self, data: &Data) -> Result<Prepared> {
        match data {
            Data::Given(path) if Cache::is_cache(path) => {
                Ok(Prepared { cache: path.clone(), ingest: None, cpu_seconds: None, _folder: None })
            }
            Data::Given(path) => self.ingest(path),
            Data::Made(scale) => {
                let folder = ScratchFolder::new_in(self.folder.path())?;
                let recipe = Recipe::parse(RECIPE, "scaling.toml")?.scaled(*scale)?;
                let bar = Bar::new("synth", "cells");
                let mut show = |done, total| bar.show("synth", done, total);
                self.ingest(&synth::write(&recipe, folder.path(), &mut show)?.input)
            }
        }
    }

    fn ingest(&self, input: &Path) -> Result<Prepared> {
        let folder = ScratchFolder::new_in(self.folder.path())?;
        let (cache, stats) = (folder.path().join("cache.dfc"), folder.path().join("stats.json"));
        let mut command = itself::command()?;
        command.arg("ingest").args(&self.options).arg("-o").arg(&cache).arg("--stats").arg(&stats);
        command.arg("--").arg(input);
        let (outcome, cpu_seconds) = timed(|| itself::run(&mut command));
        outcome?;
        let ingest = Some(itself::read_stats(&stats)?);
        Ok(Prepared { cache, ingest, cpu_seconds, _folder: Some(folder) })
    }
}

/// Scenes with their names.
#[derive(Debug)]
pub(super) struct Scenes {
    /// Each scene's name and path.
    pub(super) list: Vec<(String, PathBuf)>,
}

impl Scenes {
    /// Scenes that a user gave, by the names of their files.
    pub(super) fn given(paths: &[PathBuf]) -> Self {
        let name = |path: &PathBuf| path.file_stem().unwrap_or_default().to_string_lossy().into();
        Self { list: paths.iter().map(|path| (name(path), path.clone())).collect() }
    }

    /// The recipe's own, or those that every cache has.
    ///
    /// # Errors
    /// A damaged cache, or a folder that takes no files.
    pub(super) fn of(data: &Data, cache: &Path, maker: &DataMaker) -> Result<Self> {
        let folder = maker.folder.path();
        if let Data::Given(_) = data {
            let cache = Cache::open(cache, Cursor::WINDOWS)?;
            return Ok(Self::given(&viewpoints::write(&cache, folder)?));
        }
        let write = |(name, text): (&str, &str)| {
            let path = folder.join(format!("{name}.toml"));
            atomic_file::write(&path, text)?;
            Ok((name.to_owned(), path))
        };
        Ok(Self { list: SCENES.into_iter().map(write).collect::<Result<_>>()? })
    }
}
