//! Whether packets of more care are worth their time: what they are off by is in part rounding, which no
//! care makes less.

use super::{Batch, Mean, TilePixels, movable};
use crate::render::bounds::grade::Care;
use crate::render::camera::rays::PixelGrid;
use crate::render::tiles::waiting::{Found, ToDo};

/// Rays of a tile that tell first what is left with more care.
const FEW: usize = 64;
/// Fewer that wait are not worth a trial.
const MANY: usize = 4 * FEW;

/// What rays of a tile were off by before they were marched in packets of more care, and after.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Trial {
    before: f64,
    after: f64,
}

impl Trial {
    /// Takes in what a batch has found of those that had been marched with less care.
    pub(super) fn note(&mut self, batch: &Batch, outcome: &[Found]) {
        if batch.care != Care::Fine || batch.before == Care::Fine {
            return;
        }
        for (before, after) in batch.again.iter().zip(outcome) {
            let [before, after] = [before, after].map(|found| found.shares().quadrature);
            if before.is_finite() {
                self.before += before;
                self.after += after;
            }
        }
    }

    /// The part of it that is left, if that is known.
    fn left(&self) -> Option<f64> {
        (self.before > 0.0).then(|| self.after / self.before)
    }
}

impl TilePixels {
    /// Of squares that are to be marched `again`, in packets of more care, those that may become good
    /// enough by that, as far as others of the tile tell, or, before any do, a few; others wait.
    pub(super) fn with_promise(
        &mut self,
        grid: &PixelGrid,
        mut again: Vec<Found>,
        to_do: &ToDo,
    ) -> Vec<Found> {
        if to_do.care != Care::Fine || to_do.before == Care::Fine {
            return again;
        }
        let Some(left) = self.trial.left() else {
            if again.len() > MANY {
                let step = again.len() / FEW;
                let is_tried = |n: usize| n.is_multiple_of(step);
                let others: Vec<_> = every(&again, |n| !is_tried(n));
                again = every(&again, is_tried);
                self.wait(grid, &others, to_do);
            }
            return again;
        };
        let of_pixels = again.chunk_by(|a, b| a.square.pixel == b.square.pixel);
        let (mut promising, mut others) = (Vec::new(), Vec::new());
        for found in of_pixels {
            let Mean { mut shares, room, .. } = self.mean(grid, found, to_do.before);
            shares.quadrature *= left;
            let is_enough = movable(&shares, to_do.care) <= room;
            if is_enough { &mut promising } else { &mut others }.extend_from_slice(found);
        }
        self.wait(grid, &others, &ToDo { care: Care::Exact, ..to_do.clone() });
        promising
    }
}

/// Those of `found` whose number `is_one`.
fn every(found: &[Found], is_one: impl Fn(usize) -> bool) -> Vec<Found> {
    found.iter().enumerate().filter(|(n, _)| is_one(*n)).map(|(_, found)| *found).collect()
}
