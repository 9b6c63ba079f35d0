//! Rays that a tile's pixels have taken, and may take.

use super::GROUP_PIXELS;
use crate::render::camera::rays::BATCH_RAYS;
use crate::render::plan::goal::Goal;
use crate::render::tiles::waiting::FEW_PIXELS;

/// Rays marched.
#[derive(Default)]
pub(super) struct RayCount {
    /// Pixels of the tile.
    pixels: usize,
    /// Rays with accounts of what they stand for.
    for_squares: u64,
    /// Rays that stand for themselves, in areas; and those of the few pixels that are finished together
    /// in a crowd.
    alone: u64,
    alone_by_few: Vec<u64>,
}

impl RayCount {
    /// Bytes that it takes.
    pub(super) const BYTES: u64 = (BATCH_RAYS / FEW_PIXELS * size_of::<u64>()) as u64;

    /// Begins with none, for a tile of so many pixels.
    pub(super) fn clear(&mut self, pixels: usize) {
        (self.pixels, self.for_squares, self.alone) = (pixels, 0, 0);
        self.alone_by_few.clear();
        self.alone_by_few.resize(pixels.div_ceil(FEW_PIXELS), 0);
    }

    /// Adds rays with accounts of what they stand for.
    pub(super) fn add_for_squares(&mut self, rays: usize) {
        self.for_squares += rays as u64;
    }

    /// Adds rays of a pixel that stand for themselves.
    pub(super) fn add_alone(&mut self, pixel: usize, rays: u32) {
        self.alone += u64::from(rays);
        self.alone_by_few[pixel / FEW_PIXELS] += u64::from(rays);
    }

    /// Rays that stand for squares, beside the first of each pixel.
    pub(super) fn others(&self) -> u64 {
        self.for_squares.saturating_sub(self.pixels as u64)
    }

    /// The most of them that a group of pixels and those before it may take.
    pub(super) fn most_of_group(&self, group: usize, goal: &Goal) -> u64 {
        self.of_first((group + 1) * GROUP_PIXELS, goal.rays_per_pixel.saturating_sub(1))
    }

    /// Leaves no more of them than so many for each of the first `count` pixels.
    pub(super) fn forget_beyond(&mut self, count: usize, per_pixel: u64) {
        let most = self.of_first(count, per_pixel).saturating_add(self.pixels as u64);
        self.for_squares = self.for_squares.min(most);
    }

    /// Rays that stand for themselves.
    pub(super) fn alone(&self) -> u64 {
        self.alone
    }

    /// The same of the few pixels of this number.
    pub(super) fn alone_of_few(&self, few: usize) -> u64 {
        self.alone_by_few[few]
    }

    /// So many rays for each of the first `count` pixels, in all.
    pub(super) fn of_first(&self, count: usize, per_pixel: u64) -> u64 {
        per_pixel.saturating_mul(count.min(self.pixels) as u64)
    }
}
