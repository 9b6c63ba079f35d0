//! Rays through bricks, one by one in f64 and many at once in packets, and the accounts they keep.

pub(super) mod absorb;
mod beside;
mod blend;
mod brick_account;
#[cfg(test)]
mod brick_account_tests;
mod cell;
#[cfg(test)]
mod cell_packet_tests;
mod linear;
pub(super) mod packet;
#[cfg(test)]
pub(super) mod packet_tests;
pub(super) mod packets;
pub(super) mod ray;
pub(super) mod ray_state;
#[cfg(test)]
pub(super) mod ray_tests;
#[cfg(test)]
mod stress_tests;
mod stretch;
