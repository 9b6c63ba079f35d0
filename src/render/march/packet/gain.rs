//! What stretches of cells add to what rays gather.
#![allow(clippy::needless_range_loop)]

use super::PacketBrick;
use super::bends::{Depths, PartValues, part_error};
use super::blended::Part;
use super::cube::{Bend, Cube};
use super::part_lanes::PartLanes;
use super::rows::behind;
use super::shade::{shade, through};
use crate::lanes::Lanes;
use crate::render::bounds::grade::DEEPEST;
use crate::render::brick::scaled::MOST_PARENTS;

/// Gauss–Legendre nodes on [0, 1]: ½ ∓ 1/√12.
const NODES: [f32; 2] = [0.211_324_87, 0.788_675_1];
/// √3 / 12: what extinction's slope between the nodes adds to the depth at either.
const SLOPE_DEPTH: f32 = 0.144_337_57;

/// A stretch of a cell, along which one formula holds.
#[derive(Clone, Copy)]
pub(super) struct Stretch<'s, L: Lanes> {
    /// The brick's own values at the dual cell's corners.
    pub(super) cube: &'s Cube<L>,
    /// How the level's own interpolant bends along it.
    pub(super) bend: Bend<L>,
    /// How it is blended, beside borders of levels.
    pub(super) part: Option<&'s Part<L>>,
    /// Where the ray comes into the cell, from its lowest corner, cells.
    pub(super) place: [L::Float; 3],
    /// The ray's direction, cells per unit of t.
    pub(super) direction: [L::Float; 3],
    /// Where it begins, in t from where the ray comes into the cell.
    pub(super) from: L::Float,
    /// Its length, in t.
    pub(super) way: L::Float,
    /// Optical depth of the table's largest extinction per unit of length.
    pub(super) thickness: L::Float,
    /// What extinction is off by beside what is found out on the way.
    pub(super) rate: L::Float,
    /// The first four numbers of the group's row in [`PacketBrick::rows`].
    pub(super) stored: [L::Float; 4],
}

/// How a stretch, or several, answer to values that are not stored exactly.
#[derive(Clone, Copy)]
pub(super) struct StorageSlopes<L: Lanes> {
    /// ∫ T dt, with T the transmittance up to t.
    pub(super) lit: L::Float,
    /// ∫ T dt of the steepest slope of emission times what x is off by; the same of extinction; and
    /// ∫ dt of the latter.
    pub(super) slopes: [L::Float; 3],
}

impl<L: Lanes> StorageSlopes<L> {
    /// What no stretch adds.
    #[inline(always)]
    pub(super) fn none(l: L) -> Self {
        Self { lit: l.splat(0.0), slopes: [l.splat(0.0); 3] }
    }

    /// Adds another stretch's; of slopes only emission's where nothing absorbs.
    #[inline(always)]
    pub(super) fn add<const ABSORBS: bool>(&mut self, l: L, other: &Self) {
        self.lit = l.add(self.lit, other.lit);
        for n in 0..if ABSORBS { 3 } else { 1 } {
            self.slopes[n] = l.add(self.slopes[n], other.slopes[n]);
        }
    }
}

/// What a stretch adds to the sums.
#[derive(Clone, Copy)]
pub(super) struct Gain<L: Lanes> {
    /// Emission that it adds, dimmed by what lies in front (R, G, B).
    pub(super) light: [L::Float; 3],
    /// Its optical depth.
    pub(super) depth: L::Float,
    /// How it answers to values that are not stored exactly.
    pub(super) steep: StorageSlopes<L>,
    /// What it is off by, in the order of [`super::Packet::off`].
    pub(super) off: [L::Float; 3],
    /// Optical depth of the deepest part, at most.
    deepest: L::Float,
}

impl<L: Lanes> Gain<L> {
    /// Nothing.
    #[inline(always)]
    fn none(l: L) -> Self {
        let (zero, steep) = (l.splat(0.0), StorageSlopes::none(l));
        Self { light: [zero; 3], depth: zero, steep, off: [zero; 3], deepest: zero }
    }

    /// What a stretch behind an optical depth adds if it is passed at once; and what x is along it.
    #[inline(always)]
    pub(super) fn at_once<const ABSORBS: bool>(
        l: L,
        brick: &PacketBrick<'_>,
        depth: L::Float,
        stretch: &Stretch<'_, L>,
    ) -> (Self, PartValues<L>) {
        let look = StretchPart::at::<ABSORBS>(l, brick, stretch, l.splat(0.0), 1.0);
        look.gain::<ABSORBS>(l, brick, depth, stretch)
    }

