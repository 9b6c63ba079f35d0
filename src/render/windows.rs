//! Folds over overlapping windows of a cube, one axis after another: what a fold takes for each
//! place depends on how much windows overlap along one axis, not along three.

/// The first and last place of a window along an axis.
pub(super) type Window = (usize, usize);

/// Windows along each axis; all triples of them are folded over.
pub(super) type Triples = [Vec<Window>; 3];

/// One plane of a cube and one line of it, folded so far. Their memory is reused.
#[derive(Debug, Default)]
pub(super) struct Folder<T> {
    row: Vec<T>,
    plane: Vec<T>,
    line: Vec<T>,
}

impl<T: Copy> Folder<T> {
    /// Most heap bytes for cubes of `side` and rows of `PARTS` values a place.
    pub(super) fn bytes<const PARTS: usize>(side: usize) -> u64 {
        ((side + 2) * side * PARTS * size_of::<T>()) as u64
    }

    /// Heap bytes held.
    #[cfg(test)]
    pub(super) fn held(&self) -> usize {
        let all = [&self.row, &self.plane, &self.line];
        all.iter().map(|buffer| buffer.capacity() * size_of::<T>()).sum()
    }

    /// Tells `found`, x fastest, what `fold` makes of all places of each triple of `windows`,
    /// beginning from `none`. `row` writes the `PARTS` values of each place (x, y, z) along x into
    /// a row, part by part.
    pub(super) fn fold<const PARTS: usize>(
        &mut self,
        windows: [&[Window]; 3],
        none: T,
        fold: impl Fn(T, T) -> T + Copy,
        mut row: impl FnMut([usize; 2], &mut [T]),
        mut found: impl FnMut([T; PARTS]),
    ) {
        let [wide, high] = [0, 1].map(|a| windows[a].iter().map(|w| w.1 + 1).max().unwrap_or(0));
        let width = wide * PARTS;
        for (buffer, length) in
            [(&mut self.row, width), (&mut self.plane, width * high), (&mut self.line, width)]
        {
            buffer.clear();
            buffer.reserve_exact(length);
            buffer.resize(length, none);
        }
        for &(first, last) in windows[2] {
            self.plane.fill(none);
            for z in first..=last {
                for y in 0..high {
                    row([y, z], &mut self.row);
                    fold_into(&mut self.plane[y * width..][..width], &self.row, fold);
                }
            }
            for &(first, last) in windows[1] {
                self.line.fill(none);
                for y in first..=last {
                    fold_into(&mut self.line, &self.plane[y * width..][..width], fold);
                }
                for &(first, last) in windows[0] {
                    found(std::array::from_fn(|part| {
                        let places = &self.line[part * wide..][first..=last];
                        places.iter().copied().fold(none, fold)
                    }));
                }
            }
        }
    }
}

#[inline]
fn fold_into<T: Copy>(all: &mut [T], more: &[T], fold: impl Fn(T, T) -> T) {
    for (all, more) in all.iter_mut().zip(more) {
        *all = fold(*all, *more);
    }
}

/// The larger one; of no number the first.
#[inline]
pub(super) fn larger(a: f64, b: f64) -> f64 {
    if b > a { b } else { a }
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
            x in windows(7),
            y in windows(6),
            z in windows(5),
            values in prop::collection::vec(prop_oneof![-1.0..1.0_f64, Just(f64::NAN)], 210),
        ) {
            let at = |x: usize, y: usize, z: usize| values[(z * 6 + y) * 7 + x];
            let mut expected = Vec::new();
            for &(z0, z1) in &z {
                for &(y0, y1) in &y {
                    for &(x0, x1) in &x {
                        let mut range = [f64::NEG_INFINITY; 2];
                        for place in (z0..=z1).flat_map(|z| {
                            (y0..=y1).flat_map(move |y| (x0..=x1).map(move |x| [x, y, z]))
                        }) {
                            let value = at(place[0], place[1], place[2]);
                            range = [larger(range[0], value), larger(range[1], -value)];
                        }
                        expected.push(range);
                    }
                }
            }
            let mut found = Vec::new();
            let mut folder = Folder::default();
            // Twice: what a buffer held before must not matter.
            for _ in 0..2 {
                found.clear();
                folder.fold(
                    [&x, &y, &z],
                    f64::NEG_INFINITY,
                    larger,
                    |[y, z], row| {
                        let half = row.len() / 2;
                        for x in 0..half {
                            (row[x], row[half + x]) = (at(x, y, z), -at(x, y, z));
                        }
                    },
                    |range: [f64; 2]| found.push(range),
                );
            }
            prop_assert_eq!(found, expected);
        }
    }
}
