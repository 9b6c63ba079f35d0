//! A level: the grids' values in FABs, and `Cell_H`, which lists them.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::PathBuf;

use super::printed;
use crate::synth::grids::Grid;
use crate::synth::output::OutputFolder;
use crate::synth::recipe::{Precision, Recipe};
use crate::{Error, Result};

/// Writes one level, grid by grid.
pub(super) struct LevelWriter<'a> {
    recipe: &'a Recipe,
    folder: PathBuf,
    files: u32,
    /// The data file, its name and its size so far.
    file: Option<(BufWriter<File>, PathBuf, u64)>,
    grids: u64,
    boxes: String,
    places: String,
    least: String,
    most: String,
    bytes: u64,
}

impl<'a> LevelWriter<'a> {
    /// Starts level `level` in `folder`.
    pub(super) fn create(recipe: &'a Recipe, folder: &OutputFolder, level: usize) -> Result<Self> {
        Ok(Self {
            recipe,
            folder: folder.make(&format!("Level_{level}"))?,
            files: 0,
            file: None,
            grids: 0,
            boxes: String::new(),
            places: String::new(),
            least: String::new(),
            most: String::new(),
            bytes: 0,
        })
    }

    /// Adds a grid with its values, one vector a component.
    pub(super) fn add(&mut self, grid: &Grid, values: &[Vec<f64>]) -> Result<()> {
        let precision = self.recipe.output.precision;
        let cells = printed(&grid.cells);
        let mut fab =
            format!("FAB {}{cells} {}\n", description(precision), values.len()).into_bytes();
        for component in values {
            fab.extend(precision.stored(component));
        }
        let (name, offset) = self.append(&fab)?;
        // Writing to a string cannot fail.
        let _ = writeln!(self.boxes, "{cells}");
        let _ = writeln!(self.places, "FabOnDisk: {name} {offset}");
        for (line, pick) in
            [(&mut self.least, f64::min as fn(f64, f64) -> f64), (&mut self.most, f64::max)]
        {
            for component in values {
                let extreme = component.iter().copied().reduce(pick).unwrap_or(0.0);
                let _ = write!(line, "{extreme:.17e},");
            }
            line.push('\n');
        }
        self.grids += 1;
        Ok(())
    }

    /// Appends a FAB to the data file, or to a new one where that is full; file and offset.
    fn append(&mut self, fab: &[u8]) -> Result<(String, u64)> {
        let full = (self.recipe.output.file_mib * 1024.0 * 1024.0) as u64;
        if self.file.as_ref().is_some_and(|(.., size)| size + fab.len() as u64 > full) {
            self.close()?;
        }
        let (mut file, path, offset) = match self.file.take() {
            Some(open) => open,
            None => {
                let path = self.folder.join(format!("Cell_D_{:05}", self.files));
                self.files += 1;
                let file = File::create(&path).map_err(|e| Error::io(&path, "cannot create", e))?;
                (BufWriter::new(file), path, 0)
            }
        };
        file.write_all(fab).map_err(|e| Error::io(&path, "cannot write", e))?;
        self.bytes += fab.len() as u64;
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        self.file = Some((file, path, offset + fab.len() as u64));
        Ok((name, offset))
    }

    fn close(&mut self) -> Result<()> {
        match self.file.take() {
            Some((mut file, path, _)) => {
                file.flush().map_err(|e| Error::io(path, "cannot write", e))
            }
            None => Ok(()),
        }
    }

    /// Completes the level; the size of its files.
    pub(super) fn finish(mut self) -> Result<u64> {
        self.close()?;
        let (count, components) = (self.grids, self.recipe.output.fields.len());
        let text = format!(
            "1\n1\n{components}\n0\n({count} 0\n{})\n{count}\n{}\n{count},{components}\n{}\n\
             {count},{components}\n{}\n",
            self.boxes, self.places, self.least, self.most
        );
        let path = self.folder.join("Cell_H");
        std::fs::write(&path, &text).map_err(|e| Error::io(&path, "cannot write", e))?;
        Ok(self.bytes + text.len() as u64)
    }
}

/// AMReX' description of the numbers, which are little-endian.
fn description(precision: Precision) -> &'static str {
    match precision {
        Precision::F32 => "((8, (32 8 23 0 1 9 0 127)),(4, (4 3 2 1)))",
        Precision::F64 => "((8, (64 11 52 0 1 12 0 1023)),(8, (8 7 6 5 4 3 2 1)))",
    }
}
