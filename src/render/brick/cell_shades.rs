//! What cells of constant value emit and absorb, worked out once for all rays: what packets look
//! up in place of the transfer function.

use super::blocks::ScaledBlock;
use super::relief::Relief;
use crate::render::transfer::change::Change;
use crate::render::transfer::pieces::PieceList;
use crate::render::transfer::rounded::two_halves;

/// The cells of a brick. Its memory is reused from brick to brick.
#[derive(Debug, Default)]
pub(crate) struct CellShades {
    /// Emission (R, G, B) and extinction of each cell, relative to the transfer function's scales,
    /// x fastest, without ghosts; void cells have none. Empty where packets may not pass.
    pub(crate) rows: Vec<[f32; 4]>,
    /// What emission (upper half of the bits, relative likewise) and extinction (lower half) of each
    /// cell may be off by, as its value is not stored exactly.
    pub(crate) storages: Vec<u32>,
}

impl CellShades {
    /// Most heap bytes for a brick of `edge` cells.
    pub(super) fn bytes(edge: usize) -> usize {
        edge.pow(3) * (size_of::<[f32; 4]>() + size_of::<u32>())
    }

    /// Forgets all cells; the memory is kept.
    pub(super) fn clear(&mut self) {
        self.rows.clear();
        self.storages.clear();
    }

    /// Takes the cells of `block`, whose values are off as `relief` says. Where a step of the
    /// transfer function is as near as that to one of them, there are none: only single rays
    /// account for it.
    pub(super) fn fill(&mut self, block: &ScaledBlock, pieces: &PieceList, relief: &Relief) {
        self.clear();
        let edge = block.side - 2;
        // Exact, because the memory limit counts these bytes.
        self.rows.reserve_exact(edge.pow(3));
        self.storages.reserve_exact(edge.pow(3));
        let scales = pieces.scales();
        for n in 0..edge * edge {
            let (y, z) = (n % edge, n / edge);
            let first = block.at([1, y + 1, z + 1]);
            for (i, &x) in block.values[first..][..edge].iter().enumerate() {
                let reach = relief.group_at([i, y, z]).storage(false).up_to(x);
                let Some(stored) = storage(pieces, x, reach) else { return self.clear() };
                let off = [stored.emission / scales[0], stored.extinction / scales[1]];
                self.storages.push(two_halves(off));
                self.rows.push(shade(pieces, x, scales));
            }
        }
    }
}

fn shade(pieces: &PieceList, x: f64, [emission, extinction]: [f64; 2]) -> [f32; 4] {
    if x.is_nan() {
        return [0.0; 4];
    }
    let piece = pieces.at(x);
    let [r, g, b] = piece.emission(x).map(|channel| (channel / emission) as f32);
    [r, g, b, (piece.extinction(x) / extinction) as f32]
}

/// What emission and extinction at `x` may be off by, which is off by up to `reach`; none where the
/// transfer function steps as near as that.
fn storage(pieces: &PieceList, x: f64, reach: f64) -> Option<Change> {
    if x.is_nan() {
        return Some(Change::default());
    }
    let piece = pieces.at(x);
    if x - reach >= piece.start && x + reach < piece.end {
        return Some(piece.steepest().times(reach));
    }
    let span = pieces.over(x - reach, x + reach);
    let steps = span.jumps.emission > 0.0 || span.jumps.extinction > 0.0;
    (!steps).then(|| span.slope.times(reach))
}
