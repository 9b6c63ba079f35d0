//! What a picture takes: which bricks are drawn and in which order, how many rays, within which error.

pub(super) mod census;
pub mod cut;
pub(super) mod effort;
pub(super) mod goal;
mod octants;
pub(super) mod tree_walk;
pub(super) mod turns;
pub(super) mod walk_context;
