//! Corners of grids on the integer lattice of their level.

use crate::Result;
use crate::space::{AXES, Decimal, Domain};

/// Largest distance of a corner from the lattice, and largest error of a printed one, in cells of
/// the grid's level. Doubles have two units in the last place to a cell at level 47 of a 16³
/// root grid, so a quarter is what they still tell apart.
pub(super) const LARGEST_DEVIATION: f64 = 0.25;

/// The lattice point of `level`, which is octree level `octree`, that is nearest to a corner. `what`
/// names the corner's coordinates in messages, where `shown` stands for them.
///
/// # Errors
/// The reason, where a coordinate cannot be told, or lies farther from the lattice than
/// [`LARGEST_DEVIATION`].
pub(super) fn nearest_corner(
    domain: &Domain,
    level: u32,
    octree: u32,
    corner: impl Iterator<Item = Result<Decimal>>,
    what: &str,
    shown: [f64; 3],
) -> Result<[i128; 3], String> {
    let corner: Result<Vec<Decimal>> = corner.collect();
    let corner: [Decimal; 3] = corner
        .map_err(|e| e.to_string())?
        .try_into()
        .map_err(|_| "a corner needs three coordinates".to_owned())?;
    let (index, off) = domain.nearest_corner(octree, &corner).map_err(|e| e.to_string())?;
    for a in 0..3 {
        if off[a].abs() > LARGEST_DEVIATION {
            return Err(format!(
                "its {what} {} along {} lies {:.2} cells from the lattice of level {level}",
                shown[a],
                AXES[a],
                off[a].abs()
            ));
        }
    }
    Ok(index)
}
