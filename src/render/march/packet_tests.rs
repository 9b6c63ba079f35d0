//! Packets against the exact march of single rays.

use glam::DVec3;
use proptest::prelude::*;

use super::packets::{Accounts, Packets, Rays, TileRay};
use super::ray::{Beam, Light, march};
use super::ray_state::{Ending, RayState};
use super::ray_tests::{shells, smooth, steps, transfer};
use crate::lanes::{MOST_LANES, Width};
use crate::render::bounds::grade::{Care, PacketTransfer};
use crate::render::bounds::ray_error::RayError;
use crate::render::brick::interpolant::DrawnNeighbours;
use crate::render::brick::passage::{Passage, Region};
use crate::render::brick::scaled::ScaledBrick;
use crate::render::brick::steepness::Surveyor;
use crate::render::camera::frame::LocalRay;
use crate::render::testing::data::{BRICKS, TestCut, TestData, UNTIDY_BRICKS, linear, rough};
use crate::render::transfer::distance::Distance;
use crate::render::transfer::pieces::TransferPieces;
use crate::render::transfer::table::TransferTable;
use crate::scene::{Interpolation, TransferFunction};

pub(crate) const EDGE: u32 = 8;
/// Width of cells, code length.
pub(crate) const WIDTH: f64 = 0.1;
/// Longer than any way through a brick.
pub(crate) const LONGEST: f64 = 30.0 * WIDTH;

pub(crate) fn surveyed(
    data: &TestData,
    (level, at): (u32, [i128; 3]),
    pieces: &TransferPieces,
) -> ScaledBrick {
    let mut brick = data.brick(level, at, EDGE, Interpolation::Linear);
    brick.survey(&pieces.all, &Distance::none([0.0, 1.0]), &mut Surveyor::default());
    brick
}

/// What packets, or single rays, find of `rays`.
pub(crate) struct Found {
    pub(super) states: Vec<RayState>,
    pub(super) errors: Vec<RayError>,
    pub(super) samples: u64,
    pub(super) is_fit: bool,
}

pub(crate) struct Setting<'s> {
    pub(crate) passage: Passage<'s>,
    exact: &'s TransferPieces,
    pub(crate) light: Light<'s>,
}

impl<'s> Setting<'s> {
    pub(crate) fn new(
        brick: &'s ScaledBrick,
        drawn: DrawnNeighbours,
        exact: &'s TransferPieces,
        transfer: &TransferFunction,
        allowed: f64,
    ) -> Self {
        let close = TransferPieces::new(transfer, |_| 0.01 * allowed / LONGEST);
        let table = TransferTable::new(&exact.all, &close.merged);
        let (allowed, longest) = (Some(allowed), LONGEST);
        let packets = Some(PacketTransfer::new(table, close, allowed, 1.0, longest));
        let ending = Ending::new(LONGEST * exact.largest_emission(), 0.0);
        let region = Region { lo: [0.0; 3], hi: [f64::from(EDGE); 3], ends: 0 };
        let passage = Passage { brick, region, drawn, hides: false };
        Self { passage, exact, light: Light { pieces: &exact.all, ending, packets } }
    }

    pub(crate) fn alone(&self, rays: &[LocalRay]) -> Vec<RayState> {
        let mut states = vec![RayState::default(); rays.len()];
        for (ray, state) in rays.iter().zip(&mut states) {
            march(&self.passage, ray, &self.light, state, None);
        }
        states
    }

    pub(super) fn together(&self, rays: &[LocalRay], width: Width, care: Care) -> Found {
        self.together_as(rays, width, care, Accounts::Alone(0.0))
    }

    /// Rays that stand for what `accounts` says.
    pub(super) fn together_as(
        &self,
        rays: &[LocalRay],
        width: Width,
        care: Care,
        accounts: Accounts<'_>,
    ) -> Found {
        let mut packets = Packets::of(width);
        let mut states = vec![RayState::default(); rays.len()];
        let mut errors = vec![RayError::default(); rays.len()];
        let (diagonal, has_squares) =
            (3.0_f64.sqrt() * WIDTH, matches!(accounts, Accounts::Squares(_)));
        let is_fit = packets.enter(&self.passage, &self.light, diagonal, care, has_squares);
        let mut samples = 0;
        if is_fit {
            let mut gathered = Rays { states: &mut states, errors: &mut errors };
            let tile_ray = |(index, &ray)| TileRay { index, ray };
            let rays: Vec<_> = rays.iter().enumerate().map(tile_ray).collect();
            samples += packets.march(&self.passage, &self.light, &rays, accounts, &mut gathered);
        }
        Found { states, errors, samples, is_fit }
    }

