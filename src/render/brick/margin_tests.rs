//! Bricks cut where their level ends, against bricks taken as a whole.

use glam::{DVec2, DVec3};
use proptest::prelude::*;

use super::interpolant::DrawnNeighbours;
use super::margin::{WholeCells, parts};
use super::scaled::ScaledBrick;
use crate::render::brick::passage::{Passage, Region};
use crate::render::brick::walk::clip;
use crate::render::camera::frame::{Frame, LocalRay};
use crate::render::camera::view::View;
use crate::render::march::ray::{Light, march};
use crate::render::march::ray_state::{Ending, RayState};
use crate::render::march::ray_tests::{smooth, steps};
use crate::render::testing::data::{TestData, rough};
use crate::render::transfer::pieces::TransferPieces;
use crate::scene::{Interpolation, Scene};

const EDGE: i128 = 8;
/// Bricks of 8³ of the test data that their level fills in part: to the left and to the right, and
/// with a corner that no box of cells has.
const BRICKS: [(u32, [i128; 3]); 5] =
    [(1, [1, 0, 1]), (1, [2, 0, 1]), (2, [2, 1, 2]), (1, [1, 2, 2]), (3, [7, 3, 5])];

/// A brick before a camera that looks at it from `off`, brick edges from its centre.
fn framed(
    data: &TestData,
    (level, at): (u32, [i128; 3]),
    off: [f64; 3],
    is_flat: bool,
) -> (ScaledBrick, Frame) {
    let width = data.domain.cell_width(level as i32) * EDGE as f64;
    let left = data.domain.left();
    let target: [f64; 3] = std::array::from_fn(|a| left[a] + (at[a] as f64 + 0.5) * width[a]);
    let eye: [f64; 3] = std::array::from_fn(|a| target[a] + off[a] * width[a]);
    let lens = if is_flat {
        format!("projection = \"orthographic\"\nheight = {}", 1.5 * width.max_element())
    } else {
        "fov = 70.0".to_owned()
    };
    let text = format!(
        "[image]\nwidth = 8\nheight = 8\n[camera]\nposition = {eye:?}\nlook_at = {target:?}\n\
         up = [0.31, 1.0, 0.17]\n{lens}\n[[volume]]\nfield = \"Density\"\n"
    );
    let view = View::new(&Scene::parse(&text, "test").unwrap(), &data.domain).unwrap();
    let corner = data.domain.cell_corner(level as i32, at.map(|c| c * EDGE));
    let frame = view.frame(&corner, level as i32, EDGE as f64);
    (data.brick(level, at, EDGE as u32, Interpolation::Linear), frame)
}

fn span(ray: &LocalRay, region: &Region) -> Option<(f64, f64)> {
    clip(ray, region.lo, region.hi)
}

#[test]
fn a_core_holds_all_cells_that_exist() {
    let data = TestData::new(rough);
    let mut count = 0;
    for (level, at) in BRICKS {
        let brick = data.brick(level, at, EDGE as u32, Interpolation::Linear);
        let exists =
            |cell: &[i128; 3]| data.exists(level, std::array::from_fn(|a| at[a] * EDGE + cell[a]));
        let mut core = WholeCells { lo: [8; 3], hi: [0; 3] };
        for cell in (0..512).map(|n| [n % 8, n / 8 % 8, n / 64]).filter(exists) {
            let cell = cell.map(|c| c as usize);
            core.lo = std::array::from_fn(|a| core.lo[a].min(cell[a] & !1));
            core.hi = std::array::from_fn(|a| core.hi[a].max((cell[a] | 1) + 1));
        }
        assert_eq!(brick.margin().map(|(core, _)| *core), Some(core).filter(|c| !c.is_all(8)));
        count += usize::from(brick.margin().is_some());
    }
    assert!(count >= 3, "only {count} bricks are filled in part");
}

proptest! {
    #[test]
    fn parts_come_front_to_back_and_leave_nothing_out(
        number in 0..BRICKS.len(),
        off in prop::array::uniform3(-2.5..2.5_f64),
        is_flat in any::<bool>(),
        (is_inner, has_steps) in any::<(bool, bool)>(),
        planes in prop::collection::vec(prop::array::uniform2(-1.0..1.0_f64), 12),
    ) {
        let data = TestData::new(rough);
        // From within the brick, too.
        let off = if is_inner { off.map(|x| 0.2 * x) } else { off };
        let (brick, frame) = framed(&data, BRICKS[number], off, is_flat);
        let Some(footprint) = frame.footprint(DVec3::ZERO, DVec3::splat(8.0)) else {
            return Ok(());
        };
        let region = Region { lo: [0.0; 3], hi: [8.0; 3], ends: 0 };
        let passage = Passage { brick: &brick, region, drawn: DrawnNeighbours::ALL, hides: false };
        let transfer =
            TransferPieces::new(&if has_steps { steps() } else { smooth() }, |_| 0.0);
        let light = Light { pieces: &transfer.all, ending: Ending::new(1e9, 0.0), packets: None };
        let parts = parts(&passage, &frame, &footprint);
        let scale = if is_flat { 4.0 } else { 0.7 };
        for plane in planes {
            let ray = frame.ray(scale * DVec2::from(plane));
            let (mut whole, mut pieces) = (RayState::default(), RayState::default());
            march(&passage, &ray, &light, &mut whole, None);
            let mut reached = span(&ray, &region).map(|span| span.0);
            for part in &parts {
                let ray = part.frame.ray(scale * DVec2::from(plane));
                if let Some((from, to)) = span(&ray, &part.passage.region) {
                    let begin = reached.expect("a part beside the brick");
                    prop_assert!((from - begin).abs() < 1e-9 * (1.0 + from.abs()), "{from} {begin}");
                    reached = Some(to);
                }
                march(&part.passage, &ray, &light, &mut pieces, None);
            }
            let end = span(&ray, &region).map_or(0.0, |span| span.1);
            prop_assert!((reached.unwrap_or(0.0) - end).abs() < 1e-9 * (1.0 + end.abs()));
            for c in 0..3 {
                let (a, b) = (whole.radiance[c], pieces.radiance[c]);
                prop_assert!((a - b).abs() < 1e-7 * (1e-3 + a), "{a} {b}");
            }
            prop_assert!((whole.transmittance - pieces.transmittance).abs() < 1e-7);
        }
    }
}
