//! Polynomials along a piece of ray, in s over [0, 1].

/// `Σ c[k] s^k`, meant for s in [0, 1].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Polynomial<const N: usize>(pub [f64; N]);

/// A root is found to this in s at worst, as a rule to f64's rounding.
const ROOT_TOLERANCE: f64 = 1e-9;
/// Steps of Chebyshev's method that leave nothing to a next one: the error e becomes about 2(c·e)²·e,
/// where c is half the second derivative over the first, and where that says nothing a third of c·e².
const LAST_STEP: f64 = 1e-6;
const LAST_BEND: f64 = 1e-5;
/// What the second derivative may change of a step: by all of it where a function flattens towards
/// its root, and that step of 0 would draw others to a place that is none.
const MOST_BEND: f64 = 0.5;

/// Halvings at most of what is not monotone, before all of it counts as near.
const NEAR_HALVINGS: u32 = 16;

impl<const N: usize> Polynomial<N> {
    /// The value at `s`.
    #[inline]
    pub(crate) fn at(&self, s: f64) -> f64 {
        let mut sum = self.0[N - 1];
        for c in self.0[..N - 1].iter().rev() {
            sum = sum * s + c;
        }
        sum
    }

    /// The polynomial over [`from`, `to`] in terms of a variable that goes from 0 to 1 there.
    #[inline]
    pub(crate) fn part(&self, from: f64, to: f64) -> Self {
        let mut c = self.0;
        for done in 0..N {
            for k in (done..N - 1).rev() {
                c[k] += from * c[k + 1];
            }
        }
        let (width, mut power) = (to - from, 1.0);
        for coefficient in &mut c {
            *coefficient *= power;
            power *= width;
        }
        Self(c)
    }

    /// Bernstein coefficients: the function lies between their smallest and largest over [0, 1],
    /// and is monotone there if they are.
    #[inline]
    pub(crate) fn control_points(&self) -> [f64; N] {
        let mut points = self.0;
        let (mut binomial, degree) = (1.0, (N - 1) as f64);
        for (k, point) in points.iter_mut().enumerate() {
            *point /= binomial;
            binomial *= (degree - k as f64) / (k + 1) as f64;
        }
        for done in 1..N {
            for k in (done..N).rev() {
                points[k] += points[k - 1];
            }
        }
        points
    }

    /// The mean over [0, 1].
    #[inline]
    pub(crate) fn mean(&self) -> f64 {
        self.0.iter().enumerate().rev().fold(0.0, |sum, (k, c)| sum + c / (k + 1) as f64)
    }

    /// An upper bound of the share of [0, 1] in which the function is within `reach` of `value`.
    pub(crate) fn share_near(&self, value: f64, reach: f64) -> f64 {
        self.share_between([value - reach, value + reach], NEAR_HALVINGS)
    }

    /// An upper bound of the share of [0, 1] in which another function lies on the other side of
    /// `value`: one within `reach` of this one, that differs from it by something whose slope is
    /// at most `drift`. Where this one is steeper than that it may be so before the place where
    /// this one is `value`, or behind, not both.
    pub(crate) fn share_across(&self, value: f64, reach: f64, drift: f64) -> f64 {
        let points = self.control_points();
        let steeper = |rise: f64| rise * (N - 1) as f64 > drift;
        let rising = points.windows(2).all(|pair| steeper(pair[1] - pair[0]));
        if rising || points.windows(2).all(|pair| steeper(pair[0] - pair[1])) {
            let below = self.share_between([value - reach, value], NEAR_HALVINGS);
            return below.max(self.share_between([value, value + reach], NEAR_HALVINGS));
        }
        self.share_near(value, reach)
    }

