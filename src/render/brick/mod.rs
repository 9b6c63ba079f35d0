//! Bricks as rays march through them: read, filled, mapped, surveyed, and in fewer cells than they have.

pub(super) mod blocks;
mod cell_shades;
mod fill;
mod halves;
pub mod interpolant;
#[cfg(test)]
mod interpolant_tests;
pub(super) mod kept_rates;
pub(super) mod load;
pub(super) mod margin;
#[cfg(test)]
mod margin_tests;
mod parents;
pub(super) mod passage;
mod ranges;
pub(super) mod relief;
pub mod scaled;
#[cfg(test)]
mod scaled_tests;
pub(super) mod steepness;
pub(super) mod thin;
pub(super) mod walk;
mod windows;
