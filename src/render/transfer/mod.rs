//! From values to light: the transfer function in pieces, as a table, and over ranges of values.

pub(super) mod piece;
pub(super) mod pieces;
pub(super) mod rounded;
mod run_tree;
pub(super) mod shading;
pub(super) mod span;
pub(super) mod table;
