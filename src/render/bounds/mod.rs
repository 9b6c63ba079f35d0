//! What rays may be off by: the sums of an account, and what packets may do to them.

pub(super) mod crossing;
pub(super) mod grade;
pub(super) mod ray_error;
pub(super) mod touch;
