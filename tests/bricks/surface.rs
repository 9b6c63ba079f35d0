//! A picture of one opaque shell, by simple ray marching over point samples.

use deepfield::image::Film;
use deepfield::space::{FRACTION_BITS, Position};
use glam::DVec3;

use super::Tree;

/// Steps, in cells of the place.
const STEP: f64 = 0.2;
/// Where the light comes from.
const LIGHT: DVec3 = DVec3::new(-0.5, 0.7, -0.6);

/// What is looked at: all in code length.
pub(crate) struct Surface {
    pub(crate) centre: DVec3,
    /// Along the parallel rays.
    pub(crate) forward: DVec3,
    /// Height and depth of the view.
    pub(crate) size: f64,
    /// The shell lies where the value is this.
    pub(crate) value: f64,
}

impl Surface {
    /// The shell of `value`, `side` × `side` pixels.
    pub(crate) fn picture(
        &self,
        tree: &Tree<'_>,
        side: u32,
        value: &dyn Fn(&Position) -> f64,
    ) -> Film {
        let forward = self.forward.normalize();
        let right = forward.cross(DVec3::Y).normalize();
        let up = right.cross(forward);
        let mut film = Film::new(side, side).unwrap();
        for y in 0..side {
            for x in 0..side {
                let plane = |n: u32| (f64::from(n) + 0.5) / f64::from(side) - 0.5;
                let aside = right * plane(x) - up * plane(y);
                let start = self.centre + (aside - 0.5 * forward) * self.size;
                let shade = self.shade(tree, (start, forward), value);
                film.write_rectangle(x, y, 1, &[[shade, shade, shade, 1.0]]).unwrap();
            }
        }
        film
    }

    fn shade(
        &self,
        tree: &Tree<'_>,
        (start, forward): (DVec3, DVec3),
        value: &dyn Fn(&Position) -> f64,
    ) -> f32 {
        let excess = |point: DVec3| Some(value(&position(tree, point)?) - self.value);
        let mut from = 0.0;
        while from < self.size {
            let step = STEP * cell_width(tree, start + forward * from);
            let at = |t: f64| excess(start + forward * t).unwrap_or(-1.0);
            if at(from) < 0.0 && at(from + step) >= 0.0 {
                let hit = crossing(&at, from, from + step);
                return lambert(&excess, start + forward * hit, 0.1 * step, forward);
            }
            from += step;
        }
        0.02
    }
}

/// Where `at` crosses 0 between `low` and `high`.
fn crossing(at: &dyn Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    for _ in 0..24 {
        let middle = 0.5 * (low + high);
        if at(middle) < 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    high
}

fn lambert(excess: &dyn Fn(DVec3) -> Option<f64>, point: DVec3, reach: f64, forward: DVec3) -> f32 {
    let along = |axis: DVec3| {
        excess(point + axis * reach).unwrap_or(-1.0) - excess(point - axis * reach).unwrap_or(-1.0)
    };
    let slope = DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z));
    let outward = -slope.normalize_or_zero();
    let lit = outward.dot(LIGHT.normalize()).max(0.0);
    (0.08 + 0.6 * lit + 0.15 * outward.dot(-forward).max(0.0)) as f32
}

/// The position of a point of the domain.
fn position(tree: &Tree<'_>, point: DVec3) -> Option<Position> {
    let domain = &tree.cache.header().domain;
    let cells = (point - DVec3::from_array(domain.left())) / domain.root_cell_width();
    let units = cells * f64::from(FRACTION_BITS).exp2();
    let position = Position(units.to_array().map(|x| x as i128));
    (cells.min_element() >= 0.0 && domain.contains(&position)).then_some(position)
}

/// Width of the cells of the brick at `point`.
fn cell_width(tree: &Tree<'_>, point: DVec3) -> f64 {
    let domain = &tree.cache.header().domain;
    let octree = position(tree, point).map_or(0, |p| {
        let path = tree.path(&p, None);
        path[path.len() - 1].place.octree
    });
    domain.cell_width(octree).min_element()
}
