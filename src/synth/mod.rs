//! Synthetic AMR data sets, written from recipes in the layouts of simulation codes.
//!
//! A [`Recipe`] (TOML; `datasets_synthetic/` holds examples) gives a domain, a density model
//! ([`DensityModel`]), rules for refinement ([`Grids`]) and the layout, one of `LAYOUTS`. Enzo's
//! grids are written in batches, so memory depends on the largest grid and the deepest level;
//! layouts that list grids level by level (`batches.rs`) keep their boxes as well, and trees of
//! blocks (`tree.rs`) are built in memory.
//!
//! Values are the model at cell centres, from offsets that are exact at any depth. Cells under
//! finer grids hold what the recipe asks for, which may be deliberately wrong: only leaf cells
//! are the solution.

mod amrex;
mod athena;
mod athenapp;
mod batches;
mod boxes;
mod density;
mod edges;
mod enzo;
mod flash;
mod grids;
mod hdf5;
mod nested;
mod noise;
mod output;
mod recipe;
mod threshold;
mod tree;
mod values;

pub use density::DensityModel;
pub use grids::{Grid, Grids};
pub use recipe::{Precision, Recipe};

#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use crate::spelling::nearest_first;
use crate::{Error, Result};

/// What was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Summary {
    /// What readers open: a file, or a folder where the layout is one.
    pub input: PathBuf,
    /// Levels, the root grid's included.
    pub levels: u32,
    /// Grids of all levels.
    pub grids: u64,
    /// Cells of all grids, those under finer grids included.
    pub cells: u64,
    /// Size of all files together.
    pub bytes: u64,
}

/// A simulation code's layout.
struct Layout {
    /// The layout's name, as a recipe's `output.format` takes it.
    name: &'static str,
    write: Write,
}

/// What [`write()`] does, for one layout.
type Write = fn(&Recipe, &Path, &mut dyn FnMut(u64, u64)) -> Result<Summary>;

/// Every layout that can be written.
const LAYOUTS: &[Layout] =
    &[enzo::LAYOUT, amrex::LAYOUT, athenapp::LAYOUT, flash::LAYOUT, athena::LAYOUT];

/// Whether a layout of that name can be written.
///
/// # Errors
/// No such format: the message names those there are.
pub fn check_format(name: &str) -> Result<()> {
    layout(name).map(|_| ())
}

/// The layout called `name`.
fn layout(name: &str) -> Result<&'static Layout> {
    LAYOUTS.iter().find(|layout| layout.name.eq_ignore_ascii_case(name)).ok_or_else(|| {
        let names = nearest_first(name, LAYOUTS.iter().map(|layout| layout.name));
        let name = name.escape_debug();
        Error::request(format!("format `{name}` is not known: there are {}", names.join(", ")))
    })
}

/// Writes the data set of `recipe` as a folder of its name in `directory`. `progress` hears of
/// the cells written and their total number.
///
/// An earlier synthetic data set of that name is replaced; on failure nothing is left behind.
///
/// # Errors
/// What the recipe's layout cannot hold, a folder that holds something else, and whatever the
/// operating system refuses.
pub fn write(
    recipe: &Recipe,
    directory: &Path,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<Summary> {
    (layout(&recipe.output.format)?.write)(recipe, directory, progress)
}
