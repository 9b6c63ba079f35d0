//! What of a brick is drawn.

use super::interpolant::DrawnNeighbours;
use super::scaled::ScaledBrick;

/// All faces of a region ([`Region::ends`]).
pub(crate) const ALL_FACES: u8 = 0x3f;

/// A box inside a brick, in cells from its lowest corner, clipped to the domain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Region {
    /// Lower corner.
    pub(crate) lo: [f64; 3],
    /// Upper corner.
    pub(crate) hi: [f64; 3],
    /// Faces at which the domain ends: bit a the lower one along axis a, bit 3 + a the upper.
    pub(crate) ends: u8,
}

impl Region {
    /// The region clipped to a brick of `edge` cells.
    pub(crate) fn within(&self, edge: usize) -> Self {
        let (lo, hi) = (self.lo.map(|x| x.max(0.0)), self.hi.map(|x| x.min(edge as f64)));
        Self { lo, hi, ends: self.ends }
    }
}

/// The brick that a ray passes through, and what of it is drawn.
#[derive(Clone, Copy)]
pub(crate) struct Passage<'b> {
    /// The brick.
    pub(crate) brick: &'b ScaledBrick,
    /// The box of it that is drawn.
    pub(crate) region: Region,
    /// Beside which neighbours the level ends.
    pub(crate) drawn: DrawnNeighbours,
    /// Whether the brick is drawn in place of its children.
    pub(crate) hides: bool,
}

impl Passage<'_> {
    /// What of the brick is drawn, within it.
    pub(crate) fn inside(&self) -> Region {
        let mut region = self.region.within(self.brick.edge);
        if self.brick.is_piecewise_constant() {
            // Values do not meet at the brick's faces either.
            region.ends = ALL_FACES;
        }
        region
    }
}
