//! Rays in cells of constant value: the closed form of each, in f32.
//!
//! What that is off by, beside rounding of sums: rays cross planes a little earlier or later than in
//! f32. Let a ray go from cell A to cell B, and be certain to be in A before and in B after. Moving
//! the crossing by s changes what it gathers by s·T·[(j_A − κ_A·L) − (j_B − κ_B·L)], where T is the
//! transmittance up to the crossing and L the light from behind it. T is that behind A, but for
//! e^(κ_A·s). And from dL/ds = κ·L − j, j_B − κ_B·L is what it is at B's far end, times the
//! transmittance of B. So a crossing costs each of both cells no more than its own emission and
//! absorption over s, times the transmittance *behind* it: little where a cell is opaque. Where
//! crossings are so close to each other that their order is not certain, the ray may be in other
//! cells beside: there all that the group may emit and absorb counts, over all of the way in doubt,
//! with the transmittance in front.
#![allow(clippy::needless_range_loop)]

use super::beside::Beside;
use super::long::{Long, left_of_one, long_product, product, select, sum, times};
use super::rows::is_less;
use super::shade::DARK;
use super::sums::Sums;
use super::walk::{Exit, Walk};
use super::{Packet, PacketBrick, add_off, go_on, rates_at};
use crate::lanes::Lanes;

/// Optical depths up to this are summed as series, to 2e-9.
const THIN: f32 = 0.25;
/// Depths count as no more: what they emit relative to the table is [`LOST`], and f32 holds their
/// sum over any brick.
const DEEP: f32 = 1e36;
/// Emission and extinction lost below the smallest f32, over all of a brick.
const LOST: [f32; 2] = [1e-35, 1e-43];
/// In a crossing's own formula it may be off by this share of the way through either cell.
const CLOSEST: f32 = 0.05;
/// How far places of crossings may be off, cells. Of f64's rounding, 1e-12; of origins and inverse
/// directions as sums of two f32, 2⁻⁴³ and 2⁻⁴² in up to 34 cells; of sums of their second numbers
/// twice 2⁻⁴².
const CROSSING_ROUNDING: f32 = 4e-12;
/// What a cell's emission and extinction may be off by, relative, by rounding of what is worked out
/// in it, as sums of two f32: 2⁻²⁴ of emission by its own, twice that of extinction, and by the
/// packet's thickness; and [`Attenuation`], of a mean transmittance 1.5e-8 where it is thin, else
/// 1.1e-7, and of what is left as much as 2e-8 and 1.2e-7 of the depth make.
const THIN_ROUNDING: [f32; 2] = [8e-8, 1.45e-7];
const THICK_ROUNDING: [f32; 2] = [1.75e-7, 2.45e-7];

/// The march of a packet through constant cells until each active ray has left the brick or faded.
#[inline(always)]
pub(super) fn march<L: Lanes, const ABSORBS: bool>(
    l: L,
    brick: &PacketBrick<'_>,
    packet: &mut Packet,
) {
    let mut walk = Walk::new(l, brick, packet);
    let mut sums = Sums::load(l, packet);
    let mut doubts = Doubts::new(l, &walk);
    let (fade, zero) = (l.load(&packet.fade), l.splat(0.0));
    let side = l.splat(brick.side as f32);
    let mut active = l.mask(packet.active);
    for n in 0..3 {
        let lost = l.splat(LOST[usize::from(n > 0)]);
        sums.off[n] = l.add(sums.off[n], l.select(active, lost, zero));
    }
    let mut gathered = Gathered::new(l, l.load(&packet.thickness));
    let (has_squares, mut beside) = (!brick.reliefs.is_empty(), Beside::load(l, packet));
    let mut count = 0;
    while l.bits(active) != 0 {
        count += u64::from(l.bits(active).count_ones());
        let cell = walk.index(side);
        let shade = l.gather_row(brick.shades, cell);
        let planes = walk.inner_planes();
        let exit = walk.exit(planes);
        let way = l.select(active, exit.way, zero);
        let before = gathered.transmittance();
        let passed = gathered.pass::<ABSORBS>(
            &shade,
            select(l, active, walk.way_to(&exit), [zero; 2]),
            active,
        );
        let own = [l.max(l.max(shade[0], shade[1]), shade[2]), shade[3]];
        let rounded = [l.mul(passed.rounding[0], own[0]), l.mul(passed.rounding[1], own[1])];
        sums.off = add_off::<L, ABSORBS>(l, sums.off, rounded, passed.lit, way);
        let doubt = doubts.pass(l, &walk, planes, &exit);
        let seen = [passed.behind, before];
        let (rates, lit) = doubt.rates(l, brick, &walk, own, seen, active);
        let length = l.select(active, doubt.length, zero);
        sums.off = add_off::<L, ABSORBS>(l, sums.off, rates, l.mul(lit, length), length);
        if has_squares {
            walk.locate();
            let (rates, [lit, mean]) =
                beside.pass::<ABSORBS>(l, brick, &walk, [way, before], active);
            sums.stored = add_off::<L, ABSORBS>(l, sums.stored, rates, lit, mean);
        }
        if !brick.levels.is_empty() {
            let mut rates = rates_at(l, brick.levels, walk.group(brick.groups), active);
            if has_squares {
                rates = beside.squares.levels(l, brick, rates, active);
            }
            sums.levels = add_off::<L, ABSORBS>(l, sums.levels, rates, passed.lit, way);
        }
        let rates = rates_at(l, brick.storages, cell, active);
        sums.stored = add_off::<L, ABSORBS>(l, sums.stored, rates, passed.lit, way);
        active = go_on::<L, ABSORBS>(l, &mut walk, &exit, active, gathered.depth[0], fade);
    }
    gathered.store(packet, &mut sums);
    beside.store(l, packet);
    walk.store(packet);
    packet.active = 0;
    packet.count += count;
}

