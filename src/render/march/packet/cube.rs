//! The interpolant in a dual cell, and how it may bend.
#![allow(clippy::needless_range_loop)]

use super::part_lanes::PartLanes;
use super::rows::distance;
use crate::lanes::Lanes;

/// A dual cell's corners as differences along x.
#[derive(Clone, Copy)]
pub(super) struct Cube<L: Lanes> {
    lower: [L::Float; 4],
    rise: [L::Float; 4],
}

impl<L: Lanes> Cube<L> {
    /// The cube of `values` with `side` along each axis whose lowest corner is `first`.
    #[inline(always)]
    pub(super) fn new(l: L, values: &[f32], side: usize, first: L::Index) -> Self {
        let (row, layer) = (side, side * side);
        let rows = [0, row, layer, layer + row];
        let pairs = l.gather_pairs(values, first, rows);
        let mut cube = Self { lower: [l.splat(0.0); 4], rise: [l.splat(0.0); 4] };
        for n in 0..4 {
            let [lower, upper] = pairs[n];
            (cube.lower[n], cube.rise[n]) = (lower, l.sub(upper, lower));
        }
        cube
    }

    /// How the interpolant bends along the way from `place` that goes so far. The coefficient of its
    /// third power is the mixed difference of all axes times the direction's components; half its
    /// second derivative the sum of those of two, which are linear in the third axis.
    #[inline(always)]
    pub(super) fn bend(
        &self,
        l: L,
        skew: &Skew<L>,
        [x, y, z]: [L::Float; 3],
        length: L::Float,
    ) -> Bend<L> {
        let [a, b, c, d] = self.rise;
        let [p, q, r, s] = self.lower;
        let twist = l.sub(l.sub(d, c), l.sub(b, a));
        let xy = l.fma(twist, z, l.sub(b, a));
        let xz = l.fma(twist, y, l.sub(c, a));
        let yz = l.fma(twist, x, l.sub(l.sub(s, r), l.sub(q, p)));
        let [from_xy, from_xz, from_yz] = skew.pairs;
        let first = l.fma(xy, from_xy, l.fma(xz, from_xz, l.mul(yz, from_yz)));
        let third = l.mul(l.mul(twist, skew.all), length);
        let last = l.fma(third, l.splat(3.0), first);
        let (square, zero) = (l.mul(length, length), l.splat(0.0));
        let second = l.max(distance(l, first, zero), distance(l, last, zero));
        Bend {
            second: l.mul(second, square),
            third: l.mul(distance(l, third, zero), square),
            fourth: zero,
            kink: zero,
        }
    }

    /// In each lane the cube of the ray whose part is dealt to it.
    #[inline(always)]
    pub(super) fn dealt(mut self, l: L, deal: &PartLanes<L>) -> Self {
        for n in 0..4 {
            self.lower[n] = deal.ray_of(l, self.lower[n]);
            self.rise[n] = deal.ray_of(l, self.rise[n]);
        }
        self
    }

    /// The interpolant at `u`.
    #[inline(always)]
    pub(super) fn at(&self, l: L, [u, v, w]: [L::Float; 3]) -> L::Float {
        let mut along = self.lower;
        for n in 0..4 {
            along[n] = l.fma(u, self.rise[n], self.lower[n]);
        }
        let [a, b, c, d] = along;
        let (near, far) = (l.fma(v, l.sub(b, a), a), l.fma(v, l.sub(d, c), c));
        l.fma(w, l.sub(far, near), near)
    }
}

/// Products of a direction's components: of x and y, x and z, y and z, and of all.
#[derive(Clone, Copy)]
pub(super) struct Skew<L: Lanes> {
    pairs: [L::Float; 3],
    all: L::Float,
}

impl<L: Lanes> Skew<L> {
    /// The products of a direction with these components.
    #[inline(always)]
    pub(super) fn new(l: L, [x, y, z]: [L::Float; 3]) -> Self {
        let xy = l.mul(x, y);
        Self { pairs: [xy, l.mul(x, z), l.mul(y, z)], all: l.mul(xy, z) }
    }
}

/// How x bends along a way whose length counts as 1, at most.
#[derive(Clone, Copy)]
pub(super) struct Bend<L: Lanes> {
    /// Coefficient of the second power of the way.
    pub(super) second: L::Float,
    /// Coefficient of the third power.
    pub(super) third: L::Float,
    /// Coefficient of the fourth power.
    pub(super) fourth: L::Float,
    /// How far x is off such a polynomial.
    pub(super) kink: L::Float,
}

impl<L: Lanes> Bend<L> {
    /// How x bends along `share` of the way, whose length then counts as 1.
    #[inline(always)]
    pub(super) fn along(self, l: L, share: f32) -> Self {
        let (square, cube) = (share * share, share * share * share);
        Self {
            second: l.mul(self.second, l.splat(square)),
            third: l.mul(self.third, l.splat(cube)),
            fourth: l.mul(self.fourth, l.splat(square * square)),
            kink: self.kink,
        }
    }

    /// How the sum of both bends, at most.
    #[inline(always)]
    pub(super) fn plus(self, l: L, other: Self) -> Self {
        Self {
            second: l.add(self.second, other.second),
            third: l.add(self.third, other.third),
            fourth: l.add(self.fourth, other.fourth),
            kink: l.add(self.kink, other.kink),
        }
    }

    /// This one in some lanes, in others the other.
    #[inline(always)]
    pub(super) fn or(self, l: L, lanes: L::Mask, other: Self) -> Self {
        Self {
            second: l.select(lanes, self.second, other.second),
            third: l.select(lanes, self.third, other.third),
            fourth: l.select(lanes, self.fourth, other.fourth),
            kink: l.select(lanes, self.kink, other.kink),
        }
    }

    /// In each lane the bend for the ray whose part is dealt to it.
    #[inline(always)]
    pub(super) fn dealt(self, l: L, deal: &PartLanes<L>) -> Self {
        Self {
            second: deal.ray_of(l, self.second),
            third: deal.ray_of(l, self.third),
            fourth: deal.ray_of(l, self.fourth),
            kink: deal.ray_of(l, self.kink),
        }
    }

    /// How far x is from the straight line through the two nodes: s² − 1/12 is at most 1/6 for s
    /// from −½ to ½, s³ − s/12 half of that, s⁴ − 1/144 a third; and what nodes are off by makes
    /// √3 times as much at the line's ends.
    #[inline(always)]
    pub(super) fn distance(self, l: L) -> L::Float {
        let cubic = l.fma(self.third, l.splat(0.0834), l.mul(self.second, l.splat(0.1667)));
        l.fma(self.fourth, l.splat(0.0556), l.fma(self.kink, l.splat(2.74), cubic))
    }

    /// The integral of that distance, with its sign, from any place to an end, and five eighths of
    /// that of its product with twice the way from there, at most.
    #[inline(always)]
    pub(super) fn aside(self, l: L) -> L::Float {
        let cubic = l.fma(self.third, l.splat(0.007), l.mul(self.second, l.splat(0.0161)));
        l.fma(self.fourth, l.splat(0.015), l.fma(self.kink, l.splat(2.74), cubic))
    }

    /// How much steeper x may be in the middle than the line through the nodes.
    #[inline(always)]
    pub(super) fn lean(self, l: L) -> L::Float {
        l.fma(self.third, l.splat(0.1667), l.mul(self.kink, l.splat(3.47)))
    }
}
