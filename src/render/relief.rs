//! What a brick says of how far values differ near any place in it: for groups of cells, the
//! range and slopes of the interpolant. From these follow the differences between the rays of a
//! pixel, and what it means that a brick is drawn instead of those beneath it.

use super::ray_error::Change;
use super::scaled::{ScaledBlock, ScaledBrick, dual};
use super::span::Span;
use super::transfer_pieces::PieceList;
use crate::scene::Rounding;

/// Dual cells (with `cell`: cells) along a group's edge.
pub(super) const GROUP_EDGE: usize = 4;
/// Values farther off than this count by the transfer function's whole variation over the range
/// that they may take, steps included; nearer ones by its slope, and steps where they are met.
const FAR: f64 = 1e-3;
/// Relative rounding of interpolated values.
const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// A cube of [`GROUP_EDGE`]³ dual cells. Ranges and slopes take in one dual cell more on every
/// side, as far as the brick knows it.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Group {
    /// Smallest and largest x.
    pub(super) low: f64,
    pub(super) high: f64,
    /// Steepest slope of x along each axis, per cell.
    pub(super) slope: [f64; 3],
    /// Half the range of the slope along each axis, per cell.
    pub(super) uneven: [f64; 3],
    /// Change by what is beneath the brick.
    pub(super) levels: Change,
    /// Bound of the difference of x to that of the source's values, and of its rounding.
    pub(super) storage: f64,
    /// What the transfer function does over the range.
    pub(super) span: Span,
    /// Whether part of the group is void: what is drawn ends there.
    pub(super) has_void: bool,
}

/// How far from the truth a brick's values are, in x.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Distance {
    /// Bound of the difference to the finest interpolant, where children hide.
    pub(super) residual: f64,
    /// Which octants have children.
    pub(super) child_mask: u8,
    /// What x can be in the brick's box at any level.
    pub(super) tree: [f64; 2],
    /// Of values stored to those of the source.
    pub(super) storage: Rounding,
}

/// The groups of a brick. Its memory is reused from brick to brick.
#[derive(Debug, Default)]
pub(super) struct Relief {
    /// Groups along an edge.
    side: usize,
    groups: Vec<Group>,
    /// All groups in one.
    pub(super) whole: Group,
    /// How far steps of the transfer function must be looked for beyond the values themselves, by
    /// what is beneath.
    pub(super) levels_reach: f64,
}

impl Relief {
    /// Groups along the edge of a brick of `edge` cells.
    fn side_of(edge: usize) -> usize {
        (edge + 1).div_ceil(GROUP_EDGE)
    }

    /// Most heap bytes for a brick of `edge` cells.
    pub(super) fn bytes(edge: usize) -> u64 {
        (Self::side_of(edge).pow(3) * size_of::<Group>()) as u64
    }

    /// Whether there is none.
    pub(super) fn is_empty(&self) -> bool {
        self.groups.is_empty()
    }

    pub(super) fn clear(&mut self) {
        self.groups.clear();
    }

    /// The number of the group that holds a dual cell (or cell).
    #[inline]
    pub(super) fn find(&self, cell: [i32; 3]) -> usize {
        let [x, y, z] = cell.map(|c| c as usize / GROUP_EDGE);
        (z * self.side + y) * self.side + x
    }

    /// Number of groups, and of those along an edge.
    pub(super) fn count(&self) -> usize {
        self.groups.len()
    }

    pub(super) fn side(&self) -> usize {
        self.side
    }

    #[inline]
    pub(super) fn group(&self, index: usize) -> &Group {
        self.groups.get(index).unwrap_or(&self.whole)
    }

