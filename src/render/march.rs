//! One ray through one brick.

use super::absorb::Integrator;
use super::frame::LocalRay;
use super::interpolant::DrawnNeighbours;
use super::march_cell::march_cells;
use super::march_linear::march_linear;
use super::ray_state::{Accuracy, RayState};
use super::scaled::ScaledBrick;
use super::transfer_pieces::TransferPieces;
use super::walk::clip;

/// A box inside a brick, in cells from its lowest corner, clipped to the domain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Region {
    /// Lower corner.
    pub lo: [f64; 3],
    /// Upper corner.
    pub hi: [f64; 3],
}

/// Adds to `state` what `ray` gathers in `region` of `brick`, front to back, by the transfer
/// function `pieces`. `drawn` says beside which neighbours the level ends. Returns the number of
/// stretches integrated.
pub fn march(
    brick: &ScaledBrick,
    region: &Region,
    drawn: DrawnNeighbours,
    ray: &LocalRay,
    pieces: &TransferPieces,
    accuracy: &Accuracy,
    state: &mut RayState,
) -> u64 {
    let edge = brick.edge as f64;
    let (lo, hi) = (region.lo.map(|x| x.max(0.0)), region.hi.map(|x| x.min(edge)));
    let Some(span) = clip(ray, lo, hi) else {
        return 0;
    };
    let region = Region { lo, hi };
    let mut integrator = Integrator::new(pieces, accuracy, state);
    if brick.is_piecewise_constant() {
        march_cells(brick, &region, ray, span, &mut integrator);
    } else {
        march_linear(brick, &region, drawn, ray, span, &mut integrator);
    }
    integrator.count
}