    /// Checks that rays are off by no more than their accounts say; returns the largest difference
    /// and the largest bound.
    pub(super) fn check(
        &self,
        rays: &[LocalRay],
        found: &Found,
    ) -> Result<[f64; 2], TestCaseError> {
        let mut largest = [0.0_f64; 2];
        let brightest = self.exact.brightest().min(LONGEST * self.exact.largest_emission());
        for ((state, error), exact) in found.states.iter().zip(&found.errors).zip(self.alone(rays))
        {
            let shares = error.shares(state.radiance, state.opacity(), brightest, 0.0);
            let bound = shares.quadrature + shares.storage + shares.rounding;
            let off = (0..3)
                .map(|c| (state.radiance[c] - exact.radiance[c]).abs())
                .fold((state.opacity() - exact.opacity()).abs(), f64::max);
            prop_assert!(off <= bound + 1e-9 * state.light(), "off {off:e}, bound {bound:e}");
            largest = [largest[0].max(off), largest[1].max(bound)];
        }
        Ok(largest)
    }
}

/// Rays through a point of the brick.
pub(super) fn rays() -> impl Strategy<Value = Vec<LocalRay>> {
    let through = prop::array::uniform3(0.0..f64::from(EDGE));
    let towards = prop::array::uniform3(prop_oneof![4 => -1.0..1.0_f64, 1 => Just(0.0)]);
    let ray = (through, towards).prop_filter_map("no direction", |(at, to)| {
        let direction = DVec3::from_array(to);
        (direction.length() > 1e-3).then(|| LocalRay {
            origin: DVec3::from_array(at) - direction * 3.0,
            direction,
            length: WIDTH * direction.length(),
            sigma_min: f64::NEG_INFINITY,
        })
    });
    prop::collection::vec(ray, 1..20)
}

/// As many rays as there are lanes, close to each other.
fn beside(ray: &LocalRay) -> Vec<LocalRay> {
    let moved = |n: usize| LocalRay { origin: ray.origin + 1e-3 * n as f64, ..*ray };
    (0..MOST_LANES).map(moved).collect()
}

pub(super) fn glowing() -> TransferFunction {
    transfer(&[(0.0, 0.0)], &[(0.0, 0.0), (0.4, 0.2), (1.0, 2.0)])
}

fn function(number: usize) -> TransferFunction {
    [smooth, glowing, shells, steps][number % 4]()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 192, ..ProptestConfig::default() })]

    #[test]
    fn packets_are_off_by_no_more_than_they_say(
        rays in rays(),
        place in 0..BRICKS.len(),
        number in 0..4usize,
        is_rough in any::<bool>(),
        allowed in prop_oneof![Just(1e-4), Just(1e-2), Just(1.0)],
    ) {
        let data = TestData::new(if is_rough { rough } else { linear });
        let (level, at) = BRICKS[place];
        let function = function(number);
        let exact = TransferPieces::new(&function, |_| 0.0);
        let brick = surveyed(&data, (level, at), &exact);
        let setting = Setting::new(&brick, DrawnNeighbours::ALL, &exact, &function, allowed);
        for care in [Care::Rough, Care::Fine] {
            let found = setting.together(&rays, Width::best(), care);
            if found.is_fit {
                setting.check(&rays, &found)?;
            }
        }
    }

    #[test]
    fn beside_what_a_cut_leaves_out_too(rays in rays(), place in 0..BRICKS.len()) {
        let data = TestData::new(rough);
        let cut = TestCut::new(&data, EDGE, |level, at| level < 2 || at[1] < 3 && at[2] < 4);
        let (level, at) = BRICKS[place];
        let exact = TransferPieces::new(&glowing(), |_| 0.0);
        let brick = surveyed(&data, (level, at), &exact);
        let setting = Setting::new(&brick, cut.drawn(level, at), &exact, &glowing(), 1.0);
        let found = setting.together(&rays, Width::best(), Care::Rough);
        prop_assert!(found.is_fit);
        setting.check(&rays, &found)?;
    }

    /// Where rays end in the face of a cell, rounding decides on which side.
    #[test]
    fn a_domain_may_end_in_a_face_of_dual_cells(
        rays in prop::collection::vec(rays(), 8),
        upper in any::<bool>(),
    ) {
        let exact = TransferPieces::new(&smooth(), |_| 0.0);
        let brick = surveyed(&TestData::new(rough), BRICKS[2], &exact);
        let mut setting = Setting::new(&brick, DrawnNeighbours::ALL, &exact, &smooth(), 1.0);
        let faces = if upper { [0.0, 3.5] } else { [4.5, f64::from(EDGE)] };
        (setting.passage.region.lo, setting.passage.region.hi) = ([faces[0]; 3], [faces[1]; 3]);
        let rays = rays.concat();
        let found = setting.together(&rays, Width::best(), Care::Rough);
        setting.check(&rays, &found)?;
    }

    /// Which rays are in the lanes beside it changes nothing, be they in the same cells or not.
    #[test]
    fn every_lane_is_on_its_own(
        rays in rays(),
        are_close in any::<bool>(),
        place in 0..UNTIDY_BRICKS.len(),
        number in 0..4usize,
        width in prop_oneof![Just(None), (0.01..1.5_f64).prop_map(Some)],
        care in prop_oneof![Just(Care::Rough), Just(Care::Fine)],
        hides in any::<bool>(),
    ) {
        let data = TestData::new(rough);
        let rays = if are_close { beside(&rays[0]) } else { rays };
        let cut = TestCut::new(&data, EDGE, |level, at| level < 2 || at[1] < 3 && at[2] < 4);
        let function = function(number);
        let exact = TransferPieces::new(&function, |_| 0.0);
        let (level, at) = UNTIDY_BRICKS[place];
        let brick = surveyed(&data, (level, at), &exact);
        let mut setting = Setting::new(&brick, cut.drawn(level, at), &exact, &function, 1.0);
        setting.passage.hides = hides;
        let beam = Beam {
            spread: [width.unwrap_or(0.0); 3],
            bend: [0.1 * width.unwrap_or(0.0); 3],
            angle: 1e-3,
            advance: [WIDTH; 3],
            depth: 1.0,
            covered: 1.0,
        };
        let beams = vec![beam; rays.len()];
        let accounts = |count: usize| match width {
            Some(_) => Accounts::Squares(&beams[..count]),
            None => Accounts::Alone(0.0),
        };
        for width in Width::all() {
            let all = setting.together_as(&rays, width, care, accounts(rays.len()));
            prop_assert!(all.is_fit || number > 1);
            for (n, ray) in rays.iter().enumerate() {
                let alone = setting.together_as(&[*ray], width, care, accounts(1));
                prop_assert_eq!(all.states[n], alone.states[0], "{:?}, ray {}", width, n);
                prop_assert_eq!(all.errors[n], alone.errors[0], "{:?}, ray {}", width, n);
            }
        }
    }

    #[test]
    fn all_widths_agree(rays in rays(), place in 0..BRICKS.len()) {
        let data = TestData::new(rough);
        let exact = TransferPieces::new(&smooth(), |_| 0.0);
        let brick = surveyed(&data, BRICKS[place], &exact);
        let setting = Setting::new(&brick, DrawnNeighbours::ALL, &exact, &smooth(), 1.0);
        let expected = setting.together(&rays, Width::Portable, Care::Rough);
        for width in Width::all() {
            let found = setting.together(&rays, width, Care::Rough);
            prop_assert_eq!(found.samples, expected.samples);
            for (found, expected) in found.states.iter().zip(&expected.states) {
                for c in 0..3 {
                    let off = (found.radiance[c] - expected.radiance[c]).abs();
                    prop_assert!(off <= 1e-6 * expected.light(), "{:?}: {}", width, off);
                }
                let off = (found.opacity() - expected.opacity()).abs();
                prop_assert!(off <= 1e-6);
            }
        }
    }
}

