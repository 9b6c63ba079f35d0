//! The march against sums of many tiny steps, and at extremes.

use glam::DVec3;

use super::ray::{Light, march};
use super::ray_state::{Ending, RayState};
use crate::render::brick::interpolant::DrawnNeighbours;
use crate::render::brick::passage::{Passage, Region};
use crate::render::brick::scaled::ScaledBrick;
use crate::render::brick::walk::clip;
use crate::render::camera::frame::LocalRay;
use crate::render::testing::data::{TestCut, TestData, linear, rough};
use crate::render::transfer::pieces::{PieceList, TransferPieces};
use crate::scene::{ColorMap, ColorTable, Interpolation, PiecewiseLinear, TransferFunction};

/// Longer than any way through the data, code length.
const LONGEST: f64 = 100.0;

fn table(points: &[(f64, f64)]) -> PiecewiseLinear {
    PiecewiseLinear::new(&points.iter().map(|&(x, y)| (x, [y])).collect::<Vec<_>>()).unwrap()
}

pub(crate) fn transfer(absorption: &[(f64, f64)], emission: &[(f64, f64)]) -> TransferFunction {
    let color = ColorTable::Map(ColorMap::named("viridis").unwrap());
    TransferFunction::from_tables(&table(absorption), &table(emission), &color)
}

pub(crate) fn smooth() -> TransferFunction {
    transfer(&[(0.0, 0.0), (1.0, 3.0)], &[(0.1, 0.0), (0.6, 5.0), (1.0, 1.0)])
}

/// Opaque shells.
pub(crate) fn shells() -> TransferFunction {
    let shells = [(0.3, 0.0), (0.31, 40.0), (0.32, 0.0), (0.6, 0.0), (0.62, 25.0), (0.64, 0.0)];
    transfer(&shells, &shells)
}

/// A shell with sharp sides.
pub(crate) fn steps() -> TransferFunction {
    let steps = [(0.6, 0.0), (0.6, 2.0), (0.7, 3.0), (0.7, 0.5)];
    transfer(&steps, &[(0.55, 0.0), (0.55, 1.0), (0.65, 1.0), (0.65, 0.2)])
}

fn ray(origin: [f64; 3], direction: [f64; 3], length: f64) -> LocalRay {
    LocalRay {
        origin: DVec3::from_array(origin),
        direction: DVec3::from_array(direction),
        length,
        sigma_min: f64::NEG_INFINITY,
    }
}

/// Through the middle, along an axis exactly on faces, on a diagonal through corners, grazing.
fn rays() -> Vec<LocalRay> {
    vec![
        ray([4.0, 4.1, 3.9], [1.0, 0.37, -0.21], 0.4),
        ray([3.0, 2.0, 5.0], [0.0, 1.0, 0.0], 0.2),
        ray([4.0, 4.0, 4.0], [-1.0, -1.0, 1.0], 0.3),
        ray([3.5, 2.5, 0.0], [0.0, 0.0, -2.0], 0.5),
        ray([0.01, 7.9, 4.0], [0.02, 0.3, 1.0], 0.3),
        ray([7.3, 0.2, 7.7], [-0.9, 1.1, -0.8], 1.0),
    ]
}

fn whole(brick: &ScaledBrick) -> Region {
    Region { lo: [0.0; 3], hi: [brick.edge as f64; 3], ends: 0 }
}

fn marched(
    brick: &ScaledBrick,
    drawn: DrawnNeighbours,
    ray: &LocalRay,
    transfer: &TransferFunction,
) -> RayState {
    let mut state = RayState::default();
    let passage = Passage { brick, region: whole(brick), drawn, hides: false };
    let transfer = exact(transfer);
    march(&passage, ray, &light(&transfer, &transfer.all), &mut state, None);
    state
}

fn exact(transfer: &TransferFunction) -> TransferPieces {
    TransferPieces::new(transfer, |_| 0.0)
}

