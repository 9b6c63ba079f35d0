//! Enzo, packed AMR: a parameter file, a hierarchy (text, HDF5 or both) and HDF5 data files.

#[cfg(test)]
mod damage;
mod fields;
mod files;
mod lattice;
mod listing;
#[cfg(test)]
mod made;
mod parameters;
mod tables;
#[cfg(test)]
mod tests;
mod text;

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use files::{DataFiles, Dump};
use listing::{ListedGrid, PRINTED_DIGITS, Samples};
use parameters::Parameters;

use super::hdf5::Pool;
use super::{About, Format, GridBlock, GridRecord, Hierarchy, Source};
use crate::space::{Levels, MAX_OCTREE_LEVEL};
use crate::{Error, Result};

/// How the reader is listed among the formats.
pub(super) const FORMAT: Format = Format {
    name: "enzo",
    mark: "NAME beside NAME.hierarchy",
    recognises,
    is_one_file: false,
    has_covered_cells: true,
    open: |path| Ok(Box::new(Enzo::open(path)?)),
};

/// With more grids than this the text hierarchy is read though there is an HDF5 one: an HDF5
/// library holds the names of a group's members (about 200 bytes each), text is a stream. Runs
/// of so many grids are too shallow for the text's digits to fail; where they do, it is refused.
const MOST_GRIDS_IN_TABLES: u64 = 100_000;

/// Most grids of a level of an HDF5 hierarchy that are asked for particles; of text all are, as it is
/// read to its end anyway.
const MOST_SAMPLES: u32 = 64;

/// Whether `path` names an Enzo dump, by what its parameter file holds; or a folder of several, of which
/// one is to be named.
fn recognises(path: &Path) -> bool {
    let dump = match Dump::locate(path) {
        Ok(Some(dump)) => dump,
        Ok(None) => return false,
        Err(error) => return matches!(error, Error::Request(_)),
    };
    (dump.text().is_file() || dump.tables().is_file())
        && parameters::read_text(&dump.parameters).is_ok_and(|text| parameters::looks_right(&text))
}

/// The file that lists the grids.
enum Listing {
    Text {
        path: PathBuf,
        /// How many digits it has of numbers that need them.
        digits: i32,
    },
    Tables(PathBuf),
}

/// An Enzo dump.
struct Enzo {
    about: About,
    dump: Dump,
    listing: Listing,
    parameters: Parameters,
    files: Mutex<DataFiles>,
    pool: Pool,
}

impl Enzo {
    fn open(path: &Path) -> Result<Self> {
        let dump = Dump::locate(path)?.ok_or_else(|| {
            Error::request(format!("{}: holds no Enzo dump (no .hierarchy)", path.display()))
        })?;
        let text = parameters::read_text(&dump.parameters)?;
        let parameters = Parameters::parse(&dump.parameters, &text)?;
        let pool = Pool::default();
        let mut listing = Listing::choose(&dump, &pool)?;
        let samples = match listing.samples_of_each_level(&pool, &parameters) {
            Err(_) if listing.count_digits()? => listing.samples_of_each_level(&pool, &parameters),
            samples => samples,
        }?;
        let factors = vec![parameters.refine_by; samples.len().saturating_sub(1)];
        let levels = Levels::from_factors(&factors)
            .map_err(|e| Error::not_supported(listing.path().display(), e.to_string()))?;
        let hierarchy = Hierarchy {
            domain: parameters.domain.clone(),
            levels,
            fields: Vec::new(),
            density: None,
            time: parameters.time,
        };
        let files = Mutex::default();
        let about = About { format: FORMAT.name, path: path.to_path_buf(), hierarchy };
        let mut enzo = Self { about, dump, listing, parameters, files, pool };
        enzo.find_fields(&samples)?;
        Ok(enzo)
    }

