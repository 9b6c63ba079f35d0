//! The way of a packet through interpolated cells.
#![allow(clippy::needless_range_loop)]

use super::blended::{Along, Bends, Part, is_crooked};
use super::cube::{Cube, Skew};
use super::gain::{StorageSlopes, Stretch};
use super::rows::is_less;
use super::square::{Shift, Squares};
use super::sums::Sums;
use super::walk::Walk;
use super::{Packet, PacketBrick, add_off, go_on, unpacked};
use crate::lanes::Lanes;
use crate::render::bounds::grade::{LEVELS, LEVELS_NEAR, RATE, UNFIT};
use crate::render::brick::scaled::dual;

/// Marches rays on until each has left the brick or faded, or has come to a cell that is not fit:
/// the last are active then.
#[inline(always)]
pub(super) fn march<L: Lanes, const ABSORBS: bool, const BLENDED: bool>(
    l: L,
    brick: &PacketBrick<'_>,
    packet: &mut Packet,
) {
    let mut state = PacketMarch::new(l, brick, packet);
    loop {
        let cell = state.look::<BLENDED>();
        if l.bits(state.active) == 0 {
            break;
        }
        state.pass::<ABSORBS, BLENDED>(&cell);
    }
    state.end();
}

/// Rays on their way.
struct PacketMarch<'m, L: Lanes> {
    l: L,
    brick: &'m PacketBrick<'m>,
    packet: &'m mut Packet,
    walk: Walk<L>,
    bends: Bends<L>,
    skew: Skew<L>,
    sums: Sums<L>,
    squares: Squares<L>,
    thickness: L::Float,
    allowed: L::Float,
    fade: L::Float,
    active: L::Mask,
    /// Rays that have come to cells that are not fit for packets.
    stopped: L::Mask,
}

/// The cells that rays have come to.
struct Place<L: Lanes> {
    group: L::Index,
    /// What is known of the group, as [`PacketBrick::rows`] has it.
    row: [L::Float; 8],
    /// Their numbers among dual cells.
    duals: L::Index,
}

impl<'m, L: Lanes> PacketMarch<'m, L> {
    #[inline(always)]
    fn new(l: L, brick: &'m PacketBrick<'m>, packet: &'m mut Packet) -> Self {
        let walk = Walk::new(l, brick, packet);
        Self {
            l,
            brick,
            bends: Bends::new(l, walk.direction()),
            skew: Skew::new(l, walk.direction()),
            walk,
            sums: Sums::load(l, packet),
            squares: Squares::load(l, packet),
            thickness: l.load(&packet.thickness),
            allowed: l.load(&packet.allowed),
            fade: l.load(&packet.fade),
            active: l.mask(packet.active),
            stopped: l.mask(0),
            packet,
        }
    }

    /// Finds the cells that rays have come to, and stops those that may not pass theirs.
    #[inline(always)]
    fn look<const BLENDED: bool>(&mut self) -> Place<L> {
        let Self { l, brick, .. } = *self;
        let group = self.walk.group(brick.groups);
        let row = l.gather_row(brick.rows, group);
        let mut unfit = l.is_index(l.bits_of(row[RATE]), UNFIT);
        let duals = self.walk.index(l.splat((brick.side - 1) as f32));
        if !brick.kinds.is_empty() {
            let kind = l.gather_bytes(brick.kinds, duals);
            let expected = if BLENDED { dual::BLENDED } else { dual::PLAIN };
            let fit = l.without(l.is_index(kind, u32::from(expected)), unfit);
            unfit = l.without(l.mask(!0), fit);
        }
        let stops = l.and(self.active, unfit);
        self.stopped = l.mask(l.bits(self.stopped) | l.bits(stops));
        self.active = l.without(self.active, unfit);
        Place { group, row, duals }
    }

    /// Passes the cells at `place`, and goes on to the next.
    #[inline(always)]
    fn pass<const ABSORBS: bool, const BLENDED: bool>(&mut self, place: &Place<L>) {
        let Self { l, brick, active, .. } = *self;
        let side = l.splat(brick.side as f32);
        let cube = Cube::new(l, brick.values, brick.side, self.walk.index(side));
        self.walk.locate();
        let exit = self.walk.exit(self.walk.planes());
        let way = l.select(active, exit.way, l.splat(0.0));
        let [emission_off, extinction_off] = unpacked(l, l.bits_of(place.row[RATE]), active);
        let stretch = Stretch {
            cube: &cube,
            bend: cube.bend(l, &self.skew, self.walk.place, way),
            part: None,
            place: self.walk.place,
            direction: self.walk.direction(),
            from: l.splat(0.0),
            way,
            thickness: self.thickness,
            rate: extinction_off,
            stored: [place.row[0], place.row[1], place.row[2], place.row[3]],
        };
        let shift = self.shift::<BLENDED>(place, way);
        let steep = if BLENDED {
            self.pass_blended::<ABSORBS>(&stretch, place.duals, &shift)
        } else {
            self.pass_plain::<ABSORBS>(&stretch, &shift)
        };
        let rates = [emission_off, extinction_off];
        self.sums.off = add_off::<L, ABSORBS>(l, self.sums.off, rates, steep.lit, way);
        self.add_known::<ABSORBS>(place, &stretch, steep, &shift);
        let Self { walk, sums, fade, .. } = self;
        self.active = go_on::<L, ABSORBS>(l, walk, &exit, active, sums.depth[0], *fade);
    }

