//! Lanes of x86-64 processors: AVX2 with FMA, and AVX-512.
//!
//! One of the project's three rooms with unsafe code. Two things make it sound: a value of [`Avx2`]
//! or [`Avx512`] exists only where the processor has the instructions, so that any of its methods
//! may use them; and what reads memory clamps every index to its table, or checks it, first.
#![allow(unsafe_code, clippy::needless_range_loop)]

use std::arch::x86_64::*;

use super::{BYTE_PADDING, Kernel, Lanes, Row, doubles_partly, last_of_pairs};

/// Proof of AVX2 and FMA.
#[derive(Debug, Clone, Copy)]
pub(super) struct Avx2(());

/// Proof of AVX-512 F, DQ and VL, and of AVX2 and FMA.
#[derive(Debug, Clone, Copy)]
pub(super) struct Avx512(());

impl Avx2 {
    /// None where the processor lacks AVX2 or FMA.
    #[inline]
    pub(super) fn new() -> Option<Self> {
        let is_here = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma");
        is_here.then_some(Self(()))
    }

    /// Runs `kernel` compiled for AVX2 and FMA.
    #[inline]
    pub(super) fn run<K: Kernel>(self, kernel: K) -> K::Output {
        #[target_feature(enable = "avx2,fma")]
        fn run<K: Kernel>(lanes: Avx2, kernel: K) -> K::Output {
            kernel.run(lanes)
        }
        // SAFETY: `self` proves the features.
        unsafe { run(self, kernel) }
    }
}

impl Avx512 {
    /// None where the processor lacks AVX-512 F, DQ or VL, or what [`Avx2`] needs.
    #[inline]
    pub(super) fn new() -> Option<Self> {
        let is_here = is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl")
            && Avx2::new().is_some();
        is_here.then_some(Self(()))
    }

    /// Runs `kernel` compiled for AVX-512 F, DQ and VL.
    #[inline]
    pub(super) fn run<K: Kernel>(self, kernel: K) -> K::Output {
        #[target_feature(enable = "avx512f,avx512dq,avx512vl,avx2,fma")]
        fn run<K: Kernel>(lanes: Avx512, kernel: K) -> K::Output {
            kernel.run(lanes)
        }
        // SAFETY: `self` proves the features.
        unsafe { run(self, kernel) }
    }
}

/// The last index of a table that is not empty.
#[inline(always)]
fn last<T>(table: &[T]) -> i32 {
    assert!(!table.is_empty(), "gathering from an empty table");
    i32::try_from(table.len() - 1).unwrap_or(i32::MAX)
}

/// Lane by lane.
///
/// # Safety
/// The processor has AVX-512F.
#[inline(always)]
unsafe fn sixteen(index: __m512i) -> [u32; 16] {
    let mut at = [0; 16];
    // SAFETY: the caller's; the array is as long.
    unsafe { _mm512_storeu_si512((&raw mut at).cast(), index) };
    at
}

/// Four lanes each, one behind the other.
///
/// # Safety
/// The processor has AVX-512F.
#[inline(always)]
unsafe fn quarters([a, b, c, d]: [__m128; 4]) -> __m512 {
    // SAFETY: the caller's.
    unsafe {
        let first = _mm512_insertf32x4::<1>(_mm512_castps128_ps512(a), b);
        _mm512_insertf32x4::<3>(_mm512_insertf32x4::<2>(first, c), d)
    }
}

/// Lane by lane.
///
/// # Safety
/// The processor has AVX2.
#[inline(always)]
unsafe fn numbers(index: __m256i) -> [u32; 8] {
    let mut at = [0; 8];
    // SAFETY: the caller's; the array is as long.
    unsafe { _mm256_storeu_si256((&raw mut at).cast(), index) };
    at
}

/// A method by one expression of intrinsics.
macro_rules! method {
    ($name:ident($($argument:ident: $kind:ty),*) -> $output:ty { $body:expr }) => {
        #[inline(always)]
        fn $name(self $(, $argument: $kind)*) -> $output {
            // SAFETY: `self` proves the features; pointers are those of whole rows.
            unsafe { $body }
        }
    };
}

