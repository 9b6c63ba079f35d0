//! The tree's lists: levels, types, kinship and bounding boxes of all blocks.

use std::collections::HashMap;

use hdf5_pure::FileBuilder;

use crate::synth::edges::cell_edge;
use crate::synth::grids::Grids;
use crate::synth::recipe::{Precision, Recipe};
use crate::synth::tree::{Block, BlockTree};

/// No such block.
const NONE: i32 = -1;
/// The domain's border, where what flows out is gone.
const OUTFLOW: i32 = -32;

/// Adds all lists.
pub(super) fn add(builder: &mut FileBuilder, recipe: &Recipe, grids: &Grids, tree: &BlockTree) {
    let count = tree.blocks.len() as u64;
    let mut list = |name: &str, of: &dyn Fn(&Block) -> i32| {
        let values: Vec<i32> = tree.blocks.iter().map(of).collect();
        builder.create_dataset(name).with_i32_data(&values);
    };
    list("refine level", &|block| block.level as i32 + 1);
    list("node type", &|block| node_type(tree, block));
    list("processor number", &|_| 0);
    list("which child", &|block| block.parent.map_or(NONE, |_| block.octant as i32 + 1));
    let relatives = Relatives::new(tree);
    let rows: Vec<i32> = tree.blocks.iter().flat_map(|block| relatives.row(block)).collect();
    builder.create_dataset("gid").with_i32_data(&rows).with_shape(&[count, 15]);

    let boxes: Vec<f64> = tree.blocks.iter().flat_map(|block| edges(grids, tree, block)).collect();
    let pairs = || boxes.chunks_exact(2);
    let centres: Vec<f64> = pairs().map(|pair| 0.5 * (pair[0] + pair[1])).collect();
    let widths: Vec<f64> = pairs().map(|pair| pair[1] - pair[0]).collect();
    for (name, values, shape) in [
        ("bounding box", boxes, &[count, 3, 2][..]),
        ("coordinates", centres, &[count, 3]),
        ("block size", widths, &[count, 3]),
    ] {
        let dataset = builder.create_dataset(name);
        match recipe.output.precision {
            Precision::F64 => dataset.with_f64_data(&values),
            Precision::F32 => {
                dataset.with_f32_data(&values.iter().map(|&v| v as f32).collect::<Vec<_>>())
            }
        };
        dataset.with_shape(shape);
    }
}

/// 1 for a leaf, 2 for a leaf's parent, 3 for what lies above.
fn node_type(tree: &BlockTree, block: &Block) -> i32 {
    if block.is_leaf() {
        1
    } else if block.children.iter().any(|&child| tree.blocks[child].is_leaf()) {
        2
    } else {
        3
    }
}

/// Lower and upper edges along x, y, z, as the nearest doubles.
fn edges(grids: &Grids, tree: &BlockTree, block: &Block) -> [f64; 6] {
    let (cells, octree) = (tree.cells(block), grids.octree(block.level));
    std::array::from_fn(|i| {
        let index = if i % 2 == 0 { cells.lo[i / 2] } else { cells.hi[i / 2] };
        cell_edge(grids.domain(), octree, i / 2, index)
    })
}

/// Who lies beside, above and beneath whom.
struct Relatives<'t> {
    tree: &'t BlockTree,
    numbers: HashMap<(u32, [i128; 3]), usize>,
}

impl<'t> Relatives<'t> {
    fn new(tree: &'t BlockTree) -> Self {
        let place = |(number, block): (usize, &Block)| ((block.level, block.at), number);
        Self { tree, numbers: tree.blocks.iter().enumerate().map(place).collect() }
    }

    /// Six face neighbours, the parent, eight children, numbered from 1.
    fn row(&self, block: &Block) -> [i32; 15] {
        std::array::from_fn(|i| match i {
            0..6 => self.neighbour(block, i / 2, i % 2),
            6 => block.parent.map_or(NONE, gid),
            _ => block.children.get(i - 7).map_or(NONE, |&child| gid(child)),
        })
    }

    fn neighbour(&self, block: &Block, axis: usize, side: usize) -> i32 {
        let mut at = block.at;
        at[axis] += 2 * side as i128 - 1;
        let end = i128::from(self.tree.roots[axis]) << block.level;
        if !(0..end).contains(&at[axis]) {
            return OUTFLOW;
        }
        self.numbers.get(&(block.level, at)).map_or(NONE, |&number| gid(number))
    }
}

/// FLASH's number of a block.
fn gid(number: usize) -> i32 {
    number as i32 + 1
}
