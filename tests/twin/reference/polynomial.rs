//! Polynomials over 0 … 1 that live on the stack.

/// One more than the largest degree: a cubic and one degree for each further level of a blend.
pub(crate) const TERMS: usize = 14;

/// Coefficients from the constant upward; those from `terms` on are 0.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Polynomial {
    coefficients: [f64; TERMS],
    terms: usize,
}

impl Polynomial {
    pub(crate) fn new(given: &[f64]) -> Self {
        let mut coefficients = [0.0; TERMS];
        coefficients[..given.len()].copy_from_slice(given);
        Self { coefficients, terms: given.len() }
    }

    pub(crate) fn degree(&self) -> usize {
        self.terms - 1
    }

    fn all(&self) -> &[f64] {
        &self.coefficients[..self.terms]
    }

    #[inline]
    pub(crate) fn at(&self, s: f64) -> f64 {
        self.all().iter().rev().fold(0.0, |sum, c| sum * s + c)
    }

    /// `self + line · (other − self)`, `line` as constant and slope; none where there would be no
    /// room left for the integral.
    pub(crate) fn blended(&self, line: [f64; 2], other: &Self) -> Option<Self> {
        let terms = self.terms.max(other.terms);
        if terms + 2 > TERMS {
            return None;
        }
        let mut result = *self;
        result.terms = terms + 1;
        for n in 0..terms {
            let change = other.coefficients[n] - self.coefficients[n];
            result.coefficients[n] += line[0] * change;
            result.coefficients[n + 1] += line[1] * change;
        }
        Some(result)
    }

    /// `factor · (offset + self)`.
    pub(crate) fn mapped(&self, offset: f64, factor: f64) -> Self {
        let mut result = *self;
        result.coefficients[0] += offset;
        result.coefficients[..self.terms].iter_mut().for_each(|c| *c *= factor);
        result
    }

    /// `∫₀ˢ self`.
    pub(crate) fn integral(&self) -> Self {
        let mut result = Self { coefficients: [0.0; TERMS], terms: self.terms + 1 };
        for n in 0..self.terms {
            result.coefficients[n + 1] = self.coefficients[n] / (n + 1) as f64;
        }
        result
    }

    fn derivative(&self) -> Self {
        let mut result = Self { coefficients: [0.0; TERMS], terms: (self.terms - 1).max(1) };
        for n in 1..self.terms {
            result.coefficients[n - 1] = self.coefficients[n] * n as f64;
        }
        result
    }

    /// The same function with `low … high` stretched to 0 … 1 (Taylor shift by Horner's scheme).
    pub(crate) fn restricted(&self, low: f64, high: f64) -> Self {
        let mut result = *self;
        for first in 0..self.terms {
            for n in (first..self.terms - 1).rev() {
                result.coefficients[n] += low * result.coefficients[n + 1];
            }
        }
        let mut power = 1.0;
        for coefficient in &mut result.coefficients[..self.terms] {
            *coefficient *= power;
            power *= high - low;
        }
        result
    }

    /// Ends of the stretches of 0 … 1 along which the function rises or falls.
    fn turns(&self) -> Vec<f64> {
        let mut ends = vec![0.0];
        if self.terms > 2 {
            self.derivative().each_crossing(&[0.0], &mut |s| ends.push(s));
        }
        ends.push(1.0);
        ends
    }

    /// Hands over where the function passes through any of `levels` (ascending), stretch by
    /// stretch.
    pub(crate) fn each_crossing(&self, levels: &[f64], found: &mut dyn FnMut(f64)) {
        if self.terms < 2 {
            return;
        }
        for ends in self.turns().windows(2) {
            let values = [self.at(ends[0]), self.at(ends[1])];
            let (low, high) = (values[0].min(values[1]), values[0].max(values[1]));
            let first = levels.partition_point(|level| *level <= low);
            let end = levels.partition_point(|level| *level <= high);
            let passed = &levels[first..end.max(first)];
            if values[0] < values[1] {
                passed.iter().for_each(|level| found(self.crossing(ends[0], ends[1], *level)));
            } else {
                passed
                    .iter()
                    .rev()
                    .for_each(|level| found(self.crossing(ends[0], ends[1], *level)));
            }
        }
    }

    /// Where the function meets `level` between `low` and `high`, along which it is monotonic:
    /// Newton's steps, and halves where those leave the bracket.
    fn crossing(&self, mut low: f64, mut high: f64, level: f64) -> f64 {
        let slope = self.derivative();
        let rising = self.at(low) < self.at(high);
        let mut s = 0.5 * (low + high);
        for _ in 0..100 {
            let excess = self.at(s) - level;
            if (excess < 0.0) == rising {
                low = s;
            } else {
                high = s;
            }
            let newton = s - excess / slope.at(s);
            let next = if low < newton && newton < high { newton } else { 0.5 * (low + high) };
            if (next - s).abs() <= 1e-16 || next <= low || next >= high {
                return next;
            }
            s = next;
        }
        s
    }
}
