//! Athena, the C code (Stone et al., *ApJS* 178, 2008; version 4.2), legacy VTK files, with static
//! mesh refinement: one file a domain and process.

mod files;
mod header;
mod lattice;
mod missing;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use header::{Header, Title};

use super::open_file::OpenFile;
use super::{About, Format, GridBlock, GridRecord, Hierarchy, Source, SourceField, first_named};
use crate::space::{Domain, Levels};
use crate::{Error, Result};

/// How the reader is listed among the formats.
pub(super) const FORMAT: Format = Format {
    name: "athena",
    mark: ".vtk",
    recognises,
    is_one_file: false,
    has_covered_cells: true,
    open: |path| Ok(Box::new(Output::open(path)?)),
};

/// Names of the density, in the order in which they are looked for: the second is that of
/// outputs of one variable.
const DENSITIES: [&str; 2] = ["density", "d"];

fn recognises(path: &Path) -> bool {
    match path.is_dir() {
        true => files::any(path).is_some_and(|file| Title::of(&file).is_some()),
        false => Title::of(path).is_some(),
    }
}

/// Whether a file is VTK's, of Athena or not.
pub(super) fn is_vtk(path: &Path) -> bool {
    header::line_of_title(path).is_some()
}

/// One output of a run.
struct Output {
    about: About,
    pieces: Vec<Piece>,
}

/// One file.
struct Piece {
    path: PathBuf,
    header: Header,
    grid: GridRecord,
}

/// The domain, and the files in it.
fn place(path: &Path, files: Vec<PathBuf>) -> Result<(Domain, Vec<Piece>)> {
    let read = |path: PathBuf| Ok((Header::read(&path)?, path));
    let files: Vec<(Header, PathBuf)> = files.into_iter().map(read).collect::<Result<_>>()?;
    if files.is_empty() {
        return Err(Error::request(format!("{}: holds no .vtk files", path.display())));
    }
    let headers = files.iter().map(|(header, _)| header);
    let root: Vec<&Header> = headers.filter(|header| header.level() == 0).collect();
    let domain = lattice::domain(&root).map_err(|reason| Error::invalid(path.display(), reason))?;
    let place = |(number, (header, path)): (u64, (Header, PathBuf))| {
        let grid = lattice::place(&header, &domain, number)
            .map_err(|reason| Error::invalid(path.display(), reason))?;
        Ok(Piece { path, header, grid })
    };
    let pieces = (0..).zip(files).map(place).collect::<Result<_>>()?;
    Ok((domain, pieces))
}

impl Output {
    fn open(path: &Path) -> Result<Self> {
        let files = files::of_output(path)?;
        let (domain, pieces) = place(path, files.own)?;
        missing::check(path, &domain, &pieces, &files.elsewhere)?;
        let deepest = pieces.iter().map(|piece| piece.header.level()).max().unwrap_or(0);
        let levels = Levels::from_factors(&vec![lattice::FACTOR; deepest as usize])?;
        let fields = common_fields(&pieces)?;
        if fields.is_empty() {
            let reason = "its files have no variable in common: nothing to read";
            return Err(Error::invalid(path.display(), reason));
        }
        let field = |name| SourceField { name, units: None, to_cgs: None };
        let fields: Vec<_> = fields.into_iter().map(field).collect();
        let density = first_named(&fields, &DENSITIES);
        let time = pieces.first().and_then(|piece| piece.header.time());
        let hierarchy = Hierarchy { domain, levels, fields, density, time };
        let about = About { format: FORMAT.name, path: path.to_path_buf(), hierarchy };
        Ok(Self { about, pieces })
    }
}

/// Fields of the first file of every level, in its order.
fn common_fields(pieces: &[Piece]) -> Result<Vec<String>> {
    let mut first_of_levels: BTreeMap<u32, &Piece> = BTreeMap::new();
    for piece in pieces {
        first_of_levels.entry(piece.header.level()).or_insert(piece);
    }
    let mut common: Option<Vec<String>> = None;
    for piece in first_of_levels.into_values() {
        let file = OpenFile::open(&piece.path)?;
        let variables = header::variables(&file, &piece.header, &|_| false)?;
        let names: Vec<String> = variables.iter().flat_map(header::Variable::fields).collect();
        common = Some(match common {
            None => names,
            Some(common) => common.into_iter().filter(|name| names.contains(name)).collect(),
        });
    }
    Ok(common.unwrap_or_default())
}

impl Source for Output {
    fn about(&self) -> &About {
        &self.about
    }

    fn for_each_grid(&self, visit: &mut dyn FnMut(GridRecord) -> Result<()>) -> Result<()> {
        self.pieces.iter().try_for_each(|piece| visit(piece.grid))
    }

    fn data_files(&self) -> Result<Vec<PathBuf>> {
        Ok(self.pieces.iter().map(|piece| piece.path.clone()).collect())
    }

    fn read(
        &self,
        grid: &GridRecord,
        field: usize,
        block: GridBlock,
        out: &mut [f64],
    ) -> Result<()> {
        let piece = usize::try_from(grid.locator).ok().and_then(|number| self.pieces.get(number));
        let piece = piece.ok_or_else(|| {
            Error::invalid(self.path().display(), format!("has no grid {}", grid.id))
        })?;
        let name = self.about.field_name(field)?;
        let file = OpenFile::open(&piece.path)?;
        let has_it = |variable: &header::Variable| variable.fields().iter().any(|f| f == name);
        let variables = header::variables(&file, &piece.header, &has_it)?;
        let array = header::array(&variables, name).ok_or_else(|| {
            Error::invalid(piece.path.display(), format!("has no variable for the field {name}"))
        })?;
        array.read(&file, block, out)
    }
}