    /// Looks at `brick`, which is prepared.
    pub(super) fn fill(&mut self, brick: &ScaledBrick, pieces: &PieceList, distance: &Distance) {
        self.side = Self::side_of(brick.edge);
        self.groups.clear();
        self.groups.reserve_exact(self.side.pow(3));
        self.levels_reach = if distance.residual < FAR { distance.residual } else { 0.0 };
        let looker = Looker { brick, pieces, distance };
        for at in 0..self.side.pow(3) {
            let group = [at % self.side, at / self.side % self.side, at / self.side.pow(2)];
            self.groups.push(looker.group(group.map(|g| g * GROUP_EDGE)));
        }
        self.whole = self.groups.iter().copied().reduce(Group::with).unwrap_or_default();
        let Group { low, high, .. } = self.whole;
        self.whole.span = if low <= high { pieces.over(low, high) } else { Span::default() };
    }

    /// What holds for all within `reach` cells of `point`, of which the groups themselves know
    /// one.
    pub(super) fn near(&self, point: [f64; 3], reach: f64) -> Group {
        let beyond = reach - 1.0;
        let last = self.side - 1;
        let group = |x: f64| ((x + 0.5) / GROUP_EDGE as f64).max(0.0) as usize;
        let [lo, hi] =
            [beyond.max(0.0), -beyond.max(0.0)].map(|off| point.map(|x| group(x - off).min(last)));
        let mut all = *self.group((lo[2] * self.side + lo[1]) * self.side + lo[0]);
        for z in lo[2]..=hi[2] {
            for y in lo[1]..=hi[1] {
                for x in lo[0]..=hi[0] {
                    all = all.with(*self.group((z * self.side + y) * self.side + x));
                }
            }
        }
        all
    }
}

impl Group {
    /// What holds for both.
    fn with(self, other: Self) -> Self {
        let larger = |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|n| a[n].max(b[n]));
        let slope = larger(self.slope, other.slope);
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            slope,
            // Slopes of both signs: the range of all of them.
            uneven: slope,
            levels: self.levels.max(other.levels),
            storage: self.storage.max(other.storage),
            span: self.span.max(other.span),
            has_void: self.has_void || other.has_void,
        }
    }
}

struct Looker<'a> {
    brick: &'a ScaledBrick,
    pieces: &'a PieceList,
    distance: &'a Distance,
}

