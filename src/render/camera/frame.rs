//! A brick's own view of the camera: rays and image-plane bounds in local coordinates.

use glam::{DVec2, DVec3};

use super::view::{Aim, Basis, nothing_of};
use crate::space::Twofold;

/// Outward rounding of footprints, relative to what they are computed from.
const MARGIN: f64 = 1e-12;
/// Rounding of offsets in units, relative, and more: 2⁻⁹⁶.
const OFFSET_ROUNDING: f64 = 1.0 / (1_u128 << 96) as f64;

/// The camera as one brick sees it: relative to an exact point of the view axis near the brick.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    /// The point of the axis, in the brick's cells from its lowest corner.
    pub(crate) anchor: DVec3,
    /// Where rays are along axes that they do not move along, in units of positions from that corner,
    /// exact: the eye of a perspective view, else the anchor.
    pub(crate) start_units: [i128; 3],
    /// Width of a unit of positions, in the brick's cells; a power of two.
    pub(crate) cells_per_unit: f64,
    /// Depth of that point, code length from the eye along the view direction.
    pub(crate) depth: f64,
    /// Width of the brick's cells along each axis, code length.
    pub(crate) cell_width: DVec3,
    /// Cells per code length along each axis.
    pub(crate) cells_per_length: DVec3,
    /// Units of positions in a code length along each axis.
    pub(crate) units_per_length: [Twofold; 3],
    /// The directions of the camera.
    pub(crate) basis: Basis,
    /// Whether rays leave from one eye point; else all go along the view direction.
    pub(crate) is_perspective: bool,
}

/// A ray in a brick's coordinates: at σ it is at `origin + direction·σ`. σ is the difference of
/// depth (code length along the view direction) to the frame's anchor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalRay {
    /// Where the ray is at σ = 0, in cells from the brick's lowest corner.
    pub origin: DVec3,
    /// Cells per unit of σ.
    pub direction: DVec3,
    /// Code length along the ray per unit of σ.
    pub length: f64,
    /// Only what lies at larger σ is in front of the eye.
    pub sigma_min: f64,
}

/// Bounds of a box on the image plane, rounded outward.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Footprint {
    /// Smallest (P, Q).
    pub plane_lo: DVec2,
    /// Largest (P, Q).
    pub plane_hi: DVec2,
    /// Smallest depth, code length along the view direction from the eye; not below 0 in a
    /// perspective view.
    pub depth_lo: f64,
    /// Largest depth.
    pub depth_hi: f64,
}

impl Frame {
    /// The ray through (P, Q) = `plane`.
    #[inline]
    pub fn ray(&self, plane: DVec2) -> LocalRay {
        self.ray_of(&self.basis.aim(plane, self.is_perspective))
    }

    /// The ray that is aimed as `aim` says.
    #[inline]
    pub(crate) fn ray_of(&self, aim: &Aim) -> LocalRay {
        let (forward, aside, length) =
            (self.basis.forward, self.basis.aside(aim.plane), aim.length);
        let mut ray = if self.is_perspective {
            let along = forward + aside;
            LocalRay {
                origin: self.anchor + aside * self.depth * self.cells_per_length,
                direction: along * self.cells_per_length,
                length,
                sigma_min: -self.depth,
            }
        } else {
            LocalRay {
                origin: self.anchor + aside * self.cells_per_length,
                direction: forward * self.cells_per_length,
                length,
                sigma_min: f64::NEG_INFINITY,
            }
        };
        if aim.stays {
            self.settle(&mut ray, aim);
        }
        ray
    }

    /// Along axes that the ray does not move along, but for rounding, its coordinate decides which of
    /// two bricks that share a face holds it: taken in whole units, alike in every frame, and rounded
    /// down like positions, so that exactly one does. That of a perspective view's ray is the eye's own.
    #[cold]
    fn settle(&self, ray: &mut LocalRay, aim: &Aim) {
        let stays = self.basis.stays(aim.plane, self.is_perspective);
        let aside = self.basis.aside(aim.plane);
        for a in (0..3).filter(|&a| stays.test(a)) {
            let is_beside = !self.is_perspective && aside[a].abs() > nothing_of(aim.plane);
            let units = if is_beside { self.units_beside(aim, a) } else { self.start_units[a] };
            ray.origin[a] = rounded_down(units) * self.cells_per_unit;
            ray.direction[a] = 0.0;
        }
    }

    /// Where an orthographic view's ray is along axis `a`, in units. What may be a face of the brick's
    /// cells as far as rounding tells is one: it is less than a hundredth of any cell.
    fn units_beside(&self, aim: &Aim, a: usize) -> i128 {
        let Basis { right, up, .. } = self.basis;
        let rest = right[a] * aim.rest.x + up[a] * aim.rest.y;
        let aside = Twofold::product(right[a], aim.plane.x)
            .plus(Twofold::product(up[a], aim.plane.y))
            .plus(Twofold::from(rest));
        let offset = aside.times(self.units_per_length[a]);
        if !offset.high.is_finite() {
            // As far away as numbers go: beside nothing.
            let far = aside.high * self.units_per_length[a].high;
            return self.start_units[a].saturating_add(far as i128);
        }
        let units = self.start_units[a].saturating_add(offset.floor());
        let close = ((offset.high.abs() * OFFSET_ROUNDING) as i128).saturating_add(1);
        let per_cell = self.cells_per_unit.recip() as i128;
        let face = units.saturating_add(per_cell / 2) & -per_cell;
        if face.abs_diff(units) <= close.unsigned_abs() { face } else { units }
    }

