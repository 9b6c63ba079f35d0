//! The camera: exact positions, and which ray belongs to which place of the picture.

use glam::{BVec3, DVec2, DVec3};

use super::axis::axis_point;
use super::frame::Frame;
use crate::scene::{CameraSettings, Interpolation, Projection, Scene};
use crate::space::{Domain, FRACTION_BITS, Position, Twofold};
use crate::{Error, Result};

/// An `up` closer to the view direction than this (sine of the angle) has no direction left.
const SMALLEST_SINE: f64 = 1e-12;
/// `position` and `look_at` are at least this part of a root cell's longest side apart, 2²⁴ units of
/// positions: flooring turns the view by no more than f32 tells, then.
const LEAST_APART: f64 = 1.0 / (1_u128 << 72) as f64;
/// An edge that leaves a pixel's row or column by no more than this part of a pixel is met by the rays
/// of a row of eight squares alike.
const ALIKE: f64 = 0.125;
/// What rounding leaves of sums that cancel, relative to their terms.
const NOTHING: f64 = 8.0 * f64::EPSILON;

/// The camera's directions: orthonormal to rounding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Basis {
    /// The view direction.
    pub(crate) forward: DVec3,
    /// To the right in the picture.
    pub(crate) right: DVec3,
    /// Up in the picture.
    pub(crate) up: DVec3,
}

impl Basis {
    /// The ray through (P, Q) = `plane`.
    #[inline]
    pub(super) fn aim(&self, plane: DVec2, is_perspective: bool) -> Aim {
        let along = self.forward + self.aside(plane);
        let length = if is_perspective { along.length() } else { 1.0 };
        let stays = self.stays(plane, is_perspective).any();
        Aim { plane, rest: DVec2::ZERO, length, stays }
    }

    /// From the view axis to (P, Q) = `plane`, at a depth of 1.
    #[inline]
    pub(super) fn aside(&self, plane: DVec2) -> DVec3 {
        self.right * plane.x + self.up * plane.y
    }

    /// Along which axes the ray through (P, Q) = `plane` does not move, but for rounding.
    pub(super) fn stays(&self, plane: DVec2, is_perspective: bool) -> BVec3 {
        if !is_perspective {
            return self.forward.cmpeq(DVec3::ZERO);
        }
        let along = self.forward + self.aside(plane);
        along.abs().cmple(self.forward.abs() * NOTHING + nothing_of(plane))
    }
}

/// What rounding leaves of a sum of parts of `right` and `up` that is nothing.
pub(super) fn nothing_of(plane: DVec2) -> f64 {
    NOTHING * (plane.x.abs() + plane.y.abs())
}

/// A ray, as far as it is the same in all frames.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Aim {
    /// (P, Q).
    pub(crate) plane: DVec2,
    /// What rounding has left of them, where the side of a face may hang on it.
    pub(super) rest: DVec2,
    /// How long the way along it is for each unit of depth.
    pub(crate) length: f64,
    /// Whether there is an axis that it does not move along.
    pub(super) stays: bool,
}

/// A camera in a domain, with the picture's size. Places of the image plane are (P, Q): the ray
/// of a perspective view runs along `forward + right·P + up·Q` from the eye, that of an
/// orthographic one along `forward` through `position + right·P + up·Q` (code length).
#[derive(Debug, Clone)]
pub struct View {
    domain: Domain,
    width: u32,
    height: u32,
    position: Position,
    look_at: Position,
    /// |look_at − position|, code length.
    distance: f64,
    basis: Basis,
    is_perspective: bool,
    /// P and Q at the picture's right and upper edge.
    half: DVec2,
    /// Units of positions in a code length along each axis.
    units_per_length: [Twofold; 3],
    /// Whether cells are seen as such, with edges of their own.
    shows_cells: bool,
}

impl View {
    /// The camera of `scene` in `domain`.
    ///
    /// # Errors
    /// Positions out of range, `look_at` as good as at `position`, and an `up` along the view.
    pub fn new(scene: &Scene, domain: &Domain) -> Result<Self> {
        let view = Self::from_camera(&scene.camera, scene.image.width, scene.image.height, domain)
            .map_err(|error| Error::request(format!("{}: {error}", scene.place)))?;
        Ok(Self { shows_cells: scene.render.interpolation == Interpolation::Cell, ..view })
    }

