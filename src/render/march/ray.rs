//! One ray through one brick.

use super::absorb::Integrator;
use super::brick_account::{BrickAccount, DomainEnd, PathSegment};
use super::cell::march_cells;
use super::linear::march_linear;
use super::ray_state::{Ending, RayState};
use crate::render::bounds::grade::PacketTransfer;
use crate::render::bounds::ray_error::RayError;
use crate::render::bounds::touch::Spread;
use crate::render::brick::passage::{ALL_FACES, Passage, Region};
use crate::render::brick::walk::clip;
use crate::render::camera::frame::LocalRay;
use crate::render::transfer::pieces::PieceList;

/// The cells of a region, or its dual cells: lowest and highest along each axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct CellRange {
    /// Lowest cell along each axis.
    pub(super) lo: [i32; 3],
    /// Highest cell along each axis, itself included.
    pub(super) hi: [i32; 3],
}

/// How far before the brick dual cell 0 begins, cells.
pub(super) const DUAL_SHIFT: f64 = 0.5;

impl CellRange {
    /// The cells that the region reaches into, where number 0 begins `shift` before the brick
    /// (cells).
    pub(super) fn of(region: &Region, shift: f64) -> Self {
        let lo = region.lo.map(|x| (x + shift).floor() as i32);
        let hi = std::array::from_fn(|a| ((region.hi[a] + shift).ceil() as i32 - 1).max(lo[a]));
        Self { lo, hi }
    }
}

/// What all rays of a picture march by.
pub(crate) struct Light<'l> {
    /// The transfer function.
    pub(crate) pieces: &'l PieceList,
    /// Where a ray may end.
    pub(crate) ending: Ending,
    /// What packets of rays march by, if they may.
    pub(crate) packets: Option<PacketTransfer>,
}

/// The square of the picture that a ray stands for, as a brick sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Beam {
    /// Displacement of the square's farthest rays, cells along each axis, for each unit of depth
    /// in a perspective view; in an orthographic one wherever they are.
    pub(crate) spread: [f64; 3],
    /// The part of it that does not cancel between opposite rays ([`Spread::bend`]).
    pub(crate) bend: [f64; 3],
    /// Half the square's diagonal as an angle; 0 in an orthographic view.
    pub(crate) angle: f64,
    /// Code lengths along the square's rays for each cell along each axis, at most.
    pub(crate) advance: [f64; 3],
    /// Depth at σ = 0.
    pub(crate) depth: f64,
    /// The part of the square that the brick covers, at most.
    pub(crate) covered: f64,
}

impl Beam {
    /// A beam without width, for a ray that stands for itself and whose depth at σ = 0 is `depth`.
    pub(super) fn alone(depth: f64) -> Self {
        let none = [0.0; 3];
        Self { spread: none, bend: none, angle: 0.0, advance: none, depth, covered: 1.0 }
    }

    /// Whether the ray stands for others.
    pub(super) fn is_square(&self) -> bool {
        self.spread != [0.0; 3]
    }
}

/// Adds to `state` what `ray` gathers in a brick, front to back, and to `account` what of it may
/// be wrong. Returns the number of stretches integrated. Bricks come front to back.
pub(crate) fn march(
    passage: &Passage<'_>,
    ray: &LocalRay,
    light: &Light<'_>,
    state: &mut RayState,
    account: Option<(&mut RayError, &Beam)>,
) -> u64 {
    let region = passage.inside();
    let span = clip(ray, region.lo, region.hi);
    let Some((error, beam)) = account.filter(|_| !passage.brick.relief.is_empty()) else {
        let account = &mut None;
        return span.map_or(0, |span| march_through(passage, ray, span, light, state, account));
    };
    let before = *error;
    let spread = arrive(passage, ray, &region, span, beam, state, error);
    let mut count = 0;
    if let Some(span) = span {
        let account = BrickAccount::new(&passage.brick.relief, error, passage.hides, spread);
        count = march_through(passage, ray, span, light, state, &mut Some(account));
    }
    leave(span, beam, state, error, &before);
    count
}

fn march_through(
    passage: &Passage<'_>,
    ray: &LocalRay,
    span: (f64, f64),
    light: &Light<'_>,
    state: &mut RayState,
    account: &mut Option<BrickAccount<'_>>,
) -> u64 {
    let mut integrator = Integrator::new(light.pieces, &light.ending, account.is_some(), state);
    let region = passage.inside();
    if passage.brick.is_piecewise_constant() {
        march_cells(passage.brick, &region, ray, span, &mut integrator, account);
    } else {
        march_linear(passage, &region, ray, span, &mut integrator, account);
    }
    integrator.count
}

