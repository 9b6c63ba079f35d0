use std::iter::from_fn;

use proptest::prelude::*;

use super::*;
use crate::render::bounds::shares::LIKELY_OF_BOUND;
use crate::render::plan::cut::ErrorCut;
use crate::render::testing::scene::{scene, view};

const TOLERANCE: f64 = 1e-3;

/// How far rays are off, by how large their squares are and what their cut allows.
#[derive(Debug, Clone)]
struct Errors {
    /// Of each pixel in turn, for its whole area, parts of the tolerance.
    area: Vec<f64>,
    /// How fast that falls with the square's width.
    order: i32,
    /// Parts of the cut's limits.
    levels: f64,
    digits: f64,
    /// What nothing changes, parts of the tolerance.
    fixed: f64,
}

impl Errors {
    fn of(&self, square: &Square, cut: &Cut) -> ErrorShares {
        let number = usize::from(square.pixel) % self.area.len();
        // Unlike from place to place.
        let place = 1.0 + (37.0 * square.centre[0] + 17.0 * square.centre[1]).sin();
        let width = (2.0 * square.half()).powi(self.order);
        let [levels, digits] = match cut {
            Cut::Error(cut) => [self.levels * cut.limit, self.digits * cut.digits.unwrap_or(0.0)],
            _ => [0.0; 2],
        };
        ErrorShares {
            levels,
            digits,
            pixel_area: self.area[number] * TOLERANCE * width * place,
            rounding: self.fixed * TOLERANCE,
            ..ErrorShares::default()
        }
    }
}

/// Has a tile judge white rays of a batch.
fn judge(tile_pixels: &mut TilePixels, grid: &PixelGrid, batch: &Batch, errors: &Errors) {
    judge_by(tile_pixels, grid, batch, |square| errors.of(square, &batch.cut));
}

/// The same where squares are off by such shares.
fn judge_by(
    tile_pixels: &mut TilePixels,
    grid: &PixelGrid,
    batch: &Batch,
    shares: impl Fn(&Square) -> ErrorShares,
) {
    let outcome = |square: &Square| Found {
        square: *square,
        value: [1.0; 4],
        shares: shares(square).into(),
        uneven: None,
    };
    tile_pixels.judge(grid, batch, batch.squares.iter().map(outcome));
}

/// Draws a tile of white pixels; rays marched.
fn draw(tile_pixels: &mut TilePixels, samples: &str, goal: Goal, errors: &Errors) -> u64 {
    let scene = scene(&format!("samples = {samples}"), 9, 7);
    let grid = PixelGrid::new(&view(&scene), scene.render.samples);
    tile_pixels.start(&grid, grid.whole(), &Method::Within(goal));
    let mut rays = 0;
    while let Some(batch) = tile_pixels.next(&grid) {
        assert!(!batch.squares.is_empty() && batch.squares.len() <= BATCH_RAYS);
        assert!(batch.squares.is_sorted_by_key(|square| square.pixel));
        rays += batch.squares.len() as u64;
        judge(tile_pixels, &grid, &batch, errors);
    }
    rays
}

fn errors() -> impl Strategy<Value = Errors> {
    let area = prop::collection::vec((-3.0..1.0).prop_map(|p: f64| 10f64.powf(p)), 1..20);
    (area, 1..3, 0.0..40.0, 0.0..40.0, 0.0..0.5).prop_map(|(area, order, levels, digits, fixed)| {
        Errors { area, order, levels, digits, fixed }
    })
}

fn assert_whole(tile_pixels: &mut TilePixels) {
    assert!(tile_pixels.pixels.iter().all(|pixel| (pixel.weight - 1.0).abs() < 1e-9));
    assert!(tile_pixels.pixels().iter().flatten().all(|value| (value - 1.0).abs() < 1e-6));
}

