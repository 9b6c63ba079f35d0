//! The text hierarchy, written as the grids are walked.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::PathBuf;

use super::{GHOST_ZONES, TIME, data_path, edges, field_types, particles};
use crate::synth::edges::general_14;
use crate::synth::grids::{Grid, Grids};
use crate::synth::output::OutputFolder;
use crate::synth::recipe::Recipe;
use crate::{Error, Result};

/// The `.hierarchy` file.
pub(super) struct HierarchyText<'a> {
    recipe: &'a Recipe,
    path: PathBuf,
    file: BufWriter<File>,
    bytes: u64,
}

impl<'a> HierarchyText<'a> {
    /// Starts the file.
    pub(super) fn create(recipe: &'a Recipe, folder: &OutputFolder) -> Result<Self> {
        let path = folder.file(&format!("{}.hierarchy", recipe.name));
        let file = File::create(&path).map_err(|e| Error::io(&path, "cannot create", e))?;
        Ok(Self { recipe, path, file: BufWriter::new(file), bytes: 0 })
    }

    /// Adds a grid, whose data are in file `file` and whose next sibling is `next` (0: none).
    pub(super) fn grid(&mut self, grids: &Grids, grid: &Grid, file: u32, next: u64) -> Result<()> {
        let id = grid.id;
        let size = grid.cells.size();
        let (left, right) = edges(grids, grid);
        let types = field_types(self.recipe);
        let path = data_path(&self.recipe.name, file);
        let ghosts = i128::from(GHOST_ZONES);
        let text = format!(
            "\nGrid = {id}\nTask              = {file}\nGridRank          = 3\n\
             GridDimension     = {}\nGridStartIndex    = {}\nGridEndIndex      = {}\n\
             GridLeftEdge      = {}\nGridRightEdge     = {}\nTime              = {TIME}\n\
             SubgridsAreStatic = 0\nNumberOfBaryonFields = {}\nFieldType = {}\n\
             BaryonFileName = {path}\nCourantSafetyNumber    = 0.400000\n\
             PPMFlatteningParameter = 0\nPPMDiffusionParameter  = 0\n\
             PPMSteepeningParameter = 0\n{}GravityBoundaryType = {}\n\
             Pointer: Grid[{id}]->NextGridThisLevel = {next}\n",
            list(size.map(|n| n + 2 * ghosts)),
            list([ghosts; 3]),
            list(size.map(|n| n + ghosts - 1)),
            list(left.map(general_14)),
            list(right.map(general_14)),
            types.len(),
            list(types.iter().map(|(number, _)| number)),
            particle_lines(particles(self.recipe, grid), &path),
            if grid.level == 0 { 0 } else { 2 },
        );
        self.append(&text)
    }

    /// Adds the pointer from a grid to its first child (0: none).
    pub(super) fn first_child(&mut self, id: u64, child: u64) -> Result<()> {
        self.append(&format!("Pointer: Grid[{id}]->NextGridNextLevel = {child}\n"))
    }

    /// Completes the file; its size.
    pub(super) fn finish(mut self) -> Result<u64> {
        self.file.flush().map_err(|e| Error::io(&self.path, "cannot write", e))?;
        Ok(self.bytes)
    }

    fn append(&mut self, text: &str) -> Result<()> {
        self.bytes += text.len() as u64;
        self.file.write_all(text.as_bytes()).map_err(|e| Error::io(&self.path, "cannot write", e))
    }
}

fn particle_lines(count: u32, path: &str) -> String {
    let file = match count {
        0 => String::new(),
        _ => format!("ParticleFileName = {path}\n"),
    };
    format!("NumberOfParticles   = {count}\n{file}NumberOfActiveParticles = 0\n")
}

/// Values with a blank after each, as Enzo writes lists.
fn list<T: std::fmt::Display>(values: impl IntoIterator<Item = T>) -> String {
    values.into_iter().map(|value| format!("{value} ")).collect()
}
