//! Synthetic AMR data sets, written from recipes in the layouts of simulation codes.
//!
//! A [`Recipe`] (TOML; `datasets_synthetic/` holds examples) gives a domain, a density model
//! ([`DensityModel`]) and rules for refinement ([`Grids`]). [`write`] walks the grids in the
//! order of Enzo's own hierarchy files and writes them in batches, so memory depends on the
//! largest grid and the deepest level, not on the size of the data set.
//!
//! Values are the model at cell centres, from offsets that are exact at any depth. Cells under
//! finer grids hold what the recipe asks for, which may be deliberately wrong: only leaf cells
//! are the solution.

mod boxes;
mod density;
mod edges;
mod enzo;
mod grids;
mod nested;
mod noise;
mod output;
mod recipe;
mod threshold;
mod values;

pub use density::DensityModel;
pub use enzo::{Summary, write};
pub use grids::{Grid, Grids};
pub use recipe::Recipe;

#[cfg(test)]
mod tests;
