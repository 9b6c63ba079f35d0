//! One ray's account of what may be wrong with it, through one brick.

use std::borrow::Cow;

use super::absorb::{Integrator, Tally};
use crate::render::bounds::ray_error::RayError;
use crate::render::bounds::sums::Sums;
use crate::render::bounds::touch::Spread;
use crate::render::brick::relief::{Group, Relief};
use crate::render::transfer::change::Change;
use crate::render::transfer::storage::Reach;

/// Keeps a ray's account while it passes through a brick.
///
/// A ray stands for a square of the picture: of any other ray of the square it is said how far
/// its values are from this one's at the same distance from the eye. While both are in the brick,
/// its slopes tell, and opposite places of the square cancel but for the slopes' unevenness.
/// Where the other may have left the brick or not yet entered it, each brick answers for the way
/// inside itself.
pub(crate) struct BrickAccount<'a> {
    relief: &'a Relief,
    error: &'a mut RayError,
    /// Whether children are hidden by the brick.
    hides: bool,
    /// How far the square's rays are from this one.
    spread: Spread,
    /// The group that is being added up.
    current: usize,
    /// What the ray had gathered when that was begun.
    gathered: [f64; 3],
    shift: Shift,
}

/// How the domain ends near a part of a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum DomainEnd {
    /// Not at all.
    Nowhere,
    /// At one plane, which the ray crosses up to so many cells away, along each axis, from any place
    /// where others of its square may.
    Face([f64; 3]),
    /// At several.
    Edge,
}

/// A segment of a ray, and how much of its light reaches the eye.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PathSegment {
    /// Code length.
    pub(crate) length: f64,
    /// Transmittance in front of it, at most.
    pub(crate) transmittance: f64,
}

impl PathSegment {
    /// What `change` makes over it.
    fn sums(self, change: Change) -> Sums {
        Sums::of(change, self.length, self.length * self.transmittance)
    }
}

/// How far the values of a square's rays are from its centre's: at most, and so that half of it counts
/// for their mean; and on average but for what cancels between opposite ones, where one formula holds
/// for all, and along a stretch.
#[derive(Debug, Clone, Copy, Default)]
struct Shift {
    reach: f64,
    most: f64,
    smooth: f64,
    uneven: f64,
}

const NO_GROUP: usize = usize::MAX;

impl<'a> BrickAccount<'a> {
    /// An account of a ray through a brick, for a square whose rays are up to `spread` away.
    pub(crate) fn new(
        relief: &'a Relief,
        error: &'a mut RayError,
        hides: bool,
        spread: Spread,
    ) -> Self {
        let (current, gathered, shift) = (NO_GROUP, [0.0; 3], Shift::default());
        Self { relief, error, hides, spread, current, gathered, shift }
    }

    /// Whether the rays of the square are apart at all.
    pub(crate) fn is_spread(&self) -> bool {
        self.spread.cells != [0.0; 3]
    }

    /// Largest displacement of the square's rays, cells.
    pub(crate) fn spread(&self) -> [f64; 3] {
        self.spread.cells
    }

    /// Adds what rays of the square may see in other cells over a `segment` through a constant cell or one
    /// that was dropped, of which `touching` code lengths, summed over faces of cells, are within their
    /// reach.
    pub(crate) fn touch(&mut self, touching: f64, segment: PathSegment) {
        let length = segment.length;
        let change = self.group().elsewhere();
        // The far side of a face takes at most half of the square, all of them together all of it: half
        // of the farthest counts for the mean.
        let mean = (0.5 * touching).min(length);
        let sums = PathSegment { length: 2.0 * mean, ..segment }.sums(change);
        self.error.farthest = self.error.farthest.plus(sums);
        let segment = PathSegment { length: mean, ..segment };
        self.error.uneven = self.error.uneven.plus(segment.sums(change));
        self.add_stored(self.group().most_stored(true), segment, 1.0);
    }

    /// Adds what stored values make of what others see over a `segment`, which are a `share` of the square.
    fn add_stored(&mut self, most: Change, segment: PathSegment, share: f64) {
        let of_stored = self.error.of_stored(self.relief.is_rounded);
        *of_stored = of_stored.plus(segment.sums(most).times(share));
    }

    /// The next stretch lies in the dual cell (or cell) `cell`.
    #[inline]
    pub(crate) fn enter(&mut self, cell: [i32; 3], integrator: &mut Integrator<'_>) {
        let next = self.relief.find(cell);
        if next != self.current {
            self.close(integrator);
            self.current = next;
            self.shift = self.shift_of(self.group());
            integrator.reach = Some(self.reach());
        }
    }

