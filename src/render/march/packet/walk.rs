//! The walk of a packet from cell to cell.
#![allow(clippy::needless_range_loop)]

use super::long::{Long, apart, difference, select};
use super::rows::{behind, distance, load, store};
use super::{Packet, PacketBrick};
use crate::lanes::Lanes;
use crate::render::brick::relief::GROUP_EDGE;

/// The walk from cell to cell; every plane's t is computed anew, so that nothing drifts, and as a
/// sum of two f32, so that cells far along the ray are as exact as the first. The first numbers of
/// origins have few enough bits ([`super::ORIGIN_STEP`]) for differences to planes to be exact.
pub(super) struct Walk<L: Lanes> {
    l: L,
    origin: [Long<L>; 3],
    direction: [Long<L>; 3],
    inverse: [Long<L>; 3],
    /// 1 where the plane ahead of a cell is its upper one, and ±1 as the next cell's number is
    /// larger or smaller.
    ahead: [L::Float; 3],
    sign: [L::Float; 3],
    lo: [L::Float; 3],
    hi: [L::Float; 3],
    /// The last cell on the way, times its sign.
    last: [L::Float; 3],
    /// The (dual) cell that rays are in: whole numbers.
    pub(super) cell: [L::Float; 3],
    t: Long<L>,
    /// t where rays leave the brick.
    pub(super) end: Long<L>,
    /// Where rays are at t, from the cell's lowest corner.
    pub(super) place: [L::Float; 3],
}

/// Where the way through a cell ends.
pub(super) struct Exit<L: Lanes> {
    t: Long<L>,
    /// How long it is.
    pub(super) way: L::Float,
    /// Along which axis the ray leaves the cell: one of the three.
    pub(super) axes: [L::Mask; 3],
    /// Whether it leaves the brick before it would leave the cell.
    pub(super) at_end: L::Mask,
}

/// Along an axis on which a ray moves less than this it meets no plane.
const LEAST_MOTION: f32 = 1e-30;

impl<L: Lanes> Walk<L> {
    /// The walk of the packet's rays from where they have come to.
    #[inline(always)]
    pub(super) fn new(l: L, brick: &PacketBrick<'_>, packet: &Packet) -> Self {
        let (zero, one) = (l.splat(0.0), l.splat(1.0));
        let long = [zero; 2];
        let mut walk = Self {
            l,
            origin: [long; 3],
            direction: [long; 3],
            inverse: [long; 3],
            ahead: [zero; 3],
            sign: [zero; 3],
            lo: [zero; 3],
            hi: [zero; 3],
            last: [zero; 3],
            cell: load(l, &packet.cell),
            t: [l.load(&packet.t[0]), l.load(&packet.t[1])],
            end: [l.load(&packet.end[0]), l.load(&packet.end[1])],
            place: [zero; 3],
        };
        for a in 0..3 {
            walk.origin[a] = [l.load(&packet.origin[0][a]), l.load(&packet.origin[1][a])];
            let direction = [l.load(&packet.direction[0][a]), l.load(&packet.direction[1][a])];
            walk.direction[a] = direction;
            let falls = l.is_at_most(direction[0], l.splat(-LEAST_MOTION));
            let rises = l.is_at_most(l.splat(LEAST_MOTION), direction[0]);
            walk.ahead[a] = l.select(falls, zero, one);
            walk.sign[a] = l.select(falls, l.splat(-1.0), one);
            // One step of Newton's method from the rounded inverse.
            let inverse = l.div(one, direction[0]);
            let left = l.fused(l.sub(zero, direction[0]), inverse, one);
            let left = l.sub(left, l.mul(direction[1], inverse));
            let inverse = [inverse, l.mul(inverse, left)];
            let far = [l.splat(LEAST_MOTION.recip()), zero];
            walk.inverse[a] = select(l, falls, inverse, select(l, rises, inverse, far));
            (walk.lo[a], walk.hi[a]) = (l.splat(brick.lo[a]), l.splat(brick.hi[a]));
            let last = l.select(falls, walk.lo[a], walk.hi[a]);
            walk.last[a] = l.mul(last, walk.sign[a]);
        }
        walk
    }

    /// The rays' directions.
    #[inline(always)]
    pub(super) fn direction(&self) -> [L::Float; 3] {
        let [x, y, z] = &self.direction;
        [x[0], y[0], z[0]]
    }

    /// t reached.
    #[inline(always)]
    pub(super) fn reached(&self) -> L::Float {
        self.t[0]
    }

    /// How much longer t becomes over a cell along each axis.
    #[inline(always)]
    pub(super) fn stretching(&self) -> [L::Float; 3] {
        let (l, zero) = (self.l, self.l.splat(0.0));
        let mut stretching = self.cell;
        for a in 0..3 {
            stretching[a] = distance(l, self.inverse[a][0], zero);
        }
        stretching
    }

