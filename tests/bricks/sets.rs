//! Synthetic and real outputs, and caches of them.

use std::path::{Path, PathBuf};

use deepfield::cache::Cache;
use deepfield::ingest::{Options, Progress, ingest};
use deepfield::source;
use deepfield::synth::{self, Recipe};
use tempfile::TempDir;

use crate::data::shared;

/// A simulation output and a folder for its caches.
pub(crate) struct Set {
    pub(crate) name: String,
    pub(crate) input: PathBuf,
    folder: TempDir,
}

impl Set {
    /// Writes the synthetic set of `recipe`.
    pub(crate) fn of_recipe(name: &str, recipe: &Recipe) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let input = synth::write(recipe, folder.path(), &mut |_, _| {}).unwrap().input;
        Self { name: name.into(), input, folder }
    }

    /// Writes the synthetic set that `datasets_synthetic` holds the recipe of.
    pub(crate) fn synthetic(name: &str) -> Self {
        Self::of_recipe(name, &recipe(name))
    }

    /// A real output, where it is there.
    pub(crate) fn real(relative: &str) -> Option<Self> {
        let input = shared(&format!("data/{relative}"))?;
        Some(Self { name: relative.into(), input, folder: tempfile::tempdir().unwrap() })
    }

    /// Its cache with bricks of `brick`³ cells.
    pub(crate) fn cache(&self, brick: u32) -> Cache {
        let target = self.folder.path().join(format!("{brick}.dfc"));
        if !target.exists() {
            let source = source::open(&self.input, None).unwrap();
            let options = Options { brick: Some(brick), ..Options::default() };
            let mut quiet = |_, _, _| {};
            ingest(source.as_ref(), &target, &options, &mut Progress::new(&mut quiet)).unwrap();
        }
        Cache::open(&target, 64).unwrap()
    }
}

/// A recipe of `datasets_synthetic`.
fn recipe(name: &str) -> Recipe {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/datasets_synthetic"));
    let path = folder.join(format!("{name}.toml"));
    Recipe::parse(&std::fs::read_to_string(&path).unwrap(), path.display()).unwrap()
}
