use glam::DVec2;
use proptest::prelude::*;

use super::*;
use crate::cache::BrickShape;
use crate::render::brick::walk::clip;
use crate::render::camera::rays::PixelGrid;
use crate::render::camera::view::View;
use crate::render::plan::census::Census;
use crate::render::plan::cut::{ErrorCut, FootprintCut};
use crate::render::testing::scene::{domain, scene, view};
use crate::render::testing::tree::{Tree, tree};
use crate::render::transfer::pieces::TransferPieces;
use crate::render::transfer::shading::Shading;
use crate::scene::Scene;

impl Tree {
    /// All steps of the picture's window, and what became of the bricks.
    fn walk(&self, scene: &Scene, cut: &Cut, window: Option<PixelRect>) -> (Vec<Step>, Census) {
        let mut steps = Vec::new();
        let census = self.each_step(scene, cut, window, |step| steps.push(step), |_| 1.0);
        (steps, census)
    }

    /// Hears of all steps where `needed` says how much light from behind is let through.
    fn each_step(
        &self,
        scene: &Scene,
        cut: &Cut,
        window: Option<PixelRect>,
        mut hear: impl FnMut(Step),
        needed: impl Fn(&PixelRect) -> f64,
    ) -> Census {
        let (header, view) = (self.header(), view(scene));
        let pixels = PixelGrid::new(&view, scene.render.samples);
        let shading = Shading::new(&scene.volume, scene.render.interpolation, &header).unwrap();
        let transfer = TransferPieces::new(&shading.transfer, |_| 0.0);
        let context = WalkContext {
            rounds: true,
            header: &header,
            view: &view,
            pixels: &pixels,
            shading: &shading,
            bounds: &transfer.all,
            unseen: None,
        };
        let mut index = self.clone();
        let window = window.unwrap_or(pixels.whole());
        let mut walk = Walk::new(&context, &mut index, Census::default(), cut, window);
        while let Some(step) = walk.next(|rays, _| needed(rays)).unwrap() {
            hear(step);
        }
        walk.into_tally()
    }
}

/// The cut at cells of one pixel.
fn by_pixels(scene: &Scene) -> Cut {
    let shape = BrickShape::new(8).unwrap();
    Cut::Footprint(FootprintCut::new(1.0, scene, &domain(), shape).unwrap())
}

/// The cut at bricks whose light may be off by this much.
fn by_error(limit: f64) -> Cut {
    Cut::Error(ErrorCut { limit, narrow: 1.0, digits: Some(limit), behind: 1.0 })
}

/// The stretches (σ from the eye or the position, code length) of ray (x, y) in the steps that
/// name it, in their order.
fn stretches(view: &View, steps: &[Step], [x, y]: [u32; 2]) -> Vec<(f64, f64)> {
    let plane = centre(view, [x, y]);
    let named =
        steps.iter().filter(|s| s.pixels.columns().contains(&x) && s.pixels.rows().contains(&y));
    named
        .filter_map(|step| {
            let (from, to) = clip(&step.frame.ray(plane), step.region.lo, step.region.hi)?;
            Some((from + step.frame.depth, to + step.frame.depth))
        })
        .collect()
}

/// (P, Q) of a pixel's centre.
fn centre(view: &View, [x, y]: [u32; 2]) -> DVec2 {
    view.plane(f64::from(x) + 0.5, f64::from(y) + 0.5)
}

/// A ray's way through the domain by one slab test in f64, code length along the view direction.
fn whole_path(scene: &Scene, plane: DVec2) -> f64 {
    let (view, root) = (view(scene), domain());
    let frame = view.frame(&root.cell_corner(-2, [0; 3]), -2, 8.0);
    let cells = root.root_cells().map(|n| n as f64 / 4.0);
    clip(&frame.ray(plane), [0.0; 3], cells).map_or(0.0, |(from, to)| to - from)
}

fn cameras() -> impl Strategy<Value = (String, bool)> {
    let coordinate = |lo: f64, hi: f64| lo..hi;
    let eye = (coordinate(-0.3, 1.3), coordinate(-0.4, 0.6), coordinate(-0.5, 2.5));
    (eye, 0usize..4).prop_map(|((x, y, z), kind)| match kind {
        0 => {
            (format!("position = [{x}, {y}, {z}]\nlook_at = [0.5, 0.11, 1.02]\nfov = 70.0"), false)
        }
        1 => (
            format!(
                "projection = \"orthographic\"\nheight = 1.9\nposition = [{x}, {y}, {z}]\n\
                 look_at = [0.5, 0.11, 1.02]"
            ),
            false,
        ),
        // Rays along z that lie exactly in faces of cells and bricks: the cell width along x is
        // 0.05, along y 1/30.
        2 => (
            "projection = \"orthographic\"\nheight = 0.4\nposition = [0.4, 0.1, -3]\n\
             look_at = [0.4, 0.1, 1]"
                .to_owned(),
            true,
        ),
        // The eye in a corner of many bricks.
        _ => {
            ("position = [0.8, 0.1, 1.0]\nlook_at = [0.3, 0.05, 0.2]\nfov = 100.0".to_owned(), true)
        }
    })
}

