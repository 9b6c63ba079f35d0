//! What rays of a square meet of a brick where the square's centre is outside, and what they miss where
//! it is inside and what is drawn ends.

use std::borrow::Cow;

use glam::DVec3;

use super::brick_account::{BrickAccount, DomainEnd, PathSegment};
use super::ray::{Beam, rounding, spread_of};
use super::ray_state::RayState;
use crate::render::bounds::ray_error::RayError;
use crate::render::bounds::touch::Spread;
use crate::render::brick::passage::{ALL_FACES, Passage, Region};
use crate::render::brick::relief::Group;
use crate::render::brick::walk::Crossings;
use crate::render::camera::frame::LocalRay;
use crate::render::transfer::pieces::PieceList;

/// A ray's way beside a brick is looked at in parts of this many cells.
const PART_CELLS: f64 = 2.0;
/// A ray's way beside a brick is looked at in this many parts at most.
const MOST_PARTS: f64 = 64.0;
/// Largest part of the distance from the eye by which rays of a square may enter or leave at one face
/// before or after its centre's.
const MOST_SLANT: f64 = 0.5;

/// A ray that stands for a square, at a brick.
pub(super) struct Visit<'v> {
    pub(super) passage: &'v Passage<'v>,
    pub(super) pieces: &'v PieceList,
    pub(super) ray: &'v LocalRay,
    pub(super) region: &'v Region,
    pub(super) beam: &'v Beam,
    pub(super) state: &'v RayState,
    /// Where the ray is inside, if it is.
    pub(super) span: Option<(f64, f64)>,
}

/// One end of the ray's way through the brick: stretches of σ over which rays of the square come into
/// it, or leave it. Of a ray that meets nothing of it all is the first end.
struct Rim {
    /// Where this one is outside.
    outside: (f64, f64),
    /// Where it is inside and others may be where what is drawn has ended.
    inside: (f64, f64),
    /// Where it crosses the face.
    face: f64,
}

impl Rim {
    /// From the first to the last place.
    fn all(&self) -> (f64, f64) {
        (self.outside.0.min(self.inside.0), self.outside.1.max(self.inside.1))
    }
}

