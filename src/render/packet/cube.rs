//! The interpolant in a dual cell, and how it may bend.
#![allow(clippy::needless_range_loop)]

use super::rows::distance;
use crate::render::lanes::Lanes;

/// A dual cell's corners as differences along x.
#[derive(Clone, Copy)]
pub(super) struct Cube<L: Lanes> {
    lower: [L::Float; 4],
    rise: [L::Float; 4],
}

impl<L: Lanes> Cube<L> {
    /// The cube of `values` with `side` along each axis whose lowest corner is `first`.
    #[inline(always)]
    pub(super) fn new(l: L, (values, side): (&[f32], usize), first: L::Index) -> Self {
        let (row, layer) = (side, side * side);
        let rows = [0, row, layer, layer + row];
        let mut cube = Self { lower: [l.splat(0.0); 4], rise: [l.splat(0.0); 4] };
        for n in 0..4 {
            let [lower, upper] = l.gather_pair(values, first, rows[n]);
            (cube.lower[n], cube.rise[n]) = (lower, l.sub(upper, lower));
        }
        cube
    }

    /// How the interpolant may bend along any way through the cube: half its second derivative is at
    /// most the sum of its mixed differences, the coefficient of the third power that of all three.
    #[inline(always)]
    pub(super) fn bend(&self, l: L) -> Bend<L> {
        let [a, b, c, d] = self.rise;
        let xy = l.max(distance(l, b, a), distance(l, d, c));
        let xz = l.max(distance(l, c, a), distance(l, d, b));
        let [p, q, r, s] = self.lower;
        let lower = l.sub(l.sub(s, r), l.sub(q, p));
        let twist = l.sub(l.sub(d, c), l.sub(b, a));
        let (upper, zero) = (l.add(lower, twist), l.splat(0.0));
        let yz = l.max(distance(l, lower, zero), distance(l, upper, zero));
        Bend {
            second: l.add(l.add(xy, xz), yz),
            third: distance(l, twist, zero),
            fourth: zero,
            kink: zero,
        }
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

/// How x bends along a way of length 1, at most: coefficients of its second, third and fourth
/// power, and how far it is off such a polynomial.
#[derive(Clone, Copy)]
pub(super) struct Bend<L: Lanes> {
    pub(super) second: L::Float,
    pub(super) third: L::Float,
    pub(super) fourth: L::Float,
    pub(super) kink: L::Float,
}

impl<L: Lanes> Bend<L> {
    /// Along `share` of the way.
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

    /// Of a sum.
    #[inline(always)]
    pub(super) fn plus(self, l: L, other: Self) -> Self {
        Self {
            second: l.add(self.second, other.second),
            third: l.add(self.third, other.third),
            fourth: l.add(self.fourth, other.fourth),
            kink: l.add(self.kink, other.kink),
        }
    }

    /// How far x is from the straight line through its ends: (s − s²) and (s − s³) are at most ¼
    /// and 0.385, the latter's odd part 0.049 about the middle.
    #[inline(always)]
    pub(super) fn distance(self, l: L) -> L::Float {
        let cubic = l.fma(self.third, l.splat(0.05), l.mul(self.second, l.splat(0.25)));
        l.add(cubic, self.kink)
    }
}
