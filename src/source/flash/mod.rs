//! FLASH and Flash-X (Fryxell et al., *ApJS* 131, 2000): checkpoint and plot files of PARAMESH
//! runs, a tree of equal blocks in one HDF5 file. Parents are stored as well, with whatever data
//! they last had: only leaf blocks (node type 1) are the solution, and only these are grids here.

mod boxes;
mod fields;
mod header;
#[cfg(test)]
mod made;
#[cfg(test)]
mod tests;
mod tree;

use std::path::Path;

use header::Header;
use tree::Tree;

use super::hdf5::File;
use super::{About, Format, GridBlock, GridRecord, Hierarchy, Source, first_named};
use crate::space::Levels;
use crate::{Error, Result};

/// How the reader is listed among the formats.
pub(super) const FORMAT: Format = Format {
    name: "flash",
    mark: "HDF5 with `node type`",
    recognises,
    is_one_file: true,
    // Parents' averages are in some files, and in others what they held before they were refined.
    has_covered_cells: false,
    open: |path| Ok(Box::new(Flash::open(path)?)),
};

/// Whether `path` names a FLASH output, by its datasets.
fn recognises(path: &Path) -> bool {
    super::hdf5::is_hdf5(path)
        && File::open(path).and_then(|file| file.members("/")).is_ok_and(|members| {
            let has = |name: &&str| members.datasets.iter().any(|dataset| dataset == name);
            ["node type", "refine level", "bounding box"].iter().all(has)
        })
}

/// A FLASH output.
struct Flash {
    about: About,
    file: File,
    header: Header,
    tree: Tree,
    /// Paths of the fields' datasets.
    datasets: Vec<String>,
}

impl Flash {
    fn open(path: &Path) -> Result<Self> {
        let file = File::open(path)?;
        let header = Header::read(&file, path)?;
        let tree = Tree::read(&file, path, &header)?;
        let (datasets, fields) = fields::find(&file, path, &header)?;
        let levels = Levels::from_factors(&vec![2; tree.deepest() as usize])
            .map_err(|e| Error::not_supported(path.display(), e.to_string()))?;
        let density = first_named(&fields, &["dens"]);
        let (domain, time) = (header.domain.clone(), header.time);
        let hierarchy = Hierarchy { domain, levels, fields, density, time };
        let about = About { format: FORMAT.name, path: path.to_path_buf(), hierarchy };
        Ok(Self { about, file, header, tree, datasets })
    }
}

impl Source for Flash {
    fn about(&self) -> &About {
        &self.about
    }

    fn for_each_grid(&self, visit: &mut dyn FnMut(GridRecord) -> Result<()>) -> Result<()> {
        self.tree.for_each_leaf(&self.header, visit)
    }

    fn read(
        &self,
        grid: &GridRecord,
        field: usize,
        block: GridBlock,
        out: &mut [f64],
    ) -> Result<()> {
        let dataset = self.datasets.get(field).ok_or_else(|| self.about.no_field(field))?;
        let [x, y, z] = block.lo.map(u64::from);
        let [nx, ny, nz] = block.size.map(u64::from);
        self.file.read_f64(dataset, &[grid.locator, z, y, x], &[1, nz, ny, nx], out)
    }
}
