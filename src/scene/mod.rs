//! What to show: the scene file, how field values become colours, and the colour maps.
//!
//! A scene knows positions ([`crate::space`]) and nothing of data or rendering: [`Scene`] is the
//! file as parsed, [`Mapping`] takes field values to the transfer function's `x` in [0, 1], and
//! [`TransferFunction`] takes `x` to absorption and emission.

mod camera;
mod colormap;
mod entry;
mod file;
mod mapping;
mod piecewise;
mod render;
mod scale;
mod segments;
mod srgb;
mod transfer;
mod volume;

#[cfg(test)]
mod tests;

pub use camera::{CameraSettings, Projection};
pub use colormap::{ColorMap, color_map_names};
pub use file::{ImageSettings, MAX_SCENE_BYTES, Scene};
pub use mapping::{FieldExtrema, LARGEST_UNCLAMPED, Mapping, Rounding};
pub use piecewise::{LARGEST_TABLE_VALUE, MAX_TABLE_POINTS, PiecewiseLinear};
pub use render::{Interpolation, MAX_SAMPLES_PER_AXIS, RenderSettings, Samples, Tolerance};
pub use scale::Scale;
pub use srgb::{linear_to_srgb, srgb_to_linear};
pub use transfer::TransferFunction;
pub use volume::{ColorTable, Units, VolumeSettings};