fn goal(rays_per_pixel: u64, all_levels: bool) -> Goal {
    let (behind, alone_per_pixel) = (1.0, rays_per_pixel);
    let tolerance = TOLERANCE;
    Goal {
        tolerance,
        behind,
        rays_per_pixel,
        scouting_per_pixel: rays_per_pixel,
        alone_per_pixel,
        most_halvings: u8::MAX,
        least_halvings: 0,
        glint_halvings: 0,
        certifies: true,
        trusts_rays: false,
        power: 1.0,
        has_area: false,
        all_levels,
        sounds: false,
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn no_pixel_is_taken_above_its_allowance_while_rays_are_left(
        errors in errors(),
        all_levels in any::<bool>(),
    ) {
        let mut tile_pixels = TilePixels::default();
        draw(&mut tile_pixels, "\"area\"", goal(u64::MAX, all_levels), &errors);
        for pixel in &tile_pixels.pixels {
            let total = pixel.bound().total();
            prop_assert!(total <= TOLERANCE * (1.0 + 1e-9), "{total} {pixel:?}");
        }
        prop_assert!(tile_pixels.error().shares.total() <= TOLERANCE * (1.0 + 1e-9));
        assert_whole(&mut tile_pixels);
    }

    #[test]
    fn pixels_are_whole_and_say_their_error_when_rays_run_out(
        errors in errors(),
        most in 0..80_u64,
    ) {
        let mut tile_pixels = TilePixels::default();
        let rays = draw(&mut tile_pixels, "\"area\"", goal(most, false), &errors);
        // The batch in hand is marched.
        prop_assert!(rays < 63 * most.max(1) + BATCH_RAYS as u64, "{rays}, not {most} a pixel");
        assert_whole(&mut tile_pixels);
        let worst = tile_pixels.pixels.iter().map(|p| p.bound().total()).fold(0.0, f64::max);
        prop_assert_eq!(tile_pixels.error().shares.total(), worst);
    }

    #[test]
    fn rays_without_area_go_through_finer_levels(errors in errors()) {
        let errors = Errors { area: vec![0.0], ..errors };
        let mut tile_pixels = TilePixels::default();
        draw(&mut tile_pixels, "3", goal(u64::MAX, false), &errors);
        prop_assert!(tile_pixels.error().shares.total() <= TOLERANCE * (1.0 + 1e-9));
        assert_whole(&mut tile_pixels);
    }
}

#[test]
fn a_tile_that_is_good_enough_takes_one_ray_a_pixel() {
    let errors = Errors { area: vec![0.1], order: 1, levels: 1.0, digits: 1.0, fixed: 0.1 };
    let rays = draw(&mut TilePixels::default(), "\"area\"", goal(u64::MAX, false), &errors);
    assert_eq!(rays, 63);
}

#[test]
fn an_outlook_quarters_pixels_once_whatever_finer_levels_took() {
    // Each first ray is marched again and again for levels.
    let errors = Errors { area: vec![20.0], order: 2, levels: 30.0, digits: 1.0, fixed: 0.0 };
    let quartered = |rays_per_pixel: u64| {
        let goal = goal(rays_per_pixel, false);
        let outlook = Goal { most_halvings: 1, alone_per_pixel: 1, has_area: true, ..goal };
        let mut tile_pixels = TilePixels::default();
        draw(&mut tile_pixels, "\"area\"", outlook, &errors);
        let marched: Vec<_> = (0..63).map(|pixel| tile_pixels.first_rays.marched(pixel)).collect();
        assert!(marched.iter().all(|&rays| rays == 1.0 || rays == 5.0), "{marched:?}");
        marched.iter().filter(|&&rays| rays == 5.0).count()
    };
    // Others are good enough, or their bounds fall too slowly.
    let (few, many) = (quartered(3), quartered(64));
    assert!(few < many && many > 40, "{few} {many}");
}

#[test]
fn levels_and_digits_are_made_finer_each_for_what_it_is_off_by() {
    let scene = scene("samples = 1", 9, 7);
    let grid = PixelGrid::new(&view(&scene), scene.render.samples);
    let second = |levels: f64, digits: f64| {
        let errors = Errors { area: vec![0.0], order: 1, levels, digits, fixed: 0.0 };
        let mut tile_pixels = TilePixels::default();
        tile_pixels.start(&grid, grid.whole(), &Method::Within(goal(u64::MAX, false)));
        let cuts = [(); 2].map(|()| {
            let batch = tile_pixels.next(&grid).unwrap();
            judge(&mut tile_pixels, &grid, &batch, &errors);
            match batch.cut {
                Cut::Error(cut) => cut,
                other => panic!("{other:?}"),
            }
        });
        assert!(
            tile_pixels.next(&grid).is_none() && tile_pixels.error().shares.total() <= TOLERANCE
        );
        [cuts[1].limit / cuts[0].limit, cuts[1].digits.unwrap() / cuts[0].digits.unwrap()]
    };
    // Three tolerances of either.
    let [levels, digits] = second(20.0, 1.0);
    assert!(levels < 0.1 && digits == 1.0, "{levels} {digits}");
    let [levels, digits] = second(1.0, 20.0);
    assert!(levels == 1.0 && digits < 0.15, "{levels} {digits}");
    let [levels, digits] = second(20.0, 20.0);
    assert!(levels < 0.1 && digits < 0.15, "{levels} {digits}");
}

/// The index may say that digits, or levels, make nothing where rays find that they do: smaller limits
/// change nothing then, until there are none.
#[test]
fn pixels_end_whatever_smaller_limits_leave() {
    let scene = scene("samples = 1", 9, 7);
    let grid = PixelGrid::new(&view(&scene), scene.render.samples);
    for off in [[0.0, 2.0], [2.0, 0.0], [2.0, 2.0]] {
        let mut tile_pixels = TilePixels::default();
        tile_pixels.start(&grid, grid.whole(), &Method::Within(goal(u64::MAX, false)));
        let mut rounds = 0;
        while let Some(batch) = tile_pixels.next(&grid) {
            let [levels, digits] = match &batch.cut {
                Cut::Error(cut) => [off[0], if cut.digits.is_some() { off[1] } else { 0.0 }],
                _ => [0.0; 2],
            }
            .map(|off| off * TOLERANCE);
            let shares = ErrorShares { levels, digits, ..ErrorShares::default() };
            judge_by(&mut tile_pixels, &grid, &batch, |_| shares);
            rounds += 1;
            assert!(rounds < 30, "{off:?}: {:?}", batch.cut);
        }
        assert!(tile_pixels.error().shares.total() <= TOLERANCE, "{off:?}");
    }
}

/// What a picture is to be whose pixels' bounds are sought if it `certifies`.
fn likely(certifies: bool) -> Goal {
    Goal { alone_per_pixel: 400, certifies, ..goal(64, false) }
}

/// Rays on the outer sides of a tile none of whose pixels is close enough by its first ray.
fn border(width: u64, height: u64) -> u64 {
    4 * (width + height)
}

/// Rays of what `light` says at each place, which may be off by `bound` as squares.
fn draw_light(
    [width, height]: [u32; 2],
    goal: Goal,
    light: impl Fn([f64; 2]) -> f64,
    bound: impl Fn(&Square) -> f64,
    check: impl Fn(usize, usize, &Pixel),
) -> (u64, TileError) {
    let scene = scene("samples = \"area\"", width, height);
    let grid = PixelGrid::new(&view(&scene), scene.render.samples);
    let mut tile_pixels = TilePixels::default();
    tile_pixels.start(&grid, grid.whole(), &Method::Within(goal));
    let mut rays = 0;
    while let Some(batch) = tile_pixels.next(&grid) {
        rays += batch.squares.len() as u64;
        let outcome = |square: &Square| Found {
            square: *square,
            value: [light(if batch.is_border { square.place() } else { square.centre }); 4],
            shares: ErrorShares {
                pixel_area: if batch.has_area { bound(square) } else { 0.0 },
                ..ErrorShares::default()
            }
            .into(),
            uneven: None,
        };
        tile_pixels.judge(&grid, &batch, batch.squares.iter().map(outcome));
    }
    for (n, pixel) in tile_pixels.pixels.iter().enumerate() {
        let [x, y] = tile_pixels.first_rays.place(n).map(|n| n as usize);
        check(x, y, pixel);
    }
    (rays, tile_pixels.error())
}

#[test]
fn squares_are_taken_as_their_pixels_mean_allows() {
    // Squares of a pixel are off by more than others of it, and their pixels by just so much.
    let light = |[x, y]: [f64; 2]| 0.5 + 0.1 * (x * y).sin();
    let bound = |square: &Square| {
        let place = 1.0 + 0.9 * (37.0 * square.centre[0] + 17.0 * square.centre[1]).sin();
        20.0 * TOLERANCE * square.weight() * place
    };
    let (_, error) = draw_light([9, 7], likely(true), light, bound, |x, y, pixel| {
        assert_eq!(pixel.rays_alone, 0, "{x} {y}");
        assert!(pixel.bound().total() <= TOLERANCE * (1.0 + 1e-9), "{x} {y}");
    });
    assert!(error.shares.total() <= TOLERANCE * (1.0 + 1e-9), "{error:?}");
}

#[test]
fn a_few_squares_whose_bounds_stay_do_not_speak_for_their_group() {
    let light = |_: [f64; 2]| 0.5;
    let bound = |square: &Square| match square.pixel {
        31 => 20.0 * TOLERANCE * (16.0 * square.weight()).min(1.0),
        _ => 8.0 * TOLERANCE * square.weight(),
    };
    let (_, error) = draw_light([9, 7], likely(true), light, bound, |_, _, _| ());
    assert!(error.shares.total() <= TOLERANCE * (1.0 + 1e-9), "{error:?}");
}

#[test]
fn bounds_that_were_without_limit_say_nothing_of_others() {
    let light = |_: [f64; 2]| 0.5;
    let bound = |square: &Square| match (square.pixel, square.halvings) {
        (31, 0 | 1) => 1e300,
        _ => 20.0 * TOLERANCE * square.weight(),
    };
    let (_, error) = draw_light([9, 7], likely(true), light, bound, |_, _, _| ());
    assert!(error.shares.total() <= TOLERANCE * (1.0 + 1e-9), "{error:?}");
}

#[test]
fn pixels_pay_for_no_certificate_that_others_cannot_have() {
    let light = |_: [f64; 2]| 0.5;
    // One group of pixels is out of reach.
    let draw = |hopeless: usize| {
        let bound = |square: &Square| match usize::from(square.pixel) / GROUP_PIXELS {
            group if group == hopeless => 1e4 * TOLERANCE,
            _ => 20.0 * TOLERANCE * square.weight(),
        };
        let goal = Goal { scouting_per_pixel: 8, ..likely(true) };
        draw_light([32, 32], goal, light, bound, |_, _, _| ())
    };
    let (rays, whole) = draw(usize::MAX);
    assert!(whole.shares.total() <= TOLERANCE && rays > 21 * 1024, "{rays} {whole:?}");
    let (first, _) = draw(0);
    let (last, _) = draw(3);
    assert!(2 * first < last && last < rays, "{first} {last} {rays}");
}

#[test]
fn where_no_bound_will_do_pixels_are_within_the_tolerance_all_the_same() {
    // Edges, bends and ripples; the mean is taken of far more rays.
    let light = |[x, y]: [f64; 2]| {
        let edge = 0.4 / (1.0 + (-20.0 * (x + 0.3 * y - 5.1)).exp());
        0.2 + edge + 0.01 * (x * y).sin() + 0.003 * (9.0 * x - 7.0 * y).sin()
    };
    let mean = |x: usize, y: usize| {
        let at = |n: usize, k: usize| n as f64 + (k as f64 + 0.5) / 256.0;
        let rows = (0..256).map(|k| (0..256).map(|j| light([at(x, j), at(y, k)])).sum::<f64>());
        rows.sum::<f64>() / 65536.0
    };
    let bound = |_: &Square| 1e4 * TOLERANCE;
    let (rays, error) = draw_light([9, 7], likely(true), light, bound, |x, y, pixel| {
        let off = (pixel.value[0] - mean(x, y)).abs();
        assert!(off <= TOLERANCE, "{off} at {x}, {y}");
        assert!(off <= pixel.estimate() && pixel.estimate() <= TOLERANCE, "{}", pixel.estimate());
        assert!(
            pixel.bound().total()
                >= bound(&Square { centre: [0.0; 2], offset: [0; 2], pixel: 0, halvings: 0 })
        );
    });
    assert!(error.estimate <= TOLERANCE && error.shares.total() > TOLERANCE);
    assert!(rays < 63 * 352, "{rays}");
    // What is even takes but a few.
    let (rays, _) = draw_light([9, 7], likely(true), |_| 0.5, bound, |_, _, _| {});
    assert!(rays <= 63 * 21 + border(9, 7), "{rays}");
    // So it does where bounds fell at first: that squares are even is known by then.
    let falls =
        |square: &Square| 60.0 * TOLERANCE * 4.6f64.powi(-i32::from(square.halvings.min(2)));
    let (rays, error) = draw_light([9, 7], likely(true), |_| 0.5, falls, |_, _, _| {});
    assert!(error.estimate <= TOLERANCE && error.shares.total() > TOLERANCE);
    assert!((63 * 21..63 * 90).contains(&rays), "{rays}");
}

/// Pixels are taken to need no more than a thousand rays. One that needs a million has its squares until
/// there is no room for more, and then no other pays for a certificate.
#[test]
fn a_pixel_whose_squares_have_no_room_ends_the_search_for_certificates() {
    let falls = |square: &Square| {
        let first = if square.pixel == 500 { 600.0 } else { 0.5 };
        first * TOLERANCE * 1.5f64.powi(-i32::from(square.halvings))
    };
    let goal = Goal { rays_per_pixel: 4096, ..likely(true) };
    let (rays, error) = draw_light([64, 16], goal, |_| 0.5, falls, |_, _, _| {});
    assert!(error.estimate <= TOLERANCE && error.shares.total() > TOLERANCE);
    assert!((32_768..100_000).contains(&rays), "{rays}");
}

#[test]
fn rays_of_areas_without_a_certificate_begin_coarser_unless_they_are_exact() {
    let limit = |goal: &Goal| match goal.first_cut() {
        Cut::Error(cut) => cut.limit,
        _ => 0.0,
    };
    let mut goal = Goal { has_area: true, ..likely(true) };
    let certified = limit(&goal);
    goal.give_up_certificates();
    assert!((LIKELY_OF_BOUND * limit(&goal) / certified - 1.0).abs() < 1e-9);
    let exact = Goal { all_levels: true, ..goal }.trusting_rays();
    assert_eq!((exact.first_cut(), exact.of_rays(1.0)), (Cut::FullDepth, 1.0));
}

/// A bound that no number of rays brings within the tolerance.
fn hopeless(_: &Square) -> f64 {
    1e3 * TOLERANCE
}

#[test]
fn pixels_that_their_neighbours_predict_take_one_ray() {
    // A bow across the picture, and in its middle a bump that is rough.
    let light = |[x, y]: [f64; 2]| {
        let rough = (-0.3 * ((x - 32.0).powi(2) + (y - 8.0).powi(2))).exp();
        0.3 + 1e-4 * (x - 20.0).powi(2)
            + 0.01 * y
            + 0.01 * rough * (7.0 * x).sin() * (9.0 * y).cos()
    };
    let mean = |x: usize, y: usize| {
        let at = |n: usize, k: usize| n as f64 + (k as f64 + 0.5) / 64.0;
        let rows = (0..64).map(|k| (0..64).map(|j| light([at(x, j), at(y, k)])).sum::<f64>());
        rows.sum::<f64>() / 4096.0
    };
    let (rays, error) = draw_light([64, 16], likely(false), light, hopeless, |x, y, pixel| {
        let off = (pixel.value[0] - mean(x, y)).abs();
        assert!(off <= TOLERANCE && off <= 1.1 * pixel.estimate() + 1e-9, "{off} at {x}, {y}");
    });
    assert!(error.estimate <= TOLERANCE && error.shares.total() > TOLERANCE);
    // One for each, four more for a witness in 32, and some for the bump.
    assert!((1024 + 128 + border(64, 16)..6 * 1024).contains(&rays), "{rays}");
    let (rays, _) = draw_light([64, 16], likely(false), |[x, _]| 0.01 * x, hopeless, |_, _, _| {});
    assert_eq!(rays, 1024 + 128 + border(64, 16));
}

#[test]
fn edges_along_the_outer_sides_of_a_tile_are_seen() {
    // A step beside all centres of the last row, and beside all of the first column, so that what is
    // beyond lies in other tiles or nowhere; and one that cuts off a corner of a picture of a pixel.
    type Step = fn([f64; 2]) -> f64;
    let steps: [([u32; 2], Step); 3] = [
        ([64, 16], |[x, y]| 15.7 + 0.003 * x - y),
        ([64, 16], |[x, y]| x - 0.15 - 0.01 * y),
        ([1, 1], |[x, y]| 1.6 - x - y),
    ];
    for (size, is_lit) in steps {
        let light = |at: [f64; 2]| f64::from(u8::from(is_lit(at) > 0.0));
        let mean = |x: usize, y: usize| {
            let at = |n: usize, k: usize| n as f64 + (k as f64 + 0.5) / 128.0;
            let rows = (0..128).map(|k| (0..128).map(|j| light([at(x, j), at(y, k)])).sum::<f64>());
            rows.sum::<f64>() / 16384.0
        };
        let goal = Goal { tolerance: 0.02, ..likely(false) };
        let bound = |_: &Square| 1.0;
        draw_light(size, goal, light, bound, |x, y, pixel| {
            let off = (pixel.value[0] - mean(x, y)).abs();
            // These rays are at squares' centres, beside an edge all alike.
            assert!(off <= 2.0 * goal.tolerance, "{off} at {x}, {y} of {size:?}");
        });
    }
}

#[test]
fn silhouettes_take_few_rays_and_are_within_the_tolerance() {
    let discs = [[9.3, 7.7, 6.1], [26.6, 8.2, 4.4], [40.1, 5.8, 2.9], [54.9, 9.1, 7.3]];
    let is_in = |[x, y]: [f64; 2], [a, b, r]: [f64; 3]| (x - a).hypot(y - b) < r;
    let light = |at: [f64; 2]| f64::from(u8::from(discs.iter().any(|disc| is_in(at, *disc))));
    let mean = |x: usize, y: usize| {
        let at = |n: usize, k: usize| n as f64 + (k as f64 + 0.5) / 256.0;
        let rows = (0..256).map(|k| (0..256).map(|j| light([at(x, j), at(y, k)])).sum::<f64>());
        rows.sum::<f64>() / 65536.0
    };
    let goal = Goal { alone_per_pixel: 400, tolerance: 0.01, ..likely(false) };
    let means: Vec<_> = (0..1024).map(|n| mean(n % 64, n / 64)).collect();
    let (rays, _) = draw_light([64, 16], goal, light, hopeless, |x, y, pixel| {
        let off = (pixel.value[0] - means[64 * y + x]).abs();
        assert!(off <= goal.tolerance, "{off} at {x}, {y}");
    });
    let edges = means.iter().filter(|mean| **mean > 0.0 && **mean < 1.0).count() as u64;
    assert!(rays / edges < 800, "{} of {edges} pixels", rays / edges);
}

#[test]
fn neighbours_are_not_asked_where_more_may_shine_than_is_known_of() {
    let unknown = |_: &Square| 9.0;
    let light = |[x, _]: [f64; 2]| 0.01 * x;
    let (rays, _) = draw_light([64, 16], likely(false), light, unknown, |_, _, _| {});
    assert!(rays >= 5 * 1024, "{rays}");
}

#[test]
fn pixels_of_small_pictures_take_more_rays_whatever_these_tell() {
    // Spots of a seventh of a pixel's width in the dark, one of them in the tile's last pixel.
    let lights = [[3.12, 2.31], [8.19, 6.81], [6.69, 0.08]];
    let is_in = |[x, y]: [f64; 2], [a, b]: [f64; 2]| (x - a).abs().max((y - b).abs()) < 0.07;
    let light =
        |at: [f64; 2]| f64::from(u8::from(lights.iter().any(|light_of| is_in(at, *light_of))));
    let goal = Goal { least_halvings: 3, ..likely(false) };
    let (rays, _) = draw_light([9, 7], goal, light, hopeless, |x, y, pixel| {
        let is_here = |light_of: &[f64; 2]| light_of.map(|c| c as usize) == [x, y];
        let mean = if lights.iter().any(is_here) { 0.14 * 0.14 } else { 0.0 };
        let off = (pixel.value[0] - mean).abs();
        assert!(off <= TOLERANCE, "{off} at {x}, {y}");
    });
    assert!((63 * 85..63 * 400).contains(&rays), "{rays}");
}

#[test]
fn tips_in_dark_pixels_are_seen() {
    // The tip of something bright in a pixel's corner: none of five rays meets it, nor those around.
    let is_in = |x: f64, y: f64| x > 0.0 && y > 0.0 && x + y < 0.2;
    let light = |[x, y]: [f64; 2]| f64::from(u8::from(is_in(x - 4.0, y - 3.0)));
    let goal = Goal { glint_halvings: 3, tolerance: 0.01, ..likely(false) };
    let (rays, error) = draw_light([9, 7], goal, light, hopeless, |x, y, pixel| {
        let mean = if (x, y) == (4, 3) { 0.02 } else { 0.0 };
        let off = (pixel.value[0] - mean).abs();
        assert!(off <= goal.tolerance, "{off} at {x}, {y}");
    });
    assert!((63 * 64..63 * 100).contains(&rays), "{rays}");
    // The others may hold smaller ones.
    assert_eq!(error.unsure, 62);
    // What is a sixth of it covers so much less of the pixel: by their bounds a fourth of the rays do.
    let coarse = Goal { tolerance: 0.06, ..goal };
    let (few, _) = draw_light([9, 7], coarse, |_| 0.0, |_| 0.4, |_, _, _| {});
    assert!((63 * 20..63 * 30).contains(&few), "{few}");
    // By their bounds there is nothing: five rays do.
    let (rays, error) = draw_light([9, 7], goal, |_| 0.0, |_| 0.02, |_, _, _| {});
    assert!(rays <= 63 * 5 + border(9, 7), "{rays}");
    assert_eq!(error.unsure, 0);
    // Likewise by those of their quarters, which are as certain then.
    let first_alone = |square: &Square| if square.halvings == 0 { 1.0 } else { 0.0 };
    let (rays, error) = draw_light(
        [9, 7],
        goal,
        |_| 0.0,
        first_alone,
        |_, _, pixel| {
            assert_eq!((pixel.rays_alone, pixel.bound().total()), (0, 0.0));
        },
    );
    assert!(rays <= 63 * 5 + border(9, 7), "{rays}");
    assert_eq!((error.unsure, error.shares.total()), (0, 0.0));
}

#[test]
fn rays_that_are_the_truth_miss_nothing() {
    let scene = scene("samples = 1", 9, 7);
    let grid = PixelGrid::new(&view(&scene), scene.render.samples);
    let mut tile_pixels = TilePixels::default();
    tile_pixels.start(&grid, grid.whole(), &Method::Within(goal(u64::MAX, false)));
    let shares = ErrorShares { storage: 100.0 * TOLERANCE, ..ErrorShares::default() };
    let dark = |square: &Square| Found {
        square: *square,
        value: [0.0; 4],
        shares: shares.into(),
        uneven: None,
    };
    while let Some(batch) = tile_pixels.next(&grid) {
        tile_pixels.judge(&grid, &batch, batch.squares.iter().map(dark));
    }
    let error = tile_pixels.error();
    assert!(error.shares.storage > 50.0 * TOLERANCE && error.unsure == 0, "{error:?}");
}

#[test]
fn what_is_dark_goes_by_the_light_expected_too() {
    // A tolerance of a fifth of it: much less than that is not dark yet.
    let goal = Goal { glint_halvings: 3, tolerance: 0.2, ..likely(false) };
    let rays = |light: f64| draw_light([9, 7], goal, |_| light, |_| 0.9, |_, _, _| {}).0;
    let (dim, dark) = (rays(0.1), rays(0.01));
    assert!(dim < 63 * 5 && dark >= 63 * 21, "{dim} {dark}");
}

#[test]
fn a_pixel_that_cannot_be_finished_leaves_rays_to_others_in_a_crowd() {
    // Edges cross all pixels, and through the first there are so many that no rays would do.
    let light = |[x, y]: [f64; 2]| {
        let many = if x < 1.0 && y < 1.0 { (3e4 * x * x + 2e4 * y).sin() } else { 0.0 };
        f64::from(u8::from((1.7 * x + y).fract() > 0.5)) + many
    };
    let goal = Goal { alone_per_pixel: 2000, tolerance: 1e-4, ..likely(false) };
    draw_light([16, 4], goal, light, hopeless, |x, y, pixel| {
        let error = pixel.estimate();
        if (x, y) == (0, 0) {
            assert!(error > 5.0 * goal.tolerance, "{error}");
        } else {
            // Were rays shared by all of a group at once, some would be off by 0.02.
            assert!(error < 0.015, "{error} at {x}, {y}");
        }
    });
}

/// The worst likely error of 64×16 pixels, of 256 rays each, where an edge crosses those of some rows
/// at a height of its own; the other rows are even.
fn worst_of_edges(rows: std::ops::Range<f64>) -> f64 {
    let light = |[x, y]: [f64; 2]| {
        let height = 0.3 + 0.4 * (7.0 * x.floor() + 3.0 * y.floor()).sin().abs();
        let is_lit = y.fract() > height + 0.2 * x.fract();
        if rows.contains(&y) { f64::from(u8::from(is_lit)) } else { 0.5 }
    };
    let goal = Goal { alone_per_pixel: 256, tolerance: 1e-6, ..likely(false) };
    let (rays, error) = draw_light([64, 16], goal, light, hopeless, |_, _, _| {});
    assert!(rays <= 257 * 64 * 16 + border(64, 16), "{rays}");
    error.estimate
}

#[test]
fn what_pixels_save_is_not_all_taken_by_those_that_follow() {
    let worst = worst_of_edges(4.0..16.0);
    assert!(worst < 0.035, "{worst}");
}

#[test]
fn what_pixels_save_is_left_to_those_before() {
    // Their own rays bring them to 0.04.
    let worst = worst_of_edges(0.0..8.0);
    assert!(worst < 0.02, "{worst}");
}

#[test]
fn what_is_given_up_for_want_of_room_takes_no_rays_for_what_is_left() {
    // So many edges that not all squares can be put off: those that were cannot make up for the others.
    let is_lit = |x: f64, y: f64| y.fract() > 0.3 + 0.37 * (x + 0.01 * y).fract();
    let light = |[x, y]: [f64; 2]| if y < 2.0 { f64::from(u8::from(is_lit(x, y))) } else { 0.5 };
    let goal = Goal { alone_per_pixel: 1000, ..likely(false) };
    draw_light([64, 16], goal, light, hopeless, |x, y, pixel| {
        assert!(pixel.rays_alone < 20_000, "{} at {x}, {y}", pixel.rays_alone);
        assert!(pixel.estimate() < 0.005, "{} at {x}, {y}", pixel.estimate());
    });
}

#[test]
fn what_is_alike_in_all_pixels_is_seen_by_witnesses() {
    // Stairs of a pixel's width: centres lie on a straight line, and means on another one.
    let light = |[x, y]: [f64; 2]| 0.01 * (x + 0.4).floor() - 0.02 * (y + 0.7).floor();
    draw_light([64, 16], likely(false), light, hopeless, |x, y, pixel| {
        let mean = 0.01 * (x as f64 + 0.4) - 0.02 * (y as f64 + 0.7);
        let off = (pixel.value[0] - mean).abs();
        // Rays through centres are ten times as far off as the tolerance.
        assert!(off <= 2.0 * TOLERANCE, "{off} at {x}, {y}");
    });
}

#[test]
fn what_is_small_and_shines_is_not_lost_between_rays() {
    // A light_of of a thousandth of a pixel, as bright as a pixel all of it; squares know that it is
    // near. The rows above are rough, so that all rays for themselves are spent there.
    let (at, radius) = ([4.813, 13.377], 1e-3_f64);
    let brightness = (std::f64::consts::TAU * radius * radius).recip();
    let distance = |[x, y]: [f64; 2]| (x - at[0]).hypot(y - at[1]);
    let light = |[x, y]: [f64; 2]| {
        let rough = if y < 10.0 { 0.2 * (1e4 * (x * y).sin()).sin() } else { 0.0 };
        0.3 + rough + brightness * (-0.5 * (distance([x, y]) / radius).powi(2)).exp()
    };
    let bound = |square: &Square| {
        let is_near = distance(square.centre) < 5.0 * radius + 1.5 * square.half();
        100.0 * TOLERANCE + if is_near { brightness.min(square.weight().recip()) } else { 0.0 }
    };
    draw_light([64, 16], likely(true), light, bound, |x, y, pixel| {
        let truth = if (x, y) == (4, 13) { 1.3 } else { 0.3 };
        let off = (pixel.value[0] - truth).abs();
        assert!(y < 10 || off <= 2.0 * TOLERANCE, "{off} at {x}, {y}");
    });
}

/// Rays marched with each care that stand for themselves, of a tile of 9×7 pixels whose rays the march lets
/// be off by so many tolerances with each.
fn rays_by_care(
    samples: &str,
    goal: Goal,
    light: impl Fn([f64; 2]) -> f64,
    off: [f64; 3],
) -> [usize; 3] {
    let scene = scene(&format!("samples = {samples}"), 9, 7);
    let grid = PixelGrid::new(&view(&scene), scene.render.samples);
    let mut tile_pixels = TilePixels::default();
    tile_pixels.start(&grid, grid.whole(), &Method::Within(goal));
    let mut rays = [0; 3];
    while let Some(batch) = tile_pixels.next(&grid) {
        let care = [Care::Rough, Care::Fine, Care::Exact].iter().position(|c| *c == batch.care);
        let care = care.unwrap();
        let stands_for_area = batch.has_area && grid.has_area();
        rays[care] += if stands_for_area { 0 } else { batch.squares.len() };
        let area = if stands_for_area { 1.0 } else { 0.0 };
        let outcome = |square: &Square| Found {
            square: *square,
            value: [light(square.centre); 4],
            shares: ErrorShares {
                quadrature: off[care] * goal.tolerance,
                pixel_area: area,
                ..ErrorShares::default()
            }
            .into(),
            uneven: None,
        };
        tile_pixels.judge(&grid, &batch, batch.squares.iter().map(outcome));
    }
    rays
}

#[test]
fn packets_of_more_care_are_tried_with_a_few_rays_first() {
    const RAYS: usize = 63 * 9;
    let by = |off: [f64; 3]| rays_by_care("3", goal(64, false), |_| 1.0, off);
    // What is left of 3 tolerances is still too much, or is not.
    let [rough, fine, exact] = by([3.0, 2.0, 0.0]);
    assert!(rough == RAYS && exact == RAYS && fine > 32 && fine < RAYS / 4, "{fine}");
    assert_eq!(by([3.0, 0.9, 0.0]), [RAYS, RAYS, 0]);
    // Far too much is not tried.
    assert_eq!(by([100.0, 0.9, 0.0]), [RAYS, 0, RAYS]);
    assert_eq!(by([0.9, 0.0, 0.0]), [RAYS, 0, 0]);
}

#[test]
fn rays_of_pixels_out_of_reach_take_no_more_care() {
    let goal = Goal { tolerance: 1e-6, ..likely(false) };
    let edges = |[x, y]: [f64; 2]| f64::from(u8::from((1.7 * x + y).fract() > 0.5));
    let smooth = |[x, y]: [f64; 2]| 1e-7 * (x * x + y);
    let [rough, fine, exact] = rays_by_care("\"area\"", goal, edges, [5.0, 1.0, 0.0]);
    assert!(rough > 63 * 100 && fine + exact < rough / 20, "{rough} {fine} {exact}");
    let [rough, fine, exact] = rays_by_care("\"area\"", goal, smooth, [5.0, 1.0, 0.0]);
    assert!(rough < 63 * 40 && fine + exact >= 63, "{rough} {fine} {exact}");
}

#[test]
fn rays_that_are_off_themselves_do_not_stand_for_pixels_that_neighbours_predict() {
    let exact = |off: [f64; 3]| rays_by_care("\"area\"", likely(false), |_| 1.0, off)[2];
    assert!(exact([5.0, 2.0, 0.0]) >= 63 && exact([0.5, 0.5, 0.0]) == 0);
}

#[test]
fn squares_marched_again_and_others_quartered_do_not_mix_their_rays_up() {
    // Rays that the march lets be off by too much: of one pixel something may shine, another stands out.
    let goal = likely(false);
    let scene = scene("samples = \"area\"", 9, 7);
    let grid = PixelGrid::new(&view(&scene), scene.render.samples);
    let mut tile_pixels = TilePixels::default();
    tile_pixels.start(&grid, grid.whole(), &Method::Within(goal));
    while let Some(batch) = tile_pixels.next(&grid) {
        assert!(batch.again.is_empty() || batch.wholes.is_empty());
        let outcome = |square: &Square| {
            let area = match square.pixel {
                _ if !batch.has_area => 0.0,
                5 => 12.0,
                20 => 9.0,
                _ => 0.02,
            };
            let off = if batch.care == Care::Rough { 5.0 * goal.tolerance } else { 0.0 };
            Found {
                square: *square,
                value: [f64::from(square.pixel); 4],
                shares: ErrorShares { quadrature: off, pixel_area: area, ..ErrorShares::default() }
                    .into(),
                uneven: None,
            }
        };
        tile_pixels.judge(&grid, &batch, batch.squares.iter().map(outcome));
    }
    for (n, pixel) in tile_pixels.pixels.iter().enumerate() {
        let off = (pixel.value[0] - n as f64).abs();
        assert!(off < 1e-9 && (pixel.weight - 1.0).abs() < 1e-9, "{n}: {pixel:?}");
    }
}

#[test]
fn squares_of_a_group_that_loses_its_prospect_are_quartered_as_a_batch_has_room() {
    let scene = scene("samples = \"area\"", 16, 16);
    let grid = PixelGrid::new(&view(&scene), scene.render.samples);
    let mut tile_pixels = TilePixels::default();
    tile_pixels.start(&grid, grid.whole(), &Method::Within(likely(false)));
    // Quarters of quarters, to be marched again, none of which may shine; those of fewer than half of the
    // pixels stand out.
    let care = Care::Exact;
    let to_do = ToDo { quartered: false, cut: Cut::FullDepth, before: care, care, alone: false };
    let mut squares = Vec::new();
    grid.first_squares(&grid.whole(), &mut squares);
    for _ in 0..2 {
        squares = squares.iter().flat_map(|square| square.scattered_quarters(0.0)).collect();
    }
    for square in squares {
        let pixel_area = if square.pixel < 120 { 5.0 } else { 0.1 };
        let shares = ErrorShares { pixel_area, ..ErrorShares::default() }.into();
        let found = Found { square, value: [1.0; 4], shares, uneven: None };
        assert!(tile_pixels.may_wait(&grid, &found, &to_do));
    }
    tile_pixels.first = None;
    let mut quartered = 0;
    for batch in from_fn(|| tile_pixels.next(&grid)).take(4).filter(|batch| batch.has_area) {
        assert!(batch.squares.len() <= BATCH_RAYS && batch.again.is_empty());
        quartered += batch.wholes.len();
    }
    assert_eq!(quartered, 120 * 16);
}

/// How many rays are marched together, and what bricks of narrow cells are allowed for them, where such
/// cells make rays be off by so many tolerances.
fn batches_of_narrow_cells(off: impl Fn(&Square, f64) -> f64) -> Vec<(usize, f64)> {
    let scene = scene("samples = 1", 64, 64);
    let grid = PixelGrid::new(&view(&scene), scene.render.samples);
    let mut tile_pixels = TilePixels::default();
    let goal = Goal { sounds: true, ..goal(u64::MAX, false) };
    tile_pixels.start(&grid, grid.whole(), &Method::Within(goal));
    let mut batches = Vec::new();
    while let Some(batch) = tile_pixels.next(&grid) {
        let Cut::Error(ErrorCut { narrow, .. }) = batch.cut else {
            unreachable!("levels are left")
        };
        assert!(batch.squares.is_sorted_by_key(|square| square.pixel));
        batches.push((batch.squares.len(), narrow));
        judge_by(&mut tile_pixels, &grid, &batch, |square| ErrorShares {
            levels: off(square, narrow) * TOLERANCE,
            ..ErrorShares::default()
        });
    }
    assert_whole(&mut tile_pixels);
    assert!(tile_pixels.error().shares.total() <= TOLERANCE);
    batches
}

#[test]
fn a_few_rays_tell_how_coarse_narrow_cells_may_be() {
    assert_eq!(batches_of_narrow_cells(|_, _| 0.1), [(64, 8.0), (4032, 8.0)]);
    let rough = |_: &Square, narrow: f64| 0.2 * narrow;
    assert_eq!(batches_of_narrow_cells(rough), [(64, 8.0), (4096, 2.0)]);
    // Few that miss the tolerance are marched again, by the limit that others have; pixel 32 is one of
    // those that are drawn first.
    let seldom = |square: &Square, narrow: f64| match square.pixel {
        32 | 100 | 1000 | 3000 => 0.1 * narrow * narrow,
        _ => 0.1,
    };
    assert_eq!(batches_of_narrow_cells(seldom), [(64, 8.0), (4033, 8.0), (4, 1.0)]);
}
