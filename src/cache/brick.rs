//! A brick's content as the cache stores it.

use super::digits::{PARTS, rounding_errors};
use crate::{Error, Result};

/// Bits of a cell's state.
pub mod state {
    /// The level has data here, refined further or not.
    pub const EXISTS: u8 = 1;
    /// A finer level covers the cell; its value is the average of what lies beneath.
    pub const REFINED: u8 = 2;
    /// Dropped (`--drop-below`, `--region`): emits and absorbs nothing; the stored value is only
    /// what the interpolant needs beside it.
    pub const VOID: u8 = 4;
    /// Beyond the domain: no data; counts as existing beside a border.
    pub const OUTSIDE: u8 = 8;
    /// With [`EXISTS`] and [`VOID`]: the level has nothing here, in a dropped cell of a coarser one.
    /// Counts as existing, so that dropped cells of any level border like the domain's edge.
    pub const COARSER: u8 = 16;
    /// All of a cell in a coarser level's dropped one.
    pub const IN_COARSER_VOID: u8 = EXISTS | VOID | COARSER;

    /// Whether the bits can stand together.
    pub fn is_valid(bits: u8) -> bool {
        let is_special = (bits == OUTSIDE) | (bits == IN_COARSER_VOID);
        is_special | (bits < 8) & ((bits == 0) | (bits & EXISTS != 0))
    }

    /// Whether the level itself has data here.
    pub fn is_own(bits: u8) -> bool {
        bits & (EXISTS | COARSER) == EXISTS
    }

    /// Whether [`is_valid`] holds of all.
    pub fn are_valid(states: &[u8]) -> bool {
        !any(states, |bits| !is_valid(bits))
    }

    /// Whether something holds of any.
    pub fn any(states: &[u8], holds: impl Fn(u8) -> bool) -> bool {
        // Without an end at the first of which it does: a whole row of states at a time.
        states.iter().fold(false, |found, &bits| found | holds(bits))
    }
}

/// A cube of cells of one level.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Block {
    /// Cells along an edge.
    pub side: usize,
    /// Stored values, x fastest; 0 where a cell has none.
    pub values: Vec<f32>,
    /// [`state`] bits, x fastest.
    pub states: Vec<u8>,
}

impl Block {
    /// Index of cell (x, y, z) counted from the block's own lower corner.
    pub fn at(&self, x: usize, y: usize, z: usize) -> usize {
        (z * self.side + y) * self.side + x
    }

    /// Makes the block `side` cells wide, all of them without a value: values 0, no state bits. The
    /// memory is reused.
    pub(crate) fn reset(&mut self, side: usize) {
        self.side = side;
        self.values.clear();
        self.values.resize(side.pow(3), 0.0);
        self.states.clear();
        self.states.resize(side.pow(3), 0);
    }
}

/// Which cells of a cube lie inside the domain: a box of them.
pub struct Inside {
    side: usize,
    first: [usize; 3],
    last: [usize; 3],
}

impl Inside {
    /// Of a cube of `side`³ cells; none where no cell, or every one, is inside.
    pub fn of(side: usize, states: &[u8]) -> Option<Self> {
        if !state::any(states, |bits| bits == state::OUTSIDE) {
            return None;
        }
        let (mut first, mut last) = ([side; 3], [0; 3]);
        for (number, row) in states.chunks_exact(side).enumerate() {
            let is_inside = |bits: &u8| *bits != state::OUTSIDE;
            let Some(low) = row.iter().position(is_inside) else { continue };
            let high = row.iter().rposition(is_inside).unwrap_or(low);
            for (a, c) in
                [[low, high], [number % side; 2], [number / side; 2]].into_iter().enumerate()
            {
                first[a] = c[0].min(first[a]);
                last[a] = c[1].max(last[a]);
            }
        }
        (first[0] <= last[0]).then_some(Self { side, first, last })
    }

    fn place(side: usize, at: usize) -> [usize; 3] {
        [at % side, at / side % side, at / side / side]
    }

    /// The index of the cell inside that is nearest along all axes to that of index `at`.
    pub fn nearest(&self, at: usize) -> usize {
        let Self { side, first, last } = *self;
        let c = Self::place(side, at);
        let [x, y, z] = [0, 1, 2].map(|a| c[a].clamp(first[a], last[a]));
        (z * side + y) * side + x
    }
}

