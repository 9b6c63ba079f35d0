//! Nested refinement around points, in deliberately untidy shapes: boxes off any alignment,
//! L-shaped unions, and grids flush against their parents' faces.

use super::boxes::{aligned, refined};
use super::density::position;
use super::noise::hash;
use super::recipe::{CentreRecipe, RefinementRecipe};
use crate::Result;
use crate::space::{Domain, IndexBox, Levels, Position};

/// The boxes to refine around one point.
#[derive(Debug, Clone)]
pub(super) struct Nest {
    position: Position,
    depth: u32,
    half_size: [i128; 3],
    arms: u32,
    satellites: u32,
    seed: u64,
}

impl Nest {
    /// The nest of `centre`, number `number` of the recipe.
    pub(super) fn new(
        domain: &Domain,
        refinement: &RefinementRecipe,
        centre: &CentreRecipe,
        number: usize,
    ) -> Result<Self> {
        Ok(Self {
            position: position(domain, &centre.position)?,
            depth: centre.depth.unwrap_or(refinement.max_level),
            half_size: centre.half_size.map(i128::from),
            arms: centre.arms,
            satellites: centre.satellites,
            seed: hash(&[refinement.seed, number as u64]),
        })
    }

    /// Boxes of level `level` to refine, which may reach beyond the level above and overlap;
    /// they start and end on multiples of `factor`.
    pub(super) fn boxes(&self, domain: &Domain, levels: &Levels, level: u32) -> Vec<IndexBox> {
        if level == 0 || level > self.depth {
            return Vec::new();
        }
        let Some(factor) = factor_above(levels, level) else { return Vec::new() };
        let main = self.main(domain, levels, level);
        let mut boxes = vec![main];
        if self.arms > 0 && level.is_multiple_of(self.arms) {
            boxes.push(aligned(&self.arm(&main, level), factor));
        }
        for steps in 1..=2.min(level) {
            let below = level - steps;
            if self.satellites > 0 && below > 0 && below.is_multiple_of(self.satellites) {
                let mut flush = self.satellite(&self.main(domain, levels, below), below, steps);
                for above in below..level {
                    let Some(factor) = factor_above(levels, above + 1) else { continue };
                    flush = refined(&flush, factor);
                }
                boxes.push(aligned(&flush, factor));
            }
        }
        boxes
    }

    /// A pseudo-random number below `limit`.
    fn choose(&self, level: u32, purpose: u64, limit: u64) -> u64 {
        hash(&[self.seed, level.into(), purpose]) % limit
    }

    /// The box that holds the point, its faces moved by up to a quarter of its half size.
    fn main(&self, domain: &Domain, levels: &Levels, level: u32) -> IndexBox {
        let octree = levels.octree(level as usize).unwrap_or(0);
        let cell = domain.cell_of(octree.cast_signed(), &self.position);
        let margin = |axis: usize, side: u64| {
            let slack = self.half_size[axis] / 4;
            let moved = self.choose(level, 2 * axis as u64 + side, 2 * slack as u64 + 1);
            self.half_size[axis] - slack + i128::from(moved)
        };
        let around = IndexBox {
            lo: std::array::from_fn(|a| cell[a] - margin(a, 0)),
            hi: std::array::from_fn(|a| cell[a] + margin(a, 1)),
        };
        aligned(&around, factor_above(levels, level).unwrap_or(1))
    }

    /// A box that continues `main` across one face, over part of that face.
    fn arm(&self, main: &IndexBox, level: u32) -> IndexBox {
        let axis = self.choose(level, 10, 3) as usize;
        let across = (axis + 1) % 3;
        let mut arm = *main;
        if self.choose(level, 11, 2) == 0 {
            arm.lo[axis] = main.lo[axis] - self.half_size[axis];
        } else {
            arm.hi[axis] = main.hi[axis] + self.half_size[axis];
        }
        let middle = (main.lo[across] + main.hi[across]).div_euclid(2);
        if self.choose(level, 12, 2) == 0 {
            arm.lo[across] = middle;
        } else {
            arm.hi[across] = middle;
        }
        arm
    }

    /// A box across a face of `parent` (both in its cells), `steps` levels deeper: cut off at
    /// the face by the parent, it lies flush with it. The second step lies within the first.
    fn satellite(&self, parent: &IndexBox, level: u32, steps: u32) -> IndexBox {
        let axis = self.choose(level, 20, 3) as usize;
        let face = if self.choose(level, 21, 2) == 0 { parent.lo } else { parent.hi }[axis];
        let inset = i128::from(steps);
        let reach = 6 - 2 * inset;
        let mut flush =
            IndexBox { lo: parent.lo.map(|i| i + inset), hi: parent.lo.map(|i| i + 7 - inset) };
        (flush.lo[axis], flush.hi[axis]) = (face - reach, face + reach);
        flush
    }
}

/// The refinement factor from the level above to `level`.
fn factor_above(levels: &Levels, level: u32) -> Option<i128> {
    let fine = levels.octree(level as usize)?;
    let coarse = levels.octree((level as usize).checked_sub(1)?)?;
    Some(1 << (fine - coarse))
}
