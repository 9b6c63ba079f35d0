//! What accounts once missed: steps and void beneath, values far above the range, many parts.

use super::*;
use crate::render::march::ray::Beam;
use crate::scene::{ColorTable, FieldExtrema, Mapping, PiecewiseLinear, Scale};

fn square(x: f64, y: f64, halvings: u8) -> Square {
    Square { centre: [x, y], offset: [0; 2], pixel: 0, halvings }
}

/// Emission 2·x up to x = 1 and 2 from there on, of one colour, without absorption.
fn straight() -> TransferFunction {
    let table = |points: &[(f64, f64)]| {
        PiecewiseLinear::new(&points.iter().map(|&(x, y)| (x, [y])).collect::<Vec<_>>()).unwrap()
    };
    let white = ColorTable::List(PiecewiseLinear::new(&[(0.0, [1.0; 3])]).unwrap());
    TransferFunction::from_tables(&table(&[(0.0, 0.0)]), &table(&[(0.0, 0.0), (1.0, 2.0)]), &white)
}

#[test]
fn squares_of_values_far_above_the_range_are_as_far_off_as_their_accounts_say() {
    let leaves: [Leaf; 3] = [
        |level, cell| 2.0 + 1e15 * rough(level, cell),
        |level, cell| 2.0 + 1e20 * rough(level, cell),
        |level, cell| 2.0 + 1e25 * rough(level, cell),
    ];
    let function = straight();
    let transfer = TransferPieces::new(&function, |_| 0.0);
    for leaf in leaves {
        let data = TestData::one_level(leaf);
        let scene = camera([1.0, 0.5, 1.5], [0.3, 0.2, 3.0], 30.0, None);
        let linear = Interpolation::Linear;
        let stage = Stage::new(&data, 0, &[[1, 0, 0]], &scene, &function, &transfer, linear);
        for x in [2.2, 2.6, 3.0, 3.4, 3.8] {
            stage.check(&square(x, 3.0, 2)).unwrap();
        }
    }
}

/// Of a brick that shows something where there may be nothing beneath, all of it may be wrong, however
/// near the values are that there are.
#[test]
fn a_brick_that_fills_void_is_off_by_all_that_it_shows() {
    let data = TestData::one_level(linear);
    let scene = camera([1.0, 0.5, 1.5], [0.3, 0.2, 3.0], 30.0, None);
    for (medium, residual) in (0..6).flat_map(|n| [0.0, 1e-9, 1e-4, 9e-4, 1.1e-3].map(|r| (n, r))) {
        let function = media(medium);
        let transfer = TransferPieces::new(&function, |_| 0.0);
        let linear = Interpolation::Linear;
        let mut stage = Stage::new(&data, 0, &[[1, 0, 0]], &scene, &function, &transfer, linear);
        let distance =
            Distance { residual, child_mask: 0xff, fills_void: true, ..Distance::none([0.0, 1.0]) };
        stage.parts[0].brick.survey(&transfer.all, &distance, &mut Surveyor::default());
        let Part { brick, region, frame, .. } = &stage.parts[0];
        let drawn = DrawnNeighbours::ALL;
        let passage = Passage { brick, region: *region, drawn, hides: true };
        let (mut state, mut error) = (RayState::default(), RayError::default());
        let ray = frame.ray(stage.grid.aim(&square(3.0, 3.0, 2)).plane);
        let account = Some((&mut error, &Beam::alone(frame.depth)));
        march(&passage, &ray, &stage.light, &mut state, account);
        let bound = error.shares(state.radiance, state.opacity(), stage.brightest, 0.0).total();
        let shown = state.light().max(state.opacity());
        assert!(bound >= shown * (1.0 - 1e-9), "{medium}, {residual}: {shown:e}, not {bound:e}");
    }
}

