//! A small data set for tests: a root grid that no brick fits, L-shaped finer levels, faces where
//! levels jump by one, two and three, and the interpolant in its plainest form.

use std::cell::RefCell;
use std::collections::HashMap;

use glam::DVec3;

use crate::cache::{BrickPlace, BrickShape, Header, RawBrick, state};
use crate::render::brick::interpolant::DrawnNeighbours;
use crate::render::brick::scaled::{ScaledBrick, one_by_one};
use crate::scene::Interpolation;
use crate::space::{Domain, IndexBox};

/// Cells of the root grid.
const ROOT: [i128; 3] = [20, 12, 16];

/// A brick's level and place.
pub(crate) type At = (u32, [i128; 3]);

/// Bricks of 8³: with holes, with ghosts of one to three levels above, and whole.
pub(crate) const BRICKS: [At; 5] =
    [(0, [1, 0, 1]), (1, [1, 0, 1]), (2, [2, 1, 2]), (3, [4, 3, 5]), (3, [4, 5, 6])];
/// More of them, also at corners of levels and beside the domain's end.
pub(crate) const UNTIDY_BRICKS: [At; 8] = [
    (0, [1, 0, 1]),
    (0, [2, 1, 1]),
    (1, [1, 0, 1]),
    (1, [3, 1, 1]),
    (2, [2, 1, 2]),
    (2, [4, 3, 4]),
    (3, [4, 3, 5]),
    (3, [7, 5, 6]),
];

/// Existence as boxes of each level's cells, and a value for each leaf cell.
pub(crate) struct TestData {
    pub(crate) domain: Domain,
    boxes: Vec<Vec<IndexBox>>,
    leaf: fn(u32, [i128; 3]) -> f64,
    values: RefCell<HashMap<(u32, [i128; 3]), f64>>,
}

fn cells(lo: [i128; 3], hi: [i128; 3]) -> IndexBox {
    IndexBox { lo, hi }
}

/// Values without any order between neighbours.
pub(crate) fn rough(level: u32, cell: [i128; 3]) -> f64 {
    let mut hash = u64::from(level).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    for c in cell {
        hash = (hash ^ c as u64).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        hash ^= hash >> 29;
    }
    f64::from((hash >> 20) as u32 >> 8) / f64::from(1 << 24)
}

/// A linear function of position, taken at the cell's centre.
pub(crate) fn linear(level: u32, cell: [i128; 3]) -> f64 {
    linear_at(std::array::from_fn(|a| (cell[a] as f64 + 0.5) / f64::from(1 << level)))
}

/// [`linear`] at a point in root cells.
pub(crate) fn linear_at(point: [f64; 3]) -> f64 {
    0.3 + 0.02 * point[0] - 0.01 * point[1] + 0.015 * point[2]
}

/// Values that bend evenly over a brick of any level.
pub(crate) fn bent(level: u32, cell: [i128; 3]) -> f64 {
    let along = |a: usize| (cell[a] as f64 + 0.5) / f64::from(1 << level);
    0.2 + 0.004 * (along(0) - 7.0).powi(2) + 0.002 * along(1) * along(2) / 9.0
}

impl TestData {
    pub(crate) fn new(leaf: fn(u32, [i128; 3]) -> f64) -> Self {
        let boxes = vec![
            vec![cells([0; 3], ROOT)],
            vec![cells([8, 6, 10], [24, 18, 24]), cells([24, 6, 10], [30, 10, 14])],
            vec![cells([16, 12, 20], [40, 30, 40])],
            vec![cells([32, 24, 40], [60, 50, 64]), cells([60, 24, 40], [64, 26, 50])],
        ];
        Self::of(leaf, boxes)
    }

    /// Only the root grid.
    pub(crate) fn one_level(leaf: fn(u32, [i128; 3]) -> f64) -> Self {
        Self::of(leaf, vec![vec![cells([0; 3], ROOT)]])
    }

    fn of(leaf: fn(u32, [i128; 3]) -> f64, boxes: Vec<Vec<IndexBox>>) -> Self {
        let domain = Domain::new([0.0, -1.0, 0.5], [2.0, 2.0, 2.5], ROOT.map(|n| n as u64));
        Self { domain: domain.unwrap(), boxes, leaf, values: RefCell::default() }
    }

    pub(super) fn deepest(&self) -> u32 {
        self.boxes.len() as u32 - 1
    }

    pub(crate) fn exists(&self, level: u32, cell: [i128; 3]) -> bool {
        let one = IndexBox::at(cell, [1; 3]);
        self.boxes.get(level as usize).is_some_and(|all| all.iter().any(|b| b.contains(&one)))
    }

    fn is_inside(level: u32, cell: [i128; 3]) -> bool {
        (0..3).all(|a| (0..ROOT[a] << level).contains(&cell[a]))
    }

