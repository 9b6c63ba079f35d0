//! What rays stand for that are the centres of squares: how far the squares' other rays are from
//! them, as [`crate::render::march::brick_account`] has it for single rays.
#![allow(clippy::needless_range_loop)]

use super::PacketBrick;
use super::bends::{kinks_between, slopes_near};
use super::gain::Stretch;
use super::rows::{distance, load, store};
use super::sums::Passed;
use super::walk::Walk;
use super::{Packet, SLACK, unpacked};
use crate::lanes::Lanes;
use crate::render::bounds::grade::{RELIEF_RANGE, RELIEF_STORED};

/// The squares of a packet's rays in a brick.
#[derive(Clone, Copy)]
pub(super) struct Squares<L: Lanes> {
    /// Largest displacement of the squares' rays, cells along each axis; 1 / 12 of its inverse.
    pub(super) spread: [L::Float; 3],
    twelfth: [L::Float; 3],
    /// What of the displacement does not cancel between opposite rays.
    bend: [L::Float; 3],
    /// Twice half the square's diagonal as an angle.
    turn: L::Float,
    /// Whose other rays may be more than a cell away.
    wide: L::Mask,
}

/// How far the values of a square's rays are from its centre's: at most; and on average but for
/// what cancels between opposite ones; of proxies, at most but for what is linear in displacements.
#[derive(Clone, Copy)]
pub(super) struct Shift<L: Lanes> {
    most: L::Float,
    uneven: L::Float,
    /// How far x ranges in the group.
    range: L::Float,
    /// What stored values make of emission and extinction of any of them, packed.
    stored: L::Index,
    /// [`Squares::wide`].
    wide: L::Mask,
}

/// Pairs of axes.
const PAIRS: [[usize; 2]; 3] = [[0, 1], [1, 2], [2, 0]];

impl<L: Lanes> Squares<L> {
    /// The squares of the packet's rays.
    #[inline(always)]
    pub(super) fn load(l: L, packet: &Packet) -> Self {
        let (spread, bend, one) = (load(l, &packet.spread), load(l, &packet.bend), l.splat(1.0));
        let mut squares =
            Self { spread, twelfth: spread, bend, turn: l.load(&packet.turn), wide: l.mask(0) };
        let mut near = l.mask(!0);
        for a in 0..3 {
            squares.twelfth[a] = l.div(l.splat(1.0 / 12.0), l.max(spread[a], l.splat(SLACK)));
            near = l.and(near, l.is_at_most(spread[a], one));
        }
        squares.wide = l.without(l.mask(!0), near);
        squares
    }

    /// What is known of a group, or of all where squares are wide.
    #[inline(always)]
    pub(super) fn relief(&self, l: L, brick: &PacketBrick<'_>, group: L::Index) -> [L::Float; 8] {
        let whole = l.splat((brick.groups * brick.groups * brick.groups) as f32);
        let group = l.index(l.select(self.wide, whole, l.float(group)));
        l.gather_row(brick.reliefs, group)
    }

    /// What levels beneath make emission and extinction be off by, where these are the `rates` of a
    /// ray's own group: others of a wide square may be in any.
    #[inline(always)]
    pub(super) fn levels(
        &self,
        l: L,
        brick: &PacketBrick<'_>,
        mut rates: [L::Float; 2],
        active: L::Mask,
    ) -> [L::Float; 2] {
        let wide = l.and(self.wide, active);
        for n in 0..2 {
            rates[n] = l.select(wide, l.splat(brick.most_levels[n]), rates[n]);
        }
        rates
    }

    /// What holds for `way` through a cell, in the group `group`.
    #[inline(always)]
    pub(super) fn shift(
        &self,
        l: L,
        brick: &PacketBrick<'_>,
        walk: &Walk<L>,
        way: L::Float,
        group: L::Index,
        blended: bool,
    ) -> Shift<L> {
        let (zero, one, half) = (l.splat(0.0), l.splat(1.0), l.splat(0.5));
        let row = self.relief(l, brick, group);
        let (slope, uneven) = ([row[0], row[1], row[2]], [row[3], row[4], row[5]]);
        let (range, stored) = (row[RELIEF_RANGE], l.bits_of(row[RELIEF_STORED]));
        let spread = self.spread;
        let over =
            l.fma(slope[0], spread[0], l.fma(slope[1], spread[1], l.mul(slope[2], spread[2])));
        if brick.are_proxies {
            let most = l.min(over, range);
            let uneven = self.bent(l, brick, walk, way, uneven, most);
            return Shift { most, uneven, range, stored, wide: self.wide };
        }
        // On average half of what slopes make of the farthest, but no more than all there is.
        let most = l.min(over, l.add(range, range));
        let mut smooth = l.mul(self.turn, most);
        for n in 0..3 {
            smooth = l.fma(slope[n], self.bend[n], smooth);
            let [a, b] = PAIRS[n];
            let twist = l.mul(l.min(uneven[a], uneven[b]), l.mul(spread[a], spread[b]));
            smooth = l.fma(twist, l.splat(2.0 / 3.0), smooth);
        }
        let [from, to] = [walk.place, walk.behind(way)];
        let mut bent = smooth;
        for a in 0..3 {
            // Both ends are within the cell, so that no distance to its faces changes sign.
            let lower = self.beyond(l, a, [from[a], to[a]]);
            let upper = self.beyond(l, a, [l.sub(one, from[a]), l.sub(one, to[a])]);
            bent = l.fma(l.mul(uneven[a], l.splat(2.0)), l.add(lower, upper), bent);
        }
        let ends = [from, to];
        let touching =
            if blended { self.touches(l, brick, ends) } else { self.leaves(l, walk, ends) };
        let half_most = l.mul(most, half);
        let parted = l.mul(half_most, l.min(touching, one));
        let uneven = l.min(half_most, l.add(parted, bent));
        let uneven = l.max(l.select(self.wide, half_most, uneven), zero);
        Shift { most, uneven, range, stored, wide: self.wide }
    }