fn scene_from(camera: &str, settings: &str) -> Scene {
    let text = scene(settings, 24, 24).source;
    let start = text.find("position").unwrap();
    let end = text.find("[[volume]]").unwrap();
    let text = format!("{}{camera}\nup = [0, 1, 0]\n{}", &text[..start], &text[end..]);
    Scene::parse(&text, "test").unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn every_ray_meets_every_point_of_its_path_once_front_to_back(
        camera in cameras(),
        masks in prop::collection::vec(any::<u8>(), 1..40),
        cut in prop_oneof![
            Just(Some(Cut::FullDepth)),
            Just(None),
            (-4.0..1.0).prop_map(|power: f64| Some(by_error(10f64.powf(power)))),
        ],
    ) {
        meets_every_point_once(&camera.0, &masks, cut)?;
    }

    #[test]
    fn a_brick_is_drawn_in_one_go_and_the_last_step_is_marked(
        camera in cameras(),
        masks in prop::collection::vec(any::<u8>(), 1..40),
    ) {
        let scene = scene_from(&camera.0, "samples = 1\ntolerance = 0");
        let window = PixelRect { lo: [3, 5], hi: [17, 9] };
        let (steps, census) = tree(&masks, 4).walk(&scene, &Cut::FullDepth, Some(window));
        let mut finished = std::collections::HashSet::new();
        for step in &steps {
            prop_assert_eq!(step.pixels.intersection(&window), step.pixels);
            prop_assert!(!step.pixels.is_empty());
            prop_assert!(!finished.contains(&step.request.node));
            if step.is_last {
                finished.insert(step.request.node);
            }
        }
        let drawn: std::collections::HashSet<_> = steps.iter().map(|s| s.request.node).collect();
        prop_assert_eq!(drawn.len() as u64, census.drawn);
    }
}

/// An eye in a corner of bricks, and one of them refined: found by the property above.
#[test]
fn an_eye_in_a_corner_sees_every_point_once() {
    let camera = "position = [0.8, 0.1, 1.0]\nlook_at = [0.3, 0.05, 0.2]\nfov = 100.0";
    meets_every_point_once(camera, &[103], Some(Cut::FullDepth)).unwrap();
}

/// With the cut by pixels if there is no other.
fn meets_every_point_once(
    camera: &str,
    masks: &[u8],
    cut: Option<Cut>,
) -> Result<(), TestCaseError> {
    let scene = scene_from(camera, "samples = 1");
    let cut = cut.unwrap_or_else(|| by_pixels(&scene));
    let tree = tree(masks, 5);
    let (steps, census) = tree.walk(&scene, &cut, None);
    let view = view(&scene);
    for ray in (0..24).flat_map(|x| (0..24).map(move |y| [x, y])) {
        let found = stretches(&view, &steps, ray);
        let length: f64 = found.iter().map(|(from, to)| to - from).sum();
        let expected = whole_path(&scene, centre(&view, ray));
        prop_assert!((length - expected).abs() < 1e-9, "{ray:?}: {length} of {expected}");
        // Where the eye lies in a face, rounding may leave a sliver of the brick behind it.
        let found: Vec<_> = found.into_iter().filter(|(from, to)| to - from > 1e-10).collect();
        for pair in found.windows(2) {
            prop_assert!(pair[0].1 <= pair[1].0 + 1e-9, "{ray:?}: {pair:?}");
        }
    }
    let nodes = tree.nodes();
    prop_assert_eq!(census.out_of_view + census.coarser + census.covered + census.drawn, nodes);
    prop_assert_eq!((census.transparent, census.hidden), (0, 0));
    Ok(())
}

