//! How many rays need more of a brick, and how much of the light from there reaches them.

use std::ops::Range;

use super::RayBatch;
use crate::render::camera::pixel_order::BLOCK;
use crate::render::camera::rays::{PixelRect, TILE_SIDE};

/// Rays that need more of a brick.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Open {
    /// How many rays.
    pub(super) count: usize,
    /// A bound of the largest transmittance of any of them.
    pub(super) transmittance: f64,
}

/// Bricks for which the transmittances of strips are looked up once. They only fall, so they hold on.
const LASTING: u32 = 8;

/// The largest transmittance of the rays in each strip of a tile's pixels, a few bricks ago.
#[derive(Debug, Default)]
pub(super) struct Clearness {
    strips: Vec<f64>,
    asked: u32,
}

impl Clearness {
    /// Heap bytes.
    pub(super) const BYTES: usize = TILE_SIDE as usize * size_of::<f64>();

    /// Nothing is known of any strip.
    pub(super) fn new() -> Self {
        Self { strips: Vec::with_capacity(TILE_SIDE as usize), asked: 0 }
    }

    /// Other rays set off.
    pub(super) fn forget(&mut self) {
        self.asked = 0;
    }
}

impl RayBatch {
    /// The rays in `rect`, which lies within the tile, that need more of a brick that none has been
    /// marched through; all that do of a block of pixels that has some in it.
    pub(super) fn open_rays(&mut self, rect: &PixelRect) -> Open {
        if self.clearness.asked.is_multiple_of(LASTING) {
            self.look_through();
        }
        self.clearness.asked = self.clearness.asked.wrapping_add(1);
        let mut open = Open::default();
        let first = ((rect.lo[1] - self.rect.lo[1]) / BLOCK) as usize;
        for (strip, clearness) in self.strips(rect).zip(self.clearness.strips.iter().skip(first)) {
            let count = self.count_alive(self.squares_of(&strip));
            if count > 0 {
                open.count += count;
                open.transmittance = open.transmittance.max(*clearness);
            }
        }
        open
    }

    fn look_through(&mut self) {
        let mut strips = std::mem::take(&mut self.clearness.strips);
        strips.clear();
        strips.extend(self.strips(&self.rect).map(|strip| {
            let states = &self.states[self.squares_of(&strip)];
            states.iter().fold(0.0, |most: f64, state| most.max(state.transmittance))
        }));
        self.clearness.strips = strips;
    }

    fn count_alive(&self, range: Range<usize>) -> usize {
        let words = range.start / 64..range.end.div_ceil(64);
        let bits = |word: usize| {
            let first = range.start.saturating_sub(64 * word).min(64);
            let end = (range.end - 64 * word).min(64);
            let below = |n: usize| if n == 64 { u64::MAX } else { (1 << n) - 1 };
            self.alive[word] & below(end) & !below(first)
        };
        words.map(|word| bits(word).count_ones() as usize).sum()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::render::camera::pixel_order::PixelOrder;
    use crate::render::camera::rays::Square;

    proptest! {
        #[test]
        fn what_is_open_is_counted_and_bounded(
            [width, height] in [1_u32..=64, 1_u32..=64],
            steps in prop::collection::vec(
                ([0_u32..64, 0_u32..64], [1_u32..=64, 1_u32..=64], 0_usize..4096, any::<bool>()),
                1..40,
            ),
        ) {
            let mut batch = RayBatch::new(0);
            let rect = PixelRect { lo: [128, 64], hi: [128 + width, 64 + height] };
            batch.rect = rect;
            let count = rect.count();
            batch.states.resize_with(count, Default::default);
            batch.alive.resize(count.div_ceil(64), u64::MAX);
            if !count.is_multiple_of(64) {
                *batch.alive.last_mut().unwrap() = (1 << (count % 64)) - 1;
            }
            batch.served.resize(batch.alive.len(), 0);
            batch.starts = (0..=count).map(|n| u16::try_from(n).unwrap()).collect();
            let order = PixelOrder::of(&rect);
            batch.squares.extend((0..count).map(|number| {
                let [x, y] = order.place(number).map(|n| f64::from(n) + 0.5);
                Square { centre: [x + 128.0, y + 64.0], offset: [0; 2], pixel: 0, halvings: 0 }
            }));
            for (lo, size, ray, ends) in steps {
                let lo: [u32; 2] = std::array::from_fn(|a| rect.lo[a] + lo[a] % [width, height][a]);
                let hi = std::array::from_fn(|a| (lo[a] + size[a]).min(rect.hi[a]));
                let part = PixelRect { lo, hi };
                let found = batch.open_rays(&part);
                let rays: Vec<_> = batch.open(part).collect();
                prop_assert!(found.count >= rays.len());
                let near = batch.strips(&part).flatten();
                let near = near.filter(|ray| batch.alive[ray / 64] >> (ray % 64) & 1 == 1);
                prop_assert_eq!(found.count, near.count());
                for ray in rays {
                    prop_assert!(batch.states[ray].transmittance <= found.transmittance);
                }
                let ray = ray % count;
                batch.states[ray].transmittance *= 0.5;
                if ends {
                    batch.alive[ray / 64] &= !(1 << (ray % 64));
                }
            }
        }
    }
}
