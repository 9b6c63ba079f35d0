//! The blocks of a brick's payload, each filled from the next coarser one, and how far interpolants of
//! neighbours among them are apart.

use super::lattice::coarse_tap;
use super::scale::Scale;
use crate::cache::{Block, RawBrick, state, visit_outside};

/// A brick's own block and its ancestors', nearest first, as far as they are looked at.
#[derive(Debug, Default)]
pub(super) struct Chain {
    links: Vec<Link>,
    count: usize,
}

/// One block, and how it is seen under a scale.
#[derive(Debug, Default)]
struct Link {
    /// With something in the place of cells outside the domain.
    block: Block,
    mapped: Vec<f64>,
    /// Cells that do not exist.
    holes: Vec<u32>,
    /// Cells in which what is drawn fades on to the next coarser level.
    fading: Vec<u32>,
}

impl Chain {
    /// Begins with a brick's own block and its parent's.
    pub(super) fn begin(&mut self, raw: &RawBrick) {
        self.count = 0;
        raw.blocks.iter().take(2).for_each(|block| self.take(block));
    }

    fn take(&mut self, block: &Block) {
        if self.count == self.links.len() {
            self.links.push(Link::default());
        }
        self.links[self.count].take(block);
        self.count += 1;
    }

    /// Whether all cells of both exist.
    pub(super) fn is_complete(&self) -> bool {
        self.links[..self.count].iter().all(|link| link.holes.is_empty())
    }

    /// Leaves out holes of a brick's own block, by their places in it, that nothing draws on.
    pub(super) fn keep_holes(&mut self, draws_on: impl Fn(usize) -> bool) {
        self.links[0].holes.retain(|&hole| draws_on(hole as usize));
    }

    /// A brick's own block and its parent's.
    pub(super) fn pair(&self) -> [&Block; 2] {
        [&self.links[0].block, &self.links[1].block]
    }

    /// Whether cells of all blocks are halves of those of the next: blocks of a single cell, and
    /// ghosts, do not say which half of the next one it is.
    pub(super) fn reaches_up(raw: &RawBrick) -> bool {
        let own_cells = raw.blocks.first().map_or(0, |block| block.side.saturating_sub(2));
        raw.blocks.len() <= 1 + own_cells.checked_ilog2().unwrap_or(0) as usize
    }

    /// What is drawn at the parent's level fades on around `cell` of the brick.
    pub(super) fn fades(&mut self, cell: [usize; 3]) {
        self.links[1].fade(cell.map(|c| c / 2 + 1));
    }

    /// All cells beside holes of the parent's level are known: goes on with those of coarser ones.
    pub(super) fn end(&mut self, raw: &RawBrick) {
        while let Some(block) = raw.blocks.get(self.count) {
            let from = self.count - 1;
            if self.links[from].fading.is_empty() {
                break;
            }
            self.take(block);
            let (finer, coarser) = self.links.split_at_mut(self.count - 1);
            for &cell in &finer[from].fading {
                let above = cell_of(finer[from].block.side, cell).map(|c| c.div_ceil(2));
                if coarser[0].has_holes_around(above) {
                    coarser[0].fade(above);
                }
            }
        }
    }

    /// Maps all values by `scale` and fills holes, coarsest first.
    pub(super) fn map(&mut self, scale: Scale) {
        for n in (0..self.count).rev() {
            let (finer, coarser) = self.links.split_at_mut(n + 1);
            let link = &mut finer[n];
            scale.map(&link.block.values, &mut link.mapped);
            let Some(above) = coarser.first().filter(|_| n + 1 < self.count) else { continue };
            for &hole in &link.holes {
                link.mapped[hole as usize] = above.at_centre(cell_of(link.block.side, hole));
            }
        }
    }

    /// Values of a brick's own block and of its parent's as [`Self::map`] has left them.
    pub(super) fn mapped(&self) -> [&[f64]; 2] {
        [&self.links[0].mapped, &self.links[1].mapped]
    }

    /// How far what is drawn at the parent's level may be from T_{l−1} where it fades on.
    pub(super) fn beyond(&self) -> f64 {
        let pairs = self.links[..self.count].windows(2).skip(1);
        let most = pairs.map(|pair| {
            let cells = pair[0].fading.iter().map(|&cell| pair[0].difference(&pair[1], cell));
            cells.fold(0.0, f64::max)
        });
        most.sum()
    }
}