    fn share_between(&self, [low, high]: [f64; 2], halvings: u32) -> f64 {
        let points = self.control_points();
        let (least, most) = points
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, m), &p| (p.min(l), p.max(m)));
        if most < low || least > high {
            return 0.0;
        }
        if least >= low && most <= high {
            return 1.0;
        }
        let rising = points.windows(2).all(|pair| pair[0] <= pair[1]);
        if rising || points.windows(2).all(|pair| pair[0] >= pair[1]) {
            let share = (self.solve(high, 0.0) - self.solve(low, 0.0)).abs();
            return (share + 2.0 * ROOT_TOLERANCE).min(1.0);
        }
        if halvings == 0 {
            return 1.0;
        }
        let part = |from, to| self.part(from, to).share_between([low, high], halvings - 1);
        0.5 * (part(0.0, 0.5) + part(0.5, 1.0))
    }

    /// Where the function, monotone over [`from`, 1], takes `value`, which must lie between its
    /// values at both ends; the nearer end otherwise. Chebyshev's method (Newton's with the second
    /// derivative, of third order), kept in its bracket.
    pub(crate) fn solve(&self, value: f64, from: f64) -> f64 {
        let (mut low, mut high) = (from, 1.0);
        let first = self.expanded(low, value);
        let (at_low, at_high) = (first[0], self.at(high) - value);
        if at_low == 0.0 || at_high == 0.0 || (at_low < 0.0) == (at_high < 0.0) {
            return if at_low.abs() <= at_high.abs() { low } else { high };
        }
        let guess = low - step(first)[0];
        let mut s = if guess > low && guess < high {
            guess
        } else {
            low + (high - low) * (at_low / (at_low - at_high))
        };
        for _ in 0..100 {
            let here = self.expanded(s, value);
            if here[0] == 0.0 {
                break;
            }
            if (here[0] < 0.0) == (at_low < 0.0) {
                low = s;
            } else {
                high = s;
            }
            let [moved, bend] = step(here);
            let next = s - moved;
            if moved.abs() <= f64::EPSILON {
                break;
            }
            if next > low && next < high {
                s = next;
                let is_last = moved.abs() <= LAST_STEP && bend.abs() <= LAST_BEND;
                if is_last || moved.abs() < ROOT_TOLERANCE {
                    break;
                }
            } else {
                // Halving says nothing of how near the root is.
                let middle = 0.5 * (low + high);
                let is_done = (middle - s).abs() < f64::EPSILON;
                s = middle;
                if is_done {
                    break;
                }
            }
        }
        s
    }

    /// The polynomial, moved by a straight line so that it has these values at 0 and 1, to the
    /// rounding of their difference: a transfer function may be steep against rounding of x.
    pub(crate) fn between(mut self, ends: [f64; 2]) -> Self {
        self.0[0] = ends[0];
        let rise: f64 = self.0.iter().skip(1).sum();
        self.0[1] += (ends[1] - ends[0]) - rise;
        self
    }

    /// The slope at `s`.
    pub(crate) fn slope(&self, s: f64) -> f64 {
        self.expanded(s, 0.0)[1]
    }

    /// Where the slope changes sign in [0, 1], if it does so once.
    pub(crate) fn turn(&self) -> f64 {
        let mut slope = Self([0.0; N]);
        for k in 1..N {
            slope.0[k - 1] = k as f64 * self.0[k];
        }
        slope.solve(0.0, 0.0)
    }

    /// What the function is more than `value` at `s`, its slope there, and half its second derivative.
    #[inline]
    fn expanded(&self, s: f64, value: f64) -> [f64; 3] {
        let (mut f, mut slope, mut bend) = (self.0[N - 1], 0.0, 0.0);
        // A product with 0 is no number where s is none, so that it would be worked out.
        for (done, c) in self.0[..N - 1].iter().rev().enumerate() {
            bend = if done > 1 { bend * s + slope } else { slope };
            slope = if done > 0 { slope * s + f } else { f };
            f = f * s + c;
        }
        [f - value, slope, bend]
    }
}

/// How far from the root a place is at which a function is so `expanded`, by Chebyshev's method (by
/// Newton's where the second derivative changes that by more than [`MOST_BEND`] of it), and that change.
#[inline]
fn step([f, slope, bend]: [f64; 3]) -> [f64; 2] {
    let newton = f / slope;
    let change = bend / slope * newton;
    [newton * if change.abs() <= MOST_BEND { 1.0 + change } else { 1.0 }, change]
}