    /// Sets the fields: those that the first grid of every level has, and dark matter's density, which
    /// one of `samples` need have.
    fn find_fields(&mut self, samples: &[Samples]) -> Result<()> {
        let mut common: Option<Vec<String>> = None;
        let mut has_dark_matter = false;
        for grid in samples.iter().filter_map(|level| level.first.as_ref()) {
            let names = self.fields_of(grid)?;
            has_dark_matter |= has_dark_matter_in(&names);
            common = Some(match common {
                None => names,
                Some(common) => common.into_iter().filter(|name| names.contains(name)).collect(),
            });
        }
        let mut names = common.unwrap_or_default();
        if names.is_empty() {
            let reason = "its grids have no field in common with as many cells as they have \
                          themselves (ghost zones, by WriteGhostZones = 1, are not read): \
                          nothing to read";
            return Err(Error::invalid(self.dump.parameters.display(), reason));
        }
        for grid in samples.iter().filter_map(|level| level.with_particles.as_ref()) {
            has_dark_matter = has_dark_matter || has_dark_matter_in(&self.fields_of(grid)?);
        }
        if has_dark_matter && !has_dark_matter_in(&names) {
            names.push(fields::DARK_MATTER.to_owned());
            names.sort();
        }
        let hierarchy = &mut self.about.hierarchy;
        hierarchy.fields =
            names.into_iter().map(|name| fields::describe(name, &self.parameters)).collect();
        hierarchy.density = fields::density(&hierarchy.fields);
        Ok(())
    }

    /// The fields of one grid.
    fn fields_of(&self, grid: &ListedGrid) -> Result<Vec<String>> {
        let record = self.place(grid)?;
        let file = self.pool.get(&self.data_file(&record)?)?;
        fields::names(&file, &group(record.id), record.size)
            .map_err(|error| fields::unpacked(&file, &group(record.id)).unwrap_or(error))
    }

    /// A listed grid on its level's lattice, its data file found.
    fn place(&self, grid: &ListedGrid) -> Result<GridRecord> {
        let number = {
            let mut files = self.files.lock().unwrap_or_else(PoisonError::into_inner);
            files.number(&self.dump, &grid.file)
        };
        number
            .and_then(|number| {
                lattice::place(grid, &self.parameters, &self.about.hierarchy.levels, number)
            })
            .map_err(|reason| self.listing.fault(grid.id, reason))
    }

    fn data_file(&self, grid: &GridRecord) -> Result<PathBuf> {
        let files = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        files.path(grid.locator).ok_or_else(|| {
            self.listing.fault(grid.id, "is of another source: its data file is unknown")
        })
    }
}

impl Source for Enzo {
    fn about(&self) -> &About {
        &self.about
    }

    fn for_each_grid(&self, visit: &mut dyn FnMut(GridRecord) -> Result<()>) -> Result<()> {
        self.listing.for_each_grid(&self.pool, &mut |grid| visit(self.place(&grid)?))
    }

    fn data_files(&self) -> Result<Vec<PathBuf>> {
        // All are known when every grid has been placed.
        self.for_each_grid(&mut |_| Ok(()))?;
        let files = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        Ok(files.paths().to_vec())
    }

    fn read(
        &self,
        grid: &GridRecord,
        field: usize,
        block: GridBlock,
        out: &mut [f64],
    ) -> Result<()> {
        let path = self.data_file(grid)?;
        let file = self.pool.get(&path)?;
        let name = self.about.field_name(field)?;
        let dataset = format!("{}/{name}", group(grid.id));
        let shape = match file.dataset(&dataset) {
            Err(_) if fields::is_left_out(&file, &group(grid.id), name, grid.size)? => {
                out.fill(0.0);
                return Ok(());
            }
            found => found?.shape,
        };
        let zyx = |xyz: [u32; 3]| [xyz[2], xyz[1], xyz[0]].map(u64::from);
        if shape != zyx(grid.size) {
            return Err(Error::invalid(
                format!("{}: {dataset}", path.display()),
                format!(
                    "its shape {shape:?} contradicts the hierarchy, which gives the grid {:?}",
                    zyx(grid.size)
                ),
            ));
        }
        file.read_f64(&dataset, &zyx(block.lo), &zyx(block.size), out)
    }
}

