//! The walk of the tree: which pieces of which bricks are drawn in a window of the picture,
//! front to back, from index records alone.

use glam::DVec3;

use super::census::{BrickFate, Tally};
use super::cut::Cut;
use super::octants::{Octants, Piece, Pieces};
use super::walk_context::{Seen, Unseen, WalkContext};
use crate::cache::{BrickPlace, Cursor, FieldRecord, NodeRecord, Precision};
use crate::render::brick::load::BrickRequest;
use crate::render::brick::passage::Region;
use crate::render::camera::frame::{Footprint, Frame};
use crate::render::camera::rays::PixelRect;
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
    unseen_error: f64,
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
        let (stack, is_started, unseen_error) = (Vec::new(), false, 0.0);
        Self { context, index, tally, cut, window, stack, is_started, unseen_error }
    }

    /// The next piece. What lies wholly behind rays that need nothing more is left out, and what
    /// lies between rays: `needed(pixels, footprint)` is the largest transmittance of the rays in
    /// `pixels` that meet what has this footprint and still need light; 0 where there is none.
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
    pub(crate) fn unseen_error(&self) -> f64 {
        self.unseen_error
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
            self.unseen_error = off;
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

#[cfg(test)]
#[path = "tree_walk_tests.rs"]
mod tests;
