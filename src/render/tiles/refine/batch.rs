//! Rays that are marched together.

use std::array::from_fn;

use super::TilePixels;
use super::uncertified::ALONE_SHARE;
use crate::render::bounds::grade::Care;
use crate::render::camera::rays::{PixelGrid, Square};
use crate::render::plan::cut::Cut;
use crate::render::tiles::unevenness::Unevenness;
use crate::render::tiles::waiting::Found;

/// Rays that are marched together.
pub(crate) struct Batch {
    /// Pixel by pixel.
    pub(crate) squares: Vec<Square>,
    /// Which bricks are opened for them.
    pub(crate) cut: Cut,
    /// How they are marched, and how those have been that are marched again.
    pub(crate) care: Care,
    pub(super) before: Care,
    /// Whether they stand for their squares, not for themselves.
    pub(crate) has_area: bool,
    /// Whether they are at the tile's outer sides, only to tell of these.
    pub(super) is_border: bool,
    /// What squares that are marched again were found to be before, in order.
    pub(super) again: Vec<Found>,
    /// What the others are quarters of, likewise; neither for a tile's first rays.
    pub(super) wholes: Vec<Found>,
}

impl Batch {
    /// Says of what has been found how uneven it is: what was known of it before, or what rays of
    /// the quarters of a square tell.
    /// `tile_pixels` knows of whole pixels by their neighbours.
    pub(super) fn hand_down(
        &self,
        grid: &PixelGrid,
        tile_pixels: &TilePixels,
        outcome: &mut [Found],
    ) {
        let tolerance = tile_pixels.goal.map_or(0.0, |goal| goal.tolerance);
        for (found, before) in outcome.iter_mut().zip(&self.again) {
            found.uneven = before.uneven;
        }
        for (whole, quarters) in self.wholes.iter().zip(outcome.chunks_exact_mut(4)) {
            // Rays that are off by much themselves say nothing of others, but where many add up.
            let off = quarters.iter().chain([whole]).map(Found::own);
            let most = f64::from(whole.square.halvings).exp2() * ALONE_SHARE * tolerance;
            let tells = off.fold(0.0, f64::max) <= most;
            let values = from_fn(|n| &quarters[n].value);
            let sides = |n: usize| tile_pixels.first_rays.around(&quarters[n]);
            // Their rays lie at their centres.
            let is_aligned = grid.has_edges_along(&whole.square);
            let before = tile_pixels.known(whole);
            let each = tells
                .then(|| Unevenness::of_quarters(&whole.value, before, values, sides, is_aligned));
            for (n, quarter) in quarters.iter_mut().enumerate() {
                quarter.uneven = each.map(|each| each[n]);
            }
        }
    }
}
