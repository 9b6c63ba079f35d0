//! Groups one by one, cell by cell: what the surveyor must find as well.

use super::*;
use crate::cache::BrickShape;
use crate::render::testing::data::{At, TestData, UNTIDY_BRICKS, rough};
use crate::scene::Interpolation;

const EDGE: usize = 8;
type Box = ([usize; 3], [usize; 3]);

fn each((lo, hi): Box, mut look: impl FnMut([usize; 3])) {
    for z in lo[2]..=hi[2] {
        for y in lo[1]..=hi[1] {
            (lo[0]..=hi[0]).for_each(|x| look([x, y, z]));
        }
    }
}

const NONE: Steepness = Steepness {
    values: [f64::INFINITY, f64::NEG_INFINITY],
    slopes: [[f64::INFINITY, f64::NEG_INFINITY]; 3],
};

/// Range and slopes of the values of the cells `within`.
fn steepness(block: &ScaledBlock, within: Box) -> Steepness {
    let mut all = NONE;
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

/// A group of cells, and one more on every side within the brick.
fn group_of_cells(brick: &ScaledBrick, first: [usize; 3]) -> GroupSteepness {
    let block = &brick.blocks[0];
    let mut values = [f64::INFINITY, f64::NEG_INFINITY];
    let mut has_void = false;
    // Ghosts counted, so that brick's own cells are 1 to EDGE.
    let within = (first.map(|f| f.max(1)), first.map(|f| (f + GROUP_EDGE + 1).min(EDGE)));
    each(within, |cell| {
        let x = block.values[block.at(cell)];
        has_void |= x.is_nan();
        values = [values[0].min(x), values[1].max(x)];
    });
    GroupSteepness {
        steepness: Steepness { values, slopes: [[0.0; 2]; 3] },
        has_void,
        holds_averages: false,
    }
}

fn group(brick: &ScaledBrick, first: [usize; 3]) -> (GroupSteepness, bool) {
    let lo = first.map(|f| f.saturating_sub(1));
    let duals = first.map(|f| (f + GROUP_EDGE).min(EDGE));
    let mut within = (lo, duals.map(|h| h + 1));
    let mut found = steepness(&brick.blocks[0], within);
    let (mut is_mixed, mut has_void, mut holds_averages) = (false, false, false);
    each(within, |cell| {
        let bits = brick.blocks[0].states[brick.blocks[0].at(cell)];
        holds_averages |= bits != state::EXISTS && bits != state::OUTSIDE;
    });
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
    (GroupSteepness { steepness: found, has_void, holds_averages }, is_mixed)
}

fn assert_near(a: [f64; 2], b: [f64; 2]) {
    let is_near = |a: f64, b: f64| a == b || (a - b).abs() <= 1e-13 * (1.0 + b.abs());
    assert!(is_near(a[0], b[0]) && is_near(a[1], b[1]), "{a:?}, not {b:?}");
}

/// The brick at `at`, or with void: cells of its own, or those that own its holes.
fn brick((level, at): At, void: Option<usize>, interpolation: Interpolation) -> ScaledBrick {
    let data = TestData::new(rough);
    let mut raw = data.raw(level, at, BrickShape::new(EDGE as u32).unwrap());
    if let Some(block) = void.and_then(|block| raw.blocks.get_mut(block)) {
        let exists = |(_, bits): &(usize, &mut u8)| **bits & state::EXISTS != 0;
        for (n, bits) in block.states.iter_mut().enumerate().filter(exists) {
            *bits |= if n % 97 == 0 { state::VOID } else { 0 };
        }
    }
    data.brick_of(&raw, (level, at), EDGE as u32, interpolation)
}

fn assert_alike(found: &GroupSteepness, expected: &GroupSteepness) {
    assert_eq!(found.has_void, expected.has_void);
    assert_eq!(found.holds_averages, expected.holds_averages);
    assert_near(found.steepness.values, expected.steepness.values);
    for a in 0..3 {
        assert_near(found.steepness.slopes[a], expected.steepness.slopes[a]);
    }
}

#[test]
fn groups_are_as_they_are_one_by_one() {
    let mut surveyor = Surveyor::default();
    let side = (EDGE + 1).div_ceil(GROUP_EDGE);
    let place = |n: usize| [n % side, n / side % side, n / side / side].map(|g| g * GROUP_EDGE);
    // Of groups of dual cells: mixed ones and others; with void and without, of dual cells and of
    // cells.
    let (mut mixed, mut averages, mut void) = ([0; 2], [0; 2], [[0; 2]; 2]);
    for at in UNTIDY_BRICKS {
        for dropped in [None, Some(0), Some(1)] {
            let linear = brick(at, dropped, Interpolation::Linear);
            let found = surveyor.look(&linear, side);
            assert_eq!(found.len(), side.pow(3));
            for (n, of_group) in found.iter().enumerate() {
                let (expected, is_mixed) = group(&linear, place(n));
                assert_alike(of_group, &expected);
                mixed[usize::from(is_mixed)] += 1;
                averages[usize::from(expected.holds_averages)] += 1;
                void[0][usize::from(expected.has_void)] += 1;
            }
            let cells = brick(at, dropped, Interpolation::Cell);
            let found = surveyor.look(&cells, side);
            assert_eq!(found.len(), side.pow(3));
            for (n, of_group) in found.iter().enumerate() {
                let expected = group_of_cells(&cells, place(n));
                assert_alike(of_group, &expected);
                void[1][usize::from(expected.has_void)] += 1;
            }
        }
    }
    let all = mixed.iter().chain(&averages).chain(void.iter().flatten());
    assert!(all.into_iter().all(|&count| count > 20), "{mixed:?} {averages:?} {void:?}");
}

#[test]
fn a_surveyor_stays_within_its_bytes() {
    let mut surveyor = Surveyor::default();
    let side = (EDGE + 1).div_ceil(GROUP_EDGE);
    for at in UNTIDY_BRICKS {
        for interpolation in [Interpolation::Linear, Interpolation::Cell] {
            surveyor.look(&brick(at, None, interpolation), side);
        }
    }
    let Surveyor { ranges, numbers, flags, windows, shorter, .. } = &surveyor;
    let triples = windows.iter().chain(shorter).map(Vec::capacity).sum::<usize>();
    let held = ranges.held()
        + numbers.held()
        + flags.held()
        + triples * size_of::<Window>()
        + surveyor.of_groups.capacity() * size_of::<GroupSteepness>()
        + surveyor.is_mixed.capacity()
        + surveyor.of_block.capacity() * size_of::<Steepness>()
        + surveyor.differences.capacity() * size_of::<f64>();
    assert!(held as u64 <= Surveyor::bytes(EDGE), "{held} of {}", Surveyor::bytes(EDGE));
}