/// Compares squares beside and before a brick of 0.5 − 5e-5 with truth of 0.5 + 4e-5: between them the
/// transfer function steps.
fn check_step_beyond(distance: Distance, hides: bool) {
    let steps = [(0.0, 0.0), (0.5, 0.0), (0.5, 5.0), (1.0, 5.0)];
    let function = transfer(&[(0.0, 0.0)], &steps);
    let transfer = TransferPieces::new(&function, |_| 0.0);
    let scene = camera([1.2, -0.5, 1.0], [0.0, 0.0, 3.0], 30.0, Some(2.5));
    let stage = |data: &TestData| {
        let linear = Interpolation::Linear;
        Stage::new(data, 0, &[[1, 0, 0]], &scene, &function, &transfer, linear)
    };
    let mut drawn = stage(&TestData::one_level(|_, _| 0.5 - 5e-5));
    let truth = stage(&TestData::one_level(|_, _| 0.5 + 4e-5));
    drawn.parts[0].brick.survey(&transfer.all, &distance, &mut Surveyor::default());
    let mut met = 0;
    for (x, halvings) in [(3.0, 0), (3.6, 0), (4.2, 0), (4.6, 0), (4.6, 1), (4.2, 1)] {
        let square = square(x, 3.0, halvings);
        let (mut mean, width) = (0.0, 2.0 * square.half());
        for n in 0..RAYS * RAYS {
            let off = [n % RAYS, n / RAYS]
                .map(|i| ((f64::from(i) + 0.5) / f64::from(RAYS) - 0.5) * width);
            let centre = [square.centre[0] + off[0], square.centre[1] + off[1]];
            let other = truth.gather(&Square { centre, ..square }, Way::WithoutAccount).0;
            mean += other.light() / f64::from(RAYS * RAYS);
        }
        let Part { brick, region, frame, footprint } = &drawn.parts[0];
        let passage = Passage { brick, region: *region, drawn: DrawnNeighbours::ALL, hides };
        let plane = drawn.grid.aim(&square).plane;
        let half = drawn.grid.pixel_size() * square.half();
        if !meets(footprint, plane, half) {
            continue;
        }
        met += 1;
        let ray = frame.ray(plane);
        let covered = drawn.grid.covered(footprint) / drawn.grid.weight(&square);
        let beam = beam(frame, &ray, half, covered);
        let (mut state, mut error) = (RayState::default(), RayError::default());
        march(&passage, &ray, &drawn.light, &mut state, Some((&mut error, &beam)));
        let shares = error.shares(state.radiance, state.opacity(), drawn.brightest, 0.0);
        let (off, bound) = ((mean - state.light()).abs(), shares.total());
        assert!(off <= bound * (1.0 + 1e-9), "{x}, {halvings}: {off:e}, not {bound:e}");
    }
    assert!(met > 3, "{met}");
}

#[test]
fn steps_within_reach_of_what_is_beneath_count_beside_a_ray() {
    let tree = Distance::none([0.49, 0.51]);
    check_step_beyond(Distance { residual: 1e-4, child_mask: 0xff, ..tree }, true);
}

#[test]
fn steps_within_reach_of_the_sources_values_count_beside_a_ray() {
    let extrema = FieldExtrema { minimum: 0.0, maximum: 1.0, smallest_positive: Some(0.1) };
    let mapping = Mapping::new(Scale::Linear, Some([0.0, 1.0]), extrema, 1.0).unwrap();
    let rounding = mapping.rounding(1e-3, 0.0);
    let (storage, leaf_storage, is_rounded) = (rounding, rounding, true);
    let tree = Distance::none([0.49, 0.51]);
    check_step_beyond(Distance { storage, leaf_storage, is_rounded, ..tree }, false);
}

#[test]
fn depths_of_many_parts_are_off_by_no_more_than_their_accounts_say() {
    let comb: Vec<(f64, f64)> = (0..40)
        .map(|n| (f64::from(n) / 40.0 + 0.01, if n % 2 == 0 { 0.0 } else { 40.0 }))
        .collect();
    let (data, linear) = (TestData::one_level(rough), Interpolation::Linear);
    for extinction in [0.5, 2.1, 3.3, 6.2] {
        let function = transfer(&[(0.0, extinction)], &comb);
        let transfer = TransferPieces::new(&function, |_| 0.0);
        for n in 0..4 {
            let off = [2.0 + 0.2 * f64::from(n), 2.3 - 0.3 * f64::from(n), 2.1];
            let scene = camera([1.2, -0.5, 1.0], off, 10.0, Some(0.6));
            let mut stage =
                Stage::new(&data, 0, &[[1, 0, 0]], &scene, &function, &transfer, linear);
            stage.care = Care::Fine;
            for x in 0..12 {
                let square = square(0.25 + 0.5 * f64::from(x), 3.1, 7);
                let (packed, error) = stage.gather(&square, Way::InPackets);
                let (exact, _) = stage.gather(&square, Way::Alone);
                let off = (packed.transmittance.ln() - exact.transmittance.ln()).abs();
                let bound = error.causes.march.extinction;
                assert!(off <= bound, "{extinction}, {n}, {x}: {off:e}, not {bound:e}");
            }
        }
    }
}

/// Along a side of the domain others of a square leave it many cells before or behind its centre's: what
/// they miss there is not what those opposite meet.
#[test]
fn values_along_a_side_of_the_domain_change_before_opposite_rays_leave_it() {
    let slanted: [Leaf; 4] = [
        linear,
        |_, _| 0.5,
        |_, [x, _, _]| if x < 10 { 0.2 } else { 0.9 },
        |_, [x, _, _]| 0.5 + 0.04 * (x - 9) as f64,
    ];
    let target = [1.0, 0.0, 0.5];
    for (leaf, slope) in slanted
        .into_iter()
        .flat_map(|leaf| [0.003, 0.01, 0.0458, 0.2, -0.0458].map(|slope| (leaf, slope)))
    {
        let data = TestData::one_level(leaf);
        let scene = camera(target, [3.0, 0.0, slope], 0.0, Some(0.1));
        for medium in 0..6 {
            let linear = Interpolation::Linear;
            check_all(&data, &all_bricks(), &scene, medium, linear, &middle_squares()).unwrap();
        }
    }
}

