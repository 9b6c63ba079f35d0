//! Places grids on the integer lattice of their level.

use super::listing::{Edge, ListedGrid};
use super::parameters::Parameters;
use crate::Result;
use crate::source::GridRecord;
use crate::source::lattice::{LARGEST_DEVIATION, nearest_corner};
use crate::space::{AXES, IndexBox, Levels};

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
    let width = extent(grid, axis)? / f64::from(size[axis]);
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

/// How far apart the grid's edges along `axis` are.
///
/// # Errors
/// The reason, where the lower is not below the upper one.
fn extent(grid: &ListedGrid, axis: usize) -> Result<f64, String> {
    let (left, right) = (&grid.left[axis], &grid.right[axis]);
    let mut extent = right.value() - left.value();
    // The doubles next to long numbers may be the same one.
    if extent.abs() < 1e-9 * left.value().abs() {
        let exact = |edge: &Edge| edge.decimal().map_err(|error| error.to_string());
        extent = exact(right)?.minus(&exact(left)?).to_f64();
    }
    if extent > 0.0 {
        return Ok(extent);
    }
    let (left, right) = (left.value(), right.value());
    Err(if extent == 0.0 {
        format!(
            "its edges along {} are the same number, {left}, so they have too few digits for its \
             cells: {NEEDED}",
            AXES[axis]
        )
    } else {
        format!("its edges along {} go from {left} down to {right}", AXES[axis])
    })
}

/// What tells where grids lie if the text does not.
const NEEDED: &str =
    "the run's .hierarchy.hdf5, which holds exact edges, is needed beside the .hierarchy";

/// Refuses edges along `axis` that are printed with too few digits to tell cells `width` wide
/// apart.
fn check_digits(grid: &ListedGrid, axis: usize, width: f64) -> Result<(), String> {
    for edge in [&grid.left[axis], &grid.right[axis]] {
        let error = edge.error();
        if error > LARGEST_DEVIATION * width.abs() {
            return Err(format!(
                "its edge {} along {} has too few digits for cells {width:e} wide (it may be off \
                 by {error:e}): {NEEDED}",
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
    let corner = |edges: &[Edge; 3]| {
        let shown = edges.each_ref().map(Edge::value);
        let exact = edges.iter().map(Edge::decimal);
        nearest_corner(&parameters.domain, level, octree, exact, "edge", shown)
    };
    let (lo, hi) = (corner(&grid.left)?, corner(&grid.right)?);
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
