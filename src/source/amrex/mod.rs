//! AMReX plotfiles (Zhang et al., *JOSS* 4, 2019), which Castro, Nyx, MAESTROeX, Quokka, Pele,
//! WarpX and others write: a folder with a text `Header` and a folder for each level.

mod fab;
mod header;
mod level;
#[cfg(test)]
mod made;
#[cfg(test)]
mod tests;
mod text;
mod units;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use header::Header;
use level::LevelData;
use text::PrintedBox;
use units::Units;

use super::raw::RawArray;
use super::{About, Format, GridBlock, GridRecord, Hierarchy, Source, first_named};
use crate::space::IndexBox;
use crate::{Error, Result};

/// How the reader is listed among the formats.
pub(super) const FORMAT: Format = Format {
    name: "amrex",
    mark: "folder with Header",
    recognises: |path| header::looks_right(&header_file(path)),
    is_one_file: false,
    has_covered_cells: true,
    open: |path| Ok(Box::new(Plotfile::open(path)?)),
};

/// Names of the density, in the order in which they are looked for: Castro's, Nyx' and Pele's,
/// Quokka's, MAESTROeX', and WarpX' of the charge.
const DENSITIES: [&str; 3] = ["density", "gasDensity", "rho"];

/// The `Header` that `path` means: itself, or the one in that folder.
fn header_file(path: &Path) -> PathBuf {
    if path.is_dir() { path.join("Header") } else { path.to_path_buf() }
}

/// A plotfile.
struct Plotfile {
    about: About,
    levels: Vec<Level>,
}

/// A level of a plotfile.
struct Level {
    /// The number of its first grid among all.
    first: u64,
    /// Indices of the domain, whose lowest need not be 0.
    extent: IndexBox,
    data: LevelData,
}

impl Plotfile {
    fn open(path: &Path) -> Result<Self> {
        let file = header_file(path);
        let header = Header::read(&file)?;
        let folder = file.parent().unwrap_or(Path::new(""));
        let mut levels = Vec::new();
        let mut first = 0u64;
        for (grids, extent) in header.grids.iter().zip(header.extents) {
            let data = LevelData::open(folder, grids, header.components.len())?;
            let next = first.checked_add(data.count()).ok_or_else(|| {
                Error::invalid(file.display(), "has more grids than 64-bit numbers count")
            })?;
            levels.push(Level { first, extent, data });
            first = next;
        }
        let units = Units::read(folder);
        let field = |name| units::describe(name, units);
        let fields: Vec<_> = header.components.into_iter().map(field).collect();
        let hierarchy = Hierarchy {
            domain: header.domain,
            levels: header.levels,
            density: first_named(&fields, &DENSITIES),
            fields,
            time: header.time,
        };
        let about = About { format: FORMAT.name, path: path.to_path_buf(), hierarchy };
        Ok(Self { about, levels })
    }
}

impl Level {
    /// The grid `number` of the level `level`, in indices that begin with the domain.
    fn record(
        &self,
        level: usize,
        number: u64,
        printed: PrintedBox,
        locator: u64,
    ) -> Result<GridRecord> {
        let fault = |reason: String| Error::invalid(self.data.place(number), reason);
        let size = printed.size().map_err(fault)?;
        if !self.extent.contains(&printed.cells) {
            return Err(fault(format!(
                "its indices {:?} to {:?} lie outside the domain",
                printed.cells.lo,
                printed.cells.hi.map(|i| i - 1)
            )));
        }
        let lo = std::array::from_fn(|a| printed.cells.lo[a] - self.extent.lo[a]);
        Ok(GridRecord { id: self.first + number, level: level as u32, lo, size, locator })
    }

    /// The grid's cells in the file's own indices.
    fn printed(&self, grid: &GridRecord) -> IndexBox {
        let lo = std::array::from_fn(|a| grid.lo[a] + self.extent.lo[a]);
        IndexBox::at(lo, grid.size)
    }
}

impl Source for Plotfile {
    fn about(&self) -> &About {
        &self.about
    }

    fn for_each_grid(&self, visit: &mut dyn FnMut(GridRecord) -> Result<()>) -> Result<()> {
        for (level, grids) in self.levels.iter().enumerate() {
            grids.data.for_each_grid(&mut |number, printed, place| {
                visit(grids.record(level, number, printed, place)?)
            })?;
        }
        Ok(())
    }

    fn data_files(&self) -> Result<Vec<PathBuf>> {
        let mut files = BTreeSet::new();
        for level in &self.levels {
            level.data.for_each_grid(&mut |_, _, place| {
                files.insert(level.data.data_at(place)?.0);
                Ok(())
            })?;
        }
        Ok(files.into_iter().collect())
    }

    fn read(
        &self,
        grid: &GridRecord,
        field: usize,
        block: GridBlock,
        out: &mut [f64],
    ) -> Result<()> {
        let level = self.levels.get(grid.level as usize).ok_or_else(|| {
            Error::invalid(self.path().display(), format!("has no level {}", grid.level))
        })?;
        let cells = level.printed(grid);
        let fab = level.data.fab(&cells, grid.locator)?;
        let array = fab.header.array(field as u64);
        let within =
            array.and_then(|array| Some((array, inner(&fab.header.cells, &cells, block)?)));
        let (array, block) = within.ok_or_else(|| {
            let reason = format!("the FAB of grid {} is larger than any file", grid.id);
            Error::invalid(fab.file.path().display(), reason)
        })?;
        array.read(&fab.file, block, out)
    }
}

/// `block` of the grid of `cells` in indices of the array that begins at `array`, which has ghost
/// cells.
fn inner(array: &IndexBox, cells: &IndexBox, block: GridBlock) -> Option<GridBlock> {
    let mut lo = block.lo;
    for (a, lo) in lo.iter_mut().enumerate() {
        *lo = u32::try_from(cells.lo[a] - array.lo[a]).ok()?.checked_add(*lo)?;
    }
    Some(GridBlock { lo, size: block.size })
}

impl fab::FabHeader {
    /// The array of component `component`; none where its place exceeds 64 bits.
    fn array(&self, component: u64) -> Option<RawArray> {
        let size = self.cells.size().map(|n| u64::try_from(n).ok());
        let [Some(x), Some(y), Some(z)] = size else { return None };
        let first = RawArray {
            start: self.start,
            shape: [x, y, z],
            number: self.number,
            per_cell: 1,
            component: 0,
        };
        let bytes = first.end()? - self.start;
        let start = bytes.checked_mul(component)?.checked_add(self.start)?;
        Some(RawArray { start, ..first })
    }
}
