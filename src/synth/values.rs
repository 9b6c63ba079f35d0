//! Field values of grids.

use super::boxes::refined;
use super::density::Sampler;
use super::grids::{Grid, Grids};
use super::recipe::Covered;
use crate::space::IndexBox;

/// Temperature where the density is 1; it falls with the root of the density.
const TEMPERATURE_AT_UNIT_DENSITY: f64 = 1e4;

/// Values of the fields `fields` (of [`super::recipe::FIELD_NAMES`]) in a grid's cells, x
/// fastest, one vector a field.
pub(super) fn grid_values(
    grids: &Grids,
    grid: &Grid,
    fields: &[String],
    covered: Covered,
) -> Vec<Vec<f64>> {
    let mut values = model_values(grids, grid.level, grid.cells, fields);
    for child in grids.children(grid.level, &grid.cells) {
        cover(grids, grid, child, fields, covered, &mut values);
    }
    values
}

/// Values of the model at the centres of `cells` of level `level`, as [`grid_values`] gives them.
pub(super) fn model_values(
    grids: &Grids,
    level: u32,
    cells: IndexBox,
    fields: &[String],
) -> Vec<Vec<f64>> {
    let size = cells.size().map(|n| n as usize);
    let mut sampler = grids.model().sampler(grids.octree(level), cells);
    let mut values: Vec<Vec<f64>> =
        fields.iter().map(|_| Vec::with_capacity(size[0] * size[1] * size[2])).collect();
    for z in 0..size[2] {
        for y in 0..size[1] {
            for x in 0..size[0] {
                push_cell(&mut sampler, [x, y, z], fields, &mut values);
            }
        }
    }
    values
}

fn push_cell(sampler: &mut Sampler, at: [usize; 3], fields: &[String], values: &mut [Vec<f64>]) {
    let density = sampler.density(at);
    for (name, values) in fields.iter().zip(values) {
        values.push(match name.as_str() {
            "Temperature" => TEMPERATURE_AT_UNIT_DENSITY / density.max(f64::MIN_POSITIVE).sqrt(),
            "x-velocity" => sampler.velocity(0, at),
            "y-velocity" => sampler.velocity(1, at),
            "z-velocity" => sampler.velocity(2, at),
            _ => density,
        });
    }
}

/// Overwrites the cells of `grid` that lie under its child `child`.
fn cover(
    grids: &Grids,
    grid: &Grid,
    child: IndexBox,
    fields: &[String],
    covered: Covered,
    values: &mut [Vec<f64>],
) {
    let factor = grids.factor(grid.level);
    let under = IndexBox {
        lo: child.lo.map(|i| i.div_euclid(factor)),
        hi: child.hi.map(|i| i.div_euclid(factor)),
    };
    debug_assert_eq!(refined(&under, factor), child);
    match covered {
        Covered::Factor(wrong) => {
            for_each_cell(&under, |index| {
                let at = offset(&grid.cells, index);
                values.iter_mut().for_each(|field| field[at] *= wrong);
            });
        }
        Covered::Average(_) => {
            let fine = Grid { id: 0, level: grid.level + 1, cells: child };
            let fine_values = grid_values(grids, &fine, fields, covered);
            for_each_cell(&under, |index| {
                let at = offset(&grid.cells, index);
                let cell = refined(&IndexBox { lo: index, hi: index.map(|i| i + 1) }, factor);
                for (field, fine_field) in values.iter_mut().zip(&fine_values) {
                    let mut sum = 0.0;
                    for_each_cell(&cell, |index| sum += fine_field[offset(&child, index)]);
                    field[at] = sum / (factor * factor * factor) as f64;
                }
            });
        }
    }
}

fn for_each_cell(cells: &IndexBox, mut visit: impl FnMut([i128; 3])) {
    for z in cells.lo[2]..cells.hi[2] {
        for y in cells.lo[1]..cells.hi[1] {
            for x in cells.lo[0]..cells.hi[0] {
                visit([x, y, z]);
            }
        }
    }
}

/// Where cell `index` of a grid's box stands among the grid's values.
fn offset(cells: &IndexBox, index: [i128; 3]) -> usize {
    let size = cells.size();
    let [x, y, z] = std::array::from_fn(|a| index[a] - cells.lo[a]);
    ((z * size[1] + y) * size[0] + x) as usize
}
