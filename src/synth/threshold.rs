//! Refinement where the density is high: a grid is cut into blocks of uneven sizes, and blocks
//! that reach a threshold are refined, neighbours along x as one grid.

use super::boxes::refined;
use super::density::{DensityModel, cell_centre};
use super::noise::hash;
use super::recipe::ThresholdRecipe;
use crate::space::IndexBox;

/// Most cells of a block's run along x.
const LONGEST_RUN: i128 = 24;

/// The boxes inside `parent`, a grid of level `level` at octree level `octree`, that the density
/// asks to refine, in cells `factor` times as small.
pub(super) fn refined_blocks(
    recipe: &ThresholdRecipe,
    model: &DensityModel,
    level: u32,
    octree: u32,
    parent: &IndexBox,
    factor: i128,
    seed: u64,
) -> Vec<IndexBox> {
    let Some(&threshold) = recipe.density.get(level as usize) else { return Vec::new() };
    let cuts: [Vec<i128>; 3] =
        std::array::from_fn(|axis| cuts(recipe.block, parent, axis, seed ^ u64::from(level)));
    let mut boxes: Vec<IndexBox> = Vec::new();
    for z in cuts[2].windows(2) {
        for y in cuts[1].windows(2) {
            let mut run: Option<IndexBox> = None;
            for x in cuts[0].windows(2) {
                let block = IndexBox { lo: [x[0], y[0], z[0]], hi: [x[1], y[1], z[1]] };
                let dense = exceeds(model, octree, &block, threshold);
                run = match run {
                    Some(open) if dense && block.hi[0] - open.lo[0] <= LONGEST_RUN => {
                        Some(IndexBox { hi: block.hi, ..open })
                    }
                    finished => {
                        boxes.extend(finished);
                        dense.then_some(block)
                    }
                };
            }
            boxes.extend(run);
        }
    }
    boxes.iter().map(|block| refined(block, factor)).collect()
}

/// Where a grid is cut along an axis: both ends and between them steps of uneven size.
fn cuts(block: [u32; 2], parent: &IndexBox, axis: usize, seed: u64) -> Vec<i128> {
    let [smallest, largest] = block.map(i128::from);
    let mut at = parent.lo[axis];
    let mut cuts = vec![at];
    while parent.hi[axis] - at >= 2 * smallest {
        let noise = hash(&[seed, axis as u64, at as u64, parent.lo[(axis + 1) % 3] as u64]);
        let step = smallest + i128::from(noise) % (largest - smallest + 1);
        at += step.min(parent.hi[axis] - at - smallest);
        cuts.push(at);
    }
    cuts.push(parent.hi[axis]);
    cuts
}

/// Whether the density exceeds `threshold` at the block's centre or between that and a corner.
fn exceeds(model: &DensityModel, octree: u32, block: &IndexBox, threshold: f64) -> bool {
    let quarter = |axis: usize, q: i128| {
        let (lo, hi) = (block.lo[axis], block.hi[axis]);
        lo + ((hi - lo) * q / 4).min(hi - lo - 1)
    };
    let centre = std::array::from_fn(|axis| quarter(axis, 2));
    let corners = (0..8).map(|corner: usize| {
        std::array::from_fn(|axis| quarter(axis, if corner >> axis & 1 == 0 { 1 } else { 3 }))
    });
    std::iter::once(centre)
        .chain(corners)
        .any(|index| model.at(&cell_centre(octree, index)) > threshold)
}
