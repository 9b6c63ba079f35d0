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

use crate::render::transfer::change::Change;

/// Changes summed along a ray.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Sums {
    /// ∫ T̃·|Δj| ds.
    pub(crate) emission: f64,
    /// ∫ T̃·|Δκ| ds.
    pub(crate) dimmed: f64,
    /// ∫ |Δκ| ds.
    pub(crate) extinction: f64,
}

impl Sums {
    /// Where nothing is known.
    pub(crate) const ANYTHING: Self =
        Self { emission: f64::INFINITY, dimmed: f64::INFINITY, extinction: f64::INFINITY };

    /// Adds a stretch of `length` along which ∫ T̃ ds is at most `lit`.
    #[inline]
    pub(crate) fn add(&mut self, change: Change, length: f64, lit: f64) {
        self.emission += change.emission * lit;
        self.dimmed += change.extinction * lit;
        self.extinction += change.extinction * length;
    }

    /// The sums of one stretch, as of [`Self::add`].
    pub(crate) fn of(change: Change, length: f64, lit: f64) -> Self {
        let mut sums = Self::default();
        sums.add(change, length, lit);
        sums
    }

    /// The sum, number by number.
    pub(crate) fn plus(self, other: Self) -> Self {
        Self {
            emission: self.emission + other.emission,
            dimmed: self.dimmed + other.dimmed,
            extinction: self.extinction + other.extinction,
        }
    }

    /// The smaller of each number.
    pub(crate) fn min(self, other: Self) -> Self {
        Self {
            emission: self.emission.min(other.emission),
            dimmed: self.dimmed.min(other.dimmed),
            extinction: self.extinction.min(other.extinction),
        }
    }

    /// The larger of each number.
    pub(super) fn max(self, other: Self) -> Self {
        Self {
            emission: self.emission.max(other.emission),
            dimmed: self.dimmed.max(other.dimmed),
            extinction: self.extinction.max(other.extinction),
        }
    }

    /// All of them, times a factor.
    pub(crate) fn times(self, factor: f64) -> Self {
        Self {
            emission: self.emission * factor,
            dimmed: self.dimmed * factor,
            extinction: self.extinction * factor,
        }
    }

    /// The sums where only this `transmittance` is left of what is seen, as behind other things.
    fn seen_through(self, transmittance: f64) -> Self {
        Self {
            emission: product(self.emission, transmittance),
            dimmed: product(self.dimmed, transmittance),
            extinction: self.extinction,
        }
    }

    /// What a ray is off by, with so much light `behind`.
    pub(crate) fn light(self, behind: f64) -> f64 {
        larger(self.emission + product(self.dimmed, behind), self.dimmed)
    }

    /// ∫ T̃·(|Δj| + |Δκ|·L) ds where L is at most `brightest`, and the light in ∫ |Δκ|·T̃·L ds what
    /// `absorbed` makes of ∫ |Δκ| ds; and of 1 − T: the larger of both.
    fn bound(self, absorbed: impl Fn(f64) -> f64, brightest: f64) -> f64 {
        let absorbed = product(self.dimmed, brightest).min(absorbed(self.extinction));
        larger(self.emission + absorbed, self.dimmed)
    }
}

/// The larger; infinity where either is no number, as differences and products of what overflows are.
pub(crate) fn larger(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::INFINITY } else { a.max(b) }
}

/// The product, 0 where a factor is, also of infinity.
fn product(a: f64, b: f64) -> f64 {
    if a == 0.0 || b == 0.0 { 0.0 } else { a * b }
}

/// What may be wrong with a ray, each in the picture's own unit.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct RayError {
    /// What cells that are drawn coarser than the data make it be off by.
    pub(crate) levels: Sums,
    /// What values that are read in fewer digits than are stored make it be off by.
    pub(crate) digits: Sums,
    /// What values that are not stored as the source has them make it be off by.
    pub(crate) storage: Sums,
    /// What the march of packets of rays makes it be off by.
    pub(crate) march: Sums,
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

/// What rays are off by that take what others have gathered in a brick, by cause, for a transmittance
/// of 1 in front of it.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Lent {
    levels: Sums,
    digits: Sums,
    storage: Sums,
    march: Sums,
    /// Difference of the rays to the one that was marched.
    pub(crate) apart: Sums,
    /// What of that difference is not linear in their displacement.
    pub(crate) bent: Sums,
    quadrature: f64,
}

