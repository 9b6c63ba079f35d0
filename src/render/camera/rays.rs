//! The picture's pixels, divided into tiles, and the squares of the picture that rays stand for.

use std::ops::Range;

use glam::DVec2;
use xxhash_rust::xxh3::xxh3_64;

use super::frame::Footprint;
use super::pixel_order::PixelOrder;
use super::view::{Aim, View};
use crate::scene::Samples;

/// Most rays that are marched together.
pub(crate) const BATCH_RAYS: usize = 4096;
/// Most pixels along a tile's edge.
pub(crate) const TILE_SIDE: u32 = 64;
/// Rows of tiles that are worked through together, column by column: neighbours in the picture
/// share bricks.
const STRIP_ROWS: u32 = 8;
/// Pixels this much outside a footprint count as inside: far more than rounding.
const SLACK: f64 = 1e-3;

/// A half-open rectangle of pixels: `lo <= pixel < hi` along x and y.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PixelRect {
    /// First column and row.
    pub lo: [u32; 2],
    /// One past the last column and row.
    pub hi: [u32; 2],
}

impl PixelRect {
    /// No pixel.
    pub(crate) const NONE: Self = Self { lo: [0; 2], hi: [0; 2] };

    /// What both hold.
    pub(crate) fn intersection(&self, other: &Self) -> Self {
        Self {
            lo: std::array::from_fn(|a| self.lo[a].max(other.lo[a])),
            hi: std::array::from_fn(|a| self.hi[a].min(other.hi[a])),
        }
    }

    /// Whether no pixel lies inside.
    pub(crate) fn is_empty(&self) -> bool {
        self.lo[0] >= self.hi[0] || self.lo[1] >= self.hi[1]
    }

    /// The columns.
    pub(crate) fn columns(&self) -> Range<u32> {
        self.lo[0]..self.hi[0]
    }

    /// The rows.
    pub(crate) fn rows(&self) -> Range<u32> {
        self.lo[1]..self.hi[1]
    }

    /// Number of pixels.
    pub(crate) fn count(&self) -> usize {
        if self.is_empty() { 0 } else { self.columns().len() * self.rows().len() }
    }

    /// Whether a place, pixels from the picture's left and upper edge, lies inside.
    pub(crate) fn holds(&self, place: [f64; 2]) -> bool {
        (0..2).all(|a| f64::from(self.lo[a]) <= place[a] && place[a] < f64::from(self.hi[a]))
    }
}

/// A square of a pixel, as large as the pixel halved `halvings` times, and the ray through its
/// centre; without area only the ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Square {
    /// The centre, pixels from the picture's left and upper edge.
    pub centre: [f64; 2],
    /// How far from it its ray is, in 2¹⁵ths of half its width.
    pub offset: [i16; 2],
    /// The pixel's number in its tile.
    pub pixel: u16,
    /// Halvings; the square is `2^-halvings` of a pixel wide.
    pub halvings: u8,
}

impl Square {
    /// The square's part of its pixel.
    pub(crate) fn weight(&self) -> f64 {
        (-2.0 * f64::from(self.halvings)).exp2()
    }

    /// Half its width, pixels.
    pub(crate) fn half(&self) -> f64 {
        // A power of two by its exponent.
        f64::from_bits((1022 - u64::from(self.halvings)) << 52)
    }

    /// Where its ray is, pixels from the picture's left and upper edge.
    pub(crate) fn place(&self) -> [f64; 2] {
        let unit = self.half() / 32_768.0;
        std::array::from_fn(|a| self.centre[a] + unit * f64::from(self.offset[a]))
    }

    /// Its four quarters, with rays at their centres.
    pub(crate) fn quarters(&self) -> [Self; 4] {
        let quarter = 0.5 * self.half();
        std::array::from_fn(|n| {
            let side = |a: usize| if n >> a & 1 == 1 { quarter } else { -quarter };
            Self {
                centre: [self.centre[0] + side(0), self.centre[1] + side(1)],
                offset: [0; 2],
                halvings: self.halvings.saturating_add(1),
                ..*self
            }
        })
    }

    /// Which of its sides are its pixel's: left, right, upper, lower.
    pub(crate) fn sides_of_pixel(&self) -> [bool; 4] {
        let half = 0.5 * (-f64::from(self.halvings)).exp2();
        std::array::from_fn(|side| {
            let (centre, first) = (self.centre[side / 2], self.centre[side / 2].floor());
            if side % 2 == 0 { centre - half == first } else { centre + half == first + 1.0 }
        })
    }

