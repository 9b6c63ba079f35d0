//! What a packet gathers.
#![allow(clippy::needless_range_loop)]

use super::bends::PartValues;
use super::gain::{Gain, StorageSlopes, Stretch};
use super::long::{Long, sum};
use super::rows::{load, store};
use super::{Packet, PacketBrick};
use crate::lanes::Lanes;

/// Stretches that are off by too much are passed in so many times as many parts.
const FINER: u32 = 4;

/// What rays have gathered, and what of it may be wrong.
#[derive(Clone, Copy)]
pub(super) struct Sums<L: Lanes> {
    /// [`Packet::light`].
    pub(super) light: [L::Float; 3],
    /// [`Packet::depth`], and what is left of it by rounding to f32.
    pub(super) depth: Long<L>,
    /// [`Packet::off`].
    pub(super) off: [L::Float; 3],
    /// [`Packet::levels`].
    pub(super) levels: [L::Float; 3],
    /// [`Packet::stored`].
    pub(super) stored: [L::Float; 3],
}

/// A stretch that was passed.
pub(super) struct Passed<L: Lanes> {
    /// In how many parts, of all active rays.
    pub(super) count: u64,
    /// What x is along it.
    pub(super) seen: PartValues<L>,
    /// How it answers to values that are not stored exactly.
    pub(super) steep: StorageSlopes<L>,
}

impl<L: Lanes> Sums<L> {
    /// The sums that the packet holds.
    #[inline(always)]
    pub(super) fn load(l: L, packet: &Packet) -> Self {
        Self {
            light: load(l, &packet.light),
            depth: [l.load(&packet.depth), l.load(&packet.left[3])],
            off: load(l, &packet.off),
            levels: load(l, &packet.levels),
            stored: load(l, &packet.stored),
        }
    }

    /// Writes them back to the packet.
    #[inline(always)]
    pub(super) fn store(&self, l: L, packet: &mut Packet) {
        store(l, &self.light, &mut packet.light);
        store(l, &self.off, &mut packet.off);
        store(l, &self.levels, &mut packet.levels);
        store(l, &self.stored, &mut packet.stored);
        l.store(self.depth[0], &mut packet.depth);
        l.store(self.depth[1], &mut packet.left[3]);
    }

    /// Passes a stretch, in as many equal parts as it takes to be off by what is `allowed`.
    #[inline(always)]
    pub(super) fn pass<const ABSORBS: bool>(
        &mut self,
        l: L,
        brick: &PacketBrick<'_>,
        allowed: L::Float,
        active: L::Mask,
        stretch: &Stretch<'_, L>,
    ) -> Passed<L> {
        let mut parts = 1;
        let mut count = u64::from(l.bits(active).count_ones());
        let (mut gain, seen) = Gain::at_once::<ABSORBS>(l, brick, self.depth[0], stretch);
        let mut open = l.and(active, gain.open::<ABSORBS>(l, brick, allowed));
        while l.bits(open) != 0 && parts < brick.parts {
            parts *= FINER;
            let lanes = l.bits(open);
            let before = self.depth[0];
            let finer = Gain::in_parts::<ABSORBS>(l, brick, before, lanes, stretch, parts);
            gain = finer.or(l, open, &gain);
            count += u64::from(parts) * u64::from(l.bits(open).count_ones());
            open = l.and(open, gain.open::<ABSORBS>(l, brick, allowed));
        }
        self.add::<ABSORBS>(l, &gain);
        Passed { count, seen, steep: gain.steep }
    }

    #[inline(always)]
    fn add<const ABSORBS: bool>(&mut self, l: L, gain: &Gain<L>) {
        for n in 0..3 {
            self.light[n] = l.add(self.light[n], gain.light[n]);
            if ABSORBS || n == 0 {
                self.off[n] = l.add(self.off[n], gain.off[n]);
            }
        }
        if ABSORBS {
            let [near, rest] = sum(l, self.depth[0], gain.depth);
            self.depth = [near, l.add(self.depth[1], rest)];
        }
    }
}
