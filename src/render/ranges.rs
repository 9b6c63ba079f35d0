//! Ranges of a block's values and of their slopes, window by window: one axis after another, whole
//! planes at a time.
#![allow(clippy::needless_range_loop)]

use super::lanes::{Kernel, Lanes, Width};
use super::steepness::Steepness;
use super::windows::{Triples, Window};

/// Of values, and of their steps along each axis.
const PARTS: usize = 4;

/// Smallest and largest of each part at each place: of a plane of the block, and of a line of that.
/// Their memory is reused.
#[derive(Debug, Default)]
pub(super) struct Ranges {
    plane: Vec<f64>,
    line: Vec<f64>,
}

impl Ranges {
    /// Most heap bytes for cubes of `side`.
    pub(super) fn bytes(side: usize) -> u64 {
        (2 * PARTS * (side + 1) * side * size_of::<f64>()) as u64
    }

    /// Heap bytes held.
    #[cfg(test)]
    pub(super) fn held(&self) -> usize {
        (self.plane.capacity() + self.line.capacity()) * size_of::<f64>()
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
        for (buffer, length) in [(&mut self.plane, side * side), (&mut self.line, side)] {
            buffer.clear();
            buffer.reserve_exact(2 * PARTS * length);
            buffer.resize(2 * PARTS * length, 0.0);
        }
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
                    found.push(fold_places(line, side, *window));
                }
            }
        }
    }
}

/// Sets all parts of a buffer to no range.
#[inline(always)]
fn clear(parts: &mut [f64]) {
    parts.fill(f64::NEG_INFINITY);
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
    clear(plane);
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
        less[n] = less[n].max(-values[n]);
        more[n] = more[n].max(values[n]);
    }
}

/// Takes in steps from numbers to others, place by place.
#[inline(always)]
fn take_steps([less, more]: [&mut [f64]; 2], from: &[f64], to: &[f64]) {
    let count = from.len();
    let (less, more, to) = (&mut less[..count], &mut more[..count], &to[..count]);
    for n in 0..count {
        less[n] = less[n].max(from[n] - to[n]);
        more[n] = more[n].max(to[n] - from[n]);
    }
}

#[inline(always)]
fn fold_rows(plane: &[f64], side: usize, (first, last): Window, line: &mut [f64]) {
    clear(line);
    for part in 0..2 * PARTS {
        let most = &mut line[part * side..][..side];
        let end = if part / 2 == 2 { last } else { last + 1 };
        for y in first..end {
            let row = &plane[(part * side + y) * side..][..side];
            for x in 0..side {
                most[x] = most[x].max(row[x]);
            }
        }
    }
}

#[inline(always)]
fn fold_places(line: &[f64], side: usize, (first, last): Window) -> Steepness {
    let mut most = [f64::NEG_INFINITY; 2 * PARTS];
    for part in 0..2 * PARTS {
        let end = if part / 2 == 1 { last } else { last + 1 };
        for x in &line[part * side..][first..end] {
            most[part] = most[part].max(*x);
        }
    }
    let range = |part: usize| [-most[2 * part], most[2 * part + 1]];
    Steepness { values: range(0), slopes: [range(1), range(2), range(3)] }
}
