//! Small things that lanes do with several numbers.
#![allow(clippy::needless_range_loop)]

use crate::lanes::{Lanes, Row};

/// Three rows as numbers in lanes.
#[inline(always)]
pub(super) fn load<L: Lanes>(l: L, rows: &[Row; 3]) -> [L::Float; 3] {
    [l.load(&rows[0]), l.load(&rows[1]), l.load(&rows[2])]
}

/// Writes three numbers in lanes to rows.
#[inline(always)]
pub(super) fn store<L: Lanes>(l: L, values: &[L::Float; 3], rows: &mut [Row; 3]) {
    for a in 0..3 {
        l.store(values[a], &mut rows[a]);
    }
}

/// Where what sets off at `place` in a direction is after a way.
#[inline(always)]
pub(super) fn behind<L: Lanes>(
    l: L,
    mut place: [L::Float; 3],
    direction: [L::Float; 3],
    way: L::Float,
) -> [L::Float; 3] {
    for a in 0..3 {
        place[a] = l.fma(direction[a], way, place[a]);
    }
    place
}

/// Whether a < b; not where either is no number.
#[inline(always)]
pub(super) fn is_less<L: Lanes>(l: L, a: L::Float, b: L::Float) -> L::Mask {
    l.without(l.is_at_most(a, b), l.is_at_most(b, a))
}

/// |a − b|.
#[inline(always)]
pub(super) fn distance<L: Lanes>(l: L, a: L::Float, b: L::Float) -> L::Float {
    let difference = l.sub(a, b);
    l.max(difference, l.sub(b, a))
}
