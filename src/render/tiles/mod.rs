//! Tiles of a picture: rays that walk the tree together, and which rays pixels need.

mod pixel;
pub(super) mod ray_batch;
pub(super) mod refine;
mod unevenness;
mod waiting;
