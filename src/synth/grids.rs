//! Which grids a recipe has, walked in the order of Enzo's hierarchy files.

use super::boxes::{add_remainder, refined};
use super::density::DensityModel;
use super::nested::Nest;
use super::recipe::{Recipe, RefinementRecipe};
use super::threshold::refined_blocks;
use crate::Result;
use crate::space::{Domain, IndexBox, Levels};

/// One grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Grid {
    /// Number in the file, from 1.
    pub id: u64,
    /// Level, 0 = root grid.
    pub level: u32,
    /// Its cells, in indices of its level.
    pub cells: IndexBox,
}

impl Grid {
    /// Number of cells.
    pub fn count(&self) -> u64 {
        self.cells.size().iter().product::<i128>() as u64
    }
}

/// What a walk over the grids meets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Step {
    /// The next grid, and its next sibling's number (0: none).
    Grid(Grid, u64),
    /// The number of a grid, and of its first child (0: none).
    FirstChild(u64, u64),
}

/// The grids of a recipe: every grid lies in one parent, siblings never overlap, and a grid's
/// children follow from the grid alone, so none need be kept.
#[derive(Debug)]
pub struct Grids {
    domain: Domain,
    levels: Levels,
    refinement: RefinementRecipe,
    tiles: [u64; 3],
    nests: Vec<Nest>,
    model: DensityModel,
}

impl Grids {
    /// The grids of `recipe`.
    ///
    /// # Errors
    /// Positions that are no decimals or lie too far from the domain.
    pub fn new(recipe: &Recipe) -> Result<Self> {
        let (domain, refinement) = (recipe.space()?, &recipe.refinement);
        let nests = refinement.centre.iter().enumerate();
        let nests = nests.map(|(i, centre)| Nest::new(&domain, refinement, centre, i));
        Ok(Self {
            nests: nests.collect::<Result<_>>()?,
            levels: recipe.levels()?,
            refinement: refinement.clone(),
            tiles: recipe.domain.tiles,
            model: DensityModel::new(recipe)?,
            domain,
        })
    }

    /// The simulated box.
    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    /// The density in the cells.
    pub fn model(&self) -> &DensityModel {
        &self.model
    }

    /// Octree level of level `level`.
    pub fn octree(&self, level: u32) -> u32 {
        self.levels.octree(level as usize).unwrap_or(0)
    }

    /// The refinement factor from level `level` to the next; 1 from the last.
    pub fn factor(&self, level: u32) -> i128 {
        let fine = self.levels.octree(level as usize + 1);
        1 << fine.map_or(0, |fine| fine.saturating_sub(self.octree(level)))
    }

    /// The grids of the root level.
    pub fn roots(&self) -> Vec<IndexBox> {
        let cut = |axis: usize, n: u64| {
            let (cells, tiles) = (self.domain.root_cells()[axis], self.tiles[axis]);
            i128::from(cells) * i128::from(n) / i128::from(tiles)
        };
        let [nx, ny, nz] = self.tiles;
        let tiles =
            (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])));
        let tile = |at: [u64; 3]| IndexBox {
            lo: std::array::from_fn(|a| cut(a, at[a])),
            hi: std::array::from_fn(|a| cut(a, at[a] + 1)),
        };
        tiles.map(tile).collect()
    }

    /// The children of a grid of level `level`, in cells of the next level.
    pub fn children(&self, level: u32, grid: &IndexBox) -> Vec<IndexBox> {
        let mut children = Vec::new();
        if level >= self.refinement.max_level {
            return children;
        }
        let inside = refined(grid, self.factor(level));
        let nested = self.nests.iter();
        for candidate in nested.flat_map(|n| n.boxes(&self.domain, &self.levels, level + 1)) {
            let clipped = candidate.intersection(&inside);
            if !clipped.is_empty() {
                add_remainder(&mut children, clipped);
            }
        }
        if let Some(threshold) = &self.refinement.threshold {
            let (octree, factor) = (self.octree(level), self.factor(level));
            let (model, seed) = (&self.model, self.refinement.seed);
            for block in refined_blocks(threshold, model, level, octree, grid, factor, seed) {
                add_remainder(&mut children, block);
            }
        }
        children
    }

    /// Hands every grid to `visit`.
    ///
    /// # Errors
    /// What `visit` returns.
    pub fn for_each(&self, visit: &mut dyn FnMut(Grid) -> Result<()>) -> Result<()> {
        self.walk(&mut |step| match step {
            Step::Grid(grid, _) => visit(grid),
            Step::FirstChild(..) => Ok(()),
        })
    }

    /// Walks as Enzo writes: a grid's siblings follow it, then the children of the last, and so
    /// on back to the first. Memory: the siblings of one grid of each level.
    pub(super) fn walk(&self, visit: &mut dyn FnMut(Step) -> Result<()>) -> Result<()> {
        let mut next_id = 1;
        self.walk_siblings(&self.roots(), 0, &mut next_id, visit)
    }

    fn walk_siblings(
        &self,
        siblings: &[IndexBox],
        level: u32,
        next_id: &mut u64,
        visit: &mut dyn FnMut(Step) -> Result<()>,
    ) -> Result<()> {
        let first = *next_id;
        *next_id += siblings.len() as u64;
        for (id, cells) in (first..).zip(siblings) {
            let next = if id + 1 == *next_id { 0 } else { id + 1 };
            visit(Step::Grid(Grid { id, level, cells: *cells }, next))?;
        }
        for (place, cells) in siblings.iter().enumerate().rev() {
            let id = first + place as u64;
            let children = self.children(level, cells);
            visit(Step::FirstChild(id, if children.is_empty() { 0 } else { *next_id }))?;
            self.walk_siblings(&children, level + 1, next_id, visit)?;
        }
        Ok(())
    }
}
