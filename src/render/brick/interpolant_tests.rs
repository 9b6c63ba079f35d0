//! The interpolant against its definition, and its continuity.

use proptest::prelude::*;

use crate::render::testing::data::{TestCut, TestData, linear, linear_at, rough};

const ROOT: [f64; 3] = [20.0, 12.0, 16.0];

fn everywhere(_: u32, _: [i128; 3]) -> bool {
    true
}

/// Level of detail, with borders of levels 3 and 2 along x, y and z and of 2 and 1 along x.
fn some(level: u32, at: [i128; 3]) -> bool {
    level < 1 || level == 1 && at[0] < 2 || level == 2 && at[0] < 3 && at[1] < 3 && at[2] < 4
}

/// Places beside the borders of levels, where formulas change: near cells' faces, edges, corners
/// and centres.
fn places() -> Vec<[f64; 3]> {
    let data = TestData::new(rough);
    let mut places = Vec::new();
    let mut seed = 1u32;
    let mut random = |below: u32| {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (seed >> 8) % below
    };
    for (level, cells) in data.borders() {
        for _ in 0..400 {
            let scale = f64::from(1 << level);
            let pinned = random(7) + 1;
            let point: [f64; 3] = std::array::from_fn(|a| {
                let (lo, hi) = (cells.lo[a] as f64, cells.hi[a] as f64);
                let at = match (pinned >> a & 1 == 1, random(2)) {
                    (true, 0) => lo,
                    (true, _) => hi,
                    _ => lo + (hi - lo) * f64::from(random(997)) / 997.0,
                };
                at / scale
            });
            places.push(point);
        }
    }
    // Corners of bricks of any size, and of level-of-detail borders.
    for n in 0..400 {
        let step = [1.0, 2.0, 4.0][n % 3];
        places.push(std::array::from_fn(|a| {
            let whole = f64::from(random((ROOT[a] / step) as u32 - 1) + 1) * step;
            if random(3) == 0 { whole - f64::from(random(100)) / 100.0 } else { whole }
        }));
    }
    places
}

fn jump(cut: &TestCut<'_>, place: [f64; 3]) -> f64 {
    const STEP: f64 = 1e-9;
    let mut values = [f64::INFINITY, f64::NEG_INFINITY];
    for n in 0..27 {
        let shift = [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1];
        let point: [f64; 3] = std::array::from_fn(|a| {
            (place[a] + STEP * f64::from(shift[a])).clamp(STEP, ROOT[a] - STEP)
        });
        let value = cut.value_at(point);
        values = [values[0].min(value), values[1].max(value)];
    }
    values[1] - values[0]
}

#[test]
fn nothing_jumps_at_borders_of_data() {
    let data = TestData::new(rough);
    for edge in [8, 16] {
        let cut = TestCut::new(&data, edge, everywhere);
        for place in places() {
            let jump = jump(&cut, place);
            assert!(jump < 1e-6, "edge {edge}: {jump} at {place:?}");
        }
    }
}

#[test]
fn nothing_jumps_at_borders_of_level_of_detail() {
    let data = TestData::new(rough);
    let cut = TestCut::new(&data, 8, some);
    let levels: std::collections::BTreeSet<u32> =
        places().iter().map(|p| cut.owner(p.map(|x| x.clamp(0.0, 11.9))).0).collect();
    assert!(levels.len() == 4, "the cut must mix all levels: {levels:?}");
    for place in places() {
        let jump = jump(&cut, place);
        assert!(jump < 1e-6, "{jump} at {place:?}");
    }
}

#[test]
fn drawing_coarser_without_saying_so_jumps() {
    let data = TestData::new(rough);
    let cut = TestCut::new(&data, 8, some);
    let brick = data.brick(3, [4, 5, 6], 8, crate::scene::Interpolation::Linear);
    let (drawn, all) = (cut.drawn(3, [4, 5, 6]), super::interpolant::DrawnNeighbours::ALL);
    assert_ne!(drawn, all);
    let differs = (0..512).any(|n| {
        let point = glam::DVec3::new(f64::from(n % 8), f64::from(n / 8 % 8), f64::from(n / 64));
        let point = point + 0.75;
        (brick.value_at(point, drawn) - brick.value_at(point, all)).abs() > 1e-3
    });
    assert!(differs);
}

#[test]
fn linear_functions_are_reproduced_away_from_the_domains_edge() {
    let data = TestData::new(linear);
    for edge in [8, 16, 32] {
        let cut = TestCut::new(&data, edge, everywhere);
        for place in places() {
            let point: [f64; 3] =
                std::array::from_fn(|a| place[a].clamp(2.0, ROOT[a] - 2.0) + 0.01);
            let error = (cut.value_at(point) - linear_at(point)).abs();
            assert!(error < 2e-7, "{error} at {point:?}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(3000))]
    #[test]
    fn equals_the_definition_for_every_brick_size(u in prop::array::uniform3(0.0..1.0_f64)) {
        thread_local! {
            static DATA: TestData = TestData::new(rough);
        }
        DATA.with(|data| {
            let point: [f64; 3] = std::array::from_fn(|a| u[a] * ROOT[a]);
            let mut values = Vec::new();
            for edge in [8, 16, 32] {
                let cut = TestCut::new(data, edge, everywhere);
                let (level, _) = cut.owner(point);
                let scale = f64::from(1 << level);
                let slow = data.slow(level, point.map(|x| x * scale), &|_, _| true);
                let value = cut.value_at(point);
                prop_assert!((value - slow).abs() < 1e-6, "{value} {slow} at {point:?}");
                values.push(value);
            }
            prop_assert!((values[0] - values[1]).abs() < 1e-12);
            prop_assert!((values[0] - values[2]).abs() < 1e-12);
            Ok(())
        })?;
    }
}
