//! Polynomials of low degree over 0 … 1.

/// Coefficients from the constant upward.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Polynomial(pub(crate) Vec<f64>);

impl Polynomial {
    pub(crate) fn constant(value: f64) -> Self {
        Self(vec![value])
    }

    /// `value + slope · s`.
    pub(crate) fn line(value: f64, slope: f64) -> Self {
        Self(vec![value, slope])
    }

    pub(crate) fn at(&self, s: f64) -> f64 {
        self.0.iter().rev().fold(0.0, |sum, c| sum.mul_add(s, *c))
    }

    pub(crate) fn plus(&self, other: &Self) -> Self {
        let coefficient = |p: &Self, n: usize| p.0.get(n).copied().unwrap_or(0.0);
        let length = self.0.len().max(other.0.len());
        Self((0..length).map(|n| coefficient(self, n) + coefficient(other, n)).collect())
    }

    pub(crate) fn scaled(&self, factor: f64) -> Self {
        Self(self.0.iter().map(|c| c * factor).collect())
    }

    pub(crate) fn times(&self, other: &Self) -> Self {
        let mut product = vec![0.0; self.0.len() + other.0.len() - 1];
        for (n, a) in self.0.iter().enumerate() {
            for (m, b) in other.0.iter().enumerate() {
                product[n + m] += a * b;
            }
        }
        Self(product)
    }

    /// The integral from 0.
    pub(crate) fn integral(&self) -> Self {
        let terms = self.0.iter().enumerate().map(|(n, c)| c / (n + 1) as f64);
        Self(std::iter::once(0.0).chain(terms).collect())
    }

    fn derivative(&self) -> Self {
        let terms = self.0.iter().enumerate().skip(1).map(|(n, c)| c * n as f64);
        Self(terms.collect())
    }

    /// The same function with `low … high` stretched to 0 … 1.
    pub(crate) fn restricted(&self, low: f64, high: f64) -> Self {
        let inner = Self::line(low, high - low);
        let terms = self.0.iter().rev();
        terms.fold(Self(vec![0.0]), |sum, c| sum.times(&inner).plus(&Self::constant(*c)))
    }

    /// Where the polynomial passes through any of `levels` inside 0 … 1, ascending: between
    /// neighbouring extrema (the derivative's roots) at most once each, found by bisection.
    pub(crate) fn crossings(&self, levels: &[f64]) -> Vec<f64> {
        if self.0.len() < 2 {
            return Vec::new();
        }
        let mut ends = vec![0.0];
        ends.extend(self.derivative().crossings(&[0.0]));
        ends.push(1.0);
        let mut found = Vec::new();
        for end in ends.windows(2) {
            let values = [self.at(end[0]), self.at(end[1])];
            let passed = levels.iter().filter(|l| (values[0] < **l) != (values[1] < **l));
            found.extend(passed.map(|level| self.bisect(end[0], end[1], *level)));
        }
        found.sort_by(f64::total_cmp);
        found
    }

    fn bisect(&self, mut low: f64, mut high: f64, level: f64) -> f64 {
        let below = self.at(low) < level;
        loop {
            let middle = 0.5 * (low + high);
            if middle <= low || middle >= high {
                return middle;
            }
            if (self.at(middle) < level) == below { low = middle } else { high = middle }
        }
    }
}