impl Looker<'_> {
    fn group(&self, first: [usize; 3]) -> Group {
        let mut group = if self.brick.is_piecewise_constant() {
            self.cells(first)
        } else {
            self.dual_cells(first)
        };
        if group.low > group.high {
            return group;
        }
        group.span = self.pieces.over(group.low, group.high);
        let Distance { residual, tree, storage, .. } = *self.distance;
        // Where neighbours are far larger their share is rounding.
        let rounding = ROUNDING * group.low.abs().max(group.high.abs());
        group.storage = storage.between(group.low, group.high) + rounding;
        if residual > 0.0 && self.has_children(first) {
            group.levels =
                if self.brick.is_piecewise_constant() || residual.is_nan() || residual >= FAR {
                    self.far_change(&group, residual, tree)
                } else {
                    self.change(&group, residual)
                };
        }
        group
    }

    /// Change by values at most `distance` off, without steps.
    fn change(&self, group: &Group, distance: f64) -> Change {
        let span = self.pieces.over(group.low - distance, group.high + distance);
        span.slope.times(distance)
    }

    fn far_change(&self, group: &Group, distance: f64, tree: [f64; 2]) -> Change {
        let low = (group.low - distance).max(tree[0].min(group.low));
        let high = (group.high + distance).min(tree[1].max(group.high));
        let span = self.pieces.over(low, high);
        let by_slope = span.slope.times(distance.min(high - low)).plus(span.jumps);
        by_slope.min(span.variation.plus(span.jumps))
    }

    /// Whether an octant that the group reaches into has a child.
    fn has_children(&self, first: [usize; 3]) -> bool {
        let half = self.brick.edge / 2;
        let reaches = |a: usize, upper: bool| {
            if upper { first[a] + GROUP_EDGE >= half } else { first[a] <= half }
        };
        (0..8u8).any(|octant| {
            self.distance.child_mask >> octant & 1 == 1
                && (0..3).all(|a| reaches(a, octant >> a & 1 == 1))
        })
    }

    /// Of dual cells from `first` on: between cells counted with ghosts.
    fn dual_cells(&self, first: [usize; 3]) -> Group {
        let edge = self.brick.edge;
        let lo = first.map(|f| f.saturating_sub(1));
        let hi = first.map(|f| (f + GROUP_EDGE).min(edge));
        let block = &self.brick.blocks[0];
        let mut steepness = slopes(block, lo, hi);
        let group = steepness.group();
        if self.brick.duals.is_empty() {
            return group;
        }
        let count = edge + 1;
        let (mut mixed, mut void) = (false, false);
        for z in lo[2]..=hi[2] {
            for y in lo[1]..=hi[1] {
                for &kind in &self.brick.duals[(z * count + y) * count..][lo[0]..=hi[0]] {
                    mixed |= kind != dual::PLAIN;
                    void |= kind == dual::VOID;
                }
            }
        }
        if mixed {
            void |= self.has_void(lo, hi);
            self.widen(&mut steepness, lo, hi);
        }
        Group { has_void: void, ..steepness.group() }
    }

    fn has_void(&self, lo: [usize; 3], hi: [usize; 3]) -> bool {
        let block = &self.brick.blocks[0];
        let mut cells = (lo[2]..=hi[2] + 1).flat_map(|z| (lo[1]..=hi[1] + 1).map(move |y| (y, z)));
        cells.any(|(y, z)| {
            let row = block.at([lo[0], y, z]);
            let states = &block.states[row..row + hi[0] + 2 - lo[0]];
            states.iter().any(|bits| bits & crate::cache::state::VOID != 0)
        })
    }

    /// Beside borders of levels, values blend into those of ancestors: within the range of all of
    /// these, with slopes between theirs, give or take the weight's (two a cell) times the
    /// difference of the two levels that it blends.
    fn widen(&self, group: &mut Steepness, lo: [usize; 3], hi: [usize; 3]) {
        let blocks = &self.brick.blocks[..self.brick.used];
        let mut reach = (lo, hi.map(|h| h + 1));
        for pair in blocks.windows(2) {
            let [fine, coarse] = pair else { break };
            let parents = Parents::new(coarse);
            let mut difference = 0.0_f64;
            for_each_row(reach, |y, z| {
                for x in reach.0[0]..=reach.1[0] {
                    let value = fine.values[fine.at([x, y, z])];
                    difference = difference.max((value - parents.at([x, y, z])).abs());
                }
            });
            reach = parents.around(reach);
            let above = slopes(coarse, reach.0, reach.1.map(|h| h - 1));
            // Between the fine cells' centres the coarser values bend once more.
            let bend = (0..3).map(|a| above.range(a)).sum::<f64>() * 0.25;
            group.take(&above, coarse.scale);
            group.loosen(2.0 * (difference + bend) * 2.0 * coarse.scale);
        }
    }

    /// Of cells from `first` on, and one more on every side within the brick.
    fn cells(&self, first: [usize; 3]) -> Group {
        let block = &self.brick.blocks[0];
        let edge = self.brick.edge;
        let mut group = Group { low: f64::INFINITY, high: f64::NEG_INFINITY, ..Group::default() };
        let mut void = false;
        let lo = first.map(|f| f.saturating_sub(1));
        let hi = first.map(|f| (f + GROUP_EDGE + 1).min(edge));
        for z in lo[2]..hi[2] {
            for y in lo[1]..hi[1] {
                let row = block.at([1, y + 1, z + 1]);
                for &x in block.values.get(row + lo[0]..row + hi[0]).unwrap_or_default() {
                    void |= x.is_nan();
                    (group.low, group.high) = (group.low.min(x), group.high.max(x));
                }
            }
        }
        group.has_void = void;
        group
    }
}

/// Range of values, and of their slopes along each axis, per cell of the brick.
struct Steepness {
    values: [f64; 2],
    slopes: [[f64; 2]; 3],
}