impl Visit<'_> {
    /// Adds to an account what the rays of the square see beside this one. Returns how far these are.
    pub(super) fn arrive(&self, error: &mut RayError) -> Spread {
        let Self { passage, ray, region, beam, span, .. } = *self;
        let spread = spread_of(ray, region, span, beam);
        if beam.is_square() {
            let mut account =
                BrickAccount::new(&passage.brick.relief, error, passage.hides, spread);
            self.look_beside(&mut account);
        }
        spread
    }

    /// Adds to an account what other rays of the square meet beside this one, or miss.
    fn look_beside(&self, account: &mut BrickAccount<'_>) {
        let Self { ray, region, beam, .. } = *self;
        let spread = account.spread();
        let crossings = Crossings::new(ray, region.lo, region.hi);
        let Some(wide) = crossings.within(ray, spread, ALL_FACES) else { return };
        let inside = self.span.map_or(0.0, |(from, to)| (to - from) * ray.length);
        let across: f64 = (0..3).map(|a| (region.hi[a] - region.lo[a]) * beam.advance[a]).sum();
        let all = (wide.1 - wide.0) * ray.length;
        // All rays of the square meet the region within its extent along the ray. What is more than the
        // centre's may lie at either end.
        let outside = (all.min(across) - inside).max(0.0);
        let Some((from, to)) = self.span else {
            let rim = Rim { outside: wide, inside: (wide.1, wide.1), face: wide.1 };
            return self.look_at(account, &rim, outside);
        };
        let kept = if region.ends == 0 {
            (from, to)
        } else {
            crossings.within(ray, spread.map(|off| -off), region.ends).unwrap_or((to, from))
        };
        let enters = Rim { outside: (wide.0, from), inside: (from, kept.0), face: from };
        let leaves = Rim { outside: (to, wide.1), inside: (kept.1, to), face: to };
        self.look_at(account, &enters, outside);
        self.look_at(account, &leaves, outside);
    }

    /// Adds what is met and missed at one end, where no ray goes farther outside than `most` (code
    /// length).
    fn look_at(&self, account: &mut BrickAccount<'_>, rim: &Rim, most: f64) {
        let Self { region, beam, span, .. } = *self;
        let mut end = self.domain_end(account.spread(), rim.all());
        // A short way is looked at once; and one over which what is met and what is missed cancel.
        let is_one = matches!(end, DomainEnd::Face(_)) || self.cells(rim.all()) <= PART_CELLS;
        let group = is_one.then(|| self.around(account, rim.all()));
        let is_slanted = span.is_some() && beam.angle != 0.0;
        if let (DomainEnd::Face(_), Some(group), true) = (end, &group, is_slanted)
            && !self.crosses_face(account, rim, group)
        {
            end = DomainEnd::Edge;
        }
        let share = if span.is_some() { 0.5 } else { beam.covered.min(0.5) };
        self.each_part(account, rim.outside, group.as_deref(), |account, group, segment| {
            let length = segment.length.min(most);
            account.beside(group, PathSegment { length, ..segment }, share, end);
        });
        if region.ends == 0 || span.is_none() {
            return;
        }
        let share = (0.5 * f64::from(region.ends.count_ones())).min(1.0);
        self.each_part(account, rim.inside, group.as_deref(), |account, group, segment| {
            account.domain_ends(group, segment, share, end);
        });
    }

    /// An upper bound of the transmittance in front of σ.
    fn before(&self, sigma: f64) -> f64 {
        let depth = self.beam.depth;
        self.state.transmittance_at(depth + sigma - rounding(depth, sigma))
    }

    /// How many cells long a stretch of σ is.
    fn cells(&self, (from, to): (f64, f64)) -> f64 {
        (to - from) * self.ray.direction.abs().max_element()
    }

    /// What holds around a stretch of σ. Groups are wide where cells are: where the transfer function
    /// does more at some of a group's values than at others, those around the stretch follow from one of
    /// them and from slopes.
    fn around<'a>(&self, account: &BrickAccount<'a>, (from, to): (f64, f64)) -> Cow<'a, Group> {
        let Self { passage: Passage { brick, drawn, .. }, ray, region, pieces, .. } = *self;
        let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
        let point = std::array::from_fn(|a| {
            (ray.origin[a] + ray.direction[a] * middle).clamp(region.lo[a], region.hi[a])
        });
        let group = account.group_near(point, 0.5 * self.cells((from, to)));
        let follows = !brick.is_piecewise_constant() && !group.has_void && !account.is_wide();
        // Where the domain ends, what matters is what is shown, not how it changes.
        let is_even = region.ends == 0 && group.span.is_even(group.high - group.low);
        if !follows || is_even || group.span.is_constant() {
            return group;
        }
        let spread = account.spread();
        let away = std::array::from_fn(|a| spread[a] + half * ray.direction[a].abs());
        let x = brick.value_at(DVec3::from_array(point), *drawn);
        Cow::Owned(brick.relief.close_to(&group, x, away, pieces))
    }

    /// Cuts a stretch of σ into parts that are looked at with what holds around each, or around all if
    /// that is known.
    fn each_part(
        &self,
        account: &mut BrickAccount<'_>,
        (from, to): (f64, f64),
        around: Option<&Group>,
        mut look: impl FnMut(&mut BrickAccount<'_>, &Group, PathSegment),
    ) {
        let cells = self.cells((from, to));
        if cells.is_nan() || cells <= 0.0 {
            return;
        }
        let count = (cells / PART_CELLS).ceil().min(MOST_PARTS);
        let step = (to - from) / count;
        for n in 0..count as u32 {
            let ends = (from + f64::from(n) * step, from + f64::from(n + 1) * step);
            let length = (ends.1 - ends.0) * self.ray.length;
            let segment = PathSegment { length, transmittance: self.before(ends.0) };
            match around {
                Some(group) => look(account, group, segment),
                None => look(account, &self.around(account, ends), segment),
            }
        }
    }

    /// Where the domain ends at one face, distances from the eye to it differ within the square: adds
    /// what of them does not cancel, of what `group` holds. Returns whether they differ by little
    /// enough for that.
    ///
    /// The distance to a plane along a unit vector u is h/(u·n). Where it is s for the centre's, and η
    /// the largest relative change of u·n in first order, its mean is s but for (α²/6 + α·η/3 +
    /// η²/3(1 − η))·s, α half the square's diagonal as an angle. (The middle term counts as the bend of
    /// [`BrickAccount`]'s faces.)
    fn crosses_face(&self, account: &mut BrickAccount<'_>, rim: &Rim, group: &Group) -> bool {
        let Self { ray, beam, .. } = *self;
        let ((first, last), face) = (rim.all(), rim.face);
        let way = (face - first).max(last - face);
        let distance = beam.depth + face;
        let slant = way / distance;
        if !(0.0..=MOST_SLANT).contains(&slant) {
            return false;
        }
        let bend = 0.25 * beam.angle * beam.angle + slant * slant / (3.0 * (1.0 - slant));
        let length = bend * distance * ray.length;
        account.bend_at_face(group, PathSegment { length, transmittance: self.before(face) });
        true
    }

    /// How the domain ends within the spread of the ray over a stretch of σ: at one of the region's faces,
    /// if the square's rays cross that on no longer a way than the region is along the ray, so that what
    /// some of them meet more of it others meet less; else at an edge.
    fn domain_end(&self, spread: [f64; 3], (from, to): (f64, f64)) -> DomainEnd {
        let Self { ray, region, .. } = *self;
        if region.ends == 0 {
            return DomainEnd::Nowhere;
        }
        let long = |a: usize| (region.hi[a] - region.lo[a]) / ray.direction[a].abs();
        let (mut count, mut crossing) = (0, 0.0);
        for (a, spread) in spread.into_iter().enumerate() {
            let [p, q] = [from, to].map(|sigma| ray.origin[a] + ray.direction[a] * sigma);
            let (low, high, reach) = (p.min(q), p.max(q), spread * (1.0 + 1e-9));
            for (face, plane) in [(a, region.lo[a]), (3 + a, region.hi[a])] {
                let reaches = low - plane <= reach && high - plane >= -reach;
                if region.ends >> face & 1 == 1 && reaches {
                    let way = 2.0 * reach / ray.direction[a].abs();
                    let crosses = (0..3).all(|b| b == a || way <= long(b));
                    count += if crosses { 1 } else { 2 };
                    crossing = (plane - ray.origin[a]) / ray.direction[a];
                }
            }
        }
        match count {
            0 => DomainEnd::Nowhere,
            1 => {
                let way = (from - crossing).abs().max((to - crossing).abs());
                DomainEnd::Face((ray.direction * way).abs().to_array())
            }
            _ => DomainEnd::Edge,
        }
    }
}
