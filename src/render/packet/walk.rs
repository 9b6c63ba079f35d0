//! The walk of a packet from cell to cell.
#![allow(clippy::needless_range_loop)]

use super::rows::{load, store};
use super::{Ground, Packet};
use crate::render::lanes::Lanes;
use crate::render::relief::GROUP_EDGE;

/// The walk from cell to cell; every plane's t is computed anew, so that nothing drifts.
pub(super) struct Walk<L: Lanes> {
    l: L,
    pub(super) origin: [L::Float; 3],
    pub(super) direction: [L::Float; 3],
    pub(super) inverse: [L::Float; 3],
    /// 1 where the plane ahead of a cell is its upper one, and ±1 as the next cell's number is
    /// larger or smaller.
    ahead: [L::Float; 3],
    sign: [L::Float; 3],
    lo: [L::Float; 3],
    hi: [L::Float; 3],
    /// The last cell on the way, times its sign.
    last: [L::Float; 3],
    pub(super) cell: [L::Float; 3],
    pub(super) t: L::Float,
    pub(super) end: L::Float,
}

/// Along an axis on which a ray moves less than this it meets no plane.
const LEAST_MOTION: f32 = 1e-30;

impl<L: Lanes> Walk<L> {
    #[inline(always)]
    pub(super) fn new(l: L, ground: &Ground<'_>, packet: &Packet) -> Self {
        let (zero, one) = (l.splat(0.0), l.splat(1.0));
        let mut walk = Self {
            l,
            origin: load(l, &packet.origin),
            direction: load(l, &packet.direction),
            inverse: [zero; 3],
            ahead: [zero; 3],
            sign: [zero; 3],
            lo: [zero; 3],
            hi: [zero; 3],
            last: [zero; 3],
            cell: load(l, &packet.cell),
            t: l.load(&packet.t),
            end: l.load(&packet.end),
        };
        for a in 0..3 {
            let falls = l.is_at_most(walk.direction[a], l.splat(-LEAST_MOTION));
            let rises = l.is_at_most(l.splat(LEAST_MOTION), walk.direction[a]);
            walk.ahead[a] = l.select(falls, zero, one);
            walk.sign[a] = l.select(falls, l.splat(-1.0), one);
            let inverse = l.div(one, walk.direction[a]);
            let far = l.splat(LEAST_MOTION.recip());
            walk.inverse[a] = l.select(falls, inverse, l.select(rises, inverse, far));
            (walk.lo[a], walk.hi[a]) = (l.splat(ground.lo[a]), l.splat(ground.hi[a]));
            let last = l.select(falls, walk.lo[a], walk.hi[a]);
            walk.last[a] = l.mul(last, walk.sign[a]);
        }
        walk
    }

    /// Where rays would be at t = 0, from the cell's lowest corner.
    #[inline(always)]
    pub(super) fn within(&self) -> [L::Float; 3] {
        let mut within = self.origin;
        for a in 0..3 {
            within[a] = self.l.sub(within[a], self.cell[a]);
        }
        within
    }

    /// Where rays are at `t` that would be `within` at t = 0.
    #[inline(always)]
    pub(super) fn place(&self, mut within: [L::Float; 3], t: L::Float) -> [L::Float; 3] {
        for a in 0..3 {
            within[a] = self.l.fma(self.direction[a], t, within[a]);
        }
        within
    }

    /// Whether the dual cell is neither the first nor the last of the brick's, `last`, along an
    /// axis.
    #[inline(always)]
    pub(super) fn is_inside(&self, a: usize, last: usize) -> L::Mask {
        let l = self.l;
        let above = l.is_at_most(l.splat(1.0), self.cell[a]);
        l.and(above, l.is_at_most(self.cell[a], l.splat(last as f32 - 1.0)))
    }

    /// The number of the cell in an array of `side` along each axis.
    #[inline(always)]
    pub(super) fn index(&self, side: L::Float) -> L::Index {
        let Self { l, cell: [x, y, z], .. } = *self;
        l.index(l.fma(l.fma(z, side, y), side, x))
    }

    /// The number of the cell's group.
    #[inline(always)]
    pub(super) fn group(&self, groups: usize) -> L::Index {
        let l = self.l;
        let part = l.splat(1.0 / GROUP_EDGE as f32);
        let [x, y, z] = self.cell;
        let (x, y, z) = (l.floor(l.mul(x, part)), l.floor(l.mul(y, part)), l.floor(l.mul(z, part)));
        let side = l.splat(groups as f32);
        l.index(l.fma(l.fma(z, side, y), side, x))
    }

    /// t where the ray crosses the planes ahead of the cell.
    #[inline(always)]
    pub(super) fn planes(&self) -> [L::Float; 3] {
        let l = self.l;
        let mut planes = self.cell;
        for a in 0..3 {
            let ahead = l.sub(l.add(planes[a], self.ahead[a]), self.origin[a]);
            planes[a] = l.mul(ahead, self.inverse[a]);
        }
        planes
    }

    /// The same, but far off where there is no cell behind.
    #[inline(always)]
    pub(super) fn inner_planes(&self) -> [L::Float; 3] {
        let l = self.l;
        let mut planes = self.planes();
        for a in 0..3 {
            let is_last = l.is_at_most(self.last[a], l.mul(self.cell[a], self.sign[a]));
            planes[a] = l.select(is_last, l.splat(f32::MAX), planes[a]);
        }
        planes
    }

    /// t where the ray leaves the cell, whose planes ahead are `planes`, or the brick, and along
    /// which axis.
    #[inline(always)]
    pub(super) fn exit(&self, [x, y, z]: [L::Float; 3]) -> (L::Float, [L::Mask; 3]) {
        let l = self.l;
        let yz = l.min(y, z);
        let along_x = l.is_at_most(x, yz);
        let along_y = l.without(l.is_at_most(y, z), along_x);
        let along_z = l.without(l.without(l.mask(!0), along_x), along_y);
        (l.min(l.min(x, yz), self.end), [along_x, along_y, along_z])
    }

    /// Goes on to the next cell. Returns which of the active rays have one: rounding may leave a
    /// way of no length behind the last.
    #[inline(always)]
    pub(super) fn step(&mut self, active: L::Mask, axes: [L::Mask; 3]) -> L::Mask {
        let l = self.l;
        let mut inside = active;
        for a in 0..3 {
            let next = l.add(self.cell[a], self.sign[a]);
            let is_in = l.and(l.is_at_most(self.lo[a], next), l.is_at_most(next, self.hi[a]));
            let moves = l.and(active, axes[a]);
            self.cell[a] = l.select(l.and(moves, is_in), next, self.cell[a]);
            inside = l.without(inside, l.without(moves, is_in));
        }
        inside
    }

    #[inline(always)]
    pub(super) fn store(&self, packet: &mut Packet) {
        self.l.store(self.t, &mut packet.t);
        store(self.l, &self.cell, &mut packet.cell);
    }
}
