//! Thinner bricks against the bricks that they are made of, place by place.

use glam::DVec3;
use proptest::prelude::*;

use super::*;
use crate::render::brick::interpolant::DrawnNeighbours;
use crate::render::march::ray_tests::{smooth, steps};
use crate::render::testing::data::{At, BRICKS, TestData, UNTIDY_BRICKS, bent, linear, rough};
use crate::render::transfer::pieces::TransferPieces;
use crate::scene::TransferFunction;

const EDGE: u32 = 8;

fn surveyed(data: &TestData, (level, at): At, transfer: &TransferPieces) -> ScaledBrick {
    surveyed_of(EDGE, data, (level, at), transfer)
}

fn surveyed_of(
    edge: u32,
    data: &TestData,
    (level, at): At,
    transfer: &TransferPieces,
) -> ScaledBrick {
    let mut brick = data.brick(level, at, edge, Interpolation::Linear);
    let exact = Distance::none([0.0, 1.0]);
    brick.survey(&transfer.all, &exact, &mut Surveyor::default());
    brick
}

fn pieces(function: &TransferFunction) -> TransferPieces {
    TransferPieces::new(function, |_| 0.0)
}

/// What a thinner brick says that it is off by at most in the group of `place`, and how far it is.
fn off(brick: &ScaledBrick, thin: &ScaledBrick, place: [f64; 3]) -> (f64, f64) {
    let scale = thin.edge as f64 / brick.edge as f64;
    let dual = place.map(|x| (x * scale + 0.5) as usize);
    let value = |brick: &ScaledBrick, place: [f64; 3]| {
        brick.value_at(DVec3::from(place), DrawnNeighbours::ALL)
    };
    let apart = value(brick, place) - value(thin, place.map(|x| x * scale));
    (thin.relief.group_at(dual).thinned, apart.abs())
}

proptest! {
    #[test]
    fn a_thinner_brick_is_off_by_no_more_than_it_says(
        number in 0..BRICKS.len() + UNTIDY_BRICKS.len(),
        kind in 0..3_usize,
        (halvings, is_large) in (1..3_usize, any::<bool>()),
        places in prop::collection::vec(prop::array::uniform3(0.0..8.0_f64), 60),
        coarse in prop::collection::vec(prop::array::uniform3(0..17_u32), 60),
    ) {
        let data = TestData::new([rough, bent, linear][kind]);
        let transfer = pieces(&smooth());
        let (level, at) = *BRICKS.iter().chain(&UNTIDY_BRICKS).nth(number).unwrap();
        let (edge, at) = if is_large { (16, at.map(|c| c / 2)) } else { (8, at) };
        let brick = surveyed_of(edge, &data, (level, at), &transfer);
        let mut thinner = Thinner::default();
        let count = std::cell::Cell::new(0);
        // Each brick is asked for twice: likely, and surely.
        let fits = |_| {
            count.set(count.get() + 1);
            count.get() <= 2 * halvings
        };
        let Some((thin, found)) = thinner.thin(0, &brick, &transfer.all, fits) else {
            // What is left of the domain, or all of a brick, may be void.
            prop_assert!(brick.relief.whole.has_void);
            return Ok(());
        };
        prop_assert_eq!(found, if is_large { halvings } else { 1 });
        let wide = f64::from(edge / 8);
        let places = places.into_iter().chain(coarse.into_iter().map(|at| at.map(|n| f64::from(n) / 2.0)));
        for place in places {
            let place = place.map(|x| x * wide);
            let (most, apart) = off(&brick, thin, place);
            prop_assert!(apart <= most + 1e-12, "{apart} for {most} at {place:?}");
            prop_assert!(thin.relief.whole.thinned >= most);
        }
    }
}