    /// What a stretch behind an optical depth adds if it is passed in so many equal parts, in
    /// `lanes` (one bit each) alone: parts of as many of their rays at a time as there is room for
    /// take all lanes.
    #[inline(always)]
    pub(super) fn in_parts<const ABSORBS: bool>(
        l: L,
        brick: &PacketBrick<'_>,
        depth: L::Float,
        lanes: u32,
        stretch: &Stretch<'_, L>,
        parts: u32,
    ) -> Self {
        let (mut all, mut left) = (Self::none(l), lanes);
        while left != 0 {
            let deal = PartLanes::new(l, left, parts);
            let gain = Self::of_deal::<ABSORBS>(l, brick, depth, &deal, stretch, parts);
            all = gain.or(l, l.mask(deal.rays), &all);
            left &= !deal.rays;
        }
        all
    }

    #[inline(always)]
    fn of_deal<const ABSORBS: bool>(
        l: L,
        brick: &PacketBrick<'_>,
        depth: L::Float,
        deal: &PartLanes<L>,
        stretch: &Stretch<'_, L>,
        parts: u32,
    ) -> Self {
        let (cube, part) = (stretch.cube.dealt(l, deal), dealt(l, stretch.part, deal));
        let stretch = stretch.dealt(l, deal, &cube, part.as_ref());
        let (mut gain, before) = (Self::none(l), deal.ray_of(l, depth));
        for round in 0..parts / deal.abreast {
            let number = l.add(deal.number, l.splat((round * deal.abreast) as f32));
            let share = (parts as f32).recip();
            let look = StretchPart::at::<ABSORBS>(l, brick, &stretch, number, share);
            let mut depth = before;
            if ABSORBS {
                // From 0 on: rounding of each sum is none of all that lies in front.
                let [in_front, behind] = deal.in_front(l, gain.depth, look.mean);
                (depth, gain.depth) = (l.add(before, in_front), behind);
            }
            let (found, _) = look.gain::<ABSORBS>(l, brick, depth, &stretch);
            for n in 0..deal.abreast {
                gain = gain.and::<ABSORBS>(l, &found, deal.part(l, n));
            }
        }
        gain
    }

    /// Which lanes are off by more than what is `allowed`, or too deep.
    #[inline(always)]
    pub(super) fn open<const ABSORBS: bool>(
        &self,
        l: L,
        brick: &PacketBrick<'_>,
        allowed: L::Float,
    ) -> L::Mask {
        let mut off = self.off[0];
        if ABSORBS {
            off = l.fma(self.off[1], l.splat(brick.darkening), off);
        }
        let shallow = l.is_at_most(self.deepest, l.splat(DEEPEST));
        l.without(l.mask(!0), l.and(shallow, l.is_at_most(off, allowed)))
    }

    /// This one in some lanes, in others the other.
    #[inline(always)]
    pub(super) fn or(mut self, l: L, lanes: L::Mask, other: &Self) -> Self {
        for n in 0..3 {
            self.light[n] = l.select(lanes, self.light[n], other.light[n]);
            self.off[n] = l.select(lanes, self.off[n], other.off[n]);
            self.steep.slopes[n] = l.select(lanes, self.steep.slopes[n], other.steep.slopes[n]);
        }
        self.depth = l.select(lanes, self.depth, other.depth);
        self.steep.lit = l.select(lanes, self.steep.lit, other.steep.lit);
        self.deepest = l.select(lanes, self.deepest, other.deepest);
        self
    }

    /// This one and what lies behind it, but for its depth, which is in the lanes that `from` names.
    #[inline(always)]
    fn and<const ABSORBS: bool>(mut self, l: L, next: &Self, from: L::Index) -> Self {
        self.steep.lit = l.add(self.steep.lit, l.deal(next.steep.lit, from));
        for n in 0..3 {
            self.light[n] = l.add(self.light[n], l.deal(next.light[n], from));
            if ABSORBS || n == 0 {
                self.off[n] = l.add(self.off[n], l.deal(next.off[n], from));
                let slope = l.deal(next.steep.slopes[n], from);
                self.steep.slopes[n] = l.add(self.steep.slopes[n], slope);
            }
        }
        if ABSORBS {
            self.deepest = l.max(self.deepest, l.deal(next.deepest, from));
        }
        self
    }
}

#[inline(always)]
fn dealt<L: Lanes>(l: L, part: Option<&Part<L>>, deal: &PartLanes<L>) -> Option<Part<L>> {
    match part {
        Some(part) => Some(part.dealt(l, deal)),
        None => None,
    }
}

impl<'s, L: Lanes> Stretch<'s, L> {
    /// In each lane the stretch of the ray whose part is dealt to it, with the cube and the
    /// blending that are dealt likewise.
    #[inline(always)]
    fn dealt<'d>(
        &self,
        l: L,
        deal: &PartLanes<L>,
        cube: &'d Cube<L>,
        part: Option<&'d Part<L>>,
    ) -> Stretch<'d, L> {
        let (mut place, mut direction, mut stored) = (self.place, self.direction, self.stored);
        for a in 0..3 {
            place[a] = deal.ray_of(l, place[a]);
            direction[a] = deal.ray_of(l, direction[a]);
        }
        for n in 0..4 {
            stored[n] = deal.ray_of(l, stored[n]);
        }
        Stretch {
            cube,
            bend: self.bend.dealt(l, deal),
            part,
            place,
            direction,
            from: deal.ray_of(l, self.from),
            way: deal.ray_of(l, self.way),
            thickness: deal.ray_of(l, self.thickness),
            rate: deal.ray_of(l, self.rate),
            stored,
        }
    }
}

