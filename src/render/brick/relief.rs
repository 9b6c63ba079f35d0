//! What a brick says of how far values differ near any place in it: for groups of cells, the
//! range and slopes of the interpolant. From these follow the differences between the rays of a
//! pixel, and what it means that a brick is drawn instead of those beneath it.

use std::borrow::Cow;

use super::scaled::ScaledBrick;
use super::steepness::{GroupSteepness, Steepness, Surveyor};
use crate::render::transfer::change::Change;
use crate::render::transfer::distance::{Distance, FAR};
use crate::render::transfer::pieces::PieceList;
use crate::render::transfer::span::Span;
use crate::render::transfer::storage::Storage;

/// Dual cells (with `cell`: cells) along a group's edge.
pub(crate) const GROUP_EDGE: usize = 4;
/// Rounding of the interpolant, of the largest value.
const VALUE_ROUNDING: f64 = 1e-12;

/// A cube of [`GROUP_EDGE`]³ dual cells. Ranges and slopes take in one dual cell more on every
/// side, as far as the brick knows it.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Group {
    /// Smallest x.
    pub(crate) low: f64,
    /// Largest x.
    pub(crate) high: f64,
    /// Steepest slope of x along each axis, per cell.
    pub(crate) slope: [f64; 3],
    /// Half the range of the slope along each axis, per cell.
    pub(crate) uneven: [f64; 3],
    /// Change by what is beneath the brick.
    pub(crate) levels: Change,
    /// In a thinner brick, a bound of the difference of x to that of the brick that it is made of.
    pub(crate) thinned: f64,
    /// Difference of x to that of the source's values, and its rounding, where these may be others:
    /// beneath.
    storage: Storage,
    /// The same where they are those of the group itself.
    own_storage: Storage,
    /// What the transfer function does over the range, and as far beyond it as the source's values may
    /// be, and those beneath where these are near: others of a square may meet steps there.
    pub(crate) span: Span,
    /// Whether part of the group is void: what is drawn ends there.
    pub(crate) has_void: bool,
    /// Whether something is shown where there may be nothing beneath: then slopes do not bound `levels`.
    pub(crate) fills_void: bool,
}

/// The groups of a brick. Its memory is reused from brick to brick.
#[derive(Debug, Default)]
pub(crate) struct Relief {
    /// Groups along an edge.
    side: usize,
    groups: Vec<Group>,
    /// All groups in one.
    pub(crate) whole: Group,
    /// How far steps of the transfer function must be looked for beyond the values themselves, by
    /// what is beneath.
    pub(crate) levels_reach: f64,
    /// Whether values are read in fewer digits than are stored.
    pub(crate) is_rounded: bool,
    /// Whether values are constant in each cell.
    pub(crate) is_piecewise_constant: bool,
}

impl Relief {
    /// Groups along the edge of a brick of `edge` cells.
    pub(crate) fn side_of(edge: usize) -> usize {
        (edge + 1).div_ceil(GROUP_EDGE)
    }

    /// Most heap bytes for a brick of `edge` cells.
    pub(crate) fn bytes(edge: usize) -> u64 {
        (Self::side_of(edge).pow(3) * size_of::<Group>()) as u64
    }

    /// Whether there is none.
    pub(crate) fn is_empty(&self) -> bool {
        self.groups.is_empty()
    }

    /// Forgets all groups; their memory is kept.
    pub(crate) fn clear(&mut self) {
        self.groups.clear();
    }

    /// The number of the group that holds a dual cell (or cell).
    #[inline]
    pub(crate) fn find(&self, cell: [i32; 3]) -> usize {
        let [x, y, z] = cell.map(|c| c as usize / GROUP_EDGE);
        (z * self.side + y) * self.side + x
    }

    /// Number of groups.
    pub(crate) fn count(&self) -> usize {
        self.groups.len()
    }

    /// Number of groups along an edge.
    pub(crate) fn side(&self) -> usize {
        self.side
    }

    /// The group with this number, x fastest; all in one where there is none.
    #[inline]
    pub(crate) fn group(&self, index: usize) -> &Group {
        self.groups.get(index).unwrap_or(&self.whole)
    }

