//! What a picture's walks know of a brick before its payload is read: where it is seen, what of it lies in
//! the domain, and, from its index record, how far rays may be off that meet it as it is, or its values
//! in fewer digits.

use super::cut::{Cut, ErrorCut};
use super::octants::Octants;
use crate::cache::{BrickPlace, FieldRecord, Header, NodeRecord, Precision};
use crate::render::brick::load::BrickRequest;
use crate::render::brick::passage::Region;
use crate::render::camera::frame::{Footprint, Frame};
use crate::render::camera::rays::{PixelGrid, PixelRect};
use crate::render::camera::view::View;
use crate::render::transfer::change::Change;
use crate::render::transfer::distance::Distance;
use crate::render::transfer::pieces::PieceList;
use crate::render::transfer::shading::Shading;
use crate::space::{FRACTION_BITS, Position};

/// How much emission and extinction may be ignored in bricks whose stored values are transparent although
/// the source's, from which these differ by storage, may not be.
#[derive(Clone, Copy)]
pub(crate) struct Unseen<'r> {
    /// The transfer function itself.
    pub(crate) exact: &'r PieceList,
    /// Emission and extinction, at most.
    pub(crate) limit: Change,
    /// Error of a ray that misses that much along its whole way, in the picture's own unit.
    pub(crate) off: f64,
}

impl Unseen<'_> {
    /// So many times as much.
    pub(crate) fn times(self, factor: f64) -> Self {
        Self { limit: self.limit.times(factor), off: self.off * factor, ..self }
    }
}

/// What all walks of a picture share.
pub(crate) struct WalkContext<'r> {
    /// The tree's levels, its brick shape and domain.
    pub(crate) header: &'r Header,
    /// The camera.
    pub(crate) view: &'r View,
    /// The picture's pixels.
    pub(crate) pixels: &'r PixelGrid,
    /// What is transparent.
    pub(crate) shading: &'r Shading,
    /// What the transfer function does over ranges.
    pub(crate) bounds: &'r PieceList,
    /// What may be left out where only what is stored is transparent; none: nobody asks what is not.
    pub(crate) unseen: Option<Unseen<'r>>,
    /// Whether values may be read in fewer digits than are stored.
    pub(crate) rounds: bool,
}

/// Cells are narrow if the shorter side of the brick's footprint is at most this many pixels a cell: seen
/// askew, a cell's footprint is up to √3 times its width.
const NARROW: f64 = 1.5;
/// Bricks at least this many pixels wide are met by rays of every pixel that they cover, but at their rim.
/// With areas only these may have the larger limit: what shines in a smaller one may lie between rays.
const WIDE: f64 = 3.0;

/// A node as the camera sees it.
pub(super) struct Seen {
    /// The camera as the brick sees it.
    pub(super) frame: Frame,
    /// The pixels of the walk's window in which it may be seen.
    pub(super) pixels: PixelRect,
    /// Where it is seen on the image plane.
    pub(super) footprint: Footprint,
}

