//! `.cpuNNNN` files: the grids' values.

use hdf5_pure::{FileBuilder, GroupBuilder, LibVer};
use rayon::prelude::*;

use super::{data_file, particles};
use crate::Result;
use crate::space::AXES;
use crate::synth::grids::{Grid, Grids};
use crate::synth::hdf5::{save, stored_type};
use crate::synth::noise::hash;
use crate::synth::output::OutputFolder;
use crate::synth::recipe::Recipe;
use crate::synth::values::grid_values;

/// Collects grids until a file is full, then evaluates and writes them.
pub(super) struct DataFiles<'a> {
    recipe: &'a Recipe,
    grids: &'a Grids,
    folder: &'a OutputFolder,
    batch: Vec<Grid>,
    batch_bytes: u64,
    file: u32,
    cells_written: u64,
    bytes_written: u64,
}

impl<'a> DataFiles<'a> {
    /// No files yet.
    pub(super) fn new(recipe: &'a Recipe, grids: &'a Grids, folder: &'a OutputFolder) -> Self {
        Self {
            recipe,
            grids,
            folder,
            batch: Vec::new(),
            batch_bytes: 0,
            file: 0,
            cells_written: 0,
            bytes_written: 0,
        }
    }

    /// Adds a grid; the number of the file that holds it.
    pub(super) fn add(&mut self, grid: Grid) -> Result<u32> {
        let output = &self.recipe.output;
        let bytes = grid.count() * output.fields.len() as u64 * output.precision.bytes();
        let full = (output.file_mib * 1024.0 * 1024.0) as u64;
        if !self.batch.is_empty() && self.batch_bytes + bytes > full {
            self.write_batch()?;
            self.file += 1;
        }
        self.batch.push(grid);
        self.batch_bytes += bytes;
        Ok(self.file)
    }

    /// Cells in the files written so far.
    pub(super) fn cells_written(&self) -> u64 {
        self.cells_written
    }

    /// Writes what is left; the size of all files.
    pub(super) fn finish(mut self) -> Result<u64> {
        self.write_batch()?;
        Ok(self.bytes_written)
    }

    fn write_batch(&mut self) -> Result<()> {
        let evaluated: Vec<Vec<(usize, Vec<u8>)>> =
            self.batch.par_iter().map(|grid| self.evaluated(grid)).collect();
        let mut builder = FileBuilder::new();
        builder.with_libver_bounds(LibVer::Earliest, LibVer::V18);
        for (grid, fields) in self.batch.iter().zip(evaluated) {
            let mut group = builder.create_group(&format!("Grid{:08}", grid.id));
            for (field, bytes) in fields {
                self.add_field(&mut group, grid, field, bytes);
            }
            add_particles(&mut group, self.grids, grid, particles(self.recipe, grid));
            builder.add_group(group.finish());
        }
        let path = self.folder.file(&data_file(&self.recipe.name, self.file));
        self.bytes_written += save(builder, &path)?;
        self.cells_written += self.batch.iter().map(Grid::count).sum::<u64>();
        self.batch.clear();
        self.batch_bytes = 0;
        Ok(())
    }

    /// A grid's fields in the order in which they are written, as stored bytes.
    fn evaluated(&self, grid: &Grid) -> Vec<(usize, Vec<u8>)> {
        let output = &self.recipe.output;
        let values = grid_values(self.grids, grid, &output.fields, output.covered);
        let stored = values.iter().map(|field| output.precision.stored(field));
        let mut fields: Vec<_> = stored.enumerate().collect();
        if output.shuffle_fields {
            let turns = hash(&[grid.id]) as usize % fields.len().max(1);
            fields.rotate_left(turns);
        }
        fields
    }

    fn add_field(&self, group: &mut GroupBuilder, grid: &Grid, field: usize, bytes: Vec<u8>) {
        let datatype = stored_type(self.recipe.output.precision);
        let [x, y, z] = grid.cells.size().map(|n| n as u64);
        group
            .create_dataset(&self.recipe.output.fields[field])
            .with_raw_data(datatype, bytes, grid.count())
            .with_shape(&[z, y, x]);
    }
}

/// Particles at made-up places of a grid, one dataset a property as Enzo stores them.
fn add_particles(group: &mut GroupBuilder, grids: &Grids, grid: &Grid, count: u32) {
    if count == 0 {
        return;
    }
    let (left, right) = super::edges(grids, grid);
    let numbers: Vec<i64> = (0..count).map(|n| (grid.id as i64) << 32 | i64::from(n)).collect();
    group.create_dataset("particle_index").with_i64_data(&numbers);
    group.create_dataset("particle_mass").with_f64_data(&vec![1.0; count as usize]);
    group.create_dataset("particle_type").with_i8_data(&vec![1; count as usize]);
    for (axis, name) in AXES.into_iter().enumerate() {
        let place = |n: &i64| {
            let fraction = hash(&[*n as u64, axis as u64]) as f64 * (-64f64).exp2();
            left[axis] + (right[axis] - left[axis]) * fraction
        };
        let places: Vec<f64> = numbers.iter().map(place).collect();
        group.create_dataset(&format!("particle_position_{name}")).with_f64_data(&places);
        let rest = vec![0.0; count as usize];
        group.create_dataset(&format!("particle_velocity_{name}")).with_f64_data(&rest);
    }
}