    /// The group that holds a cell, or a dual cell.
    #[inline]
    pub(crate) fn group_at(&self, cell: [usize; 3]) -> &Group {
        let [x, y, z] = cell.map(|c| c / GROUP_EDGE);
        self.group((z * self.side + y) * self.side + x)
    }

    /// Looks at `brick`, which is prepared.
    pub(crate) fn fill(
        &mut self,
        brick: &ScaledBrick,
        pieces: &PieceList,
        distance: &Distance,
        surveyor: &mut Surveyor,
    ) {
        self.side = Self::side_of(brick.edge);
        self.groups.clear();
        self.groups.reserve_exact(self.side.pow(3));
        self.levels_reach = if distance.residual < FAR { distance.residual } else { 0.0 };
        self.is_rounded = distance.is_rounded;
        self.is_piecewise_constant = brick.is_piecewise_constant();
        let builder = GroupBuilder { brick, pieces, distance };
        for (at, of_group) in surveyor.look(brick, self.side).iter().enumerate() {
            let group = [at % self.side, at / self.side % self.side, at / self.side.pow(2)];
            self.groups.push(builder.group(of_group, group.map(|g| g * GROUP_EDGE)));
        }
        self.join(|whole| builder.span(whole, distance.near_beneath()));
    }

    /// Finds what holds for all groups; `span` is what the transfer function does over their range.
    fn join(&mut self, span: impl Fn(&Group) -> Span) {
        self.whole = self.groups.first().copied().unwrap_or_default();
        self.groups.iter().skip(1).for_each(|group| self.whole.take_in(group));
        let has_values = self.whole.low <= self.whole.high;
        self.whole.span = if has_values { span(&self.whole) } else { Span::default() };
    }

    /// Takes values to be those of a thinner brick, off by so much in each group from the one that
    /// `finer` is of.
    pub(crate) fn loosen(&mut self, finer: &Self, pieces: &PieceList, off: &[f64]) {
        let over = |group: &Group| {
            let off = group.storage.most();
            pieces.over(group.low - off, group.high + off)
        };
        for (n, (group, off)) in self.groups.iter_mut().zip(off).enumerate() {
            let most = |number: fn(&Group) -> f64| finer.most_beneath(n, self.side, number);
            group.thinned = off + most(|group| group.thinned);
            group.storage = Storage::at_most(most(|group| group.storage.most()));
            group.own_storage = Storage::at_most(most(|group| group.own_storage.most()));
            group.low -= group.thinned;
            group.high += group.thinned;
            group.span = over(group);
            group.levels = group.span.slope.times(group.thinned);
        }
        self.is_rounded = finer.is_rounded;
        self.join(over);
        let most = self.whole.thinned;
        self.levels_reach = if most < FAR { most } else { 0.0 };
    }

    /// The largest that a number is in groups that hold part of group `n` of a thinner brick, of
    /// `side` groups along an edge.
    fn most_beneath(&self, n: usize, side: usize, number: fn(&Group) -> f64) -> f64 {
        // Wider dual cells begin half of one, a finer one, before the cells.
        let within = |n: usize| (2 * n).saturating_sub(1)..=(2 * n + 1).min(self.side - 1);
        let mut most = 0.0_f64;
        for (y, z) in
            within(n / (side * side)).flat_map(|z| within(n / side % side).map(move |y| (y, z)))
        {
            let row = within(n % side).map(|x| (z * self.side + y) * self.side + x);
            most = row.fold(most, |most, at| most.max(number(self.group(at))));
        }
        most
    }

    /// What light is off by because of levels in any group, at most.
    pub(crate) fn most_levels(&self) -> Change {
        self.groups.iter().map(|group| group.levels).fold(Change::default(), Change::max)
    }

    /// The largest half range of slopes along each axis in any group.
    pub(crate) fn most_uneven(&self) -> [f64; 3] {
        let larger = |a: [f64; 3], b: &[f64; 3]| std::array::from_fn(|n| a[n].max(b[n]));
        self.groups.iter().fold([0.0; 3], |most, group| larger(most, &group.uneven))
    }

