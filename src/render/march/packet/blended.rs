//! Cells beside borders of levels, for packets: the level's own interpolant blended into its
//! parents'.
//!
//! Between the planes where its formula changes, the weight of the level is linear: these are the
//! planes through the dual cell's middle, and those through two opposite edges, on which two
//! distances from a cell's centre are equal. Weights of parents' levels, where there is more than
//! one border, may bend on the way.
#![allow(clippy::needless_range_loop)]

use super::PacketBrick;
use super::cube::{Bend, Cube, Skew};
use super::part_lanes::PartLanes;
use super::rows::distance;
use crate::lanes::{BYTE_PADDING, Lanes};
use crate::render::brick::scaled::MOST_PARENTS;

/// A block that a brick's level is blended with.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Parents<'g> {
    /// Mapped values, x fastest, ghosts included.
    pub(crate) values: &'g [f32],
    /// Cells along an edge, ghosts included.
    pub(crate) side: usize,
    /// Which corners of its dual cells exist, (side − 1)³ and padding for lanes.
    pub(crate) corners: &'g [u8],
    /// Where the brick's lower corner lies, in the block's cells from its cell 0 (ghosts not
    /// counted).
    pub(crate) corner: [f32; 3],
    /// Width of the brick's cells, in the block's.
    pub(crate) scale: f32,
}

/// Where the weight of a level bends along rays, of given directions.
pub(super) struct Bends<L: Lanes> {
    /// 1 / (d_a − d_b) and 1 / (d_a + d_b) for pairs of axes, 1 / d_a.
    less: [L::Float; 3],
    more: [L::Float; 3],
    single: [L::Float; 3],
}

/// Pairs of axes.
const PAIRS: [[usize; 2]; 3] = [[0, 1], [1, 2], [2, 0]];

impl<L: Lanes> Bends<L> {
    /// Where weights bend along rays of these directions, cells per unit of t.
    #[inline(always)]
    pub(super) fn new(l: L, direction: [L::Float; 3]) -> Self {
        let zero = l.splat(0.0);
        let mut bends = Self { less: [zero; 3], more: [zero; 3], single: [zero; 3] };
        let one = l.splat(1.0);
        for n in 0..3 {
            let [a, b] = PAIRS[n];
            // Where this divides by 0 what follows is infinite or no number: never met.
            bends.less[n] = l.div(one, l.sub(direction[a], direction[b]));
            bends.more[n] = l.div(one, l.add(direction[a], direction[b]));
            bends.single[n] = l.div(one, direction[n]);
        }
        bends
    }

    /// The first way after `from`, at most `end`, at which the weight may bend; rays begin `within`
    /// the cell, whose border is `crooked` or a plane.
    #[inline(always)]
    pub(super) fn next(
        &self,
        l: L,
        within: [L::Float; 3],
        [from, end]: [L::Float; 2],
        crooked: L::Mask,
    ) -> L::Float {
        let (mut next, half, one) = (end, l.splat(0.5), l.splat(1.0));
        let all = l.mask(!0);
        for n in 0..3 {
            next = earlier(l, next, from, l.mul(l.sub(half, within[n]), self.single[n]), all);
        }
        if l.bits(crooked) == 0 {
            return next;
        }
        for n in 0..3 {
            let [a, b] = PAIRS[n];
            let (less, more) = (l.sub(within[b], within[a]), l.add(within[a], within[b]));
            next = earlier(l, next, from, l.mul(less, self.less[n]), crooked);
            next = earlier(l, next, from, l.mul(l.sub(one, more), self.more[n]), crooked);
        }
        next
    }
}

/// `at` where that is before `next` and after `from`, and counts.
#[inline(always)]
fn earlier<L: Lanes>(
    l: L,
    next: L::Float,
    from: L::Float,
    at: L::Float,
    counts: L::Mask,
) -> L::Float {
    // Neither holds of what is no number.
    let before = l.and(counts, l.is_at_most(at, next));
    l.select(l.without(before, l.is_at_most(at, from)), at, next)
}

