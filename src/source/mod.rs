//! Simulation outputs: one file (or folder) per format behind the [`Source`] trait.
//!
//! A source knows grids and fields; it does not know bricks.

mod amrex;
mod athena;
mod athenapp;
mod enzo;
mod flash;
mod folder;
pub mod hdf5;
mod lattice;
mod lines;
mod names;
mod open_file;
mod raw;

use std::path::{Path, PathBuf};

use crate::space::{Domain, IndexBox, Levels};
use crate::spelling::nearest_first;
use crate::{Error, Result};

/// One field of a simulation output.
#[derive(Debug, Clone, PartialEq)]
pub struct SourceField {
    /// The file's own name.
    pub name: String,
    /// The unit that `to_cgs` leads to; without that factor, what the file itself calls its unit.
    pub units: Option<String>,
    /// Factor from code units to cgs, if the source says how.
    pub to_cgs: Option<f64>,
}

/// What an output says of itself before any field data are read.
#[derive(Debug, Clone)]
pub struct Hierarchy {
    /// The simulated box and root grid.
    pub domain: Domain,
    /// The levels that the output's grids use.
    pub levels: Levels,
    /// Fields that can be read; whether every grid has them may show only then.
    pub fields: Vec<SourceField>,
    /// Which of `fields` is the density, if one is.
    pub density: Option<usize>,
    /// Code time of the output.
    pub time: Option<f64>,
}

/// What an opened output is.
#[derive(Debug, Clone)]
pub struct About {
    /// The format's name, as `--format` takes it.
    pub format: &'static str,
    /// The file or folder that was opened: what the user named, or the one output in that folder.
    pub path: PathBuf,
    /// Domain, levels and fields.
    pub hierarchy: Hierarchy,
}

impl About {
    /// An error of an index beyond the fields.
    fn no_field(&self, field: usize) -> Error {
        Error::request(format!("{}: has no field number {field}", self.path.display()))
    }

    /// The name of field `field`.
    ///
    /// # Errors
    /// An index beyond the fields.
    fn field_name(&self, field: usize) -> Result<&str> {
        let field = self.hierarchy.fields.get(field).ok_or_else(|| self.no_field(field))?;
        Ok(&field.name)
    }
}

/// One grid (patch, block) of an output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GridRecord {
    /// The output's own number of the grid, for messages.
    pub id: u64,
    /// Simulation level, 0 = root grid.
    pub level: u32,
    /// The level's cell index of the grid's first cell.
    pub lo: [i128; 3],
    /// Active cells along x, y, z.
    pub size: [u32; 3],
    /// Where the source finds the data; means something to the source alone.
    pub locator: u64,
}

impl GridRecord {
    /// The grid's cells.
    pub fn cells(&self) -> IndexBox {
        IndexBox::at(self.lo, self.size)
    }
}

/// A block of one grid's cells, in the grid's own indices.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GridBlock {
    /// First cell along x, y, z.
    pub lo: [u32; 3],
    /// Cells along x, y, z.
    pub size: [u32; 3],
}

impl GridBlock {
    /// Number of cells.
    pub fn len(&self) -> usize {
        self.size.iter().map(|&n| n as usize).product()
    }

    /// Whether the block holds no cell.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// A simulation output that can be ingested. Reading may happen on several threads at once.
pub trait Source: Send + Sync {
    /// What the output is.
    fn about(&self) -> &About;

    /// The format's name, as `--format` takes it.
    fn format(&self) -> &'static str {
        self.about().format
    }

    /// The file or folder that was opened.
    fn path(&self) -> &Path {
        &self.about().path
    }

    /// Domain, levels and fields.
    fn hierarchy(&self) -> &Hierarchy {
        &self.about().hierarchy
    }

    /// Hands every grid to `visit`, in any order, in memory that does not grow with their number
    /// where the format allows.
    ///
    /// # Errors
    /// Whatever is wrong with the hierarchy, naming the grid; and what `visit` returns.
    fn for_each_grid(&self, visit: &mut dyn FnMut(GridRecord) -> Result<()>) -> Result<()>;

    /// The files that hold the fields' values, each once; here the file that the user named.
    ///
    /// # Errors
    /// Whatever is wrong with a hierarchy that names them.
    fn data_files(&self) -> Result<Vec<PathBuf>> {
        Ok(vec![self.path().to_path_buf()])
    }

    /// Whether field `field` (an index into [`Hierarchy::fields`]) is computed as the user said, not
    /// read.
    fn is_computed(&self, _field: usize) -> bool {
        false
    }

    /// Reads `block` of field `field` (an index into [`Hierarchy::fields`]) of `grid` into `out`
    /// (`block.len()` values, x fastest, then y, then z), widened to f64, as they are in the file
    /// (NaN included).
    ///
    /// # Errors
    /// Missing, truncated or unreadable data, naming file, grid and field.
    fn read(
        &self,
        grid: &GridRecord,
        field: usize,
        block: GridBlock,
        out: &mut [f64],
    ) -> Result<()>;
}

/// Which of `fields` bears the first of `names` that any bears, without regard to case.
fn first_named(fields: &[SourceField], names: &[&str]) -> Option<usize> {
    let place = |name: &&str| fields.iter().position(|f| f.name.eq_ignore_ascii_case(name));
    names.iter().find_map(place)
}

