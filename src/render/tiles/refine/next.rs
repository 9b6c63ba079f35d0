//! What is to be done with the squares of a batch once their rays have been marched.

use super::Batch;
use crate::render::bounds::grade::Care;
use crate::render::bounds::shares::ErrorShares;
use crate::render::plan::cut::Cut;
use crate::render::plan::goal::Goal;
use crate::render::tiles::waiting::Found;

/// The part of a pixel's error that may come from levels, of what levels and area may be off by.
pub(super) const LEVELS_SHARE: f64 = 0.5;
/// The parts that may come from digits that are not read, and from the march of packets, likewise.
const DIGITS_SHARE: f64 = 0.3;
const MARCH_SHARE: f64 = 0.4;
/// Rays that the march of packets lets be off by so many times what they may be are marched one by one:
/// packets of more care are off by an eighth, or a little less.
const BEYOND_PACKETS: f64 = 16.0;
/// A cut is made finer by at least, and at most, these factors.
const FINER: [f64; 2] = [0.5, 1.0 / 32.0];

/// What is to be done with the squares of a batch.
#[derive(Default)]
pub(super) struct Next {
    pub(super) careful: Vec<Found>,
    pub(super) exact: Vec<Found>,
    pub(super) finer: Vec<Found>,
    pub(super) quartered: Vec<Found>,
    /// The most that levels, and digits, are off by, of the room that there is.
    pub(super) worst: [f64; 2],
}

impl Next {
    /// Takes squares whose rays are off by so much, as `mean` of these rays has it, that they are
    /// to be marched with more care, or through finer levels.
    pub(super) fn takes(
        &mut self,
        found: &[Found],
        mean: &ErrorShares,
        room: f64,
        batch: &Batch,
    ) -> bool {
        if batch.care != Care::Exact && mean.quadrature > MARCH_SHARE * room {
            let is_beyond = mean.quadrature > BEYOND_PACKETS * room;
            let squares = if is_beyond { &mut self.exact } else { &mut self.careful };
            squares.extend(found);
            return true;
        }
        let can_be_finer = !matches!(batch.cut, Cut::FullDepth);
        // How many rays take from proxies goes by the limit of levels.
        let off = [(mean.levels + mean.proxies) / room, mean.digits / room];
        if can_be_finer && (off[0] > LEVELS_SHARE || off[1] > DIGITS_SHARE) {
            self.worst = std::array::from_fn(|n| self.worst[n].max(off[n]));
            self.finer.extend(found);
            return true;
        }
        false
    }

    /// The cut for squares that need finer levels, or more digits, than `cut` leaves them.
    pub(super) fn finer_cut(&self, goal: &Goal, cut: &Cut) -> Cut {
        let Cut::Error(cut) = cut else { return Cut::FullDepth };
        let [levels, digits] = self.factors();
        let digits = cut.digits.map_or(0.0, |most| most * digits);
        // What narrow cells were allowed beyond others goes first.
        let limit = cut.limit * (cut.narrow * levels).min(1.0);
        let narrow = if levels < 1.0 { 1.0 } else { cut.narrow };
        goal.cut(limit, digits).leaving(narrow)
    }

    /// What limits of levels and digits are made smaller by.
    fn factors(&self) -> [f64; 2] {
        let shares = [LEVELS_SHARE, DIGITS_SHARE];
        std::array::from_fn(|n| {
            let [worst, share] = [self.worst[n], shares[n]];
            // Few different cuts, so that many squares share one.
            let factor = (0.5 * share / worst).clamp(FINER[1], FINER[0]).log2().floor().exp2();
            if worst > share { factor } else { 1.0 }
        })
    }
}

/// What finer levels, more rays or more care than `care` change.
pub(super) fn movable(shares: &ErrorShares, care: Care) -> f64 {
    let march = if care == Care::Exact { 0.0 } else { shares.quadrature };
    shares.levels + shares.digits + shares.pixel_area + shares.proxies + march
}
