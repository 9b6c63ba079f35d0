//! Rays that take from proxies, against rays that are marched one by one.

use proptest::prelude::*;

use super::*;
use crate::render::brick::interpolant::DrawnNeighbours;
use crate::render::camera::view::Basis;
use crate::render::march::packet_tests::{EDGE, LONGEST, Setting, WIDTH, surveyed};
use crate::render::march::ray_tests::{shells, smooth};
use crate::render::testing::data::{BRICKS, TestData, bent, linear, rough};
use crate::render::testing::scene::{scene, view};
use crate::render::transfer::pieces::TransferPieces;
use crate::space::Twofold;

/// Pixels of the picture, and of the tile in its middle.
const PICTURE: u32 = 1024;
const SIDE: u32 = 64;
const WHOLE: PixelRect = PixelRect { lo: [PICTURE / 2; 2], hi: [PICTURE / 2 + SIDE; 2] };

/// A brick of cells of a `width` in front of all pixels of a tile, of which one is `pixel` cells wide at
/// its middle. Of an orthographic view the pixels say how wide cells are.
fn frame(
    grid: &PixelGrid,
    at: [f64; 3],
    along: DVec3,
    pixel: f64,
    width: f64,
    is_perspective: bool,
) -> Frame {
    let (right, up) = along.any_orthonormal_pair();
    let basis = Basis { forward: along, right, up };
    let cell_width = DVec3::splat(width);
    let depth = if is_perspective { pixel * width / grid.pixel_size().x } else { 1.0 };
    Frame {
        anchor: DVec3::from_array(at),
        start_units: [0; 3],
        cells_per_unit: 1.0,
        depth,
        cell_width: if is_perspective {
            cell_width
        } else {
            grid.pixel_size().x / pixel * DVec3::ONE
        },
        cells_per_length: if is_perspective {
            cell_width.recip()
        } else {
            (grid.pixel_size().x / pixel * DVec3::ONE).recip()
        },
        units_per_length: [Twofold::default(); 3],
        basis,
        is_perspective,
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn rays_are_off_by_no_more_than_they_say(
        (number, kind, is_shell) in (0..BRICKS.len(), 0..3_usize, any::<bool>()),
        at in prop::array::uniform3(1.0..7.0_f64),
        along in prop::array::uniform3(-1.0..1.0_f64),
        (pixel, is_perspective) in ((-9.0..-0.5_f64).prop_map(f64::exp), any::<bool>()),
        // How often rays come through the brick, one after the other.
        (times, thinner) in (1..5_u32, (-9.0..0.0_f64).prop_map(f64::exp)),
        limit in (-16.0..2.0_f64).prop_map(f64::exp),
    ) {
        let along = DVec3::from_array(along).try_normalize();
        prop_assume!(along.is_some());
        let data = TestData::new([linear, rough, bent][kind]);
        let function = if is_shell { shells() } else { smooth() };
        let exact = TransferPieces::new(&function, |_| 0.0);
        let brick = surveyed(&data, BRICKS[number], &exact);
        let setting = Setting::new(&brick, DrawnNeighbours::ALL, &exact, &function, 0.01);
        let scene = scene("samples = 1", PICTURE, PICTURE);
        let grid = PixelGrid::new(&view(&scene), scene.render.samples);
        let frame = frame(&grid, at, along.unwrap(), pixel, WIDTH * thinner, is_perspective);
        let edge = DVec3::splat(f64::from(EDGE));
        let Some(footprint) = frame.footprint(DVec3::ZERO, edge) else { return Ok(()) };
        let part = Part { passage: setting.passage, frame, footprint };
        let mut squares = Vec::new();
        grid.first_squares(&WHOLE, &mut squares);
        let mut batch = RayBatch::new(0);
        batch.start(&grid, WHOLE, &squares, false);
        // The frame's projection is not always the picture's own.
        for aim in &mut batch.aims {
            aim.length = frame.ray(aim.plane).length;
        }
        // What rays have met in front of the brick differs from ray to ray.
        for (n, state) in batch.states.iter_mut().enumerate() {
            state.absorb((n % 7) as f64 / 8.0);
        }
        let before = batch.states.clone();
        let care = Care::Rough;
        let thinning = Thinning { pieces: &exact.all, limit, room: 2.0 * limit, behind: 1.0 };
        let light = &setting.light;
        for _ in 0..times {
            let open = batch.open_rays(&WHOLE);
            let thinning = Some(thinning);
            let settings = Settings { light, grid: &grid, accounts: true, care, thinning };
            batch.draw_part(&part, &WHOLE, settings, open);
            prop_assert!(batch.served.iter().all(|bits| *bits == 0));
        }
        batch.settle(light);
        prop_assert!(batch.served.iter().all(|bits| *bits == 0));
        let rays: Vec<_> = batch.aims.iter().map(|aim| frame.ray_of(aim)).collect();
        let longest = LONGEST * f64::from(times);
        let brightest = exact.brightest().min(longest * exact.largest_emission());
        let truths = setting.alone(&rays);
        for (n, truth) in truths.iter().enumerate() {
            let (state, error, front) = (&batch.states[n], &batch.errors[n], before[n].transmittance);
            let bound = error.shares(state.radiance, state.opacity(), brightest, 0.0).total();
            let through = |times: u32| front * truth.transmittance.powi(times as i32);
            let opacity = 1.0 - through(times);
            let seen: f64 = (0..times).map(through).sum();
            let off = (0..3)
                .map(|c| (state.radiance[c] - seen * truth.radiance[c]).abs())
                .fold((state.opacity() - opacity).abs(), f64::max);
            prop_assert!(off <= bound + 1e-9, "{n}: off {off:e}, bound {bound:e}");
        }
    }
}

/// A brick of cells of a `width`, a thousand pixels each, and the tile's rays.
fn zoomed<'s>(grid: &PixelGrid, setting: &Setting<'s>, width: f64) -> (Part<'s>, Vec<Square>) {
    let frame = frame(grid, [4.0; 3], DVec3::new(0.6, 0.64, 0.48), 1e-3, width, true);
    let footprint = frame.footprint(DVec3::ZERO, DVec3::splat(f64::from(EDGE))).unwrap();
    let mut squares = Vec::new();
    grid.first_squares(&WHOLE, &mut squares);
    (Part { passage: setting.passage, frame, footprint }, squares)
}