/// A format that can be read.
struct Format {
    /// The format's name, as `--format` takes it.
    name: &'static str,
    /// What tells the format, in few words for the message that nothing did.
    mark: &'static str,
    /// Whether a file or folder is of the format, by its content.
    recognises: fn(&Path) -> bool,
    /// Whether an output is one file, so that a folder may be named that holds one.
    is_one_file: bool,
    /// Whether outputs hold values of cells that finer levels cover; else of leaf cells alone.
    has_covered_cells: bool,
    open: fn(&Path) -> Result<Box<dyn Source>>,
}

impl Format {
    /// Whether the file is one whole output of the format, not another that only names it.
    fn is_of(&self, file: &Path) -> bool {
        self.is_one_file && hdf5::is_hdf5(file) && (self.recognises)(file)
    }
}

/// Every format that can be read, in the order they are tried.
const FORMATS: &[Format] =
    &[enzo::FORMAT, amrex::FORMAT, athenapp::FORMAT, flash::FORMAT, athena::FORMAT];

/// Whether outputs of the format of that name hold values of cells that finer levels cover, so that
/// these can be left out; else of leaf cells alone.
pub fn has_covered_cells(format: &str) -> bool {
    FORMATS.iter().find(|known| known.name == format).is_none_or(|known| known.has_covered_cells)
}

/// Opens a simulation output, telling its format by content unless `format` names it.
///
/// # Errors
/// An input of no known format (the message lists those there are), or one that its format's
/// reader refuses.
pub fn open(path: &Path, format: Option<&str>) -> Result<Box<dyn Source>> {
    let found = std::fs::metadata(path).map_err(|e| Error::io(path, "cannot open the input", e))?;
    // Reading a pipe would wait for a writer.
    if !found.is_file() && !found.is_dir() {
        let place = path.display();
        return Err(Error::request(format!("{place}: is neither a file nor a folder; name one")));
    }
    let (chosen, path) = match format {
        Some(name) => by_name(name, path)?,
        None => by_content(path)?,
    };
    (chosen.open)(&path)
}

/// Whether a format of that name can be read.
///
/// # Errors
/// No such format: the message names those there are.
pub fn check_format(name: &str) -> Result<()> {
    named(name).map(|_| ())
}

/// The format called `name`.
fn named(name: &str) -> Result<&'static Format> {
    FORMATS.iter().find(|format| format.name.eq_ignore_ascii_case(name)).ok_or_else(|| {
        Error::request(format!(
            "format `{}` is not known: there are {}",
            name.escape_debug(),
            nearest_first(name, FORMATS.iter().map(|f| f.name)).join(", ")
        ))
    })
}

/// The format called `name`, and what its reader opens where `path` is named.
fn by_name(name: &str, path: &Path) -> Result<(&'static Format, PathBuf)> {
    let format = named(name)?;
    if !(format.is_one_file && path.is_dir()) {
        return Ok((format, path.to_path_buf()));
    }
    let file = folder::only_output(path, |file| format.is_of(file))?.ok_or_else(|| {
        let place = path.display();
        Error::request(format!("{place}: is a folder without a file of {} in it", format.name))
    })?;
    Ok((format, file))
}

/// The format that is told by the content of `path`, and what its reader opens.
fn by_content(path: &Path) -> Result<(&'static Format, PathBuf)> {
    if let Some(format) = FORMATS.iter().find(|format| (format.recognises)(path)) {
        return Ok((format, path.to_path_buf()));
    }
    let of_file = |file: &Path| FORMATS.iter().find(|format| format.is_of(file));
    if path.is_dir()
        && folder::denied(path).is_none()
        && let Some(file) = folder::only_output(path, |file| of_file(file).is_some())?
        && let Some(format) = of_file(&file)
    {
        return Ok((format, file));
    }
    Err(unknown(path))
}

fn unknown(path: &Path) -> Error {
    let damaged = || hdf5::damage(path).or_else(|| folder::first_found(path, hdf5::damage));
    if let Some(error) = folder::denied(path).or_else(damaged) {
        return error;
    }
    let known: Vec<String> = FORMATS.iter().map(|f| format!("{} ({})", f.name, f.mark)).collect();
    let reason = format!(
        "is {}, but of no known format: {}; --format NAME says what that reader misses{}",
        kind(path),
        known.join(", "),
        folder::denied_within(path).map_or_else(String::new, |file| {
            format!("; permission denied to read {}", file.display())
        })
    );
    Error::not_supported(path.display(), reason)
}

/// What a file is as far as no format need be known.
fn kind(path: &Path) -> &'static str {
    if path.is_dir() {
        "a folder"
    } else if hdf5::is_hdf5(path) {
        "an HDF5 file"
    } else if hdf5::is_behind_user_block(path) {
        "an HDF5 file behind a user block, which is not read (h5unjam takes it off)"
    } else if athena::is_vtk(path) {
        "a VTK file whose title names no level and domain, as Athena's do from version 4 on"
    } else {
        "a file"
    }
}

/// Every grid with all values of field `field`; of grids too large for tests the first alone.
#[cfg(test)]
pub(crate) fn read_all(source: &dyn Source, field: usize) -> Result<Vec<(GridRecord, Vec<f64>)>> {
    let mut grids = Vec::new();
    source.for_each_grid(&mut |grid| {
        grids.push((grid, Vec::new()));
        Ok(())
    })?;
    for (grid, values) in &mut grids {
        let cells = grid.size.iter().try_fold(1u64, |n, &s| n.checked_mul(u64::from(s)));
        let size = if cells.is_some_and(|n| n < 1 << 16) { grid.size } else { [1; 3] };
        let block = GridBlock { lo: [0; 3], size };
        values.resize(block.len(), 0.0);
        source.read(grid, field, block, values)?;
    }
    Ok(grids)
}