/// A cell of a block with `side` cells along an edge.
fn cell_of(side: usize, at: u32) -> [usize; 3] {
    let at = at as usize;
    [at % side, at / side % side, at / side / side]
}

/// Along one axis the two cells of a finer block that a point is between, counted in half cells from
/// the block's first centre.
fn fine_tap(h: usize) -> (usize, [f64; 2]) {
    if h.is_multiple_of(2) { (h / 2, [1.0, 0.0]) } else { (h / 2, [0.5, 0.5]) }
}

impl Link {
    fn take(&mut self, block: &Block) {
        self.block.side = block.side;
        self.block.values.clone_from(&block.values);
        self.block.states.clone_from(&block.states);
        let own = &mut self.block;
        visit_outside(block.side, &block.states, |at, nearest| {
            own.values[at] = block.values[nearest];
            own.states[at] = block.states[nearest];
        });
        self.holes.clear();
        self.fading.clear();
        // Most blocks have none, which is faster to say of all at once.
        if own.states.iter().fold(state::EXISTS, |all, bits| all & bits) == 0 {
            let cells = own.states.iter().enumerate();
            let holes = cells.filter(|(_, bits)| **bits & state::EXISTS == 0);
            self.holes.extend(holes.map(|(at, _)| at as u32));
        }
    }

    /// Notes a cell that fades; neighbours come one after another.
    fn fade(&mut self, [x, y, z]: [usize; 3]) {
        let at = self.block.at(x, y, z) as u32;
        if self.fading.last() != Some(&at) {
            self.fading.push(at);
        }
    }

    fn has_holes_around(&self, cell: [usize; 3]) -> bool {
        (0..27_usize).any(|n| {
            let [x, y, z] = [n % 3, n / 3 % 3, n / 9];
            let at = self.block.at(cell[0] + x - 1, cell[1] + y - 1, cell[2] + z - 1);
            self.block.states[at] & state::EXISTS == 0
        })
    }

    /// The interpolant between mapped values at the centre of `cell` of the next finer block: along each
    /// axis ¾ of its parent's and ¼ of the next one's on its side.
    fn at_centre(&self, cell: [usize; 3]) -> f64 {
        let [x, y, z] = cell.map(|c| {
            let parent = c.div_ceil(2);
            [(parent, 0.75), (if c % 2 == 0 { parent + 1 } else { parent - 1 }, 0.25)]
        });
        let row = |(y, v): (usize, f64), (z, w): (usize, f64)| {
            let values = &self.mapped[self.block.at(0, y, z)..];
            v * w * (x[0].1 * values[x[0].0] + x[1].1 * values[x[1].0])
        };
        row(y[0], z[0]) + row(y[1], z[0]) + row(y[0], z[1]) + row(y[1], z[1])
    }

    /// Largest difference to the next coarser block's interpolant in a cell.
    fn difference(&self, coarser: &Self, cell: u32) -> f64 {
        let cell = cell_of(self.block.side, cell);
        let points = (0..27_usize).map(|n| {
            let halves = [n % 3, n / 3 % 3, n / 9];
            let place: [usize; 3] = std::array::from_fn(|a| 2 * cell[a] + halves[a] - 1);
            let own = self.interpolate(place.map(fine_tap));
            (own - coarser.interpolate(place.map(above))).abs()
        });
        points.fold(0.0, f64::max)
    }

    /// The mean of the eight mapped values at `taps`.
    fn interpolate(&self, taps: [(usize, [f64; 2]); 3]) -> f64 {
        let mut sum = 0.0;
        for corner in 0..8_usize {
            let steps: [usize; 3] = std::array::from_fn(|a| corner >> a & 1);
            let weight: f64 = (0..3).map(|a| taps[a].1[steps[a]]).product();
            if weight != 0.0 {
                let [x, y, z] = std::array::from_fn(|a| taps[a].0 + steps[a]);
                sum += weight * self.mapped[self.block.at(x, y, z)];
            }
        }
        sum
    }
}

/// Along one axis the two cells of the next coarser block that a point is between, which is counted in
/// half cells from the finer block's first centre: that lies a quarter behind the coarser one's.
fn above(h: usize) -> (usize, [f64; 2]) {
    // From the lower face of the coarser block's first cell, which is where a finer cell begins.
    let (first, weights) = coarse_tap(h + 3);
    (first - 1, weights)
}
