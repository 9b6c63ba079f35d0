//! What the transfer function's table says at a place, and how much light comes through a depth.
#![allow(clippy::needless_range_loop)]

use super::rows::distance;
use crate::lanes::Lanes;
use crate::render::transfer::table::TransferTable;

/// Depths from which on no f32 shows light.
pub(super) const DARK: f32 = 80.0;

/// Emission and extinction at `x`, relative to the table's.
#[inline(always)]
pub(super) fn shade<L: Lanes, const ABSORBS: bool>(
    l: L,
    table: &TransferTable,
    x: L::Float,
) -> [L::Float; 4] {
    let inside = l.min(l.max(x, l.splat(0.0)), l.splat(1.0));
    let place = l.mul(inside, l.splat(TransferTable::BINS));
    let bin = l.floor(place);
    let rest = l.sub(place, bin);
    let bin = l.index(bin);
    let mut row = l.gather_row(&table.lines, bin);
    let has_corner = l.has_sign(row[3]);
    row[3] = distance(l, row[3], l.splat(0.0));
    // Few bins have corners: others do not wait to hear where these are.
    if l.bits(has_corner) != 0 {
        let is_behind = l.is_at_most(l.gather(&table.corners, bin, 0), rest);
        let behind = l.gather_row(&table.behind, bin);
        for c in 0..8 {
            row[c] = l.select(is_behind, behind[c], row[c]);
        }
    }
    let mut channels = [l.splat(0.0); 4];
    for c in 0..if ABSORBS { 4 } else { 3 } {
        channels[c] = l.fma(rest, row[4 + c], row[c]);
    }
    channels
}

/// e^−depth for depths from 0 on, to 3e-7; at most e^−[`DARK`] is nothing.
#[inline(always)]
pub(super) fn through<L: Lanes>(l: L, depth: L::Float) -> L::Float {
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
