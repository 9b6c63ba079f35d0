//! Enzo's packed-AMR layout: parameter file, `.hierarchy`, `.hierarchy.hdf5`, `.cpuNNNN`.

mod data;
mod hierarchy;
mod hierarchy_hdf5;
mod parameters;

use std::path::Path;

use super::grids::{Grid, Grids, Step};
use super::output::OutputFolder;
use super::recipe::{DEFAULT_HDF5_HIERARCHY_GRIDS, MAX_HDF5_HIERARCHY_GRIDS, Recipe};
use super::{Layout, Summary};
use crate::space::AXES;
use crate::{Error, Result};
use data::DataFiles;
use hierarchy::HierarchyText;

/// Ghost cells that Enzo's dimensions count on each side; they are not stored.
const GHOST_ZONES: u64 = 3;
/// Code time of all grids.
const TIME: f64 = 0.25;

/// What a first walk over the grids counts.
#[derive(Debug, Clone, Copy, Default)]
struct Totals {
    levels: u32,
    grids: u64,
    cells: u64,
}

/// How the layout is listed among the others.
pub(super) const LAYOUT: Layout = Layout { name: "enzo", write };

/// Writes the data set, as [`crate::synth::write`] says. Memory depends on the largest grid and
/// the deepest level.
fn write(recipe: &Recipe, directory: &Path, progress: &mut dyn FnMut(u64, u64)) -> Result<Summary> {
    let factor = recipe.one_factor()?;
    let grids = Grids::new(recipe)?;
    let totals = count(&grids)?;
    let with_hdf5 = wants_hdf5_hierarchy(recipe, &grids, totals)?;
    let folder = OutputFolder::create(directory, &recipe.name, &recipe.name)?;
    let mut bytes = parameters::write(recipe, factor, &folder, totals)?;
    let mut text = HierarchyText::create(recipe, &folder)?;
    let mut data = DataFiles::new(recipe, &grids, &folder);
    let mut listed = Vec::new();
    grids.walk(&mut |step| {
        match step {
            Step::Grid(grid, next) => {
                let file = data.add(grid)?;
                progress(data.cells_written(), totals.cells);
                text.grid(&grids, &grid, file, next)?;
                if with_hdf5 {
                    listed.push(hierarchy_hdf5::Listed::new(grid, file, next));
                }
            }
            Step::FirstChild(id, child) => {
                text.first_child(id, child)?;
                if let Some(grid) = id.checked_sub(1).and_then(|i| listed.get_mut(i as usize)) {
                    grid.first_child = child;
                }
            }
        }
        Ok(())
    })?;
    bytes += data.finish()? + text.finish()?;
    progress(totals.cells, totals.cells);
    if with_hdf5 {
        bytes += hierarchy_hdf5::write(recipe, &grids, &listed, &folder)?;
    }
    let input = folder.finish()?.join(&recipe.name);
    let Totals { levels, grids, cells } = totals;
    Ok(Summary { input, levels, grids, cells, bytes })
}

/// Counts grids and cells, and checks that doubles can tell the grids' edges apart.
fn count(grids: &Grids) -> Result<Totals> {
    let mut totals = Totals::default();
    grids.for_each(&mut |grid| {
        totals.levels = totals.levels.max(grid.level + 1);
        totals.grids += 1;
        totals.cells += grid.count();
        check_edges(grids, &grid)
    })?;
    Ok(totals)
}

/// Refuses cells less than two units in the last place of their grid's edges wide: readers round
/// edges to the level's lattice.
fn check_edges(grids: &Grids, grid: &Grid) -> Result<()> {
    let (left, right) = edges(grids, grid);
    let width = grids.domain().cell_width(grids.octree(grid.level).cast_signed());
    for axis in 0..3 {
        let largest = left[axis].abs().max(right[axis].abs());
        if width[axis] < 2.0 * (largest.next_up() - largest) {
            return Err(Error::request(format!(
                "refinement: cells of level {} are too small for double-precision edges at {} \
                 along {}: refine less or closer to 0",
                grid.level, left[axis], AXES[axis]
            )));
        }
    }
    Ok(())
}

fn wants_hdf5_hierarchy(recipe: &Recipe, grids: &Grids, totals: Totals) -> Result<bool> {
    let needed = recipe.needs_hdf5_hierarchy()?;
    let wanted = recipe
        .output
        .hierarchy_hdf5
        .unwrap_or(needed || totals.grids <= DEFAULT_HDF5_HIERARCHY_GRIDS);
    if wanted && totals.grids > MAX_HDF5_HIERARCHY_GRIDS {
        return Err(Error::request(format!(
            "output.hierarchy_hdf5: {} grids on {} levels of {:?} root cells: at most \
             {MAX_HDF5_HIERARCHY_GRIDS} grids fit",
            totals.grids,
            totals.levels,
            grids.domain().root_cells()
        )));
    }
    Ok(wanted)
}

/// Left and right edges of a grid, code length.
fn edges(grids: &Grids, grid: &Grid) -> ([f64; 3], [f64; 3]) {
    let octree = grids.octree(grid.level);
    let edge = |axis, index| super::edges::cell_edge(grids.domain(), octree, axis, index);
    let left = std::array::from_fn(|a| edge(a, grid.cells.lo[a]));
    (left, std::array::from_fn(|a| edge(a, grid.cells.hi[a])))
}

/// Particles that a grid holds: every third grid has some.
fn particles(recipe: &Recipe, grid: &Grid) -> u32 {
    if grid.id.is_multiple_of(3) { recipe.output.particles } else { 0 }
}

/// Path of a data file as Enzo writes it: relative to where the code ran.
fn data_path(name: &str, file: u32) -> String {
    format!("./{name}/{}", data_file(name, file))
}

fn data_file(name: &str, file: u32) -> String {
    format!("{name}.cpu{file:04}")
}

/// Enzo's numbers of those fields that its hierarchy counts; `Temperature` is derived, so it is
/// written but not listed.
fn field_types(recipe: &Recipe) -> Vec<(i64, &str)> {
    let number = |name: &str| match name {
        "Density" => Some(0),
        "x-velocity" => Some(4),
        "y-velocity" => Some(5),
        "z-velocity" => Some(6),
        _ => None,
    };
    let fields = recipe.output.fields.iter();
    fields.filter_map(|name| number(name).map(|n| (n, name.as_str()))).collect()
}