/// A march by `pieces` in which rays end where no f32 shows it.
fn light<'l>(transfer: &TransferPieces, pieces: &'l PieceList) -> Light<'l> {
    let ending = Ending::new(LONGEST * transfer.largest_emission(), 0.0);
    Light { pieces, ending, packets: None }
}

/// All of a brick, with all around it drawn.
fn through(brick: &ScaledBrick) -> Passage<'_> {
    Passage { brick, region: whole(brick), drawn: DrawnNeighbours::ALL, hides: false }
}

/// Midpoint steps through `value_at`.
fn stepped(
    brick: &ScaledBrick,
    drawn: DrawnNeighbours,
    ray: &LocalRay,
    transfer: &TransferFunction,
) -> RayState {
    const STEPS: u32 = 100_000;
    let mut state = RayState::default();
    let Some((from, to)) = clip(ray, whole(brick).lo, whole(brick).hi) else {
        return state;
    };
    let step = (to - from) / f64::from(STEPS);
    for n in 0..STEPS {
        let at = from + (f64::from(n) + 0.5) * step;
        let x = brick.value_at(ray.origin + ray.direction * at, drawn);
        if !x.is_nan() {
            state.pass(transfer.extinction(x), transfer.emission(x), step * ray.length);
        }
    }
    state
}

fn assert_close(found: &RayState, expected: &RayState, tolerance: f64, what: &str) {
    let largest = expected.radiance.iter().copied().fold(1e-6, f64::max);
    for c in 0..3 {
        let error = (found.radiance[c] - expected.radiance[c]).abs() / largest;
        assert!(error < tolerance, "{what}: {found:?} {expected:?} {error}");
    }
    assert!((found.transmittance - expected.transmittance).abs() < tolerance, "{what}");
}

#[test]
fn linear_equals_tiny_steps_beside_every_kind_of_border() {
    let data = TestData::new(rough);
    let cut = TestCut::new(&data, 8, |level, at| level < 2 || at[1] < 3 && at[2] < 4);
    for (level, at) in
        [(0, [1, 0, 1]), (1, [1, 0, 1]), (2, [2, 1, 2]), (3, [4, 3, 5]), (3, [4, 5, 6])]
    {
        let brick = data.brick(level, at, 8, Interpolation::Linear);
        let drawn = cut.drawn(level, at);
        for (n, ray) in rays().iter().enumerate() {
            for (name, transfer, tolerance) in
                [("smooth", smooth(), 2e-7), ("shells", shells(), 2e-5), ("steps", steps(), 4e-4)]
            {
                let what = format!("{name}, level {level} {at:?}, ray {n}");
                let found = marched(&brick, drawn, ray, &transfer);
                assert_close(&found, &stepped(&brick, drawn, ray, &transfer), tolerance, &what);
            }
        }
    }
}

#[test]
fn cell_equals_tiny_steps_and_holes_show_their_owner() {
    let data = TestData::new(rough);
    for (level, at) in [(1, [1, 0, 1]), (3, [4, 3, 5])] {
        let brick = data.brick(level, at, 8, Interpolation::Cell);
        for (n, ray) in rays().iter().enumerate() {
            let found = marched(&brick, DrawnNeighbours::ALL, ray, &smooth());
            let expected = stepped(&brick, DrawnNeighbours::ALL, ray, &smooth());
            assert_close(&found, &expected, 1e-4, &format!("level {level} ray {n}"));
        }
    }
    let brick = data.brick(2, [2, 1, 2], 8, Interpolation::Cell);
    let (hole, owner) = (DVec3::new(2.5, 3.5, 3.5), data.value(1, [9, 5, 9]));
    assert!(!data.exists(1, [9, 5, 9]) && !data.exists(2, [18, 11, 19]));
    let root = data.value(0, [4, 2, 4]);
    assert_ne!(owner, root);
    assert_eq!(brick.value_at(hole, DrawnNeighbours::ALL), f64::from(root));
}

