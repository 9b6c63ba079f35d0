//! The picture's rays: n×n in every pixel, counted in one grid over the whole picture.

use std::ops::Range;

use super::frame::Footprint;
use super::view::View;
use crate::scene::Samples;

/// Most rays along a tile's edge.
pub const TILE_SIDE: u32 = 64;
/// Rays per pixel and axis for `samples = "area"`: a fixed grid, until the rays are chosen from
/// a bound of the error.
const AREA_RAYS: u32 = 3;
/// Rows of tiles that are worked through together, column by column: neighbours in the picture
/// share bricks.
const STRIP_ROWS: u32 = 8;
/// Rays this much outside a footprint count as inside, in rays: far more than rounding.
const SLACK: f64 = 1e-3;

/// A half-open rectangle of rays: `lo <= ray < hi` along x and y.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RayRect {
    /// First column and row.
    pub lo: [u32; 2],
    /// One past the last column and row.
    pub hi: [u32; 2],
}

impl RayRect {
    /// What both hold.
    pub fn intersection(&self, other: &Self) -> Self {
        Self {
            lo: std::array::from_fn(|a| self.lo[a].max(other.lo[a])),
            hi: std::array::from_fn(|a| self.hi[a].min(other.hi[a])),
        }
    }

    /// Whether no ray lies inside.
    pub fn is_empty(&self) -> bool {
        self.lo[0] >= self.hi[0] || self.lo[1] >= self.hi[1]
    }

    /// The columns.
    pub fn columns(&self) -> Range<u32> {
        self.lo[0]..self.hi[0]
    }

    /// The rows.
    pub fn rows(&self) -> Range<u32> {
        self.lo[1]..self.hi[1]
    }
}

/// All rays of a picture, and their division into tiles of whole pixels.
#[derive(Debug, Clone)]
pub struct RayGrid {
    view: View,
    per_axis: u32,
    size: [u32; 2],
    /// Edge of a tile, pixels.
    tile: u32,
}

impl RayGrid {
    /// The rays that `samples` asks for.
    pub fn new(view: &View, samples: Samples) -> Self {
        let per_axis = match samples {
            Samples::Area => AREA_RAYS,
            Samples::Grid(n) => n.clamp(1, TILE_SIDE),
        };
        let size = [view.width() * per_axis, view.height() * per_axis];
        Self { view: view.clone(), per_axis, size, tile: (TILE_SIDE / per_axis).max(1) }
    }

    /// Rays per pixel and axis.
    pub fn per_axis(&self) -> u32 {
        self.per_axis
    }

    /// All rays.
    pub fn whole(&self) -> RayRect {
        RayRect { lo: [0; 2], hi: self.size }
    }

    /// P of the rays of column `x`.
    pub fn column(&self, x: u32) -> f64 {
        self.view.plane(self.pixels(x), 0.0).x
    }

    /// Q of the rays of row `y`.
    pub fn row(&self, y: u32) -> f64 {
        self.view.plane(0.0, self.pixels(y)).y
    }

    /// Where ray `ray` lies along an axis, pixels: i + (a + ½)/n.
    fn pixels(&self, ray: u32) -> f64 {
        let within = f64::from(ray % self.per_axis) + 0.5;
        f64::from(ray / self.per_axis) + within / f64::from(self.per_axis)
    }

    /// The rays that may meet what has this footprint.
    pub fn seen(&self, footprint: &Footprint) -> RayRect {
        let origin = self.view.plane(0.0, 0.0);
        let step = (self.view.plane(1.0, 1.0) - origin) / f64::from(self.per_axis);
        // Rows run against Q.
        let low = [footprint.plane_lo.x, footprint.plane_hi.y];
        let high = [footprint.plane_hi.x, footprint.plane_lo.y];
        let ray = |plane: f64, a: usize| (plane - origin[a]) / step[a] - 0.5;
        // `max` and `min` pass over NaN, and the casts saturate: what cannot be bounded is all.
        RayRect {
            lo: std::array::from_fn(|a| (ray(low[a], a) - SLACK).ceil().max(0.0) as u32),
            hi: std::array::from_fn(|a| {
                let last = (ray(high[a], a) + SLACK).floor();
                (last + 1.0).min(f64::from(self.size[a])) as u32
            }),
        }
    }

