//! Extrema and sums over leaf cells.

use crate::cache::state;
use crate::sum::Sum;

/// Values that are counted side by side.
const LANES: usize = 4;

/// The sum of many values: of every fourth first.
pub(super) fn sum(values: &[f64]) -> Sum {
    let (chunks, rest) = values.as_chunks::<LANES>();
    let (mut sums, mut carried) = ([0.0_f64; LANES], [0.0; LANES]);
    for chunk in chunks {
        for n in 0..LANES {
            let (old, value) = (sums[n], chunk[n]);
            let new = old + value;
            let (large, small) = if old.abs() >= value.abs() { (old, value) } else { (value, old) };
            carried[n] += (large - new) + small;
            sums[n] = new;
        }
    }
    let mut total = Sum::default();
    sums.iter().chain(&carried).chain(rest).for_each(|&value| total.add(value));
    total
}

/// The largest magnitude among `values`, and the smallest that is not 0; NaN aside.
pub(super) fn magnitudes(values: &[f64]) -> (f64, f64) {
    let (mut largest, mut smallest) = ([0.0; LANES], [f64::INFINITY; LANES]);
    let (chunks, rest) = values.as_chunks::<LANES>();
    let mut count = |n: usize, value: f64| {
        let magnitude = value.abs();
        largest[n] = if magnitude > largest[n] { magnitude } else { largest[n] };
        let is_smaller = magnitude < smallest[n] && magnitude > 0.0;
        smallest[n] = if is_smaller { magnitude } else { smallest[n] };
    };
    chunks.iter().for_each(|chunk| (0..LANES).for_each(|n| count(n, chunk[n])));
    rest.iter().for_each(|&value| count(0, value));
    (largest.into_iter().fold(0.0, f64::max), smallest.into_iter().fold(f64::INFINITY, f64::min))
}

/// The largest relative errors of `stored` values against 2^-`power` times the source's: of leaf
/// cells, and of averages. What f32 cannot hold but as a number below its normal range does not
/// count: next to what it can it is nothing.
pub(super) fn largest_errors(
    states: &[u8],
    values: &[f64],
    stored: &[f32],
    power: i32,
) -> [f64; 2] {
    let mut largest = [[0.0; 2]; LANES];
    let mut count = |n: usize, bits: u8, value: f64, stored: f32| {
        let stored = f64::from(stored);
        let error = ((stored - value) / value).abs();
        let is_normal = stored.abs() >= f64::from(f32::MIN_POSITIVE);
        for (kind, largest) in KINDS.into_iter().zip(&mut largest[n]) {
            let counts = is_normal & (bits == kind) & (error > *largest);
            *largest = if counts { error } else { *largest };
        }
    };
    if power == 0 {
        let (values, rest) = values.as_chunks::<LANES>();
        let cells = values.iter().zip(stored.as_chunks::<LANES>().0);
        for ((values, stored), bits) in cells.zip(states.as_chunks::<LANES>().0) {
            (0..LANES).for_each(|n| count(n, bits[n], values[n], stored[n]));
        }
        let done = LANES * values.len();
        let rest = rest.iter().zip(&stored[done..]).zip(&states[done..]);
        rest.for_each(|((&value, &stored), &bits)| count(0, bits, value, stored));
    } else {
        for ((&value, &stored), &bits) in values.iter().zip(stored).zip(states) {
            count(0, bits, times_power_of_two(value, -power), stored);
        }
    }
    let most = |kind: usize| largest.iter().fold(0.0, |most, lane| lane[kind].max(most));
    [most(0), most(1)]
}

/// States of leaf cells, and of those that hold averages.
const KINDS: [u8; 2] = [state::EXISTS, state::EXISTS | state::REFINED];

/// What [`Tally`] knows of extrema.
#[derive(Debug, Clone, Copy)]
struct Extrema {
    min: f64,
    max: f64,
    smallest_positive: f64,
    smallest_magnitude: f64,
}

impl Extrema {
    const NONE: Self = Self {
        min: f64::INFINITY,
        max: f64::NEG_INFINITY,
        smallest_positive: f64::INFINITY,
        smallest_magnitude: f64::INFINITY,
    };

    /// With `value`, which is not NaN.
    fn with(self, value: f64) -> Self {
        let smaller = |a: f64, b: f64| if a < b { a } else { b };
        let positive = if value > 0.0 { value } else { f64::INFINITY };
        let magnitude = if value == 0.0 { f64::INFINITY } else { value.abs() };
        Self {
            min: smaller(value, self.min),
            max: if value > self.max { value } else { self.max },
            smallest_positive: smaller(positive, self.smallest_positive),
            smallest_magnitude: smaller(magnitude, self.smallest_magnitude),
        }
    }
}