    /// Boxes of all levels, in cells of their level.
    pub(crate) fn borders(&self) -> impl Iterator<Item = (u32, IndexBox)> + '_ {
        (1..).zip(&self.boxes[1..]).flat_map(|(level, all)| all.iter().map(move |b| (level, *b)))
    }

    /// The value of an existing cell, rounded as a cache stores it.
    pub(crate) fn value(&self, level: u32, cell: [i128; 3]) -> f32 {
        self.average(level, cell) as f32
    }

    fn average(&self, level: u32, cell: [i128; 3]) -> f64 {
        if let Some(value) = self.values.borrow().get(&(level, cell)) {
            return *value;
        }
        let child = |n: usize| std::array::from_fn(|a| 2 * cell[a] + (n >> a & 1) as i128);
        let value = if self.exists(level + 1, child(0)) {
            (0..8).map(|n| self.average(level + 1, child(n))).sum::<f64>() / 8.0
        } else {
            (self.leaf)(level, cell)
        };
        self.values.borrow_mut().insert((level, cell), value);
        value
    }

    /// Whether the brick has data of its own.
    pub(super) fn has_brick(&self, level: u32, coordinates: [i128; 3], edge: i128) -> bool {
        let brick = IndexBox::at(coordinates.map(|c| c * edge), [edge as u32; 3]);
        self.boxes
            .get(level as usize)
            .is_some_and(|all| all.iter().any(|b| !b.intersection(&brick).is_empty()))
    }

    pub(crate) fn header(&self, shape: BrickShape) -> Header {
        Header {
            file_bytes: 0,
            source_format: String::new(),
            time: None,
            domain: self.domain.clone(),
            shape,
            levels: Vec::new(),
            fields: Vec::new(),
            max_parent_blocks: 4,
            index_offset: 0,
            index_pages: 0,
            page_table_checksum: 0,
            checksum: 0,
        }
    }

    /// The payload that a cache would hold for a brick.
    pub(crate) fn raw(&self, level: u32, coordinates: [i128; 3], shape: BrickShape) -> RawBrick {
        let lowest = coordinates.map(|c| c * shape.edge() as i128);
        let mut raw = RawBrick::default();
        for up in 0..=level {
            let side = shape.side(up as usize);
            let mut block = crate::cache::Block { side, ..Default::default() };
            let first = lowest.map(|c| (c >> up) - 1);
            for n in 0..side.pow(3) {
                let cell = [n % side, n / side % side, n / side / side];
                let cell = std::array::from_fn(|a| first[a] + cell[a] as i128);
                let (value, bits) = self.stored(level - up, cell);
                block.values.push(value);
                block.states.push(bits);
            }
            let complete = !block.states.contains(&0);
            raw.blocks.push(block);
            // A parent's block is always there, for borders of level of detail.
            if complete && up > 0 {
                break;
            }
        }
        raw
    }

    fn stored(&self, level: u32, cell: [i128; 3]) -> (f32, u8) {
        if !Self::is_inside(level, cell) {
            return (0.0, state::OUTSIDE);
        }
        if self.exists(level, cell) {
            return (self.value(level, cell), state::EXISTS);
        }
        (0.0, 0)
    }

    /// A brick ready to march through, with the values as x.
    pub(crate) fn brick(
        &self,
        level: u32,
        coordinates: [i128; 3],
        edge: u32,
        interpolation: Interpolation,
    ) -> ScaledBrick {
        let raw = self.raw(level, coordinates, BrickShape::new(edge).unwrap());
        self.brick_of(&raw, (level, coordinates), edge, interpolation)
    }

    /// The same of a payload.
    pub(crate) fn brick_of(
        &self,
        raw: &RawBrick,
        (level, coordinates): At,
        edge: u32,
        interpolation: Interpolation,
    ) -> ScaledBrick {
        let shape = BrickShape::new(edge).unwrap();
        let place = BrickPlace { tree_level: level as usize, octree: level as i32, coordinates };
        let mut brick = ScaledBrick::new();
        brick.prepare(raw, &place, shape, one_by_one(f64::from), interpolation).unwrap();
        brick
    }

    /// v_l of any cell, ghosts and holes included, by the definition.
    fn filled(&self, level: u32, cell: [i128; 3]) -> f64 {
        let cell = std::array::from_fn(|a| cell[a].clamp(0, (ROOT[a] << level) - 1));
        if self.exists(level, cell) {
            return f64::from(self.value(level, cell));
        }
        (0..8)
            .map(|n| {
                let mut weight = 1.0;
                let parent = std::array::from_fn(|a| {
                    let beside = if cell[a] & 1 == 0 { -1 } else { 1 };
                    weight *= if n >> a & 1 == 1 { 0.25 } else { 0.75 };
                    (cell[a] >> 1) + if n >> a & 1 == 1 { beside } else { 0 }
                });
                weight * self.filled(level - 1, parent)
            })
            .sum()
    }

    /// The interpolant of `level` at a point in cells of that level, by the definition;
    /// `is_drawn` says which cells are drawn at the level or finer.
    pub(crate) fn slow(
        &self,
        level: u32,
        point: [f64; 3],
        is_drawn: &dyn Fn(u32, [i128; 3]) -> bool,
    ) -> f64 {
        let low = point.map(|x| (x - 0.5).floor());
        let trilinear: f64 = (0..8)
            .map(|n| {
                let mut weight = 1.0;
                let cell = std::array::from_fn(|a| {
                    let along = point[a] - 0.5 - low[a];
                    weight *= if n >> a & 1 == 1 { along } else { 1.0 - along };
                    low[a] as i128 + i128::from(n >> a & 1 == 1)
                });
                weight * self.filled(level, cell)
            })
            .sum();
        if level == 0 {
            return trilinear;
        }
        let cell: [i128; 3] = point.map(|x| x.floor() as i128);
        let has = |c: [i128; 3]| {
            !Self::is_inside(level, c) || self.exists(level, c) && is_drawn(level, c)
        };
        let mut weight = if has(cell) { 1.0_f64 } else { 0.0 };
        for n in 1..8 {
            let u: [f64; 3] = std::array::from_fn(|a| point[a] - cell[a] as f64);
            let neighbour = std::array::from_fn(|a| match (n >> a & 1, u[a] >= 0.5) {
                (0, _) => cell[a],
                (_, true) => cell[a] + 1,
                (_, false) => cell[a] - 1,
            });
            if !has(neighbour) {
                let s = |a: &usize| 1.0 - (2.0 * u[*a] - 1.0).abs();
                let farthest =
                    (0..3).filter(|a| n >> a & 1 == 1).map(|a| s(&a)).fold(0.0, f64::max);
                weight = weight.min(farthest);
            }
        }
        let coarse = self.slow(level - 1, point.map(|x| 0.5 * x), &|_, _| true);
        coarse + weight * (trilinear - coarse)
    }
}