impl Lent {
    /// Takes `apart` to be what a mean of rays is off by, weighted so that their displacements
    /// cancel, in place of a ray between them: none is farther from it than `apart` says, and what is
    /// linear cancels, but for what transmittances differ by. With k = ∫ |Δκ| ds these do so by a
    /// factor of e^k at most; what is bent counts twice, for the mean and the ray. All else was summed
    /// with the transmittances of those that were marched.
    pub(crate) fn cancel(&mut self) {
        let k = self.apart.extinction;
        let factor = k.exp();
        for sums in [&mut self.levels, &mut self.digits, &mut self.storage, &mut self.march] {
            *sums = sums.seen_through(factor);
        }
        self.quadrature = product(self.quadrature, factor);
        let second = Sums {
            extinction: 2.0 * self.bent.extinction + k * k * factor,
            ..self.bent.times(2.0 * factor).plus(self.apart.times(k.exp_m1()))
        };
        // Infinity less infinity is no number.
        if k < 1.0 {
            self.apart = self.apart.min(second);
        }
    }

    /// This and what lies behind it, where so much `transmittance` is left.
    pub(crate) fn then(&self, behind: &Self, transmittance: f64) -> Self {
        let seen = |sums: Sums| sums.seen_through(transmittance);
        Self {
            levels: self.levels.plus(seen(behind.levels)),
            digits: self.digits.plus(seen(behind.digits)),
            storage: self.storage.plus(seen(behind.storage)),
            march: self.march.plus(seen(behind.march)),
            apart: self.apart.plus(seen(behind.apart)),
            bent: self.bent.plus(seen(behind.bent)),
            quadrature: self.quadrature + behind.quadrature * transmittance,
        }
    }

    /// The larger of each: what a mean of both is off by, whatever their shares.
    pub(crate) fn max(self, other: &Self) -> Self {
        Self {
            levels: self.levels.max(other.levels),
            digits: self.digits.max(other.digits),
            storage: self.storage.max(other.storage),
            march: self.march.max(other.march),
            apart: self.apart.max(other.apart),
            bent: self.bent.max(other.bent),
            quadrature: self.quadrature.max(other.quadrature),
        }
    }
}

/// How far a picture may be off, by cause; in its own unit.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize)]
pub struct ErrorShares {
    /// Cells drawn coarser than the data.
    pub levels: f64,
    /// Values read in fewer digits than are stored.
    pub digits: f64,
    /// Transfer function and integrals replaced by simpler ones.
    pub quadrature: f64,
    /// Pixels' areas replaced by finitely many rays, and rays by others beside them.
    pub pixel_area: f64,
    /// Stored values that are not the source's: f32, or `ingest --error`.
    pub storage: f64,
    /// Rays that ended before the domain's far side.
    pub termination: f64,
    /// Rounding, of sums along rays and of the picture's f32.
    pub rounding: f64,
}

impl ErrorShares {
    /// All together.
    pub fn total(&self) -> f64 {
        let all = self.levels
            + self.digits
            + self.quadrature
            + self.pixel_area
            + self.storage
            + self.termination
            + self.rounding;
        // Nothing is known then.
        if all.is_nan() { f64::INFINITY } else { all }
    }

    /// All but what pixels' areas are off by, which may be without limit.
    pub(crate) fn beside_area(&self) -> f64 {
        Self { pixel_area: 0.0, ..*self }.total()
    }

    /// Adds `weight` times another's.
    pub(crate) fn add(&mut self, other: &Self, weight: f64) {
        self.levels += weight * other.levels;
        self.digits += weight * other.digits;
        self.quadrature += weight * other.quadrature;
        self.pixel_area += weight * other.pixel_area;
        self.storage += weight * other.storage;
        self.termination += weight * other.termination;
        self.rounding += weight * other.rounding;
    }
}

/// The same of one of many rays, in half the room: as f32, none smaller than it was.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct RayShares([f32; 7]);

impl From<ErrorShares> for RayShares {
    fn from(shares: ErrorShares) -> Self {
        let ErrorShares { levels, digits, quadrature, pixel_area, storage, termination, rounding } =
            shares;
        let all = [levels, digits, quadrature, pixel_area, storage, termination, rounding];
        Self(all.map(|share| {
            let rounded = share as f32;
            if f64::from(rounded) < share { rounded.next_up() } else { rounded }
        }))
    }
}