    /// Its four quarters, with rays beside their centres, by up to `reach` of a quarter's half
    /// width, which follow no pattern. Opposite quarters' are opposite: what varies linearly has
    /// the square's mean.
    pub(crate) fn scattered_quarters(&self, reach: f64) -> [Self; 4] {
        let mut quarters = self.quarters();
        if reach == 0.0 {
            return quarters;
        }
        let bytes = self.centre.map(f64::to_le_bytes);
        let hash = xxh3_64(bytes.as_flattened());
        // Four numbers of 16 bits; the lowest has no opposite.
        let number = |n: usize| f64::from((hash >> (16 * n)) as i16) + 0.5;
        for (n, quarter) in quarters.iter_mut().enumerate() {
            // The first is opposite the last, the second the third.
            let (pair, sign) = (n.min(3 - n), if n < 2 { reach } else { -reach });
            quarter.offset = [2 * pair, 2 * pair + 1].map(|k| (sign * number(k)) as i16);
        }
        quarters
    }
}

/// All pixels of a picture, divided into tiles, and the rays that begin each.
#[derive(Debug, Clone)]
pub(crate) struct PixelGrid {
    view: View,
    samples: Samples,
    /// Width and height of a tile, pixels.
    tile: [u32; 2],
    /// How wide what a ray stands for is, in pixels.
    part: f64,
}

impl PixelGrid {
    /// The pixels of `view`, with the rays that `samples` asks for.
    pub(crate) fn new(view: &View, samples: Samples) -> Self {
        let size = [view.width(), view.height()];
        let tile = match samples {
            Samples::Area => area_tile(size, 0),
            Samples::Grid(n) => four_tiles(size, TILE_SIDE / n.clamp(1, TILE_SIDE)),
        };
        Self { view: view.clone(), samples, tile, part: 1.0 }
    }

    /// The same in smaller tiles, if they are of areas and would hold many of so many bricks: the rays of
    /// areas come through a tile's bricks again and again, which are loaded once if they have room together.
    pub(crate) fn among(self, bricks: u64) -> Self {
        match self.samples {
            Samples::Area => {
                Self { tile: area_tile([self.view.width(), self.view.height()], bricks), ..self }
            }
            Samples::Grid(_) => self,
        }
    }

    /// The pixels of `view` as samples of those of a larger picture: each has the area of one that
    /// is `part` as wide. They are in few tiles, since each judges for itself.
    pub(crate) fn sparse(view: &View, part: f64) -> Self {
        let tile = four_tiles([view.width(), view.height()], TILE_SIDE);
        Self { part, tile, ..Self::new(view, Samples::Area) }
    }

    /// The camera.
    pub(crate) fn view(&self) -> &View {
        &self.view
    }

    /// Whether rays stand for squares of the picture, and not for themselves.
    pub(crate) fn has_area(&self) -> bool {
        self.samples == Samples::Area
    }

    /// Rays with which each pixel begins, per axis.
    fn per_axis(&self) -> u32 {
        match self.samples {
            Samples::Area => 1,
            Samples::Grid(n) => n.clamp(1, TILE_SIDE),
        }
    }

    /// Whether edges may run through a square, or close beside it, along rows of its quarters' centres.
    pub(crate) fn has_edges_along(&self, square: &Square) -> bool {
        let ([x, y], width) = (square.centre, 2.0 * square.half());
        self.view.has_edges_along_pixels(self.view.plane(x, y), width * self.view.pixel())
    }

    /// What a ray's radiance counts for in its pixel.
    pub(crate) fn weight(&self, square: &Square) -> f64 {
        match self.samples {
            Samples::Area => square.weight(),
            Samples::Grid(_) => f64::from(self.per_axis().pow(2)).recip(),
        }
    }

    /// All pixels.
    pub(crate) fn whole(&self) -> PixelRect {
        PixelRect { lo: [0; 2], hi: [self.view.width(), self.view.height()] }
    }

    /// (P, Q) of a place, pixels from the picture's left and upper edge.
    pub(crate) fn plane_at(&self, [x, y]: [f64; 2]) -> DVec2 {
        self.view.plane(x, y)
    }

    /// The ray of a square.
    pub(crate) fn aim(&self, square: &Square) -> Aim {
        let (place, per) = self.halves(square);
        self.view.aim_in(place, per)
    }

    /// Where a square's ray is, in halves of a pixel's part, of which so many make a pixel.
    fn halves(&self, square: &Square) -> ([f64; 2], f64) {
        match self.samples {
            Samples::Area => (square.place().map(|place| 2.0 * place), 1.0),
            Samples::Grid(_) => {
                let per = f64::from(self.per_axis());
                (square.centre.map(|place| (2.0 * per * place).round()), per)
            }
        }
    }