/// The methods on four f64, which take the same instructions on both kinds.
macro_rules! methods_on_doubles {
    () => {
        method!(doubles(numbers: &[f64; 4]) -> __m256d { _mm256_loadu_pd(numbers.as_ptr()) });
        method!(of_doubles(x: __m256d) -> [f64; 4] {
            {
                let mut numbers = [0.0; 4];
                _mm256_storeu_pd(numbers.as_mut_ptr(), x);
                numbers
            }
        });
        #[inline(always)]
        fn doubles_at(self, table: &[f64], index: usize) -> __m256d {
            if table.len() < 4 || index > table.len() - 4 {
                return self.doubles(&doubles_partly(table, index));
            }
            // SAFETY: `self` proves the features; the table has four elements from there on.
            unsafe { _mm256_loadu_pd(table.as_ptr().add(index)) }
        }
        method!(sub_doubles(a: __m256d, b: __m256d) -> __m256d { _mm256_sub_pd(a, b) });
        method!(min_doubles(a: __m256d, b: __m256d) -> __m256d { _mm256_min_pd(a, b) });
        method!(max_doubles(a: __m256d, b: __m256d) -> __m256d { _mm256_max_pd(a, b) });
    };
}

impl Lanes for Avx512 {
    const COUNT: usize = 16;
    type Float = __m512;
    type Index = __m512i;
    type Mask = __mmask16;
    type Doubles = __m256d;

    methods_on_doubles!();

