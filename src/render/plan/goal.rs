//! What a picture is to be, and how far a tile of it has come.

use super::cut::{Cut, ErrorCut};
use crate::render::bounds::shares::{ErrorShares, LIKELY_OF_BOUND};

/// The part of the goal that a first batch leaves to a single brick: few bricks along a ray are off by as
/// much as the cut allows. With twice as much rays miss the goal where cells are far wider than pixels, and
/// are marched again.
const FIRST_LIMIT: f64 = 0.15;
/// The part of it that a first batch leaves to what a brick's values may be off by as they are read,
/// of rays that stand for themselves, and for areas: these come through a brick again and again, with
/// smaller limits, which should find it in as many digits as before; hardly so where rays are trusted. With
/// larger parts fewer bytes are read at first, but more bricks twice.
const FIRST_DIGITS: f64 = 0.1;
const FIRST_DIGITS_OF_AREAS: f64 = 0.02;
const FIRST_DIGITS_UNCERTIFIED: f64 = 0.04;
/// The part of it that the march of packets may use. For areas the tolerance counts as at least
/// `LEAST_OF_AREAS` of the expected light here: below that, want of rays makes more than the march does.
const PACKETS: f64 = 0.25;
const LEAST_OF_AREAS: f64 = 3e-5;
/// The slowest that bounds are taken to fall: with this power of the number of rays.
const SLOWEST: f64 = 0.05;
/// How many times the limit bricks of narrow cells have at most.
pub(crate) const MOST_OF_NARROW: f64 = 8.0;
/// Cuts that allow less than this part of the goal for a brick are none.
const SMALLEST_LIMIT: f64 = 1e-7;

/// How exact a picture must be.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Goal {
    /// The largest error of any channel of any pixel, in the picture's own unit.
    pub(crate) tolerance: f64,
    /// Light that is expected from behind a brick.
    pub(crate) behind: f64,
    /// Rays that a tile takes at most for each of its pixels, where these stand for areas.
    pub(crate) rays_per_pixel: u64,
    /// The same where bounds are not sought, but what may shine is.
    pub(crate) scouting_per_pixel: u64,
    /// Rays that a tile takes at most for each of its pixels, where these stand for themselves.
    pub(crate) alone_per_pixel: u64,
    /// How often a pixel is halved at most for rays that stand for areas.
    pub(crate) most_halvings: u8,
    /// How often a pixel is halved at least for rays that stand for themselves.
    pub(crate) least_halvings: u8,
    /// How often a pixel is halved that is dark and may not be, by its bound.
    pub(crate) glint_halvings: u8,
    /// Whether all pixels' bounds are to come within the tolerance, so that rays are spent on these.
    pub(crate) certifies: bool,
    /// Whether rays may be off by more than pixels may be for that, since they are likely off by less.
    pub(crate) trusts_rays: bool,
    /// The power of the number of rays that bounds fall with, until a group of pixels knows its own.
    pub(crate) power: f64,
    /// Whether the picture's pixels stand for areas.
    pub(crate) has_area: bool,
    /// Whether all levels are drawn whatever the tolerance.
    pub(crate) all_levels: bool,
    /// Whether a few rays of each tile tell what the others begin with.
    pub(crate) sounds: bool,
}

impl Goal {
    /// The cut that pixels begin with where nothing is known of them.
    pub(crate) fn first_cut(&self) -> Cut {
        self.coarser_cut(1.0)
    }

    /// The same cut, but as coarse as it may be where cells are narrow.
    pub(crate) fn coarsest_cut(&self) -> Cut {
        self.coarser_cut(MOST_OF_NARROW)
    }

    /// The same cut, but one that leaves so many times as much to bricks of `narrow` cells.
    pub(crate) fn coarser_cut(&self, narrow: f64) -> Cut {
        let digits = match (self.has_area, self.trusts_rays) {
            (false, _) => FIRST_DIGITS,
            (true, false) => FIRST_DIGITS_OF_AREAS,
            (true, true) => FIRST_DIGITS_UNCERTIFIED,
        };
        let allowed = self.of_rays(self.tolerance);
        self.cut(FIRST_LIMIT * allowed, digits * allowed).leaving(narrow)
    }

    /// What rays may be off by at most, where a pixel may be off by so much for what they are off by.
    pub(crate) fn of_rays(&self, allowed: f64) -> f64 {
        if self.trusts_rays { allowed / LIKELY_OF_BOUND } else { allowed }
    }

    /// The same goal, by rays that are only likely as close as they should be. Those that go through all
    /// levels begin as they would without.
    pub(crate) fn trusting_rays(self) -> Self {
        Self { trusts_rays: !self.all_levels, ..self }
    }

    /// What the march of packets may be off by along a ray.
    pub(crate) fn of_packets(&self) -> f64 {
        let least = if self.has_area { LEAST_OF_AREAS * self.behind } else { 0.0 };
        PACKETS * self.tolerance.max(least)
    }

    /// Leaves pixels' areas to rays that stand for themselves: their bounds are out of reach.
    pub(crate) fn give_up_certificates(&mut self) {
        (self.certifies, self.rays_per_pixel) = (false, self.scouting_per_pixel);
        *self = self.trusting_rays();
    }

    /// The cut that leaves `limit` to a single brick, and `digits` to how its values are read. Of ever
    /// smaller ones the last draws all levels and reads all digits, so that no pixel is drawn without end
    /// for what the index does not tell.
    pub(crate) fn cut(&self, limit: f64, digits: f64) -> Cut {
        let is_none = |limit: f64| limit.is_nan() || limit <= SMALLEST_LIMIT * self.tolerance;
        if self.all_levels || is_none(limit) {
            return Cut::FullDepth;
        }
        let digits = Some(digits).filter(|digits| !is_none(*digits));
        Cut::Error(ErrorCut { limit, narrow: 1.0, digits, behind: self.behind })
    }
}

/// How tiles are drawn.
#[derive(Debug, Clone)]
pub(crate) enum Method {
    /// Once, with this cut; `accounts`: knowing how far they may be off.
    Once { cut: Cut, accounts: bool },
    /// Until no pixel is off by more than a goal.
    Within(Goal),
}

impl Method {
    /// Whether rays keep accounts of what may be wrong with them.
    pub(crate) fn keeps_accounts(&self) -> bool {
        !matches!(self, Self::Once { accounts: false, .. })
    }
}

/// The power of the number of rays that bounds fall with, of what they were before each square was
/// quartered and after: 1 where they are second order in the square's width, and far more where
/// what is small and bright leaves most of the quarters. None before any was.
pub(crate) fn power([before, after]: [f64; 2]) -> Option<f64> {
    (before > 0.0).then(|| ((before / after).ln() / 4f64.ln()).max(SLOWEST))
}

/// How far a tile's worst pixel is off.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct TileError {
    /// At most, by cause.
    pub(crate) shares: ErrorShares,
    /// In all likelihood, where that bound is above the tolerance.
    pub(crate) estimate: f64,
    /// What bounds of areas were in all before squares were quartered, and after.
    pub(crate) fallen: [f64; 2],
    /// How many rays its pixels need in all if bounds go on to fall so.
    pub(crate) rays_needed: f64,
    /// How many of its pixels need more than any may take.
    pub(crate) beyond: u64,
    /// How many of them may hold what no ray has met.
    pub(crate) unsure: u64,
}
