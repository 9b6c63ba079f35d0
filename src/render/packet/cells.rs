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

use super::rows::is_less;
use super::shade::{DARK, through};
use super::sums::Sums;
use super::walk::{Exit, Long, Walk};
use super::{Ground, Packet, add_off, go_on, rates_at};
use crate::render::lanes::Lanes;

/// Optical depths up to this are summed as series, to 5e-8.
const THIN: f32 = 0.25;
/// Emission and extinction lost below the smallest f32, over all of a brick.
const LOST: [f32; 2] = [1e-35, 1e-43];
/// In a crossing's own formula it may be off by this share of the way through either cell.
const CLOSEST: f32 = 0.05;
/// How far places of crossings may be off, cells. Of f64's rounding, 1e-12; of origins and inverse
/// directions as sums of two f32, 2⁻⁴³ and 2⁻⁴² in up to 34 cells; of sums of their second numbers
/// twice 2⁻⁴².
const CROSSING_ROUNDING: f32 = 4e-12;
/// What a cell's emission and extinction may be off by, relative, by rounding of all that is
/// worked out in it: up to 11 times 2⁻²⁴ where it is thin. Where it is not, transmittance is off by
/// 3e-7 more ([`through`]), which is at most 1.2e-6 of a depth from [`THIN`] on.
const THIN_ROUNDING: f32 = 7e-7;
const THICK_ROUNDING: f32 = 1.9e-6;

/// As [`super::March`] has it.
#[inline(always)]
pub(super) fn march<L: Lanes, const ABSORBS: bool>(l: L, ground: &Ground<'_>, packet: &mut Packet) {
    let mut walk = Walk::new(l, ground, packet);
    let mut sums = Sums::load(l, packet);
    let mut doubts = Doubts::new(l, &walk);
    let (thickness, fade) = (l.load(&packet.thickness), l.load(&packet.fade));
    let (zero, one) = (l.splat(0.0), l.splat(1.0));
    let side = l.splat(ground.side as f32);
    let mut active = l.mask(packet.active);
    for n in 0..3 {
        let lost = l.splat(LOST[usize::from(n > 0)]);
        sums.off[n] = l.add(sums.off[n], l.select(active, lost, zero));
    }
    // Rays begin with nothing gathered: there is nothing that they stop for on the way.
    let (mut seen, mut gathered) = ([one, zero], Gathered::new(l));
    let mut count = 0;
    while l.bits(active) != 0 {
        count += u64::from(l.bits(active).count_ones());
        let cell = walk.index(side);
        let shade = l.gather_row(ground.shades, cell);
        let planes = walk.inner_planes();
        let exit = walk.exit(planes);
        let way = l.select(active, exit.way, zero);
        let before = l.add(seen[0], seen[1]);
        let (mut depth, mut lit) = (zero, l.mul(before, way));
        let mut rounding = l.splat(THIN_ROUNDING);
        if ABSORBS {
            depth = l.mul(l.mul(way, thickness), shade[3]);
            let passed = Attenuation::over(l, depth);
            lit = l.mul(lit, passed.mean);
            seen = dimmed(l, seen, passed.left);
            rounding = l.select(passed.is_thin, rounding, l.splat(THICK_ROUNDING));
            sums.depth = gathered.depth.add(l, active, sums.depth, depth);
        }
        for c in 0..3 {
            sums.light[c] = gathered.light[c].add(l, active, sums.light[c], l.mul(lit, shade[c]));
        }
        let own = [l.max(l.max(shade[0], shade[1]), shade[2]), shade[3]];
        let rounded = [l.mul(rounding, lit), l.mul(rounding, way)];
        sums.off = add_off::<L, ABSORBS>(l, sums.off, own, rounded[0], rounded[1]);
        let Doubt { length, is_simple } = doubts.pass(l, &walk, planes, &exit);
        let mut rates = own;
        // Behind the cell without the ways in doubt at its ends, a twentieth of it at most:
        // e^(depth/20) is less than 1 + depth as far as anything is seen.
        let behind = l.mul(seen[0], l.add(one, l.min(depth, l.splat(DARK))));
        let mut shadow = behind;
        if l.bits(l.without(active, is_simple)) != 0 {
            let most = rates_at(l, ground.rates, walk.group(ground.groups), active);
            for n in 0..2 {
                rates[n] = l.select(is_simple, own[n], most[n]);
            }
            shadow = l.select(is_simple, behind, before);
        }
        let length = l.select(active, length, zero);
        sums.off = add_off::<L, ABSORBS>(l, sums.off, rates, l.mul(shadow, length), length);
        if !ground.levels.is_empty() {
            let rates = rates_at(l, ground.levels, walk.group(ground.groups), active);
            sums.levels = add_off::<L, ABSORBS>(l, sums.levels, rates, lit, way);
        }
        let rates = rates_at(l, ground.storages, cell, active);
        sums.stored = add_off::<L, ABSORBS>(l, sums.stored, rates, lit, way);
        active = go_on::<L, ABSORBS>(l, &mut walk, &exit, active, (sums.depth, fade));
    }
    sums.store(l, packet);
    walk.store(packet);
    packet.active = 0;
    packet.count += count;
}