    /// How far values at displaced places are from what is linear in their displacement, at most,
    /// where slopes differ within a group by twice `uneven`. In cells without blending slopes change
    /// along another axis by no more than that over a cell, and step at faces.
    #[inline(always)]
    fn bent(
        &self,
        l: L,
        brick: &PacketBrick<'_>,
        walk: &Walk<L>,
        way: L::Float,
        uneven: [L::Float; 3],
        most: L::Float,
    ) -> L::Float {
        let (two, zero, one) = (l.splat(2.0), l.splat(0.0), l.splat(1.0));
        let spread = self.spread;
        let mut anywhere = zero;
        for a in 0..3 {
            anywhere = l.fma(uneven[a], spread[a], anywhere);
        }
        anywhere = l.mul(l.min(anywhere, most), two);
        if !brick.kinds.is_empty() {
            return anywhere;
        }
        let mut bent = zero;
        for n in 0..3 {
            let [a, b] = PAIRS[n];
            bent = l.fma(l.min(uneven[a], uneven[b]), l.mul(spread[a], spread[b]), bent);
        }
        let ends = [walk.place, walk.behind(way)];
        for a in 0..3 {
            // Beyond the lower face or the upper one, where the ray is nearest to it.
            let nearest = l.min(ends[0][a], ends[1][a]);
            let lower = l.max(l.sub(spread[a], nearest), zero);
            let nearest = l.sub(one, l.max(ends[0][a], ends[1][a]));
            let upper = l.max(l.sub(spread[a], nearest), zero);
            bent = l.fma(uneven[a], l.add(lower, upper), bent);
        }
        l.select(self.wide, anywhere, l.min(l.mul(bent, two), anywhere))
    }

    /// How far the squares' rays are, on average over the way and the square, beyond a plane that
    /// is `distances` away at the way's ends: the mean of (D − d)⁺² / 4D; at most, where only a part
    /// of the way is within reach.
    #[inline(always)]
    fn beyond(&self, l: L, a: usize, distances: [L::Float; 2]) -> L::Float {
        let zero = l.splat(0.0);
        let p = l.max(l.sub(self.spread[a], distances[0]), zero);
        let q = l.max(l.sub(self.spread[a], distances[1]), zero);
        let squares = l.fma(p, l.add(p, q), l.mul(q, q));
        l.mul(squares, self.twelfth[a])
    }

    /// The share of the way along which rays may be beyond the faces of what is drawn of the brick.
    #[inline(always)]
    fn leaves(&self, l: L, walk: &Walk<L>, [from, to]: [[L::Float; 3]; 2]) -> L::Float {
        let mut sum = l.splat(0.0);
        for a in 0..3 {
            let inside = walk.is_inside(a);
            if l.bits(l.without(l.mask(!0), inside)) != 0 {
                let half = l.splat(0.5);
                let ends = [l.sub(from[a], half), l.sub(to[a], half)];
                let share = share_near(l, ends, self.spread[a]);
                sum = l.add(sum, l.select(inside, l.splat(0.0), share));
            }
        }
        sum
    }

    /// The share of the way along which weights bend between rays: at the cell's faces and middles,
    /// and at planes through opposite edges; all of it with more than one level of parents.
    #[inline(always)]
    fn touches(&self, l: L, brick: &PacketBrick<'_>, [from, to]: [[L::Float; 3]; 2]) -> L::Float {
        let (one, half) = (l.splat(1.0), l.splat(0.5));
        if brick.parent_count > 1 {
            return one;
        }
        let mut sum = l.splat(0.0);
        for a in 0..3 {
            let [p, q] = [from[a], to[a]];
            for n in 0..3 {
                let plane = l.mul(half, l.splat(n as f32));
                let ends = [l.sub(p, plane), l.sub(q, plane)];
                sum = l.add(sum, share_near(l, ends, self.spread[a]));
            }
        }
        for n in 0..3 {
            let [a, b] = PAIRS[n];
            let reach = l.add(self.spread[a], self.spread[b]);
            let less = [l.sub(from[a], from[b]), l.sub(to[a], to[b])];
            let more = [l.add(from[a], from[b]), l.add(to[a], to[b])];
            let more = [l.sub(more[0], one), l.sub(more[1], one)];
            sum = l.add(sum, l.add(share_near(l, less, reach), share_near(l, more, reach)));
        }
        sum
    }
}

