//! What lies beside the outer sides of a tile. Neighbours tell of edges that run between their rays
//! and a pixel's; where a tile or the picture ends there are none. So pixels there that are not close
//! enough by their first ray take others on their outer sides, in the middle and at the ends, which
//! tell the same.

use super::first_rays::FirstRays;
use super::{Batch, TilePixels};
use crate::render::bounds::grade::Care;
use crate::render::camera::rays::{PixelGrid, Square, TILE_SIDE};
use crate::render::tiles::waiting::Found;

/// Towards the pixels at the left, at the right, above and below.
pub(super) const SIDES: [[i32; 2]; 4] = [[-1, 0], [1, 0], [0, -1], [0, 1]];
/// From a square's centre to its side, in units of [`Square::offset`]: within the square still.
const TO_SIDE: i16 = i16::MAX;
/// What a quadratic through the values at −2, −1 and 0 is at ½.
const AT_SIDE: [f64; 3] = [0.375, -1.25, 1.875];
/// What changes at an end of a side alone cuts off a corner: it counts as an edge this much as high.
const AT_END: f64 = 0.5;

/// Values on the outer sides of a tile, half a pixel apart.
#[derive(Default)]
pub(super) struct BorderRays {
    values: [Vec<Option<[f32; 4]>>; 4],
    is_marched: bool,
}

/// The axis along a side of [`SIDES`].
fn tangent(side: usize) -> usize {
    1 - side / 2
}

impl BorderRays {
    /// Bytes that it takes.
    pub(super) const BYTES: u64 =
        4 * (2 * TILE_SIDE as u64 + 1) * size_of::<Option<[f32; 4]>>() as u64;

    /// Forgets what it knows, for a tile of this size.
    pub(super) fn clear(&mut self, size: [u32; 2]) {
        self.is_marched = false;
        for (side, values) in self.values.iter_mut().enumerate() {
            values.clear();
            values.resize(2 * size[tangent(side)] as usize + 1, None);
        }
    }

    /// What is known on a side of the pixel at `place`, which is an outer one of the tile: half
    /// pixels from its middle along the side, and values.
    fn values(&self, place: [u32; 2], side: usize) -> impl Iterator<Item = (f64, [f64; 4])> {
        let first = 2 * place[tangent(side)] as usize;
        let known = self.values[side].iter().skip(first).take(3).zip([-1.0, 0.0, 1.0]);
        known.filter_map(|(value, along)| Some((along, (*value)?.map(f64::from))))
    }
}

impl TilePixels {
    /// The rays on outer sides of pixels that may be off by more than the tolerance, once the first
    /// ray of each is known.
    pub(super) fn border_batch(&mut self, grid: &PixelGrid) -> Option<Batch> {
        let goal = self.goal.filter(|goal| grid.has_area() && !goal.all_levels)?;
        if std::mem::replace(&mut self.first_rays.border.is_marched, true) {
            return None;
        }
        let is_open = |pixel: &usize| self.first_rays.first_bound(*pixel) > goal.tolerance;
        let mut squares = Vec::new();
        for pixel in (0..self.pixels.len()).filter(is_open) {
            let place = self.first_rays.place(pixel);
            for towards in self.first_rays.towards_rim(place, is_open) {
                squares.push(Square {
                    centre: [0, 1].map(|a| f64::from(self.rect.lo[a] + place[a]) + 0.5),
                    offset: towards.map(|towards| towards as i16 * TO_SIDE),
                    pixel: u16::try_from(pixel).unwrap_or(u16::MAX),
                    halvings: 0,
                });
            }
        }
        let (again, wholes) = Default::default();
        let cut = self.first_cut.clone().unwrap_or_else(|| goal.first_cut());
        let care = Care::Rough;
        let (has_area, is_border, before) = (false, true, care);
        let batch = Batch { squares, cut, care, before, has_area, is_border, again, wholes };
        (!batch.squares.is_empty()).then_some(batch)
    }
}