/// What rounding took from sums of active lanes so far: it goes in with the next number (Kahan,
/// *CACM* 8, 1965).
#[derive(Clone, Copy)]
struct Left<L: Lanes>(L::Float);

impl<L: Lanes> Left<L> {
    #[inline(always)]
    fn add(&mut self, l: L, active: L::Mask, sum: L::Float, more: L::Float) -> L::Float {
        let more = l.select(active, l.add(more, self.0), l.splat(0.0));
        let all = l.add(sum, more);
        self.0 = l.sub(more, l.sub(all, sum));
        all
    }
}

struct Gathered<L: Lanes> {
    light: [Left<L>; 3],
    depth: Left<L>,
}

impl<L: Lanes> Gathered<L> {
    #[inline(always)]
    fn new(l: L) -> Self {
        let nothing = Left(l.splat(0.0));
        Self { light: [nothing; 3], depth: nothing }
    }
}

/// The product of two numbers, so exact that many of them are as exact as one.
#[inline(always)]
fn dimmed<L: Lanes>(l: L, a: Long<L>, b: Long<L>) -> Long<L> {
    let product = l.mul(a[0], b[0]);
    let rest = l.fused(a[0], b[0], l.sub(l.splat(0.0), product));
    [product, l.fma(a[1], b[0], l.fma(a[0], b[1], rest))]
}

/// What a depth does to light.
struct Attenuation<L: Lanes> {
    /// The mean transmittance over it, and what is left behind it.
    mean: L::Float,
    left: Long<L>,
    is_thin: L::Mask,
}

impl<L: Lanes> Attenuation<L> {
    #[inline(always)]
    fn over(l: L, depth: L::Float) -> Self {
        const TERMS: [f32; 5] = [-1.0 / 720.0, 1.0 / 120.0, -1.0 / 24.0, 1.0 / 6.0, -0.5];
        let (zero, one) = (l.splat(0.0), l.splat(1.0));
        let mut mean = l.splat(TERMS[0]);
        for n in 1..TERMS.len() {
            mean = l.fma(mean, depth, l.splat(TERMS[n]));
        }
        mean = l.fma(mean, depth, one);
        let lost = l.mul(depth, mean);
        let left = l.sub(one, lost);
        let rest = l.sub(l.sub(one, left), lost);
        let is_thin = l.is_at_most(depth, l.splat(THIN));
        if l.bits(l.without(l.mask(!0), is_thin)) == 0 {
            return Self { mean, left: [left, rest], is_thin };
        }
        let thick = through(l, depth);
        let of_thick = l.div(l.sub(one, thick), l.max(depth, l.splat(THIN)));
        let left = [l.select(is_thin, left, thick), l.select(is_thin, rest, zero)];
        Self { mean: l.select(is_thin, mean, of_thick), left, is_thin }
    }
}

/// Where rays may be in other cells than in f32.
struct Doubts<L: Lanes> {
    /// By how much crossings may be off along t, and the end of the way.
    off: [L::Float; 3],
    off_end: L::Float,
    /// How far from t on the ray has certainly crossed all planes that it has crossed in f32.
    since: L::Float,
    /// Whether it was certainly in the cell before and went nowhere else on the way to this one.
    is_clear: L::Mask,
}

/// The doubt about a cell.
struct Doubt<L: Lanes> {
    /// How much of the way may belong to other cells.
    length: L::Float,
    /// Whether these are only the one before and the next.
    is_simple: L::Mask,
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

    /// Of the way to `exit` through a cell with these planes ahead, of which the ray crosses the one
    /// along one of the axes, or none where the brick ends.
    #[inline(always)]
    fn pass(&mut self, l: L, walk: &Walk<L>, planes: [Long<L>; 3], exit: &Exit<L>) -> Doubt<L> {
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
        Doubt { length: l.select(is_simple, simple, other), is_simple }
    }
}