    /// Number of tiles.
    pub fn tiles(&self) -> u64 {
        let [columns, rows] = self.tile_counts();
        u64::from(columns) * u64::from(rows)
    }

    /// The rays of tile `index`.
    pub fn tile(&self, index: u64) -> RayRect {
        let [columns, rows] = self.tile_counts().map(u64::from);
        let strip = index / (columns * u64::from(STRIP_ROWS));
        let first_row = strip * u64::from(STRIP_ROWS);
        let strip_rows = rows.saturating_sub(first_row).clamp(1, u64::from(STRIP_ROWS));
        let within = index - first_row * columns;
        let at = [within / strip_rows, first_row + within % strip_rows];
        let rays = self.tile * self.per_axis;
        let lo = at.map(|tile| u32::try_from(tile).unwrap_or(u32::MAX).saturating_mul(rays));
        let hi = std::array::from_fn(|a| lo[a].saturating_add(rays).min(self.size[a]));
        RayRect { lo, hi }
    }

    fn tile_counts(&self) -> [u32; 2] {
        [self.view.width().div_ceil(self.tile), self.view.height().div_ceil(self.tile)]
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;
    use crate::render::test_scene::{scene, view};

    #[test]
    fn tiles_cover_every_ray_once() {
        for (samples, width, height) in
            [("1", 200, 700), ("3", 65, 22), ("64", 5, 9), ("40", 3, 2), ("\"area\"", 130, 1)]
        {
            let scene = scene(&format!("samples = {samples}"), width, height);
            let grid = RayGrid::new(&view(&scene), scene.render.samples);
            let whole = grid.whole();
            let mut seen = vec![0u8; (whole.hi[0] * whole.hi[1]) as usize];
            for tile in (0..grid.tiles()).map(|index| grid.tile(index)) {
                assert!(!tile.is_empty() && tile.columns().len() <= 64 && tile.rows().len() <= 64);
                assert!(tile.lo.iter().all(|first| first % grid.per_axis() == 0));
                for (x, y) in tile.columns().flat_map(|x| tile.rows().map(move |y| (x, y))) {
                    seen[(y * whole.hi[0] + x) as usize] += 1;
                }
            }
            assert!(seen.iter().all(|&count| count == 1), "{samples}");
        }
    }

    #[test]
    fn a_footprint_holds_the_rays_between_its_edges() {
        let scene = scene("samples = 2", 30, 20);
        let grid = RayGrid::new(&view(&scene), scene.render.samples);
        let between = |x: [u32; 2], y: [u32; 2], nudge: f64| {
            let step = DVec2::new(grid.column(1) - grid.column(0), grid.row(0) - grid.row(1));
            grid.seen(&Footprint {
                plane_lo: DVec2::new(grid.column(x[0]), grid.row(y[1])) - step * nudge,
                plane_hi: DVec2::new(grid.column(x[1]), grid.row(y[0])) + step * nudge,
                depth_lo: 0.0,
                depth_hi: 1.0,
            })
        };
        let expected = RayRect { lo: [3, 7], hi: [18, 31] };
        for nudge in [0.0, 0.9, -0.0005] {
            assert_eq!(between([3, 17], [7, 30], nudge), expected);
        }
        assert_eq!(between([3, 17], [7, 30], -0.1), RayRect { lo: [4, 8], hi: [17, 30] });
        assert!(between([5, 5], [5, 5], -0.1).is_empty());
        assert_eq!(between([3, 17], [7, 30], f64::NAN), grid.whole());
        assert_eq!(between([3, 17], [7, 30], 1e300), grid.whole());
    }
}
