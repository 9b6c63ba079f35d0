//! What a packet gathers.
#![allow(clippy::needless_range_loop)]

use super::bends::{Depths, Seen, crooked};
use super::blended::{MOST_PARENTS, Part};
use super::cube::{Bend, Cube};
use super::rows::{load, store};
use super::walk::Walk;
use super::{Ground, Packet};
use crate::render::lanes::Lanes;
use crate::render::transfer_table::TransferTable;

/// Gauss–Legendre nodes on [0, 1]: ½ ∓ 1/√12.
const NODES: [f32; 2] = [0.211_324_87, 0.788_675_1];
/// √3 / 12: what extinction's slope between the nodes adds to the depth at either.
const SLOPE_DEPTH: f32 = 0.144_337_57;
/// Stretches that are off by too much are passed in so many times as many parts.
const FINER: u32 = 4;
/// Optical depth of a part, at most.
pub(in crate::render) const DEEPEST: f32 = 1.0;
/// Depths from which on no f32 shows light.
pub(super) const DARK: f32 = 80.0;

/// What rays have gathered.
#[derive(Clone, Copy)]
pub(super) struct Sums<L: Lanes> {
    pub(super) light: [L::Float; 3],
    pub(super) depth: L::Float,
    pub(super) off: [L::Float; 3],
    pub(super) levels: [L::Float; 3],
    pub(super) stored: [L::Float; 3],
}

/// What holds for rays all the way through a brick.
#[derive(Clone, Copy)]
pub(super) struct Terms<L: Lanes> {
    thickness: L::Float,
    allowed: L::Float,
}

impl<L: Lanes> Terms<L> {
    #[inline(always)]
    pub(super) fn load(l: L, packet: &Packet) -> Self {
        Self { thickness: l.load(&packet.thickness), allowed: l.load(&packet.allowed) }
    }
}

/// A stretch of a cell, along which one formula holds.
#[derive(Clone, Copy)]
pub(super) struct Stretch<'s, L: Lanes> {
    pub(super) cube: &'s Cube<L>,
    /// How the level's own interpolant bends along it.
    pub(super) bend: Bend<L>,
    /// How it is blended, beside borders of levels.
    pub(super) part: Option<&'s Part<L>>,
    /// Where it begins, from where the ray comes into the cell, and its length.
    pub(super) from: L::Float,
    pub(super) way: L::Float,
    /// What extinction is off by beside what is found out on the way.
    pub(super) rate: L::Float,
    /// As [`Ground::stored`] has it.
    pub(super) stored: [L::Float; 4],
}

/// A stretch that was passed.
pub(super) struct Passed<L: Lanes> {
    /// In how many parts, of all active rays.
    pub(super) count: u64,
    /// What x is along it.
    pub(super) seen: Seen<L>,
    pub(super) steep: Steep<L>,
}

/// How a stretch, or several, answer to values that are not stored exactly: ∫ T dt, and the same
/// of the steepest slopes of emission and of extinction times what x is off by; and ∫ dt of the
/// latter.
#[derive(Clone, Copy)]
pub(super) struct Steep<L: Lanes> {
    pub(super) lit: L::Float,
    pub(super) slopes: [L::Float; 3],
}

impl<L: Lanes> Steep<L> {
    #[inline(always)]
    pub(super) fn none(l: L) -> Self {
        Self { lit: l.splat(0.0), slopes: [l.splat(0.0); 3] }
    }

    #[inline(always)]
    pub(super) fn add<const ABSORBS: bool>(&mut self, l: L, other: &Self) {
        self.lit = l.add(self.lit, other.lit);
        for n in 0..if ABSORBS { 3 } else { 1 } {
            self.slopes[n] = l.add(self.slopes[n], other.slopes[n]);
        }
    }
}

impl<L: Lanes> Sums<L> {
    #[inline(always)]
    pub(super) fn load(l: L, packet: &Packet) -> Self {
        Self {
            light: load(l, &packet.light),
            depth: l.load(&packet.depth),
            off: load(l, &packet.off),
            levels: load(l, &packet.levels),
            stored: load(l, &packet.stored),
        }
    }