impl<L: Lanes> Shift<L> {
    /// No difference, for rays that stand for themselves alone.
    #[inline(always)]
    pub(super) fn none(l: L) -> Self {
        let zero = l.splat(0.0);
        Self { most: zero, uneven: zero, range: zero, stored: l.bits_of(zero), wide: l.mask(0) }
    }

    /// What stored values make of emission and extinction of any of the squares' rays.
    #[inline(always)]
    pub(super) fn stored(&self, l: L, active: L::Mask) -> [L::Float; 2] {
        unpacked(l, self.stored, active)
    }

    /// Adds what rays of the squares see differently over a stretch that was passed. Returns what stored
    /// values make of emission and extinction anywhere in the squares; of squares wider than a cell, and
    /// of proxies, more than the group may.
    #[inline(always)]
    pub(super) fn add<const ABSORBS: bool>(
        &self,
        l: L,
        brick: &PacketBrick<'_>,
        packet: &mut Packet,
        Passed { seen, steep, .. }: &Passed<L>,
        Stretch { way, stored, .. }: &Stretch<'_, L>,
        active: L::Mask,
    ) -> [L::Float; 3] {
        let way = *way;
        let lit = steep.lit;
        let reach = l.add(l.min(self.most, self.range), l.splat(brick.reach));
        let half = l.add(l.min(seen.half, self.range), reach);
        let [curved, slope, fade, _] = slopes_near(l, brick, seen.middle, half);
        let [low, high] =
            kinks_between(l, brick, [l.sub(seen.middle, half), l.add(seen.middle, half)]);
        // A kink is within reach while the straight line is, give or take what x is off it.
        let long = l.mul(l.add(reach, seen.off), l.splat(2.0));
        let near = l.min(l.div(long, l.max(seen.rise, l.splat(f32::MIN_POSITIVE))), l.splat(1.0));
        let part =
            l.min(l.fma(self.most, l.splat(0.25), self.uneven), l.mul(self.most, l.splat(0.5)));
        let square = l.mul(self.most, self.most);
        // Of a part of the way up to 1.58 of its share is seen: that of a depth of 1.
        let [at_kinks, third] = if brick.are_proxies {
            let near = l.min(l.mul(near, l.splat(1.6)), l.splat(1.0));
            [l.mul(near, self.most), square]
        } else {
            [l.mul(near, part), l.mul(square, l.splat(1.0 / 3.0))]
        };
        let emission = l.fma(slope, self.uneven, l.mul(curved, third));
        let emission = l.fma(l.sub(high[0], low[0]), at_kinks, emission);
        let extinction = l.fma(l.sub(high[1], low[1]), at_kinks, l.mul(fade, self.uneven));
        // Of lanes that are not active these may be no numbers.
        let zero = l.splat(0.0);
        let mean = [l.select(active, emission, zero), l.select(active, extinction, zero)];
        add_to::<L, ABSORBS>(l, &mut packet.uneven, mean, lit, way);
        let (emission, extinction) = (l.mul(slope, self.most), l.mul(fade, self.most));
        let most = [l.select(active, emission, zero), l.select(active, extinction, zero)];
        add_to::<L, ABSORBS>(l, &mut packet.farthest, most, lit, way);
        let all = [l.splat(f32::MAX); 3];
        if brick.are_proxies {
            return all;
        }
        let off = l.fma(l.splat(brick.storage[1]), l.add(seen.middle, half), stored[3]);
        let off = l.max(l.min(stored[2], off), zero);
        let [slope, fade] = [l.mul(slope, off), l.mul(fade, off)];
        let near = [l.mul(slope, lit), l.mul(fade, lit), l.mul(fade, way)];
        std::array::from_fn(|n| l.select(self.wide, all[n], near[n]))
    }
}

/// Adds changes of emission and extinction to a packet's sums.
#[inline(always)]
fn add_to<L: Lanes, const ABSORBS: bool>(
    l: L,
    rows: &mut [crate::lanes::Row; 3],
    rates: [L::Float; 2],
    lit: L::Float,
    way: L::Float,
) {
    let sums = super::add_off::<L, ABSORBS>(l, load(l, rows), rates, lit, way);
    store(l, &sums, rows);
}

/// The share of a way along which a coordinate goes from `from` to `to` that is within `reach` of
/// 0.
#[inline(always)]
pub(super) fn share_near<L: Lanes>(l: L, [from, to]: [L::Float; 2], reach: L::Float) -> L::Float {
    let (low, high) = (l.min(from, to), l.max(from, to));
    let (zero, one) = (l.splat(0.0), l.splat(1.0));
    let within = l.sub(l.min(high, reach), l.max(low, l.sub(zero, reach)));
    let width = l.max(distance(l, from, to), l.splat(SLACK));
    // Where the way is no longer than rounding, all of it is.
    let share = l.add(l.div(within, width), l.splat(SLACK));
    let short = l.is_at_most(width, l.splat(SLACK));
    let share = l.select(short, l.select(l.is_at_most(zero, within), one, zero), share);
    l.min(l.max(share, zero), one)
}
