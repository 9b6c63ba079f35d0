//! Rays that stand for squares, in cells of constant value: what others of a square see that are in
//! other cells, as [`crate::render::march::brick_account`] has it for single rays.
#![allow(clippy::needless_range_loop)]

use super::rows::{load, store};
use super::square::{Squares, share_near};
use super::walk::Walk;
use super::{Packet, PacketBrick, add_off, unpacked};
use crate::lanes::Lanes;
use crate::render::bounds::grade::RELIEF_STORED;

/// The squares of a packet's rays, and what their rays see differently.
pub(super) struct Beside<L: Lanes> {
    pub(super) squares: Squares<L>,
    /// [`Packet::aside`].
    aside: [[L::Float; 3]; 2],
    /// [`Packet::farthest`].
    farthest: [L::Float; 3],
    /// [`Packet::uneven`].
    uneven: [L::Float; 3],
}

impl<L: Lanes> Beside<L> {
    /// The squares of the packet's rays, and what is known of them so far.
    #[inline(always)]
    pub(super) fn load(l: L, packet: &Packet) -> Self {
        Self {
            squares: Squares::load(l, packet),
            aside: [load(l, &packet.aside[0]), load(l, &packet.aside[1])],
            farthest: load(l, &packet.farthest),
            uneven: load(l, &packet.uneven),
        }
    }

    /// Adds what others see while active rays pass `way` in the cells that they have come to, `before`
    /// which so much transmittance is left. Returns what stored values make of emission and extinction of
    /// those, and over what way, of which how much is seen first.
    #[inline(always)]
    pub(super) fn pass<const ABSORBS: bool>(
        &mut self,
        l: L,
        brick: &PacketBrick<'_>,
        walk: &Walk<L>,
        [way, before]: [L::Float; 2],
        active: L::Mask,
    ) -> ([L::Float; 2], [L::Float; 2]) {
        let (zero, one, half) = (l.splat(0.0), l.splat(1.0), l.splat(0.5));
        let touching = l.mul(self.touching(l, walk, way), way);
        // The far side of a face takes at most half of the square, all of them together all of it: half
        // of the farthest counts for the mean.
        let mean = l.select(active, l.min(l.mul(touching, half), way), zero);
        let reached = l.add(mean, mean);
        let row = self.squares.relief(l, brick, walk.group(brick.groups));
        let others = [row[0], row[1]];
        let seen = l.min(before, one);
        let [at_most, on_average] = [l.mul(seen, reached), l.mul(seen, mean)];
        self.farthest = add_off::<L, ABSORBS>(l, self.farthest, others, at_most, reached);
        self.uneven = add_off::<L, ABSORBS>(l, self.uneven, others, on_average, mean);
        (unpacked(l, l.bits_of(row[RELIEF_STORED]), active), [on_average, mean])
    }

    /// The shares of the way within reach of each of the cell's six faces, summed.
    #[inline(always)]
    fn touching(&self, l: L, walk: &Walk<L>, way: L::Float) -> L::Float {
        let (one, direction) = (l.splat(1.0), walk.direction());
        let mut sum = l.splat(0.0);
        for a in 0..3 {
            let [off, turn] = [self.aside[0][a], self.aside[1][a]];
            let from = l.fma(turn, walk.reached(), l.add(walk.place[a], off));
            let to = l.fma(l.add(direction[a], turn), way, from);
            let above = [l.sub(from, one), l.sub(to, one)];
            let reach = self.squares.spread[a];
            let both = l.add(share_near(l, [from, to], reach), share_near(l, above, reach));
            sum = l.add(sum, both);
        }
        sum
    }

    /// Writes what they see differently back to the packet.
    #[inline(always)]
    pub(super) fn store(&self, l: L, packet: &mut Packet) {
        store(l, &self.farthest, &mut packet.farthest);
        store(l, &self.uneven, &mut packet.uneven);
    }
}
