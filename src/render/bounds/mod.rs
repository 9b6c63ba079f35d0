//! What rays may be off by: what bricks say of it, and the account that each ray keeps.

pub(super) mod brick_account;
#[cfg(test)]
mod brick_account_tests;
pub(super) mod crossing;
pub(super) mod grade;
mod ranges;
pub(super) mod ray_error;
pub(super) mod relief;
pub(super) mod steepness;
pub(super) mod storage;
pub(super) mod touch;
mod windows;
