//! A source whose grids are made by hand.

use deepfield::Result;
use deepfield::source::{About, GridBlock, GridRecord, Hierarchy, Source, SourceField};
use deepfield::space::{Domain, Levels};

/// Grids and the value of each of their cells: one field, `density`.
pub(crate) struct MemorySource {
    about: About,
    grids: Vec<(GridRecord, Vec<f64>)>,
}

impl MemorySource {
    /// A domain with its root grid's size and the refinement factors between levels.
    pub(crate) fn new(
        left: [f64; 3],
        right: [f64; 3],
        root_cells: [u64; 3],
        factors: &[u32],
    ) -> Result<Self> {
        let density = SourceField { name: "density".into(), units: None, to_cgs: None };
        let hierarchy = Hierarchy {
            domain: Domain::new(left, right, root_cells)?,
            levels: Levels::from_factors(factors)?,
            fields: vec![density],
            density: Some(0),
            time: None,
        };
        let about = About { format: "memory", path: "memory".into(), hierarchy };
        Ok(Self { about, grids: Vec::new() })
    }

    /// Adds a grid of simulation level `level` whose cell `i` (its index at that level) holds
    /// `value(i)`.
    pub(crate) fn grid(
        mut self,
        level: u32,
        lo: [i128; 3],
        size: [u32; 3],
        value: impl Fn([i128; 3]) -> f64,
    ) -> Self {
        let number = self.grids.len() as u64;
        let record = GridRecord { id: number + 1, level, lo, size, locator: number };
        let mut values = Vec::new();
        for k in 0..i128::from(size[2]) {
            for j in 0..i128::from(size[1]) {
                values.extend(
                    (0..i128::from(size[0])).map(|i| value([lo[0] + i, lo[1] + j, lo[2] + k])),
                );
            }
        }
        self.grids.push((record, values));
        self
    }
}

impl Source for MemorySource {
    fn about(&self) -> &About {
        &self.about
    }

    fn for_each_grid(&self, visit: &mut dyn FnMut(GridRecord) -> Result<()>) -> Result<()> {
        self.grids.iter().try_for_each(|(record, _)| visit(*record))
    }

    fn read(&self, grid: &GridRecord, _: usize, block: GridBlock, out: &mut [f64]) -> Result<()> {
        let values = &self.grids[grid.locator as usize].1;
        let [nx, ny, _] = grid.size.map(|n| n as usize);
        let [x, y, z] = block.lo.map(|i| i as usize);
        let [width, height, _] = block.size.map(|n| n as usize);
        for (row, target) in out.chunks_mut(width).enumerate() {
            let start = ((z + row / height) * ny + y + row % height) * nx + x;
            target.copy_from_slice(&values[start..start + width]);
        }
        Ok(())
    }
}