/// Calls `visit` with each cell of a cube of `side`³ cells that lies outside the domain and the
/// nearest one along all axes that does not, by their indices. Without any inside there is no call.
pub fn visit_outside(side: usize, states: &[u8], mut visit: impl FnMut(usize, usize)) {
    let Some(inside) = Inside::of(side, states) else { return };
    for (row, states) in states.chunks_exact(side).enumerate() {
        if state::any(states, |bits| bits == state::OUTSIDE) {
            for (x, _) in states.iter().enumerate().filter(|(_, bits)| **bits == state::OUTSIDE) {
                let at = row * side + x;
                visit(at, inside.nearest(at));
            }
        }
    }
}

/// A decoded payload. `blocks[0]` holds the brick's cells with one ghost cell on every side:
/// `(B + 2)³`, its first cell at `lo − 1` where `lo` is the brick's lowest cell. `blocks[q]`,
/// `q ≥ 1`, holds the cells `q` levels up over the same space with one more on every side:
/// `(max(B >> q, 1) + 2)³`, the first at `(lo >> q) − 1`. Values are bit-identical copies of
/// what the ancestors' own bricks hold. Cells that do not exist at their level (holes, and
/// ghosts beside coarser data) have state 0 and no value; the last block has none of those.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RawBrick {
    /// The brick itself, then its ancestors' blocks, nearest first.
    pub blocks: Vec<Block>,
}

impl RawBrick {
    /// How many levels up the owner of a cell lies (the finest level that has data there), and the
    /// stored value and [`state`] that it has; the cell is counted from the brick's lowest one.
    /// None where the brick is damaged.
    pub fn owner(&self, cell: [usize; 3]) -> Option<(usize, f32, u8)> {
        self.blocks.iter().enumerate().find_map(|(up, block)| {
            let [x, y, z] = cell.map(|c| c.checked_shr(up as u32).unwrap_or(0) + 1);
            let at = block.at(x, y, z);
            let bits = *block.states.get(at)?;
            state::is_own(bits).then(|| (up, block.values[at], bits))
        })
    }

    /// Bounds of the relative differences of values in fewer digits: of each block, the largest of these.
    pub(super) fn rounding_errors(&self) -> [f32; PARTS - 1] {
        let of_blocks = self.blocks.iter().map(|block| rounding_errors(&block.values));
        of_blocks.fold([0.0; PARTS - 1], |most, errors| {
            std::array::from_fn(|part| errors[part].max(most[part]))
        })
    }

    /// Brings values of existing cells between `low` and `high`; NaN stays.
    pub(crate) fn clamp(&mut self, [low, high]: [f32; 2]) {
        for block in &mut self.blocks {
            for (value, bits) in block.values.iter_mut().zip(&block.states) {
                let clamped = if *value < low { low } else { *value };
                let clamped = if clamped > high { high } else { clamped };
                *value = if bits & state::EXISTS != 0 { clamped } else { *value };
            }
        }
    }

    /// Whether a void cell of the brick, of `shape`, lies in a cell of its parent's that is not: the
    /// parent's shows something where there is nothing.
    pub(crate) fn parent_fills_void(&self, shape: BrickShape) -> bool {
        let [own, parent, ..] = &self.blocks[..] else { return false };
        let inside = 1..=shape.edge();
        let is_void = |block: &Block, [x, y, z]: [usize; 3]| {
            block.states.get(block.at(x, y, z)).is_some_and(|bits| bits & state::VOID != 0)
        };
        let rows = inside.clone().flat_map(|z| inside.clone().map(move |y| (y, z)));
        rows.flat_map(|(y, z)| inside.clone().map(move |x| [x, y, z]))
            .any(|cell| is_void(own, cell) && !is_void(parent, cell.map(|c| (c - 1) / 2 + 1)))
    }

    /// Makes room for `blocks` blocks of shape `shape`, whose cells are still to be set.
    pub(crate) fn fit(&mut self, shape: BrickShape, blocks: usize) {
        self.blocks.resize_with(blocks, Block::default);
        for (up, block) in self.blocks.iter_mut().enumerate() {
            block.side = shape.side(up);
            block.values.resize(block.side.pow(3), 0.0);
            block.states.resize(block.side.pow(3), 0);
        }
    }
}

/// How many cells a brick has along an edge, and what follows from it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BrickShape {
    edge: u32,
}

impl BrickShape {
    /// The largest edge, cells.
    pub const MOST_CELLS: usize = 32;

    /// Bricks of `edge`³ cells: 8, 16 or 32.
    ///
    /// # Errors
    /// Any other edge.
    pub fn new(edge: u32) -> Result<Self> {
        match edge {
            8 | 16 | 32 => Ok(Self { edge }),
            _ => Err(Error::request(format!("bricks of {edge}³ cells: 8, 16 or 32 are supported"))),
        }
    }

