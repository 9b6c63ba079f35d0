//! Folds over overlapping windows of a cube, one axis after another: what a fold takes for each
//! place depends on how much windows overlap along one axis, not along three.

use crate::lanes::{Kernel, Lanes, Width};

/// The first and last place of a window along an axis.
pub(super) type Window = (usize, usize);

/// Windows along each axis; all triples of them are folded over.
pub(super) type Triples = [Vec<Window>; 3];

/// Planes of a cube folded so far, one for each window across them, the plane in hand and a line.
/// Their memory is reused.
#[derive(Debug, Default)]
pub(super) struct Folder<T> {
    plane: Vec<T>,
    folded: Vec<T>,
    line: Vec<T>,
}

impl<T: Copy> Folder<T> {
    /// Most heap bytes for cubes of `side` with so many windows along an axis.
    pub(super) fn bytes(side: usize, windows: usize) -> u64 {
        ((side * (windows + 1) + 1) * side * size_of::<T>()) as u64
    }

    /// Heap bytes held.
    #[cfg(test)]
    pub(super) fn held(&self) -> usize {
        let all = [&self.plane, &self.folded, &self.line];
        all.iter().map(|buffer| buffer.capacity() * size_of::<T>()).sum()
    }

    /// Tells `found`, x fastest, what `fold` makes of all places of each triple of `windows` in a
    /// cube of `side`, beginning from `none`. `plane` writes what is at each place (x, y, z) of a
    /// plane z, x fastest.
    pub(super) fn fold(
        &mut self,
        side: usize,
        windows: &Triples,
        none: T,
        fold: impl Fn(T, T) -> T + Copy,
        plane: impl FnMut(usize, &mut [T]),
        found: impl FnMut(T),
    ) {
        let area = side * side;
        for (buffer, length) in [
            (&mut self.plane, area),
            (&mut self.folded, area * windows[2].len()),
            (&mut self.line, side),
        ] {
            buffer.clear();
            buffer.reserve_exact(length);
            buffer.resize(length, none);
        }
        Width::best().run(Fold { folder: self, side, windows, none, fold, plane, found });
    }
}

/// [`Folder::fold`], compiled for the processor that the lanes are of.
struct Fold<'f, T, F, P, E> {
    folder: &'f mut Folder<T>,
    side: usize,
    windows: &'f Triples,
    none: T,
    fold: F,
    plane: P,
    found: E,
}

impl<T, F, P, E> Kernel for Fold<'_, T, F, P, E>
where
    T: Copy,
    F: Fn(T, T) -> T + Copy,
    P: FnMut(usize, &mut [T]),
    E: FnMut(T),
{
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, _: L) {
        let Self { folder, side, windows, none, fold, mut plane, mut found } = self;
        let Folder { plane: in_hand, folded, line } = folder;
        let area = side * side;
        let deep = windows[2].iter().map(|window| window.1 + 1).max().unwrap_or(0);
        for z in 0..deep {
            plane(z, in_hand);
            for (folded, &(first, last)) in folded.chunks_exact_mut(area).zip(&windows[2]) {
                if (first..=last).contains(&z) {
                    fold_into(folded, in_hand, fold);
                }
            }
        }
        for folded in folded.chunks_exact(area) {
            for &(first, last) in &windows[1] {
                line.fill(none);
                for row in folded[first * side..(last + 1) * side].chunks_exact(side) {
                    fold_into(line, row, fold);
                }
                for &(first, last) in &windows[0] {
                    found(line[first..=last].iter().copied().fold(none, fold));
                }
            }
        }
    }
}

#[inline(always)]
fn fold_into<T: Copy>(all: &mut [T], more: &[T], fold: impl Fn(T, T) -> T) {
    for (all, more) in all.iter_mut().zip(more) {
        *all = fold(*all, *more);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn windows(side: usize) -> impl Strategy<Value = Vec<Window>> {
        let window = (0..side, 0..side).prop_map(|(a, b)| (a.min(b), a.max(b)));
        prop::collection::vec(window, 1..4)
    }

    proptest! {
        #[test]
        fn windows_hold_what_their_places_do(
            windows in [windows(7), windows(7), windows(7)],
            values in prop::collection::vec(prop_oneof![-1.0..1.0_f64, Just(f64::NAN)], 343),
        ) {
            let mut expected = Vec::new();
            for &(z0, z1) in &windows[2] {
                for &(y0, y1) in &windows[1] {
                    for &(x0, x1) in &windows[0] {
                        let mut most = f64::NEG_INFINITY;
                        for place in (z0..=z1).flat_map(|z| {
                            (y0..=y1).flat_map(move |y| (x0..=x1).map(move |x| [x, y, z]))
                        }) {
                            most = most.max(values[(place[2] * 7 + place[1]) * 7 + place[0]]);
                        }
                        expected.push(most);
                    }
                }
            }
            let mut found = Vec::new();
            let mut folder = Folder::default();
            // Twice: what a buffer held before must not matter.
            for _ in 0..2 {
                found.clear();
                folder.fold(
                    7,
                    &windows,
                    f64::NEG_INFINITY,
                    f64::max,
                    |z, plane| plane.copy_from_slice(&values[z * 49..][..49]),
                    |most| found.push(most),
                );
            }
            prop_assert_eq!(&found, &expected);
        }
    }
}
