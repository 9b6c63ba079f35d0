//! The transfer function's tables, cut at all their points and found in constant time.

use super::piecewise::PiecewiseLinear;

/// Buckets of the look-up table over [0, 1]: a power of two, so that bucket edges are exact.
const BUCKETS: usize = 1024;

/// Absorption, emission and colour from `start` up to the next segment, each linear.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Segment {
    start: f64,
    /// 1 / width, finite: the fraction of a subnormal width stays a number.
    inverse_width: f64,
    extinction: [f64; 2],
    emission: [f64; 2],
    color: [[f64; 3]; 2],
}

impl Segment {
    #[inline]
    fn fraction(&self, x: f64) -> f64 {
        ((x - self.start) * self.inverse_width).min(1.0)
    }

    /// Absorption at `x` inside the segment, 1 / code length.
    #[inline]
    pub(super) fn extinction(&self, x: f64) -> f64 {
        mix(self.extinction, self.fraction(x))
    }

    /// Emission times colour at `x` inside the segment, radiance / code length.
    #[inline]
    pub(super) fn emission(&self, x: f64) -> [f64; 3] {
        let t = self.fraction(x);
        let strength = mix(self.emission, t);
        std::array::from_fn(|c| strength * mix([self.color[0][c], self.color[1][c]], t))
    }

    /// Whether nothing is emitted or absorbed anywhere in the segment.
    fn is_transparent(&self) -> bool {
        self.extinction == [0.0; 2] && (self.emission == [0.0; 2] || self.color == [[0.0; 3]; 2])
    }

    /// Whether nothing is emitted or absorbed at the segment's first x.
    fn is_transparent_at_start(&self) -> bool {
        self.extinction[0] == 0.0 && (self.emission[0] == 0.0 || self.color[0] == [0.0; 3])
    }

    /// A bound of the emission of any channel within the segment.
    pub(super) fn largest_emission(&self) -> f64 {
        let largest = self.color.iter().flatten().copied().fold(0.0, f64::max);
        self.emission[0].max(self.emission[1]) * largest
    }

    /// The largest absorption within the segment.
    pub(super) fn largest_extinction(&self) -> f64 {
        self.extinction[0].max(self.extinction[1])
    }
}

#[inline]
fn mix([left, right]: [f64; 2], t: f64) -> f64 {
    left * (1.0 - t) + right * t
}

/// All segments over [0, 1], the last one standing for x = 1 alone.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Segments {
    segments: Vec<Segment>,
    /// For each bucket the segment that holds its lower edge; one more for x = 1.
    first: Vec<u16>,
    /// How many segments before this one are not transparent.
    opaque_before: Vec<u32>,
}

impl Segments {
    /// Cuts the three functions at all their points inside [0, 1].
    pub(super) fn new(
        extinction: &PiecewiseLinear,
        emission: &PiecewiseLinear,
        color: &PiecewiseLinear<3>,
    ) -> Self {
        let starts = merge(&[extinction.positions(), emission.positions(), color.positions()]);
        let segment = |index: usize| {
            let start = starts[index];
            let end = starts.get(index + 1).copied();
            let ([k], [e]) = (extinction.value(start), emission.value(start));
            let right = |f: &PiecewiseLinear| end.map_or(f.value(start)[0], |x| f.left_limit(x)[0]);
            let color_right = end.map_or(color.value(start), |x| color.left_limit(x));
            Segment {
                start,
                inverse_width: end.map_or(1.0, |x| (1.0 / (x - start)).min(f64::MAX)),
                extinction: [k, right(extinction)],
                emission: [e, right(emission)],
                color: [color.value(start), color_right],
            }
        };
        Self::index((0..starts.len()).map(segment).collect())
    }

    fn index(segments: Vec<Segment>) -> Self {
        let mut opaque = 0;
        let opaque_before = segments
            .iter()
            .map(|segment| {
                let before = opaque;
                opaque += u32::from(!segment.is_transparent());
                before
            })
            .collect();
        let holding = |edge: f64| segments.partition_point(|s| s.start <= edge).saturating_sub(1);
        let first = (0..=BUCKETS)
            .map(|bucket| holding(bucket as f64 / BUCKETS as f64))
            .map(|index| u16::try_from(index).unwrap_or(u16::MAX))
            .collect();
        Self { segments, first, opaque_before }
    }

    /// The segments in order.
    pub(super) fn all(&self) -> &[Segment] {
        &self.segments
    }

    /// The segment that holds `x`, which must lie in [0, 1].
    #[inline]
    pub(super) fn at(&self, x: f64) -> &Segment {
        &self.segments[self.find(x)]
    }

    #[inline]
    fn find(&self, x: f64) -> usize {
        let bucket = ((x * BUCKETS as f64) as usize).min(BUCKETS - 1);
        let (low, high) = (usize::from(self.first[bucket]), usize::from(self.first[bucket + 1]));
        if low == high {
            return low;
        }
        low + self.segments[low + 1..=high].partition_point(|segment| segment.start <= x)
    }

    /// Whether no x of [low, high], within [0, 1], emits or absorbs.
    pub(super) fn is_transparent(&self, low: f64, high: f64) -> bool {
        let (first, last) = (self.find(low), self.find(high));
        if low == high {
            let segment = &self.segments[first];
            return segment.extinction(low) == 0.0 && segment.emission(low) == [0.0; 3];
        }
        let end = &self.segments[last];
        let end_transparent =
            if high > end.start { end.is_transparent() } else { end.is_transparent_at_start() };
        end_transparent && self.opaque_before[first] == self.opaque_before[last]
    }
}

/// 0, 1 and all positions between them: sorted, each once.
fn merge(tables: &[&[f64]]) -> Vec<f64> {
    let inside = |x: &f64| *x > 0.0 && *x < 1.0;
    let mut merged = vec![0.0, 1.0];
    merged.extend(tables.iter().flat_map(|table| table.iter().copied().filter(inside)));
    merged.sort_by(f64::total_cmp);
    merged.dedup();
    merged
}
