//! One file.

use std::io::{BufWriter, Write};
use std::path::Path;

use super::TIME;
use crate::synth::edges::{cell_edge, exponential_6};
use crate::synth::grids::{Grid, Grids};
use crate::{Error, Result};

/// A variable: numbers or vectors.
pub(super) struct Variable {
    /// Athena's name.
    pub(super) name: &'static str,
    /// Which of the fields is its first part.
    pub(super) first: usize,
    /// Its parts: 1 or 3.
    pub(super) parts: usize,
}

/// Writes a grid, domain `domain` of its level, with the values of the variables' parts; the
/// file's size.
pub(super) fn write(
    path: &Path,
    grids: &Grids,
    grid: &Grid,
    domain: usize,
    variables: &[Variable],
    values: &[Vec<f64>],
) -> Result<u64> {
    let failed = |e| Error::io(path, "cannot write", e);
    let mut file = BufWriter::new(std::fs::File::create(path).map_err(failed)?);
    let mut bytes = header(grids, grid, domain).into_bytes();
    for (number, variable) in variables.iter().enumerate() {
        let gap = if number == 0 { "" } else { "\n" };
        let title = match variable.parts {
            1 => format!("{gap}SCALARS {} float\nLOOKUP_TABLE default\n", variable.name),
            _ => format!("{gap}VECTORS {} float\n", variable.name),
        };
        bytes.extend(title.into_bytes());
        let parts = &values[variable.first..variable.first + variable.parts];
        for cell in 0..parts.first().map_or(0, Vec::len) {
            bytes.extend(parts.iter().flat_map(|part| (part[cell] as f32).to_be_bytes()));
        }
    }
    file.write_all(&bytes).and_then(|()| file.flush()).map_err(failed)?;
    Ok(bytes.len() as u64)
}

fn header(grids: &Grids, grid: &Grid, domain: usize) -> String {
    let octree = grids.octree(grid.level);
    let origin = [0, 1, 2].map(|a| cell_edge(grids.domain(), octree, a, grid.cells.lo[a]));
    let spacing = grids.domain().cell_width(octree.cast_signed()).to_array();
    let [nx, ny, nz] = grid.cells.size();
    let list = |values: [f64; 3]| values.map(exponential_6).join(" ");
    format!(
        "# vtk DataFile Version 2.0\n\
         PRIMITIVE vars at time= {}, level= {}, domain= {domain}\n\
         BINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS {} {} {}\nORIGIN {} \nSPACING {} \n\
         CELL_DATA {} \n",
        exponential_6(TIME),
        grid.level,
        nx + 1,
        ny + 1,
        nz + 1,
        list(origin),
        list(spacing),
        nx * ny * nz
    )
}
