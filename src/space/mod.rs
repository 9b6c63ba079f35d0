//! Exact positions, levels and boxes. Floats appear only as differences of exact positions.

mod boxes;
mod decimal;
mod domain;
mod levels;
mod twofold;

pub use boxes::IndexBox;
pub use decimal::Decimal;
pub use domain::{Domain, MAX_ROOT_CELLS, Position};
pub use levels::{Levels, cells_at};
pub(crate) use twofold::Twofold;

/// Names of the axes.
pub(crate) const AXES: [&str; 3] = ["x", "y", "z"];

/// Fraction bits of a [`Position`]: one unit is 2⁻⁹⁶ of a root cell's width.
pub const FRACTION_BITS: u32 = 96;

/// The deepest octree level (factor-2 steps below the root grid). [`FRACTION_BITS`] leaves 36
/// bits below its cells.
pub const MAX_OCTREE_LEVEL: u32 = 60;
