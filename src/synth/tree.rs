//! A recipe's refinement as a tree of equal blocks: a block is refined, into eight, where any of
//! the recipe's finer grids reaches into it.

use std::cell::OnceCell;
use std::rc::Rc;

use rayon::prelude::*;

use super::boxes::refined;
use super::grids::Grids;
use super::recipe::{Covered, Recipe};
use super::values::model_values;
use crate::space::IndexBox;
use crate::{Error, Result};

/// Most values of a data set: it is built in memory.
const MOST_VALUES: u64 = 1 << 26;

/// One block.
#[derive(Debug, Clone)]
pub(super) struct Block {
    /// Level, 0 = root grid.
    pub(super) level: u32,
    /// Place in blocks of its level.
    pub(super) at: [i128; 3],
    /// The parent's number; none for a root block.
    pub(super) parent: Option<usize>,
    /// Which of the parent's children it is, x fastest.
    pub(super) octant: usize,
    /// The children's numbers, x fastest; none for a leaf.
    pub(super) children: Vec<usize>,
}

impl Block {
    /// Whether no block refines it.
    pub(super) fn is_leaf(&self) -> bool {
        self.children.is_empty()
    }
}

/// All blocks, depth first, parents before their children.
#[derive(Debug)]
pub(super) struct BlockTree {
    /// The blocks, numbered from 0.
    pub(super) blocks: Vec<Block>,
    /// Cells of a block.
    pub(super) size: [u32; 3],
    /// Blocks of the root grid.
    pub(super) roots: [u64; 3],
    most_blocks: u64,
}

/// A grid of the recipe; its children are found once, when a block asks.
struct Patch {
    level: u32,
    cells: IndexBox,
    children: OnceCell<Vec<Rc<Patch>>>,
}

impl Patch {
    fn new(level: u32, cells: IndexBox) -> Rc<Self> {
        Rc::new(Self { level, cells, children: OnceCell::new() })
    }

    fn children(&self, grids: &Grids) -> &[Rc<Self>] {
        self.children.get_or_init(|| {
            let boxes = grids.children(self.level, &self.cells);
            boxes.into_iter().map(|cells| Self::new(self.level + 1, cells)).collect()
        })
    }
}

/// The patches that reach into `cells`.
fn inside<'p>(patches: impl Iterator<Item = &'p Rc<Patch>>, cells: &IndexBox) -> Vec<Rc<Patch>> {
    patches.filter(|patch| !patch.cells.intersection(cells).is_empty()).cloned().collect()
}

impl BlockTree {
    /// The tree of `recipe`.
    ///
    /// # Errors
    /// A refinement factor that is not 2, blocks that do not make up the root grid, and more
    /// blocks than fit into memory.
    pub(super) fn new(recipe: &Recipe, grids: &Grids) -> Result<Self> {
        let factor = recipe.one_factor()?;
        if factor != 2 {
            return Err(Error::request(format!(
                "refinement.factor: {factor} in a tree of blocks, which needs 2"
            )));
        }
        let (size, root) = (recipe.output.block, recipe.domain.root);
        let odd = recipe.refinement.max_level > 0 && size.iter().any(|n| n % 2 == 1);
        if odd || (0..3).any(|a| size[a] == 0 || !root[a].is_multiple_of(size[a].into())) {
            return Err(no_tiling(&recipe.output.format, size, root));
        }
        let cells: u64 = size.iter().map(|&n| u64::from(n)).product();
        let fields = recipe.output.fields.len().max(1) as u64;
        let mut tree = Self {
            blocks: Vec::new(),
            size,
            roots: std::array::from_fn(|a| root[a] / u64::from(size[a])),
            most_blocks: MOST_VALUES / (cells * fields),
        };
        let patches: Vec<_> = grids.roots().iter().map(|cells| Patch::new(0, *cells)).collect();
        let [nx, ny, nz] = tree.roots.map(i128::from);
        for place in 0..nx * ny * nz {
            let at = [place % nx, place / nx % ny, place / nx / ny];
            let block = Block { level: 0, at, parent: None, octant: 0, children: Vec::new() };
            let own = inside(patches.iter(), &tree.cells(&block));
            tree.add(block, grids, &own)?;
        }
        Ok(tree)
    }

    /// The cells of a block, in indices of its level.
    pub(super) fn cells(&self, block: &Block) -> IndexBox {
        let lo = std::array::from_fn(|a| block.at[a] * i128::from(self.size[a]));
        IndexBox::at(lo, self.size)
    }

    /// Cells of one block.
    pub(super) fn block_cells(&self) -> usize {
        self.size.iter().map(|&n| n as usize).product()
    }

    /// Adds a block and all beneath it; `patches` are those of its level that reach into it.
    fn add(&mut self, block: Block, grids: &Grids, patches: &[Rc<Patch>]) -> Result<usize> {
        let number = self.blocks.len();
        if number as u64 == self.most_blocks {
            return Err(Error::request(format!(
                "refinement: more than {number} blocks do not fit into memory: refine less"
            )));
        }
        let (level, at) = (block.level + 1, block.at);
        let fine = refined(&self.cells(&block), 2);
        self.blocks.push(block);
        let finer = inside(patches.iter().flat_map(|patch| patch.children(grids)), &fine);
        if finer.is_empty() {
            return Ok(number);
        }
        for octant in 0..8usize {
            let at = std::array::from_fn(|a| 2 * at[a] + (octant >> a & 1) as i128);
            let child = Block { level, at, parent: Some(number), octant, children: Vec::new() };
            let own = inside(finer.iter(), &self.cells(&child));
            let child = self.add(child, grids, &own)?;
            self.blocks[number].children.push(child);
        }
        Ok(number)
    }