#[test]
fn what_a_thinner_brick_says_is_met_where_there_is_no_border() {
    let transfer = pieces(&smooth());
    for values in [rough, bent] {
        let data = TestData::one_level(values);
        let brick = surveyed(&data, (0, [1, 0, 1]), &transfer);
        let mut thinner = Thinner::default();
        let (thin, _) = thinner.thin(0, &brick, &transfer.all, |_| true).unwrap();
        let mut farthest = 0.0_f64;
        for place in (0..17 * 17 * 17).map(|n| [n % 17, n / 17 % 17, n / 289]) {
            let place = place.map(|n: i32| f64::from(n) / 2.0);
            farthest = farthest.max(off(&brick, thin, place).1);
        }
        let said = thin.relief.whole.thinned;
        assert!(farthest > 0.0 && said <= 1.001 * farthest + 1e-12, "{said} for {farthest}");
    }
}

#[test]
fn values_that_bend_evenly_lie_between_chords() {
    // Along x alone, by 2·0.004 a cell and cell: chords of two cells about a quarter of that on
    // either side.
    let transfer = pieces(&smooth());
    let data = TestData::one_level(|level, cell| bent(level, [cell[0], 0, 0]));
    let brick = surveyed(&data, (0, [1, 0, 1]), &transfer);
    let mut thinner = Thinner::default();
    let (thin, _) = thinner.thin(0, &brick, &transfer.all, |_| true).unwrap();
    let off = thin.relief.whole.thinned;
    assert!((off / 0.002 - 1.0).abs() < 1e-4, "{off}");
}

#[test]
fn where_light_steps_or_likely_is_off_by_too_much_nothing_is_tried() {
    let data = TestData::one_level(rough);
    let mut thinner = Thinner::default();
    let stepped = pieces(&steps());
    let brick = surveyed(&data, (0, [1, 0, 1]), &stepped);
    assert!(thinner.thin(0, &brick, &stepped.all, |_| true).is_none());
    let transfer = pieces(&smooth());
    let brick = surveyed(&data, (0, [1, 0, 1]), &transfer);
    let asked = std::cell::Cell::new(0);
    let never = |_| {
        asked.set(asked.get() + 1);
        false
    };
    assert!(thinner.thin(0, &brick, &transfer.all, never).is_none());
    assert_eq!(asked.get(), 1);
}

#[test]
fn buffers_stay_within_their_bytes() {
    let (data, transfer) = (TestData::new(rough), pieces(&smooth()));
    let mut thinner = Thinner::default();
    let mut blocks = 0;
    for at in BRICKS.into_iter().chain(UNTIDY_BRICKS) {
        let brick = surveyed(&data, at, &transfer);
        blocks = blocks.max(brick.used);
        thinner.thin(0, &brick, &transfer.all, |_| true);
    }
    let Thinner { values, is_own, comparison, .. } = &thinner;
    let Comparison { halves, row, apart, farthest, off } = comparison;
    let edge = EDGE as usize;
    assert!(blocks > 1 && halves.held() as u64 <= Halves::bytes(edge, blocks));
    assert!(row.held() as u64 <= Halves::bytes(edge, 1));
    let numbers = values.iter().chain([apart, farthest, off]).map(Vec::capacity).sum::<usize>();
    let held = numbers * size_of::<f64>() + is_own.capacity() + halves.held() + row.held();
    let shape = BrickShape::new(EDGE).unwrap();
    assert!(
        held as u64
            <= Thinner::bytes(shape, blocks)
                - ScaledBrick::bytes(shape.coarser(), 1, Interpolation::Linear)
    );
}

#[test]
fn values_are_not_moved_to_a_step() {
    // Along x they bend up to just below it, and straightened ones would lie above.
    let data = TestData::one_level(|_, cell| 0.5499 - 0.003 * (cell[0] as f64 - 12.5).powi(2));
    let function = steps();
    let transfer = pieces(&function);
    let brick = surveyed(&data, (0, [1, 0, 1]), &transfer);
    let step = transfer.all.over(0.5499, 0.5506).jumps;
    assert!(step != Change::default(), "there is no step there");
    assert!(brick.relief.whole.span.jumps == Change::default());
    assert!(Thinner::default().thin(0, &brick, &transfer.all, |_| true).is_none());
}
