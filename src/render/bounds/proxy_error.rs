//! What rays may be off by that take what proxies, marched in their place, have gathered.

use super::causes::Causes;
use super::sums::{Sums, product};

/// What rays are off by that take what others have gathered in a brick, by cause, for a transmittance
/// of 1 in front of it.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct ProxyError {
    /// What those that were marched are off by.
    pub(super) causes: Causes,
    /// Difference of the rays to the one that was marched.
    pub(crate) apart: Sums,
    /// What of that difference is not linear in their displacement.
    pub(crate) bent: Sums,
    pub(super) quadrature: f64,
}

impl ProxyError {
    /// Takes `apart` to be what a mean of rays is off by, weighted so that their displacements
    /// cancel, in place of a ray between them: none is farther from it than `apart` says, and what is
    /// linear cancels, but for what transmittances differ by. With k = ∫ |Δκ| ds these do so by a
    /// factor of e^k at most; what is bent counts twice, for the mean and the ray. All else was summed
    /// with the transmittances of those that were marched.
    pub(crate) fn cancel(&mut self) {
        let k = self.apart.extinction;
        let factor = k.exp();
        self.causes = self.causes.seen_through(factor);
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
        Self {
            causes: self.causes.plus(behind.causes.seen_through(transmittance)),
            apart: self.apart.plus(behind.apart.seen_through(transmittance)),
            bent: self.bent.plus(behind.bent.seen_through(transmittance)),
            quadrature: self.quadrature + behind.quadrature * transmittance,
        }
    }

    /// The larger of each: what a mean of both is off by, whatever their shares.
    pub(crate) fn max(self, other: &Self) -> Self {
        Self {
            causes: self.causes.max(other.causes),
            apart: self.apart.max(other.apart),
            bent: self.bent.max(other.bent),
            quadrature: self.quadrature.max(other.quadrature),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::bounds::ray_error::RayError;

    /// Rays between those that were marched may see more of what lies behind by a factor of e^k.
    #[test]
    fn what_proxies_make_grows_by_what_transmittances_differ_by() {
        let sums = Sums { emission: 0.5, dimmed: 0.25, extinction: 0.25 };
        let apart = Sums { extinction: 0.5, ..Sums::default() };
        let causes = Causes { levels: sums, digits: sums, storage: sums, march: sums };
        let mut error = RayError::default();
        (error.causes, error.quadrature, error.farthest) = (causes, 0.5, apart);
        let mut proxies = error.of_proxy(1.0);
        proxies.cancel();
        let grown = Sums { emission: 0.5, dimmed: 0.25, extinction: 0.0 }.times(0.5_f64.exp());
        let grown_each = Sums { extinction: 0.25, ..grown };
        let [levels, digits, storage, march] = [grown_each; 4];
        assert_eq!(proxies.causes, Causes { levels, digits, storage, march });
        assert_eq!(proxies.quadrature, grown.emission);
        // Nothing times whatever is nothing.
        let farthest = Sums { extinction: f64::INFINITY, ..Sums::default() };
        let mut error = RayError::default();
        error.farthest = farthest;
        let mut nothing = error.of_proxy(1.0);
        nothing.cancel();
        assert_eq!((nothing.causes, nothing.quadrature), (Causes::default(), 0.0));
    }
}