    method!(splat(x: f32) -> __m512 { _mm512_set1_ps(x) });
    method!(load(row: &Row) -> __m512 { _mm512_loadu_ps(row.0.as_ptr()) });
    method!(store(x: __m512, row: &mut Row) -> () { _mm512_storeu_ps(row.0.as_mut_ptr(), x) });
    method!(add(a: __m512, b: __m512) -> __m512 { _mm512_add_ps(a, b) });
    method!(sub(a: __m512, b: __m512) -> __m512 { _mm512_sub_ps(a, b) });
    method!(mul(a: __m512, b: __m512) -> __m512 { _mm512_mul_ps(a, b) });
    method!(div(a: __m512, b: __m512) -> __m512 { _mm512_div_ps(a, b) });
    method!(fused(a: __m512, b: __m512, c: __m512) -> __m512 { _mm512_fmadd_ps(a, b, c) });
    method!(fma(a: __m512, b: __m512, c: __m512) -> __m512 { _mm512_fmadd_ps(a, b, c) });
    method!(min(a: __m512, b: __m512) -> __m512 { _mm512_min_ps(a, b) });
    method!(max(a: __m512, b: __m512) -> __m512 { _mm512_max_ps(a, b) });
    method!(floor(x: __m512) -> __m512 { _mm512_roundscale_ps::<0x09>(x) });
    method!(power_of_two(n: __m512) -> __m512 { _mm512_scalef_ps(_mm512_set1_ps(1.0), n) });
    method!(is_at_most(a: __m512, b: __m512) -> __mmask16 {
        _mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b)
    });
    method!(has_sign(x: __m512) -> __mmask16 { _mm512_movepi32_mask(_mm512_castps_si512(x)) });
    method!(select(mask: __mmask16, a: __m512, b: __m512) -> __m512 {
        _mm512_mask_blend_ps(mask, b, a)
    });
    method!(index(x: __m512) -> __m512i { _mm512_cvttps_epi32(x) });
    method!(float(index: __m512i) -> __m512 { _mm512_cvtepi32_ps(index) });
    method!(has_bit(index: __m512i, bit: u32) -> __mmask16 {
        _mm512_test_epi32_mask(index, _mm512_set1_epi32(1 << bit))
    });
    method!(is_index(a: __m512i, value: u32) -> __mmask16 {
        _mm512_cmpeq_epi32_mask(a, _mm512_set1_epi32(value.cast_signed()))
    });
    method!(deal(x: __m512, lanes: __m512i) -> __m512 { _mm512_permutexvar_ps(lanes, x) });
    method!(bits_of(x: __m512) -> __m512i { _mm512_castps_si512(x) });
    method!(upper_half(index: __m512i) -> __m512 {
        _mm512_castsi512_ps(_mm512_slli_epi32::<16>(_mm512_srli_epi32::<16>(index)))
    });
    method!(lower_half(index: __m512i) -> __m512 {
        _mm512_castsi512_ps(_mm512_slli_epi32::<16>(index))
    });

    #[inline(always)]
    fn and(self, a: __mmask16, b: __mmask16) -> __mmask16 {
        a & b
    }
    #[inline(always)]
    fn without(self, a: __mmask16, b: __mmask16) -> __mmask16 {
        a & !b
    }
    #[inline(always)]
    fn bits(self, mask: __mmask16) -> u32 {
        u32::from(mask)
    }
    #[inline(always)]
    fn mask(self, bits: u32) -> __mmask16 {
        bits as u16
    }
    #[inline(always)]
    fn gather(self, table: &[f32], index: __m512i, offset: usize) -> __m512 {
        let table = &table[offset.min(table.len() - 1)..];
        let last = last(table);
        // SAFETY: `self` proves the features; as unsigned numbers, indices are at most the last.
        unsafe {
            let index = _mm512_min_epu32(index, _mm512_set1_epi32(last));
            _mm512_i32gather_ps::<4>(index, table.as_ptr())
        }
    }
    // Loads and shuffles, here and in `gather_row`: gathers take most processors longer.
    #[inline(always)]
    fn gather_pairs(self, table: &[f32], index: __m512i, offsets: [usize; 4]) -> [[__m512; 2]; 4] {
        let last = i32::try_from(last_of_pairs(table, offsets)).unwrap_or(i32::MAX);
        let mut pairs = [[self.splat(0.0); 2]; 4];
        // SAFETY: `self` proves the features; as unsigned numbers, indices are at most the last one
        // from which on there are pairs at all offsets.
        unsafe {
            let at = sixteen(_mm512_min_epu32(index, _mm512_set1_epi32(last)));
            for place in 0..4 {
                let start = table.as_ptr().add(offsets[place]);
                let mut two = [_mm_setzero_ps(); 8];
                for n in 0..8 {
                    let pair = start.add(at[2 * n] as usize).cast::<f64>();
                    let next = start.add(at[2 * n + 1] as usize).cast::<f64>();
                    two[n] = _mm_castpd_ps(_mm_loadh_pd(_mm_load_sd(pair), next));
                }
                let a = quarters([two[0], two[2], two[4], two[6]]);
                let b = quarters([two[1], two[3], two[5], two[7]]);
                pairs[place] = [_mm512_shuffle_ps::<0x88>(a, b), _mm512_shuffle_ps::<0xdd>(a, b)];
            }
        }
        pairs
    }
    #[inline(always)]
    fn gather_row<const N: usize>(self, table: &[[f32; N]], index: __m512i) -> [__m512; N] {
        const { assert!(N.is_multiple_of(4)) };
        // Rows begin so many bytes from the first as i32 holds.
        let last = last(table).min(i32::MAX / (4 * N as i32));
        let mut row = [self.splat(0.0); N];
        // SAFETY: `self` proves the features; as unsigned numbers, indices are at most the last
        // row's, of which all elements are read, four at once.
        unsafe {
            let index = _mm512_min_epu32(index, _mm512_set1_epi32(last));
            let at = sixteen(_mm512_mullo_epi32(index, _mm512_set1_epi32(4 * N as i32)));
            for first in (0..N).step_by(4) {
                let mut four = [_mm_setzero_ps(); 16];
                for n in 0..16 {
                    let row = table.as_ptr().byte_add(at[n] as usize).cast::<f32>();
                    four[n] = _mm_loadu_ps(row.add(first));
                }
                let a = quarters([four[0], four[4], four[8], four[12]]);
                let b = quarters([four[1], four[5], four[9], four[13]]);
                let c = quarters([four[2], four[6], four[10], four[14]]);
                let d = quarters([four[3], four[7], four[11], four[15]]);
                let (ab, cd) = (_mm512_unpacklo_ps(a, b), _mm512_unpacklo_ps(c, d));
                let (ef, gh) = (_mm512_unpackhi_ps(a, b), _mm512_unpackhi_ps(c, d));
                row[first] = _mm512_shuffle_ps::<0x44>(ab, cd);
                row[first + 1] = _mm512_shuffle_ps::<0xee>(ab, cd);
                row[first + 2] = _mm512_shuffle_ps::<0x44>(ef, gh);
                row[first + 3] = _mm512_shuffle_ps::<0xee>(ef, gh);
            }
        }
        row
    }
    #[inline(always)]
    fn gather_bits(self, table: &[u32], index: __m512i) -> __m512i {
        let last = last(table);
        // SAFETY: as in `gather`.
        unsafe {
            let index = _mm512_min_epu32(index, _mm512_set1_epi32(last));
            _mm512_i32gather_epi32::<4>(index, table.as_ptr().cast())
        }
    }
    #[inline(always)]
    fn gather_bytes(self, table: &[u8], index: __m512i) -> __m512i {
        assert!(table.len() > BYTE_PADDING, "gathering from an empty table");
        let last = last(table) - BYTE_PADDING as i32;
        // SAFETY: as in `gather`; four bytes from the last index on are the table's.
        unsafe {
            let index = _mm512_min_epu32(index, _mm512_set1_epi32(last));
            let four = _mm512_i32gather_epi32::<1>(index, table.as_ptr().cast());
            _mm512_and_si512(four, _mm512_set1_epi32(0xff))
        }
    }
}

