//! `cell`: the value is constant in each cell, so every stretch has a closed form.

use super::absorb::Integrator;
use super::frame::LocalRay;
use super::march::Region;
use super::scaled::ScaledBrick;
use super::walk::Walk;

/// As [`super::march::march`], over the stretch `span` of σ.
pub(super) fn march_cells(
    brick: &ScaledBrick,
    region: &Region,
    ray: &LocalRay,
    span: (f64, f64),
    integrator: &mut Integrator<'_>,
) {
    let block = &brick.blocks[0];
    let lo = region.lo.map(|x| x.floor() as i32);
    let hi = std::array::from_fn(|a| (region.hi[a].ceil() as i32 - 1).max(lo[a]));
    let mut walk = Walk::new(ray, span, 0.0, lo, hi);
    // Equal neighbours make one stretch: the closed form is the same and costs once.
    let (mut x, mut from, mut to) = (f32::NAN, span.0, span.0);
    while let Some(step) = walk.next() {
        let value = block.values[block.at(step.cell.map(|c| c as usize + 1))];
        if value.to_bits() != x.to_bits() {
            add(integrator, x, (to - from) * ray.length);
            if integrator.is_dark() {
                return;
            }
            (x, from) = (value, step.from);
        }
        to = step.to;
    }
    add(integrator, x, (to - from) * ray.length);
}

#[inline]
fn add(integrator: &mut Integrator<'_>, x: f32, length: f64) {
    if !x.is_nan() {
        integrator.constant(f64::from(x), length);
    }
}