    /// Width and height in P and Q of what a pixel stands for.
    pub(crate) fn pixel_size(&self) -> DVec2 {
        (self.view.plane(1.0, 1.0) - self.view.plane(0.0, 0.0)).abs() * self.part
    }

    /// The rays with which the pixels of `rect` begin, pixel by pixel, in their order.
    pub(crate) fn first_squares(&self, rect: &PixelRect, squares: &mut Vec<Square>) {
        let (n, order) = (self.per_axis(), PixelOrder::of(rect));
        squares.clear();
        for number in 0..rect.count() {
            let place = order.place(number);
            let corner: [f64; 2] = std::array::from_fn(|a| f64::from(rect.lo[a] + place[a]));
            let pixel = u16::try_from(number).unwrap_or(u16::MAX);
            for ray in 0..n * n {
                let within = [ray % n, ray / n].map(|i| (f64::from(i) + 0.5) / f64::from(n));
                let centre = [corner[0] + within[0], corner[1] + within[1]];
                squares.push(Square { centre, offset: [0; 2], pixel, halvings: 0 });
            }
        }
    }

    /// The pixels that what has this footprint may be seen in.
    pub(crate) fn seen(&self, footprint: &Footprint) -> PixelRect {
        let origin = self.view.plane(0.0, 0.0);
        let step = self.view.plane(1.0, 1.0) - origin;
        // Rows run against Q.
        let low = [footprint.plane_lo.x, footprint.plane_hi.y];
        let high = [footprint.plane_hi.x, footprint.plane_lo.y];
        let pixel = |plane: f64, a: usize| (plane - origin[a]) / step[a];
        let size = self.whole().hi;
        // `max` and `min` pass over NaN, and the casts saturate: what cannot be bounded is all.
        PixelRect {
            lo: std::array::from_fn(|a| (pixel(low[a], a) - SLACK).floor().max(0.0) as u32),
            hi: std::array::from_fn(|a| {
                let last = (pixel(high[a], a) + SLACK).floor();
                (last + 1.0).min(f64::from(size[a])) as u32
            }),
        }
    }

    /// The part of a pixel that what has this footprint covers, at most.
    pub(crate) fn covered(&self, footprint: &Footprint) -> f64 {
        let size = self.pixel_size();
        let part = (footprint.plane_hi - footprint.plane_lo) / size;
        let part = part.x.min(1.0) * part.y.min(1.0);
        if part.is_nan() { 1.0 } else { part.clamp(0.0, 1.0) }
    }

    /// Number of tiles.
    pub(crate) fn tiles(&self) -> u64 {
        let [columns, rows] = self.tile_counts();
        u64::from(columns) * u64::from(rows)
    }

    /// The pixels of tile `index`.
    pub(crate) fn tile(&self, index: u64) -> PixelRect {
        let [columns, rows] = self.tile_counts().map(u64::from);
        let strip = index / (columns * u64::from(STRIP_ROWS));
        let first_row = strip * u64::from(STRIP_ROWS);
        let strip_rows = rows.saturating_sub(first_row).clamp(1, u64::from(STRIP_ROWS));
        let within = index - first_row * columns;
        let at = [within / strip_rows, first_row + within % strip_rows];
        let size = self.whole().hi;
        let [width, height] = self.tile;
        let edge =
            |tile: u64, side: u32| u32::try_from(tile).unwrap_or(u32::MAX).saturating_mul(side);
        let lo = [edge(at[0], width), edge(at[1], height)];
        let hi = std::array::from_fn(|a| lo[a].saturating_add(self.tile[a]).min(size[a]));
        PixelRect { lo, hi }
    }

    /// The last of the tiles, in their order, that have pixels of `rect`; with no more than four none is
    /// the last, as small pictures are drawn to be followed by others of the same view.
    pub(crate) fn last_tile(&self, rect: &PixelRect) -> u64 {
        if self.tiles() <= FEW_TILES {
            return u64::MAX;
        }
        let [columns, rows] = self.tile_counts().map(u64::from);
        let last = |a: usize| u64::from(rect.hi[a].saturating_sub(1) / self.tile[a]);
        let (column, row) = (last(0), last(1));
        let first_row = row / u64::from(STRIP_ROWS) * u64::from(STRIP_ROWS);
        let strip_rows = rows.saturating_sub(first_row).clamp(1, u64::from(STRIP_ROWS));
        first_row * columns + column * strip_rows + (row - first_row)
    }