/// What is counted of one field: over leaf cells that are neither dropped nor NaN where nothing
/// else is said.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Tally {
    /// Smallest value; infinite without any.
    pub(super) min: f64,
    /// Largest value; −infinite without any.
    pub(super) max: f64,
    /// Smallest value above 0; infinite without any.
    pub(super) smallest_positive: f64,
    /// Smallest magnitude of values that are not 0; infinite without any.
    pub(super) smallest_magnitude: f64,
    /// Σ value, from the source's values. This sum and the others are of one brick's values alone
    /// until [`Self::merge`] adds them times the volume of its cells.
    pub(super) sum: Sum,
    /// Σ value, from the values as stored.
    pub(super) stored_sum: Sum,
    /// Leaf cells that are NaN and not dropped.
    pub(super) nan_cells: u64,
    /// Leaf cells dropped.
    pub(super) dropped_cells: u64,
    /// Volume of the dropped leaf cells, counted by [`Self::merge`] alone.
    pub(super) dropped_volume: Sum,
    /// Σ value of the dropped leaf cells, NaN left out.
    pub(super) dropped_sum: Sum,
    /// Largest relative error of values as they are stored, averages included.
    pub(super) relative_error: f64,
    /// Largest relative error of leaf cells' values as they are stored.
    pub(super) leaf_error: f64,
}

impl Default for Tally {
    fn default() -> Self {
        Self {
            min: f64::INFINITY,
            max: f64::NEG_INFINITY,
            smallest_positive: f64::INFINITY,
            smallest_magnitude: f64::INFINITY,
            sum: Sum::default(),
            stored_sum: Sum::default(),
            nan_cells: 0,
            dropped_cells: 0,
            dropped_volume: Sum::default(),
            dropped_sum: Sum::default(),
            relative_error: 0.0,
            leaf_error: 0.0,
        }
    }
}

impl Tally {
    /// Counts leaf cells' values, none of them NaN.
    pub(super) fn count(&mut self, values: &[f64]) {
        let (chunks, rest) = values.as_chunks::<LANES>();
        let lanes = chunks.iter().fold([Extrema::NONE; LANES], |lanes, chunk| {
            std::array::from_fn(|n| lanes[n].with(chunk[n]))
        });
        let of_rest = rest.iter().fold(Extrema::NONE, |extrema, &value| extrema.with(value));
        for extrema in lanes.into_iter().chain([of_rest]) {
            self.min = self.min.min(extrema.min);
            self.max = self.max.max(extrema.max);
            self.smallest_positive = self.smallest_positive.min(extrema.smallest_positive);
            self.smallest_magnitude = self.smallest_magnitude.min(extrema.smallest_magnitude);
        }
        self.sum.add(sum(values).value());
    }

    /// Takes in what a brick counted whose cells have volume `volume`. Bricks come in one order
    /// whatever the number of threads, so sums do not depend on it.
    pub(super) fn merge(&mut self, brick: &Self, volume: f64) {
        self.min = self.min.min(brick.min);
        self.max = self.max.max(brick.max);
        self.smallest_positive = self.smallest_positive.min(brick.smallest_positive);
        self.smallest_magnitude = self.smallest_magnitude.min(brick.smallest_magnitude);
        self.sum.add(brick.sum.value() * volume);
        self.stored_sum.add(brick.stored_sum.value() * volume);
        self.nan_cells += brick.nan_cells;
        self.dropped_cells += brick.dropped_cells;
        self.dropped_volume.add(brick.dropped_cells as f64 * volume);
        self.dropped_sum.add(brick.dropped_sum.value() * volume);
        self.relative_error = self.relative_error.max(brick.relative_error);
        self.leaf_error = self.leaf_error.max(brick.leaf_error);
    }

    /// The power of two by which stored values are multiplied: 0 wherever f32 holds the field's
    /// range as it is.
    pub(super) fn exponent(&self) -> i32 {
        exponent(self.min.abs().max(self.max.abs()), self.smallest_magnitude)
    }
}

/// The exponent that brings values of magnitudes `smallest` to `largest` into f32's normal
/// range: 0 where they lie there, or where `largest` does and is not itself tiny (what is lost
/// then is below 2⁻⁹⁶ of the largest).
pub(super) fn exponent(largest: f64, smallest: f64) -> i32 {
    if !(largest > 0.0 && largest.is_finite()) {
        return 0;
    }
    let underflows = smallest < f64::from(f32::MIN_POSITIVE) && largest < (-30f64).exp2();
    if largest <= f64::from(f32::MAX) && !underflows {
        return 0;
    }
    // The largest magnitude lands near 2^100, which leaves 2^226 below it.
    (largest.log2().floor() as i32 - 100).clamp(-1000, 1000)
}