    /// Values of each block's fields, x fastest: the model in leaves, what the recipe asks for in
    /// cells under finer blocks in the others.
    pub(super) fn values(&self, recipe: &Recipe, grids: &Grids) -> Vec<Vec<Vec<f64>>> {
        let output = &recipe.output;
        let of_block = |block: &Block| {
            let mut values = model_values(grids, block.level, self.cells(block), &output.fields);
            if let Covered::Factor(wrong) = output.covered
                && !block.is_leaf()
            {
                values.iter_mut().flatten().for_each(|value| *value *= wrong);
            }
            values
        };
        let mut values: Vec<_> = self.blocks.par_iter().map(of_block).collect();
        if matches!(output.covered, Covered::Average(_)) {
            // Children stand behind their parents.
            for number in (0..self.blocks.len()).rev() {
                if !self.blocks[number].is_leaf() {
                    values[number] = self.averages(number, &values);
                }
            }
        }
        values
    }

    /// The fields of a block as averages of its children's.
    fn averages(&self, number: usize, values: &[Vec<Vec<f64>>]) -> Vec<Vec<f64>> {
        let size = self.size.map(|n| n as usize);
        let mut averages = vec![vec![0.0; self.block_cells()]; values[number].len()];
        for (octant, &child) in self.blocks[number].children.iter().enumerate() {
            let half = |axis: usize, i: usize| (octant >> axis & 1) * size[axis] / 2 + i / 2;
            for (field, averages) in averages.iter_mut().enumerate() {
                for (at, value) in values[child][field].iter().enumerate() {
                    let [x, y, z] = [at % size[0], at / size[0] % size[1], at / size[0] / size[1]];
                    let to = (half(2, z) * size[1] + half(1, y)) * size[0] + half(0, x);
                    averages[to] += value / 8.0;
                }
            }
        }
        averages
    }
}

/// An error of blocks that make no tree, and which would.
fn no_tiling(format: &str, size: [u32; 3], root: [u64; 3]) -> Error {
    let divides = |axis: usize, n: u32| root[axis].is_multiple_of(u64::from(n));
    let even = |axis: usize| (1..=size[axis].max(2) / 2).map(|half| 2 * half);
    let fitting = |axis: usize| even(axis).rfind(|&n| divides(axis, n));
    let advice = match [0, 1, 2].map(fitting) {
        [Some(x), Some(y), Some(z)] => format!("block = [{x}, {y}, {z}] would, or"),
        _ => "that takes".to_owned(),
    };
    Error::request(format!(
        "output.block: {size:?} cells of a block must be even and divide the root grid's {root:?} in the \
         layout of {format}: {advice} another domain.root"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    const RECIPE: &str = "[domain]\nleft = [0.0, 0.0, 0.0]\nright = [3.0, 1.0, 2.0]\n\
        root = [12, 4, 12]\n[refinement]\nmax_level = 3\n[[refinement.centre]]\n\
        position = [1.3, 0.6, 1.1]\nhalf_size = [2, 2, 2]\n[[density]]\nkind = \"gradient\"\n\
        value = 1.0\nslope = [0.3, 0.2, 0.1]\n[output]\nblock = [4, 2, 6]\n\
        covered = \"average\"\n";

    fn tree(recipe: &str) -> Result<(Recipe, Grids, BlockTree)> {
        let recipe = Recipe::parse(recipe, "recipe")?;
        let grids = Grids::new(&recipe)?;
        let tree = BlockTree::new(&recipe, &grids)?;
        Ok((recipe, grids, tree))
    }

    #[test]
    fn leaves_tile_the_domain_and_hold_the_recipes_depth() {
        let (recipe, grids, tree) = tree(RECIPE).unwrap();
        assert_eq!(tree.roots, [3, 2, 2]);
        let leaves = || tree.blocks.iter().filter(|block| block.is_leaf());
        let volume: f64 = leaves().map(|block| (-3.0 * f64::from(block.level)).exp2()).sum();
        assert_eq!(volume, 12.0);
        assert_eq!(leaves().map(|block| block.level).max(), Some(3));
        for block in &tree.blocks {
            let above = block.parent.map(|parent| &tree.blocks[parent]);
            assert!(above.is_none_or(|above| block.at.map(|i| i >> 1) == above.at));
        }
        // A linear function's averages are its values.
        let values = tree.values(&recipe, &grids);
        for (block, values) in tree.blocks.iter().zip(&values) {
            let exact = model_values(&grids, block.level, tree.cells(block), &recipe.output.fields);
            for (found, exact) in values[0].iter().zip(&exact[0]) {
                assert!((found - exact).abs() < 1e-12, "{found} {exact}");
            }
        }
    }

    #[test]
    fn what_is_no_tree_of_blocks_is_refused() {
        for (from, to, expected) in [
            ("[4, 2, 6]", "[4, 2, 5]", "divide the root grid's [12, 4, 12] in the layout of enzo"),
            ("[4, 2, 6]", "[8, 3, 5]", ": block = [6, 2, 4] would, or another domain.root"),
            ("[12, 4, 12]", "[12, 3, 12]", ": that takes another domain.root"),
            ("[4, 2, 6]", "[3, 2, 6]", "even"),
            ("[4, 2, 6]", "[0, 2, 6]", "output.block"),
            ("max_level = 3", "max_level = 3\nfactor = 4", "needs 2"),
        ] {
            let error = tree(&RECIPE.replace(from, to)).err().unwrap().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