    /// The length, code length, of about the longest way through a box of `edge` cells along each
    /// axis that is seen in `footprint`.
    pub(crate) fn crossing(&self, footprint: &Footprint, edge: f64) -> f64 {
        let middle = |lo: f64, hi: f64| if (lo + hi).is_finite() { 0.5 * (lo + hi) } else { 0.0 };
        let (lo, hi) = (footprint.plane_lo, footprint.plane_hi);
        let ray = self.ray(DVec2::new(middle(lo.x, hi.x), middle(lo.y, hi.y)));
        edge / ray.direction.abs().max_element() * ray.length
    }

    /// The same camera as a brick sees it whose lowest corner is the same and whose cells are twice
    /// as wide.
    pub(crate) fn coarser(&self) -> Self {
        Self {
            anchor: self.anchor * 0.5,
            cells_per_unit: self.cells_per_unit * 0.5,
            cell_width: self.cell_width * 2.0,
            cells_per_length: self.cells_per_length * 0.5,
            ..*self
        }
    }

    /// Whether rays that cross the plane where coordinate `a` is `plane` come from above. Where the
    /// eye is as close to it as rounding they cross it within the same.
    pub(crate) fn meets_upper_first(&self, a: usize, plane: f64) -> bool {
        let forward = self.basis.forward[a];
        if !self.is_perspective {
            return forward < 0.0;
        }
        self.anchor[a] - self.depth * forward / self.cell_width[a] >= plane
    }

    /// Where the box between two places, in the brick's cells from its lowest corner, may be seen:
    /// every ray that meets it has its (P, Q) within (infinite where the box meets the eye's
    /// plane). `None` where it lies behind the eye.
    pub fn footprint(&self, lo: DVec3, hi: DVec3) -> Option<Footprint> {
        let Basis { forward, right, up } = self.basis;
        let mut seen = Footprint {
            plane_lo: DVec2::INFINITY,
            plane_hi: DVec2::NEG_INFINITY,
            depth_lo: f64::INFINITY,
            depth_hi: f64::NEG_INFINITY,
        };
        let mut reach = 0.0_f64;
        let offsets: [DVec3; 8] = std::array::from_fn(|octant| {
            let upper = |a: usize| if octant >> a & 1 == 1 { hi[a] } else { lo[a] };
            (DVec3::new(upper(0), upper(1), upper(2)) - self.anchor) * self.cell_width
        });
        for offset in offsets {
            let depth = self.depth + offset.dot(forward);
            seen.depth_lo = seen.depth_lo.min(depth);
            seen.depth_hi = seen.depth_hi.max(depth);
            reach = reach.max(offset.length());
        }
        let error = MARGIN * (reach + self.depth.abs());
        seen.depth_lo -= error;
        seen.depth_hi += error;
        if self.is_perspective && seen.depth_hi <= 0.0 {
            return None;
        }
        let place = |offset: DVec3| {
            let depth = if self.is_perspective { self.depth + offset.dot(forward) } else { 1.0 };
            (depth, DVec2::new(offset.dot(right), offset.dot(up)))
        };
        for (octant, &offset) in offsets.iter().enumerate() {
            let (depth, aside) = place(offset);
            if !self.is_perspective || depth > error {
                // Near the eye's plane depth is off by a larger part of itself.
                let off = if self.is_perspective { error / depth } else { MARGIN };
                let slack = (DVec2::splat(reach) * MARGIN + aside.abs() * off) / depth;
                seen.plane_lo = seen.plane_lo.min(aside / depth - slack);
                seen.plane_hi = seen.plane_hi.max(aside / depth + slack);
                continue;
            }
            for axis in 0..3 {
                let (ahead, beside) = place(offsets[octant ^ 1 << axis]);
                if ahead > error {
                    seen.meet_eye_plane(aside.lerp(beside, depth / (depth - ahead)), error);
                }
            }
        }
        seen.depth_lo = if self.is_perspective { seen.depth_lo.max(0.0) } else { seen.depth_lo };
        Some(seen)
    }
}

impl Footprint {
    /// An edge of the box meets the eye's plane at `aside`: near there it is seen ever farther
    /// from the view axis, on that side.
    fn meet_eye_plane(&mut self, aside: DVec2, error: f64) {
        let (lower, upper) = (aside.cmple(DVec2::splat(error)), aside.cmpge(DVec2::splat(-error)));
        self.plane_lo = DVec2::select(lower, DVec2::NEG_INFINITY, self.plane_lo);
        self.plane_hi = DVec2::select(upper, DVec2::INFINITY, self.plane_hi);
    }
}

/// The largest f64 that is not above `units`.
fn rounded_down(units: i128) -> f64 {
    let nearest = units as f64;
    if nearest as i128 > units { nearest.next_down() } else { nearest }
}
