use proptest::prelude::*;

use super::*;
use crate::render::test_scene::{scene, view};

const TOLERANCE: f64 = 1e-3;

/// How far rays are off, by how large their squares are and what their cut allows.
#[derive(Debug, Clone)]
struct Errors {
    /// Of each pixel in turn, for its whole area, parts of the tolerance.
    area: Vec<f64>,
    /// How fast that falls with the square's width.
    order: i32,
    /// Parts of the cut's limit.
    levels: f64,
    /// What nothing changes, parts of the tolerance.
    fixed: f64,
}

impl Errors {
    fn of(&self, square: &Square, cut: &Cut) -> ErrorShares {
        let number = usize::from(square.pixel) % self.area.len();
        // Unlike from place to place.
        let place = 1.0 + (37.0 * square.centre[0] + 17.0 * square.centre[1]).sin();
        let width = (2.0 * square.half()).powi(self.order);
        ErrorShares {
            levels: match cut {
                Cut::Error(cut) => self.levels * cut.limit,
                _ => 0.0,
            },
            pixel_area: self.area[number] * TOLERANCE * width * place,
            rounding: self.fixed * TOLERANCE,
            ..ErrorShares::default()
        }
    }
}

/// Draws a tile of white pixels; rays marched.
fn draw(sheet: &mut Sheet, samples: &str, goal: Goal, errors: &Errors) -> u64 {
    let scene = scene(&format!("samples = {samples}"), 9, 7);
    let grid = PixelGrid::new(&view(&scene), scene.render.samples);
    sheet.start(&grid, grid.tile(0), &Method::Within(goal));
    let mut rays = 0;
    while let Some(batch) = sheet.next(&grid) {
        assert!(!batch.squares.is_empty() && batch.squares.len() <= BATCH_RAYS);
        assert!(batch.squares.is_sorted_by_key(|square| square.pixel));
        rays += batch.squares.len() as u64;
        let outcome = |square: &Square| (*square, [1.0; 4], errors.of(square, &batch.cut));
        sheet.judge(&grid, &batch, batch.squares.iter().map(outcome));
    }
    rays
}

fn errors() -> impl Strategy<Value = Errors> {
    let area = prop::collection::vec((-3.0..1.0).prop_map(|p: f64| 10f64.powf(p)), 1..20);
    (area, 1..3, 0.0..40.0, 0.0..0.5).prop_map(|(area, order, levels, fixed)| Errors {
        area,
        order,
        levels,
        fixed,
    })
}

fn assert_whole(sheet: &mut Sheet) {
    assert!(sheet.pixels.iter().all(|pixel| (pixel.weight - 1.0).abs() < 1e-9));
    assert!(sheet.pixels().iter().flatten().all(|value| (value - 1.0).abs() < 1e-6));
}

fn goal(rays_per_pixel: u64, all_levels: bool) -> Goal {
    Goal { tolerance: TOLERANCE, behind: 1.0, rays_per_pixel, all_levels }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn no_pixel_is_taken_above_its_allowance_while_rays_are_left(
        errors in errors(),
        all_levels in any::<bool>(),
    ) {
        let mut sheet = Sheet::default();
        draw(&mut sheet, "\"area\"", goal(u64::MAX, all_levels), &errors);
        for pixel in &sheet.pixels {
            let total = pixel.shares.total();
            prop_assert!(total <= TOLERANCE * (1.0 + 1e-9), "{total} {pixel:?}");
        }
        prop_assert!(sheet.shares().total() <= TOLERANCE * (1.0 + 1e-9));
        assert_whole(&mut sheet);
    }

    #[test]
    fn pixels_are_whole_and_say_their_error_when_rays_run_out(
        errors in errors(),
        most in 0..80_u64,
    ) {
        let mut sheet = Sheet::default();
        let rays = draw(&mut sheet, "\"area\"", goal(most, false), &errors);
        // The batch in hand is marched.
        prop_assert!(rays < 63 * most.max(1) + BATCH_RAYS as u64, "{rays}, not {most} a pixel");
        assert_whole(&mut sheet);
        let worst = sheet.pixels.iter().map(|p| p.shares.total()).fold(0.0, f64::max);
        prop_assert_eq!(sheet.shares().total(), worst);
    }

    #[test]
    fn rays_without_area_go_through_finer_levels(errors in errors()) {
        let errors = Errors { area: vec![0.0], ..errors };
        let mut sheet = Sheet::default();
        draw(&mut sheet, "3", goal(u64::MAX, false), &errors);
        prop_assert!(sheet.shares().total() <= TOLERANCE * (1.0 + 1e-9));
        assert_whole(&mut sheet);
    }
}

#[test]
fn a_tile_that_is_good_enough_takes_one_ray_a_pixel() {
    let errors = Errors { area: vec![0.1], order: 1, levels: 1.0, fixed: 0.1 };
    let rays = draw(&mut Sheet::default(), "\"area\"", goal(u64::MAX, false), &errors);
    assert_eq!(rays, 63);
}
