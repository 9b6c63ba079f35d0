//! What rays may be off by: the sums of an account, and what packets may do to them.

mod causes;
pub(super) mod crossing;
pub(super) mod grade;
pub(super) mod proxy_error;
pub(super) mod ray_error;
pub(super) mod shares;
pub(super) mod sums;
pub(super) mod touch;