#[test]
fn colour_maps_taken_as_a_whole_stay_close() {
    /// Largest deviation of the emission, radiance / code length.
    const ALLOWED: f64 = 5e-5;
    let mut is_simpler = false;
    let data = TestData::new(rough);
    let brick = data.brick(3, [4, 3, 5], 8, Interpolation::Linear);
    let transfer = TransferPieces::new(&smooth(), |_| ALLOWED);
    let light = light(&transfer, &transfer.merged);
    for ray in rays() {
        let mut state = RayState::default();
        march(&through(&brick), &ray, &light, &mut state, None);
        let exact = marched(&brick, DrawnNeighbours::ALL, &ray, &smooth());
        assert_close(&state, &exact, 1e-4, "loose");
        let (from, to) = clip(&ray, whole(&brick).lo, whole(&brick).hi).unwrap();
        for (found, exact) in state.radiance.iter().zip(exact.radiance) {
            let most = ALLOWED * (to - from) * ray.length;
            assert!((found - exact).abs() <= most + 1e-9 * exact, "{found} {exact} {most}");
            is_simpler |= found != &exact;
        }
        assert!((state.transmittance / exact.transmittance - 1.0).abs() < 1e-9);
    }
    assert!(is_simpler, "no entries were taken together");
}

#[test]
fn octants_add_up_to_the_whole() {
    let data = TestData::new(rough);
    let transfer = exact(&shells());
    let light = light(&transfer, &transfer.all);
    for interpolation in [Interpolation::Linear, Interpolation::Cell] {
        let brick = data.brick(3, [4, 3, 5], 8, interpolation);
        for ray in rays() {
            let all = marched(&brick, DrawnNeighbours::ALL, &ray, &shells());
            let mut state = RayState::default();
            let mask = (0..3).fold(0, |m, a| m | usize::from(ray.direction[a] < 0.0) << a);
            for n in 0..8 {
                let lo = std::array::from_fn(|a| if (n ^ mask) >> a & 1 == 1 { 4.0 } else { 0.0 });
                let region = Region { lo, hi: lo.map(|x| x + 4.0), ends: 0 };
                march(&Passage { region, ..through(&brick) }, &ray, &light, &mut state, None);
            }
            assert_close(&state, &all, 1e-10, "octants");
        }
    }
}

#[test]
fn a_linear_function_has_its_analytic_integral() {
    let data = TestData::one_level(linear);
    let brick = data.brick(0, [0, 0, 0], 8, Interpolation::Linear);
    let linear_emission = transfer(&[(0.0, 0.0)], &[(0.0, 0.0), (1.0, 1.0)]);
    let white = ColorTable::List(PiecewiseLinear::new(&[(0.0, [1.0; 3])]).unwrap());
    let white = TransferFunction::from_tables(
        &table(&[(0.0, 0.0), (1.0, 2.0)]),
        &table(&[(0.0, 0.0), (1.0, 2.0)]),
        &white,
    );
    let ray = ray([1.0, 1.5, 2.0], [0.3, 0.8, 0.7], 0.7);
    let region = Region { lo: [1.0, 1.0, 1.0], hi: [7.0, 7.0, 7.0], ends: 0 };
    let mut state = RayState::default();
    let transfer = exact(&white);
    let light = light(&transfer, &transfer.all);
    march(&Passage { region, ..through(&brick) }, &ray, &light, &mut state, None);
    // σ from 0 (z would enter at −1.43, y at −0.625, x at 0) to 5.5 / 0.8.
    let to = 5.5 / 0.8;
    let x = |s: f64| {
        crate::render::testing::data::linear_at([1.0 + 0.3 * s, 1.5 + 0.8 * s, 2.0 + 0.7 * s])
    };
    let depth = 2.0 * 0.5 * (x(0.0) + x(to)) * to * 0.7;
    assert!((state.transmittance - (-depth).exp()).abs() < 1e-7);
    assert!((state.radiance[1] - (1.0 - (-depth).exp())).abs() < 1e-7);
    assert!(marched(&brick, DrawnNeighbours::ALL, &ray, &linear_emission).transmittance == 1.0);
}

