//! The scales in which fields are shown.

use std::f64::consts::LN_10;

use crate::log10::log10;

/// The scale `s` in which values are mapped and interpolated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Scale {
    /// s(f) = f.
    Linear,
    /// s(f) = log10(f); what is at or below the smallest positive leaf value counts as that.
    Log10,
    /// Linear within ± linthresh, logarithmic beyond, as matplotlib's `SymLogNorm` with base 10
    /// and `linscale` 1: with u = |f| / linthresh, s(f) = sign(f)·u / 0.9 for u ≤ 1, else
    /// sign(f)·(1 / 0.9 + log10 u).
    Symlog {
        /// Where the linear part ends, in the field's units; > 0.
        linthresh: f64,
    },
}

impl Scale {
    /// s(f); `f` must be positive under [`Scale::Log10`].
    #[inline(always)]
    pub(super) fn apply(self, f: f64) -> f64 {
        match self {
            Self::Linear => f,
            Self::Log10 => log10(f),
            Self::Symlog { linthresh } => {
                let size = f.abs().min(f64::MAX);
                let u = size / linthresh;
                let s = if u <= 1.0 {
                    u / 0.9
                } else if u <= f64::MAX {
                    1.0 / 0.9 + log10(u)
                } else {
                    1.0 / 0.9 + (log10(size) - log10(linthresh))
                };
                s.copysign(f)
            }
        }
    }

    /// How far means of symlog of values between `low` and `high` may be apart, where those of the
    /// values themselves are by at most `linear`: what the chord over the range makes of that, and the
    /// range of what the scale is more than the chord. That is largest or smallest at an end, where the
    /// scale bends, or where its slope is the chord's.
    pub(super) fn means_apart(self, linear: f64, [low, high]: [f64; 2], linthresh: f64) -> f64 {
        if low >= -linthresh && high <= linthresh {
            return linear / (0.9 * linthresh);
        }
        if !(linear.is_finite() && (high - low).is_finite()) {
            return f64::INFINITY;
        }
        if low == high {
            return 0.0;
        }
        let [first, last] = [low, high].map(|f| self.apply(f));
        let slope = (last - first) / (high - low);
        let alike = (slope * LN_10).recip().max(linthresh);
        let places = [low, high, -alike, -linthresh, linthresh, alike];
        let (mut least, mut most) = (0.0_f64, 0.0_f64);
        for place in places.map(|place| place.clamp(low, high)) {
            let more = self.apply(place) - first - slope * (place - low);
            (least, most) = (least.min(more), most.max(more));
        }
        let rounding = 16.0 * f64::EPSILON * first.abs().max(last.abs());
        (slope * linear + (most - least)) * (1.0 + 1e-9) + rounding
    }
}
