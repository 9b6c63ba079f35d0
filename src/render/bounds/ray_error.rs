//! What a ray's radiance may be off by.
//!
//! Let a ray gather light by (j̃, κ̃) where the truth is (j, κ). From `dL/ds = κ·L − j`, seen from
//! the eye, the difference of both pictures is exactly
//!
//! `Ĩ − I = ∫ T̃(s)·[(j̃ − j)(s) − (κ̃ − κ)(s)·L(s)] ds`
//!
//! with T̃ the transmittance that was marched through and L the true light from behind s. So a
//! march that knows bounds of |j̃ − j| and |κ̃ − κ| knows a bound of its error; the same holds for
//! 1 − T with j = κ.

use super::causes::Causes;
use super::proxy_error::ProxyError;
use super::shares::ErrorShares;
use super::sums::{Sums, larger, product};

/// What may be wrong with a ray, each in the picture's own unit.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct RayError {
    /// What it is off by itself.
    pub(crate) causes: Causes,
    /// What proxies, rays that were marched in its place, make it be off by.
    proxies: Sums,
    /// Largest difference of any ray of the ray's square to its centre's.
    pub(crate) farthest: Sums,
    /// Difference of the square's mean to its centre's ray, by what does not cancel between
    /// opposite places of the square.
    pub(crate) uneven: Sums,
    /// ∫ T̃·|Δj| ds by simpler formulas than the transfer function's.
    pub(crate) quadrature: f64,
    /// ∫ |Δκ|·(what the ray has gathered before s: R, G, B) ds, or less, over all but what a square
    /// makes.
    passed: [f64; 3],
    /// Changes of extinction times those of light from behind them, as [`Products`] has them.
    pub(super) products: Products,
}

/// Sums over pairs of places, the first in front of the second: ∫ |Δκ| up to there, times what is
/// added by the second, which may be on average over the square half of what it is at most.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Products {
    emission: f64,
    dimmed: f64,
}

/// Relative error of exact integration and of sums along a ray: what the stress tests of the
/// integrator hold it to.
const INTEGRATION: f64 = 1e-9;
/// Relative error of what a ray gathers behind a place, to what it gathers in all: a difference of
/// sums, that in all less that before the place.
const GATHERED: f64 = 1e-6;
/// Relative error of a channel stored as f32, and the least that there is of one that is not 0.
const STORED: f64 = 6e-8;
const LEAST: f64 = 1.5e-45;

impl RayError {
    /// All but what a square makes.
    fn of_itself(&self) -> Sums {
        self.causes.sum().plus(self.proxies)
    }

    /// What was added since the account was as `before`, of what the ray itself is off by, lies behind
    /// places where it had gathered so much `light`.
    #[inline]
    pub(crate) fn place_behind(&mut self, light: [f64; 3], before: f64) {
        let added = self.own_extinction() - before;
        if added.is_finite() {
            self.passed.iter_mut().zip(light).for_each(|(passed, light)| *passed += added * light);
        }
    }

    /// ∫ |Δκ| ds of all but what a square makes.
    #[inline]
    pub(crate) fn own_extinction(&self) -> f64 {
        self.causes.extinction() + self.proxies.extinction
    }

    /// What a ray adds to the accounts of others in whose place it was marched, with so much
    /// `transmittance` at the start: it stands for a square that holds them.
    pub(crate) fn of_proxy(&self, transmittance: f64) -> ProxyError {
        let seen = |sums: Sums| sums.seen_through(transmittance.recip());
        ProxyError {
            causes: self.causes.seen_through(transmittance.recip()),
            apart: seen(self.farthest),
            bent: seen(self.uneven),
            quadrature: self.quadrature / transmittance,
        }
    }

    /// What values as they are read add to, which may have fewer digits than are stored.
    pub(crate) fn of_stored(&mut self, is_rounded: bool) -> &mut Sums {
        self.causes.of_stored(is_rounded)
    }