impl Steepness {
    fn group(&self) -> Group {
        let slope = self.slopes.map(|[least, most]| least.abs().max(most.abs()));
        Group {
            low: self.values[0],
            high: self.values[1],
            slope,
            uneven: self.slopes.map(|[least, most]| 0.5 * (most - least)),
            ..Group::default()
        }
    }

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

/// What a coarser block says of the cells of the next finer one.
struct Parents<'b> {
    coarse: &'b ScaledBlock,
    /// Which half of its parent the finer block's first cell (its ghost not counted) is.
    upper: [usize; 3],
}

impl<'b> Parents<'b> {
    fn new(coarse: &'b ScaledBlock) -> Self {
        let upper = coarse.corner.map(|corner| (2.0 * corner.fract()) as usize & 1);
        Self { coarse, upper }
    }

    /// The parent of the finer block's cell `cell` along axis `a`, and its neighbour on the
    /// cell's side; ghosts counted.
    fn along(&self, a: usize, cell: usize) -> [usize; 2] {
        let place = cell + 1 + self.upper[a];
        let (parent, last) = (place / 2, self.coarse.side - 1);
        let beside = if place.is_multiple_of(2) { parent.saturating_sub(1) } else { parent + 1 };
        [parent.min(last), beside.min(last)]
    }

    /// The coarser interpolant at the centre of the finer block's cell.
    fn at(&self, cell: [usize; 3]) -> f64 {
        let parents: [[usize; 2]; 3] = std::array::from_fn(|a| self.along(a, cell[a]));
        let weight = |bit: usize| if bit == 0 { 0.75 } else { 0.25 };
        (0..8)
            .map(|n| {
                let side: [usize; 3] = std::array::from_fn(|a| n >> a & 1);
                let at = self.coarse.at(std::array::from_fn(|a| parents[a][side[a]]));
                weight(side[0]) * weight(side[1]) * weight(side[2]) * self.coarse.values[at]
            })
            .sum()
    }

    /// The cells that the interpolant draws on between those of `reach`.
    fn around(&self, reach: ([usize; 3], [usize; 3])) -> ([usize; 3], [usize; 3]) {
        let last = self.coarse.side - 1;
        let lo =
            std::array::from_fn(|a| self.along(a, reach.0[a])[0].saturating_sub(1).min(last - 1));
        let hi: [usize; 3] = std::array::from_fn(|a| (self.along(a, reach.1[a])[0] + 1).min(last));
        (lo, std::array::from_fn(|a| hi[a].max(lo[a] + 1)))
    }
}

fn for_each_row((lo, hi): ([usize; 3], [usize; 3]), mut look: impl FnMut(usize, usize)) {
    for z in lo[2]..=hi[2] {
        for y in lo[1]..=hi[1] {
            look(y, z);
        }
    }
}

/// Range and slopes of the values between cells `lo` and `hi` + 1 of `block`, per cell of it.
fn slopes(block: &ScaledBlock, lo: [usize; 3], hi: [usize; 3]) -> Steepness {
    const NONE: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];
    let mut steepness = Steepness { values: NONE, slopes: [NONE; 3] };
    let strides = [1, block.side, block.side * block.side];
    for_each_row((lo, hi.map(|h| h + 1)), |y, z| {
        let row = block.at([lo[0], y, z]);
        let count = hi[0] + 2 - lo[0];
        let values = &block.values[row..row + count];
        for &x in values {
            let [least, most] = steepness.values;
            steepness.values = [least.min(x), most.max(x)];
        }
        let mut along = |axis: usize, values: &[f64], next: &[f64]| {
            let [mut least, mut most] = steepness.slopes[axis];
            for (a, b) in values.iter().zip(next) {
                (least, most) = (least.min(b - a), most.max(b - a));
            }
            steepness.slopes[axis] = [least, most];
        };
        along(0, &values[..count - 1], &values[1..]);
        if y <= hi[1] {
            along(1, values, &block.values[row + strides[1]..][..count]);
        }
        if z <= hi[2] {
            along(2, values, &block.values[row + strides[2]..][..count]);
        }
    });
    steepness
}

#[cfg(test)]
#[path = "relief_tests.rs"]
mod tests;