/// A ray comes to a brick, of which it meets `span` or nothing: adds what the rays of its square
/// see beside it. Returns how far these are.
pub(super) fn arrive(
    passage: &Passage<'_>,
    ray: &LocalRay,
    region: &Region,
    span: Option<(f64, f64)>,
    beam: &Beam,
    state: &RayState,
    error: &mut RayError,
) -> Spread {
    let spread = spread_of(ray, region, span, beam);
    if !beam.is_square() {
        return spread;
    }
    let mut account = BrickAccount::new(&passage.brick.relief, error, passage.hides, spread);
    look_beside(&mut account, ray, region, beam, span, state);
    spread
}

/// How far the rays of a square are from `ray` at most, in a brick of which it meets `span` or nothing.
pub(crate) fn spread_of(
    ray: &LocalRay,
    region: &Region,
    span: Option<(f64, f64)>,
    beam: &Beam,
) -> Spread {
    let depth = if beam.is_square() && ray.sigma_min.is_finite() {
        (beam.depth + farthest(ray, region, beam, span)).max(0.0)
    } else {
        1.0
    };
    let at_depth = |cells: [f64; 3]| cells.map(|cells| cells * depth);
    Spread { cells: at_depth(beam.spread), bend: at_depth(beam.bend), angle: beam.angle }
}

/// A ray has come through `span` of a brick, when its account was as `before`.
pub(super) fn leave(
    span: Option<(f64, f64)>,
    beam: &Beam,
    state: &mut RayState,
    error: &mut RayError,
    before: &RayError,
) {
    if let Some((_, to)) = span {
        state.mark(beam.depth + to + rounding(beam.depth, to));
    }
    if beam.is_square() {
        error.multiply(before);
    }
}

/// σ of the farthest place at which rays of the square may be in the region.
fn farthest(ray: &LocalRay, region: &Region, beam: &Beam, span: Option<(f64, f64)>) -> f64 {
    let across: f64 =
        (0..3).map(|a| (region.hi[a] - region.lo[a]) * beam.advance[a]).sum::<f64>() / ray.length;
    match span {
        Some((from, to)) => to + (across - (to - from)).max(0.0),
        None => {
            // The nearest place to the region's centre, and half the region beyond.
            let middle: [f64; 3] =
                std::array::from_fn(|a| 0.5 * (region.lo[a] + region.hi[a]) - ray.origin[a]);
            let direction = ray.direction.to_array();
            let along = |a: usize| middle[a] * direction[a];
            let square: f64 = direction.iter().map(|d| d * d).sum();
            let nearest = (along(0) + along(1) + along(2)) / square;
            let reach: f64 = (0..3).map(|a| region.hi[a] - region.lo[a]).sum();
            nearest + reach / square.sqrt()
        }
    }
}

fn rounding(depth: f64, sigma: f64) -> f64 {
    1e-14 * (depth.abs() + sigma.abs())
}

/// A ray's way beside a brick is looked at in parts of this many cells.
const PART_CELLS: f64 = 2.0;
/// A ray's way beside a brick is looked at in this many parts at most.
const MOST_PARTS: f64 = 64.0;

/// What rays of the square meet of the region where this one is outside, and what they miss
/// where it is inside and the domain ends.
fn look_beside(
    account: &mut BrickAccount<'_>,
    ray: &LocalRay,
    region: &Region,
    beam: &Beam,
    span: Option<(f64, f64)>,
    state: &RayState,
) {
    let spread = account.spread();
    let moved = |faces: u8, by: f64| -> ([f64; 3], [f64; 3]) {
        let off = |face: usize, a: usize| if faces >> face & 1 == 1 { by * spread[a] } else { 0.0 };
        (
            std::array::from_fn(|a| region.lo[a] - off(a, a)),
            std::array::from_fn(|a| region.hi[a] + off(3 + a, a)),
        )
    };
    let (lo, hi) = moved(ALL_FACES, 1.0);
    let Some(wide) = clip(ray, lo, hi) else { return };
    let inside = span.map_or(0.0, |(from, to)| (to - from) * ray.length);
    let across: f64 = (0..3).map(|a| (region.hi[a] - region.lo[a]) * beam.advance[a]).sum();
    let all = (wide.1 - wide.0) * ray.length;
    // All rays of the square meet the region within its extent along the ray.
    let outside = (all.min(across) - inside).max(0.0);
    let counted = if all > inside { outside / (all - inside) } else { 0.0 };
    let before =
        |sigma: f64| state.transmittance_at(beam.depth + sigma - rounding(beam.depth, sigma));
    let share = if span.is_some() { 0.5 } else { beam.covered.min(0.5) };
    let (from, to) = span.unwrap_or((wide.1, wide.1));
    let (lo, hi) = moved(region.ends, -1.0);
    let kept = match span {
        Some(span) if region.ends == 0 => span,
        Some(_) => clip(ray, lo, hi).unwrap_or((to, from)),
        None => (wide.1, wide.1),
    };
    let rims = [(wide.0, kept.0.max(from)), (kept.1.min(to), wide.1)];
    let mut domain_ends = rims.map(|rim| domain_end(ray, region, spread, rim));
    if span.is_some() {
        let ways = [(wide.0, from, kept.0), (kept.1, to, wide.1)];
        for ((first, face, last), end) in ways.into_iter().zip(&mut domain_ends) {
            let way = (face - first).max(last - face);
            let crossing = FaceCrossing { sigma: face, way, transmittance: before(face) };
            *end = cross_face(account, ray, beam, crossing, *end);
        }
    }
    for (ends, end) in [(wide.0, from), (to, wide.1)].into_iter().zip(domain_ends) {
        each_part(ray, region, ends, |point, (from, to), half| {
            let group = account.group_near(point, half);
            let length = counted * (to - from) * ray.length;
            let segment = PathSegment { length, transmittance: before(from) };
            account.beside(&group, segment, share, end);
        });
    }
    if region.ends == 0 || span.is_none() {
        return;
    }
    let share = (0.5 * f64::from(region.ends.count_ones())).min(1.0);
    for (ends, end) in [(from, kept.0), (kept.1, to)].into_iter().zip(domain_ends) {
        each_part(ray, region, ends, |point, (from, to), half| {
            let group = account.group_near(point, half);
            let length = (to - from) * ray.length;
            let segment = PathSegment { length, transmittance: before(from) };
            account.domain_ends(&group, segment, share, end);
        });
    }
}