/// A tree cut for a level of detail: which bricks are opened, and all bricks drawn.
pub(crate) struct TestCut<'a> {
    pub(super) data: &'a TestData,
    pub(super) edge: u32,
    /// Whether a brick's children are drawn instead, where there are any.
    pub(super) opens: fn(u32, [i128; 3]) -> bool,
    bricks: RefCell<HashMap<(u32, [i128; 3]), ScaledBrick>>,
}

impl<'a> TestCut<'a> {
    pub(crate) fn new(data: &'a TestData, edge: u32, opens: fn(u32, [i128; 3]) -> bool) -> Self {
        Self { data, edge, opens, bricks: RefCell::default() }
    }

    /// Whether the brick exists and is drawn, itself or by what lies beneath.
    fn is_drawn(&self, level: u32, coordinates: [i128; 3]) -> bool {
        self.data.has_brick(level, coordinates, i128::from(self.edge))
            && (1..=level).all(|up| (self.opens)(level - up, coordinates.map(|c| c >> up)))
    }

    pub(crate) fn drawn(&self, level: u32, coordinates: [i128; 3]) -> DrawnNeighbours {
        DrawnNeighbours((0..27).fold(0, |bits, n| {
            let shift = [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1];
            let at = std::array::from_fn(|a| coordinates[a] + i128::from(shift[a]));
            bits | u32::from(self.is_drawn(level, at)) << n
        }))
    }

    /// The brick that owns `point` (root cells).
    pub(crate) fn owner(&self, point: [f64; 3]) -> (u32, [i128; 3]) {
        (0..=self.data.deepest())
            .rev()
            .map(|level| {
                let scale = f64::from(1 << level) / f64::from(self.edge);
                (level, point.map(|x| (x * scale).floor() as i128))
            })
            .find(|(level, at)| self.is_drawn(*level, *at))
            .unwrap()
    }

    /// What is drawn at `point` (root cells).
    pub(crate) fn value_at(&self, point: [f64; 3]) -> f64 {
        let (level, at) = self.owner(point);
        let drawn = self.drawn(level, at);
        let mut bricks = self.bricks.borrow_mut();
        let brick = bricks
            .entry((level, at))
            .or_insert_with(|| self.data.brick(level, at, self.edge, Interpolation::Linear));
        let local =
            |a: usize| point[a] * f64::from(1 << level) - at[a] as f64 * f64::from(self.edge);
        brick.value_at(DVec3::new(local(0), local(1), local(2)), drawn)
    }
}