#[test]
fn extremes_stay_finite() {
    let data = TestData::new(rough);
    let opaque = transfer(&[(0.2, 0.0), (0.2, 1e30)], &[(0.0, 1e30)]);
    let bright = transfer(&[(0.0, 0.0)], &[(0.0, 1e30), (1.0, 1e30)]);
    let wall = transfer(&[(0.0, 1e6), (1.0, 1e6)], &[(0.0, 1e6), (1.0, 1e6)]);
    for interpolation in [Interpolation::Linear, Interpolation::Cell] {
        let brick = data.brick(3, [4, 3, 5], 8, interpolation);
        for ray in rays() {
            for transfer in [&opaque, &bright] {
                let state = marched(&brick, DrawnNeighbours::ALL, &ray, transfer);
                assert!(state.radiance.iter().all(|c| c.is_finite() && *c >= 0.0), "{state:?}");
                assert!((0.0..=1.0).contains(&state.transmittance));
            }
            let state = marched(&brick, DrawnNeighbours::ALL, &ray, &wall);
            let x = brick.value_at(entry(&brick, &ray), DrawnNeighbours::ALL);
            let expected = wall.emission(x)[1] / 1e6;
            assert!(state.transmittance < 1e-12);
            assert!((state.radiance[1] - expected).abs() < 1e-4, "{state:?} {expected}");
        }
    }
}

#[test]
fn a_wall_of_dust_ends_only_rays_that_nothing_can_change() {
    let data = TestData::one_level(|_, _| 0.5);
    let dust = transfer(&[(0.0, 40.0), (1.0, 40.0)], &[(0.0, 0.0), (0.9, 0.0), (1.0, 1e9)]);
    let transfer = exact(&dust);
    let light = light(&transfer, &transfer.all);
    for interpolation in [Interpolation::Linear, Interpolation::Cell] {
        let brick = data.brick(0, [0; 3], 8, interpolation);
        let ray = ray([4.3, 4.2, 0.0], [0.0, 0.0, 1.0], 1.0);
        // Before anything was gathered, something bright behind may still count, however faint.
        for (gathered, done) in [(1e15, true), (0.0, false)] {
            let mut state = RayState::default();
            state.gather([gathered; 3]);
            march(&through(&brick), &ray, &light, &mut state, None);
            let exact = (-320.0_f64).exp();
            assert!(state.transmittance < 1e-9, "{state:?}");
            assert_eq!(state.is_done(&Ending::new(1e11, 0.0)), done, "{state:?}");
            assert!(done || (state.transmittance / exact - 1.0).abs() < 1e-9, "{state:?}");
        }
    }
}

/// Huge values of both signs among ordinary ones.
fn wild(level: u32, cell: [i128; 3]) -> f64 {
    let value = rough(level, cell);
    let huge = [1e29, -1e29, 3e5, -1e12];
    if value < 0.4 { huge[(value * 10.0) as usize] } else { value }
}

#[test]
fn values_beyond_all_ranges_do_not_spill() {
    let data = TestData::new(wild);
    let opaque_middle = transfer(&[(0.0, 0.0), (0.5, 1e9), (1.0, 0.0)], &[(0.0, 1.0), (1.0, 2.0)]);
    for (level, at) in [(0, [1, 0, 1]), (2, [2, 1, 2])] {
        let brick = data.brick(level, at, 8, Interpolation::Linear);
        for ray in rays() {
            let found = marched(&brick, DrawnNeighbours::ALL, &ray, &smooth());
            let expected = stepped(&brick, DrawnNeighbours::ALL, &ray, &smooth());
            assert_close(&found, &expected, 4e-4, "wild");
            let state = marched(&brick, DrawnNeighbours::ALL, &ray, &opaque_middle);
            assert!(state.radiance.iter().all(|c| (0.0..1e3).contains(c)), "{state:?}");
        }
    }
}

/// Just inside where the ray enters.
fn entry(brick: &ScaledBrick, ray: &LocalRay) -> DVec3 {
    let (from, to) = clip(ray, whole(brick).lo, whole(brick).hi).unwrap();
    ray.origin + ray.direction * (from + 1e-9 * (to - from))
}