    #[inline(always)]
    pub(super) fn store(&self, l: L, packet: &mut Packet) {
        store(l, &self.light, &mut packet.light);
        store(l, &self.off, &mut packet.off);
        store(l, &self.levels, &mut packet.levels);
        store(l, &self.stored, &mut packet.stored);
        l.store(self.depth, &mut packet.depth);
    }

    /// Passes a stretch, in as many equal parts as it takes to be off by little.
    #[inline(always)]
    pub(super) fn pass<const ABSORBS: bool>(
        &mut self,
        l: L,
        ground: &Ground<'_>,
        (walk, terms, active): (&Walk<L>, &Terms<L>, L::Mask),
        stretch: Stretch<'_, L>,
    ) -> Passed<L> {
        let mut parts = 1;
        let mut count = u64::from(l.bits(active).count_ones());
        let depth = self.depth;
        let (mut gain, seen) =
            Gain::over::<ABSORBS>(l, ground, (walk, terms, depth), stretch, parts);
        let mut open = l.and(active, gain.open);
        while l.bits(open) != 0 && parts < ground.parts {
            parts *= FINER;
            let (finer, _) = Gain::over::<ABSORBS>(l, ground, (walk, terms, depth), stretch, parts);
            gain.choose(l, open, &finer);
            count += u64::from(parts) * u64::from(l.bits(open).count_ones());
            open = l.and(open, finer.open);
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
        self.depth = gain.depth;
    }
}

/// What a stretch adds to the sums.
#[derive(Clone, Copy)]
struct Gain<L: Lanes> {
    light: [L::Float; 3],
    /// Optical depth behind it.
    depth: L::Float,
    steep: Steep<L>,
    off: [L::Float; 3],
    /// Which lanes are off by too much.
    open: L::Mask,
}

impl<L: Lanes> Gain<L> {
    /// Takes another's in some lanes.
    #[inline(always)]
    fn choose(&mut self, l: L, lanes: L::Mask, other: &Self) {
        for n in 0..3 {
            self.light[n] = l.select(lanes, other.light[n], self.light[n]);
            self.off[n] = l.select(lanes, other.off[n], self.off[n]);
            self.steep.slopes[n] = l.select(lanes, other.steep.slopes[n], self.steep.slopes[n]);
        }
        self.depth = l.select(lanes, other.depth, self.depth);
        self.steep.lit = l.select(lanes, other.steep.lit, self.steep.lit);
    }

