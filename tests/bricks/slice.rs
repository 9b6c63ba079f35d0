//! A picture of a cut through the data under a transfer function with sharp steps.

use deepfield::render::Film;
use deepfield::space::{FRACTION_BITS, Position};
use glam::DVec3;

use super::Tree;

/// Samples in each pixel and axis.
const SAMPLES: u32 = 3;

/// The plane z = `centre.z`: a square of `size` around `centre`, all in code length.
pub(crate) struct Slice {
    pub(crate) centre: DVec3,
    pub(crate) size: f64,
    /// Dark and bright bands in turn: this many pairs in a unit of the value.
    pub(crate) bands: f64,
}

impl Slice {
    /// `side` × `side` pixels.
    pub(crate) fn picture(
        &self,
        tree: &Tree<'_>,
        side: u32,
        value: &dyn Fn(&Position) -> f64,
    ) -> Film {
        let mut film = Film::new(side, side).unwrap();
        let part = |n: u32| (f64::from(n) + 0.5) / f64::from(side * SAMPLES) - 0.5;
        for y in 0..side {
            for x in 0..side {
                let mut light = 0.0;
                for n in 0..SAMPLES * SAMPLES {
                    let (right, down) = (x * SAMPLES + n % SAMPLES, y * SAMPLES + n / SAMPLES);
                    let offset = DVec3::new(part(right), -part(down), 0.0) * self.size;
                    let at = position(tree, self.centre + offset);
                    light += at.map_or(0.0, |at| self.shade(value(&at)));
                }
                let shade = (light / f64::from(SAMPLES * SAMPLES)) as f32;
                film.write_rectangle(x, y, 1, &[[shade, shade, shade, 1.0]]).unwrap();
            }
        }
        film
    }

    fn shade(&self, value: f64) -> f64 {
        if (value * self.bands).rem_euclid(1.0) < 0.5 { 0.02 } else { 0.8 }
    }
}

/// The position of a point of the domain.
fn position(tree: &Tree<'_>, point: DVec3) -> Option<Position> {
    let domain = &tree.cache.header().domain;
    let cells = (point - DVec3::from_array(domain.left())) / domain.root_cell_width();
    let units = cells * f64::from(FRACTION_BITS).exp2();
    let position = Position(units.to_array().map(|x| x as i128));
    (cells.min_element() >= 0.0 && domain.contains(&position)).then_some(position)
}