/// Optical depth of a way where there is so much for each unit of it.
#[inline(always)]
fn depth_of<L: Lanes>(l: L, way: Long<L>, rate: Long<L>) -> Long<L> {
    let (deep, [depth, rest]) = (l.splat(DEEP), long_product(l, way, rate));
    let is_deep = l.is_at_most(deep, depth);
    [l.min(depth, deep), l.select(is_deep, l.splat(0.0), rest)]
}

/// A sum and what is added to it.
#[inline(always)]
fn and<L: Lanes>(l: L, all: Long<L>, more: Long<L>) -> Long<L> {
    let [near, rest] = sum(l, all[0], more[0]);
    [near, l.add(all[1], l.add(rest, more[1]))]
}

/// What rays have gathered, and passed.
struct Gathered<L: Lanes> {
    l: L,
    thickness: L::Float,
    light: [Long<L>; 3],
    depth: Long<L>,
    /// The transmittance of all that was passed.
    seen: Long<L>,
}

/// What a cell's emission and extinction count for.
struct Passed<L: Lanes> {
    /// ∫ T ds over the way through it.
    lit: L::Float,
    /// The transmittance behind the cell, at most, without the ways in doubt at its ends.
    behind: L::Float,
    /// What both may be off by, relative.
    rounding: [L::Float; 2],
}

impl<L: Lanes> Gathered<L> {
    /// Rays begin with nothing gathered: there is nothing that they stop for on the way.
    #[inline(always)]
    fn new(l: L, thickness: L::Float) -> Self {
        let (zero, one) = (l.splat(0.0), l.splat(1.0));
        let nothing = [zero; 2];
        Self { l, thickness, light: [nothing; 3], depth: nothing, seen: [one, zero] }
    }

    #[inline(always)]
    fn transmittance(&self) -> L::Float {
        self.l.add(self.seen[0], self.seen[1])
    }

    /// Passes `way` through a cell of emission and extinction `shade`.
    #[inline(always)]
    fn pass<const ABSORBS: bool>(
        &mut self,
        shade: &[L::Float; 4],
        way: Long<L>,
        active: L::Mask,
    ) -> Passed<L> {
        let (l, nothing) = (self.l, [self.l.splat(0.0); 2]);
        let (mut depth, mut lit) = (nothing, long_product(l, self.seen, way));
        let mut rounding = THIN_ROUNDING.map(|rounding| l.splat(rounding));
        if ABSORBS {
            depth = depth_of(l, way, product(l, self.thickness, shade[3]));
            let passed = Attenuation::over(l, depth);
            lit = long_product(l, lit, passed.mean);
            self.seen = long_product(l, self.seen, passed.left);
            for n in 0..2 {
                let thick = l.splat(THICK_ROUNDING[n]);
                rounding[n] = l.select(passed.is_thin, rounding[n], thick);
            }
            self.depth = and(l, self.depth, select(l, active, depth, nothing));
        }
        for c in 0..3 {
            let light = select(l, active, times(l, lit, shade[c]), nothing);
            self.light[c] = and(l, self.light[c], light);
        }
        // The ways in doubt are a twentieth of the cell at most: e^(depth/20) is less than 1 + depth as
        // far as anything is seen.
        let doubt = l.add(l.splat(1.0), l.min(depth[0], l.splat(DARK)));
        Passed { lit: lit[0], behind: l.mul(self.seen[0], doubt), rounding }
    }

    #[inline(always)]
    fn store(&self, packet: &mut Packet, sums: &mut Sums<L>) {
        for c in 0..3 {
            sums.light[c] = self.light[c][0];
            self.l.store(self.light[c][1], &mut packet.left[c]);
        }
        sums.depth = self.depth;
        sums.store(self.l, packet);
    }
}

