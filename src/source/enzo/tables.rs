//! `.hierarchy.hdf5`: every grid's edges as the numbers that the code held.

use std::path::Path;

use super::listing::{Edge, ListedGrid};
use crate::source::hdf5::{File, Pool, Values};
use crate::{Error, Result};

/// The level of every grid, by number − 1.
const LOOKUP_TABLE: &str = "/LevelLookupTable";
/// Entries of the lookup table read at a time.
const PART: u64 = 4096;

/// Hands the number and level of every grid to `visit`, without reading the grids.
///
/// # Errors
/// A damaged file, or a table that contradicts the file's count of grids; and what `visit`
/// returns.
pub(super) fn for_each_level(
    path: &Path,
    pool: &Pool,
    visit: &mut dyn FnMut(u64, u32) -> Result<()>,
) -> Result<()> {
    let file = pool.get(path)?;
    let grids = grid_count(path, pool)?;
    let mut levels = Vec::new();
    for first in (0..grids).step_by(PART as usize) {
        let count = PART.min(grids - first);
        levels.resize(count as usize, 0);
        file.read_i64(LOOKUP_TABLE, &[first], &[count], &mut levels)?;
        for (id, &level) in (first + 1..).zip(&levels) {
            let level = u32::try_from(level).map_err(|_| {
                let reason = format!("the lookup table gives it level {level}");
                Error::invalid(format!("{}: grid {id}", path.display()), reason)
            })?;
            visit(id, level)?;
        }
    }
    Ok(())
}

/// Number of grids.
///
/// # Errors
/// As [`for_each_level`].
pub(super) fn grid_count(path: &Path, pool: &Pool) -> Result<u64> {
    let file = pool.get(path)?;
    let shape = file.dataset(LOOKUP_TABLE)?.shape;
    let stated = file.attributes("/")?.get("TotalNumberOfGrids").and_then(Values::integers);
    if let &[grids] = shape.as_slice() {
        file.check_holds(grids, 1)?;
    }
    match (shape.as_slice(), stated) {
        (&[grids], Some([stated])) if u64::try_from(stated) != Ok(grids) => Err(Error::invalid(
            path.display(),
            format!("says that it has {stated} grids, but its lookup table has {grids}"),
        )),
        (&[grids], _) => Ok(grids),
        _ => {
            let reason = format!("{LOOKUP_TABLE} has shape {shape:?}, not one axis");
            Err(Error::invalid(path.display(), reason))
        }
    }
}

/// Hands every grid to `visit`, in the order of their numbers.
///
/// # Errors
/// As [`for_each_level`], and grids that are missing or malformed.
pub(super) fn for_each_grid(
    path: &Path,
    pool: &Pool,
    visit: &mut dyn FnMut(ListedGrid) -> Result<()>,
) -> Result<()> {
    for_each_level(path, pool, &mut |id, level| visit(read_grid(path, pool, id, level)?))
}

/// One grid.
///
/// # Errors
/// A grid that is missing or malformed.
pub(super) fn read_grid(path: &Path, pool: &Pool, id: u64, level: u32) -> Result<ListedGrid> {
    let file = pool.get(path)?;
    let group = Group { file: &file, path: format!("/Level{level}/Grid{id:08}") };
    let attributes = file.attributes(&group.path)?;
    let particles = group.values("NumberOfParticles").ok().and_then(|number| number.integers());
    let text = |key: &str| attributes.get(key).and_then(Values::text).map(str::to_owned);
    let fault = |reason: String| Error::invalid(format!("{}: grid {id}", path.display()), reason);
    if let Some([rank]) = attributes.get("GridRank").and_then(Values::integers)
        && rank != 3
    {
        return Err(fault(format!("GridRank = {rank}: only three-dimensional grids can be read")));
    }
    Ok(ListedGrid {
        id,
        level: Some(level),
        start: group.integers("GridStartIndex")?,
        end: group.integers("GridEndIndex")?,
        left: group.edges("GridLeftEdge")?,
        right: group.edges("GridRightEdge")?,
        file: text("BaryonFileName").or_else(|| text("ParticleFileName")).ok_or_else(|| {
            fault("has neither BaryonFileName nor ParticleFileName: it holds no fields".into())
        })?,
        has_particles: particles.is_some_and(|[number]| number > 0),
    })
}

/// A grid's group.
struct Group<'a> {
    file: &'a File,
    path: String,
}

impl Group<'_> {
    fn values(&self, name: &str) -> Result<Values> {
        self.file.values(&format!("{}/{name}", self.path))
    }

    fn fault(&self, name: &str, reason: &str) -> Error {
        Error::invalid(format!("{}: {}/{name}", self.file.path().display(), self.path), reason)
    }

    fn integers(&self, name: &str) -> Result<[i64; 3]> {
        self.values(name)?.integers().ok_or_else(|| self.fault(name, "is not three integers"))
    }

    fn edges(&self, name: &str) -> Result<[Edge; 3]> {
        let is_finite = |edges: &[[f64; 2]; 3]| edges.iter().all(|edge| edge[0].is_finite());
        let edges = self.values(name)?.sums().filter(is_finite);
        let edges = edges.ok_or_else(|| self.fault(name, "is not three finite numbers"))?;
        Ok(edges.map(Edge::Exact))
    }
}