    fn tile_counts(&self) -> [u32; 2] {
        let [width, height] = self.tile;
        [self.view.width().div_ceil(width), self.view.height().div_ceil(height)]
    }
}

/// Tiles of a picture that were one.
const FEW_TILES: u64 = 4;

/// Tiles that a picture of areas has at least, however small it is, and their least edge, pixels: its
/// pixels may take thousands of rays, and threads share nothing smaller than tiles. Not the number of
/// threads decides, which pictures do not depend on.
const FEWEST_TILES: u64 = 48;
const LEAST_TILE_SIDE: u32 = 16;
/// Bricks behind a tile of areas, about, if all of the data lay in the picture one beside the other. A ray
/// passes many: a tile meets some times as many. Not the memory limit decides, which pictures do not depend
/// on.
const MOST_BRICKS: u64 = 512;

/// Width and height of the tiles of a picture of areas that has so many columns and rows, of data that
/// has so many bricks. Where they are smaller than others they are alike: pixels in what would be left
/// over had few neighbours.
fn area_tile(size: [u32; 2], bricks: u64) -> [u32; 2] {
    let pixels = u64::from(size[0]) * u64::from(size[1]);
    let mut side = TILE_SIDE;
    let is_large = |side: u32| {
        let of_tile = u64::from(side).pow(2);
        pixels < FEWEST_TILES * of_tile
            || bricks.saturating_mul(of_tile) > MOST_BRICKS.saturating_mul(pixels)
    };
    while side > LEAST_TILE_SIDE && is_large(side) {
        side /= 2;
    }
    if side == TILE_SIDE {
        return [TILE_SIDE; 2];
    }
    size.map(|size| size.div_ceil(size.div_ceil(side).max(1)).max(1))
}