impl FirstRays {
    /// Where on the outer sides of the pixel at `place` rays are wanted, from its centre. Those at an
    /// end are the next pixel's as well.
    fn towards_rim(
        &self,
        place: [u32; 2],
        is_open: impl Fn(&usize) -> bool,
    ) -> impl Iterator<Item = [i32; 2]> {
        (0..9).map(|n| [n % 3 - 1, n / 3 - 1]).filter(move |towards| {
            let sides = (0..4).filter(|side| self.is_outer(place, *towards, *side));
            let is_others = |side: usize| {
                let mut before = [0; 2];
                before[tangent(side)] = -1;
                let others = self.order.beside(place, before);
                towards[tangent(side)] < 0 && others.is_some_and(|pixel| is_open(&pixel))
            };
            let mut sides = sides.peekable();
            sides.peek().is_some() && !sides.any(is_others)
        })
    }

    /// Whether a side is an outer one of the pixel at `place`, and so many half pixels from its
    /// centre are on it.
    fn is_outer(&self, place: [u32; 2], towards: [i32; 2], side: usize) -> bool {
        let axis = 1 - tangent(side);
        let is_on = towards[axis] == SIDES[side][axis];
        is_on && self.order.beside(place, SIDES[side]).is_none()
    }

    /// Notes what rays on outer sides have found.
    pub(super) fn note_border(&mut self, outcome: &[Found]) {
        for found in outcome {
            let towards = found.square.offset.map(|offset| i32::from(offset.signum()));
            let place = self.order.place(usize::from(found.square.pixel));
            for side in 0..4 {
                let at = (2 * place[tangent(side)] + 1).checked_add_signed(towards[tangent(side)]);
                let is_here = self.is_outer(place, towards, side);
                let known = at.and_then(|at| self.border.values[side].get_mut(at as usize));
                if let (true, Some(known)) = (is_here, known) {
                    *known = Some(found.value.map(|channel| channel as f32));
                }
            }
        }
    }

    /// By how much a ray in the pixel at `place` that has found `value` differs from what is on an
    /// outer side of it, as far as that is known.
    pub(super) fn beyond_rim(&self, place: [u32; 2], side: usize, value: &[f64; 4]) -> f64 {
        let change =
            |outer: [f64; 4]| (0..4).map(|c| (outer[c] - value[c]).abs()).fold(0.0, f64::max);
        self.border.values(place, side).map(|(_, outer)| change(outer)).fold(0.0, f64::max)
    }

    /// By how much values change at an outer side of the pixel at `place`, as far as that is known: no
    /// more than they differ from what varies smoothly, as the first rays of this pixel, of the two
    /// behind it and of those beside it along the side do.
    pub(super) fn edge_at_rim(&self, place: [u32; 2], side: usize) -> f64 {
        let Some(own) = self.first(place, [0; 2]) else { return 0.0 };
        let inward = |steps: i32| self.first(place, SIDES[side].map(|towards| -steps * towards));
        let beside = |steps: i32| {
            let mut towards = [0; 2];
            towards[tangent(side)] = steps;
            self.first(place, towards)
        };
        let (inward, beside) = ([inward(2), inward(1), Some(own)], [beside(-1), beside(1)]);
        let smooth = |along: f64, c: usize| {
            let behind = inward.iter().zip(AT_SIDE).map(|(x, part)| Some((*x)?[c] * part));
            let middle = behind.sum::<Option<f64>>()?;
            let slope = match beside {
                [Some(before), Some(after)] => 0.5 * (after[c] - before[c]),
                [Some(before), None] => own[c] - before[c],
                [None, Some(after)] => after[c] - own[c],
                [None, None] => return (along == 0.0).then_some(middle),
            };
            Some(middle + 0.5 * along * slope)
        };
        let change = |(along, outer): (f64, [f64; 4])| {
            let rough = |c: usize| smooth(along, c).map_or(f64::INFINITY, |x| (outer[c] - x).abs());
            let most = (0..4).map(|c| (outer[c] - own[c]).abs().min(rough(c))).fold(0.0, f64::max);
            if along == 0.0 { most } else { AT_END * most }
        };
        self.border.values(place, side).map(change).fold(0.0, f64::max)
    }
}
