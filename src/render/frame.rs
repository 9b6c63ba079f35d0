//! A brick's own view of the camera: rays and image-plane bounds in local coordinates.

use glam::{DVec2, DVec3};

use super::view::Basis;

/// Outward rounding of footprints, relative to what they are computed from.
const MARGIN: f64 = 1e-12;

/// The camera as one brick sees it: relative to an exact point of the view axis near the brick.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    /// The point of the axis, in the brick's cells from its lowest corner.
    pub(super) anchor: DVec3,
    /// Depth of that point, code length from the eye along the view direction.
    pub(super) depth: f64,
    /// Width of the brick's cells, code length.
    pub(super) cell_width: DVec3,
    pub(super) basis: Basis,
    pub(super) is_perspective: bool,
    /// Half the image plane's extents.
    pub(super) half: DVec2,
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
        let Basis { forward, right, up } = self.basis;
        let aside = right * plane.x + up * plane.y;
        if self.is_perspective {
            let along = forward + aside;
            return LocalRay {
                origin: self.anchor + aside * self.depth / self.cell_width,
                direction: along / self.cell_width,
                length: along.length(),
                sigma_min: -self.depth,
            };
        }
        LocalRay {
            origin: self.anchor + aside / self.cell_width,
            direction: forward / self.cell_width,
            length: 1.0,
            sigma_min: f64::NEG_INFINITY,
        }
    }

    /// Where the box of `size_cells`³ cells at the brick's lowest corner may be seen: every ray
    /// that meets it has its (P, Q) within. `None` where it lies behind the eye.
    pub fn footprint(&self, size_cells: f64) -> Option<Footprint> {
        let Basis { forward, right, up } = self.basis;
        let mut seen = Footprint {
            plane_lo: DVec2::INFINITY,
            plane_hi: DVec2::NEG_INFINITY,
            depth_lo: f64::INFINITY,
            depth_hi: f64::NEG_INFINITY,
        };
        let mut reach = 0.0_f64;
        let offsets: [DVec3; 8] = std::array::from_fn(|octant| {
            let upper = |a: usize| if octant >> a & 1 == 1 { size_cells } else { 0.0 };
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
        if self.is_perspective && seen.depth_lo <= error {
            let whole = self.half * (1.0 + MARGIN);
            return Some(Footprint {
                plane_lo: -whole,
                plane_hi: whole,
                depth_lo: seen.depth_lo.max(0.0),
                ..seen
            });
        }
        for offset in offsets {
            let depth = if self.is_perspective { self.depth + offset.dot(forward) } else { 1.0 };
            let plane = DVec2::new(offset.dot(right), offset.dot(up)) / depth;
            let slack = DVec2::splat(MARGIN * reach / depth) + plane.abs() * MARGIN;
            seen.plane_lo = seen.plane_lo.min(plane - slack);
            seen.plane_hi = seen.plane_hi.max(plane + slack);
        }
        Some(seen)
    }
}
