//! Bricks in fewer cells than they have, where that is close enough.
//!
//! What lies beneath a brick is known of the brick as a whole (`render/plan/tree_walk.rs`). Around a peak
//! each level has its share of bricks that are finer than they need be, because a neighbour within
//! the same parent is not. Such a brick is drawn in cells twice as wide, or four or eight times, by
//! values that are found while it is in hand; and how far these are from its interpolant at most, in
//! each group of cells, is found likewise, and counted with what levels are off by.
//!
//! A cell's value is the interpolant at its centre, less what makes it stick out from that on one
//! side only: where x bends by x″ along an axis, the chord between two centres 2h apart is h²·x″/2 off
//! the finer one, so all values are moved by half as much.

use std::ops::RangeInclusive;

use super::halves::Halves;
use super::relief::{GROUP_EDGE, Relief};
use super::scaled::ScaledBrick;
use super::steepness::Surveyor;
use crate::cache::BrickShape;
use crate::lanes::MOST_LANES;
use crate::render::transfer::change::Change;
use crate::render::transfer::distance::Distance;
use crate::render::transfer::pieces::PieceList;
use crate::scene::Interpolation;

/// Bricks are halved so often at most, and not below so many cells along an edge.
const MOST_HALVINGS: usize = 3;
const FEWEST_CELLS: usize = 4;
/// Rays from which on fewer cells are worth the search: marching them takes longer than that.
pub(crate) const FEWEST_RAYS: usize = 64 * MOST_LANES;

/// One thread's thinner bricks: of the bricks that were thinned last, since the next tile's rays are
/// likely to meet these too. The memory is reused from brick to brick.
#[derive(Debug, Default)]
pub(crate) struct Thinner {
    kept: Vec<Kept>,
    /// Bricks of which thinner ones may be kept beside that in hand.
    room: usize,
    /// Bricks that were asked for.
    asked: u64,
    surveyor: Surveyor,
    /// Values of cells, ghosts included, before and after they are moved.
    values: [Vec<f64>; 2],
    /// Which of these values are those of the finer brick's own interpolant.
    is_own: Vec<bool>,
    comparison: Comparison,
}

/// Thinner bricks of one.
#[derive(Debug, Default)]
struct Kept {
    /// Its key.
    key: u64,
    /// Each of half as many cells as that before; and how many of them there are.
    bricks: [ScaledBrick; MOST_HALVINGS],
    made: usize,
    /// When it was asked for.
    asked: u64,
}

/// Buffers for comparing a brick with a thinner one.
#[derive(Debug, Default)]
struct Comparison {
    /// Values of both bricks at the same places.
    halves: Halves,
    row: Halves,
    /// How far apart they are along a row; and at most, for groups along y and z.
    apart: Vec<f64>,
    farthest: Vec<f64>,
    /// How far apart they are in each group, at most.
    off: Vec<f64>,
}

impl Thinner {
    /// With room for thinner ones of so many bricks more than one.
    pub(crate) fn new(room: usize) -> Self {
        Self { room, kept: Vec::with_capacity(1 + room), ..Self::default() }
    }

    /// Bytes that thinner ones of a brick of `shape` take at most.
    pub(crate) fn bytes_kept(shape: BrickShape) -> u64 {
        let mut shape = shape.coarser();
        let mut bytes = size_of::<Kept>() as u64;
        for _ in 0..MOST_HALVINGS {
            bytes += ScaledBrick::bytes(shape, 1, Interpolation::Linear);
            shape = shape.coarser();
        }
        bytes
    }

    /// Heap bytes at most, for bricks of `shape` with `blocks` blocks, without those for which there
    /// is room beside.
    pub(crate) fn bytes(shape: BrickShape, blocks: usize) -> u64 {
        let mut bytes = Halves::bytes(shape.edge(), blocks) + Halves::bytes(shape.edge(), 1);
        let thinner = shape.coarser();
        let (side, groups) = (thinner.edge() + 2, Relief::side_of(thinner.edge()));
        let places = 2 * shape.edge() + 1;
        let of_groups = groups * groups * (places + groups) + 2 * places;
        bytes += 2 * (17 * side.pow(3) + size_of::<f64>() * of_groups) as u64;
        bytes + Surveyor::bytes(thinner.edge()) + Self::bytes_kept(shape)
    }

    /// What is kept of the brick of a request's key, or where that may be.
    fn take(&mut self, key: u64) -> usize {
        self.asked += 1;
        let found = self.kept.iter().position(|kept| kept.key == key);
        let at = found.unwrap_or_else(|| {
            if self.kept.len() <= self.room {
                self.kept.push(Kept::default());
            }
            let by_age = self.kept.iter().enumerate().min_by_key(|(_, kept)| kept.asked);
            let oldest = by_age.map_or(0, |(at, _)| at);
            (self.kept[oldest].key, self.kept[oldest].made) = (key, 0);
            oldest
        });
        self.kept[at].asked = self.asked;
        at
    }

