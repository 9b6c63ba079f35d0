//! Exact positions against arbitrary-precision rationals, at levels 1, 25 and 60.

// Helpers fail the tests that call them.
#![allow(clippy::unwrap_used)]

mod rational;

use deepfield::space::{Decimal, Domain, FRACTION_BITS, Levels, MAX_OCTREE_LEVEL, Position};
use num_bigint::BigInt;
use num_traits::Signed;
use proptest::prelude::*;
use rational::{Rational, cells_at, decimal_text, domains, parts, power, rational, root_width};

const LEVELS: [i32; 3] = [1, 25, 60];

fn level() -> impl Strategy<Value = i32> {
    prop::sample::select(LEVELS.to_vec())
}

/// `value` (code length) in cells of `octree` from the domain's left edge.
fn in_cells(domain: &Domain, axis: usize, octree: i32, value: &Rational) -> Rational {
    (value - rational(domain.left()[axis])) / root_width(domain, axis) * power(octree)
}

fn decimal_value(text: &str) -> Rational {
    let (mantissa, exponent) = text.split_once('e').unwrap_or((text, "0"));
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let digits: BigInt = format!("{whole}{fraction}").parse().unwrap();
    let shift = exponent.parse::<i32>().unwrap() - fraction.len() as i32;
    let ten = Rational::from(BigInt::from(10).pow(shift.unsigned_abs()));
    if shift < 0 { Rational::from(digits) / ten } else { Rational::from(digits) * ten }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..Default::default() })]

    #[test]
    fn cells_and_positions_round_trip(domain in domains(), octree in level(), parts in parts()) {
        let cell = cells_at(&domain, octree, parts);
        let corner = domain.cell_corner(octree, cell);
        let last = (1i128 << (i64::from(FRACTION_BITS) - i64::from(octree))) - 1;
        prop_assert!(domain.contains(&corner));
        prop_assert_eq!(domain.cell_of(octree, &corner), cell);
        let far = Position(corner.0.map(|c| c + last));
        prop_assert_eq!(domain.cell_of(octree, &far), cell);
        // Half-open: a face belongs to the cell above it.
        let above = Position(far.0.map(|c| c + 1));
        prop_assert_eq!(domain.cell_of(octree, &above), cell.map(|i| i + 1));
        let below = Position(corner.0.map(|c| c - 1));
        prop_assert_eq!(domain.cell_of(octree, &below), cell.map(|i| i - 1));
        for coarser in -3..octree {
            let expected = cell.map(|i| i >> (octree - coarser));
            prop_assert_eq!(domain.cell_of(coarser, &far), expected);
        }
    }

    #[test]
    fn differences_are_rounded_exact_ones(
        domain in domains(),
        octree in level(),
        parts in parts(),
        offset in prop::array::uniform3(any::<i64>()),
        shift in 0u32..64,
    ) {
        let from = domain.cell_corner(octree, cells_at(&domain, octree, parts));
        // From a position's last bits up to many cells.
        let to = Position(std::array::from_fn(|a| from.0[a] + (i128::from(offset[a]) >> shift)));
        for (to, from) in [(to, from), (from, to), (to, Position([0; 3])), (domain.upper(), to)] {
            let found = domain.difference(&to, &from);
            for a in 0..3 {
                let units = Rational::from(BigInt::from(to.0[a]) - BigInt::from(from.0[a]));
                let exact = units * power(-(FRACTION_BITS as i32)) * root_width(&domain, a);
                let error = (rational(found[a]) - &exact).abs();
                // Five roundings: the width's two, the difference's, and two products.
                prop_assert!(error <= exact.abs() * rational(5.1 * (-53f64).exp2()), "axis {a}");
            }
        }
    }

    #[test]
    fn decimals_of_a_position_lead_back_to_it(domain in domains(), parts in parts()) {
        let corner = domain.cell_corner(60, cells_at(&domain, 60, parts));
        let texts = domain.decimals(&corner).unwrap();
        let found = domain.position(&texts.each_ref().map(|t| Decimal::parse(t).unwrap())).unwrap();
        for a in 0..3 {
            prop_assert!((0..=1).contains(&(corner.0[a] - found.0[a])), "{texts:?}");
        }
    }

    #[test]
    fn decimals_are_floored(
        domain in domains(),
        octree in level(),
        parts in parts(),
        digits in 1u32..150,
    ) {
        // Decimals at, just below and just above a cell's faces, cut off at any length.
        let cell = cells_at(&domain, octree, parts);
        for nudge in [-1, 0, 1] {
            let texts: [String; 3] = std::array::from_fn(|a| {
                let face = Rational::from(BigInt::from(cell[a])) * power(-octree);
                let face = rational(domain.left()[a]) + face * root_width(&domain, a);
                let nudge = Rational::new(nudge.into(), BigInt::from(10).pow(digits));
                decimal_text(&(face + nudge), digits)
            });
            let decimals = texts.each_ref().map(|text| Decimal::parse(text).unwrap());
            let position = domain.position(&decimals).unwrap();
            let found = domain.cell_of(octree, &position);
            for a in 0..3 {
                let value = decimal_value(&texts[a]);
                let fraction_bits = FRACTION_BITS as i32;
                let units = in_cells(&domain, a, fraction_bits, &value).floor().to_integer();
                prop_assert_eq!(BigInt::from(position.0[a]), units, "{}", &texts[a]);
                let index = in_cells(&domain, a, octree, &value).floor().to_integer();
                prop_assert_eq!(BigInt::from(found[a]), index, "{}", &texts[a]);
            }
        }
    }

    #[test]
    fn doubles_and_decimals_are_taken_as_they_are(
        domain in domains(),
        value in prop::array::uniform3(-1.5f64..1.5),
    ) {
        let exact = value.map(|v| Decimal::from_f64(v).unwrap());
        let position = domain.position(&exact);
        for (a, &value) in value.iter().enumerate() {
            let units = in_cells(&domain, a, FRACTION_BITS as i32, &rational(value)).floor();
            match &position {
                Ok(position) => {
                    prop_assert_eq!(BigInt::from(position.0[a]), units.to_integer());
                }
                // Too far from a domain whose cells are small.
                Err(_) => prop_assert!(domain.root_cell_width().min_element() < 1e-4),
            }
        }
    }

    #[test]
    fn levels_of_factors_2_and_4_map_both_ways(
        factors in prop::collection::vec(prop::sample::select(vec![2u32, 4]), 0..30),
    ) {
        let levels = Levels::from_factors(&factors).unwrap();
        let mut octree = 0;
        prop_assert_eq!(levels.octree(0), Some(0));
        for (level, factor) in factors.iter().enumerate() {
            for half in octree + 1..octree + factor.ilog2() {
                prop_assert_eq!(levels.simulation(half), None);
            }
            octree += factor.ilog2();
            prop_assert_eq!(levels.octree(level + 1), Some(octree));
            prop_assert_eq!(levels.simulation(octree), Some(level + 1));
        }
        prop_assert_eq!(levels.deepest(), octree);
        prop_assert_eq!(levels.simulation(octree + 1), None);
        prop_assert_eq!(levels.octree(factors.len() + 1), None);
        prop_assert_eq!(levels.count(), factors.len() + 1);
    }
}

#[test]
fn levels_beyond_the_deepest_are_refused() {
    let deepest = MAX_OCTREE_LEVEL as usize;
    assert!(Levels::from_factors(&vec![2; deepest]).is_ok());
    assert!(Levels::from_factors(&vec![2; deepest + 1]).is_err());
}

#[test]
fn cells_that_are_too_stretched_are_refused() {
    let domain = |length: f64| Domain::new([0.0; 3], [1.0, 1.0, length], [4, 4, 8]);
    assert!(domain(1.9e10).is_ok() && domain(2.1e-10).is_ok());
    for length in [2.1e10, 1.9e-10] {
        let error = domain(length).unwrap_err().to_string();
        assert!(error.contains("up to 1e10 times as wide is supported"), "{error}");
    }
}
