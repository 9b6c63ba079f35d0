//! How far the values of a brick's blocks range, and their slopes, group by group.

use super::blocks::ScaledBlock;
use super::parents::{ParentRow, Parents};
use super::ranges::Ranges;
use super::relief::GROUP_EDGE;
use super::scaled::{ScaledBrick, dual};
use super::windows::{Folder, Triples, Window};
use crate::cache::state;
use crate::lanes::{Kernel, Lanes, Width};

/// How far values of some cells range, and their slopes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Steepness {
    /// Smallest and largest value.
    pub(super) values: [f64; 2],
    /// Least and steepest slope along each axis, with their signs, per cell of the brick.
    pub(super) slopes: [[f64; 2]; 3],
}

/// What holds for a group of dual cells, or cells.
#[derive(Debug, Clone, Copy)]
pub(super) struct GroupSteepness {
    /// How its values and slopes range.
    pub(super) steepness: Steepness,
    /// Whether part of it is void.
    pub(super) has_void: bool,
    /// Whether any values are, or come from, averages of refined cells.
    pub(super) holds_averages: bool,
}

/// One thread's buffers for looking at bricks.
#[derive(Debug, Default)]
pub(crate) struct Surveyor {
    ranges: Ranges,
    numbers: Folder<f64>,
    flags: Folder<u8>,
    /// The windows of the groups' values in the block in hand, and of the places between two of
    /// these: one shorter.
    windows: Triples,
    shorter: Triples,
    /// What holds for each group, x fastest.
    of_groups: Vec<GroupSteepness>,
    is_mixed: Vec<bool>,
    /// How values of the block in hand range, and their slopes, in each group's windows.
    of_block: Vec<Steepness>,
    differences: Vec<f64>,
}

/// Flags of a dual cell: it is not [`dual::PLAIN`]; it is [`dual::VOID`].
const IS_MIXED: u8 = 1;
const IS_VOID: u8 = 2;

impl Steepness {
    /// Largest less smallest slope along axis `a`.
    fn range(&self, a: usize) -> f64 {
        self.slopes[a][1] - self.slopes[a][0]
    }

    /// Takes in those of a level whose cells are 1 / `scale` of the brick's.
    fn take(&mut self, other: &Self, scale: f64) {
        self.values = [self.values[0].min(other.values[0]), self.values[1].max(other.values[1])];
        for (own, other) in self.slopes.iter_mut().zip(&other.slopes) {
            *own = [own[0].min(other[0] * scale), own[1].max(other[1] * scale)];
        }
    }

    fn loosen(&mut self, by: f64) {
        self.slopes = self.slopes.map(|[least, most]| [least - by, most + by]);
    }
}

impl Surveyor {
    /// Most heap bytes for bricks of `edge` cells.
    pub(crate) fn bytes(edge: usize) -> u64 {
        let (side, groups) = (edge + 2, (edge + 1).div_ceil(GROUP_EDGE));
        let of_group = size_of::<GroupSteepness>() + size_of::<Steepness>() + 9;
        let windows = 2 * 3 * groups.next_power_of_two().max(4) * size_of::<Window>();
        Ranges::bytes(side)
            + Folder::<f64>::bytes(side, groups)
            + Folder::<u8>::bytes(side, groups)
            + (groups.pow(3) * of_group + windows) as u64
    }

    /// Looks at the groups of `brick`, which is prepared, x fastest, `side` along each edge.
    pub(super) fn look(&mut self, brick: &ScaledBrick, side: usize) -> &[GroupSteepness] {
        self.of_groups.clear();
        self.of_groups.reserve_exact(side.pow(3));
        if brick.is_piecewise_constant() {
            self.cells(brick, side);
        } else {
            self.dual_cells(brick, side);
        }
        &self.of_groups
    }

    /// Sets the windows of each of `side` groups, alike along all axes.
    fn set_windows(&mut self, along: impl Fn(usize) -> Window, side: usize) {
        for windows in &mut self.windows {
            windows.clear();
            windows.extend((0..side).map(&along));
        }
        self.shorten();
    }