/// `value · 2^power`, in two steps so that powers beyond f64's own range do not overflow early.
pub(super) fn times_power_of_two(value: f64, power: i32) -> f64 {
    let half = power / 2;
    value * f64::from(half).exp2() * f64::from(power - half).exp2()
}

/// Rounds the mantissa of a value that was rounded to f32 before so that the relative error of both
/// stays below `relative_error`, where that is more than f32 itself makes.
pub(super) fn round_mantissa(value: f32, relative_error: f64) -> f32 {
    let left = relative_error - 0.5 * f64::from(f32::EPSILON);
    if left < f64::from(f32::EPSILON) || !value.is_normal() {
        return value;
    }
    // Keeping k bits after the leading one leaves an error of at most 2^-(k+1).
    let kept = (-left.log2()).ceil().max(1.0) as u32 - 1;
    let dropped = 23u32.saturating_sub(kept);
    if dropped == 0 {
        return value;
    }
    let half = 1u32 << (dropped - 1);
    let rounded = f32::from_bits((value.to_bits() + half) & !((1 << dropped) - 1));
    if rounded.is_finite() { rounded } else { value }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_keep_what_cancels() {
        let mut sum = Sum::default();
        for value in [1e100, 1.0, -1e100, 1e-3] {
            sum.add(value);
        }
        assert_eq!(sum.value(), 1.001);
        let values = [1e100, 1.0, 3.0, 1e90, -1e100, 1e-3, -2.0, -1e90, 7.0];
        assert_eq!(super::sum(&values).value(), 9.001);
    }

    #[test]
    fn the_largest_relative_error_is_found() {
        let alike = |bits: u8, values: &[f64], power: i32| {
            let scaled = values.iter().map(|&value| times_power_of_two(value, -power) as f32);
            let stored: Vec<f32> = scaled.collect();
            largest_errors(&vec![bits; values.len()], values, &stored, power)
        };
        let [leaf, average] = KINDS;
        let exact = [0.0, 1.5, -3.0, 1e-300, f64::NAN, 7.0];
        let roots: Vec<f64> = (1..10_001).map(|n| f64::from(n).sqrt()).collect();
        for power in [0, 30] {
            assert_eq!(alike(leaf, &exact, power), [0.0; 2]);
            let [leaves, averages] = alike(leaf, &roots, power);
            assert!(leaves > 5.5e-8 && leaves < (-24_f64).exp2(), "{leaves:e}");
            assert_eq!((averages, alike(average, &roots, power)), (0.0, [0.0, leaves]));
        }
        let states = [leaf, average, leaf, state::EXISTS | state::VOID, 0, leaf];
        let (values, stored) = ([2.0, -4.0, 8.0, 1.0, 1.0, 5.0], [2.0, -3.0, 7.0, 9.0, 9.0, 6.0]);
        assert_eq!(largest_errors(&states, &values, &stored, 0), [0.2, 0.25]);
    }

    #[test]
    fn only_ranges_beyond_f32_are_scaled() {
        assert_eq!(exponent(1e33, 1e-20), 0);
        assert_eq!(exponent(1.0, 1e-60), 0);
        assert_eq!(exponent(0.0, f64::INFINITY), 0);
        for (largest, smallest) in [(1e45, 1.0), (1e300, 1e280), (1e-40, 1e-60), (5e-324, 5e-324)] {
            let power = exponent(largest, smallest);
            let (high, low) =
                (times_power_of_two(largest, -power), times_power_of_two(smallest, -power));
            assert!(high <= f64::from(f32::MAX) && low >= f64::from(f32::MIN_POSITIVE));
        }
    }

    #[test]
    fn rounded_mantissas_keep_the_error_asked_for() {
        for error in [0.3, 0.1, 1e-2, 1e-3, 1e-5, 1e-6, (-20_f64).exp2(), 2e-7] {
            let (mut value, mut largest) = (1.1e-12_f64, 0.0_f64);
            while value < 1e12 {
                let rounded = f64::from(round_mantissa(value as f32, error));
                largest = largest.max(((rounded - value) / value).abs());
                value *= 1.000_037;
            }
            assert!(largest <= error && largest > 0.2 * error, "{largest:e} {error:e}");
        }
        assert_eq!(round_mantissa(1.234_567_8, 0.0), 1.234_567_8);
    }
}