    /// What half as many cells along each axis would likely make of light in some group, at least.
    pub(crate) fn likely_thinned(&self) -> Change {
        // A slope that rises evenly by its range over a group and the cells beside it lets chords of
        // two cells be off by a quarter of its rise over a cell; of that a quarter again is taken.
        const SHARE: f64 = 2.0 / (GROUP_EDGE + 2) as f64 / 16.0;
        let bent = |group: &Group| SHARE * group.uneven.iter().sum::<f64>();
        let thinned = self.groups.iter().map(|group| group.span.slope.times(bent(group)));
        thinned.fold(Change::default(), Change::max)
    }

    /// What holds for all within `reach` cells of `point`, of which the groups themselves know one, if
    /// places are compared that are up to `apart` cells from each other.
    pub(crate) fn near(&self, point: [f64; 3], reach: f64, apart: f64) -> Cow<'_, Group> {
        let beyond = reach - 1.0;
        let last = self.side - 1;
        // Dual cells lie half a cell beside cells.
        let shift = if self.is_piecewise_constant { 0.0 } else { 0.5 };
        let group = |x: f64| (((x + shift) / GROUP_EDGE as f64).max(0.0) as usize).min(last);
        let groups =
            |off: f64| [group(point[0] + off), group(point[1] + off), group(point[2] + off)];
        let (lo, hi) = (groups(-beyond.max(0.0)), groups(beyond.max(0.0)));
        let first = self.group((lo[2] * self.side + lo[1]) * self.side + lo[0]);
        if lo == hi {
            return Cow::Borrowed(first);
        }
        let mut all = *first;
        for z in lo[2]..=hi[2] {
            for y in lo[1]..=hi[1] {
                for x in lo[0]..=hi[0] {
                    all.take_in(self.group((z * self.side + y) * self.side + x));
                }
            }
        }
        if apart > 1.0 {
            // No group knows both places.
            let Span { variation, jumps, .. } = self.whole.span;
            all.span = Span { variation, jumps, ..all.span };
        }
        Cow::Owned(all)
    }

    /// What holds of what `group` knows in all places that are within `away` (cells along each axis) of one
    /// at which the interpolant is `x`.
    pub(crate) fn close_to(
        &self,
        group: &Group,
        x: f64,
        away: [f64; 3],
        pieces: &PieceList,
    ) -> Group {
        let largest = group.low.abs().max(group.high.abs());
        let over = (0..3).map(|a| group.slope[a] * away[a]).sum::<f64>() + VALUE_ROUNDING * largest;
        let [low, high] = [(x - over).max(group.low), (x + over).min(group.high)];
        if low <= high {
            let off = group.storage.most() + group.thinned + self.levels_reach;
            Group { low, high, span: pieces.over(low - off, high + off), ..*group }
        } else {
            *group
        }
    }
}

impl Group {
    /// Change where what is drawn ends.
    pub(crate) fn border(&self) -> Change {
        if self.has_void { self.span.most } else { Change::default() }
    }

    /// How far light at two places may differ between which x is off by `over` by its slopes.
    pub(crate) fn change(&self, over: f64) -> Change {
        let Span { slope, variation, jumps, .. } = self.span;
        slope.times(over).min(variation).plus(jumps)
    }

    /// Change from one constant cell to any other, or to none.
    pub(crate) fn elsewhere(&self) -> Change {
        self.span.variation.plus(self.span.jumps).max(self.border())
    }

    /// Difference of x to that of the source's values; `is_elsewhere`: which may be others, beneath or
    /// along other rays.
    #[inline]
    pub(crate) fn storage(&self, is_elsewhere: bool) -> Storage {
        if is_elsewhere { self.storage } else { self.own_storage }
    }

    /// What such stored values make of emission and extinction, at most.
    pub(crate) fn most_stored(&self, is_elsewhere: bool) -> Change {
        self.span.slope.times(self.storage(is_elsewhere).most())
    }

