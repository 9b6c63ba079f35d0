//! The `Header`.

use std::fmt::Write;

use super::{TIME, component, printed};
use crate::space::IndexBox;
use crate::synth::edges::cell_edge;
use crate::synth::grids::{Grid, Grids};
use crate::synth::recipe::Recipe;

/// The text of the `Header`.
pub(super) fn text(recipe: &Recipe, grids: &Grids, levels: &[Vec<Grid>]) -> String {
    let mut text = format!("HyperCLaw-V1.1\n{}\n", recipe.output.fields.len());
    let numbers = 0..levels.len() as u32;
    let domain = grids.domain();
    // Writing to a string cannot fail.
    let mut line = |line: String| {
        let _ = writeln!(text, "{line}");
    };
    recipe.output.fields.iter().for_each(|field| line(component(field).to_owned()));
    line(format!("3\n{TIME}\n{}", levels.len().saturating_sub(1)));
    line(list(domain.left()));
    line(list(domain.right()));
    line(list(numbers.clone().skip(1).map(|level| grids.factor(level - 1))));
    let extent = |level: u32| {
        let cells = domain.root_cells().map(|n| i128::from(n) << grids.octree(level));
        printed(&IndexBox { lo: [0; 3], hi: cells })
    };
    line(list(numbers.clone().map(extent)));
    line(list(numbers.clone().map(|_| 0)));
    for level in numbers {
        line(list(domain.cell_width(grids.octree(level).cast_signed()).to_array()));
    }
    line("0\n0".to_owned());
    for (level, list) in levels.iter().enumerate() {
        line(format!("{level} {} {TIME}\n0", list.len()));
        list.iter().for_each(|grid| line(edges(grids, grid)));
        line(format!("Level_{level}/Cell"));
    }
    text
}

/// A grid's edges, a line for each axis.
fn edges(grids: &Grids, grid: &Grid) -> String {
    let octree = grids.octree(grid.level);
    let edge = |axis, index| cell_edge(grids.domain(), octree, axis, index);
    let axis = |a: usize| format!("{} {}", edge(a, grid.cells.lo[a]), edge(a, grid.cells.hi[a]));
    [0, 1, 2].map(axis).join("\n")
}

/// Values with a blank after each, as AMReX prints lists.
fn list<T: std::fmt::Display>(values: impl IntoIterator<Item = T>) -> String {
    values.into_iter().map(|value| format!("{value} ")).collect()
}