    /// Follows changed windows.
    fn shorten(&mut self) {
        for (shorter, windows) in self.shorter.iter_mut().zip(&self.windows) {
            shorter.clear();
            shorter.extend(windows.iter().map(|&(first, last)| (first, last.max(1) - 1)));
        }
    }

    /// Looks at groups of cells, with one more on every side within the brick.
    fn cells(&mut self, brick: &ScaledBrick, side: usize) {
        let (block, edge) = (&brick.blocks[0], brick.edge);
        let along = |group: usize| {
            let first = group * GROUP_EDGE;
            // Counted with ghosts. The last group may hold dual cells alone.
            (first.max(1), (first + GROUP_EDGE + 1).min(edge))
        };
        self.set_windows(along, side);
        let Self { ranges, flags, windows, of_groups, of_block, .. } = self;
        of_block.clear();
        of_block.reserve_exact(windows.iter().map(Vec::len).product());
        ranges.find(&block.values, block.side, windows, of_block);
        of_groups.extend(of_block.iter().map(|found| {
            let steepness = Steepness { values: found.values, slopes: [[0.0; 2]; 3] };
            // Cells that have averages have children, which says as much.
            GroupSteepness { steepness, has_void: false, holds_averages: false }
        }));
        let mut of_group = of_groups.iter_mut();
        let area = block.side * block.side;
        flags.fold(
            block.side,
            windows,
            0,
            |a, b| a | b,
            |z, plane| {
                let cells = plane.iter_mut().zip(&block.values[z * area..]);
                cells.for_each(|(flag, x)| *flag = u8::from(x.is_nan()));
            },
            |void| {
                if let Some(of_group) = of_group.next() {
                    of_group.has_void = void != 0;
                }
            },
        );
    }

    /// Looks at groups of dual cells, with one more on every side as far as the brick knows it.
    fn dual_cells(&mut self, brick: &ScaledBrick, side: usize) {
        let edge = brick.edge;
        // A dual cell lies between its cell, counted with ghosts, and the next.
        let first = |group: usize| (group * GROUP_EDGE).saturating_sub(1);
        let last = |group: usize| (group * GROUP_EDGE + GROUP_EDGE).min(edge);
        self.set_windows(|group| (first(group), last(group) + 1), side);
        self.steepness(&brick.blocks[0]);
        let plain = |&steepness: &Steepness| {
            let (has_void, holds_averages) = (false, false);
            GroupSteepness { steepness, has_void, holds_averages }
        };
        self.of_groups.extend(self.of_block.iter().map(plain));
        let is_leaf = |bits| (bits == state::EXISTS) | (bits == state::OUTSIDE);
        if !state::any(&brick.blocks[0].states, |bits| !is_leaf(bits)) {
            return;
        }
        self.mark(brick);
        if self.is_mixed.contains(&true) {
            self.widen(&brick.blocks[..brick.used]);
        }
    }

    /// Finds where formulas differ, and what is void.
    fn mark(&mut self, brick: &ScaledBrick) {
        let Self { flags, windows, shorter, of_groups, is_mixed, .. } = self;
        let count = brick.edge + 1;
        is_mixed.clear();
        is_mixed.reserve_exact(of_groups.len());
        let mut of_group = of_groups.iter_mut();
        if brick.duals.is_empty() {
            is_mixed.resize(of_group.len(), false);
        } else {
            flags.fold(
                count,
                shorter,
                0,
                |a, b| a | b,
                |z, plane| {
                    let kinds = &brick.duals[z * count * count..];
                    for (flag, &kind) in plane.iter_mut().zip(kinds) {
                        let (mixed, void) = (kind != dual::PLAIN, kind == dual::VOID);
                        *flag = (u8::from(mixed) * IS_MIXED) | (u8::from(void) * IS_VOID);
                    }
                },
                |found| {
                    is_mixed.push(found & IS_MIXED != 0);
                    if let Some(of_group) = of_group.next() {
                        of_group.has_void = found & IS_VOID != 0;
                    }
                },
            );
        }
        let block = &brick.blocks[0];
        let mut marked = of_groups.iter_mut().zip(is_mixed.iter());
        flags.fold(
            block.side,
            windows,
            0,
            |a, b| a | b,
            |z, plane| plane.copy_from_slice(&block.states[z * plane.len()..][..plane.len()]),
            |found| {
                if let Some((of_group, is_mixed)) = marked.next() {
                    of_group.has_void |= *is_mixed && found & state::VOID != 0;
                    let averages = state::REFINED | state::VOID;
                    of_group.holds_averages = *is_mixed || found & averages != 0;
                }
            },
        );
    }

