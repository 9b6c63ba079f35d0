//! Arrays of plain numbers in files, read in blocks.

use super::GridBlock;
use super::open_file::OpenFile;
use crate::{Error, Result};

/// Rows that lie no further apart than this are read together: disks and caches deal in pages.
const LARGEST_GAP: u64 = 4096;
/// Most bytes of a read, unless a single row has more: they stay in a core's cache until they are
/// decoded.
const LARGEST_READ: u64 = 128 << 10;

/// How a number is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Number {
    /// 32-bit float, little-endian.
    F32Little,
    /// 32-bit float, big-endian.
    F32Big,
    /// 64-bit float, little-endian.
    F64Little,
    /// 64-bit float, big-endian.
    F64Big,
}

impl Number {
    /// Bytes of one number.
    pub(super) fn bytes(self) -> u64 {
        match self {
            Self::F32Little | Self::F32Big => 4,
            Self::F64Little | Self::F64Big => 8,
        }
    }

    /// Widens a number of every `stride` bytes of `bytes` into `out`.
    fn decode(self, bytes: &[u8], stride: usize, out: &mut [f64]) {
        match self {
            Self::F32Little => decode_with(bytes, stride, out, |b| f32::from_le_bytes(b).into()),
            Self::F32Big => decode_with(bytes, stride, out, |b| f32::from_be_bytes(b).into()),
            Self::F64Little => decode_with(bytes, stride, out, f64::from_le_bytes),
            Self::F64Big => decode_with(bytes, stride, out, f64::from_be_bytes),
        }
    }
}

/// [`Number::decode`] for one way of storing numbers, so that the loop has no choices.
fn decode_with<const N: usize>(
    bytes: &[u8],
    stride: usize,
    out: &mut [f64],
    number: impl Fn([u8; N]) -> f64,
) {
    if stride == N {
        // Of a length that the compiler knows, which is several times as fast.
        for (value, stored) in out.iter_mut().zip(bytes.as_chunks().0) {
            *value = number(*stored);
        }
        return;
    }
    for (value, cell) in out.iter_mut().zip(bytes.chunks(stride)) {
        if let Some(stored) = cell.first_chunk() {
            *value = number(*stored);
        }
    }
}

/// A three-dimensional array in a file, x fastest, of cells of one or more numbers.
#[derive(Debug, Clone, Copy)]
pub(super) struct RawArray {
    /// Where the first cell stands in the file, bytes.
    pub(super) start: u64,
    /// Cells along x, y, z.
    pub(super) shape: [u64; 3],
    /// How numbers are stored.
    pub(super) number: Number,
    /// Numbers of a cell, which stand side by side.
    pub(super) per_cell: u64,
    /// Which of a cell's numbers is read.
    pub(super) component: u64,
}

impl RawArray {
    /// Where the array ends in the file, if that is a number of 64 bits.
    pub(super) fn end(&self) -> Option<u64> {
        let cells = self.shape.iter().try_fold(1u64, |n, &extent| n.checked_mul(extent))?;
        cells.checked_mul(self.cell_bytes()?)?.checked_add(self.start)
    }

    fn cell_bytes(&self) -> Option<u64> {
        self.per_cell.checked_mul(self.number.bytes())
    }

    /// Reads the cells of `block` (in the array's indices) of `file` into `out`. Only rows of the
    /// block are read, with what lies between them where that is little.
    ///
    /// # Errors
    /// A block that is not inside the array, an array that is not inside the file, and whatever
    /// the operating system refuses.
    pub(super) fn read(&self, file: &OpenFile, block: GridBlock, out: &mut [f64]) -> Result<()> {
        self.check(file, block, out)?;
        let cell = self.per_cell * self.number.bytes();
        let row = u64::from(block.size[0]);
        let count = u64::from(block.size[1]) * u64::from(block.size[2]);
        let (mut bytes, mut out) = (Vec::new(), out.chunks_exact_mut(row as usize));
        let mut next = 0;
        while next < count {
            let first = self.row_start(block, next);
            let rows = self.rows_together(block, next, count);
            let cells = self.row_start(block, next + rows - 1) + row - first;
            bytes.resize((cells * cell) as usize, 0);
            file.read_exact_at(&mut bytes, self.start + first * cell)?;
            for (row, out) in (next..next + rows).zip(&mut out) {
                let at = (self.row_start(block, row) - first) * cell;
                let at = at + self.component * self.number.bytes();
                self.number.decode(&bytes[at as usize..], cell as usize, out);
            }
            next += rows;
        }
        Ok(())
    }

    /// The array's number of the first cell of row `row` of `block`.
    fn row_start(&self, block: GridBlock, row: u64) -> u64 {
        let [x, y, z] = block.lo.map(u64::from);
        let rows = u64::from(block.size[1]);
        ((z + row / rows) * self.shape[1] + y + row % rows) * self.shape[0] + x
    }

