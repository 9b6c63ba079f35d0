//! Packets in cells of constant value against single rays.

use glam::DVec3;
use proptest::prelude::*;

use super::packet_tests::{EDGE, LONGEST, Setting, WIDTH, glowing};
use super::packets::Accounts;
use super::ray::{Beam, march};
use super::ray_state::RayState;
use super::ray_tests::{shells, smooth, steps, transfer};
use crate::cache::{BrickShape, state};
use crate::lanes::Width;
use crate::render::bounds::grade::Care;
use crate::render::bounds::ray_error::RayError;
use crate::render::bounds::sums::Sums;
use crate::render::brick::interpolant::DrawnNeighbours;
use crate::render::brick::scaled::ScaledBrick;
use crate::render::brick::steepness::Surveyor;
use crate::render::camera::frame::LocalRay;
use crate::render::testing::data::{At, BRICKS, TestData, rough};
use crate::render::transfer::distance::Distance;
use crate::render::transfer::pieces::TransferPieces;
use crate::scene::{FieldExtrema, Interpolation, Mapping, Scale, TransferFunction};

/// Nothing hides, and values are the source's.
fn truth() -> Distance {
    Distance::none([0.0, 1.0])
}

/// A brick; of one in five cells, as `seed` has it, nothing is left.
fn brick(
    (level, at): At,
    seed: Option<u64>,
    pieces: &TransferPieces,
    far: Distance,
) -> ScaledBrick {
    let data = TestData::new(rough);
    let mut raw = data.raw(level, at, BrickShape::new(EDGE).unwrap());
    let cells = raw.blocks[0].states.iter_mut().enumerate();
    for (n, bits) in cells.filter(|(_, bits)| **bits == state::EXISTS) {
        if seed.is_some_and(|seed| rough(0, [n as i128, i128::from(seed), 7]) < 0.2) {
            *bits |= state::VOID;
        }
    }
    let mut brick = data.brick_of(&raw, (level, at), EDGE, Interpolation::Cell);
    brick.survey(&pieces.all, &far, &mut Surveyor::default());
    brick
}

/// From nothing to opaque whatever the way.
fn wall() -> TransferFunction {
    transfer(&[(0.5, 0.0), (0.5, 1e30)], &[(0.5, 0.0), (0.5, 3e29), (1.0, 1e30)])
}

/// Opaque by a cell, or a few of them.
fn fog() -> TransferFunction {
    transfer(&[(0.2, 0.0), (0.3, 200.0), (1.0, 20.0)], &[(0.2, 0.0), (0.3, 100.0), (1.0, 50.0)])
}

/// Next to nothing.
fn breath() -> TransferFunction {
    transfer(&[(0.0, 0.0), (1.0, 1e-20)], &[(0.0, 1e-25), (0.7, 1e-24), (1.0, 0.0)])
}

fn function(number: usize) -> TransferFunction {
    [smooth, glowing, shells, steps, wall, fog, breath][number % 7]()
}

fn ray(at: [f64; 3], towards: [f64; 3]) -> LocalRay {
    let direction = DVec3::from_array(towards);
    let origin = DVec3::from_array(at) - direction * 3.0;
    let length = WIDTH * direction.length();
    LocalRay { origin, direction, length, sigma_min: f64::NEG_INFINITY }
}

/// Rays through a point of the brick, or of a face, an edge or a corner of its cells or right
/// beside them; in any direction, along diagonals and axes, or hardly off them.
fn rays() -> impl Strategy<Value = Vec<LocalRay>> {
    let edge = f64::from(EDGE);
    let near = (0..=EDGE, prop_oneof![Just(0.0), Just(1e-12), Just(-1e-12), -1e-5..1e-5_f64])
        .prop_map(move |(plane, off)| (f64::from(plane) + off).clamp(0.0, edge));
    let through = prop::array::uniform3(prop_oneof![0.0..edge, near]);
    let slight = prop_oneof![Just(0.0), Just(1e-17), Just(-1e-17), Just(-1e-9), -1e-5..1e-5_f64];
    let steep = prop_oneof![Just(1.0), Just(-1.0), -1.0..1.0_f64];
    let towards = prop::array::uniform3(prop_oneof![2 => steep, 1 => slight]);
    let ray = (through, towards).prop_filter_map("no direction", |(at, to)| {
        (DVec3::from_array(to).length() > 1e-3).then(|| ray(at, to))
    });
    prop::collection::vec(ray, 1..20)
}

