//! Tiles of a picture: rays that walk the tree together, and which rays pixels need.

mod pixel;
pub(super) mod refine;
pub(super) mod tile;
mod unevenness;
mod waiting;
