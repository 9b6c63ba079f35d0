//! Piecewise-linear functions of the mapped value.

use crate::{Error, Result};

/// Most points of one table of a scene.
pub const MAX_TABLE_POINTS: usize = 4096;
/// Largest absorption, emission (1 / code length) or colour of a table: products of two stay
/// finite with room to spare.
pub const LARGEST_TABLE_VALUE: f64 = 1e30;

/// A function of x with `CHANNELS` values ≥ 0: linear between its points, constant beyond the
/// first and last. Two points with the same x are a step; at the step itself the value is that of
/// the last point with this x.
#[derive(Debug, Clone, PartialEq)]
pub struct PiecewiseLinear<const CHANNELS: usize = 1> {
    positions: Vec<f64>,
    values: Vec<[f64; CHANNELS]>,
}

impl<const CHANNELS: usize> PiecewiseLinear<CHANNELS> {
    /// Builds the function through `points` (x, values), in order.
    ///
    /// # Errors
    /// No points or more than [`MAX_TABLE_POINTS`]; an x that is not finite or below the one
    /// before; a value that is NaN, negative or above [`LARGEST_TABLE_VALUE`].
    pub fn new(points: &[(f64, [f64; CHANNELS])]) -> Result<Self> {
        if points.is_empty() || points.len() > MAX_TABLE_POINTS {
            let count = points.len();
            return Err(Error::request(format!(
                "{count} points; a table has 1 to {MAX_TABLE_POINTS}"
            )));
        }
        for (index, (x, values)) in points.iter().enumerate() {
            check_point(index, *x, values)?;
        }
        if let Some(pair) = points.windows(2).find(|pair| pair[0].0 > pair[1].0) {
            let (before, after) = (pair[0].0, pair[1].0);
            return Err(Error::request(format!(
                "x = {after} follows x = {before}; points must be sorted by x"
            )));
        }
        Ok(Self::from_sorted(points.iter().copied()))
    }

    /// The function through points that are known to be sorted, finite and not negative.
    pub(super) fn from_sorted(points: impl Iterator<Item = (f64, [f64; CHANNELS])>) -> Self {
        let (positions, values) = points.unzip();
        Self { positions, values }
    }

    /// The points' x, ascending.
    pub fn positions(&self) -> &[f64] {
        &self.positions
    }

    /// The points' values.
    pub fn values(&self) -> &[[f64; CHANNELS]] {
        &self.values
    }

    /// The values at `x`; NaN counts as the first point's x.
    pub fn value(&self, x: f64) -> [f64; CHANNELS] {
        self.between(self.positions.partition_point(|&position| position <= x), x)
    }

    /// The limit of the values as `x` is approached from below: other than [`Self::value`] at a
    /// step.
    pub fn left_limit(&self, x: f64) -> [f64; CHANNELS] {
        self.between(self.positions.partition_point(|&position| position < x), x)
    }

    /// The line through points `upper − 1` and `upper` at `x`.
    fn between(&self, upper: usize, x: f64) -> [f64; CHANNELS] {
        let last = self.positions.len() - 1;
        if upper == 0 || upper > last {
            return self.values[upper.min(last)];
        }
        let (left, right) = (self.positions[upper - 1], self.positions[upper]);
        // Halves: the difference of two finite numbers need not be finite.
        let t = (0.5 * x - 0.5 * left) / (0.5 * right - 0.5 * left);
        if !t.is_finite() {
            return self.values[if x > left { upper } else { upper - 1 }];
        }
        let (below, above) = (&self.values[upper - 1], &self.values[upper]);
        std::array::from_fn(|channel| below[channel] * (1.0 - t) + above[channel] * t)
    }
}

fn check_point<const CHANNELS: usize>(
    index: usize,
    x: f64,
    values: &[f64; CHANNELS],
) -> Result<()> {
    let point = index + 1;
    if !x.is_finite() {
        return Err(Error::request(format!("point {point}: x = {x} is not a finite number")));
    }
    match values.iter().find(|value| !(0.0..=LARGEST_TABLE_VALUE).contains(*value)) {
        Some(value) => Err(Error::request(format!(
            "point {point}: {value:?} is outside 0 to {LARGEST_TABLE_VALUE:e}"
        ))),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(points: &[(f64, f64)]) -> Result<PiecewiseLinear> {
        PiecewiseLinear::new(&points.iter().map(|&(x, y)| (x, [y])).collect::<Vec<_>>())
    }

    #[test]
    fn linear_between_and_constant_beyond() {
        let function = table(&[(0.2, 1.0), (0.6, 3.0)]).unwrap();
        for (x, expected) in [(-9.0, 1.0), (0.2, 1.0), (0.3, 1.5), (0.6, 3.0), (2.0, 3.0)] {
            assert!((function.value(x)[0] - expected).abs() < 1e-15, "{x}");
        }
        assert_eq!(table(&[(0.5, 2.0)]).unwrap().value(0.1), [2.0]);
        assert_eq!(function.value(f64::NAN), [1.0]);
    }

    #[test]
    fn a_step_takes_the_last_value_and_keeps_its_left_limit() {
        let function =
            table(&[(0.0, 0.0), (0.5, 1.0), (0.5, 7.0), (0.5, 2.0), (1.0, 2.0)]).unwrap();
        assert_eq!(function.value(0.5), [2.0]);
        assert_eq!(function.left_limit(0.5), [1.0]);
        assert_eq!(function.value(0.25), [0.5]);
        assert_eq!(function.left_limit(0.25), [0.5]);
        assert_eq!(function.left_limit(0.0), [0.0]);
    }

    #[test]
    fn points_as_far_apart_as_numbers_go_stay_finite() {
        let wide = table(&[(f64::MIN, 1.0), (f64::MAX, 3.0)]).unwrap();
        assert_eq!(wide.value(0.0), [2.0]);
        let narrow = table(&[(0.0, 1.0), (5e-324, 3.0)]).unwrap();
        assert!(narrow.value(0.0) == [1.0] && narrow.value(5e-324) == [3.0]);
        assert!(narrow.value(1.0) == [3.0] && narrow.left_limit(5e-324) == [3.0]);
    }

    #[test]
    fn what_is_no_table_is_refused() {
        let bad: [&[(f64, f64)]; 6] = [
            &[],
            &[(1.0, 0.0), (0.0, 0.0)],
            &[(f64::NAN, 0.0)],
            &[(0.0, f64::NAN)],
            &[(0.0, -1e-9)],
            &[(0.0, 1e31)],
        ];
        for points in bad {
            assert!(table(points).is_err(), "{points:?}");
        }
        assert!(table(&vec![(0.0, 0.0); MAX_TABLE_POINTS + 1]).is_err());
    }
}