/// Largest part of the distance from the eye by which rays of a square may enter or leave at one face
/// before or after its centre's.
const MOST_SLANT: f64 = 0.5;

/// Where a ray crosses a face at which the domain ends.
struct FaceCrossing {
    sigma: f64,
    /// By how much σ differs there within the square, at most.
    way: f64,
    /// Transmittance in front of it, at most.
    transmittance: f64,
}

/// Where the domain ends at one face, distances from the eye to it differ within the square: adds what
/// of them does not cancel. Returns how the domain ends: at an edge, where they differ too much.
///
/// The distance to a plane along a unit vector u is h/(u·n). Where it is s for the centre's, and η the
/// largest relative change of u·n in first order, its mean is s but for (α²/6 + α·η/3 + η²/3(1 − η))·s,
/// α half the square's diagonal as an angle. (The middle term counts as the bend of [`BrickAccount`]'s faces.)
fn cross_face(
    account: &mut BrickAccount<'_>,
    ray: &LocalRay,
    beam: &Beam,
    FaceCrossing { sigma, way, transmittance }: FaceCrossing,
    end: DomainEnd,
) -> DomainEnd {
    let distance = beam.depth + sigma;
    if end != DomainEnd::Face || beam.angle == 0.0 {
        return end;
    }
    let slant = way / distance;
    if !(0.0..=MOST_SLANT).contains(&slant) {
        return DomainEnd::Edge;
    }
    let bend = 0.25 * beam.angle * beam.angle + slant * slant / (3.0 * (1.0 - slant));
    let half = way * ray.direction.abs().max_element();
    let group = account.group_near((ray.origin + ray.direction * sigma).into(), half);
    let length = bend * distance * ray.length;
    account.bend_at_face(&group, PathSegment { length, transmittance });
    end
}

/// How many of the region's faces at which the domain ends come within the spread of the ray
/// over a stretch of σ.
fn domain_end(
    ray: &LocalRay,
    region: &Region,
    spread: [f64; 3],
    (from, to): (f64, f64),
) -> DomainEnd {
    if region.ends == 0 {
        return DomainEnd::Nowhere;
    }
    let reaches = |face: usize| {
        let a = face % 3;
        let plane = if face < 3 { region.lo[a] } else { region.hi[a] };
        let at = |sigma: f64| ray.origin[a] + ray.direction[a] * sigma - plane;
        let (start, end) = (at(from), at(to));
        region.ends >> face & 1 == 1
            && start.min(end) <= spread[a] * (1.0 + 1e-9)
            && start.max(end) >= -spread[a] * (1.0 + 1e-9)
    };
    match (0..6).filter(|&face| reaches(face)).count() {
        0 => DomainEnd::Nowhere,
        1 => DomainEnd::Face,
        _ => DomainEnd::Edge,
    }
}

/// Cuts σ from `from` to `to` into parts; of each: its middle within the region, its ends, and
/// half its length in cells.
fn each_part(
    ray: &LocalRay,
    region: &Region,
    (from, to): (f64, f64),
    mut look: impl FnMut([f64; 3], (f64, f64), f64),
) {
    let cells = (to - from) * ray.direction.abs().max_element();
    if cells.is_nan() || cells <= 0.0 {
        return;
    }
    let count = (cells / PART_CELLS).ceil().min(MOST_PARTS);
    let step = (to - from) / count;
    for n in 0..count as u32 {
        let ends = (from + f64::from(n) * step, from + f64::from(n + 1) * step);
        let middle = 0.5 * (ends.0 + ends.1);
        let point = std::array::from_fn(|a| {
            (ray.origin[a] + ray.direction[a] * middle).clamp(region.lo[a], region.hi[a])
        });
        look(point, ends, 0.5 * cells / count);
    }
}
