use glam::DVec3;
use proptest::prelude::*;

use super::*;
use crate::render::brick::interpolant::DrawnNeighbours;
use crate::render::march::ray_tests::smooth;
use crate::render::testing::data::{TestData, UNTIDY_BRICKS, rough};
use crate::render::transfer::pieces::TransferPieces;
use crate::scene::{FieldExtrema, Interpolation, Mapping, Scale};

const EDGE: usize = 8;
/// Far apart from cell to cell, as logarithms are.
fn wide(level: u32, cell: [i128; 3]) -> f64 {
    20.0 * (rough(level, cell) - 0.5).powi(3)
}

fn surveyed(number: usize, leaf: fn(u32, [i128; 3]) -> f64) -> ScaledBrick {
    let (level, at) = UNTIDY_BRICKS[number];
    let mut brick = TestData::new(leaf).brick(level, at, EDGE as u32, Interpolation::Linear);
    let distance = Distance::none([0.0, 1.0]);
    brick.survey(&TransferPieces::new(&smooth(), |_| 0.0).all, &distance, &mut Surveyor::default());
    brick
}

/// A place in group `index` or within one dual cell of it, as far as the brick goes.
fn place(brick: &ScaledBrick, index: usize, within: [f64; 3]) -> DVec3 {
    let side = brick.relief.side;
    let group = [index % side, index / side % side, index / side / side];
    let along = |a: usize| {
        let lo = (group[a] * GROUP_EDGE) as f64 - 1.5;
        let hi = lo + GROUP_EDGE as f64 + 2.0;
        (lo + within[a] * (hi - lo)).clamp(0.0, EDGE as f64)
    };
    DVec3::new(along(0), along(1), along(2))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn groups_bound_values_and_slopes(
        number in 0..UNTIDY_BRICKS.len(),
        is_wide in any::<bool>(),
        places in prop::collection::vec(prop::array::uniform3(0.0..1.0_f64), 200),
    ) {
        let brick = surveyed(number, if is_wide { wide } else { rough });
        let value = |at: DVec3| brick.value_at(at, DrawnNeighbours::ALL);
        for (index, group) in brick.relief.groups.iter().enumerate() {
            let mut slopes = [[f64::INFINITY, f64::NEG_INFINITY]; 3];
            let points = places.iter().map(|within| place(&brick, index, *within));
            for point in points.clone() {
                let x = value(point);
                prop_assert!(x >= group.low - 1e-12 && x <= group.high + 1e-12, "{x} {group:?}");
                for a in 0..3 {
                    const STEP: f64 = 1e-6;
                    let mut next = point;
                    next[a] += if point[a] < 1.0 { STEP } else { -STEP };
                    let slope = (value(next) - x) / (next[a] - point[a]);
                    slopes[a] = [slopes[a][0].min(slope), slopes[a][1].max(slope)];
                    let steepest = group.slope[a] + 1e-8;
                    prop_assert!(slope.abs() <= steepest, "{index} {a}: {slope} {group:?}");
                }
            }
            for (a, [least, most]) in slopes.into_iter().enumerate() {
                prop_assert!(most - least <= 2.0 * group.uneven[a] + 1e-8, "{a} {group:?}");
            }
            for (a, b) in points.clone().zip(points.skip(1)) {
                let most: f64 = (0..3).map(|n| group.slope[n] * (a[n] - b[n]).abs()).sum();
                prop_assert!((value(a) - value(b)).abs() <= most + 1e-12, "{a} {b} {group:?}");
            }
        }
    }

    #[test]
    fn what_is_near_bounds_values_and_slopes(
        number in 0..UNTIDY_BRICKS.len(),
        centre in prop::array::uniform3(0.0..8.0_f64),
        reach in 0.0..6.0_f64,
        places in prop::collection::vec(prop::array::uniform3(-1.0..1.0_f64), 100),
    ) {
        let brick = surveyed(number, rough);
        let pieces = TransferPieces::new(&smooth(), |_| 0.0).all;
        let light = |x: f64| {
            let piece = pieces.at(x);
            let [r, g, b] = piece.emission(x);
            [r.max(g).max(b), piece.extinction(x)]
        };
        let group = brick.relief.near(centre, reach, 2.0 * reach);
        let near = |off: &[f64; 3]| {
            let along = |a: usize| (centre[a] + reach * off[a]).clamp(0.0, EDGE as f64);
            DVec3::new(along(0), along(1), along(2))
        };
        let value = |at: DVec3| brick.value_at(at, DrawnNeighbours::ALL);
        let middle = value(near(&[0.0; 3]));
        let close = brick.relief.close_to(&group, middle, [reach; 3], &pieces);
        prop_assert!(close.low >= group.low && close.high <= group.high);
        prop_assert!(close.high - close.low <= 2.1 * reach * group.slope.iter().sum::<f64>() + 1e-9);
        for place in &places {
            let x = value(near(place));
            prop_assert!(x >= close.low - 1e-12 && x <= close.high + 1e-12, "{x} {close:?}");
        }
        for pair in places.windows(2) {
            let (a, b) = (near(&pair[0]), near(&pair[1]));
            let most: f64 = (0..3).map(|n| group.slope[n] * (a[n] - b[n]).abs()).sum();
            prop_assert!((value(a) - value(b)).abs() <= most + 1e-12, "{a} {b} {group:?}");
            let [p, q] = [light(value(a)), light(value(b))];
            let change = group.change(most);
            prop_assert!((p[1] - q[1]).abs() <= change.extinction + 1e-9, "{a} {b} {group:?}");
            let emission = group.span.most.emission;
            prop_assert!(p[0] <= emission + 1e-9 && (p[0] - q[0]).abs() <= change.emission + 1e-9);
            prop_assert!(p[0] <= close.span.most.emission + 1e-9);
            prop_assert!(p[1] <= close.span.most.extinction + 1e-9);
            prop_assert!((p[1] - q[1]).abs() <= close.change(most).extinction + 1e-9);
        }
    }
}

