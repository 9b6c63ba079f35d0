//! An output in both forms: cells for the twin, caches for the program.

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use deepfield::cache::Cache;
use deepfield::ingest::{Options, Progress, ingest};
use deepfield::render::{RenderOptions, Rendered, render};
use deepfield::source;
use deepfield::synth::{self, Recipe};
use tempfile::TempDir;

use super::Result;
use super::dataset::{Dataset, Precision};
use super::interpolant::Interpolant;
use super::reference::Reference;
use super::reference::area::Effort;
use super::reference::tree::Tree;
use super::scene::Scene;
use super::transfer::Scale;
use crate::data::shared;

/// A turbulent cloud with a core, refined wherever it is dense: clumps at every scale.
pub(crate) const CLUMPY: &str = r#"
name = "DD0005"
[domain]
left = [0.0, 0.0, 0.0]
right = [1.0, 0.9, 1.1]
root = [16, 14, 18]
[refinement]
max_level = 5
seed = 31
[[refinement.centre]]
position = [0.5317, 0.4419, 0.5231]
half_size = [7, 6, 7]
satellites = 2
[refinement.threshold]
density = [2.0, 12.0]
block = [3, 6]
[[density]]
kind = "constant"
value = 0.25
[[density]]
kind = "core"
centre = [0.5317, 0.4419, 0.5231]
peak = 3e5
radius = 1e-3
slope = 2.0
spiral = { arms = 2, pitch = 4.0, amplitude = 0.9 }
texture = { frequency = 3.0, amplitude = 0.9 }
[[density]]
kind = "turbulence"
scale = 0.23
octaves = 6
amplitude = 1.7
persistence = 0.6
[output]
precision = "f32"
"#;

/// Index windows with which a cache is opened.
const WINDOWS: usize = 64;
const MEMORY: u64 = 512 << 20;

/// An output, its cells, and caches of it.
pub(crate) struct Subject {
    pub(crate) name: String,
    pub(crate) dataset: Dataset,
    input: PathBuf,
    folder: TempDir,
    /// The cells as trees, by scale.
    trees: RefCell<Vec<(Scale, Rc<Tree>)>>,
}

impl Subject {
    /// A real output beside the repository, where it is there.
    pub(crate) fn real(relative: &str) -> Result<Option<Self>> {
        let Some(input) = shared(relative) else { return Ok(None) };
        Self::new(relative, input, folder()?).map(Some)
    }

    /// The synthetic output that `datasets_synthetic` holds the recipe of.
    pub(crate) fn synthetic(name: &str) -> Result<Self> {
        let recipes = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/datasets_synthetic"));
        let path = recipes.join(format!("{name}.toml"));
        Self::of_recipe(name, &std::fs::read_to_string(&path).map_err(|e| e.to_string())?)
    }

    /// The output of a recipe.
    pub(crate) fn of_recipe(name: &str, recipe: &str) -> Result<Self> {
        let folder = folder()?;
        let recipe = Recipe::parse(recipe, name).map_err(|e| e.to_string())?;
        let written = synth::write(&recipe, folder.path(), &mut |_, _| {});
        let input = written.map_err(|e| e.to_string())?.input;
        Self::new(name, input, folder)
    }

    fn new(name: &str, input: PathBuf, folder: TempDir) -> Result<Self> {
        let source = source::open(&input, None).map_err(|e| e.to_string())?;
        let dataset = Dataset::load(source.as_ref(), "Density", Precision::Source)?;
        Ok(Self { name: name.into(), dataset, input, folder, trees: RefCell::default() })
    }

    /// The cache whose stored values have a relative error of at most `error`.
    pub(crate) fn cache(&self, error: f64) -> Result<Cache> {
        let target = self.folder.path().join(format!("{error:e}.dfc"));
        if !target.exists() {
            let source = source::open(&self.input, None).map_err(|e| e.to_string())?;
            let options = Options { relative_error: error, ..Options::default() };
            let mut quiet = |_, _, _| {};
            let mut progress = Progress::new(&mut quiet);
            ingest(source.as_ref(), &target, &options, &mut progress).map_err(|e| e.to_string())?;
        }
        Cache::open(&target, WINDOWS).map_err(|e| e.to_string())
    }

    /// The program's picture.
    pub(crate) fn picture(&self, text: &str, stored_error: f64) -> Result<Rendered> {
        let cache = self.cache(stored_error)?;
        let scene = deepfield::scene::Scene::parse(text, "scene").map_err(|e| e.to_string())?;
        let options = RenderOptions {
            memory: MEMORY,
            threads: Some(2),
            progress: None,
            fixed: None,
            resident: false,
        };
        render(&cache, &scene, &options).map_err(|e| e.to_string())
    }

    /// The truth.
    pub(crate) fn reference(&self, text: &str, effort: Effort) -> Result<Reference> {
        self.reference_at(text, effort, None)
    }

    /// The truth at some pixels (by number, row by row), or at all.
    pub(crate) fn reference_at(
        &self,
        text: &str,
        effort: Effort,
        places: Option<Vec<usize>>,
    ) -> Result<Reference> {
        let scene = Scene::parse(text)?;
        let transfer = scene.transfer(&self.dataset)?;
        let scale = transfer.scale;
        let known = self.trees.borrow().iter().find(|t| t.0 == scale).map(|t| Rc::clone(&t.1));
        let tree = match known {
            Some(tree) => tree,
            None => {
                let tree = Rc::new(Tree::new(&Interpolant::new(&self.dataset, &transfer))?);
                self.trees.borrow_mut().push((scale, Rc::clone(&tree)));
                tree
            }
        };
        Reference::render(&scene, &self.dataset, &tree, effort, places)
    }
}

fn folder() -> Result<TempDir> {
    tempfile::tempdir().map_err(|error| error.to_string())
}
