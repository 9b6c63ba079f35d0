//! What is refused, and what is drawn where cells were dropped.

use glam::DVec3;

use super::interpolant::DrawnNeighbours;
use super::scaled::{ScaledBrick, dual, one_by_one};
use crate::cache::{BrickPlace, BrickShape, RawBrick, state};
use crate::render::testing::data::{TestData, rough};
use crate::scene::Interpolation;

const AT: [i128; 3] = [4, 3, 5];
const PLACE: BrickPlace = BrickPlace { tree_level: 3, octree: 3, coordinates: AT };

fn prepared(raw: &RawBrick, mode: Interpolation) -> crate::Result<ScaledBrick> {
    let shape = BrickShape::new(8).unwrap();
    let mut brick = ScaledBrick::new();
    let header = TestData::new(rough).header(shape);
    brick.prepare(raw, &PLACE, header.shape, one_by_one(f64::from), mode).map(|()| brick)
}

fn raw() -> RawBrick {
    TestData::new(rough).raw(3, AT, BrickShape::new(8).unwrap())
}

#[test]
fn contradictions_are_errors() {
    let damage: [fn(&mut RawBrick); 6] = [
        |raw| raw.blocks.clear(),
        |raw| raw.blocks[0].side = 9,
        |raw| raw.blocks[1].values.truncate(3),
        |raw| raw.blocks[1].states.push(1),
        |raw| raw.blocks[0].states[17] = 6,
        |raw| raw.blocks.truncate(1),
    ];
    for mode in [Interpolation::Linear, Interpolation::Cell] {
        for damage in damage {
            let mut raw = raw();
            damage(&mut raw);
            let Err(error) = prepared(&raw, mode) else { panic!("damage went unseen") };
            assert!(error.to_string().contains("tree level 3"), "{error}");
        }
        assert!(prepared(&raw(), mode).is_ok());
    }
}

#[test]
fn dropped_cells_and_holes_of_dropped_owners_are_void() {
    let mut raw = raw();
    let data = TestData::new(rough);
    // An own cell, and the root cell that owns the hole at (0, 0, 0): level 3 begins at y = 24.
    let own = raw.blocks[0].at(6, 6, 6);
    assert_eq!(raw.blocks[0].states[own], state::EXISTS);
    raw.blocks[0].states[own] |= state::VOID;
    for block in &mut raw.blocks[1..] {
        for bits in block.states.iter_mut().filter(|bits| **bits & state::EXISTS != 0) {
            *bits |= state::VOID;
        }
    }
    let cells = prepared(&raw, Interpolation::Cell).unwrap();
    let at = |x: f64| DVec3::splat(x);
    assert!(cells.value_at(at(5.5), DrawnNeighbours::ALL).is_nan());
    assert!(!cells.value_at(at(4.5), DrawnNeighbours::ALL).is_nan());
    let linear = prepared(&raw, Interpolation::Linear).unwrap();
    assert_eq!(linear.duals[(5 * 9 + 5) * 9 + 5], dual::MIXED);
    assert!(data.exists(3, [36, 28, 44]));
}

#[test]
fn a_brick_used_again_forgets_and_stays_within_its_bytes() {
    let shape = BrickShape::new(8).unwrap();
    let data = TestData::new(rough);
    let header = data.header(shape);
    let mut brick = ScaledBrick::new();
    let points: Vec<DVec3> = (0..512)
        .map(|n| DVec3::new(f64::from(n % 8), f64::from(n / 8 % 8), f64::from(n / 64)) + 0.3)
        .collect();
    for (level, at) in [(3, AT), (0, [0, 0, 0]), (2, [2, 1, 2]), (1, [3, 0, 1])] {
        for mode in [Interpolation::Cell, Interpolation::Linear] {
            let raw = data.raw(level, at, shape);
            let place =
                BrickPlace { tree_level: level as usize, octree: level as i32, coordinates: at };
            brick.prepare(&raw, &place, header.shape, one_by_one(f64::from), mode).unwrap();
            let fresh = data.brick(level, at, 8, mode);
            for &point in &points {
                let again = brick.value_at(point, DrawnNeighbours::ALL);
                let once = fresh.value_at(point, DrawnNeighbours::ALL);
                assert_eq!(again.to_bits(), once.to_bits());
            }
            let block =
                |b: &super::blocks::ScaledBlock| 8 * b.values.capacity() + b.states.capacity();
            let narrow =
                |b: &super::blocks::NarrowBlock| 4 * b.values.capacity() + b.corners.capacity();
            let used = |brick: &ScaledBrick| {
                brick.blocks.iter().map(block).sum::<usize>()
                    + brick.duals.capacity()
                    + brick.narrow.iter().map(narrow).sum::<usize>()
                    + brick.blocks.capacity() * size_of::<super::blocks::ScaledBlock>()
            };
            let coarse =
                fresh.margin().map_or(0, |(_, coarse)| size_of::<ScaledBrick>() + used(coarse));
            let used = used(&fresh) + coarse;
            assert!(used as u64 <= ScaledBrick::bytes(shape, raw.blocks.len(), mode), "{used}");
        }
    }
}

#[test]
fn holes_lie_in_the_right_half_of_their_parents_far_below_these() {
    const UP: usize = 60;
    let shape = BrickShape::new(8).unwrap();
    let mut raw = RawBrick::default();
    raw.fit(shape, UP + 1);
    // Only the root's block has values: along x they rise by 1 a cell.
    let root = &mut raw.blocks[UP];
    for (at, (value, bits)) in root.values.iter_mut().zip(&mut root.states).enumerate() {
        (*value, *bits) = ((at % 3) as f32 - 1.0, state::EXISTS);
    }
    // So many ones that an f64 would round them up to the root's upper half.
    let place = BrickPlace { tree_level: 60, octree: 60, coordinates: [(1 << 56) - 1; 3] };
    let mut brick = ScaledBrick::new();
    let map = one_by_one(f64::from);
    brick.prepare(&raw, &place, shape, map, Interpolation::Linear).unwrap();
    let lowest = place.lowest_cell(shape)[0];
    for (up, block) in brick.blocks[..UP].iter().enumerate() {
        let from_root = |cell: usize| {
            let lower = ((lowest >> up) - 1 + cell as i128) as f64;
            (lower + 0.5) * ((up as f64) - UP as f64).exp2() - 0.5
        };
        for x in 0..block.side {
            let (found, expected) = (block.values[block.at([x, 1, 1])], from_root(x));
            assert!((found - expected).abs() < 1e-12, "{up} levels up, {x}: {found} {expected}");
        }
    }
}
