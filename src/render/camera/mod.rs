//! The camera: exact positions, what bricks see of it, and the pixels and rays of a picture.

mod axis;
pub(super) mod frame;
pub(super) mod pixel_order;
pub(super) mod rays;
pub mod view;
#[cfg(test)]
mod view_tests;
