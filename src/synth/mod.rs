//! Synthetic AMR data sets, written from recipes in the layouts of simulation codes.
//!
//! A [`Recipe`] (TOML; `datasets_synthetic/` holds examples) gives a domain, a density model
//! ([`DensityModel`]) and rules for refinement ([`Grids`]). [`write`] writes them in the
//! layout of a simulation code, grids in batches, so memory depends on the largest grid and the
//! deepest level; layouts that list grids level by level keep their boxes as well.
//!
//! Values are the model at cell centres, from offsets that are exact at any depth. Cells under
//! finer grids hold what the recipe asks for, which may be deliberately wrong: only leaf cells
//! are the solution.

mod amrex;
mod athena;
mod batches;
mod boxes;
mod density;
mod edges;
mod enzo;
mod grids;
mod layout;
mod nested;
mod noise;
mod output;
mod recipe;
mod threshold;
mod values;

pub use density::DensityModel;
pub use grids::{Grid, Grids};
pub use layout::{Summary, write};
pub use recipe::Recipe;

#[cfg(test)]
mod tests;
