//! (being written)

mod absorb;
mod axis;
mod blend;
mod fill;
pub mod frame;
pub mod interpolant;
pub mod march;
mod march_cell;
mod march_linear;
mod polynomial;
pub mod ray_state;
pub mod scaled;
pub mod transfer_pieces;
pub mod view;
mod walk;

#[cfg(test)]
mod interpolant_tests;
#[cfg(test)]
mod march_tests;
#[cfg(test)]
mod scaled_tests;
#[cfg(test)]
mod test_data;
#[cfg(test)]
mod view_tests;