/// What single rays find, with their accounts.
fn accounted(setting: &Setting<'_>, rays: &[LocalRay]) -> Vec<RayError> {
    let account = |ray| {
        let (mut state, mut error) = (RayState::default(), RayError::default());
        let beam = Beam::alone(0.0);
        march(&setting.passage, ray, &setting.light, &mut state, Some((&mut error, &beam)));
        error
    };
    rays.iter().map(account).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 512, ..ProptestConfig::default() })]

    #[test]
    fn packets_are_off_by_no_more_than_they_say(
        rays in rays(),
        place in 0..BRICKS.len(),
        number in 0..7usize,
        void in prop::option::of(any::<u64>()),
    ) {
        let function = function(number);
        let exact = TransferPieces::new(&function, |_| 0.0);
        let brick = brick(BRICKS[place], void, &exact, truth());
        let setting = Setting::new(&brick, DrawnNeighbours::ALL, &exact, &function, 1e-3);
        let found = setting.together(&rays, Width::best(), Care::Rough);
        prop_assert!(found.is_fit);
        setting.check(&rays, &found)?;
        prop_assert!(!setting.together(&rays, Width::best(), Care::Fine).is_fit);
    }

    #[test]
    fn regions_may_end_within_cells(
        rays in rays(),
        number in 0..7usize,
        lo in prop::array::uniform3(0.0..4.0_f64),
        hi in prop::array::uniform3(prop_oneof![Just(8.0), Just(5.0), 4.0..8.0_f64]),
    ) {
        let function = function(number);
        let exact = TransferPieces::new(&function, |_| 0.0);
        let brick = brick(BRICKS[2], None, &exact, truth());
        let mut setting = Setting::new(&brick, DrawnNeighbours::ALL, &exact, &function, 1e-3);
        (setting.passage.region.lo, setting.passage.region.hi) = (lo, hi);
        let found = setting.together(&rays, Width::best(), Care::Rough);
        setting.check(&rays, &found)?;
    }

    #[test]
    fn neither_width_nor_company_shows(rays in rays(), place in 0..BRICKS.len(), number in 0..7usize) {
        let function = function(number);
        let exact = TransferPieces::new(&function, |_| 0.0);
        let brick = brick(BRICKS[place], Some(3), &exact, truth());
        let setting = Setting::new(&brick, DrawnNeighbours::ALL, &exact, &function, 1e-3);
        let expected = setting.together(&rays, Width::Portable, Care::Rough);
        for width in Width::all() {
            let found = setting.together(&rays, width, Care::Rough);
            prop_assert_eq!(found.samples, expected.samples);
            for (found, expected) in found.states.iter().zip(&expected.states) {
                for c in 0..3 {
                    let off = (found.radiance[c] - expected.radiance[c]).abs();
                    prop_assert!(off <= 2e-6 * expected.light(), "{:?}: {}", width, off);
                }
                prop_assert!((found.opacity() - expected.opacity()).abs() <= 1e-6);
            }
            for (n, ray) in rays.iter().enumerate() {
                let alone = setting.together(&[*ray], width, Care::Rough);
                prop_assert_eq!(alone.states[0], found.states[n]);
                prop_assert_eq!(alone.errors[0], found.errors[n]);
            }
        }
    }
}

