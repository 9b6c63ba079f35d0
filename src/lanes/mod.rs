//! Arithmetic on several rays at once: one kernel, written once, runs on AVX-512, AVX2 or plain
//! arrays, whichever the processor has.
//!
//! A kernel is a [`Kernel`]: a function generic over [`Lanes`]. Each ray is on its own: nothing it
//! finds depends on the rays beside it, so that how rays are grouped never shows. A kernel
//! that is plain loops over slices leaves its lanes alone, and the compiler uses registers of
//! their width.

mod portable;
#[cfg(target_arch = "x86_64")]
mod x86;

pub(super) use self::portable::Portable;

/// Lanes of the widest kind.
pub(super) const MOST_LANES: usize = 16;

/// One number for each lane; of narrower kinds the first ones count.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(64))]
pub(super) struct Row(pub(super) [f32; MOST_LANES]);

impl Row {
    /// 0 in all lanes.
    pub(super) const ZERO: Self = Self([0.0; MOST_LANES]);
}

/// Bytes that a table of bytes needs behind the last that is gathered: reads may take four at once.
pub(super) const BYTE_PADDING: usize = 3;

/// Several f32 at once. Masks are of lanes; indices are whole numbers from 0 on.
pub(super) trait Lanes: Copy {
    /// Number of lanes.
    const COUNT: usize;
    /// One f32 a lane.
    type Float: Copy;
    /// One u32 a lane.
    type Index: Copy;
    /// One bit a lane.
    type Mask: Copy;
    /// Four f64, whatever the number of lanes.
    type Doubles: Copy;

