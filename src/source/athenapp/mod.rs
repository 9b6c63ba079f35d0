//! Athena++ (Stone et al., *ApJS* 249, 2020): `.athdf` outputs, which hold the leaf blocks of a
//! tree of equal blocks in one HDF5 file, beside an optional `.xdmf` that only names it.

mod attributes;
mod blocks;
mod fields;
mod located;
#[cfg(test)]
mod made;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use attributes::Attributes;
use blocks::Blocks;
use fields::Variable;

use super::hdf5::File;
use super::{About, Format, GridBlock, GridRecord, Hierarchy, Source, first_named};
use crate::space::{Domain, Levels};
use crate::{Error, Result};

/// How the reader is listed among the formats.
pub(super) const FORMAT: Format = Format {
    name: "athena++",
    mark: ".athdf",
    recognises,
    is_one_file: true,
    has_covered_cells: false,
    open: |path| Ok(Box::new(AthenaPp::open(path)?)),
};

/// Whether `path` names an Athena++ output, by its attributes.
fn recognises(path: &Path) -> bool {
    let Ok(path) = located::data_file(path) else { return false };
    super::hdf5::is_hdf5(&path)
        && File::open(&path).and_then(|file| file.attributes("/")).is_ok_and(|attributes| {
            ["NumMeshBlocks", "MeshBlockSize"].iter().all(|key| attributes.contains_key(*key))
        })
}

/// An Athena++ output.
struct AthenaPp {
    about: About,
    file: File,
    blocks: Blocks,
    variables: Vec<Variable>,
}

impl AthenaPp {
    fn open(path: &Path) -> Result<Self> {
        let data = located::data_file(path)?;
        let file = File::open(&data)?;
        let attributes = Attributes::read(&file, &data)?;
        attributes.check_mesh()?;
        let blocks = Blocks::read(&file, &data, &attributes)?;
        let variables = fields::variables(&file, &data, &attributes, blocks.count())?;
        let (left, right) = attributes.edges()?;
        let place = |e: Error| Error::invalid(data.display(), e.to_string());
        let domain = Domain::new(left, right, attributes.root_grid_size()?).map_err(place)?;
        let levels = Levels::from_factors(&vec![2; blocks.deepest() as usize])
            .map_err(|e| Error::not_supported(data.display(), e.to_string()))?;
        let fields: Vec<_> = variables.iter().map(Variable::describe).collect();
        let density = first_named(&fields, &fields::DENSITIES);
        let hierarchy = Hierarchy { domain, levels, fields, density, time: attributes.time() };
        let about = About { format: FORMAT.name, path: path.to_path_buf(), hierarchy };
        Ok(Self { about, file, blocks, variables })
    }
}

impl Source for AthenaPp {
    fn about(&self) -> &About {
        &self.about
    }

    fn for_each_grid(&self, visit: &mut dyn FnMut(GridRecord) -> Result<()>) -> Result<()> {
        self.blocks.for_each(&self.file, visit)
    }

    fn data_files(&self) -> Result<Vec<PathBuf>> {
        // The user may have named the .xdmf.
        Ok(vec![located::data_file(self.path())?])
    }

    fn read(
        &self,
        grid: &GridRecord,
        field: usize,
        block: GridBlock,
        out: &mut [f64],
    ) -> Result<()> {
        let variable = self.variables.get(field).ok_or_else(|| self.about.no_field(field))?;
        let first = block.lo.map(|n| u64::from(n) + self.blocks.ghosts());
        let [x, y, z] = block.size.map(u64::from);
        let start = [variable.number, grid.locator, first[2], first[1], first[0]];
        self.file.read_f64(&variable.dataset, &start, &[1, 1, z, y, x], out)
    }
}
