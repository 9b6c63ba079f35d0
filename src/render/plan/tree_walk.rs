//! The walk of the tree: which pieces of which bricks are drawn in a window of the picture,
//! front to back, from index records alone.

use glam::DVec3;

use super::census::{BrickFate, Tally};
use super::cut::{Cut, ErrorCut};
use super::octants::{Octants, Piece, Pieces};
use crate::cache::{BrickPlace, Cursor, FieldRecord, Header, NodeRecord, Precision};
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
use crate::{Error, Result};

/// Reads index records.
pub(crate) trait Index {
    /// The records of node `node`: its own, and its field's.
    ///
    /// # Errors
    /// An index that is damaged or contradicts itself.
    fn records(&mut self, node: u64) -> Result<(NodeRecord, FieldRecord)>;
}

/// Records of one field of a cache.
pub(crate) struct FieldIndex<'c> {
    /// Reads the cache's index.
    pub cursor: Cursor<'c>,
    /// Which field.
    pub field: usize,
}

impl Index for FieldIndex<'_> {
    fn records(&mut self, node: u64) -> Result<(NodeRecord, FieldRecord)> {
        Ok((self.cursor.node(node)?, self.cursor.field(node, self.field)?))
    }
}

/// How much the source's values may shine and absorb in bricks that are left out since what is stored of
/// them is transparent.
#[derive(Clone, Copy)]
pub(crate) struct Unseen<'r> {
    /// The transfer function itself.
    pub(crate) exact: &'r PieceList,
    /// Emission and extinction, at most.
    pub(crate) limit: Change,
    /// What rays are off by that miss so much all along their way.
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
    pub header: &'r Header,
    /// The camera.
    pub view: &'r View,
    /// The picture's pixels.
    pub pixels: &'r PixelGrid,
    /// What is transparent.
    pub shading: &'r Shading,
    /// What the transfer function does over ranges.
    pub(crate) bounds: &'r PieceList,
    /// What may be left out where only what is stored is transparent; none: nobody asks what is not.
    pub(crate) unseen: Option<Unseen<'r>>,
    /// Whether values may be read in fewer digits than are stored.
    pub(crate) rounds: bool,
}

/// Cells that are narrower than pixels, by the smaller side of what is seen of the brick: askew, that is up
/// to √3 times as wide as they are.
const NARROW: f64 = 1.5;
/// Bricks of so many pixels are met by rays of all pixels that they make a part of, but at their rim. Of
/// areas, others count by the part that they cover, and may shine between rays.
const WIDE: f64 = 3.0;

/// One piece to draw: a brick, or some octants of it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Step {
    /// The brick.
    pub request: BrickRequest,
    /// The camera as the brick sees it.
    pub frame: Frame,
    /// What is drawn of the brick, clipped to the domain.
    pub region: Region,
    /// The pixels in which it may be seen, and where in them.
    pub pixels: PixelRect,
    /// Where it is seen on the image plane.
    pub footprint: Footprint,
    /// Whether it is drawn in place of children.
    pub hides: bool,
    /// Whether no later step draws from this brick.
    pub is_last: bool,
}

/// A node whose octants are being visited.
struct Open {
    request: BrickRequest,
    frame: Frame,
    /// Those that are still to be visited.
    pieces: Pieces,
    fate: BrickFate,
}

/// A walk through the window of pixels `window`, depth first and front to back. Memory grows with
/// the depth only. The tally hears of every brick in the tree once, on its own or as one of a
/// subtree.
pub(crate) struct Walk<'r, I, T> {
    context: &'r WalkContext<'r>,
    index: &'r mut I,
    tally: T,
    cut: &'r Cut,
    window: PixelRect,
    stack: Vec<Open>,
    is_started: bool,
    unseen: f64,
}

impl<'r, I: Index, T: Tally> Walk<'r, I, T> {
    /// A walk that begins at the root.
    pub(crate) fn new(
        context: &'r WalkContext<'r>,
        index: &'r mut I,
        tally: T,
        cut: &'r Cut,
        window: PixelRect,
    ) -> Self {
        let (stack, is_started, unseen) = (Vec::new(), false, 0.0);
        Self { context, index, tally, cut, window, stack, is_started, unseen }
    }