    /// Makes of it what holds for `other` as well.
    fn take_in(&mut self, other: &Self) {
        self.low = self.low.min(other.low);
        self.high = self.high.max(other.high);
        self.slope = std::array::from_fn(|a| self.slope[a].max(other.slope[a]));
        // Slopes of both signs: the range of all of them.
        self.uneven = self.slope;
        self.levels = self.levels.max(other.levels);
        self.thinned = self.thinned.max(other.thinned);
        self.storage = self.storage.max(other.storage);
        self.own_storage = self.own_storage.max(other.own_storage);
        self.span = self.span.max(other.span);
        self.has_void |= other.has_void;
        self.fills_void |= other.fills_void;
    }
}

/// What is common to a brick's groups.
struct GroupBuilder<'a> {
    brick: &'a ScaledBrick,
    pieces: &'a PieceList,
    distance: &'a Distance,
}

impl GroupBuilder<'_> {
    fn group(&self, of_group: &GroupSteepness, first: [usize; 3]) -> Group {
        let Steepness { values, slopes } = of_group.steepness;
        let mut group = Group {
            low: values[0],
            high: values[1],
            slope: slopes.map(|[least, most]| least.abs().max(most.abs())),
            uneven: slopes.map(|[least, most]| 0.5 * (most - least)),
            has_void: of_group.has_void,
            ..Group::default()
        };
        if group.low > group.high {
            return group;
        }
        let Distance { residual, fills_void, tree, storage, leaf_storage, .. } = *self.distance;
        let has_children = (residual > 0.0 || fills_void) && self.has_children(first, 1);
        let is_constant = self.brick.is_piecewise_constant();
        let of = if is_constant { Storage::of_cells } else { Storage::new };
        let stored = if of_group.holds_averages { storage } else { leaf_storage };
        let own = of(&stored, [group.low, group.high], 0.0, tree);
        group.storage = if has_children {
            // What lies beneath is off by parts of its own values; averages take part beside borders.
            of(&storage, [group.low, group.high], residual, tree)
        } else {
            own
        };
        // Constant cells do not tell whether they stand for what lies beneath.
        let stands = is_constant && has_children && self.has_children(first, 0);
        group.own_storage = if stands { group.storage } else { own };
        group.span =
            self.span(&group, if has_children { self.distance.near_beneath() } else { 0.0 });
        group.fills_void = has_children && fills_void;
        if group.fills_void {
            let [low, high] = [tree[0].min(group.low), tree[1].max(group.high)];
            group.levels = self.pieces.over(low, high).most;
        } else if has_children {
            group.levels = if is_constant || residual.is_nan() || residual >= FAR {
                self.far_change(&group)
            } else {
                self.change(&group, residual)
            };
        }
        group
    }

    /// What the transfer function does over a group's range, and where values beneath are so far off.
    fn span(&self, Group { low, high, storage, .. }: &Group, beneath: f64) -> Span {
        let off = storage.most() + beneath;
        self.pieces.over(low - off, high + off)
    }

    /// Change by values at most `distance` off, without steps.
    fn change(&self, group: &Group, distance: f64) -> Change {
        let span = self.pieces.over(group.low - distance, group.high + distance);
        span.slope.times(distance)
    }

    fn far_change(&self, group: &Group) -> Change {
        let [low, high] = self.distance.range_beneath([group.low, group.high]);
        let span = self.pieces.over(low, high);
        let distance = self.distance.residual.min(high - low);
        let by_slope = span.slope.times(distance).plus(span.jumps);
        by_slope.min(span.variation.plus(span.jumps))
    }

    /// Whether an octant that the group, or what lies up to so many cells around it, reaches into has a
    /// child.
    fn has_children(&self, first: [usize; 3], around: usize) -> bool {
        let half = self.brick.edge / 2;
        let reaches = |a: usize, upper: bool| {
            if upper { first[a] + GROUP_EDGE + around > half } else { first[a] < half + around }
        };
        (0..8u8).any(|octant| {
            self.distance.child_mask >> octant & 1 == 1
                && (0..3).all(|a| reaches(a, octant >> a & 1 == 1))
        })
    }
}

#[cfg(test)]
#[path = "relief_tests.rs"]
mod tests;