    /// How far other rays of squares are, if rays stand for such.
    #[inline(always)]
    fn shift<const BLENDED: bool>(&self, place: &Place<L>, way: L::Float) -> Shift<L> {
        if self.brick.reliefs.is_empty() {
            return Shift::none(self.l);
        }
        self.squares.shift(self.l, self.brick, &self.walk, way, place.group, BLENDED)
    }

    /// Passes cells whose interpolant is the level's own.
    #[inline(always)]
    fn pass_plain<const ABSORBS: bool>(
        &mut self,
        stretch: &Stretch<'_, L>,
        shift: &Shift<L>,
    ) -> StorageSlopes<L> {
        let Self { l, brick, active, .. } = *self;
        let mut passed = self.sums.pass::<ABSORBS>(l, brick, self.allowed, active, stretch);
        self.packet.count += passed.count;
        if !brick.reliefs.is_empty() {
            passed.steep.slopes =
                shift.add::<ABSORBS>(l, brick, self.packet, &passed, stretch, active);
        }
        passed.steep
    }

    /// Passes cells beside borders of levels, cut where weights of levels bend.
    #[inline(always)]
    fn pass_blended<const ABSORBS: bool>(
        &mut self,
        stretch: &Stretch<'_, L>,
        duals: L::Index,
        shift: &Shift<L>,
    ) -> StorageSlopes<L> {
        let Self { l, brick, active, allowed, .. } = *self;
        let (zero, way) = (l.splat(0.0), stretch.way);
        let mut steep = StorageSlopes::none(l);
        let exists = l.gather_bytes(brick.corners, duals);
        let crooked = l.and(active, is_crooked(l, exists));
        let (mut from, mut ahead) = (zero, active);
        while l.bits(ahead) != 0 {
            let to = self.bends.next(l, self.walk.place, [from, way], crooked);
            let length = l.max(l.select(ahead, l.sub(to, from), zero), zero);
            let middle = self.walk.behind(l.fma(length, l.splat(0.5), from));
            let along = Along { from: self.walk.behind(from), middle, length, skew: &self.skew };
            let part = Part::new(l, brick, &self.walk.cell, exists, ahead, along);
            let bend = stretch.cube.bend(l, &self.skew, along.from, length);
            let stretch = Stretch { bend, part: Some(&part), from, way: length, ..*stretch };
            let mut passed = self.sums.pass::<ABSORBS>(l, brick, allowed, ahead, &stretch);
            self.packet.count += passed.count;
            if !brick.reliefs.is_empty() {
                passed.steep.slopes =
                    shift.add::<ABSORBS>(l, brick, self.packet, &passed, &stretch, ahead);
            }
            steep.add::<ABSORBS>(l, &passed.steep);
            ahead = l.and(ahead, is_less(l, to, way));
            from = l.select(ahead, to, from);
        }
        steep
    }

    /// Adds what levels and stored values make of what was passed.
    #[inline(always)]
    fn add_known<const ABSORBS: bool>(
        &mut self,
        place: &Place<L>,
        Stretch { way, stored, .. }: &Stretch<'_, L>,
        steep: StorageSlopes<L>,
        shift: &Shift<L>,
    ) {
        let Self { l, brick, active, .. } = *self;
        if !brick.levels.is_empty() {
            let levels = l.bits_of(place.row[if brick.are_proxies { LEVELS_NEAR } else { LEVELS }]);
            let mut rates = unpacked(l, levels, active);
            if !brick.reliefs.is_empty() && !brick.are_proxies {
                rates = self.squares.levels(l, brick, rates, active);
            }
            self.sums.levels = add_off::<L, ABSORBS>(l, self.sums.levels, rates, steep.lit, *way);
        }
        let mut of_group = [stored[0], stored[1]];
        if !brick.reliefs.is_empty() {
            of_group = shift.stored(l, active);
        }
        self.sums.stored =
            add_stored::<L, ABSORBS>(l, self.sums.stored, of_group, active, &steep, *way);
    }

    #[inline(always)]
    fn end(self) {
        self.sums.store(self.l, self.packet);
        self.walk.store(self.packet);
        self.packet.active = self.l.bits(self.stopped);
    }
}

/// Adds what stored values make over `way`, in active lanes: by what they make of emission and extinction
/// anywhere in the group, or by the slopes that were met.
#[inline(always)]
fn add_stored<L: Lanes, const ABSORBS: bool>(
    l: L,
    mut sums: [L::Float; 3],
    [emission, extinction]: [L::Float; 2],
    active: L::Mask,
    StorageSlopes { lit, slopes }: &StorageSlopes<L>,
    way: L::Float,
) -> [L::Float; 3] {
    let of_group = [l.mul(emission, *lit), l.mul(extinction, *lit), l.mul(extinction, way)];
    for n in 0..if ABSORBS { 3 } else { 1 } {
        let least = l.min(of_group[n], slopes[n]);
        sums[n] = l.add(sums[n], l.select(active, least, l.splat(0.0)));
    }
    sums
}