/// What a depth does to light.
struct Attenuation<L: Lanes> {
    /// The mean transmittance over it, and what is left behind it.
    mean: Long<L>,
    left: Long<L>,
    is_thin: L::Mask,
}

impl<L: Lanes> Attenuation<L> {
    #[inline(always)]
    fn over(l: L, depth: Long<L>) -> Self {
        // (1 − e^−d)/d − 1 over d.
        const TERMS: [f32; 6] =
            [1.0 / 5040.0, -1.0 / 720.0, 1.0 / 120.0, -1.0 / 24.0, 1.0 / 6.0, -0.5];
        let mut bent = l.splat(TERMS[0]);
        for n in 1..TERMS.len() {
            bent = l.fma(bent, depth[0], l.splat(TERMS[n]));
        }
        let less = l.sub(l.splat(0.0), l.mul(bent, depth[0]));
        let mean = left_of_one(l, [less, l.mul(depth[1], l.splat(0.5))]);
        let left = left_of_one(l, long_product(l, depth, mean));
        let is_thin = l.is_at_most(depth[0], l.splat(THIN));
        if l.bits(l.without(l.mask(!0), is_thin)) == 0 {
            return Self { mean, left, is_thin };
        }
        let thick = remaining(l, depth);
        let lost = left_of_one(l, thick);
        let inverse = l.div(l.splat(1.0), l.max(depth[0], l.splat(THIN)));
        // One step of Newton's method from the rounded quotient.
        let quotient = l.mul(lost[0], inverse);
        let more = l.sub(lost[1], l.mul(quotient, depth[1]));
        let more = l.add(l.fused(l.sub(l.splat(0.0), quotient), depth[0], lost[0]), more);
        let of_thick = [quotient, l.mul(more, inverse)];
        let mean = select(l, is_thin, mean, of_thick);
        Self { mean, left: select(l, is_thin, left, thick), is_thin }
    }
}

/// e^−depth for depths from [`THIN`] on, to 3e-8; at most e^−[`DARK`] is nothing.
#[inline(always)]
fn remaining<L: Lanes>(l: L, depth: Long<L>) -> Long<L> {
    // ln 2 as the sum of two, the first of which makes exact products with numbers up to 2⁹.
    const LN_2: [f32; 2] = [22_713.0 / 32_768.0, 1.428_606_8e-6];
    // (e^−r − 1 + r)/r².
    const TERMS: [f32; 6] = [-1.0 / 5040.0, 1.0 / 720.0, -1.0 / 120.0, 1.0 / 24.0, -1.0 / 6.0, 0.5];
    let (zero, dark) = (l.splat(0.0), l.splat(DARK));
    let is_dark = l.is_at_most(dark, depth[0]);
    let depth = select(l, is_dark, [dark, zero], depth);
    let whole = l.fma(depth[0], l.splat(std::f32::consts::LOG2_E), l.splat(0.5));
    let whole = l.sub(zero, l.floor(whole));
    let rest = l.fused(whole, l.splat(LN_2[0]), depth[0]);
    let little = l.fma(whole, l.splat(LN_2[1]), depth[1]);
    let mut bent = l.splat(TERMS[0]);
    for n in 1..TERMS.len() {
        bent = l.fma(bent, rest, l.splat(TERMS[n]));
    }
    let near = l.sub(l.splat(1.0), rest);
    let left = l.sub(l.sub(l.splat(1.0), near), rest);
    // e^−(r + s) is e^−r − s·e^−r.
    let curved = l.mul(l.mul(rest, rest), bent);
    let moved = l.mul(little, l.add(near, curved));
    let power = sum(l, near, l.add(curved, l.sub(left, moved)));
    let scale = l.power_of_two(whole);
    [l.mul(power[0], scale), l.mul(power[1], scale)]
}

/// Where rays may be in other cells than in f32.
struct Doubts<L: Lanes> {
    /// By how much crossings of planes along each axis may be off, in t.
    off: [L::Float; 3],
    /// By how much the end of the way may be off, in t.
    off_end: L::Float,
    /// How far from t on the ray has certainly crossed all planes that it has crossed in f32.
    since: L::Float,
    /// Whether it was certainly in the cell before and went nowhere else on the way to this one.
    is_clear: L::Mask,
}

/// The doubt about a cell.
struct CellDoubt<L: Lanes> {
    /// How much of the way may belong to other cells.
    length: L::Float,
    /// Whether these are only the one before and the next.
    is_simple: L::Mask,
}

