use super::*;
use crate::render::testing::scene::{scene, view};

const ALL: Footprint = Footprint {
    plane_lo: DVec2::NEG_INFINITY,
    plane_hi: DVec2::INFINITY,
    depth_lo: 0.0,
    depth_hi: 1.0,
};

fn rect(x: [u32; 2], y: [u32; 2]) -> PixelRect {
    PixelRect { lo: [x[0], y[0]], hi: [x[1], y[1]] }
}

#[test]
fn rays_are_needed_until_they_are_done() {
    let scene = scene("samples = 1", 130, 70);
    let grid = PixelGrid::new(&view(&scene), scene.render.samples);
    let (mut batch, mut squares) = (RayBatch::new(0), Vec::new());
    let whole = rect([64, 128], [64, 70]);
    grid.first_squares(&whole, &mut squares);
    batch.start(&grid, whole, &squares, false);
    assert_eq!(batch.needs(&rect([64, 65], [64, 65]), &ALL), 1.0);
    assert_eq!(batch.needs(&rect([127, 128], [69, 70]), &ALL), 1.0);
    // The strip of the first four rows; of the last pixel of its third row.
    let number = PixelOrder::of(&whole).number([63, 2]).unwrap();
    batch.alive[..4].fill(0);
    batch.alive[number / 64] = 1 << (number % 64);
    batch.states[number].transmittance = 0.25;
    assert_eq!(batch.needs(&rect([100, 128], [66, 67]), &ALL), 0.25);
    assert_eq!(batch.needs(&rect([64, 127], [66, 67]), &ALL), 0.0);
    assert_eq!(batch.needs(&rect([64, 127], [66, 69]), &ALL), 1.0);
    // What lies between the rays of four pixels.
    batch.start(&grid, whole, &squares, false);
    let [first, last] = [0, 5].map(|index| batch.aims[index].plane);
    let middle = first.midpoint(last);
    let between = |by: f64| {
        let reach = (last - first).abs() * by;
        Footprint { plane_lo: middle - reach, plane_hi: middle + reach, ..ALL }
    };
    let four = rect([64, 66], [64, 66]);
    assert_eq!(batch.needs(&four, &between(0.49)), 0.0);
    assert_eq!(batch.needs(&four, &between(0.51)), 1.0);
    squares.retain(|square| square.centre[0].floor() == 69.0);
    batch.start(&grid, whole, &squares, false);
    assert_eq!(batch.needs(&rect([64, 69], [64, 70]), &ALL), 0.0);
    let strips: Vec<_> = batch.strips(&rect([64, 128], [66, 69])).collect();
    assert_eq!(
        strips.iter().map(|strip| batch.squares_of(strip)).collect::<Vec<_>>(),
        [0..4, 4..6]
    );
    assert_eq!(batch.needs(&rect([69, 70], [69, 70]), &ALL), 1.0);
}
