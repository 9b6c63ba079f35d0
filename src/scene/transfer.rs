//! The transfer function: what a mapped value absorbs and emits.

use super::piecewise::PiecewiseLinear;
use super::segments::{Segment, Segments};
use super::volume::{ColorTable, VolumeSettings};

/// Absorption κ(x) and emission j(x)·color(x) over x in [0, 1]; x is clamped first and NaN counts
/// as 0. Absorption, emission and colour are each piecewise linear, so emitted light is quadratic
/// between the points of all tables.
#[derive(Debug, Clone, PartialEq)]
pub struct TransferFunction {
    segments: Segments,
    knots: Vec<f64>,
    largest_emission: f64,
    largest_extinction: f64,
}

impl TransferFunction {
    /// The transfer function of a scene's volume.
    pub fn new(volume: &VolumeSettings) -> Self {
        let emission = volume.emission.as_ref().unwrap_or(&volume.absorption);
        Self::from_tables(&volume.absorption, emission, &volume.color)
    }

    /// The transfer function of three tables: absorption and emission in 1 / code length, colour
    /// in linear RGB.
    pub fn from_tables(
        absorption: &PiecewiseLinear,
        emission: &PiecewiseLinear,
        color: &ColorTable,
    ) -> Self {
        let segments = Segments::new(absorption, emission, color.table());
        let largest =
            |value: fn(&Segment) -> f64| segments.all().iter().map(value).fold(0.0, f64::max);
        let (largest_emission, largest_extinction) =
            (largest(Segment::largest_emission), largest(Segment::largest_extinction));
        let mut tables = vec![absorption.positions(), emission.positions()];
        if let ColorTable::List(list) = color {
            tables.push(list.positions());
        }
        let mut knots: Vec<f64> =
            tables.iter().flat_map(|table| table.iter().copied().map(clamp)).collect();
        knots.sort_by(f64::total_cmp);
        knots.dedup();
        Self { segments, knots, largest_emission, largest_extinction }
    }

    /// κ(x), 1 / code length.
    #[inline]
    pub fn extinction(&self, x: f64) -> f64 {
        let x = clamp(x);
        self.segments.at(x).extinction(x)
    }

    /// j(x)·color(x): linear RGB radiance / code length.
    #[inline]
    pub fn emission(&self, x: f64) -> [f64; 3] {
        let x = clamp(x);
        self.segments.at(x).emission(x)
    }

    /// [`Self::extinction`] and [`Self::emission`] with one look-up.
    #[inline]
    pub fn sample(&self, x: f64) -> (f64, [f64; 3]) {
        let x = clamp(x);
        let segment = self.segments.at(x);
        (segment.extinction(x), segment.emission(x))
    }

    /// The x in [0, 1] where absorption, emission or an explicit colour list bends or steps:
    /// sorted, each once. The 256 entries of a named colour map are not among them. 0 and 1 are
    /// where a table has a point there or reaches beyond.
    pub fn knots(&self) -> &[f64] {
        &self.knots
    }

    /// Whether absorption and emission are exactly 0 for every x of [low, high] (clamped to
    /// [0, 1]). False if either is NaN or `low` > `high`.
    pub fn is_transparent(&self, low: f64, high: f64) -> bool {
        low <= high && self.segments.is_transparent(clamp(low), clamp(high))
    }

    /// An upper bound of every channel of [`Self::emission`].
    pub fn largest_emission(&self) -> f64 {
        self.largest_emission
    }

    /// The largest value of [`Self::extinction`].
    pub fn largest_extinction(&self) -> f64 {
        self.largest_extinction
    }
}

