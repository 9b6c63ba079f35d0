//! What a packet gathers.
#![allow(clippy::needless_range_loop)]

use super::bends::crooked;
use super::blended::{MOST_PARENTS, Part};
use super::cube::Cube;
use super::rows::{load, store};
use super::walk::Walk;
use super::{Ground, Packet};
use crate::render::lanes::Lanes;
use crate::render::transfer_table::TransferTable;

/// Gauss–Legendre nodes on [0, 1]: ½ ∓ 1/√12.
const NODES: [f32; 2] = [0.211_324_87, 0.788_675_1];
/// √3 / 12: what extinction's slope between the nodes adds to the depth at either.
const SLOPE_DEPTH: f32 = 0.144_337_57;
/// Depths from which on no f32 shows light.
const DARK: f32 = 80.0;

/// What rays have gathered.
pub(super) struct Sums<L: Lanes> {
    pub(super) light: [L::Float; 3],
    depth: L::Float,
    thickness: L::Float,
    pub(super) lit: L::Float,
    pub(super) off: [L::Float; 3],
    pub(super) levels: [L::Float; 3],
}

impl<L: Lanes> Sums<L> {
    #[inline(always)]
    pub(super) fn load(l: L, packet: &Packet) -> Self {
        Self {
            light: load(l, &packet.light),
            depth: l.load(&packet.depth),
            thickness: l.load(&packet.thickness),
            lit: l.load(&packet.lit),
            off: load(l, &packet.off),
            levels: load(l, &packet.levels),
        }
    }

    #[inline(always)]
    pub(super) fn store(&self, l: L, packet: &mut Packet) {
        store(l, &self.light, &mut packet.light);
        store(l, &self.off, &mut packet.off);
        store(l, &self.levels, &mut packet.levels);
        l.store(self.depth, &mut packet.depth);
        l.store(self.lit, &mut packet.lit);
    }

    /// Passes `way` through a cell, from t = `from` on; extinction is off by `rate` beside what is
    /// found out here.
    #[inline(always)]
    pub(super) fn pass<const ABSORBS: bool>(
        &mut self,
        l: L,
        ground: &Ground<'_>,
        (cube, part): (&Cube<L>, Option<&Part<L>>),
        walk: &Walk<L>,
        (from, way): (L::Float, L::Float),
        rate: L::Float,
    ) {
        let step = l.mul(way, l.splat((ground.parts as f32).recip()));
        let half = l.mul(step, l.splat(0.5));
        let thickness = l.mul(step, self.thickness);
        let (within, bend, share) = (walk.within(), cube.bend(l), (ground.parts as f32).recip());
        for count in 0..ground.parts {
            let (mut shades, mut values) = ([[half; 4]; 2], [half; 2]);
            let mut blends = [[[half; 2]; MOST_PARENTS]; 2];
            for n in 0..2 {
                let t = l.fma(step, l.splat(count as f32 + NODES[n]), from);
                let place = walk.place(within, t);
                let mut x = cube.at(l, place);
                if let Some(part) = part {
                    (x, blends[n]) = part.at(l, x, place);
                }
                shades[n] = shade::<L, ABSORBS>(l, ground.table, x);
                values[n] = x;
            }
            let [a, b] = shades;
            let (mut weights, mut depths) = ([half; 2], [l.splat(0.0); 2]);
            if ABSORBS {
                let mean = l.mul(thickness, l.mul(l.add(a[3], b[3]), l.splat(0.5)));
                let bend = l.mul(l.mul(thickness, l.sub(b[3], a[3])), l.splat(SLOPE_DEPTH));
                for n in 0..2 {
                    let depth = l.sub(l.fma(mean, l.splat(NODES[n]), self.depth), bend);
                    weights[n] = l.mul(half, through(l, depth));
                }
                self.depth = l.add(self.depth, mean);
                depths = [mean, thickness];
            }
            let mut brightest = l.splat(0.0);
            for c in 0..3 {
                let light = l.fma(weights[0], a[c], l.mul(weights[1], b[c]));
                self.light[c] = l.add(self.light[c], light);
                brightest = l.max(brightest, light);
            }
            let lit = l.add(weights[0], weights[1]);
            self.lit = l.add(self.lit, lit);
            let bend = match part {
                Some(part) => part.bend(l, bend, share, &blends),
                None => bend.along(l, share),
            };
            let [emission, extinction, crooked] =
                crooked::<L, ABSORBS>(l, ground, (values, bend), depths);
            self.off[0] = l.fma(emission, lit, self.off[0]);
            if ABSORBS {
                self.off[1] = l.fma(extinction, lit, self.off[1]);
                self.off[2] = l.fma(extinction, step, self.off[2]);
                // The depth in front of a node is off by up to three times as much.
                let late = l.mul(l.mul(l.add(crooked, rate), thickness), l.splat(3.3));
                self.off[0] = l.fma(late, brightest, self.off[0]);
            }
        }
    }
}

/// Emission and extinction at `x`, relative to the table's.
#[inline(always)]
fn shade<L: Lanes, const ABSORBS: bool>(l: L, table: &TransferTable, x: L::Float) -> [L::Float; 4] {
    let inside = l.min(l.max(x, l.splat(0.0)), l.splat(1.0));
    let place = l.mul(inside, l.splat(TransferTable::LINES));
    let line = l.index(place);
    let rest = l.sub(place, l.floor(place));
    let row = l.gather_row(&table.lines, line);
    let mut channels = [l.splat(0.0); 4];
    for c in 0..if ABSORBS { 4 } else { 3 } {
        channels[c] = l.fma(rest, row[4 + c], row[c]);
    }
    channels
}

/// e^−depth for depths from 0 on, to 3e-7; at most e^−[`DARK`] is nothing.
#[inline(always)]
fn through<L: Lanes>(l: L, depth: L::Float) -> L::Float {
    // 2^f over [0, 1), minimax, to 2e-7.
    const TERMS: [f32; 6] =
        [1.877_576_7e-3, 8.989_34e-3, 5.582_631_8e-2, 2.401_536_1e-1, 6.931_531e-1, 9.999_999_4e-1];
    let exponent = l.mul(l.min(depth, l.splat(DARK)), l.splat(-std::f32::consts::LOG2_E));
    let whole = l.floor(exponent);
    let rest = l.sub(exponent, whole);
    let mut power = l.splat(TERMS[0]);
    for n in 1..TERMS.len() {
        power = l.fma(power, rest, l.splat(TERMS[n]));
    }
    l.mul(power, l.power_of_two(whole))
}
