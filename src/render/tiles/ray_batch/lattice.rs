//! Square lattices over the pixels of a tile.

use crate::render::camera::rays::PixelRect;

/// Corners of square blocks of pixels, from the tile's first on.
#[derive(Clone, Copy)]
pub(super) struct Lattice {
    first: [u32; 2],
    /// Edge of a block, pixels.
    pub(super) apart: u32,
    /// Number of blocks along x and y.
    count: [u32; 2],
}

impl Lattice {
    /// The lattice over `pixels`, with blocks `apart` pixels wide that are aligned to those of the
    /// whole tile.
    pub(super) fn over(tile: &PixelRect, pixels: &PixelRect, apart: u32) -> Self {
        let below = |a: usize| (pixels.lo[a] - tile.lo[a]) / apart;
        let first = std::array::from_fn(|a| tile.lo[a] + below(a) * apart);
        let count = std::array::from_fn(|a| (pixels.hi[a] - first[a]).div_ceil(apart));
        Self { first, apart, count }
    }

    /// All blocks by column and row, row by row.
    pub(super) fn blocks(&self) -> impl Iterator<Item = [u32; 2]> + use<> {
        let [columns, rows] = self.count;
        (0..rows).flat_map(move |y| (0..columns).map(move |x| [x, y]))
    }

    /// The pixels of a block.
    pub(super) fn pixels(&self, block: [u32; 2]) -> PixelRect {
        let lo = std::array::from_fn(|a| self.first[a] + block[a] * self.apart);
        PixelRect { lo, hi: lo.map(|x| x + self.apart) }
    }

    /// The numbers of the four corners of a block among all.
    pub(super) fn corners(&self, [x, y]: [u32; 2]) -> [usize; 4] {
        let side = self.count[0] as usize + 1;
        let first = y as usize * side + x as usize;
        [first, first + 1, first + side, first + side + 1]
    }

    /// The place of a corner, pixels.
    pub(super) fn place(&self, corner: usize) -> [f64; 2] {
        let side = self.count[0] as usize + 1;
        let at = [corner % side, corner / side];
        std::array::from_fn(|a| f64::from(self.first[a]) + (at[a] * self.apart as usize) as f64)
    }

    /// Number of corners.
    pub(super) fn results(&self) -> usize {
        self.count.map(|n| n as usize + 1).iter().product()
    }
}