impl Lanes for Avx2 {
    const COUNT: usize = 8;
    type Float = __m256;
    type Index = __m256i;
    /// All bits of a lane set, or none.
    type Mask = __m256;
    type Doubles = __m256d;

    methods_on_doubles!();

    method!(splat(x: f32) -> __m256 { _mm256_set1_ps(x) });
    method!(load(row: &Row) -> __m256 { _mm256_loadu_ps(row.0.as_ptr()) });
    method!(store(x: __m256, row: &mut Row) -> () { _mm256_storeu_ps(row.0.as_mut_ptr(), x) });
    method!(add(a: __m256, b: __m256) -> __m256 { _mm256_add_ps(a, b) });
    method!(sub(a: __m256, b: __m256) -> __m256 { _mm256_sub_ps(a, b) });
    method!(mul(a: __m256, b: __m256) -> __m256 { _mm256_mul_ps(a, b) });
    method!(div(a: __m256, b: __m256) -> __m256 { _mm256_div_ps(a, b) });
    method!(fused(a: __m256, b: __m256, c: __m256) -> __m256 { _mm256_fmadd_ps(a, b, c) });
    method!(fma(a: __m256, b: __m256, c: __m256) -> __m256 { _mm256_fmadd_ps(a, b, c) });
    method!(min(a: __m256, b: __m256) -> __m256 { _mm256_min_ps(a, b) });
    method!(max(a: __m256, b: __m256) -> __m256 { _mm256_max_ps(a, b) });
    method!(floor(x: __m256) -> __m256 { _mm256_floor_ps(x) });
    method!(power_of_two(n: __m256) -> __m256 {
        _mm256_castsi256_ps(_mm256_slli_epi32::<23>(
            _mm256_add_epi32(_mm256_cvttps_epi32(n), _mm256_set1_epi32(127)),
        ))
    });
    method!(is_at_most(a: __m256, b: __m256) -> __m256 { _mm256_cmp_ps::<_CMP_LE_OQ>(a, b) });
    method!(has_sign(x: __m256) -> __m256 {
        _mm256_castsi256_ps(_mm256_srai_epi32::<31>(_mm256_castps_si256(x)))
    });
    method!(select(mask: __m256, a: __m256, b: __m256) -> __m256 { _mm256_blendv_ps(b, a, mask) });
    method!(and(a: __m256, b: __m256) -> __m256 { _mm256_and_ps(a, b) });
    method!(without(a: __m256, b: __m256) -> __m256 { _mm256_andnot_ps(b, a) });
    method!(bits(mask: __m256) -> u32 { _mm256_movemask_ps(mask).cast_unsigned() });
    method!(mask(bits: u32) -> __m256 {
        {
            let lanes = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            let set = _mm256_and_si256(_mm256_set1_epi32(bits.cast_signed()), lanes);
            _mm256_castsi256_ps(_mm256_cmpeq_epi32(set, lanes))
        }
    });
    method!(index(x: __m256) -> __m256i { _mm256_cvttps_epi32(x) });
    method!(float(index: __m256i) -> __m256 { _mm256_cvtepi32_ps(index) });
    method!(has_bit(index: __m256i, bit: u32) -> __m256 {
        {
            let bit = _mm256_set1_epi32(1 << bit);
            _mm256_castsi256_ps(_mm256_cmpeq_epi32(_mm256_and_si256(index, bit), bit))
        }
    });
    method!(is_index(a: __m256i, value: u32) -> __m256 {
        _mm256_castsi256_ps(_mm256_cmpeq_epi32(a, _mm256_set1_epi32(value.cast_signed())))
    });
    method!(deal(x: __m256, lanes: __m256i) -> __m256 { _mm256_permutevar8x32_ps(x, lanes) });
    method!(bits_of(x: __m256) -> __m256i { _mm256_castps_si256(x) });
    method!(upper_half(index: __m256i) -> __m256 {
        _mm256_castsi256_ps(_mm256_slli_epi32::<16>(_mm256_srli_epi32::<16>(index)))
    });
    method!(lower_half(index: __m256i) -> __m256 {
        _mm256_castsi256_ps(_mm256_slli_epi32::<16>(index))
    });