impl From<RayShares> for ErrorShares {
    fn from(RayShares(all): RayShares) -> Self {
        let [levels, digits, quadrature, pixel_area, storage, termination, rounding] =
            all.map(f64::from);
        Self { levels, digits, quadrature, pixel_area, storage, termination, rounding }
    }
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
        let stored = self.digits.plus(self.storage);
        self.levels.plus(stored).plus(self.march).plus(self.proxies)
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
        let stored = self.digits.extinction + self.storage.extinction;
        let packets = self.march.extinction + self.proxies.extinction;
        self.levels.extinction + stored + packets
    }

    /// What a ray adds to the accounts of others in whose place it was marched, with so much
    /// `transmittance` at the start: it stands for a square that holds them.
    pub(crate) fn lent(&self, transmittance: f64) -> Lent {
        let seen = |sums: Sums| sums.seen_through(transmittance.recip());
        Lent {
            levels: seen(self.levels),
            digits: seen(self.digits),
            storage: seen(self.storage),
            march: seen(self.march),
            apart: seen(self.farthest),
            bent: seen(self.uneven),
            quadrature: self.quadrature / transmittance,
        }
    }

    /// What values as they are read add to, which may have fewer digits than are stored.
    pub(crate) fn of_stored(&mut self, is_rounded: bool) -> &mut Sums {
        if is_rounded { &mut self.digits } else { &mut self.storage }
    }

    /// Adds what was lent to a ray with so much `transmittance` that had gathered so much `light`.
    pub(crate) fn borrow(&mut self, lent: &Lent, transmittance: f64, light: [f64; 3]) {
        let before = self.own_extinction();
        let seen = |sums: Sums| sums.seen_through(transmittance);
        self.levels = self.levels.plus(seen(lent.levels));
        self.digits = self.digits.plus(seen(lent.digits));
        self.storage = self.storage.plus(seen(lent.storage));
        self.march = self.march.plus(seen(lent.march));
        self.proxies = self.proxies.plus(seen(lent.apart));
        self.quadrature += lent.quadrature * transmittance;
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
        let causes = [self.levels, self.digits, self.storage, self.march, self.proxies];
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
            pixel_area: mean.min(bound(self.uneven) + twice).min(most) + share * proxies,
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

    #[test]
    fn nothing_wrong_is_no_error() {
        let shares = RayError::default().shares([0.0; 3], 0.0, f64::INFINITY, 0.0);
        assert_eq!(shares.total(), 0.0);
    }

    #[test]
    fn a_rays_shares_are_no_smaller_in_half_the_room() {
        let numbers = [0.1, 0.0, 1e-50, f64::INFINITY, 1e300, 1.0, 3e-7];
        let [levels, digits, quadrature, pixel_area, storage, termination, rounding] = numbers;
        let shares =
            ErrorShares { levels, digits, quadrature, pixel_area, storage, termination, rounding };
        let ErrorShares { levels, digits, quadrature, pixel_area, storage, termination, rounding } =
            RayShares::from(shares).into();
        let rounded = [levels, digits, quadrature, pixel_area, storage, termination, rounding];
        for (rounded, number) in rounded.into_iter().zip(numbers) {
            assert!(
                rounded >= number && (rounded > 1e38 || rounded <= 1.000_000_2 * number + 2e-45)
            );
        }
        assert_eq!((rounded[1], rounded[5]), (0.0, 1.0));
        // What f32 cannot hold has no limit, and takes nothing from what is beside it.
        let wide = ErrorShares { pixel_area: 1e39, rounding: 1.0, ..ErrorShares::default() };
        let wide: ErrorShares = RayShares::from(wide).into();
        assert_eq!((wide.total(), wide.beside_area()), (f64::INFINITY, 1.0));
    }

    /// Rays between those that were marched may see more of what lies behind by a factor of e^k.
    #[test]
    fn what_is_lent_grows_by_what_transmittances_differ_by() {
        let sums = Sums { emission: 0.5, dimmed: 0.25, extinction: 0.25 };
        let apart = Sums { extinction: 0.5, ..Sums::default() };
        let mut error = RayError { levels: sums, storage: sums, ..RayError::default() };
        (error.march, error.digits, error.quadrature) = (sums, sums, 0.5);
        error.farthest = apart;
        let mut lent = error.lent(1.0);
        lent.cancel();
        let grown = Sums { emission: 0.5, dimmed: 0.25, extinction: 0.0 }.times(0.5_f64.exp());
        for found in [lent.levels, lent.storage, lent.march, lent.digits] {
            assert_eq!(found, Sums { extinction: 0.25, ..grown });
        }
        assert_eq!(lent.quadrature, grown.emission);
        // Nothing times whatever is nothing.
        let farthest = Sums { extinction: f64::INFINITY, ..Sums::default() };
        let mut nothing = RayError { farthest, ..RayError::default() }.lent(1.0);
        nothing.cancel();
        assert_eq!((nothing.levels, nothing.quadrature), (Sums::default(), 0.0));
    }

    #[test]
    fn what_is_no_number_has_no_bound() {
        let all = |error: RayError| error.shares([1.0; 3], 0.0, 10.0, 0.0).total();
        let of = |sums| all(RayError { march: sums, ..RayError::default() });
        let sums = Sums { emission: 0.5, dimmed: 0.25, extinction: 0.25 };
        assert!(of(sums) < 10.0);
        // But for the brightest that there is.
        assert!(of(Sums { emission: f64::NAN, ..sums }) >= 10.0);
        let mut products = RayError { march: sums, ..RayError::default() };
        products.farthest = Sums { extinction: f64::INFINITY, ..Sums::default() };
        products.multiply(&RayError::default());
        assert!(!all(products).is_nan());
    }

    #[test]
    fn a_thin_ray_is_off_by_what_its_emission_is() {
        let mut error = RayError::default();
        error.levels.add(Change { emission: 0.5, extinction: 0.0 }, 0.2, 0.2);
        let shares = error.shares([3.0; 3], 0.0, f64::INFINITY, 0.0);
        assert_eq!(shares.levels, 0.1);
        assert!(shares.total() < 0.1 + 1e-6);
    }

    #[test]
    fn what_was_gathered_before_is_not_dimmed() {
        let near = Change { emission: 0.0, extinction: 0.1 };
        let mut error = RayError::default();
        error.storage.add(near, 1.0, 1.0);
        error.place_behind([3.0, 1.0, 0.0], 0.0);
        // The channel of which most is still to come; and what that may be off by itself.
        let found = error.shares([4.0, 4.0, 1.0], 0.5, f64::INFINITY, 0.0).storage;
        let off = (4.0 * (1.0 + GATHERED) - 1.0) * 0.1 / 0.9;
        assert!((found - off).abs() < 1e-9, "{found}");
        // Added by parts.
        let before = error.own_extinction();
        error.levels.add(near, 1.0, 1.0);
        error.place_behind([4.0, 4.0, 1.0], before);
        let both = error.shares([4.0, 4.0, 1.0], 0.5, f64::INFINITY, 0.0);
        let off = (8.0 * (1.0 + GATHERED) - 5.0) * 0.1 / 0.8;
        assert!((both.levels + both.storage - off).abs() < 1e-9, "{both:?}");
        assert_eq!(both.levels, both.storage);
    }

    #[test]
    fn light_from_behind_is_what_the_ray_gathered_or_the_brightest() {
        let mut error = RayError::default();
        error.levels.add(Change { emission: 0.0, extinction: 0.1 }, 1.0, 1.0);
        let by_light = error.shares([2.0; 3], 0.5, f64::INFINITY, 0.0).levels;
        let gathered = 2.0 * (1.0 + GATHERED);
        assert!((by_light - 0.1 * gathered / 0.9).abs() < 1e-12);
        assert!((error.shares([2.0; 3], 0.5, 1.5, 0.0).levels - 0.15).abs() < 1e-12);
        let mut opaque = RayError::default();
        opaque.levels.add(Change { emission: 0.0, extinction: 1e6 }, 1.0, 1e-6);
        assert!((opaque.shares([1.0; 3], 1.0, 1.0, 0.0).levels - 1.0).abs() < 1e-9);
        assert_eq!(opaque.shares([1.0; 3], 1.0, f64::INFINITY, 0.0).levels, f64::INFINITY);
    }
}
