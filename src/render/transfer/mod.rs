//! From values to light: the transfer function in pieces, as a table, and over ranges of values; and
//! how far values may be off.

pub(super) mod change;
pub(super) mod distance;
pub(super) mod piece;
pub(super) mod pieces;
pub(super) mod rounded;
mod run_tree;
pub(super) mod shading;
pub(super) mod span;
pub(super) mod storage;
pub(super) mod table;