/// Rays without any order, none of them close to a plane all the way.
fn usual(count: u32) -> Vec<LocalRay> {
    let random = |n: u32, c: i128| rough(n, [c, 2, 3]);
    let at = |n, c| random(n, c) * f64::from(EDGE);
    let to = |n, c| random(n, c) - 0.5;
    (0..count).map(|n| ray([0, 1, 2].map(|c| at(n, c)), [10, 11, 12].map(|c| to(n, c)))).collect()
}

/// Most rays are off by little, as they say, also where cells are opaque; and f32 does show.
#[test]
fn bounds_are_small() {
    const COUNT: u32 = 2000;
    let rays = usual(COUNT);
    for (function, opaque) in [(smooth(), false), (shells(), false), (fog(), true), (wall(), true)]
    {
        let exact = TransferPieces::new(&function, |_| 0.0);
        let brightest = exact.brightest().min(LONGEST * exact.largest_emission());
        let brick = brick(BRICKS[2], None, &exact, truth());
        let setting = Setting::new(&brick, DrawnNeighbours::ALL, &exact, &function, 1e-3);
        let found = setting.together(&rays, Width::best(), Care::Rough);
        let [off, _] = setting.check(&rays, &found).unwrap();
        assert!(off > 1e-9, "{off:e}");
        let bounds = found.states.iter().zip(&found.errors).map(|(state, error)| {
            error.shares(state.radiance, state.opacity(), brightest, 0.0).quadrature
        });
        let small = bounds.filter(|bound| *bound < 3e-4 * brightest).count() as u32;
        assert!(small >= COUNT * if opaque { 90 } else { 99 } / 100, "{small}");
    }
}

/// What lies beneath, and what is not stored exactly, count at least as for single rays.
#[test]
fn other_causes_are_accounted_for() {
    let extrema = FieldExtrema { minimum: 0.0, maximum: 1.0, smallest_positive: Some(0.1) };
    let mapping = Mapping::new(Scale::Linear, Some([0.0, 1.0]), extrema, 1.0).unwrap();
    let (residual, storage) = (f64::INFINITY, mapping.rounding(1e-7, 0.0));
    let far = Distance {
        is_rounded: false,
        residual,
        child_mask: 0xff,
        fills_void: false,
        tree: [0.0, 1.0],
        storage,
        leaf_storage: storage,
    };
    let rays = usual(500);
    for function in [smooth(), glowing(), shells(), steps()] {
        let exact = TransferPieces::new(&function, |_| 0.0);
        let brick = brick(BRICKS[2], None, &exact, far);
        // Where nothing is little, storage is known group by group.
        for allowed in [1e-9, 1e9] {
            let mut setting =
                Setting::new(&brick, DrawnNeighbours::ALL, &exact, &function, allowed);
            setting.passage.hides = true;
            let found = setting.together(&rays, Width::best(), Care::Rough);
            assert!(found.is_fit);
            let mut stored = 0.0;
            for (found, expected) in found.errors.iter().zip(accounted(&setting, &rays)) {
                assert!(
                    covers(&found.causes.levels, &expected.causes.levels),
                    "{found:?} {expected:?}"
                );
                assert!(
                    covers(&found.causes.storage, &expected.causes.storage),
                    "{found:?} {expected:?}"
                );
                assert!(expected.causes.levels.emission > 0.0);
                stored += expected.causes.storage.emission;
            }
            assert!(stored > 1e-7, "{stored:e}");
        }
    }
}