/// Whether the border within dual cells of these existing corners is anything but a plane midway.
#[inline(always)]
pub(super) fn is_crooked<L: Lanes>(l: L, exists: L::Index) -> L::Mask {
    let mut crooked = l.mask(!0);
    for flat in [0xff, 0x00, 0x55, 0xaa, 0x33, 0xcc, 0x0f, 0xf0] {
        crooked = l.without(crooked, l.is_index(exists, flat));
    }
    crooked
}

/// For each set of existing corners of a dual cell, and each of its eight parts: which sets of
/// neighbours of the part's own cell (bit a of the set: the one along axis a) do not exist; set 0
/// is the cell itself.
static MISSING: [u8; 8 * 256 + BYTE_PADDING] = missing();

const fn missing() -> [u8; 8 * 256 + BYTE_PADDING] {
    let mut table = [0; 8 * 256 + BYTE_PADDING];
    let mut at = 0;
    while at < 8 * 256 {
        let (exists, own) = (at / 8, at % 8);
        let mut set = 0;
        while set < 8 {
            if exists >> (own ^ set) & 1 == 0 {
                table[at] |= 1 << set;
            }
            set += 1;
        }
        at += 1;
    }
    table
}

/// Whether a weight bends within a part where these sets of neighbours are missing: not where all
/// of them lie along one axis, nor where there is none.
static BENT: [u8; 256 + BYTE_PADDING] = bent();

const fn bent() -> [u8; 256 + BYTE_PADDING] {
    let mut table = [1; 256 + BYTE_PADDING];
    let mut missing = 0;
    while missing < 256 {
        // Sets with axis a: those with bit a in their number.
        let (x, y, z) = (0b1010_1010, 0b1100_1100, 0b1111_0000);
        let flat_x = missing & !x == 0 && missing & 0b10 != 0;
        let flat_y = missing & !y == 0 && missing & 0b100 != 0;
        let flat_z = missing & !z == 0 && missing & 0b1_0000 != 0;
        if missing == 0 || missing & 1 == 1 || flat_x || flat_y || flat_z {
            table[missing] = 0;
        }
        missing += 1;
    }
    table
}

/// The blending in one of the eight parts of a dual cell, each of which belongs to one cell.
pub(super) struct Part<L: Lanes> {
    /// The entry of [`MISSING`] for the brick's own level.
    missing: L::Index,
    parents: [Level<L>; MOST_PARENTS],
    /// How many of them count.
    depth: usize,
}

/// A level that is blended in.
#[derive(Clone, Copy)]
struct Level<L: Lanes> {
    missing: L::Index,
    /// The cells around, where the dual cell's lowest corner lies among them, and the width of the
    /// brick's cells in these.
    cube: Cube<L>,
    within: [L::Float; 3],
    scale: f32,
    /// How long the stretch is in its own cells, and how its interpolant bends along it.
    length: L::Float,
    bend: Bend<L>,
}

/// A stretch within the part.
#[derive(Clone, Copy)]
pub(super) struct Along<'a, L: Lanes> {
    /// Where it begins, from the dual cell's lowest corner, cells.
    pub(super) from: [L::Float; 3],
    /// Its middle, likewise.
    pub(super) middle: [L::Float; 3],
    /// Its length, in t.
    pub(super) length: L::Float,
    /// Products of the ray's direction.
    pub(super) skew: &'a Skew<L>,
}

/// Weights of levels, and how far each is from the next one's interpolant, at a node.
pub(super) type Blend<L> = [[<L as Lanes>::Float; 2]; MOST_PARENTS];

impl<L: Lanes> Part<L> {
    /// The part that a stretch is in of the dual cell `cell`, whose corners `exists` says, for all
    /// of `lanes`.
    #[inline(always)]
    pub(super) fn new(
        l: L,
        brick: &PacketBrick<'_>,
        cell: &[L::Float; 3],
        exists: L::Index,
        lanes: L::Mask,
        along: Along<'_, L>,
    ) -> Self {
        let missing = missing_at(l, exists, along.middle);
        let first = Level::new(l, &brick.parents[0], cell, along);
        let mut part = Self { missing, parents: [first; MOST_PARENTS], depth: 1 };
        while part.depth < brick.parent_count {
            let complete = l.is_index(part.parents[part.depth - 1].missing, 0);
            if l.bits(l.without(lanes, complete)) == 0 {
                break;
            }
            part.parents[part.depth] = Level::new(l, &brick.parents[part.depth], cell, along);
            part.depth += 1;
        }
        part
    }

