//! Grids of layouts that list them level by level, evaluated in batches on all cores.

use rayon::prelude::*;

use super::grids::{Grid, Grids};
use super::recipe::Recipe;
use super::values::grid_values;
use crate::{Error, Result};

/// Cells of a batch (a single grid may exceed it).
const BATCH_CELLS: u64 = 1 << 21;
/// Most grids, as their boxes are kept.
const MOST_GRIDS: usize = 2_000_000;

/// Values of a grid, one vector a field, x fastest.
pub(super) type Evaluated = Vec<Vec<f64>>;

/// The grids by level.
///
/// # Errors
/// More than [`MOST_GRIDS`].
pub(super) fn by_level(grids: &Grids) -> Result<Vec<Vec<Grid>>> {
    let (mut levels, mut count) = (Vec::new(), 0);
    grids.for_each(&mut |grid| {
        let level = grid.level as usize;
        if levels.len() <= level {
            levels.resize(level + 1, Vec::new());
        }
        levels[level].push(grid);
        count += 1;
        if count <= MOST_GRIDS {
            return Ok(());
        }
        Err(Error::request(format!("refinement: more than {MOST_GRIDS} grids: refine less")))
    })?;
    Ok(levels)
}

/// Hands every grid of `list` to `take`, in order, with the values of `fields`.
///
/// # Errors
/// What `take` returns.
pub(super) fn evaluate(
    recipe: &Recipe,
    grids: &Grids,
    list: &[Grid],
    fields: &[String],
    take: &mut dyn FnMut(&Grid, Evaluated) -> Result<()>,
) -> Result<()> {
    let mut rest = list;
    while !rest.is_empty() {
        let mut total = 0;
        let fits = |grid: &&Grid| {
            total += grid.count();
            total <= BATCH_CELLS
        };
        let count = rest.iter().take_while(fits).count().max(1);
        let (batch, others) = rest.split_at(count);
        let covered = recipe.output.covered;
        let evaluated: Vec<Evaluated> =
            batch.par_iter().map(|grid| grid_values(grids, grid, fields, covered)).collect();
        for (grid, values) in batch.iter().zip(evaluated) {
            take(grid, values)?;
        }
        rest = others;
    }
    Ok(())
}