    /// The stretch is over. For `touching` of it, 1 at most, formulas change between this ray and
    /// others of the square; and rays are on average `beyond` cells in the next dual cell along
    /// each axis, where the slope along that axis is another.
    #[inline]
    pub(crate) fn leave(
        &mut self,
        touching: f64,
        beyond: [f64; 3],
        integrator: &mut Integrator<'_>,
    ) {
        let Shift { most, smooth, .. } = self.shift;
        let uneven = &self.group().uneven;
        let bent: f64 = (0..3).map(|a| 2.0 * uneven[a] * beyond[a]).sum();
        let parted = 0.5 * most * touching.min(1.0);
        self.shift.uneven = (0.5 * most).min(parted + bent + smooth);
        self.close(integrator);
    }

    /// Whether the square's rays may be more than a cell away.
    #[inline]
    pub(crate) fn is_wide(&self) -> bool {
        self.spread.cells.iter().any(|&spread| spread > 1.0)
    }

    fn group(&self) -> &'a Group {
        if self.is_wide() { &self.relief.whole } else { self.relief.group(self.current) }
    }

    /// How far from this ray's values steps of the transfer function are looked for.
    fn reach(&self) -> Reach {
        let levels = if self.hides { self.relief.levels_reach } else { 0.0 };
        let is_elsewhere = self.hides || self.is_spread();
        Reach {
            others: self.shift.reach + levels,
            storage: self.group().storage(is_elsewhere),
            is_elsewhere,
        }
    }

    fn shift_of(&self, group: &Group) -> Shift {
        let Spread { cells, bend, angle } = self.spread;
        let over = |away: [f64; 3]| (0..3).map(|a| group.slope[a] * away[a]).sum::<f64>();
        let (over_slopes, range) = (over(cells), group.high - group.low);
        // On average half of what slopes make of the farthest, but no more than all there is.
        let most = over_slopes.min(2.0 * range);
        // Opposite rays lie opposite but for the bend of the sphere on which their distances from
        // the eye are equal, and by less than twice their displacement times its angle. Where one
        // formula holds, opposite values cancel but for its second derivatives: slopes change
        // within a cell by no more than their range, and E|δ_a δ_b| ≤ D_a D_b / 3.
        let twist = |a: usize, b: usize| {
            2.0 / 3.0 * group.uneven[a].min(group.uneven[b]) * cells[a] * cells[b]
        };
        let smooth = twist(0, 1) + twist(1, 2) + twist(2, 0) + over(bend) + 2.0 * angle * most;
        // Until the stretch is known: a place of the square is on average half as far from its
        // centre as its border is.
        Shift { reach: over_slopes.min(range), most, smooth, uneven: 0.5 * most }
    }

    /// Adds what the integrator has tallied.
    pub(crate) fn close(&mut self, integrator: &mut Integrator<'_>) {
        let tally = std::mem::take(&mut integrator.tally);
        let gathered = std::mem::replace(&mut self.gathered, integrator.state.radiance);
        if self.current == NO_GROUP {
            return;
        }
        let group = self.group();
        let before = self.error.own_extinction();
        self.error.quadrature += tally.quadrature;
        let is_spread = self.is_spread();
        let of_stored = self.error.of_stored(self.relief.is_rounded);
        *of_stored = of_stored.plus(tally.stored);
        if self.hides {
            let mut levels = Sums::of(group.levels, tally.length, tally.lit);
            if self.relief.levels_reach > 0.0 && !group.fills_void {
                let steepest = tally.slope.plus(tally.kinks);
                levels = levels.min(steepest.times(self.relief.levels_reach));
            }
            self.error.causes.levels = self.error.causes.levels.plus(levels);
        }
        if is_spread {
            // Between constant cells void is met where other cells are.
            let is_met = self.relief.is_piecewise_constant;
            self.add_spread(&tally, if is_met { Change::default() } else { group.border() });
        } else {
            // Steps within reach of what is beneath, or of what is not stored exactly.
            let cause = if self.hides {
                &mut self.error.causes.levels
            } else {
                self.error.of_stored(self.relief.is_rounded)
            };
            *cause = cause.plus(tally.jumps);
        }
        self.error.place_behind(gathered, before);
    }

    fn add_spread(&mut self, tally: &Tally, border: Change) {
        let Shift { most, uneven, .. } = self.shift;
        let end = Sums::of(border, tally.length, tally.lit);
        let all = tally.slope.plus(tally.kinks).times(most).plus(tally.jumps.plus(end).times(2.0));
        self.error.farthest = self.error.farthest.plus(all);
        // A half second derivative c bends the mean of opposite places by c times the square of
        // their distance in value: on average at most a third of that of the farthest, as it is
        // of a sum of two values that are uniform between opposite bounds.
        let bent = Sums { emission: tally.bend * most * most / 3.0, ..Sums::default() };
        // At a kink as at a face: at most a quarter of the farthest is beyond it on average.
        let kinks = tally.kinks.times((0.25 * most + uneven).min(0.5 * most));
        let cancelled =
            tally.slope.times(uneven).plus(kinks).plus(tally.jumps).plus(end).plus(bent);
        self.error.uneven = self.error.uneven.plus(cancelled);
    }

    /// Adds what rays of the square may meet in the brick, over a `segment` where this one is
    /// outside, beside what `group` holds: `share` of the square, at most half of it, since brick
    /// and square are convex.
    pub(crate) fn beside(
        &mut self,
        group: &Group,
        segment: PathSegment,
        share: f64,
        end: DomainEnd,
    ) {
        let most = group.span.most;
        self.add_stored(group.most_stored(true), segment, share);
        let along = if let DomainEnd::Face(along) = end { along } else { [0.0; 3] };
        let mut change = self.change_beside(group, along);
        if self.hides {
            // The coarser values need not meet the neighbour's at the face.
            change = change.plus(group.levels.times(2.0));
        }
        match end {
            DomainEnd::Face(_) if !group.has_void => {
                return self.add_face(group, change.times(2.0), segment, share);
            }
            DomainEnd::Nowhere if !group.has_void => {}
            _ => change = change.max(most),
        }
        self.add_part(change, segment, share);
    }

    /// Where the domain ends at one plane, what opposite rays of the square meet more and less of
    /// it is the same but for how values `change` along the way, and for the bend of the sphere on
    /// which distances from the eye are equal.
    fn add_face(&mut self, group: &Group, change: Change, segment: PathSegment, share: f64) {
        let most = group.span.most;
        let uneven = change.plus(most.times(2.0 * self.spread.angle)).min(most);
        let farthest = segment.sums(change.max(most));
        self.error.farthest = self.error.farthest.plus(farthest.times((2.0 * share).max(1.0)));
        let uneven = segment.sums(uneven);
        self.error.uneven = self.error.uneven.plus(uneven.times(share));
    }

    /// Adds what rays of the square miss where the domain ends near this one.
    pub(crate) fn domain_ends(
        &mut self,
        group: &Group,
        segment: PathSegment,
        share: f64,
        end: DomainEnd,
    ) {
        self.add_stored(group.most_stored(true), segment, share);
        if let DomainEnd::Face(along) = end {
            let change = self.change_beside(group, along);
            self.add_face(group, change.times(2.0), segment, share);
        } else {
            self.add_part(group.span.most, segment, share);
        }
    }

    /// Adds what of the distances from the eye at which the square's rays meet a face where the domain
    /// ends does not cancel: a `segment` on average.
    pub(crate) fn bend_at_face(&mut self, group: &Group, segment: PathSegment) {
        let sums = segment.sums(group.span.most);
        self.error.uneven = self.error.uneven.plus(sums);
    }

    /// What holds for the square's rays beside `point`, and for this one's way of `half` cells on
    /// both sides of it.
    pub(crate) fn group_near(&self, point: [f64; 3], half: f64) -> Cow<'a, Group> {
        let widest = self.spread.cells.iter().copied().fold(0.0, f64::max);
        if widest > 4.0 {
            return Cow::Borrowed(&self.relief.whole);
        }
        self.relief.near(point, widest + half, widest)
    }

    /// How far light differs by the square's displacements, and by so many cells `along` the ray.
    fn change_beside(&self, group: &Group, along: [f64; 3]) -> Change {
        let away = |a: usize| self.spread.cells[a] + along[a];
        group.change((0..3).map(|a| group.slope[a] * away(a)).sum())
    }

    /// `share` of the square differs by `change`.
    fn add_part(&mut self, change: Change, segment: PathSegment, share: f64) {
        let sums = segment.sums(change);
        // Half of the farthest counts as average.
        self.error.farthest = self.error.farthest.plus(sums.times((2.0 * share).max(1.0)));
        self.error.uneven = self.error.uneven.plus(sums.times(share));
    }
}