/// Width and height of tiles of at most `side` pixels along an edge, but of a quarter of the picture where
/// that were one tile: for as many threads.
fn four_tiles(size: [u32; 2], side: u32) -> [u32; 2] {
    if size.iter().any(|&size| size > side) {
        return [side; 2];
    }
    size.map(|size| size.div_ceil(2).max(1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::testing::scene::{scene, view};

    #[test]
    fn small_pictures_have_smaller_tiles_that_are_alike() {
        let tiles = [[9, 7], [33, 20], [64, 64], [130, 100], [320, 180], [1920, 1080]];
        let tiles = tiles.map(|size| area_tile(size, 0));
        assert_eq!(tiles, [[9, 7], [11, 10], [16, 16], [15, 15], [32, 30], [64, 64]]);
    }

    #[test]
    fn tiles_of_areas_hold_few_of_many_bricks() {
        let tiles = |bricks: u64| [[800, 450], [1920, 1080]].map(|size| area_tile(size, bricks));
        assert_eq!(tiles(10_000), [[64, 64], [64, 64]]);
        assert_eq!(tiles(100_000), [[32, 30], [64, 64]]);
        assert_eq!(tiles(400_000), [[16, 16], [32, 32]]);
        assert_eq!(tiles(u64::MAX), [[16, 16], [16, 16]]);
        let view = view(&scene("", 480, 270));
        let single = |bricks| PixelGrid::new(&view, Samples::Grid(1)).among(bricks).tiles();
        assert_eq!(single(150_000), single(0));
    }

    #[test]
    fn what_were_one_tile_is_four() {
        let sizes = [(1, 1, 1), (7, 24, 4), (24, 1, 2), (TILE_SIDE, TILE_SIDE, 4), (65, 64, 2)];
        for (width, height, tiles) in sizes {
            let view = view(&scene("", width, height));
            for grid in [PixelGrid::sparse(&view, 0.5), PixelGrid::new(&view, Samples::Grid(1))] {
                assert_eq!(grid.tiles(), tiles, "{width}x{height}");
            }
        }
    }

    #[test]
    fn tiles_cover_every_pixel_once() {
        for (samples, width, height) in
            [("1", 200, 700), ("3", 65, 22), ("64", 5, 9), ("40", 3, 2), ("\"area\"", 130, 1)]
        {
            let scene = scene(&format!("samples = {samples}"), width, height);
            let grid = PixelGrid::new(&view(&scene), scene.render.samples);
            let mut seen = vec![0u8; (width * height) as usize];
            let mut squares = Vec::new();
            for tile in (0..grid.tiles()).map(|index| grid.tile(index)) {
                grid.first_squares(&tile, &mut squares);
                assert!(!tile.is_empty() && squares.len() <= BATCH_RAYS);
                for (x, y) in tile.columns().flat_map(|x| tile.rows().map(move |y| (x, y))) {
                    seen[(y * width + x) as usize] += 1;
                }
            }
            assert!(seen.iter().all(|&count| count == 1), "{samples}");
        }
    }

    #[test]
    fn the_last_tile_of_a_rectangle_comes_after_all_others() {
        for (samples, width, height) in [("1", 200, 1300), ("64", 30, 21), ("\"area\"", 130, 1)] {
            let scene = scene(&format!("samples = {samples}"), width, height);
            let grid = PixelGrid::new(&view(&scene), scene.render.samples);
            for n in 0..500 {
                let [a, b] = [[7, 13], [29, 31]].map(|[x, y]| [(n * x) % width, (n * y) % height]);
                let rect = PixelRect {
                    lo: std::array::from_fn(|i| a[i].min(b[i])),
                    hi: std::array::from_fn(|i| a[i].max(b[i]) + 1),
                };
                let has_some = |tile: &u64| !grid.tile(*tile).intersection(&rect).is_empty();
                assert_eq!((0..grid.tiles()).rfind(has_some), Some(grid.last_tile(&rect)));
            }
        }
        let grid = PixelGrid::new(&view(&scene("samples = 1", 64, 64)), Samples::Grid(1));
        assert_eq!(grid.last_tile(&grid.tile(0)), u64::MAX);
    }

    #[test]
    fn sides_of_pixels_are_those_of_squares_at_them() {
        let whole = Square { centre: [7.5, 2.5], offset: [0; 2], pixel: 0, halvings: 0 };
        assert_eq!(whole.sides_of_pixel(), [true; 4]);
        let sides = whole.quarters().map(|quarter| quarter.sides_of_pixel());
        assert_eq!(sides[0], [true, false, true, false]);
        assert_eq!(sides[3], [false, true, false, true]);
        let within = whole.quarters()[0].quarters()[3];
        assert_eq!(within.sides_of_pixel(), [false; 4]);
        assert_eq!(whole.quarters()[1].quarters()[0].sides_of_pixel(), [false, false, true, false]);
    }

    #[test]
    fn rays_lie_where_samples_say() {
        let scene = scene("samples = 2", 30, 20);
        let grid = PixelGrid::new(&view(&scene), scene.render.samples);
        let mut squares = Vec::new();
        grid.first_squares(&PixelRect { lo: [3, 5], hi: [5, 6] }, &mut squares);
        let centres: Vec<_> = squares.iter().map(|square| square.centre).collect();
        assert_eq!(centres[..3], [[3.25, 5.25], [3.75, 5.25], [3.25, 5.75]]);
        assert_eq!((centres[4], squares[4].pixel), ([4.25, 5.25], 1));
        assert!(squares.iter().all(|square| grid.weight(square) == 0.25));
    }

    #[test]
    fn quarters_make_a_square() {
        let square = Square { centre: [2.5, 7.5], offset: [0; 2], pixel: 9, halvings: 0 };
        let mut all = square.quarters().to_vec();
        all.extend(all.clone()[1].quarters());
        all.remove(1);
        assert!((all.iter().map(Square::weight).sum::<f64>() - 1.0).abs() < 1e-15);
        let mean = all.iter().map(|s| s.centre[0] * s.weight()).sum::<f64>();
        assert_eq!(mean, 2.5);
        assert!(all.iter().all(|s| (s.centre[1] - 7.5).abs() + s.half() <= 0.5));
    }

    #[test]
    fn a_footprint_holds_the_pixels_that_it_meets() {
        let scene = scene("samples = 2", 30, 20);
        let grid = PixelGrid::new(&view(&scene), scene.render.samples);
        let between = |x: [f64; 2], y: [f64; 2]| {
            let view = grid.view();
            grid.seen(&Footprint {
                plane_lo: view.plane(x[0], y[1]),
                plane_hi: view.plane(x[1], y[0]),
                depth_lo: 0.0,
                depth_hi: 1.0,
            })
        };
        let expected = PixelRect { lo: [3, 7], hi: [18, 20] };
        assert_eq!(between([3.1, 17.9], [7.5, 19.9]), expected);
        assert_eq!(between([3.01, 17.01], [7.01, 40.0]), expected);
        assert_eq!(between([2.999, 17.9], [7.5, 19.9]).lo, [2, 7]);
        assert!(between([31.0, 32.0], [5.0, 5.1]).is_empty());
        assert_eq!(between([f64::NAN, f64::NAN], [-1e300, 1e300]), grid.whole());
    }
}