    /// In each lane the blending for the ray whose part is dealt to it.
    #[inline(always)]
    pub(super) fn dealt(&self, l: L, deal: &PartLanes<L>) -> Self {
        let missing = dealt(l, self.missing, deal);
        let mut part = Self { missing, parents: self.parents, depth: self.depth };
        for n in 0..self.depth {
            let level = &mut part.parents[n];
            level.missing = dealt(l, level.missing, deal);
            level.cube = level.cube.dealt(l, deal);
            for a in 0..3 {
                level.within[a] = deal.ray_of(l, level.within[a]);
            }
            level.length = deal.ray_of(l, level.length);
            level.bend = level.bend.dealt(l, deal);
        }
        part
    }

    /// The interpolant at `place` in the dual cell, where the level's own is `x`, and what it
    /// comes from.
    #[inline(always)]
    pub(super) fn at(&self, l: L, x: L::Float, place: [L::Float; 3]) -> (L::Float, Blend<L>) {
        let one = l.splat(1.0);
        let mut own = [x; MOST_PARENTS + 1];
        let mut weights = [one; MOST_PARENTS + 1];
        weights[0] = weight(l, self.missing, place);
        for n in 0..self.depth {
            let level = &self.parents[n];
            let place = level.place(l, place);
            own[n + 1] = level.cube.at(l, place);
            if n + 1 < self.depth {
                weights[n + 1] = weight(l, level.missing, place);
            }
        }
        let mut value = own[self.depth];
        let mut blend = [[one, l.splat(0.0)]; MOST_PARENTS];
        for n in 0..self.depth {
            let n = self.depth - 1 - n;
            let apart = l.sub(own[n], value);
            value = l.sub(own[n], l.mul(l.sub(one, weights[n]), apart));
            blend[n] = [weights[n], apart];
        }
        (value, blend)
    }

    /// How the interpolant bends along `share` of the stretch, at the nodes of which it is blended
    /// as `nodes` say, where the level's own bends by `bend` over all of it. The product of a weight,
    /// linear, with a difference of two levels bends as their changes' does; where a parents'
    /// weight bends, its slope does so by up to 4 a cell of its own.
    #[inline(always)]
    pub(super) fn bend(&self, l: L, bend: Bend<L>, share: f32, [a, b]: &[Blend<L>; 2]) -> Bend<L> {
        let mut above = self.parents[self.depth - 1].bend.along(l, share);
        for n in 0..self.depth {
            let n = self.depth - 1 - n;
            let own = if n == 0 { bend } else { self.parents[n - 1].bend };
            let own = own.along(l, share);
            let both = own.plus(l, above);
            let ([w, d], [v, e]) = (a[n], b[n]);
            let change = l.fma(distance(l, d, e), l.splat(1.733), both.lean(l));
            let turn = l.mul(distance(l, v, w), l.splat(1.733));
            above = both;
            // The weight makes a fourth power of the difference's third; and of its fourth one a
            // fifth, of which two nodes leave two and a half times as much.
            let power = l.fma(both.fourth, l.splat(2.5), both.third);
            above.fourth = l.fma(turn, power, above.fourth);
            above.second = l.fma(turn, change, above.second);
            // What is left is the weight times the difference's third power: it bends no more
            // than a third of that, less a straight line.
            above.third = l.fma(turn, l.add(both.second, both.third), above.third);
            if n > 0 {
                let level = &self.parents[n - 1];
                let zero = l.splat(0.0);
                let apart = l.add(l.add(distance(l, d, zero), distance(l, e, zero)), change);
                let apart = l.add(apart, both.distance(l));
                let straight = l.is_index(l.gather_bytes(&BENT, level.missing), 0);
                let kink = l.mul(apart, l.mul(level.length, l.splat(share)));
                above.kink = l.add(above.kink, l.select(straight, zero, kink));
            }
            // Without a neighbour that is missing there is no blending, whatever other lanes do.
            let missing = if n == 0 { self.missing } else { self.parents[n - 1].missing };
            above = own.or(l, l.is_index(missing, 0), above);
        }
        above
    }
}

