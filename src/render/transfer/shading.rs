//! From stored values to light: the scene's volume over one field of the cache.

use super::distance::Distance;
use crate::cache::{CachedField, EMPTY_RANGE, FieldRecord, Header, NodeRecord, Precision};
use crate::lanes::{Kernel, Lanes, Width};
use crate::scene::{
    FieldExtrema, Interpolation, Mapping, Rounding, TransferFunction, Units, VolumeSettings,
};
use crate::{Error, Result};

/// The field that is shown, and how its values become colours.
#[derive(Debug, Clone)]
pub(crate) struct Shading {
    /// Which field of the cache.
    pub field: usize,
    /// What the field is between cell centres.
    pub interpolation: Interpolation,
    /// Absorption and emission over x.
    pub transfer: TransferFunction,
    mapping: Mapping,
    /// A field value is this times the stored one.
    factor: f64,
    /// Largest relative error of a stored value against the source's.
    relative_error: f64,
    /// Largest relative error of a leaf cell's stored value against the source's.
    leaf_error: f64,
    /// Values below it, code units, are stored with fewer digits.
    least_exact: f64,
}

/// Rounding of a relative error in f64, relative to it.
const ERROR_ROUNDING: f64 = 1e-6;

impl Shading {
    /// Looks the volume's field up in the cache, without regard to case.
    ///
    /// # Errors
    /// A field that the cache does not hold, cgs units where the source does not say how, and a
    /// mapping without a finite range.
    pub(crate) fn new(
        volume: &VolumeSettings,
        interpolation: Interpolation,
        header: &Header,
    ) -> Result<Self> {
        let field = header
            .find_field(&volume.field)
            .map_err(|reason| Error::request(format!("the cache {reason}")))?;
        let cached = &header.fields[field];
        let to_units = units_factor(volume, cached)?;
        // A field without any leaf value, all dropped or NaN, has no extrema: a constant then.
        let none = cached.min > cached.max;
        let extrema = FieldExtrema {
            minimum: if none { 0.0 } else { cached.min },
            maximum: if none { 0.0 } else { cached.max },
            smallest_positive: cached.smallest_positive,
        };
        Ok(Self {
            field,
            interpolation,
            transfer: TransferFunction::new(volume),
            mapping: Mapping::new(volume.scale, volume.range, extrema, to_units)?,
            factor: f64::from(cached.exponent).exp2(),
            // Found in f64, which rounds.
            relative_error: cached.relative_error * (1.0 + ERROR_ROUNDING),
            leaf_error: cached.leaf_error * (1.0 + ERROR_ROUNDING),
            least_exact: cached.least_exact(),
        })
    }

    /// Whether values are stored with all digits that f32 has, so that reading fewer is worthwhile.
    pub(crate) fn has_all_digits(&self) -> bool {
        self.relative_error < f64::from(f32::EPSILON)
    }

    /// Whether values are stored as the source has them.
    pub(crate) fn is_exact(&self) -> bool {
        self.mapping.rounding(self.relative_error, self.least_exact) == Rounding::default()
    }

    /// How far x of a brick's own values, between `low` and `high`, may be off where they are read in
    /// fewer digits.
    pub(crate) fn read_distance(
        &self,
        [low, high]: [f64; 2],
        field: &FieldRecord,
        precision: Precision,
    ) -> f64 {
        self.rounding(0.0, field, precision).between(low, high)
    }

    /// How far values of a brick are off as they are read, where those stored are by so much.
    fn rounding(&self, stored: f64, field: &FieldRecord, precision: Precision) -> Rounding {
        let read = f64::from(field.error(precision));
        self.mapping.rounding(stored + read * (1.0 + stored), self.least_exact)
    }