    #[inline(always)]
    fn gather(self, table: &[f32], index: __m256i, offset: usize) -> __m256 {
        let table = &table[offset.min(table.len() - 1)..];
        let last = last(table);
        // SAFETY: `self` proves the features; as unsigned numbers, indices are at most the last.
        unsafe {
            let index = _mm256_min_epu32(index, _mm256_set1_epi32(last));
            _mm256_i32gather_ps::<4>(table.as_ptr(), index)
        }
    }
    // Loads and shuffles, here and in `gather_row`: gathers take this kind of processor several
    // times as long.
    #[inline(always)]
    fn gather_pairs(self, table: &[f32], index: __m256i, offsets: [usize; 4]) -> [[__m256; 2]; 4] {
        let last = i32::try_from(last_of_pairs(table, offsets)).unwrap_or(i32::MAX);
        let mut pairs = [[self.splat(0.0); 2]; 4];
        // SAFETY: `self` proves the features; as unsigned numbers, indices are at most the last one
        // from which on there are pairs at all offsets.
        unsafe {
            let at = numbers(_mm256_min_epu32(index, _mm256_set1_epi32(last)));
            for place in 0..4 {
                let start = table.as_ptr().add(offsets[place]);
                let mut two = [_mm_setzero_pd(); 4];
                for n in 0..4 {
                    let pair = start.add(at[2 * n] as usize).cast::<f64>();
                    let next = start.add(at[2 * n + 1] as usize).cast::<f64>();
                    two[n] = _mm_loadh_pd(_mm_load_sd(pair), next);
                }
                let a = _mm256_castpd_ps(_mm256_set_m128d(two[2], two[0]));
                let b = _mm256_castpd_ps(_mm256_set_m128d(two[3], two[1]));
                pairs[place] = [_mm256_shuffle_ps::<0x88>(a, b), _mm256_shuffle_ps::<0xdd>(a, b)];
            }
        }
        pairs
    }
    #[inline(always)]
    fn gather_row<const N: usize>(self, table: &[[f32; N]], index: __m256i) -> [__m256; N] {
        const { assert!(N.is_multiple_of(4)) };
        // Rows begin so many bytes from the first as i32 holds.
        let last = last(table).min(i32::MAX / (4 * N as i32));
        let mut row = [self.splat(0.0); N];
        // SAFETY: `self` proves the features; as unsigned numbers, indices are at most the last
        // row's, of which all elements are read, four at once.
        unsafe {
            let index = _mm256_min_epu32(index, _mm256_set1_epi32(last));
            let at = numbers(_mm256_mullo_epi32(index, _mm256_set1_epi32(4 * N as i32)));
            for first in (0..N).step_by(4) {
                let mut four = [_mm_setzero_ps(); 8];
                for n in 0..8 {
                    let row = table.as_ptr().byte_add(at[n] as usize).cast::<f32>();
                    four[n] = _mm_loadu_ps(row.add(first));
                }
                let a = _mm256_set_m128(four[4], four[0]);
                let b = _mm256_set_m128(four[5], four[1]);
                let c = _mm256_set_m128(four[6], four[2]);
                let d = _mm256_set_m128(four[7], four[3]);
                let (ab, cd) = (_mm256_unpacklo_ps(a, b), _mm256_unpacklo_ps(c, d));
                let (ef, gh) = (_mm256_unpackhi_ps(a, b), _mm256_unpackhi_ps(c, d));
                row[first] = _mm256_shuffle_ps::<0x44>(ab, cd);
                row[first + 1] = _mm256_shuffle_ps::<0xee>(ab, cd);
                row[first + 2] = _mm256_shuffle_ps::<0x44>(ef, gh);
                row[first + 3] = _mm256_shuffle_ps::<0xee>(ef, gh);
            }
        }
        row
    }
    #[inline(always)]
    fn gather_bits(self, table: &[u32], index: __m256i) -> __m256i {
        let last = last(table);
        // SAFETY: as in `gather`.
        unsafe {
            let index = _mm256_min_epu32(index, _mm256_set1_epi32(last));
            _mm256_i32gather_epi32::<4>(table.as_ptr().cast(), index)
        }
    }
    #[inline(always)]
    fn gather_bytes(self, table: &[u8], index: __m256i) -> __m256i {
        assert!(table.len() > BYTE_PADDING, "gathering from an empty table");
        let last = last(table) - BYTE_PADDING as i32;
        // SAFETY: as in `gather`; four bytes from the last index on are the table's.
        unsafe {
            let index = _mm256_min_epu32(index, _mm256_set1_epi32(last));
            let four = _mm256_i32gather_epi32::<1>(table.as_ptr().cast(), index);
            _mm256_and_si256(four, _mm256_set1_epi32(0xff))
        }
    }
}