impl Polynomial<4> {
    /// The trilinear interpolant of `corners` (bit a of the index: the upper corner along axis
    /// a) on the straight line from `start` to `end`, both in the unit cube.
    #[inline]
    pub(crate) fn along_line(corners: &[f64; 8], start: [f64; 3], end: [f64; 3]) -> Self {
        let [x, y, z] = start;
        let (dx, dy, dz) = (end[0] - x, end[1] - y, end[2] - z);
        // Along x: four linear functions v + d·s; along y: two quadratic ones; along z: a cubic.
        let slope: [f64; 4] = std::array::from_fn(|n| corners[2 * n + 1] - corners[2 * n]);
        let v: [f64; 4] = std::array::from_fn(|n| corners[2 * n] + slope[n] * x);
        let d = slope.map(|slope| slope * dx);
        let quadratic = |n: usize| {
            let (w, e) = (v[n + 1] - v[n], d[n + 1] - d[n]);
            [v[n] + w * y, d[n] + w * dy + e * y, e * dy]
        };
        let (low, high) = (quadratic(0), quadratic(2));
        let w: [f64; 3] = std::array::from_fn(|k| high[k] - low[k]);
        Self([
            low[0] + w[0] * z,
            low[1] + w[1] * z + w[0] * dz,
            low[2] + w[2] * z + w[1] * dz,
            w[2] * dz,
        ])
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const P: Polynomial<8> = Polynomial([0.3, -2.0, 5.0, 1.0, -7.0, 0.5, 2.0, 1.5]);

    #[test]
    fn a_part_is_the_same_function() {
        let part = P.part(0.2, 0.65);
        for n in 0..=10 {
            let s = f64::from(n) / 10.0;
            assert!((part.at(s) - P.at(0.2 + 0.45 * s)).abs() < 1e-13);
        }
    }

    #[test]
    fn control_points_enclose_and_make_the_function() {
        let points = P.control_points();
        let binomial = [1.0, 7.0, 21.0, 35.0, 35.0, 21.0, 7.0, 1.0];
        for n in 0..=20 {
            let s = f64::from(n) / 20.0;
            let sum: f64 = (0..8)
                .map(|k| points[k] * binomial[k] * s.powi(k as i32) * (1.0 - s).powi(7 - k as i32))
                .sum();
            assert!((sum - P.at(s)).abs() < 1e-12, "{s}");
        }
    }

    #[test]
    fn another_function_crosses_a_value_on_one_side() {
        let x = Polynomial([0.2, 0.5, 0.1, -0.05]);
        let (value, reach, drift) = (0.45, 0.03, 0.1);
        let share = x.share_across(value, reach, drift);
        let both = x.share_near(value, reach);
        assert!(share > 0.5 * both && share < 0.55 * both, "{share} {both}");
        const STEPS: u32 = 10_000;
        for n in 0..=20 {
            let start = reach * (f64::from(n) / 10.0 - 1.0);
            for rise in [-drift, 0.0, drift] {
                let other = |s: f64| x.at(s) + (start + rise * (s - 0.5)).clamp(-reach, reach);
                let differs = |s: f64| (x.at(s) < value) != (other(s) < value);
                let apart = (0..STEPS).filter(|n| differs(f64::from(*n) / f64::from(STEPS)));
                let apart = apart.count() as f64 / f64::from(STEPS);
                assert!(apart <= share + 1.0 / f64::from(STEPS), "{apart} {share}");
            }
        }
        // Not as steep, or not monotone: on both sides.
        assert_eq!(x.share_across(value, reach, 0.6), both);
        let bent = Polynomial([0.4, 0.3, -0.3, 0.0]);
        assert_eq!(bent.share_across(0.45, 0.01, 0.0), bent.share_near(0.45, 0.01));
    }

    #[test]
    fn roots_of_steep_flat_and_triple_kind() {
        let steep = Polynomial([-1.0, 1e9, 0.0, 1e12]);
        assert!((steep.at(steep.solve(0.5, 0.0)) - 0.5).abs() < 1e-2);
        let triple = Polynomial([-0.125, 0.75, -1.5, 1.0]);
        assert!((triple.solve(0.0, 0.0) - 0.5).abs() < 1e-4);
        assert_eq!(triple.solve(9.0, 0.25), 1.0);
        let line = Polynomial([0.0, 2.0, 0.0, 0.0]);
        assert!((line.solve(1.3, 0.1) - 0.65).abs() < 1e-12);
    }

    #[test]
    fn no_step_ends_where_there_is_no_root() {
        // Chebyshev's step at -1: nothing.
        for change in [-1.0, -1.0 + 1e-9, 3.0, f64::NAN] {
            assert_eq!(step([2.0, 4.0, 8.0 * change])[0], 0.5);
        }
        assert_eq!(step([2.0, 4.0, -0.8]), [0.45, -0.1]);
    }

    /// By halving alone.
    fn bisected<const N: usize>(x: &Polynomial<N>, value: f64, from: f64) -> f64 {
        let (mut low, mut high) = (from, 1.0);
        let is_below = |s: f64| (x.at(s) < value) == (x.at(from) < value);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if is_below(middle) { low = middle } else { high = middle }
        }
        low
    }

    proptest! {
        #[test]
        fn roots_are_those_of_halving(
            points in prop::array::uniform4(0.0..1.0_f64),
            power in 1..12_i32,
            [from, share] in prop::array::uniform2(0.0..1.0_f64),
            falls in any::<bool>(),
        ) {
            // Bernstein coefficients that grow, some of them by next to nothing.
            let mut sum = 0.0;
            let b = points.map(|p| { sum += p.powi(power); if falls { -sum } else { sum } });
            let x = Polynomial([
                b[0],
                3.0 * (b[1] - b[0]),
                3.0 * (b[2] - 2.0 * b[1] + b[0]),
                b[3] - 3.0 * b[2] + 3.0 * b[1] - b[0],
            ]);
            let [low, high] = [x.at(from), x.at(1.0)];
            let value = low + share * (high - low);
            let (ours, truth) = (x.solve(value, from), bisected(&x, value, from));
            // What rounding of values makes of places counts as well.
            let off = (x.at(ours) - value).abs();
            prop_assert!(
                (ours - truth).abs() <= 1e-10 || off <= 4.0 * f64::EPSILON * sum,
                "{ours} for {truth}, off by {off:e}"
            );
        }
    }

    #[test]
    fn trilinear_along_a_line() {
        let corners = [0.1, 2.0, -1.0, 4.0, 0.7, -3.0, 1.0, 0.2];
        let (start, end) = ([0.1, 0.9, 0.3], [0.8, 0.2, 0.95]);
        let cubic = Polynomial::along_line(&corners, start, end);
        for n in 0..=8 {
            let s = f64::from(n) / 8.0;
            let u: [f64; 3] = std::array::from_fn(|a| start[a] + s * (end[a] - start[a]));
            let direct: f64 = (0..8)
                .map(|c| {
                    let w = |a: usize| if c >> a & 1 == 1 { u[a] } else { 1.0 - u[a] };
                    corners[c] * w(0) * w(1) * w(2)
                })
                .sum();
            assert!((cubic.at(s) - direct).abs() < 1e-14);
        }
    }
}