#[test]
fn smooth_bricks_take_few_rays() {
    let data = TestData::new(linear);
    let exact = TransferPieces::new(&smooth(), |_| 0.0);
    let brick = surveyed(&data, BRICKS[0], &exact);
    let setting = Setting::new(&brick, DrawnNeighbours::ALL, &exact, &smooth(), 0.01);
    let scene = scene("samples = 1", PICTURE, PICTURE);
    let grid = PixelGrid::new(&view(&scene), scene.render.samples);
    let (part, squares) = zoomed(&grid, &setting, WIDTH);
    let draw = |limit: Option<f64>| {
        let mut batch = RayBatch::new(0);
        batch.start(&grid, WHOLE, &squares, false);
        let thinning = limit.map(|limit| Thinning {
            pieces: &exact.all,
            limit,
            room: 2.0 * limit,
            behind: 1.0,
        });
        let open = thinning.map_or(Open::default(), |_| batch.open_rays(&WHOLE));
        let (light, care) = (&setting.light, Care::Rough);
        let settings = Settings { light, grid: &grid, accounts: true, care, thinning };
        let samples = batch.draw_part(&part, &WHOLE, settings, open);
        batch.settle(light);
        (samples, batch.states[SIDE as usize + 1].radiance)
    };
    let (all, found) = draw(None);
    let (few, taken) = draw(Some(1.0));
    assert!(few * 128 <= all, "{few} of {all}");
    assert!((found[0] - taken[0]).abs() < 1e-4 * found[0], "{found:?} {taken:?}");
    assert_eq!(draw(Some(1e-9)), (all, found));
}