    /// The shape of a brick that covers the same space in cells twice as wide: half as many along
    /// an edge, which may be fewer than [`Self::new`] takes.
    pub(crate) fn coarser(self) -> Self {
        Self { edge: self.edge / 2 }
    }

    /// Cells along an edge, without ghosts.
    pub fn edge(self) -> usize {
        self.edge as usize
    }

    /// Cells of a brick, without ghosts.
    pub fn cells(self) -> usize {
        self.edge().pow(3)
    }

    /// Cells along an edge of the block `up` levels above the brick's, ghosts included.
    pub fn side(self, up: usize) -> usize {
        self.edge().checked_shr(u32::try_from(up).unwrap_or(u32::MAX)).unwrap_or(0).max(1) + 2
    }

    /// Cells in the first `blocks` blocks together.
    pub fn cells_in_blocks(self, blocks: usize) -> usize {
        (0..blocks).map(|up| self.side(up).pow(3)).sum()
    }

    /// Bytes of a decoded payload with `blocks` blocks: a state byte and a 4-byte value for each cell.
    pub fn payload_bytes(self, blocks: usize) -> usize {
        5 * self.cells_in_blocks(blocks)
    }
}

/// Where a brick lies in the octree.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct BrickPlace {
    /// Position in [`super::Header::levels`]: 0 = root.
    pub tree_level: usize,
    /// Octree level of its cells: factor-2 steps below the root grid (may be negative).
    pub octree: i32,
    /// Which brick of its level: its lowest cell has index `coordinates · B`.
    pub coordinates: [i128; 3],
}

impl BrickPlace {
    /// The root brick, `upper` levels above the root grid's level.
    pub fn root(upper: i32) -> Self {
        Self { tree_level: 0, octree: -upper, coordinates: [0; 3] }
    }

    /// The brick in octant `octant` (`x + 2y + 4z`), one level down.
    pub fn child(&self, octant: u8) -> Self {
        Self {
            tree_level: self.tree_level + 1,
            octree: self.octree + 1,
            coordinates: std::array::from_fn(|a| {
                2 * self.coordinates[a] + i128::from(octant >> a & 1)
            }),
        }
    }

    /// Index of the lowest cell at the brick's own level.
    pub fn lowest_cell(&self, shape: BrickShape) -> [i128; 3] {
        self.coordinates.map(|c| c * i128::from(shape.edge))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_outside_have_a_nearest_one_inside() {
        const SIDE: usize = 4;
        // Inside are x from 1 on, and z up to 2.
        let place = |at: usize| [at % SIDE, at / SIDE % SIDE, at / SIDE / SIDE];
        let is_inside = |[x, _, z]: [usize; 3]| x >= 1 && z <= 2;
        let states: Vec<u8> = (0..SIDE.pow(3))
            .map(|at| if is_inside(place(at)) { state::EXISTS } else { state::OUTSIDE })
            .collect();
        let mut visited = 0;
        visit_outside(SIDE, &states, |at, nearest| {
            let [x, y, z] = place(at);
            assert!(!is_inside([x, y, z]));
            assert_eq!(place(nearest), [x.max(1), y, z.min(2)]);
            visited += 1;
        });
        assert_eq!(visited, states.iter().filter(|bits| **bits == state::OUTSIDE).count());
        visit_outside(SIDE, &[state::OUTSIDE; SIDE.pow(3)], |_, _| unreachable!());
        visit_outside(SIDE, &[0; SIDE.pow(3)], |_, _| unreachable!());
    }

    #[test]
    fn void_is_filled_where_the_parent_has_something() {
        let shape = BrickShape::new(8).unwrap();
        let mut brick = RawBrick::default();
        brick.fit(shape, 2);
        for block in &mut brick.blocks {
            block.states.fill(state::EXISTS);
        }
        let set = |brick: &mut RawBrick, up: usize, [x, y, z]: [usize; 3], bits: u8| {
            let at = brick.blocks[up].at(x, y, z);
            brick.blocks[up].states[at] = bits;
        };
        let void = state::EXISTS | state::VOID;
        // Ghosts lie in other bricks' boxes.
        set(&mut brick, 0, [0, 4, 4], void);
        set(&mut brick, 0, [9, 4, 4], void);
        assert!(!brick.parent_fills_void(shape));
        set(&mut brick, 0, [8, 3, 1], void);
        assert!(brick.parent_fills_void(shape));
        set(&mut brick, 1, [4, 2, 1], void | state::REFINED);
        assert!(!brick.parent_fills_void(shape));
        brick.blocks.truncate(1);
        assert!(!brick.parent_fills_void(shape), "the root");
    }
}