    /// Adds what proxies make a ray be off by that takes what they gathered, with so much
    /// `transmittance` left, after it had gathered so much `light`.
    pub(crate) fn take_from_proxies(
        &mut self,
        proxies: &ProxyError,
        transmittance: f64,
        light: [f64; 3],
    ) {
        let before = self.own_extinction();
        self.causes = self.causes.plus(proxies.causes.seen_through(transmittance));
        self.proxies = self.proxies.plus(proxies.apart.seen_through(transmittance));
        self.quadrature += proxies.quadrature * transmittance;
        self.place_behind(light, before);
    }

    /// All that may differ between the ray and any other of its square.
    fn all(&self) -> Sums {
        self.of_itself().plus(self.farthest)
    }

    /// Adds the products of what was added since the account was as `before`: places since then
    /// may lie in any order.
    pub(crate) fn multiply(&mut self, before: &Self) {
        let mean = |error: &Self| error.of_itself().plus(error.farthest.times(0.5));
        let (in_front, old, new) = (self.all().extinction, mean(before), mean(self));
        self.products.emission += product(in_front, new.emission - old.emission);
        self.products.dimmed += product(in_front, new.dimmed - old.dimmed);
    }

    /// Bounds by cause, for a ray that has gathered `light` (R, G, B) and absorbs `opacity` of what
    /// lies behind; `brightest` bounds light from behind any place, `rest` light from behind where
    /// the ray ended early.
    ///
    /// What is gathered up to s as it was marched, and from there on in truth, is H(s) = Ĩ(s) +
    /// T̃·L: off from the ray's own Ĩ by no more than that is from the truth, as it is off by the
    /// same sums from s on. So T̃·L is at most Ĩ, and what that may be off by, less Ĩ(s).
    pub(crate) fn shares(
        &self,
        light: [f64; 3],
        opacity: f64,
        brightest: f64,
        rest: f64,
    ) -> ErrorShares {
        let beside = self.of_itself();
        let largest = light.into_iter().fold(0.0, f64::max);
        let termination = if rest > 0.0 { product(1.0 - opacity, rest.max(1.0)) } else { 0.0 };
        let gathered = light.map(|light| light * (1.0 + GATHERED) + termination);
        let farthest = self.off_by(gathered, brightest);
        let gathered = gathered.map(|light| light + farthest);
        let most_gathered = gathered.into_iter().fold(0.0, f64::max);
        // No light is brighter than the brightest, and no opacity above 1.
        let most = brightest.max(largest).max(1.0);
        let bound = |sums: Sums| {
            sums.bound(|extinction| product(extinction, most_gathered), brightest).min(most)
        };
        let own = beside.bound(|extinction| self.absorbed(extinction, gathered), brightest);
        // Together they make no more than all at once.
        let Causes { levels, digits, storage, march } = self.causes;
        let causes = [levels, digits, storage, march, self.proxies];
        let [levels, digits, storage, march, proxies] = causes.map(bound);
        let apart = levels + digits + storage + march + proxies;
        let share = if own < apart { own / apart } else { 1.0 };
        // Offsets within a square are on average half the largest.
        let mean = bound(self.farthest.times(0.5));
        let Products { emission, dimmed } = self.products;
        let twice = (self.all().extinction * (bound(beside) + mean))
            .min(larger(emission + product(dimmed, brightest), dimmed));
        ErrorShares {
            levels: share * levels,
            digits: share * digits,
            quadrature: self.quadrature + share * march,
            pixel_area: mean.min(bound(self.uneven) + twice).min(most),
            proxies: share * proxies,
            storage: share * storage,
            termination,
            rounding: rounding(largest.max(opacity)),
        }
    }

    /// ∫ |Δκ|·T̃·L ds, of any channel, where all light that is gathered from s on is at most `light`
    /// less what was before.
    fn absorbed(&self, extinction: f64, light: [f64; 3]) -> f64 {
        let channel = |c: usize| larger(product(extinction, light[c]) - self.passed[c], 0.0);
        channel(0).max(channel(1)).max(channel(2))
    }

    /// Solves E = J + min(t·brightest, E·k + what is absorbed of `light`) for the largest error E of
    /// any ray of the square.
    pub(crate) fn off_by(&self, light: [f64; 3], brightest: f64) -> f64 {
        let sums = self.all();
        let emission = larger(sums.emission, 0.0) + self.quadrature;
        let by_brightest = emission + product(sums.dimmed, brightest);
        let by_light = if sums.extinction < 1.0 {
            (emission + self.absorbed(sums.extinction, light)) / (1.0 - sums.extinction)
        } else {
            f64::INFINITY
        };
        by_brightest.min(by_light)
    }
}

