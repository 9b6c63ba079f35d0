//! Groups one by one, cell by cell: what the surveyor must find as well.

use super::*;
use crate::render::test_data::{TestData, rough};
use crate::scene::Interpolation;

const EDGE: usize = 8;
/// Bricks with holes, ghosts of one to three levels above, beside the domain's end, and whole.
const BRICKS: [(u32, [i128; 3]); 6] = [
    (0, [1, 0, 1]),
    (1, [1, 0, 1]),
    (1, [3, 1, 1]),
    (2, [2, 1, 2]),
    (3, [4, 3, 5]),
    (3, [7, 5, 6]),
];

type Box = ([usize; 3], [usize; 3]);

fn each((lo, hi): Box, mut look: impl FnMut([usize; 3])) {
    for z in lo[2]..=hi[2] {
        for y in lo[1]..=hi[1] {
            (lo[0]..=hi[0]).for_each(|x| look([x, y, z]));
        }
    }
}

/// Range and slopes of the values of the cells `within`.
fn steepness(block: &ScaledBlock, within: Box) -> Steepness {
    let mut all = Steepness::NONE;
    each(within, |cell| {
        let x = block.values[block.at(cell)];
        all.values = [all.values[0].min(x), all.values[1].max(x)];
        for a in (0..3).filter(|&a| cell[a] < within.1[a]) {
            let mut next = cell;
            next[a] += 1;
            let slope = block.values[block.at(next)] - x;
            all.slopes[a] = [all.slopes[a][0].min(slope), all.slopes[a][1].max(slope)];
        }
    });
    all
}

/// The coarser interpolant at the centre of the finer block's cell.
fn above(parents: &Parents<'_>, cell: [usize; 3]) -> f64 {
    let along: [[usize; 2]; 3] = std::array::from_fn(|a| parents.along(a, cell[a]));
    let weight = |bit: usize| if bit == 0 { 0.75 } else { 0.25 };
    let corner = |n: usize| {
        let side: [usize; 3] = std::array::from_fn(|a| n >> a & 1);
        let at = parents.coarse.at(std::array::from_fn(|a| along[a][side[a]]));
        side.map(weight).iter().product::<f64>() * parents.coarse.values[at]
    };
    (0..8).map(corner).sum()
}

fn group(brick: &ScaledBrick, first: [usize; 3]) -> Terrain {
    let lo = first.map(|f| f.saturating_sub(1));
    let duals = first.map(|f| (f + GROUP_EDGE).min(EDGE));
    let mut within = (lo, duals.map(|h| h + 1));
    let mut found = steepness(&brick.blocks[0], within);
    let (mut is_mixed, mut has_void) = (false, false);
    if !brick.duals.is_empty() {
        each((lo, duals), |[x, y, z]| {
            let kind = brick.duals[(z * (EDGE + 1) + y) * (EDGE + 1) + x];
            is_mixed |= kind != dual::PLAIN;
            has_void |= kind == dual::VOID;
        });
    }
    if is_mixed {
        let block = &brick.blocks[0];
        each(within, |cell| has_void |= block.states[block.at(cell)] & state::VOID != 0);
        for pair in brick.blocks[..brick.used].windows(2) {
            let parents = Parents::new(&pair[1]);
            let mut difference = 0.0_f64;
            each(within, |cell| {
                let off = pair[0].values[pair[0].at(cell)] - above(&parents, cell);
                difference = difference.max(off.abs());
            });
            let around: [Window; 3] =
                std::array::from_fn(|a| parents.around(a, (within.0[a], within.1[a])));
            within = (around.map(|w| w.0), around.map(|w| w.1));
            let coarse = steepness(&pair[1], within);
            let bend = (0..3).map(|a| coarse.range(a)).sum::<f64>() * 0.25;
            found.take(&coarse, pair[1].scale);
            found.loosen(2.0 * (difference + bend) * 2.0 * pair[1].scale);
        }
    }
    Terrain { steepness: found, has_void }
}

fn assert_near(a: [f64; 2], b: [f64; 2]) {
    let is_near = |a: f64, b: f64| a == b || (a - b).abs() <= 1e-13 * (1.0 + b.abs());
    assert!(is_near(a[0], b[0]) && is_near(a[1], b[1]), "{a:?}, not {b:?}");
}

#[test]
fn groups_are_as_they_are_one_by_one() {
    let mut surveyor = Surveyor::default();
    for (level, at) in BRICKS {
        let brick = TestData::new(rough).brick(level, at, EDGE as u32, Interpolation::Linear);
        let side = (EDGE + 1).div_ceil(GROUP_EDGE);
        let found = surveyor.look(&brick, side);
        assert_eq!(found.len(), side.pow(3));
        for (n, terrain) in found.iter().enumerate() {
            let first = [n % side, n / side % side, n / side / side].map(|g| g * GROUP_EDGE);
            let expected = group(&brick, first);
            assert_eq!(terrain.has_void, expected.has_void);
            assert_near(terrain.steepness.values, expected.steepness.values);
            for a in 0..3 {
                assert_near(terrain.steepness.slopes[a], expected.steepness.slopes[a]);
            }
        }
    }
}