    /// How far what a brick draws may be from the truth.
    pub(crate) fn distance(
        &self,
        record: &NodeRecord,
        field: &FieldRecord,
        precision: Precision,
    ) -> Distance {
        let residual = match (record.descendants, self.interpolation) {
            (0, _) => 0.0,
            // Residuals are those of the interpolant.
            (_, Interpolation::Cell) => f64::INFINITY,
            (_, Interpolation::Linear) => {
                let stored = |value: f32| f64::from(value) * self.factor;
                let (linear, log10) = (stored(field.residual_linear), field.residual_log10);
                self.mapping.distance(linear, f64::from(log10), field.tree.map(stored))
            }
        };
        Distance {
            residual,
            child_mask: record.child_mask,
            fills_void: field.fills_void(),
            tree: self.range(field),
            storage: self.rounding(self.relative_error, field, precision),
            leaf_storage: self.rounding(self.leaf_error, field, precision),
            is_rounded: precision != Precision::Full,
        }
    }

    /// What x can be in a brick's box at any level.
    pub(super) fn range(&self, field: &FieldRecord) -> [f64; 2] {
        self.between(field.tree, field.has_nan(false)).unwrap_or([0.0; 2])
    }

    /// What x can be between stored values from `min` to `max`, in order, and NaN as well if `nan`;
    /// none where there are no values.
    pub(crate) fn between(&self, [min, max]: [f32; 2], nan: bool) -> Option<[f64; 2]> {
        let values = (min <= max).then(|| [self.map(min), self.map(max)]);
        let nan = nan.then(|| [self.map(f32::NAN); 2]);
        let both =
            |[low, high]: [f64; 2], [least, most]: [f64; 2]| [low.min(least), high.max(most)];
        values.into_iter().chain(nan).reduce(both)
    }

    /// The transfer function's x of a stored value, unclamped.
    pub(crate) fn map(&self, stored: f32) -> f64 {
        self.mapping.unclamped(f64::from(stored) * self.factor)
    }

    /// [`Self::map`] of all `stored` values.
    pub(crate) fn map_all(&self, stored: &[f32], x: &mut [f64]) {
        Width::best().run(MapAll { shading: self, stored, x });
    }

    /// What x may be between the source's values that are stored as from `min` to `max`, in order, and
    /// NaN as well if `nan`; the same as stored where these are exact.
    pub(crate) fn of_source(&self, range: [f32; 2], nan: bool) -> Option<[f64; 2]> {
        let [low, high] = self.between(range, nan)?;
        let rounding = self.mapping.rounding(self.relative_error, self.least_exact);
        let off = rounding.between(low, high);
        Some([low - off, high + off])
    }

    /// Whether nothing that is drawn of stored values in `range` (and NaN, if `nan`) emits or absorbs. An
    /// empty range holds nothing.
    pub(crate) fn is_transparent(&self, range: [f32; 2], nan: bool) -> bool {
        let is_nothing = |found: Option<[f64; 2]>| {
            found.is_none_or(|[low, high]| self.transfer.is_transparent(low, high))
        };
        match self.interpolation {
            // Beside a NaN cell values are between what it counts as and those around it.
            Interpolation::Linear => is_nothing(self.between(range, nan)),
            Interpolation::Cell => {
                is_nothing(self.between(range, false)) && is_nothing(self.between(EMPTY_RANGE, nan))
            }
        }
    }
}

/// The mapping of many values.
struct MapAll<'m> {
    shading: &'m Shading,
    stored: &'m [f32],
    x: &'m mut [f64],
}

impl Kernel for MapAll<'_> {
    type Output = ();

    // A plain loop, compiled for the processor that the lanes are of. By copies: for all that the
    // compiler knows a reference might lead to the output, and then it takes values one by one.
    #[inline(always)]
    fn run<L: Lanes>(self, _: L) {
        let Shading { mapping, factor, .. } = self.shading;
        let (mapping, factor) = (*mapping, *factor);
        mapping.unclamped_all(self.stored, factor, self.x);
    }
}

fn units_factor(volume: &VolumeSettings, field: &CachedField) -> Result<f64> {
    match (volume.units, field.to_cgs) {
        (Units::Code, _) => Ok(1.0),
        (Units::Cgs, Some(factor)) => Ok(factor),
        (Units::Cgs, None) => Err(Error::request(format!(
            "field `{}` has no conversion to cgs in its source: use units = \"code\"",
            field.name
        ))),
    }
}
