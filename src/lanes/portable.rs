//! Lanes as plain arrays: the reference for the others, and what runs on processors without them.

use super::{BYTE_PADDING, Lanes, Row, doubles_partly, last_of_pairs};

const COUNT: usize = 8;

/// Eight numbers in an array.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Portable;

#[inline(always)]
fn each<T>(value: impl FnMut(usize) -> T) -> [T; COUNT] {
    std::array::from_fn(value)
}

impl Lanes for Portable {
    const COUNT: usize = COUNT;
    type Float = [f32; COUNT];
    type Index = [u32; COUNT];
    type Mask = [bool; COUNT];
    type Doubles = [f64; 4];

    #[inline(always)]
    fn splat(self, x: f32) -> Self::Float {
        [x; COUNT]
    }
    #[inline(always)]
    fn load(self, row: &Row) -> Self::Float {
        each(|n| row.0[n])
    }
    #[inline(always)]
    fn store(self, x: Self::Float, row: &mut Row) {
        row.0[..COUNT].copy_from_slice(&x);
    }
    #[inline(always)]
    fn add(self, a: Self::Float, b: Self::Float) -> Self::Float {
        each(|n| a[n] + b[n])
    }
    #[inline(always)]
    fn sub(self, a: Self::Float, b: Self::Float) -> Self::Float {
        each(|n| a[n] - b[n])
    }
    #[inline(always)]
    fn mul(self, a: Self::Float, b: Self::Float) -> Self::Float {
        each(|n| a[n] * b[n])
    }
    #[inline(always)]
    fn div(self, a: Self::Float, b: Self::Float) -> Self::Float {
        each(|n| a[n] / b[n])
    }
    #[inline(always)]
    fn fused(self, a: Self::Float, b: Self::Float, c: Self::Float) -> Self::Float {
        // Products of f32 are exact in f64, whose own rounding of the sum is as good as none.
        each(|n| (f64::from(a[n]) * f64::from(b[n]) + f64::from(c[n])) as f32)
    }
    #[inline(always)]
    fn fma(self, a: Self::Float, b: Self::Float, c: Self::Float) -> Self::Float {
        // Rounded twice: without hardware for it `mul_add` is a function call.
        each(|n| a[n] * b[n] + c[n])
    }
    #[inline(always)]
    fn min(self, a: Self::Float, b: Self::Float) -> Self::Float {
        each(|n| if a[n] < b[n] { a[n] } else { b[n] })
    }
    #[inline(always)]
    fn max(self, a: Self::Float, b: Self::Float) -> Self::Float {
        each(|n| if a[n] > b[n] { a[n] } else { b[n] })
    }
    #[inline(always)]
    fn floor(self, x: Self::Float) -> Self::Float {
        each(|n| x[n].floor())
    }
    #[inline(always)]
    fn power_of_two(self, n: Self::Float) -> Self::Float {
        each(|lane| f32::from_bits(((n[lane] as i32 + 127) as u32) << 23))
    }
    #[inline(always)]
    fn is_at_most(self, a: Self::Float, b: Self::Float) -> Self::Mask {
        each(|n| a[n] <= b[n])
    }
    #[inline(always)]
    fn has_sign(self, x: Self::Float) -> Self::Mask {
        each(|n| x[n].is_sign_negative())
    }
    #[inline(always)]
    fn select(self, mask: Self::Mask, a: Self::Float, b: Self::Float) -> Self::Float {
        each(|n| if mask[n] { a[n] } else { b[n] })
    }
    #[inline(always)]
    fn and(self, a: Self::Mask, b: Self::Mask) -> Self::Mask {
        each(|n| a[n] && b[n])
    }
    #[inline(always)]
    fn without(self, a: Self::Mask, b: Self::Mask) -> Self::Mask {
        each(|n| a[n] && !b[n])
    }
    #[inline(always)]
    fn bits(self, mask: Self::Mask) -> u32 {
        (0..COUNT).fold(0, |bits, n| bits | u32::from(mask[n]) << n)
    }
    #[inline(always)]
    fn mask(self, bits: u32) -> Self::Mask {
        each(|n| bits >> n & 1 == 1)
    }
    #[inline(always)]
    fn index(self, x: Self::Float) -> Self::Index {
        each(|n| x[n] as u32)
    }
    #[inline(always)]
    fn float(self, index: Self::Index) -> Self::Float {
        each(|n| index[n] as f32)
    }
    #[inline(always)]
    fn has_bit(self, index: Self::Index, bit: u32) -> Self::Mask {
        each(|n| index[n] >> bit & 1 == 1)
    }
    #[inline(always)]
    fn deal(self, x: Self::Float, lanes: Self::Index) -> Self::Float {
        each(|n| x[lanes[n] as usize % COUNT])
    }
    #[inline(always)]
    fn is_index(self, a: Self::Index, value: u32) -> Self::Mask {
        each(|n| a[n] == value)
    }
    #[inline(always)]
    fn gather(self, table: &[f32], index: Self::Index, offset: usize) -> Self::Float {
        each(|n| table[(index[n] as usize + offset).min(table.len() - 1)])
    }
    #[inline(always)]
    fn gather_pairs(
        self,
        table: &[f32],
        index: Self::Index,
        offsets: [usize; 4],
    ) -> [[Self::Float; 2]; 4] {
        let last = last_of_pairs(table, offsets);
        let first = each(|n| (index[n] as usize).min(last));
        offsets.map(|offset| [offset, offset + 1].map(|offset| each(|n| table[first[n] + offset])))
    }
    #[inline(always)]
    fn gather_row<const N: usize>(
        self,
        table: &[[f32; N]],
        index: Self::Index,
    ) -> [Self::Float; N] {
        let rows = each(|n| table[(index[n] as usize).min(table.len() - 1)]);
        std::array::from_fn(|c| each(|n| rows[n][c]))
    }
    #[inline(always)]
    fn gather_bits(self, table: &[u32], index: Self::Index) -> Self::Index {
        each(|n| table[(index[n] as usize).min(table.len() - 1)])
    }
    #[inline(always)]
    fn gather_bytes(self, table: &[u8], index: Self::Index) -> Self::Index {
        let last = table.len().saturating_sub(BYTE_PADDING + 1);
        each(|n| u32::from(table[(index[n] as usize).min(last)]))
    }
    #[inline(always)]
    fn bits_of(self, x: Self::Float) -> Self::Index {
        each(|n| x[n].to_bits())
    }
    #[inline(always)]
    fn upper_half(self, index: Self::Index) -> Self::Float {
        each(|n| f32::from_bits(index[n] & 0xffff_0000))
    }
    #[inline(always)]
    fn lower_half(self, index: Self::Index) -> Self::Float {
        each(|n| f32::from_bits(index[n] << 16))
    }
    #[inline(always)]
    fn doubles(self, numbers: &[f64; 4]) -> Self::Doubles {
        *numbers
    }
    #[inline(always)]
    fn doubles_at(self, table: &[f64], index: usize) -> Self::Doubles {
        let whole = table.get(index..).and_then(|rest| rest.first_chunk());
        whole.copied().unwrap_or_else(|| doubles_partly(table, index))
    }
    #[inline(always)]
    fn of_doubles(self, x: Self::Doubles) -> [f64; 4] {
        x
    }
    #[inline(always)]
    fn sub_doubles(self, a: Self::Doubles, b: Self::Doubles) -> Self::Doubles {
        std::array::from_fn(|n| a[n] - b[n])
    }
    #[inline(always)]
    fn min_doubles(self, a: Self::Doubles, b: Self::Doubles) -> Self::Doubles {
        std::array::from_fn(|n| if a[n] < b[n] { a[n] } else { b[n] })
    }
    #[inline(always)]
    fn max_doubles(self, a: Self::Doubles, b: Self::Doubles) -> Self::Doubles {
        std::array::from_fn(|n| if a[n] > b[n] { a[n] } else { b[n] })
    }
}