/// A small number, of the rays whose parts are dealt.
#[inline(always)]
fn dealt<L: Lanes>(l: L, number: L::Index, deal: &PartLanes<L>) -> L::Index {
    l.index(deal.ray_of(l, l.float(number)))
}

impl<L: Lanes> Level<L> {
    #[inline(always)]
    fn new(l: L, parents: &Parents<'_>, cell: &[L::Float; 3], along: Along<'_, L>) -> Self {
        let Parents { values, side, corners, corner, scale } = *parents;
        let Along { from, middle: place, length, skew } = along;
        let (mut first, mut within) = (place, place);
        for a in 0..3 {
            // Dual cells begin half a cell below cells, at all levels.
            let offset = l.splat(corner[a] + 0.5 - 0.5 * scale);
            let origin = l.fma(cell[a], l.splat(scale), offset);
            first[a] = l.floor(l.fma(place[a], l.splat(scale), origin));
            within[a] = l.sub(origin, first[a]);
        }
        let cube = Cube::new(l, values, side, number(l, first, side));
        let mut level = Self {
            missing: number(l, first, side - 1),
            cube,
            within,
            scale,
            length: l.mul(length, l.splat(scale)),
            bend: Bend { second: length, third: length, fourth: length, kink: length },
        };
        level.bend = cube.bend(l, skew, level.place(l, from), level.length);
        let exists = l.gather_bytes(corners, level.missing);
        level.missing = missing_at(l, exists, level.place(l, place));
        level
    }

    /// Where `place` in the dual cell lies among the level's.
    #[inline(always)]
    fn place(&self, l: L, place: [L::Float; 3]) -> [L::Float; 3] {
        let mut above = place;
        for a in 0..3 {
            above[a] = l.fma(place[a], l.splat(self.scale), self.within[a]);
        }
        above
    }
}

/// The number of a cell in an array of `side` along each axis.
#[inline(always)]
fn number<L: Lanes>(l: L, [x, y, z]: [L::Float; 3], side: usize) -> L::Index {
    let side = l.splat(side as f32);
    l.index(l.fma(l.fma(z, side, y), side, x))
}

/// The entry of [`MISSING`] where these corners of a dual cell exist, for the part of it that holds
/// `place`.
#[inline(always)]
fn missing_at<L: Lanes>(l: L, exists: L::Index, place: [L::Float; 3]) -> L::Index {
    let mut own = l.mul(l.float(exists), l.splat(8.0));
    for a in 0..3 {
        let is_upper = l.is_at_most(l.splat(0.5), place[a]);
        own = l.add(own, l.select(is_upper, l.splat((1 << a) as f32), l.splat(0.0)));
    }
    l.gather_bytes(&MISSING, l.index(own))
}

/// A level's weight (as [`crate::render::brick::interpolant::weight`]) at `place` in a dual cell.
#[inline(always)]
fn weight<L: Lanes>(l: L, missing: L::Index, place: [L::Float; 3]) -> L::Float {
    let (mut near, zero, one) = (place, l.splat(0.0), l.splat(1.0));
    for a in 0..3 {
        // 1 at the cell's centre, 0 at its face.
        near[a] = distance(l, l.fma(place[a], l.splat(-2.0), one), zero);
    }
    let [x, y, z] = near;
    let (xy, xz, yz) = (l.max(x, y), l.max(x, z), l.max(y, z));
    let sets = [zero, x, y, xy, z, xz, yz, l.max(xy, z)];
    let mut weight = one;
    for set in 0..8 {
        let bound = l.min(weight, sets[set]);
        weight = l.select(l.has_bit(missing, set as u32), bound, weight);
    }
    weight
}