    /// The next piece. What lies wholly behind rays that need nothing more is left out, and what
    /// lies between rays: `needed` says how much of the light from behind any ray of a rectangle
    /// that meets what has a footprint still lets through.
    ///
    /// # Errors
    /// A damaged index.
    pub(crate) fn next(
        &mut self,
        needed: impl Fn(&PixelRect, &Footprint) -> f64,
    ) -> Result<Option<Step>> {
        if !self.is_started {
            self.is_started = true;
            let root = self.context.header.levels.first().map_or(0, |level| level.octree);
            let place = BrickPlace { tree_level: 0, octree: root, coordinates: [0; 3] };
            if let Some(step) = self.visit(0, place, &needed)? {
                return Ok(Some(step));
            }
        }
        while let Some(open) = self.stack.last_mut() {
            let step = match open.pieces.next() {
                Some(Piece::Child(octant)) => {
                    let BrickRequest { record, place, .. } = open.request;
                    let child = record.child(octant).unwrap_or(0);
                    self.visit(child, place.child(octant), &needed)?
                }
                Some(Piece::Own(octants)) => self.own_octants(octants, &needed),
                None => {
                    self.tally.count(open.fate, 1);
                    self.stack.pop();
                    continue;
                }
            };
            if step.is_some() {
                return Ok(step);
            }
        }
        Ok(None)
    }

    /// What rays may be off by for bricks that were left out although the source's values may be seen.
    pub(crate) fn unseen(&self) -> f64 {
        self.unseen
    }

    /// Whether the brick itself (`own`), or all from it down, emits and absorbs nothing, or so little of
    /// what may be the source's values that it counts with the rays.
    fn is_transparent(&mut self, field: &FieldRecord, own: bool) -> bool {
        let shading = self.context.shading;
        let range = if own { field.own } else { field.tree };
        if field.is_void() {
            return true;
        }
        let nan = field.has_nan(own);
        let is_stored_so = shading.is_transparent(range, nan);
        let is_asked = is_stored_so && range[0] <= range[1];
        let unseen = self.context.unseen.filter(|_| is_asked).zip(shading.of_source(range, nan));
        let Some((Unseen { exact, limit, off }, [low, high])) = unseen else {
            return is_stored_so;
        };
        if shading.transfer.is_transparent(low, high) {
            return true;
        }
        let most = exact.over(low, high).most;
        let is_little = most.emission <= limit.emission && most.extinction <= limit.extinction;
        if is_little {
            self.unseen = off;
        }
        is_little
    }

    /// What the tally has heard.
    pub(crate) fn into_tally(self) -> T {
        self.tally
    }

    /// Goes to a node: leaves it and all beneath out, draws it whole, or opens it.
    fn visit(
        &mut self,
        node: u64,
        place: BrickPlace,
        needed: &impl Fn(&PixelRect, &Footprint) -> f64,
    ) -> Result<Option<Step>> {
        if place.tree_level >= self.context.header.levels.len() {
            return Err(Error::invalid(
                format!("brick {node} of the cache"),
                "it lies deeper than the tree has levels; ingest the data again",
            ));
        }
        let (record, field) = self.index.records(node)?;
        let subtree = record.descendants.saturating_add(1);
        let context = self.context;
        let frame = context.frame(&place);
        let edge = context.header.shape.edge() as f64;
        let footprint = frame.footprint(DVec3::ZERO, DVec3::splat(edge));
        let all = footprint.map_or(PixelRect::NONE, |footprint| context.pixels.seen(&footprint));
        let pixels = all.intersection(&self.window);
        let Some(footprint) = footprint.filter(|_| !pixels.is_empty()) else {
            self.tally.count(BrickFate::OutOfView, subtree);
            return Ok(None);
        };
        if self.is_transparent(&field, false) {
            self.tally.count(BrickFate::Transparent, subtree);
            return Ok(None);
        }
        let transmittance = needed(&pixels, &footprint);
        if transmittance == 0.0 {
            self.tally.count(BrickFate::Hidden, subtree);
            return Ok(None);
        }
        let last_tile = context.pixels.last_tile(&all);
        let seen = Seen { frame, pixels, footprint };
        let precision = Precision::Full;
        let request = BrickRequest { node, place, record, field, last_tile, precision };
        let opens = record.child_mask != 0 && self.opens(&request, &seen, transmittance);
        if !opens {
            self.tally.count(BrickFate::Coarser, record.descendants);
            return Ok(self.draw_whole(request, &seen));
        }
        self.open(request, &seen, record.child_mask);
        Ok(None)
    }

    fn opens(&self, request: &BrickRequest, seen: &Seen, transmittance: f64) -> bool {
        match self.cut {
            Cut::FullDepth => true,
            Cut::Footprint(cut) => cut.opens(&request.place),
            Cut::Error(cut) => {
                let is_narrow = self.context.is_narrow(&seen.footprint);
                let limit = if is_narrow { cut.narrow * cut.limit } else { cut.limit };
                transmittance * self.context.error(request, seen, cut) > limit
            }
        }
    }