    /// How many of the `count` rows of `block`, from row `first`, one read takes.
    fn rows_together(&self, block: GridBlock, first: u64, count: u64) -> u64 {
        let cell = self.per_cell * self.number.bytes();
        let (start, row) = (self.row_start(block, first), u64::from(block.size[0]));
        let mut last = first;
        while last + 1 < count {
            let next = self.row_start(block, last + 1);
            let gap = next - self.row_start(block, last) - row;
            if gap * cell > LARGEST_GAP || (next + row - start) * cell > LARGEST_READ {
                break;
            }
            last += 1;
        }
        last + 1 - first
    }

    fn check(&self, file: &OpenFile, block: GridBlock, out: &[f64]) -> Result<()> {
        let inside = (0..3).all(|a| {
            u64::from(block.lo[a]) + u64::from(block.size[a]) <= self.shape[a] && block.size[a] > 0
        });
        if !inside || out.len() != block.len() || self.component >= self.per_cell {
            let reason = format!("{block:?} is no block of an array {:?}", self.shape);
            return Err(Error::invalid(file.path().display(), reason));
        }
        let length = file.length()?;
        if self.end().is_none_or(|end| end > length) {
            let reason = format!(
                "{:?} cells should follow byte {}, but the file ends at byte {length}: is it \
                 truncated?",
                self.shape, self.start
            );
            return Err(Error::invalid(file.path().display(), reason));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file_of(bytes: &[u8]) -> tempfile::NamedTempFile {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), bytes).unwrap();
        file
    }

    /// Values 0, 1, 2 … of an array of `shape` cells after three bytes, a third of a number apart
    /// in the components of a cell.
    fn stored(shape: [u64; 3], number: Number, per_cell: u64) -> Vec<u8> {
        let mut bytes = vec![7; 3];
        for cell in 0..shape.iter().product::<u64>() {
            for component in 0..per_cell {
                let value = cell as f64 + component as f64 / 4.0;
                match number {
                    Number::F32Little => bytes.extend((value as f32).to_le_bytes()),
                    Number::F32Big => bytes.extend((value as f32).to_be_bytes()),
                    Number::F64Little => bytes.extend(value.to_le_bytes()),
                    Number::F64Big => bytes.extend(value.to_be_bytes()),
                }
            }
        }
        bytes
    }

    #[test]
    fn blocks_hold_what_the_array_holds_however_it_is_stored() {
        let numbers = [Number::F32Little, Number::F32Big, Number::F64Little, Number::F64Big];
        for (number, per_cell) in numbers.into_iter().flat_map(|n| [(n, 1), (n, 3)]) {
            // Rows of the second array lie further apart than what is read together.
            for shape in [[5, 4, 3], [2000, 3, 2]] {
                let file = file_of(&stored(shape, number, per_cell));
                let component = per_cell - 1;
                let array = RawArray { start: 3, shape, number, per_cell, component };
                let block = GridBlock { lo: [1, 1, 0], size: [3, 2, 2] };
                let mut out = [0.0; 12];
                let opened = OpenFile::open(file.path()).unwrap();
                array.read(&opened, block, &mut out).unwrap();
                let mut expected = Vec::new();
                for (z, y, x) in [0, 1].into_iter().flat_map(|z| {
                    [1, 2].into_iter().flat_map(move |y| [1, 2, 3].map(move |x| (z, y, x)))
                }) {
                    let cell = (z * shape[1] + y) * shape[0] + x;
                    expected.push(cell as f64 + component as f64 / 4.0);
                }
                assert_eq!(out.as_slice(), expected);
            }
        }
    }

    #[test]
    fn what_is_not_there_is_refused() {
        let file = file_of(&stored([4, 4, 4], Number::F32Big, 1));
        let array = RawArray {
            start: 3,
            shape: [4, 4, 4],
            number: Number::F32Big,
            per_cell: 1,
            component: 0,
        };
        let opened = OpenFile::open(file.path()).unwrap();
        let error = |array: RawArray, lo: u32| {
            let block = GridBlock { lo: [lo, 0, 0], size: [2, 1, 1] };
            array.read(&opened, block, &mut [0.0; 2]).unwrap_err().to_string()
        };
        assert!(error(array, 3).contains("no block of an array"));
        assert!(error(RawArray { start: 4, ..array }, 0).contains("is it truncated?"));
        assert!(error(RawArray { shape: [u64::MAX; 3], ..array }, 0).contains("truncated"));
        assert!(error(RawArray { start: u64::MAX, ..array }, 0).contains("truncated"));
        assert!(error(RawArray { component: 1, ..array }, 0).contains("no block"));
    }
}
