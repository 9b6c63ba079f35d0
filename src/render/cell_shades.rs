//! What cells of constant value emit and absorb, worked out once for all rays: what packets look
//! up in place of the transfer function.

use super::scaled::ScaledBlock;
use super::transfer_pieces::PieceList;

/// The cells of a brick. Its memory is reused from brick to brick.
#[derive(Debug, Default)]
pub(super) struct CellShades {
    /// Emission (R, G, B) and extinction of each cell, relative to the transfer function's scales,
    /// x fastest, without ghosts; void cells have none. Empty where packets may not pass.
    pub(super) rows: Vec<[f32; 4]>,
}

impl CellShades {
    /// Most heap bytes for a brick of `edge` cells.
    pub(super) fn bytes(edge: usize) -> usize {
        edge.pow(3) * size_of::<[f32; 4]>()
    }

    pub(super) fn clear(&mut self) {
        self.rows.clear();
    }

    /// Takes the cells of `block`, whose values may be off by `reach`. Where a step of the
    /// transfer function is as near as that to one of them, there are none: what the step may
    /// change is a matter of single cells, which only single rays account for.
    pub(super) fn fill(&mut self, block: &ScaledBlock, pieces: &PieceList, reach: f64) {
        self.rows.clear();
        let edge = block.side - 2;
        // Exact, because the memory limit counts these bytes.
        self.rows.reserve_exact(edge.pow(3));
        let scales = pieces.scales();
        for n in 0..edge * edge {
            let first = block.at([1, n % edge + 1, n / edge + 1]);
            for &x in &block.values[first..][..edge] {
                if meets_step(pieces, x, reach) {
                    return self.rows.clear();
                }
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

/// Whether the transfer function steps within `reach` of `x`.
fn meets_step(pieces: &PieceList, x: f64, reach: f64) -> bool {
    let piece = pieces.at(x);
    let is_inside = x.is_nan() || (x - reach >= piece.start && x + reach < piece.end);
    !is_inside && {
        let jumps = pieces.over(x - reach, x + reach).jumps;
        jumps.emission > 0.0 || jumps.extinction > 0.0
    }
}
