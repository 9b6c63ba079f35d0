//! The order of a tile's pixels.

use std::ops::Range;

use super::rays::PixelRect;

/// Edge of the blocks that a tile's pixels are ordered by: rays of one go side by side.
pub(crate) const BLOCK: u32 = 4;

/// The order of a rectangle's pixels: in strips of [`BLOCK`] rows, in these block by block, in a
/// block row by row. Neighbours in it are close in both directions, so that their rays meet the same
/// cells.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct PixelOrder {
    width: u32,
    height: u32,
}

impl PixelOrder {
    /// The order of the pixels of `rect`.
    pub(crate) fn of(rect: &PixelRect) -> Self {
        let [width, height] = std::array::from_fn(|a| rect.hi[a].saturating_sub(rect.lo[a]));
        Self { width, height }
    }

    /// Pixels of a row.
    pub(crate) fn width(&self) -> u32 {
        self.width
    }

    /// Number of rows.
    pub(crate) fn height(&self) -> u32 {
        self.height
    }

    /// Rows of the strip with row `y`.
    fn rows(&self, y: u32) -> u32 {
        BLOCK.min(self.height - y / BLOCK * BLOCK)
    }

    /// The number of the pixel in column `x` and row `y`, if the rectangle has it.
    pub(crate) fn number(&self, [x, y]: [u32; 2]) -> Option<usize> {
        let [column, row] = [x, y].map(|n| n / BLOCK * BLOCK);
        let number = |columns: u32, rows: u32| {
            row * self.width + column * rows + (y - row) * columns + (x - column)
        };
        let is_inside = x < self.width && y < self.height;
        is_inside.then(|| number(BLOCK.min(self.width - column), self.rows(y)) as usize)
    }

    /// The number of the pixel so many columns and rows from the one at `place`, if the rectangle has
    /// it.
    pub(crate) fn beside(&self, place: [u32; 2], steps: [i32; 2]) -> Option<usize> {
        let [x, y] = std::array::from_fn(|a| place[a].checked_add_signed(steps[a]));
        self.number([x?, y?])
    }

    /// The column and row of a pixel.
    pub(crate) fn place(&self, number: usize) -> [u32; 2] {
        let number = u32::try_from(number).unwrap_or(u32::MAX);
        let row = number / (BLOCK * self.width) * BLOCK;
        let in_strip = number - row * self.width;
        let column = in_strip / (BLOCK * self.rows(row)) * BLOCK;
        let in_block = in_strip - column * self.rows(row);
        let columns = BLOCK.min(self.width - column);
        [column + in_block % columns, row + in_block / columns]
    }

    /// The numbers, strip by strip, of the pixels in all blocks that have some in these columns and
    /// rows of the rectangle.
    pub(crate) fn strips(
        self,
        columns: Range<u32>,
        rows: Range<u32>,
    ) -> impl Iterator<Item = Range<usize>> {
        let strips = rows.start / BLOCK..rows.end.div_ceil(BLOCK);
        let first = columns.start / BLOCK * BLOCK;
        let end = columns.end.div_ceil(BLOCK).saturating_mul(BLOCK).min(self.width).max(first);
        strips.map(move |strip| {
            let row = strip * BLOCK;
            let number = |x: u32| (row * self.width + x * self.rows(row)) as usize;
            number(first)..number(end)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_are_ordered_block_by_block() {
        for (width, height) in [(64, 64), (64, 3), (5, 9), (1, 1), (3, 64), (31, 22)] {
            let order = PixelOrder { width, height };
            let count = (width * height) as usize;
            let mut seen = vec![false; count];
            for number in 0..count {
                let [x, y] = order.place(number);
                assert!(x < width && y < height);
                assert_eq!(order.number([x, y]), Some(number));
                seen[(y * width + x) as usize] = true;
            }
            assert!(seen.iter().all(|seen| *seen));
            let (columns, rows) = (width / 3..width / 2 + 1, height / 2..height);
            let numbers: Vec<_> = order.strips(columns.clone(), rows.clone()).flatten().collect();
            assert!(numbers.is_sorted());
            for number in 0..count {
                let [x, y] = order.place(number).map(|n| n / BLOCK);
                let meets = |n, range: &Range<u32>| {
                    (range.start / BLOCK..range.end.div_ceil(BLOCK)).contains(&n)
                };
                let is_among = meets(x, &columns) && meets(y, &rows);
                assert_eq!(numbers.binary_search(&number).is_ok(), is_among);
            }
        }
        let order = PixelOrder { width: 9, height: 7 };
        assert_eq!(
            [0, 3, 4, 16, 17, 32, 36].map(|n| order.place(n))[..5],
            [[0, 0], [3, 0], [0, 1], [4, 0], [5, 0]]
        );
        assert!(order.strips(5..6, 0..1).eq(std::iter::once(16..32)));
    }
}
