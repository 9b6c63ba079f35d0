//! All kinds of lanes against plain arithmetic.

use proptest::prelude::*;

use super::*;

/// What a kernel finds in each lane.
type Found = Vec<[f32; MOST_LANES]>;

struct Everything {
    a: Row,
    b: Row,
    /// The same in all parts of as many lanes as the narrowest kind has.
    even: Row,
    table: Vec<f32>,
    rows: Vec<[f32; 8]>,
    bytes: Vec<u8>,
}

impl Kernel for &Everything {
    type Output = Found;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Found {
        let (a, b) = (l.load(&self.a), l.load(&self.b));
        let index = l.index(l.max(a, l.splat(0.0)));
        let bits: Vec<u32> = self.table.iter().map(|x| x.to_bits()).collect();
        let both = l.gather_bits(&bits, index);
        let less = l.is_at_most(a, b);
        let [[first, second], .., [third, fourth]] =
            l.gather_pairs(&self.table, index, [1, 2, 0, 3]);
        let row = l.gather_row(&self.rows, index);
        let byte = l.gather_bytes(&self.bytes, index);
        let choice = |mask: L::Mask| l.select(mask, l.splat(1.0), l.splat(0.0));
        let values = [
            l.add(a, b),
            l.sub(a, b),
            l.mul(a, b),
            l.div(a, b),
            l.min(a, b),
            l.max(a, b),
            l.floor(a),
            l.power_of_two(l.floor(l.min(l.max(a, l.splat(-126.0)), l.splat(127.0)))),
            l.select(less, a, b),
            choice(l.has_sign(first)),
            choice(l.and(less, l.mask(0x5a5a))),
            choice(l.without(less, l.mask(0x5a5a))),
            choice(l.mask(l.bits(less))),
            l.gather(&self.table, index, 2),
            l.upper_half(both),
            l.upper_half(l.bits_of(first)),
            l.lower_half(both),
            first,
            second,
            third,
            fourth,
            row[0],
            row[3],
            row[6],
            l.float(byte),
            choice(l.has_bit(byte, 2)),
            choice(l.is_index(byte, 7)),
            l.deal(l.load(&self.even), l.index(l.min(l.max(b, l.splat(0.0)), l.splat(7.0)))),
        ];
        let mut found: Found = vec![[0.0; MOST_LANES]; values.len()];
        for (value, found) in values.into_iter().zip(&mut found) {
            let mut row = Row::ZERO;
            l.store(value, &mut row);
            *found = row.0;
        }
        found
    }
}

proptest! {
    #[test]
    fn all_kinds_of_lanes_compute_the_same(
        a in prop::array::uniform16(-200.0..200.0_f32),
        b in prop::array::uniform16(-3.0..30.0_f32),
        table in prop::collection::vec(any::<f32>(), 5..60),
        bytes in prop::collection::vec(any::<u8>(), 4..60),
    ) {
        let rows: Vec<[f32; 8]> = table.iter().map(|x| std::array::from_fn(|c| x + c as f32)).collect();
        let few = Width::Portable.count();
        let even = Row(std::array::from_fn(|lane| a[lane % few]));
        let mut all = Everything { a: Row(a), b: Row(b), even, table, rows, bytes };
        let found: Vec<_> = Width::all().map(|width| (width, width.run(&all))).collect();
        for first in (0..MOST_LANES).step_by(few) {
            let expected = Width::Portable.run(&all);
            for (width, found) in found.iter().filter(|(width, _)| width.count() > first) {
                for (n, (found, expected)) in found.iter().zip(&expected).enumerate() {
                    for lane in first..first + few {
                        let (found, expected) = (found[lane], expected[lane - first]);
                        let is_same = found.to_bits() == expected.to_bits();
                        prop_assert!(is_same, "{width:?}, value {n}, lane {lane}");
                    }
                }
            }
            // The lanes behind come first.
            for row in [&mut all.a, &mut all.b] {
                row.0.rotate_left(few);
            }
        }
    }
}

#[test]
fn a_fused_product_is_at_most_rounding_away() {
    struct Fused;
    impl Kernel for Fused {
        type Output = f32;
        #[inline(always)]
        fn run<L: Lanes>(self, l: L) -> f32 {
            let mut row = Row::ZERO;
            l.store(l.fma(l.splat(1.1), l.splat(2.3), l.splat(-0.7)), &mut row);
            row.0[0]
        }
    }
    for width in Width::all() {
        assert!((width.run(Fused) - (1.1 * 2.3 - 0.7)).abs() < 3e-7, "{width:?}");
    }
}

/// Four doubles of two tables from some index on: as they are, their differences, the smaller, the larger.
struct OfDoubles<'t> {
    tables: [&'t [f64]; 2],
    index: usize,
}

impl Kernel for &OfDoubles<'_> {
    type Output = [[f64; 4]; 5];

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> [[f64; 4]; 5] {
        let [a, b] = self.tables.map(|table| l.doubles_at(table, self.index));
        let all = [a, b, l.sub_doubles(a, b), l.min_doubles(a, b), l.max_doubles(a, b)];
        all.map(|x| l.of_doubles(l.doubles(&l.of_doubles(x))))
    }
}

proptest! {
    #[test]
    fn doubles_are_those_of_the_tables(
        pairs in prop::collection::vec((any::<f64>(), prop_oneof![any::<f64>(), Just(f64::NAN)]), 0..12),
        index in prop_oneof![0..14_usize, Just(usize::MAX), Just(usize::MAX - 3)],
    ) {
        let tables: (Vec<f64>, Vec<f64>) = pairs.iter().copied().unzip();
        let of = OfDoubles { tables: [&tables.0, &tables.1], index };
        let at = |n: usize| pairs.get(index.checked_add(n)?).copied();
        let pairs: [_; 4] = std::array::from_fn(|n| at(n).unwrap_or((f64::NAN, f64::NAN)));
        let expected = [
            pairs.map(|(a, _)| a),
            pairs.map(|(_, b)| b),
            pairs.map(|(a, b)| a - b),
            pairs.map(|(a, b)| if a < b { a } else { b }),
            pairs.map(|(a, b)| if a > b { a } else { b }),
        ];
        for width in Width::all() {
            for (found, expected) in width.run(&of).as_flattened().iter().zip(expected.as_flattened()) {
                // Which zero of two is left open.
                let is_same = found == expected || found.is_nan() && expected.is_nan();
                prop_assert!(is_same, "{width:?}: {found} {expected}");
            }
        }
    }
}
