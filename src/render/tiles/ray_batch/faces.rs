//! What a proxy's rays see of a brick where they enter and leave it.
//!
//! Bricks in front and behind are not marched by the same proxies: where a ray of the square comes
//! into the brick before the proxy does, or after, all that is there counts.

use std::borrow::Cow;

use glam::DVec3;

use crate::render::bounds::sums::Sums;
use crate::render::brick::passage::{Passage, Region};
use crate::render::brick::walk::clip;
use crate::render::camera::frame::LocalRay;
use crate::render::march::ray::{Beam, spread_of};

/// Cells around a place of which groups are looked at one by one.
const MOST_REACH: f64 = 4.0;

/// What rays of a proxy's square may see of a brick before the proxy comes into it, or after it has
/// left, and the other way round, if so much light comes through from in front of it and behind; and
/// what of that is not linear in their displacement.
pub(super) fn at_faces(
    passage: &Passage<'_>,
    ray: &LocalRay,
    beam: &Beam,
    [before, after]: [f64; 2],
) -> [Sums; 2] {
    let region = passage.inside();
    let Region { lo, hi, .. } = region;
    let span = clip(ray, lo, hi);
    let spread = spread_of(ray, &region, span, beam).cells;
    let moved = |faces: [f64; 3], sign: f64| std::array::from_fn(|a| faces[a] + sign * spread[a]);
    let Some(wide) = clip(ray, moved(lo, -1.0), moved(hi, 1.0)) else {
        return [Sums::default(); 2];
    };
    let whole = &passage.brick.relief.whole;
    let narrow = clip(ray, moved(lo, 1.0), moved(hi, -1.0));
    let (Some((from, to)), Some(narrow)) = (span, narrow) else {
        let length = (wide.1 - wide.0) * ray.length;
        return [Sums::of(whole.span.most.plus(whole.levels), length, length * before); 2];
    };
    // A ray enters once, before the proxy or after.
    let enters = Rim { way: (from - wide.0).max(narrow.0 - from), sigma: from, seen: before };
    let leaves = Rim { way: (wide.1 - to).max(to - narrow.1), sigma: to, seen: after };
    let mut sums = [Sums::default(); 2];
    for rim in [enters, leaves].into_iter().filter(|rim| rim.way > 0.0) {
        let [apart, bent] = at_face(passage, ray, beam, spread, rim, before);
        sums = [sums[0].plus(apart), sums[1].plus(bent)];
    }
    sums
}

/// Where a proxy enters or leaves.
struct Rim {
    /// How much before it others may do so, or after it, σ; where it does itself; and how much light
    /// comes through from there.
    way: f64,
    sigma: f64,
    seen: f64,
}

/// What rays of the square may see of a brick and the proxy not, or the other way round, at the one
/// place where the proxy enters or leaves, if no more than `most_seen` of the light comes through;
/// and what of that is not linear in their displacement.
fn at_face(
    passage: &Passage<'_>,
    ray: &LocalRay,
    beam: &Beam,
    spread: [f64; 3],
    Rim { way, sigma, seen }: Rim,
    most_seen: f64,
) -> [Sums; 2] {
    let along = ray.direction.abs() * way;
    let reach = along.max_element() + spread.iter().copied().fold(0.0, f64::max);
    let point = ray.origin + ray.direction * sigma;
    let relief = &passage.brick.relief;
    let farthest: [f64; 3] = std::array::from_fn(|a| 2.0 * spread[a] + along[a]);
    let group = if reach > MOST_REACH {
        Cow::Borrowed(&relief.whole)
    } else {
        relief.near(point.into(), reach, farthest.into_iter().fold(0.0, f64::max))
    };
    let most = group.span.most.plus(group.levels);
    let length = way * ray.length;
    // At the far end the proxy, and so what is seen, is not yet as dim as behind it.
    let lit = length * (seen * (most.extinction * length).exp()).min(most_seen);
    let apart = Sums::of(most, length, lit);
    if !is_at_one_face(&passage.inside(), spread, point, along) {
        return [apart; 2];
    }
    // Rays come through one plane, at depths that are linear but for perspective; and what they meet
    // between them is the same but for how values change there.
    let over: f64 = (0..3).map(|a| group.slope[a] * farthest[a]).sum();
    let change = group.change(over).plus(group.levels);
    let is_perspective = ray.sigma_min.is_finite();
    let curved = if is_perspective { 4.0 * way / (beam.depth + sigma).abs() } else { 0.0 };
    [apart, Sums::of(change.plus(most.times(curved)), length, lit).min(apart)]
}

/// Whether no more than one face of a region is near a point on its border: within the spread of rays
/// there and so many cells along them.
fn is_at_one_face(region: &Region, spread: [f64; 3], point: DVec3, along: DVec3) -> bool {
    let is_near = |face: usize| {
        let a = face % 3;
        let plane = if face < 3 { region.lo[a] } else { region.hi[a] };
        (point[a] - plane).abs() <= (spread[a] + along[a]) * (1.0 + 1e-9)
    };
    (0..6).filter(|&face| is_near(face)).count() <= 1
}
