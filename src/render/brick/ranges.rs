//! Ranges of a block's values and of their slopes, window by window: one axis after another, whole
//! planes at a time.
#![allow(clippy::needless_range_loop)]

use super::steepness::Steepness;
use super::windows::{Triples, Window};
use crate::lanes::{Kernel, Lanes, Width};

/// Of values, and of their steps along each axis.
const PARTS: usize = 4;
/// Numbers at each place: smallest, with their signs turned, and largest of each part.
const NUMBERS: usize = 2 * PARTS;
/// Places that are folded together.
const ABREAST: usize = 4;

/// Places of a row, with room for some that are folded with the last.
const fn padded_row(side: usize) -> usize {
    side.next_multiple_of(ABREAST)
}

/// Places of a plane, likewise, from any row's last on.
const fn padded(side: usize) -> usize {
    (side * side).next_multiple_of(ABREAST) + ABREAST
}

/// Smallest and largest of each part at each place: of a plane of the block, number by number, and of
/// a line of that, place by place. Their memory is reused.
#[derive(Debug, Default)]
pub(super) struct Ranges {
    plane: Vec<f64>,
    line: Vec<[f64; NUMBERS]>,
}

impl Ranges {
    /// Most heap bytes for cubes of `side`.
    pub(super) fn bytes(side: usize) -> u64 {
        (NUMBERS * (padded(side) + padded_row(side)) * size_of::<f64>()) as u64
    }

    /// Heap bytes held.
    #[cfg(test)]
    pub(super) fn held(&self) -> usize {
        (self.plane.capacity() + NUMBERS * self.line.capacity()) * size_of::<f64>()
    }

    /// Adds to `found`, x fastest, what holds in each triple of `windows` of a cube of `values`:
    /// their range, and that of the steps between neighbours of which both are in the window. What
    /// is no number does not count.
    pub(super) fn find(
        &mut self,
        values: &[f64],
        side: usize,
        windows: &Triples,
        found: &mut Vec<Steepness>,
    ) {
        let (length, Self { plane, line }) = (NUMBERS * padded(side), &mut *self);
        plane.clear();
        plane.reserve_exact(length);
        plane.resize(length, 0.0);
        line.clear();
        line.reserve_exact(padded_row(side));
        line.resize(padded_row(side), [0.0; NUMBERS]);
        Width::best().run(Search { values, side, windows, buffers: self, found });
    }
}

/// The search for ranges.
struct Search<'s> {
    values: &'s [f64],
    side: usize,
    windows: &'s Triples,
    buffers: &'s mut Ranges,
    found: &'s mut Vec<Steepness>,
}

impl Kernel for Search<'_> {
    type Output = ();

    // Plain loops, compiled for the processor that the lanes are of.
    #[inline(always)]
    fn run<L: Lanes>(self, _: L) {
        let Self { values, side, windows: [along_x, along_y, along_z], buffers, found } = self;
        let Ranges { plane, line } = buffers;
        for window in along_z {
            fold_planes(values, side, *window, plane);
            for window in along_y {
                fold_rows(plane, side, *window, line);
                for window in along_x {
                    found.push(fold_places(line, *window));
                }
            }
        }
    }
}

/// The larger of what was found and a number; what is no number does not count. (`max` asks that of
/// both, which takes four instructions for one.)
#[inline(always)]
pub(super) fn larger(most: f64, x: f64) -> f64 {
    if x > most { x } else { most }
}

/// Raises each of `most` to a number, where that is larger.
///
/// `most` is for registers: of what lies in memory compilers write only what changes, under a mask,
/// for which many processors with AVX2 take ten times as long as for writing all.
#[inline(always)]
fn raise(most: &mut [f64; ABREAST], numbers: [f64; ABREAST]) {
    for n in 0..ABREAST {
        most[n] = larger(most[n], numbers[n]);
    }
}

/// Numbers from place `first` on, all of which there are.
#[inline(always)]
fn whole(numbers: &[f64], first: usize) -> [f64; ABREAST] {
    let numbers = &numbers[first..first + ABREAST];
    std::array::from_fn(|n| numbers[n])
}

/// Numbers from place `first` on; beyond the last what is none.
#[inline(always)]
fn partly(numbers: &[f64], first: usize) -> [f64; ABREAST] {
    std::array::from_fn(|n| numbers.get(first + n).copied().unwrap_or(f64::NAN))
}

/// Of each part the smallest, with their signs turned, and the largest over planes, place by place.
#[inline(always)]
fn fold_planes(values: &[f64], side: usize, window: Window, plane: &mut [f64]) {
    let (area, length) = (side * side, padded(side));
    for place in (0..area).step_by(ABREAST) {
        let end = window.1 * area + place + side + ABREAST;
        let most = if end <= values.len() {
            fold_place(side, window, place, |at| whole(values, at))
        } else {
            fold_place(side, window, place, |at| partly(values, at))
        };
        for number in 0..NUMBERS {
            plane[number * length + place..][..ABREAST].copy_from_slice(&most[number]);
        }
    }
}

/// What [`fold_planes`] finds from `place` on, where `abreast` tells the values from some place on.
#[inline(always)]
fn fold_place(
    side: usize,
    (first, last): Window,
    place: usize,
    abreast: impl Fn(usize) -> [f64; ABREAST],
) -> [[f64; ABREAST]; NUMBERS] {
    let area = side * side;
    let mut most = [[f64::NEG_INFINITY; ABREAST]; NUMBERS];
    for z in first..=last {
        let at = z * area + place;
        let here = abreast(at);
        raise(&mut most[0], here.map(|value| -value));
        raise(&mut most[1], here);
        for axis in 0..if z < last { 3 } else { 2 } {
            // Steps from a row's, or the plane's, last place are no steps, and no window has them.
            let beyond = abreast(at + [1, side, area][axis]);
            raise(&mut most[2 + 2 * axis], std::array::from_fn(|n| here[n] - beyond[n]));
            raise(&mut most[3 + 2 * axis], std::array::from_fn(|n| beyond[n] - here[n]));
        }
    }
    most
}

/// Of each number the largest over rows, place by place.
#[inline(always)]
fn fold_rows(plane: &[f64], side: usize, (first, last): Window, line: &mut [[f64; NUMBERS]]) {
    let (places, _) = line.as_chunks_mut::<ABREAST>();
    for number in 0..NUMBERS {
        let rows = &plane[number * padded(side)..][..padded(side)];
        let end = if number / 2 == 2 { last } else { last + 1 };
        for (chunk, places) in places.iter_mut().enumerate() {
            let mut most = [f64::NEG_INFINITY; ABREAST];
            for y in first..end {
                raise(&mut most, whole(rows, y * side + chunk * ABREAST));
            }
            for n in 0..ABREAST {
                places[n][number] = most[n];
            }
        }
    }
}

#[inline(always)]
fn fold_places(line: &[[f64; NUMBERS]], (first, last): Window) -> Steepness {
    let mut most = [f64::NEG_INFINITY; NUMBERS];
    for place in &line[first..last] {
        for n in 0..NUMBERS {
            most[n] = larger(most[n], place[n]);
        }
    }
    for n in 0..NUMBERS {
        // Steps from the last place lead out of the window.
        if n / 2 != 1 {
            most[n] = larger(most[n], line[last][n]);
        }
    }
    let range = |part: usize| [-most[2 * part], most[2 * part + 1]];
    Steepness { values: range(0), slopes: [range(1), range(2), range(3)] }
}
