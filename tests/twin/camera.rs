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