    /// `brick` of a key, which was surveyed, in the fewest cells by which light is off by so little, in
    /// any group, that `fits` says so; and how often it was halved. None where it was not.
    pub(crate) fn thin(
        &mut self,
        key: u64,
        brick: &ScaledBrick,
        pieces: &PieceList,
        fits: impl Fn(Change) -> bool,
    ) -> Option<(&ScaledBrick, usize)> {
        if !may_be_thinner(brick, &fits) {
            return None;
        }
        let at = self.take(key);
        let Kept { bricks, made, .. } = &mut self.kept[at];
        let mut halvings = 0;
        while halvings < MOST_HALVINGS {
            let (finer, thinner) = bricks.split_at_mut(halvings);
            let finer = finer.last().unwrap_or(brick);
            if halvings > 0 && !may_be_thinner(finer, &fits) {
                break;
            }
            let whole = &finer.relief.whole;
            let thinner = &mut thinner[0];
            if *made <= halvings {
                let comparison = &mut self.comparison;
                find_values(finer, &mut comparison.halves, &mut self.values, &mut self.is_own);
                thinner.take_values(finer.edge / 2, &self.values[1]);
                comparison.compare(finer, thinner);
                let exact = Distance::none([whole.low, whole.high]);
                thinner.survey(pieces, &exact, &mut self.surveyor);
                thinner.relief.loosen(&finer.relief, pieces, &comparison.off);
                *made += 1;
            }
            // Values may have been moved to a step.
            if has_steps(&thinner.relief) || !fits(thinner.relief.most_levels()) {
                break;
            }
            halvings += 1;
        }
        halvings.checked_sub(1).map(|last| (&self.kept[at].bricks[last], halvings))
    }
}

/// Whether half as many cells may do for a brick.
fn may_be_thinner(brick: &ScaledBrick, fits: &impl Fn(Change) -> bool) -> bool {
    let relief = &brick.relief;
    let is_large = brick.edge / 2 >= FEWEST_CELLS && !relief.is_empty();
    is_large && !relief.whole.has_void && !has_steps(relief) && fits(relief.likely_thinned())
}

/// Whether the transfer function steps where values may be.
fn has_steps(relief: &Relief) -> bool {
    relief.whole.span.jumps != Change::default()
}

/// Finds the values of a brick of half as many cells along each axis, ghosts included.
fn find_values(
    finer: &ScaledBrick,
    halves: &mut Halves,
    [found, values]: &mut [Vec<f64>; 2],
    is_own: &mut Vec<bool>,
) {
    let last = 2 * finer.edge;
    // Middles of the wider cells, and the brick's faces.
    halves.set(finer, 1.0, (0..=finer.edge / 2 + 1).map(|n| (4 * n).saturating_sub(2).min(last)));
    let side = halves.places().len();
    found.clear();
    is_own.clear();
    for (y, z) in (0..side * side).map(|n| (n % side, n / side)) {
        halves.look(finer, [y, z]);
        for (value, own) in (0..side).map(|x| halves.value(x)) {
            found.push(value);
            is_own.push(own);
        }
    }
    values.clear();
    values.extend_from_slice(found);
    for stride in [1, side, side * side] {
        straighten(found, values, is_own, side, stride);
    }
    // Ghosts, so that the interpolant is on the faces what was found there.
    for stride in [1, side, side * side] {
        for lower in (0..values.len()).filter(|at| at / stride % side == 0) {
            let upper = lower + (side - 1) * stride;
            values[lower] = 2.0 * values[lower] - values[lower + stride];
            values[upper] = 2.0 * values[upper] - values[upper - stride];
        }
    }
}

/// Moves middles by half of what chords between them are off, along the axis with `stride`.
fn straighten(found: &[f64], values: &mut [f64], is_own: &[bool], side: usize, stride: usize) {
    for at in (0..values.len()).filter(|&at| is_own[at]) {
        let n = at / stride % side;
        if n == 0 || n == side - 1 {
            continue;
        }
        // Bends of the nearest middle that has others on both sides.
        let middle = at - n * stride + n.clamp(2, side - 3) * stride;
        let bend = found[middle - stride] - 2.0 * found[middle] + found[middle + stride];
        values[at] -= bend / 16.0;
    }
}

/// The groups of a thinner brick of so many groups along an edge that a place lies in or between.
fn groups_at(place: usize, groups: usize) -> RangeInclusive<usize> {
    // A group's dual cells are as wide as 4 places, and begin half of one before its first cell.
    const WIDTH: usize = 4 * GROUP_EDGE;
    (place + 1) / WIDTH..=((place + 2) / WIDTH).min(groups - 1)
}

impl Comparison {
    /// Finds how far a brick is at most from the thinner one in each of that one's groups.
    fn compare(&mut self, finer: &ScaledBrick, thinner: &ScaledBrick) {
        let Self { halves, row, apart, farthest, off } = self;
        // Where any of the interpolants bends: those two levels above and more do where neither that
        // one's parent's nor the thinner one's does.
        let (all, last) = (finer.used > 2, 2 * finer.edge);
        let bends = (0..=last).filter(|&n| all || n % 4 != 0 || n == 0 || n == last);
        halves.set(finer, 1.0, bends);
        row.set(thinner, 0.5, halves.places().iter().copied());
        let (count, groups) = (halves.places().len(), Relief::side_of(thinner.edge));
        farthest.clear();
        farthest.resize(groups * groups * count, 0.0);
        for (y, z) in (0..count * count).map(|n| (n % count, n / count)) {
            halves.look(finer, [y, z]);
            row.look(thinner, [y, z]);
            halves.distances(row.own(), apart);
            let [y, z] = [y, z].map(|n| groups_at(halves.places()[n], groups));
            for at in z.flat_map(|z| y.clone().map(move |y| z * groups + y)) {
                for (most, apart) in farthest[at * count..][..count].iter_mut().zip(&*apart) {
                    *most = if *apart > *most { *apart } else { *most };
                }
            }
        }
        off.clear();
        off.resize(groups.pow(3), 0.0);
        for (groups_of_row, row) in off.chunks_mut(groups).zip(farthest.chunks(count)) {
            for (place, apart) in halves.places().iter().zip(row) {
                for group in groups_at(*place, groups) {
                    groups_of_row[group] = apart.max(groups_of_row[group]);
                }
            }
        }
    }
}

#[cfg(test)]
#[path = "thin_tests.rs"]
mod tests;