    fn draw_whole(&mut self, request: BrickRequest, seen: &Seen) -> Option<Step> {
        let region = self.context.region(&request.place, Octants::ALL);
        let hides = request.record.child_mask != 0;
        // What is transparent itself need not be so beneath, and is counted as an error then.
        let counts = hides && matches!(self.cut, Cut::Error(_));
        let is_transparent = !counts && self.is_transparent(&request.field, true);
        let fate = if is_transparent || region.is_none() {
            BrickFate::Transparent
        } else {
            BrickFate::Drawn
        };
        self.tally.count(fate, 1);
        let region = region.filter(|_| !is_transparent)?;
        let request = self.with_digits(request, seen);
        let Seen { frame, pixels, footprint } = *seen;
        Some(Step { request, frame, region, pixels, footprint, hides, is_last: true })
    }

    /// A request for as many digits as a brick that is drawn needs.
    fn with_digits(&self, request: BrickRequest, seen: &Seen) -> BrickRequest {
        let BrickRequest { record, field, .. } = &request;
        let precision = self.context.precision(record, field, seen, self.cut);
        BrickRequest { precision, ..request }
    }

    fn open(&mut self, request: BrickRequest, seen: &Seen, opened: u8) {
        let context = self.context;
        let is_transparent = self.is_transparent(&request.field, true);
        let has_own = |octant: u8| {
            let octants = Octants::one(octant);
            opened >> octant & 1 == 0 && context.region(&request.place, octants).is_some()
        };
        let own =
            (0..8).filter(|&octant| has_own(octant)).fold(0, |mask, octant| mask | 1 << octant);
        let order = context.view.octant_order(&context.centre(&request.place));
        let fate =
            if own != 0 && is_transparent { BrickFate::Transparent } else { BrickFate::Covered };
        let own = if is_transparent { 0 } else { own };
        let request = if own == 0 { request } else { self.with_digits(request, seen) };
        let pieces = Pieces::new(opened, own, order);
        self.stack.push(Open { request, frame: seen.frame, pieces, fate });
    }

    /// Octants that the node on top of the stack draws itself.
    fn own_octants(
        &mut self,
        octants: Octants,
        needed: &impl Fn(&PixelRect, &Footprint) -> f64,
    ) -> Option<Step> {
        let Open { request, frame, pieces, .. } = *self.stack.last()?;
        let region = self.context.region(&request.place, octants)?;
        let footprint = frame.footprint(region.lo.into(), region.hi.into())?;
        let pixels = self.pixels_of(&footprint);
        if pixels.is_empty() {
            return None;
        }
        self.stack.last_mut()?.fate = BrickFate::Drawn;
        let is_last = pieces.are_only_children();
        let step = Step { request, frame, region, pixels, footprint, hides: false, is_last };
        (needed(&pixels, &footprint) > 0.0).then_some(step)
    }

    fn pixels_of(&self, footprint: &Footprint) -> PixelRect {
        self.context.pixels.seen(footprint).intersection(&self.window)
    }
}

/// A node as the camera sees it.
struct Seen {
    frame: Frame,
    pixels: PixelRect,
    footprint: Footprint,
}

impl WalkContext<'_> {
    /// The brick's lowest corner.
    fn corner(&self, place: &BrickPlace) -> Position {
        self.header.domain.cell_corner(place.octree, place.lowest_cell(self.header.shape))
    }

    /// Where its octants meet.
    fn centre(&self, place: &BrickPlace) -> Position {
        let half = self.header.shape.edge() as i128 / 2;
        let lowest = place.lowest_cell(self.header.shape);
        self.header.domain.cell_corner(place.octree, lowest.map(|c| c + half))
    }

    /// The camera as the brick sees it.
    fn frame(&self, place: &BrickPlace) -> Frame {
        self.view.frame(&self.corner(place), place.octree, self.header.shape.edge() as f64)
    }

    /// Some octants of the brick, in its cells, as far as they lie in the domain.
    fn region(&self, place: &BrickPlace, octants: Octants) -> Option<Region> {
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
    fn error(&self, request: &BrickRequest, seen: &Seen, cut: &ErrorCut) -> f64 {
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
    fn is_narrow(&self, footprint: &Footprint) -> bool {
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
    fn precision(
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

#[cfg(test)]
#[path = "tree_walk_tests.rs"]
mod tests;
