//! Pixels that are taken by their first ray, as those of their neighbours tell.

use super::TilePixels;
use super::uncertified::ALONE_SHARE;
use crate::render::tiles::waiting::Found;

/// Neighbours tell little of a pixel that may be off by this many times the light that was expected
/// of all of the picture.
const UNKNOWN: f64 = 4.0;
/// What neighbours have missed in a witness counts this many times beside what they predict of
/// others.
const DOUBTS: f64 = 2.0;

impl TilePixels {
    /// Takes a whole pixel by its first ray if its neighbours tell that its mean is close enough to
    /// it. Returns whether they do.
    pub(super) fn take_by_neighbours(&mut self, found: &Found) -> bool {
        let pixel = usize::from(found.square.pixel);
        let is_asked = found.square.halvings == 0 && !self.first_rays.is_witness(pixel);
        if !is_asked || self.is_unknown(pixel) || self.is_off_itself(found) {
            return false;
        }
        let Some(predicted) = self.first_rays.predict(pixel) else { return false };
        let doubt = DOUBTS * self.first_rays.doubt_around(pixel);
        let beside = self.pixels[pixel].beside_mean() + found.own();
        if predicted.likely() + predicted.most_bend() + doubt > self.room_for_mean(beside) {
            return false;
        }
        self.pixels[pixel].take_as_predicted(found, &predicted, doubt);
        true
    }

    /// Whether a ray may be off by so much itself that it does not stand for others: rays of its quarters are
    /// marched with more care, or through finer levels, should they be as well.
    fn is_off_itself(&self, found: &Found) -> bool {
        let off = found.shares().likely_of_rays();
        self.goal.is_some_and(|goal| off > ALONE_SHARE * goal.tolerance)
    }

    /// Whether a pixel's neighbours say little: far more light may be in it than is known of, or pixels are
    /// so few that more rays are taken of each.
    fn is_unknown(&self, pixel: usize) -> bool {
        self.goal.is_none_or(|goal| {
            goal.least_halvings > 0
                || self.first_rays.first_bound(pixel) > UNKNOWN * goal.behind
                || self.is_dark_by_chance(&goal, pixel)
        })
    }
}
