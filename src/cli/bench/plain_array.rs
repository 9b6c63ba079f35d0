//! A covering grid as a file of plain 32-bit floats: what the least loading takes.

use std::fs::File;
use std::hint::black_box;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::source::{GridBlock, Source};
use crate::{Error, Result};

/// Cells along z that are written at a time: those of one layer of bricks.
const LAYER: u32 = 16;

/// The file.
#[derive(Debug)]
pub(super) struct PlainArray {
    path: PathBuf,
    /// Least time of reading it to memory, seconds.
    pub(super) seconds: f64,
}

impl PlainArray {
    /// Writes the first field of `grid` to `path`, x fastest, and reads it once.
    ///
    /// # Errors
    /// A damaged cache, or no room for the file.
    pub(super) fn write(grid: &dyn Source, path: PathBuf) -> Result<Self> {
        write(grid, &path)?;
        let mut array = Self { path, seconds: f64::INFINITY };
        array.read()?;
        Ok(array)
    }

    /// Reads the file to memory of its own; from the page cache if that holds it.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub(super) fn read(&mut self) -> Result<()> {
        let started = Instant::now();
        let bytes = std::fs::read(&self.path)
            .map_err(|source| Error::io(&self.path, "cannot read", source))?;
        black_box(&bytes);
        self.seconds = self.seconds.min(started.elapsed().as_secs_f64());
        Ok(())
    }
}

fn write(grid: &dyn Source, path: &Path) -> Result<()> {
    let failed = |source| Error::io(path, "cannot write the grid", source);
    let mut file = BufWriter::new(File::create(path).map_err(failed)?);
    let mut values = Vec::new();
    grid.for_each_grid(&mut |record| {
        let [width, height, depth] = record.size;
        for z in (0..depth).step_by(LAYER as usize) {
            let size = [width, height, LAYER.min(depth - z)];
            let block = GridBlock { lo: [0, 0, z], size };
            values.resize(block.len(), 0.0);
            grid.read(&record, 0, block, &mut values)?;
            for value in &values {
                file.write_all(&(*value as f32).to_le_bytes()).map_err(failed)?;
            }
        }
        Ok(())
    })?;
    file.flush().map_err(failed)
}
