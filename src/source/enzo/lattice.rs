//! Places grids on the integer lattice of their level.

use super::listing::{Edge, ListedGrid};
use super::parameters::Parameters;
use crate::Result;
use crate::source::GridRecord;
use crate::space::{Decimal, IndexBox, Levels};

/// Largest distance of an edge from the lattice, and largest error of a printed one, in cells of
/// the grid's level. Doubles have two units in the last place to a cell at level 47 of a 16³
/// root grid, so a quarter is what they still tell apart.
const LARGEST_DEVIATION: f64 = 0.25;
const AXES: [&str; 3] = ["x", "y", "z"];

/// The level of `grid`: stated, or from the width of its cells.
///
/// # Errors
/// The reason, where the cells are no power of the refinement factor smaller than root cells.
pub(super) fn level(grid: &ListedGrid, parameters: &Parameters) -> Result<u32, String> {
    let size = grid.size()?;
    if let Some(level) = grid.level {
        return Ok(level);
    }
    let factor = f64::from(parameters.refine_by);
    let root_width = parameters.domain.root_cell_width();
    // The axis with the most cells gives the width of one most precisely.
    let axis = (0..3).max_by_key(|&a| size[a]).unwrap_or(0);
    let width = (grid.right[axis].value() - grid.left[axis].value()) / f64::from(size[axis]);
    check_digits(grid, axis, width)?;
    let level = ((root_width[axis] / width).ln() / factor.ln()).round();
    if !(0.0..=1e4).contains(&level) {
        return Err(format!(
            "its cells are {width:e} wide along {}, which is no power of {factor} below the root \
             cells",
            AXES[axis]
        ));
    }
    for a in 0..3 {
        check_digits(grid, a, root_width[a] * factor.powf(-level))?;
    }
    Ok(level as u32)
}

/// Refuses edges along `axis` that are printed with too few digits to tell cells `width` wide
/// apart.
fn check_digits(grid: &ListedGrid, axis: usize, width: f64) -> Result<(), String> {
    for edge in [&grid.left[axis], &grid.right[axis]] {
        let error = edge.error();
        if error > LARGEST_DEVIATION * width.abs() {
            return Err(format!(
                "its edge {} along {} has too few digits for cells {width:e} wide (it may be off \
                 by {error:e}): the run's .hierarchy.hdf5, which holds exact edges, is needed \
                 beside the .hierarchy",
                edge.value(),
                AXES[axis]
            ));
        }
    }
    Ok(())
}

/// `grid` with its cells' indices at its level; `locator` is passed on.
///
/// # Errors
/// The reason, where the grid does not fit the lattice of its level, or what is known of its
/// edges does not tell where it lies.
pub(super) fn place(
    grid: &ListedGrid,
    parameters: &Parameters,
    levels: &Levels,
    locator: u64,
) -> Result<GridRecord, String> {
    let level = level(grid, parameters)?;
    let octree = levels
        .octree(level as usize)
        .ok_or_else(|| format!("lies at level {level}, deeper than the hierarchy's levels"))?;
    let size = grid.size()?;
    let lo = corner(&grid.left, level, octree, parameters)?;
    let hi = corner(&grid.right, level, octree, parameters)?;
    let cells = IndexBox::at(lo, size);
    for a in 0..3 {
        if hi[a] != cells.hi[a] {
            return Err(format!(
                "its edges along {} are {} cells of level {level} apart, but it has {} cells",
                AXES[a],
                hi[a] - lo[a],
                size[a]
            ));
        }
        if lo[a] < 0 || hi[a] > i128::from(parameters.domain.root_cells()[a]) << octree {
            return Err(format!("its edges along {} lie outside the domain", AXES[a]));
        }
    }
    Ok(GridRecord { id: grid.id, level, lo, size, locator })
}

/// The lattice point nearest to a corner.
fn corner(
    edges: &[Edge; 3],
    level: u32,
    octree: u32,
    parameters: &Parameters,
) -> Result<[i128; 3], String> {
    let domain = &parameters.domain;
    let exact: Result<Vec<Decimal>> = edges.iter().map(Edge::decimal).collect();
    let exact: [Decimal; 3] = exact
        .map_err(|e| e.to_string())?
        .try_into()
        .map_err(|_| "a corner needs three coordinates".to_owned())?;
    let (index, off) = domain.nearest_corner(octree, &exact).map_err(|e| e.to_string())?;
    for a in 0..3 {
        if off[a].abs() > LARGEST_DEVIATION {
            return Err(format!(
                "its edge {} along {} lies {:.2} cells from the lattice of level {level}",
                edges[a].value(),
                AXES[a],
                off[a].abs()
            ));
        }
    }
    Ok(index)
}
