//! Rays of a picture's pixels, in double-double.

use super::Result;
use super::dataset::Dataset;
use super::double_double::DoubleDouble;
use super::exact::{self, Rational};
use super::scene::{Projection, Scene};
use super::walk::Ray;

type Vector = [DoubleDouble; 3];

/// A camera placed in a data set.
pub(crate) struct Camera {
    projection: Projection,
    /// Root cells from the domain's left edge.
    position: Vector,
    forward: Vector,
    right: Vector,
    up: Vector,
    /// Half the view's height: a slope (perspective) or code length (orthographic).
    half_height: DoubleDouble,
    root_cell_width: Vector,
    size: [usize; 2],
}

/// Where a box appears in a picture.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BoxView {
    /// Column and row, pixels from the upper left corner.
    pub(crate) lo: [f64; 2],
    pub(crate) hi: [f64; 2],
    /// Edge of a pixel at the box's nearest and farthest corner, code length; the nearest is not
    /// positive where the box reaches behind the eye, and its place means nothing.
    pub(crate) near: f64,
    pub(crate) far: f64,
    /// Longest path of a ray through a slab across the view, over the slab's thickness.
    pub(crate) stretch: f64,
}

impl Camera {
    pub(crate) fn new(scene: &Scene, dataset: &Dataset) -> Result<Self> {
        let camera = &scene.camera;
        let (position, target) = (camera.position()?, camera.look_at()?);
        let view: [Rational; 3] = std::array::from_fn(|a| &target[a] - &position[a]);
        let forward = normalised(view.each_ref().map(exact::to_double_double))?;
        let up_hint = camera.up()?.each_ref().map(exact::to_double_double);
        let right = normalised(cross(forward, up_hint))?;
        let half_height = match (camera.projection, camera.fov, camera.height) {
            (Projection::Perspective, Some(fov), None) => (fov.to_radians() / 2.0).tan(),
            (Projection::Orthographic, None, Some(height)) => height / 2.0,
            _ => return Err("perspective takes fov, orthographic height".into()),
        };
        Ok(Self {
            projection: camera.projection,
            position: dataset.in_root_cells(&position),
            forward,
            right,
            up: cross(right, forward),
            half_height: DoubleDouble::from(half_height),
            root_cell_width: dataset.root_cell_width(),
            size: [scene.image.width, scene.image.height],
        })
    }

    /// Where a box with its centre at `centre` (root cells) and `half` its edges (code length)
    /// appears.
    pub(crate) fn view_of(&self, centre: Vector, half: [f64; 3]) -> BoxView {
        let away: Vector =
            std::array::from_fn(|a| (centre[a] - self.position[a]) * self.root_cell_width[a]);
        let axes = [self.right, self.up, self.forward];
        let middle = axes.map(|axis| dot(away, axis).to_f64());
        let [width, height] = self.size.map(|n| n as f64);
        let mut view = BoxView { lo: [f64::INFINITY; 2], hi: [-f64::INFINITY; 2], ..self.flat() };
        for corner in 0..8 {
            let side = |a: usize| if corner >> a & 1 == 1 { half[a] } else { -half[a] };
            let step = |n: usize| (0..3).map(|a| side(a) * axes[n][a].to_f64()).sum::<f64>();
            let [x, y, depth] = [0, 1, 2].map(|n| middle[n] + step(n));
            let edge = self.pixel_edge(depth);
            (view.near, view.far) = (view.near.min(edge), view.far.max(edge));
            let place = [0.5 * width + x / edge, 0.5 * height - y / edge];
            for (a, at) in place.into_iter().enumerate() {
                (view.lo[a], view.hi[a]) = (view.lo[a].min(at), view.hi[a].max(at));
            }
        }
        view
    }

    /// Edge of what a pixel sees at a depth along the view, code length; not positive behind the
    /// eye.
    fn pixel_edge(&self, depth: f64) -> f64 {
        let edge = 2.0 * self.half_height.to_f64() / self.size[1] as f64;
        if self.projection == Projection::Perspective { edge * depth } else { edge }
    }

    /// A view of nothing: what the corners of a box are added to.
    fn flat(&self) -> BoxView {
        let slope = match self.projection {
            Projection::Orthographic => 0.0,
            Projection::Perspective => {
                let [width, height] = self.size.map(|n| n as f64);
                self.half_height.to_f64() * (width / height).hypot(1.0)
            }
        };
        let [lo, hi] = [[0.0; 2]; 2];
        let (near, far) = (f64::INFINITY, f64::NEG_INFINITY);
        BoxView { lo, hi, near, far, stretch: slope.hypot(1.0) }
    }

    /// The ray through `column` and `row` pixels from the top left corner of the image; both
    /// are fractions `[numerator, denominator]`.
    pub(crate) fn ray(&self, column: [f64; 2], row: [f64; 2]) -> Result<Ray> {
        let [width, height] = self.size.map(|n| DoubleDouble::from(n as f64));
        let fraction = |[n, d]: [f64; 2]| DoubleDouble::from(n) / DoubleDouble::from(d);
        let two = DoubleDouble::from(2.0);
        let p = two * fraction(column) / width - DoubleDouble::ONE;
        let q = DoubleDouble::ONE - two * fraction(row) / height;
        let across = p * self.half_height * width / height;
        let upward = q * self.half_height;
        let offset: Vector = std::array::from_fn(|a| self.right[a] * across + self.up[a] * upward);
        let in_root_cells =
            |v: Vector| -> Vector { std::array::from_fn(|a| v[a] / self.root_cell_width[a]) };
        Ok(match self.projection {
            Projection::Perspective => Ray {
                origin: self.position,
                direction: in_root_cells(normalised(sum(self.forward, offset))?),
                forward_only: true,
            },
            Projection::Orthographic => Ray {
                origin: sum(self.position, in_root_cells(offset)),
                direction: in_root_cells(self.forward),
                forward_only: false,
            },
        })
    }
}

fn sum(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|n| a[n] + b[n])
}

fn dot(a: Vector, b: Vector) -> DoubleDouble {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|n| {
        let (m, k) = ((n + 1) % 3, (n + 2) % 3);
        a[m] * b[k] - a[k] * b[m]
    })
}

fn normalised(v: Vector) -> Result<Vector> {
    let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    if length.is_zero() {
        return Err("the camera has no direction, or looks along its up vector".into());
    }
    Ok(v.map(|x| x / length))
}
