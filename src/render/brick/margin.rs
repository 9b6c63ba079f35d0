//! What of a brick its own level does not fill: there the next coarser level is all there is, and
//! rays go through that one's cells, half as many and without borders.
//!
//! A place whose cell does not exist has the coarser levels' interpolant, as if the level were not
//! there (`render/brick/interpolant.rs`). So the brick's box is cut at the faces of the smallest box that
//! holds all cells that exist, and what lies around it is drawn as a brick of the coarser level.

use super::interpolant::DrawnNeighbours;
use super::passage::{Passage, Region};
use super::scaled::ScaledBrick;
use crate::cache::{Block, state};
use crate::render::camera::frame::{Footprint, Frame};

/// The smallest box of whole coarser cells that holds all cells that exist, in the brick's cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct WholeCells {
    /// Lowest cell along each axis; the brick's edge where no cell exists.
    pub(super) lo: [usize; 3],
    /// One behind the highest cell along each axis; 0 where no cell exists.
    pub(super) hi: [usize; 3],
}

impl WholeCells {
    /// The box of a brick of `edge` cells whose own block, ghosts included, is `block`.
    pub(super) fn of(block: &Block, edge: usize) -> Self {
        let mut core = Self { lo: [edge; 3], hi: [0; 3] };
        for z in 0..edge {
            for y in 0..edge {
                let row = &block.states[block.at(1, y + 1, z + 1)..][..edge];
                let exists = |bits: &u8| *bits != 0 && bits & state::COARSER == 0;
                let Some(first) = row.iter().position(exists) else { continue };
                let last = row.iter().rposition(exists).unwrap_or(first);
                core.take([first, y, z]);
                core.take([last, y, z]);
            }
        }
        core
    }

    /// Takes in a cell, and its neighbours in the coarser one.
    fn take(&mut self, cell: [usize; 3]) {
        for ((lo, hi), c) in self.lo.iter_mut().zip(&mut self.hi).zip(cell) {
            *lo = (*lo).min(c & !1);
            *hi = (*hi).max((c | 1) + 1);
        }
    }

    /// Whether all of a brick of `edge` cells is in it.
    pub(super) fn is_all(&self, edge: usize) -> bool {
        *self == Self { lo: [0; 3], hi: [edge; 3] }
    }
}

/// A box of one level's cells within a brick, and the camera as it sees it.
pub(crate) struct Part<'b> {
    /// The brick whose cells are passed, and the box of it that is drawn.
    pub(crate) passage: Passage<'b>,
    /// The camera in the coordinates of that brick.
    pub(crate) frame: Frame,
    /// Where the box is seen on the image plane.
    pub(crate) footprint: Footprint,
}

impl<'b> Part<'b> {
    /// The same part drawn by `brick` instead, which covers the same space in cells twice as wide
    /// and hides nothing.
    pub(crate) fn wider(self, brick: &'b ScaledBrick) -> Self {
        let Self { passage, frame, footprint } = self;
        let half = |corner: [f64; 3]| corner.map(|x| 0.5 * x);
        let Region { lo, hi, ends } = passage.region;
        let region = Region { lo: half(lo), hi: half(hi), ends };
        let passage = Passage { brick, region, drawn: DrawnNeighbours::ALL, hides: false };
        Self { passage, frame: frame.coarser(), footprint }
    }
}

/// The parts that rays pass in what a passage draws, front to back, whatever the ray. All of it is
/// seen within `footprint`.
pub(crate) fn parts<'b>(
    passage: &Passage<'b>,
    frame: &Frame,
    footprint: &Footprint,
) -> Vec<Part<'b>> {
    let Some((core, coarse)) = passage.brick.margin() else {
        return vec![Part { passage: *passage, frame: *frame, footprint: *footprint }];
    };
    let (before, rest, behind) = cut(passage.region, core, frame);
    let part = |region: Region, is_core: bool| {
        let footprint = frame.footprint(region.lo.into(), region.hi.into())?;
        let part = Part { passage: Passage { region, ..*passage }, frame: *frame, footprint };
        // Nothing finer lies beneath holes.
        Some(if is_core { part } else { part.wider(coarse) })
    };
    let outside = |region| part(region, false);
    let mut parts: Vec<_> = before.into_iter().filter_map(outside).collect();
    parts.extend(rest.and_then(|region| part(region, true)));
    parts.extend(behind.into_iter().rev().filter_map(outside));
    parts
}

/// Cuts a region at the faces of `core`: what lies before the core's part of it, that part, and what
/// lies behind, farthest first.
fn cut(
    region: Region,
    core: &WholeCells,
    frame: &Frame,
) -> (Vec<Region>, Option<Region>, Vec<Region>) {
    let (mut before, mut behind) = (Vec::new(), Vec::new());
    let mut rest = region;
    for a in 0..3 {
        for (plane, core_is_upper) in [(core.lo[a], true), (core.hi[a], false)] {
            let plane = plane as f64;
            let upper_first = frame.meets_upper_first(a, plane);
            let aside = if core_is_upper { plane > rest.lo[a] } else { plane < rest.hi[a] };
            if !aside {
                continue;
            }
            let all_aside = if core_is_upper { plane >= rest.hi[a] } else { plane <= rest.lo[a] };
            if all_aside {
                before.push(rest);
                return (before, None, behind);
            }
            let (mut lower, mut upper) = (rest, rest);
            (lower.hi[a], upper.lo[a]) = (plane, plane);
            lower.ends &= !(0b1000 << a);
            upper.ends &= !(1 << a);
            let (kept, other) = if core_is_upper { (upper, lower) } else { (lower, upper) };
            if upper_first == core_is_upper { &mut behind } else { &mut before }.push(other);
            rest = kept;
        }
    }
    (before, Some(rest), behind)
}