impl WalkContext<'_> {
    /// The brick's lowest corner.
    fn corner(&self, place: &BrickPlace) -> Position {
        self.header.domain.cell_corner(place.octree, place.lowest_cell(self.header.shape))
    }

    /// Where its octants meet.
    pub(super) fn centre(&self, place: &BrickPlace) -> Position {
        let half = self.header.shape.edge() as i128 / 2;
        let lowest = place.lowest_cell(self.header.shape);
        self.header.domain.cell_corner(place.octree, lowest.map(|c| c + half))
    }

    /// The camera as the brick sees it.
    pub(super) fn frame(&self, place: &BrickPlace) -> Frame {
        self.view.frame(&self.corner(place), place.octree, self.header.shape.edge() as f64)
    }

    /// Some octants of the brick, in its cells, as far as they lie in the domain.
    pub(super) fn region(&self, place: &BrickPlace, octants: Octants) -> Option<Region> {
        let edge = self.header.shape.edge() as f64;
        let corner = self.corner(place);
        let upper = self.header.domain.upper();
        let cells_per_unit = f64::from(place.octree - FRACTION_BITS as i32).exp2();
        let bounds = |a: usize| {
            let (lo, hi) = octants.ends(a, edge);
            // Exact where it clips: then it is less than a brick, in units of the root grid.
            let end = upper.0[a].saturating_sub(corner.0[a]) as f64 * cells_per_unit;
            (lo, hi.min(end))
        };
        let axes: [(f64, f64); 3] = std::array::from_fn(bounds);
        let is_inside = axes.iter().all(|(lo, hi)| lo < hi);
        let ends = |a: usize| {
            let lower = corner.0[a] == 0 && axes[a].0 == 0.0;
            let end = upper.0[a].saturating_sub(corner.0[a]) as f64 * cells_per_unit;
            u8::from(lower) << a | u8::from(axes[a].1 >= end) << (3 + a)
        };
        is_inside.then(|| Region {
            lo: axes.map(|axis| axis.0),
            hi: axes.map(|axis| axis.1),
            ends: ends(0) | ends(1) | ends(2),
        })
    }

    /// How far the light of a ray may be off, or of a pixel that is larger than the brick, if the
    /// brick is drawn in place of its children: from the index alone, and what lies in front of
    /// it left aside.
    pub(super) fn error(&self, request: &BrickRequest, seen: &Seen, cut: &ErrorCut) -> f64 {
        let Distance { residual, fills_void, tree, .. } =
            self.shading.distance(&request.record, &request.field, Precision::Full);
        let span = self.bounds.over(tree[0], tree[1]);
        let change = if fills_void {
            span.most
        } else {
            let by_slope = span.slope.times(residual.min(tree[1] - tree[0])).plus(span.jumps);
            by_slope.min(span.variation.plus(span.jumps))
        };
        self.seen_length(seen) * change.light(cut.behind)
    }

    /// Whether a brick with this footprint has narrow cells of which rays tell enough.
    pub(super) fn is_narrow(&self, footprint: &Footprint) -> bool {
        let across = (footprint.plane_hi - footprint.plane_lo) / self.pixels.pixel_size();
        let brick = across.min_element();
        let is_met = !self.pixels.has_area() || brick >= WIDE;
        is_met && brick <= NARROW * self.header.shape.edge() as f64
    }

    /// The longest way of a ray through a brick, or of a pixel's rays on average.
    fn seen_length(&self, seen: &Seen) -> f64 {
        let crossing = seen.frame.crossing(&seen.footprint, self.header.shape.edge() as f64);
        let covered =
            if self.pixels.has_area() { self.pixels.covered(&seen.footprint) } else { 1.0 };
        crossing * covered
    }

    /// How many digits of a brick's values are read: by what these may make of a ray's light, whatever
    /// lies in front, so that all tiles with the same cut read the same. The index tells that by the
    /// steepest slope over all of the brick's values, and for the longest way; rays make far less of it.
    /// Still, with a larger limit more tiles are drawn again because of it.
    pub(super) fn precision(
        &self,
        record: &NodeRecord,
        field: &FieldRecord,
        seen: &Seen,
        cut: &Cut,
    ) -> Precision {
        let fewer = Precision::FEWER.into_iter();
        let mut fewer = fewer.filter(|precision| self.rounds && field.error(*precision) > 0.0);
        let found = match cut {
            Cut::FullDepth => None,
            Cut::Footprint(cut) => fewer.find(|precision| *precision >= cut.precision()),
            Cut::Error(cut) => cut.digits.and_then(|most| {
                fewer
                    .find(|&precision| self.read_error(record, field, precision, seen, cut) <= most)
            }),
        };
        found.unwrap_or(Precision::Full)
    }

    /// How far the light of a ray may be off where a brick's own values are read in fewer digits. Where
    /// others beneath are near, slopes count that these may meet, as in rays' accounts.
    fn read_error(
        &self,
        record: &NodeRecord,
        field: &FieldRecord,
        precision: Precision,
        seen: &Seen,
        cut: &ErrorCut,
    ) -> f64 {
        let own = self.shading.between(field.own, field.has_nan(true));
        let [low, high] = own.unwrap_or([0.0; 2]);
        let distance = self.shading.distance(record, field, Precision::Full);
        let beneath = distance.range_beneath([low, high]);
        let off = self.shading.read_distance(beneath, field, precision);
        let reach = off + distance.near_beneath();
        let span = self.bounds.over(low - reach, high + reach);
        let by_slope = span.slope.times(off).plus(span.jumps);
        let change = by_slope.min(span.variation.plus(span.jumps));
        self.seen_length(seen) * change.light(cut.behind)
    }
}
