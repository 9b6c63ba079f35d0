//! A tile: the rays that walk the tree together, and what they have gathered.

use glam::DVec2;

use super::interpolant::DrawnNeighbours;
use super::march::march;
use super::ray_state::{Accuracy, RayState};
use super::rays::{RayGrid, RayRect, TILE_SIDE};
use super::scaled::ScaledBrick;
use super::transfer_pieces::TransferPieces;
use super::tree_walk::Step;

const SIDE: usize = TILE_SIDE as usize;

/// What the march of all tiles needs.
#[derive(Debug)]
pub struct Light {
    /// The transfer function.
    pub pieces: TransferPieces,
    /// How exact the march is.
    pub accuracy: Accuracy,
}

/// Up to 64×64 rays. The memory is reused from tile to tile.
#[derive(Debug)]
pub struct Tile {
    rect: RayRect,
    columns: Vec<f64>,
    rows: Vec<f64>,
    states: Vec<RayState>,
    /// A row's rays that need more: bit = column.
    alive: [u64; SIDE],
    pixels: Vec<[f32; 4]>,
}

impl Tile {
    /// Most bytes that a tile takes.
    pub const BYTES: u64 =
        (SIDE * SIDE * (size_of::<RayState>() + size_of::<[f32; 4]>()) + 4 * SIDE * 8) as u64;

    /// A tile without rays.
    pub fn new() -> Self {
        Self {
            rect: RayRect { lo: [0; 2], hi: [0; 2] },
            columns: Vec::with_capacity(SIDE),
            rows: Vec::with_capacity(SIDE),
            states: Vec::with_capacity(SIDE * SIDE),
            alive: [0; SIDE],
            pixels: Vec::with_capacity(SIDE * SIDE),
        }
    }

    /// Sets the rays of `rect` off: at most 64 along each axis.
    pub fn start(&mut self, grid: &RayGrid, rect: RayRect) {
        self.rect = rect;
        self.columns.clear();
        self.columns.extend(rect.columns().map(|x| grid.column(x)));
        self.rows.clear();
        self.rows.extend(rect.rows().map(|y| grid.row(y)));
        self.states.clear();
        self.states.resize(self.columns.len() * self.rows.len(), RayState::default());
        self.alive = [0; SIDE];
        self.alive[..self.rows.len()].fill(bits(0, self.columns.len()));
    }

    /// Whether any ray of `rect`, which lies within the tile, needs more.
    pub fn needs(&self, rect: &RayRect) -> bool {
        let mask = self.mask(rect);
        self.row_range(rect).any(|row| self.alive[row] & mask != 0)
    }

    /// Marches the rays of a step through its brick. Returns the number of samples.
    pub fn draw(
        &mut self,
        step: &Step,
        brick: &ScaledBrick,
        drawn: DrawnNeighbours,
        light: &Light,
    ) -> u64 {
        let mask = self.mask(&step.rays);
        let brightest = light.pieces.largest_emission() * light.accuracy.longest_path;
        let mut samples = 0;
        for row in self.row_range(&step.rays) {
            let mut waiting = self.alive[row] & mask;
            while waiting != 0 {
                let column = waiting.trailing_zeros() as usize;
                waiting &= waiting - 1;
                let ray = step.frame.ray(DVec2::new(self.columns[column], self.rows[row]));
                let state = &mut self.states[row * self.columns.len() + column];
                let Light { pieces, accuracy } = light;
                samples += march(brick, &step.region, drawn, &ray, pieces, accuracy, state);
                if state.is_done(brightest) {
                    self.alive[row] &= !(1 << column);
                }
            }
        }
        samples
    }

    /// The tile's pixels, row by row: R, G, B, A, each the mean of its rays.
    pub fn pixels(&mut self, grid: &RayGrid) -> &[[f32; 4]] {
        let per_axis = grid.per_axis() as usize;
        let (columns, rows) = (self.columns.len() / per_axis, self.rows.len() / per_axis);
        self.pixels.clear();
        for y in 0..rows {
            for x in 0..columns {
                let mean = self.mean([x * per_axis, y * per_axis], per_axis);
                self.pixels.push(mean.map(|channel| channel as f32));
            }
        }
        &self.pixels
    }

    fn mean(&self, [x, y]: [usize; 2], per_axis: usize) -> [f64; 4] {
        let mut sum = [0.0; 4];
        for row in y..y + per_axis {
            let start = row * self.columns.len() + x;
            for state in &self.states[start..start + per_axis] {
                let [r, g, b] = state.radiance;
                for (sum, value) in sum.iter_mut().zip([r, g, b, state.opacity()]) {
                    *sum += value;
                }
            }
        }
        sum.map(|channel| channel / (per_axis * per_axis) as f64)
    }

    fn mask(&self, rect: &RayRect) -> u64 {
        bits((rect.lo[0] - self.rect.lo[0]) as usize, rect.columns().len())
    }

    fn row_range(&self, rect: &RayRect) -> std::ops::Range<usize> {
        let first = (rect.lo[1] - self.rect.lo[1]) as usize;
        first..first + rect.rows().len()
    }
}

impl Default for Tile {
    fn default() -> Self {
        Self::new()
    }
}

/// `count` bits from bit `first` on; at most 64 in all.
fn bits(first: usize, count: usize) -> u64 {
    if count == 0 { 0 } else { (u64::MAX >> (SIDE - count)) << first }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::test_scene::{scene, view};

    fn rect(x: [u32; 2], y: [u32; 2]) -> RayRect {
        RayRect { lo: [x[0], y[0]], hi: [x[1], y[1]] }
    }

    #[test]
    fn rays_are_needed_until_they_are_done() {
        let scene = scene("samples = 1", 130, 70);
        let grid = RayGrid::new(&view(&scene), scene.render.samples);
        let mut tile = Tile::new();
        tile.start(&grid, rect([64, 128], [64, 70]));
        assert!(tile.needs(&rect([64, 65], [64, 65])) && tile.needs(&rect([127, 128], [69, 70])));
        tile.alive[2] = 1 << 63;
        assert!(tile.needs(&rect([100, 128], [66, 67])));
        assert!(!tile.needs(&rect([64, 127], [66, 67])));
        assert!(tile.needs(&rect([64, 127], [65, 67])));
        tile.start(&grid, rect([128, 130], [64, 70]));
        assert_eq!(tile.alive[..7], [3, 3, 3, 3, 3, 3, 0]);
    }

    #[test]
    fn a_pixel_is_the_mean_of_its_rays() {
        let scene = scene("samples = 2", 4, 3);
        let grid = RayGrid::new(&view(&scene), scene.render.samples);
        let mut tile = Tile::new();
        tile.start(&grid, grid.whole());
        for (n, state) in tile.states.iter_mut().enumerate() {
            state.radiance = [n as f64, 1.0, 0.0];
            state.transmittance = if n == 11 { 0.0 } else { 1.0 };
        }
        let pixels = tile.pixels(&grid);
        assert_eq!(pixels.len(), 12);
        // Pixel (1, 0): rays 2, 3 of rows 0 and 1, 8 rays a row.
        assert_eq!(pixels[1], [6.5, 1.0, 0.0, 0.25]);
        assert_eq!(pixels[11], [(38.0 + 39.0 + 46.0 + 47.0) / 4.0, 1.0, 0.0, 0.0]);
    }
}
