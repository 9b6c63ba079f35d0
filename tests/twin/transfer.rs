//! From a field value to extinction and radiance.

use super::Result;
use super::polynomial::Polynomial;

/// How field values are scaled before they are mapped (and, in `linear` pictures, interpolated).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Scale {
    Linear,
    /// Values at or below `floor`, the smallest positive leaf value, count as it.
    Log10 {
        floor: f64,
    },
    /// Linear within ±`threshold`, decades beyond (matplotlib's definition with `linscale` 1).
    SymLog {
        threshold: f64,
    },
}

impl Scale {
    pub(crate) fn apply(self, value: f64) -> f64 {
        match self {
            Self::Linear => value,
            Self::Log10 { floor } => value.max(floor).log10(),
            Self::SymLog { threshold } => {
                let linear = 1.0 / (1.0 - 0.1);
                let size = value.abs();
                if size <= threshold {
                    return value * linear;
                }
                value.signum() * threshold * (linear + (size / threshold).log10())
            }
        }
    }

    /// `value`, or under `Log10` the floor where that is more.
    pub(crate) fn raised(self, value: f64) -> f64 {
        if let Self::Log10 { floor } = self { value.max(floor) } else { value }
    }

    /// The scaled value of a bound of the scene's range, to which no floor applies.
    fn apply_bound(self, bound: f64) -> f64 {
        match self {
            Self::Log10 { .. } if bound > 0.0 => bound.log10(),
            _ => self.apply(bound),
        }
    }
}

/// Piecewise linear in `x`, constant beyond the end points; two points at one `x` are a step, and
/// the second holds there.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Table(Vec<(f64, f64)>);

impl Table {
    pub(crate) fn new(points: Vec<(f64, f64)>) -> Result<Self> {
        if points.is_empty() || points.windows(2).any(|p| p[0].0 > p[1].0) {
            return Err("a table needs points in ascending order".into());
        }
        Ok(Self(points))
    }

    pub(crate) fn at(&self, x: f64) -> f64 {
        let (first, last) = (self.0[0], self.0[self.0.len() - 1]);
        if x < first.0 {
            return first.1;
        }
        let above = self.0.iter().position(|p| p.0 > x);
        above.map_or(last.1, |n| {
            let ((x0, y0), (x1, y1)) = (self.0[n - 1], self.0[n]);
            y0 + (y1 - y0) * ((x - x0) / (x1 - x0))
        })
    }
}

/// What the medium does at one value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Optics {
    /// Extinction, 1 / code length.
    pub(crate) extinction: f64,
    /// Emission, radiance / code length, without the colour.
    pub(crate) emission: f64,
    /// Linear RGB.
    pub(crate) color: [f64; 3],
}

/// A scene's volume: scale, range and tables.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Transfer {
    pub(crate) scale: Scale,
    low: f64,
    high: f64,
    pub(crate) absorption: Table,
    pub(crate) emission: Table,
    pub(crate) color: [Table; 3],
}

impl Transfer {
    /// `range`: the field values that map to 0 and 1.
    pub(crate) fn new(
        scale: Scale,
        range: [f64; 2],
        absorption: Table,
        emission: Table,
        color: [Table; 3],
    ) -> Result<Self> {
        let [low, high] = range.map(|bound| scale.apply_bound(bound));
        if !(low.is_finite() && high.is_finite() && low < high) {
            return Err(format!("the range {range:?} is empty"));
        }
        Ok(Self { scale, low, high, absorption, emission, color })
    }

    /// The scaled value of a cell; NaN counts as the range's lower end.
    pub(crate) fn scaled(&self, value: f64) -> f64 {
        if value.is_nan() { self.low } else { self.scale.apply(value) }
    }

    /// The scaled values that map to 0 and 1.
    pub(crate) fn bounds(&self) -> [f64; 2] {
        [self.low, self.high]
    }

    /// The mapped value of a scaled one, before it is clamped to 0 … 1.
    pub(crate) fn map(&self, scaled: f64) -> f64 {
        (scaled - self.low) / (self.high - self.low)
    }

    /// The mapped value along a stretch where the scaled one is `scaled`.
    pub(crate) fn map_along(&self, scaled: &Polynomial) -> Polynomial {
        scaled.plus(&Polynomial::constant(-self.low)).scaled(1.0 / (self.high - self.low))
    }

    /// What the medium does at the mapped value `x`.
    pub(crate) fn optics(&self, x: f64) -> Optics {
        let x = x.clamp(0.0, 1.0);
        Optics {
            extinction: self.absorption.at(x),
            emission: self.emission.at(x),
            color: std::array::from_fn(|c| self.color[c].at(x)),
        }
    }

    /// Where any table has a kink, ascending, 0 and 1 (where clamping begins) included.
    pub(crate) fn kinks(&self) -> Vec<f64> {
        let tables = self.color.iter().chain([&self.absorption, &self.emission]);
        let mut kinks: Vec<f64> = tables.flat_map(|t| t.0.iter().map(|p| p.0)).collect();
        kinks.retain(|x| 0.0 < *x && *x < 1.0);
        kinks.extend([0.0, 1.0]);
        kinks.sort_by(f64::total_cmp);
        kinks.dedup();
        kinks
    }
}
