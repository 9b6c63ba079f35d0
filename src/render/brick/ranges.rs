//! Ranges of a block's values and of their slopes, window by window: one axis after another, whole
//! planes at a time.

use super::steepness::Steepness;
use super::windows::{Triples, Window};
use crate::lanes::{Kernel, Lanes, Width};

/// Of values, and of their steps along each axis.
const PARTS: usize = 4;
/// The parts that are steps.
const ALONG_X: usize = 1;
const ALONG_Y: usize = 2;
const ALONG_Z: usize = 3;
/// Places that are folded together, as many as lanes hold doubles.
const ABREAST: usize = 4;

/// Of each part the smallest and the largest, at places abreast of each other.
type Abreast = [[[f64; ABREAST]; 2]; PARTS];

/// At a place: the smallest of each part, and the largest of each.
type Place = [[f64; PARTS]; 2];

/// Smallest and largest of each part at each place of a plane of the block, row by row, and of a line
/// of that; both with room for places beyond a row's last. Their memory is reused.
#[derive(Debug, Default)]
pub(super) struct Ranges {
    plane: Vec<Abreast>,
    line: Vec<Place>,
}

impl Ranges {
    /// Most heap bytes for cubes of `side`.
    pub(super) fn bytes(side: usize) -> u64 {
        let abreast = side.div_ceil(ABREAST);
        (abreast * (side * size_of::<Abreast>() + ABREAST * size_of::<Place>())) as u64
    }

    /// Heap bytes held.
    #[cfg(test)]
    pub(super) fn held(&self) -> usize {
        self.plane.capacity() * size_of::<Abreast>() + self.line.capacity() * size_of::<Place>()
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
        let abreast = side.div_ceil(ABREAST);
        self.plane.clear();
        self.plane.reserve_exact(abreast * side);
        self.plane.resize(abreast * side, Default::default());
        self.line.clear();
        self.line.reserve_exact(abreast * ABREAST);
        self.line.resize(abreast * ABREAST, Default::default());
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

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let Self { values, side, windows: [along_x, along_y, along_z], buffers, found } = self;
        let Ranges { plane, line } = buffers;
        for window in along_z {
            fold_planes(l, values, side, *window, plane);
            for window in along_y {
                fold_rows(l, plane, side, *window, line);
                for window in along_x {
                    found.push(fold_places(l, line, *window));
                }
            }
        }
    }
}

/// The smallest and the largest of what four places have; what is no number does not count.
#[derive(Clone, Copy)]
struct Range<L: Lanes>([L::Doubles; 2]);

impl<L: Lanes> Range<L> {
    /// Of nothing.
    #[inline(always)]
    fn none(l: L) -> Self {
        Self([f64::INFINITY, f64::NEG_INFINITY].map(|x| l.doubles(&[x; ABREAST])))
    }

    /// Takes in numbers.
    #[inline(always)]
    fn take(&mut self, l: L, numbers: L::Doubles) {
        self.join(l, [numbers; 2]);
    }

    /// Takes in ranges.
    #[inline(always)]
    fn join(&mut self, l: L, [least, most]: [L::Doubles; 2]) {
        self.0 = [l.min_doubles(least, self.0[0]), l.max_doubles(most, self.0[1])];
    }

    #[inline(always)]
    fn numbers(self, l: L) -> [[f64; ABREAST]; 2] {
        self.0.map(|numbers| l.of_doubles(numbers))
    }
}

/// Of each part the smallest and the largest over planes, place by place.
#[inline(always)]
fn fold_planes<L: Lanes>(
    l: L,
    values: &[f64],
    side: usize,
    (first, last): Window,
    plane: &mut [Abreast],
) {
    let area = side * side;
    for (y, row) in plane.chunks_exact_mut(side.div_ceil(ABREAST)).enumerate() {
        for (place, abreast) in (y * side..).step_by(ABREAST).zip(row) {
            let mut ranges = [Range::none(l); PARTS];
            let mut at = first * area + place;
            let mut here = l.doubles_at(values, at);
            for z in first..=last {
                ranges[0].take(l, here);
                // Steps from a row's, or the plane's, last place are no steps, and no window has them.
                ranges[ALONG_X].take(l, l.sub_doubles(l.doubles_at(values, at + 1), here));
                ranges[ALONG_Y].take(l, l.sub_doubles(l.doubles_at(values, at + side), here));
                if z < last {
                    at += area;
                    let next = l.doubles_at(values, at);
                    ranges[ALONG_Z].take(l, l.sub_doubles(next, here));
                    here = next;
                }
            }
            *abreast = ranges.map(|range| range.numbers(l));
        }
    }
}

/// Of each part the smallest and the largest over rows, place by place.
#[inline(always)]
fn fold_rows<L: Lanes>(
    l: L,
    plane: &[Abreast],
    side: usize,
    (first, last): Window,
    line: &mut [Place],
) {
    let (places, _) = line.as_chunks_mut::<ABREAST>();
    let count = side.div_ceil(ABREAST);
    for (number, places) in places.iter_mut().enumerate() {
        let column = &plane[first * count + number..=last * count + number];
        let mut ranges = [Range::none(l); PARTS];
        for (y, abreast) in column.iter().step_by(count).enumerate() {
            for (part, (range, ends)) in ranges.iter_mut().zip(abreast).enumerate() {
                // Steps from the last row lead out of the window.
                if part != ALONG_Y || first + y < last {
                    range.join(l, ends.each_ref().map(|end| l.doubles(end)));
                }
            }
        }
        for (part, range) in ranges.into_iter().enumerate() {
            let [least, most] = range.numbers(l);
            for (n, place) in places.iter_mut().enumerate() {
                (place[0][part], place[1][part]) = (least[n], most[n]);
            }
        }
    }
}

/// What holds for the places of a line in a window.
#[inline(always)]
fn fold_places<L: Lanes>(l: L, line: &[Place], (first, last): Window) -> Steepness {
    let mut range = Range::none(l);
    for [least, most] in &line[first..last] {
        range.join(l, [l.doubles(least), l.doubles(most)]);
    }
    // Steps from the last place lead out of the window.
    let [mut least, mut most] = line[last];
    (least[ALONG_X], most[ALONG_X]) = (f64::NAN, f64::NAN);
    range.join(l, [l.doubles(&least), l.doubles(&most)]);
    let [least, most] = range.numbers(l);
    let of = |part: usize| [least[part], most[part]];
    Steepness { values: of(0), slopes: [ALONG_X, ALONG_Y, ALONG_Z].map(of) }
}
