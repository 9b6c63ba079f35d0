//! Data, scenes, trees and exact light for tests.

pub(super) mod data;
pub(super) mod exact_light;
pub(super) mod fixed;
pub(super) mod scene;
pub(super) mod tree;
