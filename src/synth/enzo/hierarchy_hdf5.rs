//! `.hierarchy.hdf5`: the hierarchy with edges in full double precision.
//!
//! Enzo also links each grid to its data file here; the HDF5 writer has no external links, and
//! `BaryonFileName` says the same.

use hdf5_pure::{AttrValue, FileBuilder, FinishedGroup, GroupBuilder, LibVer};

use super::{GHOST_ZONES, TIME, data_path, edges, field_types, particles};
use crate::synth::grids::{Grid, Grids};
use crate::synth::output::OutputFolder;
use crate::synth::recipe::Recipe;
use crate::{Error, Result};

/// A grid with its place among the others.
pub(super) struct Listed {
    grid: Grid,
    file: u32,
    next_sibling: u64,
    /// Number of the first child (0: none).
    pub(super) first_child: u64,
}

impl Listed {
    /// A grid whose children are not known yet.
    pub(super) fn new(grid: Grid, file: u32, next_sibling: u64) -> Self {
        Self { grid, file, next_sibling, first_child: 0 }
    }
}

/// Writes the file; its size.
pub(super) fn write(
    recipe: &Recipe,
    grids: &Grids,
    listed: &[Listed],
    folder: &OutputFolder,
) -> Result<u64> {
    let mut builder = FileBuilder::new();
    builder.with_libver_bounds(LibVer::Earliest, LibVer::V18);
    builder.set_attr("NumberOfProcessors", AttrValue::I64(1));
    builder.set_attr("Redshift", AttrValue::F64(0.0));
    builder.set_attr("TotalNumberOfGrids", AttrValue::I64(listed.len() as i64));
    let levels: Vec<i64> = listed.iter().map(|g| g.grid.level.into()).collect();
    builder.create_dataset("LevelLookupTable").with_i64_data(&levels);
    for level in 0..=levels.iter().copied().max().unwrap_or(0) {
        let mut group = builder.create_group(&format!("Level{level}"));
        let members = listed.iter().filter(|g| i64::from(g.grid.level) == level);
        group.set_attr("NumberOfGrids", AttrValue::I64(members.clone().count() as i64));
        for member in members {
            let name = format!("Grid{:08}", member.grid.id);
            let member_group = group.create_group(&name);
            group.add_group(grid_group(recipe, grids, member, member_group)?);
        }
        builder.add_group(group.finish());
    }
    let path = folder.file(&format!("{}.hierarchy.hdf5", recipe.name));
    crate::synth::hdf5::save(builder, &path)
}

fn grid_group(
    recipe: &Recipe,
    grids: &Grids,
    listed: &Listed,
    mut group: GroupBuilder,
) -> Result<FinishedGroup> {
    let grid = &listed.grid;
    set_attributes(recipe, listed, &mut group);
    let whole = |values: [i128; 3]| -> Result<[i64; 3]> {
        let fits = |v| i64::try_from(v).ok();
        match values.map(fits) {
            [Some(x), Some(y), Some(z)] => Ok([x, y, z]),
            _ => Err(Error::request(format!(
                "refinement: cell indices of level {} exceed 64 bits, which GridGlobalPosition \
                 needs: refine less",
                grid.level
            ))),
        }
    };
    let (size, ghosts) = (grid.cells.size(), i128::from(GHOST_ZONES));
    let (left, right) = edges(grids, grid);
    for (name, values) in [
        ("GridDimension", size.map(|n| n + 2 * ghosts)),
        ("GridStartIndex", [ghosts; 3]),
        ("GridEndIndex", size.map(|n| n + ghosts - 1)),
        ("GridGlobalPosition", grid.cells.lo),
    ] {
        group.create_dataset(name).with_i64_data(&whole(values)?);
    }
    group.create_dataset("GridLeftEdge").with_f64_data(&left);
    group.create_dataset("GridRightEdge").with_f64_data(&right);
    let count = i64::from(particles(recipe, grid));
    group.create_dataset("NumberOfParticles").with_i64_data(&[count]).with_shape(&[]);
    Ok(group.finish())
}

fn set_attributes(recipe: &Recipe, listed: &Listed, group: &mut GroupBuilder) {
    let types: Vec<i64> = field_types(recipe).iter().map(|(number, _)| *number).collect();
    let path = data_path(&recipe.name, listed.file);
    group.set_attr("BaryonFileName", AttrValue::AsciiString(path));
    group.set_attr("NumberOfBaryonFields", AttrValue::I64(types.len() as i64));
    group.set_attr("FieldType", AttrValue::I64Array(types));
    group.set_attr("GridRank", AttrValue::I64(3));
    group.set_attr("Time", AttrValue::F64(TIME));
    group.set_attr("Task", AttrValue::I64(listed.file.into()));
    group.set_attr("NextGridThisLevelID", AttrValue::I64(listed.next_sibling as i64));
    group.set_attr("NextGridNextLevelID", AttrValue::I64(listed.first_child as i64));
}