#[test]
fn every_brick_meets_one_fate() {
    let mut tree = tree(&[0b1010_0110, 0xff, 0, 0b11], 5);
    let scene = scene("samples = 1\ntolerance = 0", 24, 24);
    // Values up to 0.2 map to x where the default absorption is above 0 already: void instead.
    for node in [9, 30] {
        tree.nodes[node].1.flags = FieldRecord::VOID;
    }
    let (steps, census) = tree.walk(&scene, &Cut::FullDepth, None);
    let skipped: u64 = [9, 30].iter().map(|&node| tree.nodes[node].0.descendants + 1).sum();
    assert_eq!(census.transparent, skipped);
    let Census { out_of_view, transparent, coarser, covered, hidden, drawn } = census;
    assert_eq!(out_of_view + transparent + coarser + covered + hidden + drawn, tree.nodes());
    assert!(steps.iter().all(|step| step.request.node != 9 && step.request.node != 30));
}

#[test]
fn what_is_not_needed_is_left_out_with_all_beneath() {
    let tree = tree(&[0xff], 3);
    let scene = scene("samples = 1\ntolerance = 0", 24, 24);
    let drawn = std::cell::Cell::new(0);
    // As if the first five steps had made everything opaque.
    let needed = |_: &PixelRect| if drawn.get() < 5 { 1.0 } else { 0.0 };
    let hear = |_| drawn.set(drawn.get() + 1);
    let census = tree.each_step(&scene, &Cut::FullDepth, None, hear, needed);
    assert_eq!(drawn.get(), 5);
    assert_eq!((census.drawn, census.out_of_view), (5, 0));
    assert_eq!(census.hidden + census.drawn + census.covered, tree.nodes());
}

#[test]
fn the_cut_by_error_goes_from_all_to_nothing() {
    let tree = tree(&[0xff, 0b1011_0111], 5);
    let scene = scene("samples = 1\ntolerance = 0", 24, 24);
    let nodes = |cut: &Cut| {
        let (steps, census) = tree.walk(&scene, cut, None);
        (steps.iter().map(|step| step.request.node).collect::<Vec<_>>(), census)
    };
    let (all, _) = nodes(&Cut::FullDepth);
    assert_eq!(nodes(&by_error(0.0)).0, all, "nothing may be off");
    let (only_root, census) = nodes(&by_error(f64::INFINITY));
    assert_eq!((only_root, census.coarser), (vec![0], tree.nodes() - 1));
    // The less may be off, the more is drawn; what lies behind a veil counts by what that lets
    // through.
    let limits = [64.0, 32.0, 16.0, 8.0, 4.0, 2.0, 1.0];
    let drawn = |through: f64| {
        let census =
            |limit| tree.each_step(&scene, &by_error(limit), None, |_| (), |_| through).drawn;
        limits.map(census)
    };
    let (bare, veiled) = (drawn(1.0), drawn(0.25));
    assert!(bare.is_sorted() && bare[0] < bare[3] && bare[3] < bare[6], "{bare:?}");
    assert_eq!(veiled[2..], bare[..5]);
}

#[test]
fn digits_follow_the_limit_and_are_the_same_in_all_windows() {
    let tree = tree(&[0xff, 0b1011_0111], 5);
    let scene = scene("samples = 1", 24, 24);
    let digits = |cut: &Cut, window: Option<PixelRect>| {
        let steps = tree.walk(&scene, cut, window).0.into_iter();
        steps.map(|step| (step.request.node, step.request.precision)).collect::<Vec<_>>()
    };
    assert!(digits(&Cut::FullDepth, None).iter().all(|step| step.1 == Precision::Full));
    let short = FootprintCut::new(0.0, &scene, &domain(), BrickShape::new(8).unwrap()).unwrap();
    let short = digits(&Cut::Footprint(short.in_short()), None);
    assert!(short.iter().all(|step| step.1 == Precision::Short));
    let all = [1e-9, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1].map(|limit| digits(&by_error(limit), None));
    let count = |steps: &[(u64, Precision)], precision| {
        steps.iter().filter(|step| step.1 == precision).count() as f64 / steps.len() as f64
    };
    let parts = |precision| all.each_ref().map(|steps| count(steps, precision));
    let (short, full) = (parts(Precision::Short), parts(Precision::Full));
    assert!(short.is_sorted() && short[0] == 0.0 && short[6] == 1.0, "{short:?}");
    assert!(full.iter().rev().is_sorted() && full[0] == 1.0 && full[6] == 0.0, "{full:?}");
    for between in [Precision::Medium, Precision::Long] {
        assert!(all.iter().any(|steps| count(steps, between) > 0.0), "{between:?}");
    }
    let whole = digits(&by_error(1e-3), None);
    let window = PixelRect { lo: [3, 5], hi: [17, 9] };
    assert!(digits(&by_error(1e-3), Some(window)).iter().all(|step| whole.contains(step)));
}