#[test]
fn slopes_are_close_to_those_there_are() {
    // Away from borders of levels they are the differences of neighbours, no more.
    let data = TestData::one_level(|_, cell| if cell[0] == 11 { 1.0 } else { 0.0 });
    let mut brick = data.brick(0, [1, 0, 1], EDGE as u32, Interpolation::Linear);
    let distance = Distance::none([0.0, 1.0]);
    brick.survey(&TransferPieces::new(&smooth(), |_| 0.0).all, &distance, &mut Surveyor::default());
    let group = brick.relief.group(0);
    assert_eq!((group.low, group.high, group.slope), (0.0, 1.0, [1.0, 0.0, 0.0]));
    assert_eq!(group.uneven, [1.0, 0.0, 0.0]);
}

/// Two rises with nothing between, one in each of two groups: no group knows both.
#[test]
fn places_in_different_groups_differ_by_more_than_either_says() {
    let data = TestData::one_level(|_, cell| 0.3 * (cell[1] + 2).div_euclid(4) as f64);
    let mut brick = data.brick(0, [1, 0, 1], EDGE as u32, Interpolation::Linear);
    let distance = Distance::none([0.0, 1.0]);
    let pieces = TransferPieces::new(&smooth(), |_| 0.0).all;
    brick.survey(&pieces, &distance, &mut Surveyor::default());
    let extinction = |y: f64| {
        let x = brick.value_at(DVec3::new(4.0, y, 4.0), DrawnNeighbours::ALL);
        pieces.at(x).extinction(x)
    };
    let difference = extinction(6.5) - extinction(1.5);
    let near = brick.relief.near([4.0; 3], 2.5, 5.0);
    assert!(difference > 1.0 && near.change(5.0).extinction >= difference, "{difference} {near:?}");
    // Those of one group, or of the next within a cell, do not.
    let close = brick.relief.near([4.0; 3], 2.5, 1.0);
    assert!(close.change(5.0).extinction < 0.6 * difference, "{close:?}");
}

/// A place beside a group's cells, within reach of one that this group does not know.
#[test]
fn constant_cells_near_a_place_are_those_within_reach_of_it() {
    let data = TestData::one_level(|_, cell| if cell[0] == 10 { 1.0 } else { 0.0 });
    let mut brick = data.brick(0, [1, 0, 1], EDGE as u32, Interpolation::Cell);
    let distance = Distance::none([0.0, 1.0]);
    let pieces = TransferPieces::new(&smooth(), |_| 0.0).all;
    brick.survey(&pieces, &distance, &mut Surveyor::default());
    // The cell from 2 to 3.
    for (x, high) in [(3.6, 1.0), (1.4, 1.0), (6.5, 0.0)] {
        assert_eq!(brick.relief.near([x, 2.0, 2.0], 0.8, 0.8).high, high, "{x}");
    }
}

/// Beside an octant with a child, whose values are a million times as large.
#[test]
fn values_beneath_are_off_where_they_are_stood_for_alone() {
    let extrema = FieldExtrema { minimum: 0.0, maximum: 1.0, smallest_positive: Some(1e-6) };
    let mapping = Mapping::new(Scale::Linear, Some([0.0, 1.0]), extrema, 1.0).unwrap();
    let rounding = mapping.rounding(6e-8, 0.0);
    let distance = Distance {
        residual: 0.5,
        child_mask: 1 << 7,
        storage: rounding,
        leaf_storage: rounding,
        ..Distance::none([0.0, 1.0])
    };
    let data = TestData::one_level(|_, _| 1e-6);
    let pieces = TransferPieces::new(&smooth(), |_| 0.0).all;
    for interpolation in [Interpolation::Cell, Interpolation::Linear] {
        let mut brick = data.brick(0, [1, 0, 1], EDGE as u32, interpolation);
        brick.survey(&pieces, &distance, &mut Surveyor::default());
        let most = |cell: [usize; 3], is_elsewhere: bool| {
            brick.relief.group_at(cell).storage(is_elsewhere).most()
        };
        assert!(most([0; 3], false) < 1e-12, "its own: {:e}", most([0; 3], false));
        assert!(most([0; 3], true) > 2e-8, "beside it: {:e}", most([0; 3], true));
        // Constant cells of an octant with a child may stand for what lies beneath.
        let stands = interpolation == Interpolation::Cell;
        assert_eq!(most([EDGE - 1; 3], false) > 2e-8, stands, "{interpolation:?}");
    }
}