#[test]
fn what_corners_gather_in_bricks_in_a_row_adds_up() {
    let data = TestData::new(linear);
    let exact = TransferPieces::new(&smooth(), |_| 0.0);
    let brick = surveyed(&data, BRICKS[0], &exact);
    let setting = Setting::new(&brick, DrawnNeighbours::ALL, &exact, &smooth(), 0.01);
    let scene = scene("samples = 1", PICTURE, PICTURE);
    let grid = PixelGrid::new(&view(&scene), scene.render.samples);
    let (part, squares) = zoomed(&grid, &setting, 0.01 * WIDTH);
    let mut batch = RayBatch::new(0);
    let mut draw = |times: i32| {
        batch.start(&grid, WHOLE, &squares, false);
        let thinning = Some(Thinning { pieces: &exact.all, limit: 1.0, room: 2.0, behind: 1.0 });
        for _ in 0..times {
            let open = batch.open_rays(&WHOLE);
            let (light, care) = (&setting.light, Care::Rough);
            let settings = Settings { light, grid: &grid, accounts: true, care, thinning };
            batch.draw_part(&part, &WHOLE, settings, open);
            assert_eq!(batch.proxies.kept.len(), CORNERS);
            assert_eq!(batch.states[77], RayState::default());
        }
        batch.settle(&setting.light);
        let (state, error) = (batch.states[77], &batch.errors[77]);
        let bound = error.shares(state.radiance, state.opacity(), 1.0, 0.0).total();
        (state, bound, batch.aims[77].plane)
    };
    let ((one, bound_of_one, plane), (three, bound, _)) = (draw(1), draw(3));
    let truth = setting.alone(&[part.frame.ray(plane)])[0];
    assert!((0.97..0.999).contains(&one.transmittance));
    for (ray, slack) in [(one, 1e-4 * one.radiance[0]), (truth, bound)] {
        let through = |times: i32| ray.transmittance.powi(times);
        let seen: f64 = (0..3).map(through).sum();
        for c in 0..3 {
            assert!((three.radiance[c] - seen * ray.radiance[c]).abs() < slack);
        }
        assert!((three.opacity() - (1.0 - through(3))).abs() < slack);
    }
    assert!(bound > 2.9 * bound_of_one && bound < 4.0 * bound_of_one);
}

#[test]
fn lattices_hold_each_pixel_once() {
    let tile = PixelRect { lo: [64, 128], hi: [128, 150] };
    for (pixels, apart) in
        [([70, 75, 129, 150], 4), ([64, 128, 128, 150], 64), ([127, 128, 149, 150], 8)]
    {
        let [x, y, z, w] = pixels;
        let pixels = PixelRect { lo: [x, z], hi: [y, w] };
        let lattice = Lattice::over(&tile, &pixels, apart);
        for (column, row) in pixels.rows().flat_map(|y| pixels.columns().map(move |x| (x, y))) {
            let place = [f64::from(column) + 0.5, f64::from(row) + 0.5];
            let holding: Vec<_> = lattice
                .blocks()
                .filter(|block| {
                    let PixelRect { lo, hi } = lattice.pixels(*block);
                    (lo[0]..hi[0]).contains(&column) && (lo[1]..hi[1]).contains(&row)
                })
                .collect();
            assert_eq!(holding.len(), 1);
            let corners = lattice.corners(holding[0]).map(|corner| lattice.place(corner));
            assert!(corners[0].iter().zip(&place).all(|(a, b)| a < b));
            assert!(corners[3].iter().zip(&place).all(|(a, b)| a > b));
            assert_eq!([corners[1][0], corners[2][1]], corners[3]);
        }
    }
}
