//! `linear`: from dual cell to dual cell, in each of which the interpolant is one cubic along the
//! ray, or a few polynomials beside borders of levels.

use super::absorb::Integrator;
use super::blend::march_mixed;
use super::frame::LocalRay;
use super::interpolant::DrawnNeighbours;
use super::march::Region;
use super::polynomial::Polynomial;
use super::scaled::{ScaledBrick, dual};
use super::walk::{Step, Walk};

/// As [`super::march::march`], over the stretch `span` of σ.
pub(super) fn march_linear(
    brick: &ScaledBrick,
    region: &Region,
    drawn: DrawnNeighbours,
    ray: &LocalRay,
    span: (f64, f64),
    integrator: &mut Integrator<'_>,
) {
    let lo = region.lo.map(|x| (x + 0.5).floor() as i32);
    let hi = std::array::from_fn(|a| ((region.hi[a] + 0.5).ceil() as i32 - 1).max(lo[a]));
    let mut walk = Walk::new(ray, span, 0.5, lo, hi);
    while let Some(step) = walk.next() {
        if integrator.is_dark() {
            break;
        }
        match kind(brick, step.cell, drawn) {
            dual::PLAIN => march_plain(brick, ray, &step, integrator),
            dual::MIXED => march_mixed(brick, drawn, ray, &step, integrator),
            _ => {}
        }
    }
}

#[inline]
fn kind(brick: &ScaledBrick, cell: [i32; 3], drawn: DrawnNeighbours) -> u8 {
    let [x, y, z] = cell.map(|c| c as usize);
    let count = brick.edge + 1;
    let kind = brick.duals.get((z * count + y) * count + x).copied().unwrap_or(dual::PLAIN);
    let undrawn = kind == dual::PLAIN && brick.meets_undrawn(cell, drawn);
    if undrawn { dual::MIXED } else { kind }
}

/// A dual cell whose eight corners make one trilinear function.
#[inline]
fn march_plain(brick: &ScaledBrick, ray: &LocalRay, step: &Step, integrator: &mut Integrator<'_>) {
    let block = &brick.blocks[0];
    let first = block.at(step.cell.map(|c| c as usize));
    let (row, layer) = (block.side, block.side * block.side);
    let pair = |at: usize| [block.values[at], block.values[at + 1]];
    let [a, b] = [pair(first), pair(first + row)];
    let [c, d] = [pair(first + layer), pair(first + layer + row)];
    let corners = [a[0], a[1], b[0], b[1], c[0], c[1], d[0], d[1]];
    let low = f64::from(corners.iter().copied().fold(f32::INFINITY, f32::min));
    let high = f64::from(corners.iter().copied().fold(f32::NEG_INFINITY, f32::max));
    let piece = integrator.pieces.at(low);
    let fits = high < piece.end;
    if fits && piece.is_transparent {
        return;
    }
    let (origin, direction) = (ray.origin.to_array(), ray.direction.to_array());
    let at = |sigma: f64| -> [f64; 3] {
        std::array::from_fn(|a| origin[a] + 0.5 - f64::from(step.cell[a]) + direction[a] * sigma)
    };
    let x = Polynomial::along_line(&corners.map(f64::from), at(step.from), at(step.to));
    let length = (step.to - step.from) * ray.length;
    if fits {
        integrator.within(&x, piece, [low, high], length);
    } else {
        integrator.along(&x, length);
    }
}