/// What integration, sums and f32 make of a ray's largest channel.
fn rounding(largest: f64) -> f64 {
    if largest > 0.0 { (INTEGRATION + STORED) * largest + LEAST } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::transfer::change::Change;

    #[test]
    fn nothing_wrong_is_no_error() {
        let shares = RayError::default().shares([0.0; 3], 0.0, f64::INFINITY, 0.0);
        assert_eq!(shares.total(), 0.0);
    }

    #[test]
    fn what_is_no_number_has_no_bound() {
        let all = |error: RayError| error.shares([1.0; 3], 0.0, 10.0, 0.0).total();
        let of = |sums| {
            all(RayError {
                causes: Causes { march: sums, ..Causes::default() },
                ..RayError::default()
            })
        };
        let sums = Sums { emission: 0.5, dimmed: 0.25, extinction: 0.25 };
        assert!(of(sums) < 10.0);
        // But for the brightest that there is.
        assert!(of(Sums { emission: f64::NAN, ..sums }) >= 10.0);
        let mut products =
            RayError { causes: Causes { march: sums, ..Causes::default() }, ..RayError::default() };
        products.farthest = Sums { extinction: f64::INFINITY, ..Sums::default() };
        products.multiply(&RayError::default());
        assert!(!all(products).is_nan());
    }

    #[test]
    fn a_thin_ray_is_off_by_what_its_emission_is() {
        let mut error = RayError::default();
        error.causes.levels.add(Change { emission: 0.5, extinction: 0.0 }, 0.2, 0.2);
        let shares = error.shares([3.0; 3], 0.0, f64::INFINITY, 0.0);
        assert_eq!(shares.levels, 0.1);
        assert!(shares.total() < 0.1 + 1e-6);
    }

    #[test]
    fn what_was_gathered_before_is_not_dimmed() {
        let near = Change { emission: 0.0, extinction: 0.1 };
        let mut error = RayError::default();
        error.causes.storage.add(near, 1.0, 1.0);
        error.place_behind([3.0, 1.0, 0.0], 0.0);
        // The channel of which most is still to come; and what that may be off by itself.
        let found = error.shares([4.0, 4.0, 1.0], 0.5, f64::INFINITY, 0.0).storage;
        let off = (4.0 * (1.0 + GATHERED) - 1.0) * 0.1 / 0.9;
        assert!((found - off).abs() < 1e-9, "{found}");
        // Added by parts.
        let before = error.own_extinction();
        error.causes.levels.add(near, 1.0, 1.0);
        error.place_behind([4.0, 4.0, 1.0], before);
        let both = error.shares([4.0, 4.0, 1.0], 0.5, f64::INFINITY, 0.0);
        let off = (8.0 * (1.0 + GATHERED) - 5.0) * 0.1 / 0.8;
        assert!((both.levels + both.storage - off).abs() < 1e-9, "{both:?}");
        assert_eq!(both.levels, both.storage);
    }

    #[test]
    fn light_from_behind_is_what_the_ray_gathered_or_the_brightest() {
        let mut error = RayError::default();
        error.causes.levels.add(Change { emission: 0.0, extinction: 0.1 }, 1.0, 1.0);
        let by_light = error.shares([2.0; 3], 0.5, f64::INFINITY, 0.0).levels;
        let gathered = 2.0 * (1.0 + GATHERED);
        assert!((by_light - 0.1 * gathered / 0.9).abs() < 1e-12);
        assert!((error.shares([2.0; 3], 0.5, 1.5, 0.0).levels - 0.15).abs() < 1e-12);
        let mut opaque = RayError::default();
        opaque.causes.levels.add(Change { emission: 0.0, extinction: 1e6 }, 1.0, 1e-6);
        assert!((opaque.shares([1.0; 3], 1.0, 1.0, 0.0).levels - 1.0).abs() < 1e-9);
        assert_eq!(opaque.shares([1.0; 3], 1.0, f64::INFINITY, 0.0).levels, f64::INFINITY);
    }
}