/// What a square's other rays see differently is as much as single rays' accounts say, wherever these
/// are apart, and beside nothing.
#[test]
fn squares_are_accounted_for_as_by_single_rays() {
    let rays = usual(400);
    for (function, void) in
        [(smooth(), None), (glowing(), Some(5)), (shells(), None), (fog(), Some(6))]
    {
        let exact = TransferPieces::new(&function, |_| 0.0);
        let most = LONGEST * exact.largest_emission();
        let brick = brick(BRICKS[2], void, &exact, truth());
        let setting = Setting::new(&brick, DrawnNeighbours::ALL, &exact, &function, 1e-3);
        for width in [1e-3, 0.05, 0.4, 1.5] {
            let beam = Beam { spread: [width, 0.7 * width, 0.3 * width], ..Beam::alone(0.0) };
            let beams = vec![beam; rays.len()];
            let accounts = Accounts::Squares(&beams);
            let found = setting.together_as(&rays, Width::best(), Care::Rough, accounts);
            assert!(found.is_fit);
            let mut some = 0;
            for (found, ray) in found.errors.iter().zip(&rays) {
                let (mut state, mut error) = (RayState::default(), RayError::default());
                march(&setting.passage, ray, &setting.light, &mut state, Some((&mut error, &beam)));
                for (found, expected) in
                    [(found.farthest, error.farthest), (found.uneven, error.uneven)]
                {
                    assert!(covers(&found, &expected), "{width}: {found:?} {expected:?}");
                    let limit = 1.01 * expected.emission + 1e-4 * most;
                    assert!(found.emission <= limit, "{width}: {found:?} {expected:?}");
                    some += u32::from(expected.emission > 1e-3 * most);
                }
            }
            assert!(some > 20, "{width}: {some}");
        }
    }
}

/// Others of a wide square may be where levels beneath make more of a difference than at its centre.
#[test]
fn wide_squares_take_levels_of_all_groups() {
    let exact = TransferPieces::new(&smooth(), |_| 0.0);
    // Only beneath one corner of the brick there are finer levels.
    let far = Distance { residual: 0.02, child_mask: 1, ..truth() };
    let data = TestData::one_level(rough);
    for interpolation in [Interpolation::Cell, Interpolation::Linear] {
        let mut brick = data.brick(0, [0; 3], 16, interpolation);
        brick.survey(&exact.all, &far, &mut Surveyor::default());
        let mut setting = Setting::new(&brick, DrawnNeighbours::ALL, &exact, &smooth(), 1.0);
        (setting.passage.region.hi, setting.passage.hides) = ([16.0, 12.0, 16.0], true);
        let rays = [ray([14.5, 10.3, 8.0], [0.01, 0.02, 1.0])];
        for (width, has_levels) in [(0.3, false), (1.5, true)] {
            let beam = Beam { spread: [width; 3], ..Beam::alone(0.0) };
            let accounts = Accounts::Squares(std::slice::from_ref(&beam));
            let found = setting.together_as(&rays, Width::best(), Care::Rough, accounts);
            let (mut state, mut error) = (RayState::default(), RayError::default());
            let account = Some((&mut error, &beam));
            march(&setting.passage, &rays[0], &setting.light, &mut state, account);
            let levels = found.errors[0].causes.levels;
            assert!(found.is_fit && (levels.emission > 0.0) == has_levels, "{width}: {levels:?}");
            assert!(covers(&levels, &error.causes.levels), "{width}: {levels:?} {error:?}");
        }
    }
}

/// Whether the first sums are not below the second.
fn covers(found: &Sums, expected: &Sums) -> bool {
    let is_above = |found: f64, expected: f64| found >= expected * (1.0 - 1e-3);
    is_above(found.emission, expected.emission) && is_above(found.dimmed, expected.dimmed)
}

/// What a step changes is a matter of single cells where it is as near as rounding.
#[test]
fn values_at_steps_are_left_to_single_rays() {
    let value = f64::from(TestData::new(rough).value(2, [20, 14, 22]));
    let near = |x: f64| {
        let function = transfer(&[(x, 0.0), (x, 2.0)], &[(0.0, 1.0)]);
        let exact = TransferPieces::new(&function, |_| 0.0);
        let brick = brick((2, [2, 1, 2]), None, &exact, truth());
        let setting = Setting::new(&brick, DrawnNeighbours::ALL, &exact, &function, 1.0);
        setting.together(&usual(4), Width::best(), Care::Rough).is_fit
    };
    assert!(!near(value) && near(value + 1e-9));
}
