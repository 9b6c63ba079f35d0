//! What a source's grids hold, looked up grid by grid.

// Each test program uses only a part of it.
#![allow(dead_code)]

use deepfield::source::{GridBlock, GridRecord, Source};
use deepfield::space::Position;

/// All grids.
pub(crate) fn grids(source: &dyn Source) -> Vec<GridRecord> {
    let mut grids = Vec::new();
    source
        .for_each_grid(&mut |grid| {
            grids.push(grid);
            Ok(())
        })
        .unwrap();
    grids
}

/// The grid of `grids`, which are sorted from the finest, that holds `position`, and the cell
/// there in the grid's own indices.
pub(crate) fn leaf<'g>(
    source: &dyn Source,
    grids: &'g [GridRecord],
    position: &Position,
) -> Option<(&'g GridRecord, [u32; 3])> {
    let hierarchy = source.hierarchy();
    grids.iter().find_map(|grid| {
        let octree = hierarchy.levels.octree(grid.level as usize)?;
        let cell = hierarchy.domain.cell_of(i32::try_from(octree).unwrap(), position);
        let cells = grid.cells();
        let inside = (0..3).all(|a| (cells.lo[a]..cells.hi[a]).contains(&cell[a]));
        inside.then(|| (grid, [0, 1, 2].map(|a| u32::try_from(cell[a] - grid.lo[a]).unwrap())))
    })
}

/// All values of a field in a grid, x fastest.
pub(crate) fn values(source: &dyn Source, grid: &GridRecord, field: usize) -> Vec<f64> {
    let block = GridBlock { lo: [0; 3], size: grid.size };
    let mut values = vec![0.0; block.len()];
    source.read(grid, field, block, &mut values).unwrap();
    values
}

/// Where a cell of a grid stands among its values.
pub(crate) fn offset(grid: &GridRecord, cell: [u32; 3]) -> usize {
    let [nx, ny, _] = grid.size.map(|n| n as usize);
    let [x, y, z] = cell.map(|i| i as usize);
    x + nx * (y + ny * z)
}
