//! What rays may be off by: what bricks say of it, and the account that each ray keeps.

pub(super) mod crossing;
pub(super) mod grade;
pub(super) mod ledger;
#[cfg(test)]
mod ledger_tests;
mod ranges;
pub(super) mod ray_error;
pub(super) mod relief;
pub(super) mod steepness;
pub(super) mod storage;
pub(super) mod touch;
mod windows;
