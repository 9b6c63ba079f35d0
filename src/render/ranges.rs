//! Ranges of a block's values and of their slopes, window by window: one axis after another, whole
//! planes at a time.
#![allow(clippy::needless_range_loop)]

use super::lanes::{Kernel, Lanes, Width};
use super::steepness::Steepness;
use super::windows::{Triples, Window};
use crate::cache::BrickShape;

/// Of values, and of their steps along each axis.
const PARTS: usize = 4;
/// Numbers at each place: smallest, with their signs turned, and largest of each part.
const NUMBERS: usize = 2 * PARTS;

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
        (NUMBERS * (side + 1) * side * size_of::<f64>()) as u64
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
        (values, side): (&[f64], usize),
        windows: &Triples,
        found: &mut Vec<Steepness>,
    ) {
        let (area, Self { plane, line }) = (side * side, &mut *self);
        plane.clear();
        plane.reserve_exact(NUMBERS * area);
        plane.resize(NUMBERS * area, 0.0);
        line.clear();
        line.reserve_exact(side);
        line.resize(side, [0.0; NUMBERS]);
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

/// The largest of a part's numbers with their signs turned, and as they are.
#[inline(always)]
fn of_part(parts: &mut [f64], length: usize, part: usize) -> [&mut [f64]; 2] {
    let (less, more) = parts[2 * part * length..][..2 * length].split_at_mut(length);
    [less, more]
}

#[inline(always)]
fn fold_planes(values: &[f64], side: usize, (first, last): Window, plane: &mut [f64]) {
    let area = side * side;
    plane.fill(f64::NEG_INFINITY);
    for z in first..=last {
        let here = &values[z * area..];
        take_values(of_part(plane, area, 0), &here[..area]);
        for axis in 0..if z < last { 3 } else { 2 } {
            // Steps from a row's, or the plane's, last place are no steps, and no window has them.
            let beyond = &here[[1, side, area][axis]..];
            let count = area.min(beyond.len());
            take_steps(of_part(plane, area, 1 + axis), &here[..count], &beyond[..count]);
        }
    }
}

/// Takes in numbers, place by place.
#[inline(always)]
fn take_values([less, more]: [&mut [f64]; 2], values: &[f64]) {
    let count = values.len();
    let (less, more) = (&mut less[..count], &mut more[..count]);
    for n in 0..count {
        less[n] = larger(less[n], -values[n]);
        more[n] = larger(more[n], values[n]);
    }
}

/// Takes in steps from numbers to others, place by place.
#[inline(always)]
fn take_steps([less, more]: [&mut [f64]; 2], from: &[f64], to: &[f64]) {
    let count = from.len();
    let (less, more, to) = (&mut less[..count], &mut more[..count], &to[..count]);
    for n in 0..count {
        let step = to[n] - from[n];
        less[n] = larger(less[n], -step);
        more[n] = larger(more[n], step);
    }
}

#[inline(always)]
fn fold_rows(plane: &[f64], side: usize, (first, last): Window, line: &mut [[f64; NUMBERS]]) {
    let mut buffer = [0.0; BrickShape::MOST_CELLS + 2];
    let most = &mut buffer[..side];
    for number in 0..NUMBERS {
        most.fill(f64::NEG_INFINITY);
        let end = if number / 2 == 2 { last } else { last + 1 };
        for y in first..end {
            let row = &plane[(number * side + y) * side..][..side];
            for x in 0..side {
                most[x] = larger(most[x], row[x]);
            }
        }
        for x in 0..side {
            line[x][number] = most[x];
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
