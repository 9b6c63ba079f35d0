//! The layouts of simulation codes that data sets are written in.

use std::path::{Path, PathBuf};

use super::recipe::Recipe;
use super::{amrex, athena, enzo};
use crate::{Error, Result};

/// A layout.
pub(super) struct Layout {
    /// As recipes and `--format` name it: as the format that reads it.
    pub(super) name: &'static str,
    /// Writes a data set, as [`write`].
    pub(super) write: fn(&Recipe, &Path, &mut dyn FnMut(u64, u64)) -> Result<Summary>,
}

/// Every layout that can be written.
const LAYOUTS: &[Layout] = &[enzo::LAYOUT, amrex::LAYOUT, athena::LAYOUT];

/// What was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Summary {
    /// What readers open: a parameter file, a plotfile's folder, the file of the root level.
    pub parameter_file: PathBuf,
    /// Levels, the root grid's included.
    pub levels: u32,
    /// Grids of all levels.
    pub grids: u64,
    /// Cells of all grids, those under finer grids included.
    pub cells: u64,
    /// Size of all files together.
    pub bytes: u64,
}

/// The layout called `name`.
///
/// # Errors
/// There is none; the message lists those there are.
pub(super) fn named(name: &str) -> Result<&'static Layout> {
    LAYOUTS.iter().find(|layout| layout.name == name).ok_or_else(|| {
        let names: Vec<&str> = LAYOUTS.iter().map(|layout| layout.name).collect();
        Error::request(format!(
            "output.format: `{name}` cannot be written: there is {}",
            names.join(", ")
        ))
    })
}

/// Writes the data set of `recipe` as a folder of its name in `directory`. `progress` hears of
/// the cells written and their total number.
///
/// An earlier synthetic data set of that name is replaced; on failure nothing is left behind.
///
/// # Errors
/// Cells too small for the layout's coordinates, refinement that it has no words for, a folder
/// that holds something else, and whatever the operating system refuses.
pub fn write(
    recipe: &Recipe,
    directory: &Path,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<Summary> {
    (named(&recipe.output.format)?.write)(recipe, directory, progress)
}