    /// Of a stretch behind an optical depth, passed in so many equal parts; and what x is along the
    /// last.
    #[inline(always)]
    fn over<const ABSORBS: bool>(
        l: L,
        ground: &Ground<'_>,
        (walk, terms, depth): (&Walk<L>, &Terms<L>, L::Float),
        Stretch { cube, bend, part, from, way, rate, stored }: Stretch<'_, L>,
        parts: u32,
    ) -> (Self, Seen<L>) {
        let share = (parts as f32).recip();
        let step = l.mul(way, l.splat(share));
        let half = l.mul(step, l.splat(0.5));
        let thickness = l.mul(step, terms.thickness);
        let (mut deepest, zero) = (l.splat(0.0), l.splat(0.0));
        let open = l.mask(0);
        let steep = Steep::none(l);
        let mut gain = Self { light: [zero; 3], depth, steep, off: [zero; 3], open };
        let mut seen = Seen { middle: zero, half: zero, off: zero, rise: zero };
        for count in 0..parts {
            let (mut shades, mut values) = ([[half; 4]; 2], [half; 2]);
            let mut blends = [[[half; 2]; MOST_PARENTS]; 2];
            for n in 0..2 {
                let node = l.fma(step, l.splat(count as f32 + NODES[n]), from);
                let place = walk.behind(node);
                let mut x = cube.at(l, place);
                if let Some(part) = part {
                    (x, blends[n]) = part.at(l, x, place);
                }
                shades[n] = shade::<L, ABSORBS>(l, ground.table, x);
                values[n] = x;
            }
            let [a, b] = shades;
            let (mut weights, mut mean) = ([half; 2], zero);
            if ABSORBS {
                mean = l.mul(thickness, l.mul(l.add(a[3], b[3]), l.splat(0.5)));
                let bend = l.mul(l.mul(thickness, l.sub(b[3], a[3])), l.splat(SLOPE_DEPTH));
                for n in 0..2 {
                    let depth = l.sub(l.fma(mean, l.splat(NODES[n]), gain.depth), bend);
                    weights[n] = l.mul(half, through(l, depth));
                }
                gain.depth = l.add(gain.depth, mean);
            }
            let mut brightest = zero;
            for c in 0..3 {
                let light = l.fma(weights[0], a[c], l.mul(weights[1], b[c]));
                gain.light[c] = l.add(gain.light[c], light);
                brightest = l.max(brightest, light);
            }
            let lit = l.add(weights[0], weights[1]);
            gain.steep.lit = l.add(gain.steep.lit, lit);
            let bend = match part {
                Some(part) => part.bend(l, bend, share, &blends),
                None => bend.along(l, share),
            };
            let depths = Depths { thickness, mean, extinction: l.max(a[3], b[3]) };
            let found = crooked::<L, ABSORBS>(l, ground, (values, bend), depths);
            seen = found.seen;
            gain.off[0] = l.fma(found.emission, lit, gain.off[0]);
            let high = l.add(found.seen.middle, found.seen.half);
            let off = l.min(stored[2], l.fma(l.splat(ground.storage[1]), high, stored[3]));
            let off = l.max(off, zero);
            let [slope, fade] = [l.mul(found.steepest[0], off), l.mul(found.steepest[1], off)];
            gain.steep.slopes[0] = l.fma(slope, lit, gain.steep.slopes[0]);
            if ABSORBS {
                gain.steep.slopes[1] = l.fma(fade, lit, gain.steep.slopes[1]);
                gain.steep.slopes[2] = l.fma(fade, step, gain.steep.slopes[2]);
                gain.off[1] = l.fma(found.extinction, lit, gain.off[1]);
                gain.off[2] = l.fma(found.extinction, step, gain.off[2]);
                // The depth in front of a node is off by up to three times as much.
                let late = l.mul(l.mul(l.add(found.most, rate), thickness), l.splat(3.3));
                gain.off[0] = l.fma(l.add(late, found.curved), brightest, gain.off[0]);
                deepest = l.max(deepest, found.depth);
            }
        }
        let mut off = gain.off[0];
        if ABSORBS {
            off = l.fma(gain.off[1], l.splat(ground.darkening), off);
        }
        let shallow = l.is_at_most(deepest, l.splat(DEEPEST));
        let fine = l.and(shallow, l.is_at_most(off, terms.allowed));
        gain.open = l.without(l.mask(!0), fine);
        (gain, seen)
    }
}

/// Emission and extinction at `x`, relative to the table's.
#[inline(always)]
fn shade<L: Lanes, const ABSORBS: bool>(l: L, table: &TransferTable, x: L::Float) -> [L::Float; 4] {
    let inside = l.min(l.max(x, l.splat(0.0)), l.splat(1.0));
    let place = l.mul(inside, l.splat(TransferTable::BINS));
    let bin = l.floor(place);
    let rest = l.sub(place, bin);
    let corner = l.gather(&table.corners, l.index(bin), 0);
    let is_after = l.is_at_most(corner, rest);
    let line = l.fma(bin, l.splat(2.0), l.select(is_after, l.splat(1.0), l.splat(0.0)));
    let row = l.gather_row(&table.lines, l.index(line));
    let mut channels = [l.splat(0.0); 4];
    for c in 0..if ABSORBS { 4 } else { 3 } {
        channels[c] = l.fma(rest, row[4 + c], row[c]);
    }
    channels
}

/// e^−depth for depths from 0 on, to 3e-7; at most e^−[`DARK`] is nothing.
#[inline(always)]
pub(super) fn through<L: Lanes>(l: L, depth: L::Float) -> L::Float {
    // 2^f over [0, 1), minimax, to 2e-7.
    const TERMS: [f32; 6] =
        [1.877_576_7e-3, 8.989_34e-3, 5.582_631_8e-2, 2.401_536_1e-1, 6.931_531e-1, 9.999_999_4e-1];
    let exponent = l.mul(l.min(depth, l.splat(DARK)), l.splat(-std::f32::consts::LOG2_E));
    let whole = l.floor(exponent);
    let rest = l.sub(exponent, whole);
    let mut power = l.splat(TERMS[0]);
    for n in 1..TERMS.len() {
        power = l.fma(power, rest, l.splat(TERMS[n]));
    }
    l.mul(power, l.power_of_two(whole))
}
