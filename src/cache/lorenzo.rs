//! The Lorenzo predictor (Ibarria, Lindstrom, Rossignac and Szymczak, *Computer Graphics Forum* 22, 343,
//! 2003): each number of a cube of cells is replaced by its difference from a prediction, and back. In
//! smooth data most differences are small, in whatever digits the numbers are.
//!
//! The prediction is the sum of the three preceding neighbours across faces, less the three across edges,
//! plus the one across the corner; beyond the cube all are 0. So the differences are first differences
//! along x, then y, then z, and running sums along each axis undo them. The caller says how to add and
//! subtract; both must wrap around.

/// Makes differences of the numbers of a cube of `side`³ cells, x fastest.
#[inline(always)]
pub(super) fn differences(
    numbers: &mut [u32],
    side: usize,
    subtract: impl Fn(u32, u32) -> u32 + Copy,
) {
    subtract_chunks(numbers, side * side, subtract);
    for plane in numbers.chunks_exact_mut(side * side) {
        subtract_chunks(plane, side, subtract);
        for row in plane.chunks_exact_mut(side) {
            for at in (1..row.len()).rev() {
                row[at] = subtract(row[at], row[at - 1]);
            }
        }
    }
}

/// Subtracts from each of the chunks of `length` numbers the one before it.
#[inline(always)]
fn subtract_chunks(numbers: &mut [u32], length: usize, subtract: impl Fn(u32, u32) -> u32) {
    for start in (length..numbers.len()).step_by(length).rev() {
        let (before, from) = numbers.split_at_mut(start);
        for (number, before) in from[..length].iter_mut().zip(&before[start - length..]) {
            *number = subtract(*number, *before);
        }
    }
}

/// Takes back [`differences`].
#[inline(always)]
pub(super) fn sums(numbers: &mut [u32], side: usize, add: impl Fn(u32, u32) -> u32 + Copy) {
    for plane in numbers.chunks_exact_mut(side * side) {
        for row in plane.chunks_exact_mut(side) {
            let mut sum = 0;
            for number in row {
                sum = add(sum, *number);
                *number = sum;
            }
        }
        add_chunks(plane, side, add);
    }
    add_chunks(numbers, side * side, add);
}

/// Adds to each of the chunks of `length` numbers the one before it.
#[inline(always)]
fn add_chunks(numbers: &mut [u32], length: usize, add: impl Fn(u32, u32) -> u32) {
    for start in (length..numbers.len()).step_by(length) {
        let (before, from) = numbers.split_at_mut(start);
        for (number, before) in from[..length].iter_mut().zip(&before[start - length..]) {
            *number = add(*number, *before);
        }
    }
}

/// Gives the cells of a cube of `side`³ that have no number that of a cell nearby, so that differences
/// are small there: of the one before in the row, else the first that has one; rows without any are like
/// the row before, and planes likewise.
pub(super) fn fill(numbers: &mut [u32], side: usize, has_number: impl Fn(usize) -> bool) {
    let has_any = |mut cells: std::ops::Range<usize>| cells.any(&has_number);
    if (0..numbers.len()).all(&has_number) {
        return;
    }
    let area = side * side;
    for (row, numbers) in numbers.chunks_exact_mut(side).enumerate() {
        spread(numbers, 1, |x| has_number(side * row + x));
    }
    for (z, plane) in numbers.chunks_exact_mut(area).enumerate() {
        spread(plane, side, |y| has_any(area * z + side * y..area * z + side * (y + 1)));
    }
    spread(numbers, area, |z| has_any(area * z..area * (z + 1)));
}

/// Copies chunks of `length` numbers that are known to those behind them that are not, and the first of
/// them to those before it.
fn spread(numbers: &mut [u32], length: usize, is_known: impl Fn(usize) -> bool) {
    let count = numbers.len() / length;
    let Some(mut last) = (0..count).find(|chunk| is_known(*chunk)) else { return };
    for chunk in 0..count {
        if is_known(chunk) {
            last = chunk;
        } else {
            numbers.copy_within(length * last..length * (last + 1), length * chunk);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_from_predictions_and_sums_take_them_back() {
        for side in [1_usize, 2, 3, 4, 6, 10, 18, 34] {
            let noise = |n: usize| (n as u32).wrapping_mul(0x9e37_79b9);
            let numbers: Vec<u32> = (0..side.pow(3)).map(noise).collect();
            let before = |cell: [usize; 3], back: [usize; 3]| {
                let [x, y, z] = [0, 1, 2].map(|axis| cell[axis].checked_sub(back[axis]));
                let (Some(x), Some(y), Some(z)) = (x, y, z) else { return 0 };
                i64::from(numbers[(z * side + y) * side + x])
            };
            let mut found = numbers.clone();
            differences(&mut found, side, u32::wrapping_sub);
            for (at, found) in found.iter().enumerate() {
                let cell = [at % side, at / side % side, at / side / side];
                let of = |back| before(cell, back);
                let faces = of([1, 0, 0]) + of([0, 1, 0]) + of([0, 0, 1]);
                let edges = of([1, 1, 0]) + of([1, 0, 1]) + of([0, 1, 1]);
                let predicted = faces - edges + of([1, 1, 1]);
                assert_eq!(*found, (of([0; 3]) - predicted) as u32, "{cell:?} of {side}³");
            }
            sums(&mut found, side, u32::wrapping_add);
            assert_eq!(found, numbers);
        }
    }

    #[test]
    fn cells_without_numbers_take_those_of_cells_nearby() {
        const SIDE: usize = 3;
        // One plane without any, one with a single cell, one with holes in a row and an empty row.
        let has_number = |at: usize| match at / 9 {
            0 => false,
            1 => at == 9 + 4,
            _ => ![18, 20].contains(&at) && at / 3 != 7,
        };
        let mut numbers: Vec<u32> = (0..27).collect();
        fill(&mut numbers, SIDE, has_number);
        assert_eq!(numbers[..18], [13; 18]);
        assert_eq!(numbers[18..], [19, 19, 19, 19, 19, 19, 24, 25, 26]);
        let mut all: Vec<u32> = (0..27).collect();
        fill(&mut all, SIDE, |_| true);
        assert!(all.iter().zip(0..).all(|(found, at)| *found == at));
        fill(&mut all, SIDE, |_| false);
        assert!(all.iter().zip(0..).all(|(found, at)| *found == at));
    }
}