    /// Beside borders of levels, values blend into those of ancestors: within the range of all of
    /// these, with slopes between theirs, give or take the weight's (two a cell) times the
    /// difference of the two levels that it blends.
    fn widen(&mut self, blocks: &[ScaledBlock]) {
        for pair in blocks.windows(2) {
            let [fine, coarse] = pair else { break };
            let parents = Parents::new(coarse);
            self.differ(fine, &parents);
            for (a, windows) in self.windows.iter_mut().enumerate() {
                for window in windows {
                    *window = parents.around(a, *window);
                }
            }
            self.shorten();
            self.steepness(coarse);
            let groups = self.of_groups.iter_mut().zip(&self.is_mixed);
            for ((of_group, _), (above, difference)) in groups
                .zip(self.of_block.iter().zip(&self.differences))
                .filter(|((_, is_mixed), _)| **is_mixed)
            {
                // Between the fine cells' centres the coarser values bend once more.
                let bend = (0..3).map(|a| above.range(a)).sum::<f64>() * 0.25;
                of_group.steepness.take(above, coarse.scale);
                of_group.steepness.loosen(2.0 * (difference + bend) * 2.0 * coarse.scale);
            }
        }
    }

    /// Range and slopes of the block's values in each triple of windows, per cell of it.
    fn steepness(&mut self, block: &ScaledBlock) {
        let Self { ranges, windows, of_block, .. } = self;
        of_block.clear();
        of_block.reserve_exact(windows.iter().map(Vec::len).product());
        ranges.find(&block.values, block.side, windows, of_block);
    }

    /// The largest difference of the finer block's values to the coarser interpolant at their
    /// places, in each triple of windows.
    fn differ(&mut self, fine: &ScaledBlock, parents: &Parents<'_>) {
        let Self { numbers, windows, differences, .. } = self;
        differences.clear();
        differences.reserve_exact(windows.iter().map(Vec::len).product());
        let area = fine.side * fine.side;
        numbers.fold(
            fine.side,
            windows,
            0.0,
            |most, x| if x > most { x } else { most },
            |z, differences| {
                let values = &fine.values[z * area..][..area];
                Width::best().run(Differ { values, side: fine.side, parents, z, differences });
            },
            |most| differences.push(most),
        );
    }
}

/// The differences of a plane z of values to what is made of the coarser ones, compiled for the
/// processor that the lanes are of.
struct Differ<'d> {
    values: &'d [f64],
    side: usize,
    parents: &'d Parents<'d>,
    z: usize,
    differences: &'d mut [f64],
}

impl Kernel for Differ<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, _: L) {
        let Self { values, side, parents, z, differences } = self;
        let mut row = ParentRow::default();
        let rows = differences.chunks_exact_mut(side).zip(values.chunks_exact(side));
        for (y, (differences, values)) in rows.enumerate() {
            let above = parents.row([y, z], &mut row);
            for ((difference, value), above) in differences.iter_mut().zip(values).zip(above) {
                *difference = (value - above).abs();
            }
        }
    }
}

#[cfg(test)]
#[path = "steepness_tests.rs"]
mod tests;