    /// `x` in all lanes.
    fn splat(self, x: f32) -> Self::Float;
    /// The first [`Self::COUNT`] numbers of `row`.
    fn load(self, row: &Row) -> Self::Float;
    /// Writes `x` to the first [`Self::COUNT`] numbers of `row` and leaves the others.
    fn store(self, x: Self::Float, row: &mut Row);
    /// a + b.
    fn add(self, a: Self::Float, b: Self::Float) -> Self::Float;
    /// a − b.
    fn sub(self, a: Self::Float, b: Self::Float) -> Self::Float;
    /// a·b.
    fn mul(self, a: Self::Float, b: Self::Float) -> Self::Float;
    /// a / b.
    fn div(self, a: Self::Float, b: Self::Float) -> Self::Float;
    /// a·b + c, rounded once.
    fn fused(self, a: Self::Float, b: Self::Float, c: Self::Float) -> Self::Float;
    /// a·b + c, rounded once or twice.
    fn fma(self, a: Self::Float, b: Self::Float, c: Self::Float) -> Self::Float;
    /// The smaller; `b` where either is NaN.
    fn min(self, a: Self::Float, b: Self::Float) -> Self::Float;
    /// The larger; `b` where either is NaN.
    fn max(self, a: Self::Float, b: Self::Float) -> Self::Float;
    /// The largest whole number ≤ x.
    fn floor(self, x: Self::Float) -> Self::Float;
    /// 2ⁿ for whole n from −126 to 127.
    fn power_of_two(self, n: Self::Float) -> Self::Float;
    /// a ≤ b.
    fn is_at_most(self, a: Self::Float, b: Self::Float) -> Self::Mask;
    /// Whether the sign is minus, that of 0 as well.
    fn has_sign(self, x: Self::Float) -> Self::Mask;
    /// `a` where the mask is set, else `b`.
    fn select(self, mask: Self::Mask, a: Self::Float, b: Self::Float) -> Self::Float;
    /// Set in both.
    fn and(self, a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Set in `a` and not in `b`.
    fn without(self, a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Bit n for lane n.
    fn bits(self, mask: Self::Mask) -> u32;
    /// Set in lane n where bit n of `bits` is.
    fn mask(self, bits: u32) -> Self::Mask;
    /// The whole part of `x` ≥ 0.
    fn index(self, x: Self::Float) -> Self::Index;
    /// An index below 2³¹ as a number, rounded to f32.
    fn float(self, index: Self::Index) -> Self::Float;
    /// Whether bit `bit` of an index is set.
    fn has_bit(self, index: Self::Index, bit: u32) -> Self::Mask;
    /// Whether an index is `value`.
    fn is_index(self, a: Self::Index, value: u32) -> Self::Mask;
    /// In each lane what `x` is in the lane that its index names, modulo the number of lanes.
    fn deal(self, x: Self::Float, lanes: Self::Index) -> Self::Float;
    /// `table[index + offset]`, of the last element where that is beyond it.
    fn gather(self, table: &[f32], index: Self::Index, offset: usize) -> Self::Float;
    /// Pairs of neighbours: `table[index + offset]` and the next, for each offset; of the last index
    /// for which there are all where it is beyond that.
    fn gather_pairs(
        self,
        table: &[f32],
        index: Self::Index,
        offsets: [usize; 4],
    ) -> [[Self::Float; 2]; 4];
    /// `table[index]`, of the last row where that is beyond it.
    fn gather_row<const N: usize>(self, table: &[[f32; N]], index: Self::Index)
    -> [Self::Float; N];
    /// `table[index]`, of the last element where that is beyond it.
    fn gather_bits(self, table: &[u32], index: Self::Index) -> Self::Index;
    /// `table[index]`, widened, of a table with [`BYTE_PADDING`] more bytes at its end; of the last
    /// before these where the index is beyond it.
    fn gather_bytes(self, table: &[u8], index: Self::Index) -> Self::Index;
    /// An f32's bits.
    fn bits_of(self, x: Self::Float) -> Self::Index;
    /// The f32 whose upper 16 bits are the upper half of the index, the others 0.
    fn upper_half(self, index: Self::Index) -> Self::Float;
    /// The f32 whose upper 16 bits are the lower half of the index, the others 0.
    fn lower_half(self, index: Self::Index) -> Self::Float;
    /// Four f64 as they are.
    fn doubles(self, numbers: &[f64; 4]) -> Self::Doubles;
    /// Four elements of `table` from `index` on; NaN beyond the last.
    fn doubles_at(self, table: &[f64], index: usize) -> Self::Doubles;
    /// Four f64 as an array.
    fn of_doubles(self, x: Self::Doubles) -> [f64; 4];
    /// a − b.
    fn sub_doubles(self, a: Self::Doubles, b: Self::Doubles) -> Self::Doubles;
    /// The smaller; `b` where either is NaN.
    fn min_doubles(self, a: Self::Doubles, b: Self::Doubles) -> Self::Doubles;
    /// The larger; `b` where either is NaN.
    fn max_doubles(self, a: Self::Doubles, b: Self::Doubles) -> Self::Doubles;
}

/// The last index from which on there are pairs at all offsets.
#[inline(always)]
fn last_of_pairs(table: &[f32], offsets: [usize; 4]) -> usize {
    let [a, b, c, d] = offsets;
    let beyond = a.max(b).max(c.max(d)) + 2;
    assert!(table.len() >= beyond, "gathering pairs from a table without any");
    table.len() - beyond
}

/// Four elements of `table` from `index` on; NaN beyond the last.
#[cold]
fn doubles_partly(table: &[f64], index: usize) -> [f64; 4] {
    let at = |n: usize| table.get(index.checked_add(n)?).copied();
    std::array::from_fn(|n| at(n).unwrap_or(f64::NAN))
}

/// What runs on lanes of any kind.
pub(super) trait Kernel {
    /// What the kernel returns.
    type Output;
    /// Has to be `inline(always)`, as all that it calls with lanes: only so is it compiled for the
    /// processor that the lanes need.
    fn run<L: Lanes>(self, lanes: L) -> Self::Output;
}

/// A kind of lanes that this processor has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Width {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Width {
    /// All kinds that this processor has, the fastest last.
    pub(super) fn all() -> impl DoubleEndedIterator<Item = Self> {
        let all: &[Self] = &[
            Self::Portable,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2,
            #[cfg(target_arch = "x86_64")]
            Self::Avx512,
        ];
        all.iter().copied().filter(|width| width.is_here())
    }

    /// The fastest.
    pub(super) fn best() -> Self {
        Self::all().next_back().unwrap_or(Self::Portable)
    }

    fn is_here(self) -> bool {
        match self {
            Self::Portable => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => x86::Avx2::new().is_some(),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => x86::Avx512::new().is_some(),
        }
    }

    /// Lanes of this kind.
    pub(super) fn count(self) -> usize {
        match self {
            Self::Portable => Portable::COUNT,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => x86::Avx2::COUNT,
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => x86::Avx512::COUNT,
        }
    }

    /// Runs `kernel` on lanes of this kind, or on plain ones where the processor has none.
    #[inline]
    pub(super) fn run<K: Kernel>(self, kernel: K) -> K::Output {
        #[cfg(target_arch = "x86_64")]
        match self {
            Self::Portable => {}
            Self::Avx2 => {
                if let Some(lanes) = x86::Avx2::new() {
                    return lanes.run(kernel);
                }
            }
            Self::Avx512 => {
                if let Some(lanes) = x86::Avx512::new() {
                    return lanes.run(kernel);
                }
            }
        }
        // In one place, since kernels are inlined whole: the march is half a megabyte of code.
        kernel.run(Portable)
    }
}

#[cfg(test)]
mod tests;