impl<L: Lanes> CellDoubt<L> {
    /// What may be emitted and absorbed over the length in doubt, and how much of that is seen: of the
    /// cell's `own`, what is seen behind it; of all in the group, what is seen before.
    #[inline(always)]
    fn rates(
        &self,
        l: L,
        brick: &PacketBrick<'_>,
        walk: &Walk<L>,
        own: [L::Float; 2],
        [behind, before]: [L::Float; 2],
        active: L::Mask,
    ) -> ([L::Float; 2], L::Float) {
        if l.bits(l.without(active, self.is_simple)) == 0 {
            return (own, behind);
        }
        let mut rates = rates_at(l, brick.rates, walk.group(brick.groups), active);
        for n in 0..2 {
            rates[n] = l.select(self.is_simple, own[n], rates[n]);
        }
        (rates, l.select(self.is_simple, behind, before))
    }
}

impl<L: Lanes> Doubts<L> {
    #[inline(always)]
    fn new(l: L, walk: &Walk<L>) -> Self {
        let off_end = l.splat(CROSSING_ROUNDING);
        let mut off = walk.stretching();
        for a in 0..3 {
            off[a] = l.mul(off[a], off_end);
        }
        Self { off, off_end, since: l.splat(0.0), is_clear: l.mask(!0) }
    }

    /// What is in doubt of the way to `exit` through a cell with these planes ahead, of which the
    /// ray crosses the one along one of the axes, or none where the brick ends.
    #[inline(always)]
    fn pass(&mut self, l: L, walk: &Walk<L>, planes: [Long<L>; 3], exit: &Exit<L>) -> CellDoubt<L> {
        let (way, zero, since) = (exit.way, l.splat(0.0), self.since);
        // All from the exit on: when the ray may leave at the earliest; when it has crossed the plane
        // that it crosses in f32 at the latest; and when it may cross another plane than that of the
        // earliest.
        let mut early = l.sub(walk.beyond(exit, walk.end), self.off_end);
        let mut late = self.off_end;
        let mut second = l.splat(f32::MAX);
        for a in 0..3 {
            let at_least = l.sub(walk.beyond(exit, planes[a]), self.off[a]);
            second = l.min(second, l.max(early, at_least));
            early = l.min(early, at_least);
            let crosses = l.without(exit.axes[a], exit.at_end);
            late = l.select(crosses, self.off[a], late);
        }
        let is_certain = is_less(l, since, l.add(way, early));
        let leaves = l.and(is_certain, is_less(l, late, second));
        let in_front = l.max(since, zero);
        let simple = l.add(in_front, late);
        let is_short = l.is_at_most(simple, l.mul(way, l.splat(CLOSEST)));
        let is_simple = l.and(l.and(leaves, self.is_clear), is_short);
        let other = l.min(l.add(in_front, l.max(l.sub(zero, early), zero)), way);
        let other = l.fma(self.off_end, l.splat(2.0), other);
        self.since = l.max(l.sub(since, way), late);
        self.is_clear = leaves;
        CellDoubt { length: l.select(is_simple, simple, other), is_simple }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::lanes::{Kernel, Row, Width};

    struct Pass(f64);

    impl Kernel for Pass {
        /// The mean transmittance, and what is left.
        type Output = [f64; 2];

        #[inline(always)]
        fn run<L: Lanes>(self, l: L) -> [f64; 2] {
            let near = self.0 as f32;
            let rest = (self.0 - f64::from(near)) as f32;
            let passed = Attenuation::over(l, [l.splat(near), l.splat(rest)]);
            [passed.mean, passed.left].map(|parts| {
                let [near, rest] = parts.map(|part| {
                    let mut row = Row::ZERO;
                    l.store(part, &mut row);
                    f64::from(row.0[0])
                });
                near + rest
            })
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 4000, ..ProptestConfig::default() })]

        /// As [`THIN_ROUNDING`] and [`THICK_ROUNDING`] take them to be.
        #[test]
        fn attenuation_is_more_exact_than_f32(
            depth in prop_oneof![
                4 => 1e-3..2.0_f64,
                2 => 2.0..70.0_f64,
                1 => (-30.0..-3.0_f64).prop_map(|d| 10_f64.powf(d)),
            ],
        ) {
            let (mean, left) = (-(-depth).exp_m1() / depth, (-depth).exp());
            let is_thin = depth <= f64::from(THIN);
            // The truth is rounded too.
            let of_thin = (1.5e-8, 2e-8 * depth + 1e-15);
            let (of_mean, of_left) = if is_thin { of_thin } else { (1.1e-7, 3e-8) };
            for width in Width::all() {
                let found = width.run(Pass(depth));
                prop_assert!((found[0] / mean - 1.0).abs() <= of_mean, "{:?} {}", found, mean);
                prop_assert!((found[1] / left - 1.0).abs() <= of_left, "{:?} {}", found, left);
            }
        }
    }
}
