//! How values are mapped before they are interpolated.

use std::f64::consts::LOG10_E;

use crate::lanes::{Kernel, Lanes, Width};

/// A map of stored values that never falls.
#[derive(Debug, Clone, Copy)]
pub(in crate::ingest) enum Scale {
    /// The stored value times `factor`.
    Linear { factor: f64 },
    /// log10 of that, where it is raised to `floor` > 0 first.
    Log10 { factor: f64, floor: f64 },
}

impl Scale {
    /// Maps values, of which none is NaN.
    pub(super) fn map(self, stored: &[f32], mapped: &mut Vec<f64>) {
        mapped.resize(stored.len(), 0.0);
        Width::best().run(Map { scale: self, stored, mapped });
    }
}

struct Map<'v> {
    scale: Scale,
    stored: &'v [f32],
    mapped: &'v mut [f64],
}

impl Kernel for Map<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, _: L) {
        let pairs = self.mapped.iter_mut().zip(self.stored);
        match self.scale {
            Scale::Linear { factor } => {
                pairs.for_each(|(mapped, &stored)| *mapped = f64::from(stored) * factor);
            }
            Scale::Log10 { factor, floor } => pairs.for_each(|(mapped, &stored)| {
                let value = f64::from(stored) * factor;
                *mapped = ln(if value > floor { value } else { floor }) * LOG10_E;
            }),
        }
    }
}

/// The bits of √½: numbers are split into a power of two and what lies between √½ and √2.
const LEAST: u64 = 0x3fe6_a09e_667f_3bcd;
const ONE: u64 = 0x3ff0_0000_0000_0000;
const MANTISSA: u64 = (1 << 52) - 1;
/// Below 2⁵², a whole number is the mantissa of this one and itself together.
const TWO_TO_52: u64 = 0x4330_0000_0000_0000;
/// ln 2 in two parts: multiples of the first by whole numbers are exact.
const LN_2: [f64; 2] = [6.931_471_803_691_238e-1, 1.908_214_929_270_587_7e-10];
/// Of s⁻¹·ln((1 + s)/(1 − s)) − 2 by powers of s² (FreeBSD's msun, `e_log.c`).
const SERIES: [f64; 7] = [
    0.666_666_666_666_673_5,
    0.399_999_999_994_094_2,
    0.285_714_287_436_623_9,
    0.222_221_984_321_497_84,
    0.181_835_721_616_180_5,
    0.153_138_376_992_093_73,
    0.147_981_986_051_165_86,
];

/// The natural logarithm of a finite number above 0, to its last bit but one: without branches and
/// calls, so that many are taken side by side, and alike on all machines.
#[inline(always)]
fn ln(x: f64) -> f64 {
    let (x, lift) = if x < f64::MIN_POSITIVE { (x * (1_u64 << 54) as f64, 54.0) } else { (x, 0.0) };
    let shifted = x.to_bits().wrapping_add(ONE - LEAST);
    let exponent = f64::from_bits(shifted >> 52 | TWO_TO_52) - f64::from_bits(TWO_TO_52);
    let power = exponent - 1023.0 - lift;
    let f = f64::from_bits((shifted & MANTISSA) + LEAST) - 1.0;
    let s = f / (2.0 + f);
    let z = s * s;
    let w = z * z;
    let [a, b, c, d, e, g, h] = SERIES;
    let even = w * (b + w * (d + w * g));
    let odd = z * (a + w * (c + w * (e + w * h)));
    let half_square = 0.5 * f * f;
    s * (half_square + (odd + even)) + power * LN_2[1] - half_square + f + power * LN_2[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logarithms_are_those_of_the_library_but_for_the_last_bit() {
        let mut x = 5e-324_f64;
        let mut numbers = vec![1.0, 1.0_f64.next_up(), 1.0_f64.next_down(), f64::MAX, 2.0, 0.5];
        while x.is_finite() {
            numbers.push(x);
            x = (x * 1.013_7).max(x.next_up());
        }
        assert!(numbers.len() > 50_000);
        for x in numbers {
            let [own, library] = [ln(x), x.ln()];
            assert!((own - library).abs() <= 2.3e-16 * library.abs(), "{x:e}: {own} {library}");
        }
    }

    #[test]
    fn many_values_are_mapped_as_each_is() {
        let stored: Vec<f32> = (-50..51).map(|n| (n as f32 * 0.31).sinh()).collect();
        let (factor, floor) = (0.25, 1e-3);
        let mut mapped = Vec::new();
        Scale::Linear { factor }.map(&stored, &mut mapped);
        assert!(stored.iter().zip(&mapped).all(|(&v, &m)| m == f64::from(v) * factor));
        Scale::Log10 { factor, floor }.map(&stored, &mut mapped);
        for (&value, mapped) in stored.iter().zip(mapped) {
            let expected = (f64::from(value) * factor).max(floor).log10();
            assert!((mapped - expected).abs() <= 1e-15 * expected.abs(), "{value}");
        }
    }
}
