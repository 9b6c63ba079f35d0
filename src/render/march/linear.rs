//! `linear`: from dual cell to dual cell, in each of which the interpolant is one cubic along the
//! ray, or a few polynomials beside borders of levels.

use super::absorb::Integrator;
use super::blend::{BlendRoom, march_mixed};
use super::brick_account::{BrickAccount, PathSegment};
use super::ray::{CellRange, DUAL_SHIFT};
use crate::polynomial::Polynomial;
use crate::render::bounds::touch::Touch;
use crate::render::brick::interpolant::DrawnNeighbours;
use crate::render::brick::passage::{Passage, Region};
use crate::render::brick::scaled::{ScaledBrick, dual};
use crate::render::brick::walk::{Step, Walk};
use crate::render::camera::frame::LocalRay;

/// The dual cells of a brick that a ray walks through.
#[derive(Clone, Copy)]
pub(super) struct DualCells<'b> {
    /// The brick.
    pub(super) brick: &'b ScaledBrick,
    /// Which of its neighbours are drawn.
    pub(super) drawn: DrawnNeighbours,
    /// Which dual cells these are.
    pub(super) range: &'b CellRange,
}

/// Marches a ray through the stretch `span` of σ, from dual cell to dual cell.
pub(super) fn march_linear(
    &Passage { brick, drawn, .. }: &Passage<'_>,
    region: &Region,
    ray: &LocalRay,
    span: (f64, f64),
    integrator: &mut Integrator<'_>,
    account: &mut Option<BrickAccount<'_>>,
) {
    let range = CellRange::of(region, DUAL_SHIFT);
    let mut walk = Walk::new(ray, span, DUAL_SHIFT, range.lo, range.hi);
    let cells = DualCells { brick, drawn, range: &range };
    let mut room = BlendRoom::default();
    while let Some(step) = walk.next() {
        if integrator.is_faded() {
            break;
        }
        pass_dual_cell(cells, ray, &step, &mut room, integrator, account);
    }
    if let Some(account) = account {
        account.close(integrator);
    }
}

/// The way through one of the dual cells.
#[inline]
pub(super) fn pass_dual_cell(
    cells: DualCells<'_>,
    ray: &LocalRay,
    step: &Step,
    room: &mut BlendRoom,
    integrator: &mut Integrator<'_>,
    account: &mut Option<BrickAccount<'_>>,
) {
    let DualCells { brick, drawn, .. } = cells;
    let kind = kind(brick, step.cell, drawn);
    if let Some(account) = account {
        account.enter(step.cell, integrator);
    }
    let (length, transmittance) =
        ((step.to - step.from) * ray.length, integrator.state.transmittance);
    let void = match kind {
        dual::PLAIN => {
            march_plain(brick, ray, step, integrator);
            0.0
        }
        dual::MIXED | dual::BLENDED => march_mixed(brick, drawn, ray, step, room, integrator),
        _ => length,
    };
    if let Some(account) = account
        && account.is_spread()
    {
        let touch = Touch::new(ray, step, DUAL_SHIFT, account.spread());
        if void > 0.0 {
            // Others may be in cells that were kept, behind faces of cells: those of the dual cell, beyond
            // which are others, and those through its middle.
            let near = if account.is_wide() { 2.0 } else { touch.faces() + touch.middles() };
            account.touch(near * length, PathSegment { length: void, transmittance });
        }
        let (touching, beyond) = if account.is_wide() {
            (1.0, [0.0; 3])
        } else {
            (touching(&touch, cells, step, kind), beyond(&touch))
        };
        account.leave(touching, beyond, integrator);
    }
}

/// The share of a stretch along which rays of the square may be beyond a face of what is drawn of
/// the brick, or where weights beside a border of levels bend.
#[inline]
fn touching(
    touch: &Touch,
    DualCells { brick, range, .. }: DualCells<'_>,
    step: &Step,
    kind: u8,
) -> f64 {
    if kind != dual::PLAIN {
        // With more than one ancestor weights bend at more places than these.
        let simple = brick.used <= 2;
        return if simple { touch.faces() + touch.middles() + touch.diagonals() } else { 1.0 };
    }
    let ends = |a: usize| {
        let is_at_face = step.cell[a] == range.lo[a] || step.cell[a] == range.hi[a];
        if is_at_face { touch.plane(a, 0.5) } else { 0.0 }
    };
    ends(0) + ends(1) + ends(2)
}

/// How far rays of the square are on average in the next dual cell along each axis.
#[inline]
fn beyond(touch: &Touch) -> [f64; 3] {
    std::array::from_fn(|a| touch.beyond(a, 0.0) + touch.beyond(a, 1.0))
}

/// The [`dual`] kind of dual cell `cell`, given which neighbours are drawn: beside one that is not,
/// a plain or blended cell counts as mixed.
#[inline]
pub(super) fn kind(brick: &ScaledBrick, cell: [i32; 3], drawn: DrawnNeighbours) -> u8 {
    let [x, y, z] = cell.map(|c| c as usize);
    let count = brick.edge + 1;
    let kind = brick.duals.get((z * count + y) * count + x).copied().unwrap_or(dual::PLAIN);
    // Which of a blended cell's corners exist is known of drawn neighbours alone.
    let knows = kind == dual::PLAIN || kind == dual::BLENDED;
    let undrawn = knows && brick.meets_undrawn(cell, drawn);
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
    let low = corners.iter().copied().fold(f64::INFINITY, f64::min);
    let high = corners.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let piece = integrator.pieces.at(low);
    let fits = high < piece.end;
    let length = (step.to - step.from) * ray.length;
    if fits && piece.is_transparent && integrator.is_clear(piece, [low, high]) {
        return integrator.through_nothing(piece, high, length);
    }
    let (origin, direction) = (ray.origin.to_array(), ray.direction.to_array());
    let at = |sigma: f64| -> [f64; 3] {
        std::array::from_fn(|a| origin[a] + 0.5 - f64::from(step.cell[a]) + direction[a] * sigma)
    };
    let x = Polynomial::along_line(&corners, at(step.from), at(step.to));
    if fits {
        integrator.along_piece(&x, piece, [low, high], length);
    } else {
        integrator.along(&x, length);
    }
}
