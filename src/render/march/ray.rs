//! One ray through one brick.

use super::absorb::Integrator;
use super::beside::Visit;
use super::brick_account::BrickAccount;
use super::cell::march_cells;
use super::linear::march_linear;
use super::ray_state::{Ending, RayState};
use crate::render::bounds::grade::PacketTransfer;
use crate::render::bounds::ray_error::RayError;
use crate::render::bounds::touch::Spread;
use crate::render::brick::passage::{Passage, Region};
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
    let visit = Visit { passage, pieces: light.pieces, ray, region: &region, beam, state, span };
    let spread = visit.arrive(error);
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

/// What rounding does to a depth.
pub(super) fn rounding(depth: f64, sigma: f64) -> f64 {
    1e-14 * (depth.abs() + sigma.abs())
}