#[test]
fn more_care_means_a_smaller_bound_and_packets_do_pass() {
    let exact = TransferPieces::new(&smooth(), |_| 0.0);
    let ray = |n: u32| LocalRay {
        origin: DVec3::new(-1.0, 0.3 * f64::from(n), 2.0),
        direction: DVec3::new(1.0, 0.13, 0.4),
        length: WIDTH * DVec3::new(1.0, 0.13, 0.4).length(),
        sigma_min: f64::NEG_INFINITY,
    };
    let rays: Vec<_> = (0..20).map(ray).collect();
    for (place, is_rough) in BRICKS.into_iter().flat_map(|place| [(place, true), (place, false)]) {
        let data = TestData::new(if is_rough { rough } else { linear });
        let brick = surveyed(&data, place, &exact);
        let setting = Setting::new(&brick, DrawnNeighbours::ALL, &exact, &smooth(), 0.03);
        let [once, more] = [Care::Rough, Care::Fine].map(|care| {
            let found = setting.together(&rays, Width::best(), care);
            assert!(found.is_fit && found.samples > 0);
            setting.check(&rays, &found).unwrap()
        });
        let less = if is_rough { 0.5 } else { 1.0 };
        assert!(more[1] <= less * once[1], "{place:?}: {once:?} {more:?}");
        // Of values without any order, and of a linear field.
        let limits = if is_rough { [2e-2, 10.0] } else { [1e-3, 0.1] };
        assert!(once[0] < limits[0] && once[1] < limits[1], "{place:?}: {once:?}");
    }
}

#[test]
fn depths_beyond_f32_are_left_to_single_rays() {
    let points = [(0.0, 0.0), (0.5, 0.0), (1.0, 1e29)];
    let function = transfer(&points, &[(0.0, 0.0), (1.0, 1.0)]);
    let exact = TransferPieces::new(&function, |_| 0.0);
    let brick = surveyed(&TestData::new(|_, _| 0.25), BRICKS[2], &exact);
    let setting = Setting::new(&brick, DrawnNeighbours::ALL, &exact, &function, 1.0);
    let mut packets = Packets::new();
    // Nothing absorbs at the values that are met, so that the table alone decides.
    let mut enter =
        |width: f64| packets.enter(&setting.passage, &setting.light, width, Care::Rough, false);
    assert!(enter(1.0) && !enter(100.0));
}