/// x in [0, 1], NaN as 0.
#[inline]
fn clamp(x: f64) -> f64 {
    if x > 0.0 { x.min(1.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::colormap::ColorMap;
    use super::*;

    fn table(points: &[(f64, f64)]) -> PiecewiseLinear {
        PiecewiseLinear::new(&points.iter().map(|&(x, y)| (x, [y])).collect::<Vec<_>>()).unwrap()
    }

    fn viridis() -> ColorTable {
        ColorTable::Map(ColorMap::named("viridis").unwrap())
    }

    /// The same by two look-ups in the scene's own tables.
    fn slow(tables: (&PiecewiseLinear, &PiecewiseLinear, &ColorTable), x: f64) -> (f64, [f64; 3]) {
        let x = if x.is_nan() { 0.0 } else { x.clamp(0.0, 1.0) };
        let strength = tables.1.value(x)[0];
        (tables.0.value(x)[0], tables.2.table().value(x).map(|channel| channel * strength))
    }

    fn sorted_tables() -> impl Strategy<Value = PiecewiseLinear> {
        let position = prop_oneof![
            (0u32..=8).prop_map(|n| f64::from(n) / 8.0),
            -0.5f64..1.5,
            (0u32..=3).prop_map(|n| 0.5 + f64::from(n) * f64::EPSILON),
        ];
        let value = prop_oneof![Just(0.0), 0.0f64..10.0];
        prop::collection::vec((position, value), 1..12).prop_map(|mut points| {
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            table(&points)
        })
    }

    fn colors() -> impl Strategy<Value = ColorTable> {
        let list = prop::collection::vec((0u32..=8, prop::array::uniform3(0.0f64..1.0)), 1..6);
        prop_oneof![
            Just(viridis()),
            list.prop_map(|mut points| {
                points.sort_by_key(|point| point.0);
                let points: Vec<_> =
                    points.into_iter().map(|(n, rgb)| (f64::from(n) / 8.0, rgb)).collect();
                ColorTable::List(PiecewiseLinear::new(&points).unwrap())
            }),
        ]
    }

    proptest! {
        #[test]
        fn equals_its_slow_twin(
            absorption in sorted_tables(),
            emission in sorted_tables(),
            color in colors(),
            random in prop::collection::vec(-0.2f64..1.2, 40),
        ) {
            let function = TransferFunction::from_tables(&absorption, &emission, &color);
            let mut at = [absorption.positions(), emission.positions(), &random].concat();
            at.extend([0.0, 1.0, 0.5, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e30]);
            for x in at {
                let (k, rgb) = slow((&absorption, &emission, &color), x);
                let (found_k, found_rgb) = function.sample(x);
                prop_assert!((found_k - k).abs() <= 1e-12 * (1.0 + k), "κ({x}): {found_k} {k}");
                for (found, expected) in found_rgb.iter().zip(rgb) {
                    prop_assert!((found - expected).abs() <= 1e-11, "j({x}): {found} {expected}");
                }
                prop_assert!(found_k <= function.largest_extinction() * (1.0 + 1e-15));
                let bound = function.largest_emission() * (1.0 + 1e-15);
                prop_assert!(found_rgb.iter().all(|channel| *channel <= bound));
            }
        }

        #[test]
        fn transparent_means_zero_everywhere(
            absorption in sorted_tables(),
            emission in sorted_tables(),
            ends in prop::array::uniform2(prop_oneof![
                -0.1f64..1.1,
                (0u32..=8).prop_map(|n| f64::from(n) / 8.0)
            ]),
        ) {
            let color = viridis();
            let (low, high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
            let function = TransferFunction::from_tables(&absorption, &emission, &color);
            let knots = [absorption.positions(), emission.positions()].concat();
            let mut at: Vec<f64> = (0..=500).map(|n| low + (high - low) * f64::from(n) / 500.0)
                .chain(knots.iter().flat_map(|x| [x.next_down(), *x, x.next_up()]))
                .filter(|x| (low..=high).contains(x))
                .collect();
            at.push(low);
            at.push(high);
            let zero = at.iter().all(|&x| slow((&absorption, &emission, &color), x) == (0.0, [0.0; 3]));
            prop_assert_eq!(function.is_transparent(low, high), zero);
        }
    }

    #[test]
    fn steps_and_transparency_at_their_edges() {
        let absorption = table(&[(0.25, 0.0), (0.5, 0.0), (0.5, 3.0), (0.75, 3.0), (0.75, 0.0)]);
        let function = TransferFunction::from_tables(&absorption, &absorption, &viridis());
        assert!(function.is_transparent(-5.0, 0.5_f64.next_down()));
        assert!(!function.is_transparent(0.0, 0.5));
        assert!(!function.is_transparent(0.75_f64.next_down(), 1.0));
        assert!(function.is_transparent(0.75, f64::INFINITY));
        assert!(!function.is_transparent(0.9, 0.8) && !function.is_transparent(f64::NAN, 0.9));
        assert_eq!((function.extinction(0.5), function.extinction(0.75)), (3.0, 0.0));
        let last = table(&[(1.0, 0.0), (1.0, 5.0)]);
        let at_one = TransferFunction::from_tables(&last, &last, &viridis());
        assert_eq!((at_one.extinction(1.0), at_one.extinction(1.0_f64.next_down())), (5.0, 0.0));
        assert!(at_one.is_transparent(0.0, 0.999) && !at_one.is_transparent(0.0, 1.0));
    }

    #[test]
    fn black_emits_nothing() {
        let black = ColorTable::List(PiecewiseLinear::new(&[(0.0, [0.0; 3])]).unwrap());
        let none = table(&[(0.0, 0.0)]);
        let function = TransferFunction::from_tables(&none, &table(&[(0.0, 2.0)]), &black);
        assert!(function.is_transparent(0.0, 1.0));
        assert_eq!(function.largest_emission(), 0.0);
    }

    #[test]
    fn knots_are_those_of_the_scenes_own_tables() {
        let absorption = table(&[(0.25, 0.0), (0.5, 1.0), (0.5, 2.0)]);
        let emission = table(&[(0.3, 0.0), (0.5, 1.0)]);
        let of = |color: &ColorTable| {
            TransferFunction::from_tables(&absorption, &emission, color).knots().to_vec()
        };
        assert_eq!(of(&viridis()), [0.25, 0.3, 0.5]);
        let list = PiecewiseLinear::new(&[(0.0, [1.0; 3]), (0.4, [0.0; 3]), (1.0, [1.0; 3])]);
        assert_eq!(of(&ColorTable::List(list.unwrap())), [0.0, 0.25, 0.3, 0.4, 0.5, 1.0]);
        let beyond = table(&[(-1.0, 0.0), (2.0, 3.0)]);
        let function = TransferFunction::from_tables(&beyond, &beyond, &viridis());
        assert_eq!(function.knots(), [0.0, 1.0]);
        assert_eq!((function.extinction(-3.0), function.extinction(3.0)), (1.0, 2.0));
    }

    #[test]
    fn a_thousand_points_in_one_bucket() {
        let points: Vec<(f64, f64)> =
            (0..1000).map(|n| (0.4 + f64::from(n) * 1e-12, f64::from(n % 7))).collect();
        let absorption = table(&points);
        let function = TransferFunction::from_tables(&absorption, &absorption, &viridis());
        for (x, k) in points {
            assert!((function.extinction(x) - k).abs() < 1e-6);
        }
    }
}