    /// The camera in `domain`, for a picture of `width`×`height` pixels.
    ///
    /// # Errors
    /// Whatever [`Self::new`] says of the camera.
    pub(super) fn from_camera(
        camera: &CameraSettings,
        width: u32,
        height: u32,
        domain: &Domain,
    ) -> Result<Self> {
        let place = |name, place| {
            let named = |error: Error| Error::request(format!("camera: {name}: {error}"));
            domain.position(place).map_err(named)
        };
        let position = place("position", &camera.position)?;
        let look_at = place("look_at", &camera.look_at)?;
        let ahead = domain.difference(&look_at, &position);
        if ahead.length() < LEAST_APART * domain.root_cell_width().max_element() {
            return Err(Error::request(
                "camera: look_at is less than 2^-72 of a root cell from position, which tells no \
                 direction: move one of them",
            ));
        }
        let (is_perspective, half_height) = match camera.projection {
            // fov/2 in radians, in one rounding, so that tiny angles stay precise.
            Projection::Perspective { fov_degrees } => {
                (true, (fov_degrees * (std::f64::consts::PI / 360.0)).tan())
            }
            Projection::Orthographic { height } => (false, 0.5 * height),
        };
        let aspect = f64::from(width) / f64::from(height);
        if !(half_height > 0.0 && half_height.is_finite() && aspect > 0.0 && aspect.is_finite()) {
            return Err(Error::request("camera: the view has no height or width"));
        }
        Ok(Self {
            domain: domain.clone(),
            width,
            height,
            position,
            look_at,
            distance: ahead.length(),
            basis: basis(ahead, camera.up)?,
            is_perspective,
            half: DVec2::new(f64::from(width) * half_height / f64::from(height), half_height),
            units_per_length: domain.units_per_length(),
            shows_cells: false,
        })
    }

    /// Pixels in a row.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The ray through a place, as [`Self::plane_in`] has it.
    pub(super) fn aim_in(&self, place: [f64; 2], per: f64) -> Aim {
        let aim = self.basis.aim(self.plane_in(place, per), self.is_perspective);
        if !aim.stays || self.is_perspective {
            return aim;
        }
        let [x, y] = self.parts_in(place, per).map(|part| {
            let height = Twofold::from(per * f64::from(self.height));
            Twofold::product(part, self.half.y).over(height)
        });
        let left = |exact: Twofold, rounded: f64| (exact.high - rounded) + exact.low;
        Aim { rest: DVec2::new(left(x, aim.plane.x), left(y, aim.plane.y)), ..aim }
    }

    /// (P, Q) of a place in pixels from the picture's left and upper edge: i + ½ and j + ½ for
    /// the centre of pixel (i, j).
    pub fn plane(&self, x_pixels: f64, y_pixels: f64) -> DVec2 {
        self.plane_in([2.0 * x_pixels, 2.0 * y_pixels], 1.0)
    }

    /// (P, Q) of a place in halves of a pixel's `per`-th, from the picture's left and upper edge.
    /// Where these are whole numbers, P and Q are rounded once, or twice if the view's height takes
    /// many bits: rays that lie in faces of cells do so exactly.
    pub(super) fn plane_in(&self, place: [f64; 2], per: f64) -> DVec2 {
        let height = per * f64::from(self.height);
        DVec2::from_array(self.parts_in(place, per).map(|part| part * self.half.y / height))
    }

    /// Where a place lies to the right of the picture's middle and above, in halves of a pixel's
    /// `per`-th.
    fn parts_in(&self, [x, y]: [f64; 2], per: f64) -> [f64; 2] {
        [x - per * f64::from(self.width), per * f64::from(self.height) - y]
    }

    /// Whether edges may run along rows or columns of pixels within `reach` of (P, Q) = `plane`: all
    /// that there are along an axis are seen in the direction in which a point that moves along it does.
    pub(super) fn has_edges_along_pixels(&self, plane: DVec2, reach: f64) -> bool {
        let Basis { forward, right, up } = self.basis;
        let at = if self.is_perspective { plane } else { DVec2::ZERO };
        (0..3).any(|axis| {
            let along = DVec2::new(right[axis], up[axis]) - at * forward[axis];
            let [least, most] = [along.abs().min_element(), along.abs().max_element()];
            most > 0.0
                && least <= ALIKE * most
                && (self.shows_cells || self.is_by_domains_edge(plane, reach, axis))
        })
    }

