//! `cell`: the value is constant in each cell, so every stretch has a closed form.

use super::absorb::Integrator;
use super::brick_account::{BrickAccount, PathSegment};
use super::ray::CellRange;
use crate::render::bounds::touch::Touch;
use crate::render::brick::blocks::ScaledBlock;
use crate::render::brick::passage::Region;
use crate::render::brick::scaled::ScaledBrick;
use crate::render::brick::walk::Walk;
use crate::render::camera::frame::LocalRay;

/// Marches a ray through the stretch `span` of σ, from cell to cell.
pub(super) fn march_cells(
    brick: &ScaledBrick,
    region: &Region,
    ray: &LocalRay,
    span: (f64, f64),
    integrator: &mut Integrator<'_>,
    account: &mut Option<BrickAccount<'_>>,
) {
    let block = &brick.blocks[0];
    let CellRange { lo, hi } = CellRange::of(region, 0.0);
    let mut walk = Walk::new(ray, span, 0.0, lo, hi);
    if let Some(account) = account {
        return march_accounted(block, ray, &mut walk, integrator, account);
    }
    // Equal neighbours make one stretch: the closed form is the same and costs once.
    let (mut x, mut from, mut to) = (f64::NAN, span.0, span.0);
    while let Some(step) = walk.next() {
        let value = block.values[block.at(step.cell.map(|c| c as usize + 1))];
        if value.to_bits() != x.to_bits() {
            add(integrator, x, (to - from) * ray.length);
            if integrator.is_faded() {
                return;
            }
            (x, from) = (value, step.from);
        }
        to = step.to;
    }
    add(integrator, x, (to - from) * ray.length);
}

/// Marches a ray cell by cell, equal neighbours or not, and keeps an account of each.
fn march_accounted(
    block: &ScaledBlock,
    ray: &LocalRay,
    walk: &mut Walk,
    integrator: &mut Integrator<'_>,
    account: &mut BrickAccount<'_>,
) {
    while let Some(step) = walk.next() {
        if integrator.is_faded() {
            break;
        }
        account.enter(step.cell, integrator);
        let length = (step.to - step.from) * ray.length;
        if account.is_spread() {
            let touching = Touch::new(ray, &step, 0.0, account.spread()).faces() * length;
            let transmittance = integrator.state.transmittance;
            account.touch(touching, PathSegment { length, transmittance });
        }
        add(integrator, block.values[block.at(step.cell.map(|c| c as usize + 1))], length);
    }
    account.close(integrator);
}

#[inline]
fn add(integrator: &mut Integrator<'_>, x: f64, length: f64) {
    if !x.is_nan() {
        integrator.cell(x, length);
    }
}