    /// Finds `place`.
    #[inline(always)]
    pub(super) fn locate(&mut self) {
        let l = self.l;
        for a in 0..3 {
            let ([origin, rest], [direction, turned]) = (self.origin[a], self.direction[a]);
            let near = l.fused(direction, self.t[0], l.sub(origin, self.cell[a]));
            let rest = l.fma(turned, self.t[0], l.fma(direction, self.t[1], rest));
            self.place[a] = l.add(near, rest);
        }
    }

    /// Where rays are `way` behind `place`.
    #[inline(always)]
    pub(super) fn behind(&self, way: L::Float) -> [L::Float; 3] {
        behind(self.l, self.place, self.direction(), way)
    }

    /// Whether the dual cell is neither the first nor the last that is drawn along an axis.
    #[inline(always)]
    pub(super) fn is_inside(&self, a: usize) -> L::Mask {
        let (l, one) = (self.l, self.l.splat(1.0));
        let above = l.is_at_most(l.add(self.lo[a], one), self.cell[a]);
        l.and(above, l.is_at_most(self.cell[a], l.sub(self.hi[a], one)))
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
    pub(super) fn planes(&self) -> [Long<L>; 3] {
        let (l, zero) = (self.l, self.l.splat(0.0));
        let mut planes = self.origin;
        for a in 0..3 {
            let ([origin, rest], [inverse, more]) = (self.origin[a], self.inverse[a]);
            let ahead = l.sub(l.add(self.cell[a], self.ahead[a]), origin);
            let t = l.mul(ahead, inverse);
            let left = l.fused(ahead, inverse, l.sub(zero, t));
            let moved = l.sub(l.mul(ahead, more), l.mul(rest, inverse));
            planes[a] = [t, l.add(left, moved)];
        }
        planes
    }

    /// t of the three planes ahead, but far off where there is no cell behind the plane.
    #[inline(always)]
    pub(super) fn inner_planes(&self) -> [Long<L>; 3] {
        let l = self.l;
        let mut planes = self.planes();
        for a in 0..3 {
            let is_last = l.is_at_most(self.last[a], l.mul(self.cell[a], self.sign[a]));
            planes[a] = select(l, is_last, [l.splat(f32::MAX), l.splat(0.0)], planes[a]);
        }
        planes
    }

    /// Where the ray leaves the cell, whose planes ahead are `planes`, or the brick.
    #[inline(always)]
    pub(super) fn exit(&self, [x, y, z]: [Long<L>; 3]) -> Exit<L> {
        let (l, zero) = (self.l, self.l.splat(0.0));
        let (xy, xz) = (apart(l, x, y), apart(l, x, z));
        let along_x = l.and(l.is_at_most(xy, zero), l.is_at_most(xz, zero));
        let along_y = l.without(l.is_at_most(apart(l, y, z), zero), along_x);
        let along_z = l.without(l.without(l.mask(!0), along_x), along_y);
        let plane = select(l, along_x, x, select(l, along_y, y, z));
        let at_end = l.is_at_most(apart(l, self.end, plane), zero);
        let t = select(l, at_end, self.end, plane);
        let way = apart(l, t, self.t);
        // Rounding may put planes that the ray has come to behind it.
        let t = select(l, l.is_at_most(zero, way), t, self.t);
        Exit { t, way: l.max(way, zero), axes: [along_x, along_y, along_z], at_end }
    }

    /// How long the way to the exit is, as the sum of two.
    #[inline(always)]
    pub(super) fn way_to(&self, exit: &Exit<L>) -> Long<L> {
        difference(self.l, exit.t, self.t)
    }

    /// How far it is from the exit on to a t.
    #[inline(always)]
    pub(super) fn beyond(&self, exit: &Exit<L>, t: Long<L>) -> L::Float {
        apart(self.l, t, exit.t)
    }

    /// Active rays go on to the exit and into the next cell. Returns which of them have one: rounding
    /// may leave a way of no length behind the last.
    #[inline(always)]
    pub(super) fn step(&mut self, active: L::Mask, exit: &Exit<L>) -> L::Mask {
        let (l, axes) = (self.l, exit.axes);
        self.t = select(l, active, exit.t, self.t);
        let active = l.without(active, exit.at_end);
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

    /// Writes t and cell back to the packet.
    #[inline(always)]
    pub(super) fn store(&self, packet: &mut Packet) {
        self.l.store(self.t[0], &mut packet.t[0]);
        self.l.store(self.t[1], &mut packet.t[1]);
        store(self.l, &self.cell, &mut packet.cell);
    }
}