fn has_dark_matter_in(names: &[String]) -> bool {
    names.iter().any(|name| name == fields::DARK_MATTER)
}

/// The group that holds grid `id`'s data in its data file.
fn group(id: u64) -> String {
    format!("/Grid{id:08}")
}

impl Listing {
    fn choose(dump: &Dump, pool: &Pool) -> Result<Self> {
        let (text, tables) = (dump.text(), dump.tables());
        match (text.is_file(), tables.is_file()) {
            (true, true) if tables::grid_count(&tables, pool)? > MOST_GRIDS_IN_TABLES => {
                Ok(Self::text(text))
            }
            (_, true) => Ok(Self::Tables(tables)),
            (true, false) => Ok(Self::text(text)),
            (false, false) => {
                let reason = "is missing, and so is .hierarchy.hdf5: the dump needs one of them";
                Err(Error::invalid(text.display(), reason))
            }
        }
    }

    fn text(path: PathBuf) -> Self {
        Self::Text { path, digits: PRINTED_DIGITS }
    }

    /// Counts the digits of a text's edges, which takes reading all of it; whether they are more than was
    /// thought.
    fn count_digits(&mut self) -> Result<bool> {
        let Self::Text { path, digits } = self else { return Ok(false) };
        let thought = std::mem::replace(digits, text::most_digits(path)?);
        Ok(*digits > thought)
    }

    fn path(&self) -> &Path {
        match self {
            Self::Text { path, .. } | Self::Tables(path) => path,
        }
    }

    fn fault(&self, id: u64, reason: impl Into<String>) -> Error {
        Error::invalid(format!("{}: grid {id}", self.path().display()), reason)
    }

    fn for_each_grid(
        &self,
        pool: &Pool,
        visit: &mut dyn FnMut(ListedGrid) -> Result<()>,
    ) -> Result<()> {
        match self {
            Self::Text { path, digits } => text::for_each_grid(path, *digits, visit),
            Self::Tables(path) => tables::for_each_grid(path, pool, visit),
        }
    }

    /// Grids of each level that tell its fields, in one pass that places nothing.
    fn samples_of_each_level(&self, pool: &Pool, parameters: &Parameters) -> Result<Vec<Samples>> {
        let mut samples = Vec::new();
        match self {
            Self::Text { path, digits } => text::for_each_grid(path, *digits, &mut |grid| {
                let level = lattice::level(&grid, parameters)
                    .map_err(|reason| self.fault(grid.id, reason))?;
                self.slot(&mut samples, level, grid.id)?.look_at(grid);
                Ok(())
            })?,
            Self::Tables(path) => tables::for_each_level(path, pool, &mut |id, level| {
                let slot = self.slot(&mut samples, level, id)?;
                if slot.want_more(MOST_SAMPLES) {
                    slot.look_at(tables::read_grid(path, pool, id, level)?);
                }
                Ok(())
            })?,
        }
        if samples.first().is_none_or(|root: &Samples| root.first.is_none()) {
            let reason = "lists no grid of the root level: is it truncated?";
            return Err(Error::invalid(self.path().display(), reason));
        }
        Ok(samples)
    }

    /// The place of level `level` in a list by level.
    fn slot<'a>(
        &self,
        samples: &'a mut Vec<Samples>,
        level: u32,
        id: u64,
    ) -> Result<&'a mut Samples> {
        if level > MAX_OCTREE_LEVEL {
            let reason = format!(
                "lies at level {level}: at most {MAX_OCTREE_LEVEL} factor-2 steps below the root \
                 grid are supported"
            );
            let place = format!("{}: grid {id}", self.path().display());
            return Err(Error::not_supported(place, reason));
        }
        let at = level as usize;
        if samples.len() <= at {
            samples.resize(at + 1, Samples::default());
        }
        Ok(&mut samples[at])
    }
}