/// Where nothing shines along a square's own ray, what does along others is off as it is stored as well.
#[test]
fn stored_values_count_of_all_rays_of_a_square() {
    const STORED: f64 = 1e-2;
    let extrema = FieldExtrema { minimum: 0.0, maximum: 1.0, smallest_positive: Some(0.1) };
    let mapping = Mapping::new(Scale::Linear, Some([0.0, 1.0]), extrema, 1.0).unwrap();
    let rounding = mapping.rounding(STORED, 0.0);
    let (storage, leaf_storage) = (rounding, rounding);
    let distance = Distance { storage, leaf_storage, ..Distance::none([0.0, 1.0]) };
    let function = transfer(&[(0.0, 0.0)], &[(0.0, 0.0), (0.5, 0.0), (1.0, 2.0)]);
    let transfer = TransferPieces::new(&function, |_| 0.0);
    let scene = camera([1.2, -0.5, 1.0], [0.0, 0.0, 3.0], 30.0, Some(2.5));
    let stage = |leaf: Leaf, interpolation: Interpolation| {
        let data = TestData::one_level(leaf);
        let bricks = [[1, 0, 0]];
        let mut stage = Stage::new(&data, 0, &bricks, &scene, &function, &transfer, interpolation);
        stage.parts[0].brick.survey(&transfer.all, &distance, &mut Surveyor::default());
        stage
    };
    for interpolation in [Interpolation::Cell, Interpolation::Linear] {
        let stored = stage(|_, [x, _, _]| if x < 12 { 0.2 } else { 0.8 }, interpolation);
        let source = stage(|_, [x, _, _]| if x < 12 { 0.2 } else { 0.807 }, interpolation);
        let mut beside = 0;
        for (x, halvings) in
            (0..60).flat_map(|n| [(0.1 * f64::from(n), 0), (0.1 * f64::from(n), 2)])
        {
            let square = square(x, 3.0, halvings);
            let width = 2.0 * square.half();
            let mut off = 0.0;
            for n in 0..RAYS * RAYS {
                let place = [n % RAYS, n / RAYS]
                    .map(|i| ((f64::from(i) + 0.5) / f64::from(RAYS) - 0.5) * width);
                let centre = [square.centre[0] + place[0], square.centre[1] + place[1]];
                let other = Square { centre, ..square };
                let light = |stage: &Stage<'_>| stage.gather(&other, Way::WithoutAccount).0.light();
                off += (light(&source) - light(&stored)) / f64::from(RAYS * RAYS);
            }
            for way in [Way::Alone, Way::InPackets] {
                let (state, error) = stored.gather(&square, way);
                let bound = error.causes.storage.emission;
                assert!(
                    off <= bound * (1.0 + 1e-6),
                    "{x}, {halvings}, {way:?}: {off:e}, not {bound:e}"
                );
                beside += usize::from(state.light() == 0.0 && off > 0.0);
            }
        }
        assert!(beside > 0, "{interpolation:?}");
    }
}

/// A ramp, and a transfer function that steps on it: squares cells away from the step are certain, though
/// groups at which their rays enter bricks reach over it, and squares across it are not.
#[test]
fn what_shines_cells_away_is_not_counted_at_a_bricks_faces() {
    let data = TestData::one_level(|_, [x, ..]| 0.1 * (x - 8) as f64);
    let function = transfer(&[(0.0, 0.0)], &[(0.0, 0.0), (0.35, 0.0), (0.35, 5.0), (1.0, 5.0)]);
    let transfer = TransferPieces::new(&function, |_| 0.0);
    let scene = camera([1.5, 0.5, 0.5], [0.1, 1.0, 3.0], 30.0, Some(2.0));
    let linear = Interpolation::Linear;
    let stage = Stage::new(&data, 0, &all_bricks(), &scene, &function, &transfer, linear);
    let steps = |part: &Part, n: usize| part.brick.relief.group(n).span.jumps.emission > 0.0;
    assert!(stage.parts.iter().any(|part| steps(part, 0) && steps(part, 1)));
    let bound = |x: f64| {
        let (state, error) = stage.gather(&square(x, 3.0, 2), Way::Alone);
        error.shares([0.0; 3], state.opacity(), stage.brightest, 0.0).pixel_area
    };
    for x in [0.625, 0.875, 1.125, 1.375, 1.625] {
        assert_eq!(bound(x), 0.0, "{x}");
    }
    assert!(bound(4.375) > 1.0);
}