    /// Whether the line of an edge of the domain along an axis is within `reach` of (P, Q) = `plane`.
    fn is_by_domains_edge(&self, plane: DVec2, reach: f64, axis: usize) -> bool {
        let Basis { forward, right, up } = self.basis;
        let along = DVec3::AXES[axis];
        (0..4).any(|n| {
            let mut corner = Position([0; 3]);
            for side in 0..2 {
                let across = (axis + 1 + side) % 3;
                corner.0[across] =
                    if n >> side & 1 == 1 { self.domain.upper().0[across] } else { 0 };
            }
            let corner = self.domain.difference(&corner, &self.position);
            // The line is seen where rays lie in the plane with this normal through the eye; or, if they
            // are parallel, in that along them.
            let (normal, off) = if self.is_perspective {
                let normal = corner.cross(along);
                (normal, normal.dot(forward))
            } else {
                let normal = along.cross(forward);
                (normal, -normal.dot(corner))
            };
            let normal = DVec2::new(normal.dot(right), normal.dot(up));
            (normal.dot(plane) + off).abs() <= reach * normal.length()
        })
    }

    /// A pixel's width, in the units of P and Q.
    pub(super) fn pixel(&self) -> f64 {
        2.0 * self.half.y / f64::from(self.height)
    }

    /// P and Q at the picture's right and upper edge; the others are their negatives.
    #[cfg(test)]
    pub(super) fn plane_half_size(&self) -> DVec2 {
        self.half
    }

    /// The frame of a brick of `size_cells`³ cells of octree level `octree` with its lowest
    /// corner at `corner`: anchored at the exact point of the view axis that is closest to the
    /// brick's centre, counted in cells (of those not behind the eye, in a perspective view). By code
    /// length that point may lie beyond the range of positions, where cells are much longer along one
    /// axis than along another.
    pub fn frame(&self, corner: &Position, octree: i32, size_cells: f64) -> Frame {
        let cells_per_unit = f64::from(octree - FRACTION_BITS as i32).exp2();
        let half = (0.5 * size_cells / cells_per_unit) as i128;
        let centre = Position(corner.0.map(|c| c.saturating_add(half)));
        let cell_width = self.domain.cell_width(octree);
        let in_cells = |to| self.domain.difference(to, &self.position) / cell_width;
        let ahead = in_cells(&self.look_at);
        let t = in_cells(&centre).dot(ahead) / ahead.length() / ahead.length();
        let t = if t.is_finite() && !(self.is_perspective && t < 0.0) { t } else { 0.0 };
        let anchor = axis_point(&self.position, &self.look_at, t);
        let from_corner = |place: &Position| -> [i128; 3] {
            std::array::from_fn(|a| place.0[a].saturating_sub(corner.0[a]))
        };
        let anchor_units = from_corner(&anchor);
        Frame {
            anchor: DVec3::from_array(anchor_units.map(|units| units as f64 * cells_per_unit)),
            start_units: if self.is_perspective {
                from_corner(&self.position)
            } else {
                anchor_units
            },
            cells_per_unit,
            depth: t * self.distance,
            cell_width,
            units_per_length: self.units_per_length,
            cells_per_length: cell_width.recip(),
            basis: self.basis,
            is_perspective: self.is_perspective,
        }
    }

    /// The order in which a box's octants are met, as a mask: octants `o ^ mask` for o in 0..8
    /// run front to back, for the box (or brick) centred at `centre`, whatever the ray.
    pub fn octant_order(&self, centre: &Position) -> u8 {
        (0..3).fold(0, |mask, a| {
            let upper_first = if self.is_perspective {
                self.position.0[a] >= centre.0[a]
            } else {
                self.look_at.0[a] < self.position.0[a]
            };
            mask | u8::from(upper_first) << a
        })
    }

    /// Height of a pixel's footprint at `depth` (code length along the view direction from the
    /// eye), code length; 0 behind the eye of a perspective view.
    #[cfg(test)]
    pub(super) fn pixel_size_at(&self, depth: f64) -> f64 {
        let pixel = self.pixel();
        if self.is_perspective { pixel * depth.max(0.0) } else { pixel }
    }
}

/// Directions from the view direction and `up`, of any lengths.
fn basis(ahead: DVec3, up: DVec3) -> Result<Basis> {
    let up = up / up.abs().max_element();
    let forward = ahead.normalize();
    let across = forward.cross(up.normalize());
    if across.length() <= SMALLEST_SINE || !across.is_finite() {
        return Err(Error::request("camera: up points along the view: choose another direction"));
    }
    // The cross product of nearly parallel vectors is orthogonal only after a second pass.
    let across = across.normalize();
    let right = (across - forward * across.dot(forward)).normalize();
    // Along an axis it is exactly that, so that rays can lie in faces of cells.
    let is_across = forward.dot(up) == 0.0;
    let above = if is_across { up.normalize() } else { right.cross(forward).normalize() };
    Ok(Basis { forward, right, up: above })
}