/// A part of a stretch in each lane, before it is known what lies in front.
struct StretchPart<L: Lanes> {
    /// Its length.
    step: L::Float,
    /// Optical depth of the table's largest extinction over it, and its own.
    thickness: L::Float,
    mean: L::Float,
    /// x at the nodes, what it emits and absorbs there, and how x bends.
    values: [L::Float; 2],
    shades: [[L::Float; 4]; 2],
    bend: Bend<L>,
}

impl<L: Lanes> StretchPart<L> {
    /// At the part with a number, of parts that are each such a share of the stretch.
    #[inline(always)]
    fn at<const ABSORBS: bool>(
        l: L,
        brick: &PacketBrick<'_>,
        stretch: &Stretch<'_, L>,
        number: L::Float,
        share: f32,
    ) -> Self {
        let Stretch { cube, bend, part, place, direction, from, way, thickness, .. } = *stretch;
        let step = l.mul(way, l.splat(share));
        let zero = l.splat(0.0);
        let (mut shades, mut values) = ([[zero; 4]; 2], [zero; 2]);
        let mut blends = [[[zero; 2]; MOST_PARENTS]; 2];
        for n in 0..2 {
            let node = l.fma(step, l.add(number, l.splat(NODES[n])), from);
            let place = behind(l, place, direction, node);
            let mut x = cube.at(l, place);
            if let Some(part) = part {
                (x, blends[n]) = part.at(l, x, place);
            }
            shades[n] = shade::<L, ABSORBS>(l, brick.table, x);
            values[n] = x;
        }
        let bend = match part {
            Some(part) => part.bend(l, bend, share, &blends),
            None => bend.along(l, share),
        };
        let (mut mean, thickness) = (zero, l.mul(step, thickness));
        if ABSORBS {
            mean = l.mul(thickness, l.mul(l.add(shades[0][3], shades[1][3]), l.splat(0.5)));
        }
        Self { step, thickness, mean, values, shades, bend }
    }

    /// What it adds, behind an optical depth; and what x is along it.
    #[inline(always)]
    fn gain<const ABSORBS: bool>(
        &self,
        l: L,
        brick: &PacketBrick<'_>,
        depth: L::Float,
        stretch: &Stretch<'_, L>,
    ) -> (Gain<L>, PartValues<L>) {
        let Self { step, thickness, mean, values, shades: [a, b], bend } = *self;
        let half = l.mul(step, l.splat(0.5));
        let mut gain = Gain::none(l);
        let mut weights = [half; 2];
        if ABSORBS {
            let lean = l.mul(l.mul(thickness, l.sub(b[3], a[3])), l.splat(SLOPE_DEPTH));
            for n in 0..2 {
                let depth = l.sub(l.fma(mean, l.splat(NODES[n]), depth), lean);
                weights[n] = l.mul(half, through(l, depth));
            }
            gain.depth = mean;
        }
        let mut brightest = l.splat(0.0);
        for c in 0..3 {
            gain.light[c] = l.fma(weights[0], a[c], l.mul(weights[1], b[c]));
            brightest = l.max(brightest, gain.light[c]);
        }
        let lit = l.add(weights[0], weights[1]);
        gain.steep.lit = lit;
        let depths = Depths { thickness, mean, extinction: l.max(a[3], b[3]) };
        let found = part_error::<L, ABSORBS>(l, brick, values, bend, depths);
        gain.off[0] = l.mul(found.emission, lit);
        let high = l.add(found.seen.middle, found.seen.half);
        let [_, _, most, base] = stretch.stored;
        let off = l.min(most, l.fma(l.splat(brick.storage[1]), high, base));
        let off = l.max(off, l.splat(0.0));
        let [slope, fade] = [l.mul(found.steepest[0], off), l.mul(found.steepest[1], off)];
        gain.steep.slopes[0] = l.mul(slope, lit);
        if ABSORBS {
            gain.steep.slopes[1] = l.mul(fade, lit);
            gain.steep.slopes[2] = l.mul(fade, step);
            gain.off[1] = l.mul(found.extinction, lit);
            gain.off[2] = l.mul(found.extinction, step);
            // The depth in front of a node is off by up to three times as much.
            let late = l.mul(l.mul(l.add(found.most, stretch.rate), thickness), l.splat(3.3));
            gain.off[0] = l.fma(l.add(late, found.curved), brightest, gain.off[0]);
            gain.deepest = found.depth;
        }
        (gain, found.seen)
    }
}
