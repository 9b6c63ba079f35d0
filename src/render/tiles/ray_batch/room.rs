//! How much of what rays may be off by is left for proxies.

use std::ops::Range;

use super::proxies::NEAREST;
use crate::render::camera::rays::{PixelRect, TILE_SIDE};

/// What proxies in one brick may use up of what is left. Then bricks in front leave something to those
/// behind, however many there are, and together they never use up more than there is.
const PART: f64 = 0.125;

/// Blocks of [`NEAREST`]² pixels along a tile's edge.
const SIDE: usize = (TILE_SIDE / NEAREST) as usize;

/// What proxies have made rays of a tile be off by, block by block of its pixels, in the picture's own
/// unit. Lattices consist of whole blocks.
#[derive(Debug)]
pub(super) struct Spent {
    blocks: Vec<f64>,
}

impl Spent {
    /// Heap bytes.
    pub(super) const BYTES: usize = SIDE * SIDE * size_of::<f64>();

    /// Nothing is used up.
    pub(super) fn new() -> Self {
        Self { blocks: vec![0.0; SIDE * SIDE] }
    }

    /// Other rays set off.
    pub(super) fn forget(&mut self) {
        self.blocks.fill(0.0);
    }

    /// What all rays in `rect`, from the tile's first pixel on, may be off by in a brick, of `room` in
    /// all.
    pub(super) fn left_for_all(&self, rect: &PixelRect, room: f64) -> f64 {
        PART * (room - self.in_rect(rect).fold(0.0, f64::max)).max(0.0)
    }

    /// What those rays in `rect` that have most left, from the tile's first pixel on, may be off by
    /// in a brick, of `room` in all.
    pub(super) fn left_for_some(&self, rect: &PixelRect, room: f64) -> f64 {
        PART * (room - self.in_rect(rect).fold(room, f64::min)).max(0.0)
    }

    /// Notes that rays in `rect` are off by `off` more.
    pub(super) fn add(&mut self, rect: &PixelRect, off: f64) {
        for row in rows(rect) {
            self.blocks[row].iter_mut().for_each(|spent| *spent += off);
        }
    }

    fn in_rect(&self, rect: &PixelRect) -> impl Iterator<Item = f64> {
        rows(rect).flat_map(|row| &self.blocks[row]).copied()
    }
}

/// The blocks with pixels in `rect`, row by row.
fn rows(rect: &PixelRect) -> impl Iterator<Item = Range<usize>> + use<> {
    let along = |a: usize| {
        let [first, end] = [rect.lo[a] / NEAREST, rect.hi[a].div_ceil(NEAREST)];
        (first as usize).min(SIDE)..(end as usize).min(SIDE)
    };
    let columns = along(0);
    along(1).map(move |row| row * SIDE + columns.start..row * SIDE + columns.end)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn rect() -> impl Strategy<Value = PixelRect> {
        let along = || (0..TILE_SIDE, 1..=TILE_SIDE);
        (along(), along()).prop_map(|(x, y)| {
            let end = |(lo, size): (u32, u32)| (lo + size).min(TILE_SIDE);
            PixelRect { lo: [x.0, y.0], hi: [end(x), end(y)] }
        })
    }

    /// A rectangle of whole blocks.
    fn whole() -> impl Strategy<Value = PixelRect> {
        rect().prop_map(|PixelRect { lo, hi }| PixelRect {
            lo: lo.map(|x| x / NEAREST * NEAREST),
            hi: hi.map(|x| x.next_multiple_of(NEAREST)),
        })
    }

    proptest! {
        /// Pixel by pixel.
        #[test]
        fn each_ray_knows_what_it_has_spent(
            used in prop::collection::vec((whole(), 0.0..1.0_f64), 0..20),
            asked in rect(),
            room in 0.0..20.0_f64,
        ) {
            let mut spent = Spent::new();
            for (rect, off) in &used {
                spent.add(rect, *off);
            }
            let of = |x: u32, y: u32| -> f64 {
                let holds = |rect: &PixelRect| rect.columns().contains(&x) && rect.rows().contains(&y);
                used.iter().filter(|(rect, _)| holds(rect)).map(|(_, off)| off).sum()
            };
            let all = asked.rows().flat_map(|y| asked.columns().map(move |x| (x, y)));
            let all: Vec<f64> = all.map(|(x, y)| PART * (room - of(x, y)).max(0.0)).collect();
            // Blocks at the rectangle's edge count whole: what was used is of whole blocks.
            let [least, most] = all.iter().fold([f64::INFINITY, 0.0_f64], |[a, b], x| [a.min(*x), b.max(*x)]);
            prop_assert!((spent.left_for_all(&asked, room) - least).abs() < 1e-12);
            prop_assert!((spent.left_for_some(&asked, room) - most).abs() < 1e-12);
        }

        #[test]
        fn no_more_is_spent_than_there_is(count in 0..200_u32, room in 0.0..10.0_f64) {
            let (mut spent, rect) = (Spent::new(), PixelRect { lo: [0; 2], hi: [TILE_SIDE; 2] });
            let mut all = 0.0;
            for _ in 0..count {
                let off = spent.left_for_all(&rect, room);
                spent.add(&rect, off);
                all += off;
            }
            prop_assert!(all <= room * (1.0 + 1e-12));
        }
    }
}
