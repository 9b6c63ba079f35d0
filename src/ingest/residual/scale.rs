//! How values are mapped before they are interpolated.

use crate::lanes::{Kernel, Lanes, Width};
use crate::log10::log10;

/// A map of stored values that never falls.
#[derive(Debug, Clone, Copy)]
pub(in crate::ingest) enum Scale {
    /// The stored value.
    Linear,
    /// log10 of the stored value times `factor`, where that is raised to `floor` > 0 first.
    Log10 { factor: f64, floor: f64 },
}

impl Scale {
    /// Maps values, of which none is NaN.
    pub(super) fn map(self, stored: &[f32], mapped: &mut Vec<f64>) {
        mapped.resize(stored.len(), 0.0);
        Width::best().run(Map { scale: self, stored, mapped });
    }
}

struct Map<'v> {
    scale: Scale,
    stored: &'v [f32],
    mapped: &'v mut [f64],
}

impl Kernel for Map<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, _: L) {
        let pairs = self.mapped.iter_mut().zip(self.stored);
        match self.scale {
            Scale::Linear => pairs.for_each(|(mapped, &stored)| *mapped = f64::from(stored)),
            Scale::Log10 { factor, floor } => pairs.for_each(|(mapped, &stored)| {
                let value = f64::from(stored) * factor;
                *mapped = log10(if value > floor { value } else { floor });
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_values_are_mapped_as_each_is() {
        let stored: Vec<f32> = (-50..51).map(|n| (n as f32 * 0.31).sinh()).collect();
        let (factor, floor) = (0.25, 1e-3);
        let mut mapped = Vec::new();
        Scale::Linear.map(&stored, &mut mapped);
        assert!(stored.iter().zip(&mapped).all(|(&v, &m)| m == f64::from(v)));
        Scale::Log10 { factor, floor }.map(&stored, &mut mapped);
        for (&value, mapped) in stored.iter().zip(mapped) {
            let expected = (f64::from(value) * factor).max(floor).log10();
            assert!((mapped - expected).abs() <= 1e-15 * expected.abs(), "{value}");
        }
    }
}
