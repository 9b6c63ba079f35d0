//! The cells of one data set as a tree, each with the scaled values around it: one step down
//! costs an addition, where tables of cells cost a search for each of 27 values.

use super::super::Result;
use super::super::dataset::{Dataset, children};
use super::super::interpolant::Interpolant;

/// Sets of axes (bits), none empty.
const SETS: std::ops::Range<usize> = 1..8;
/// Every neighbour exists.
const ALL: u32 = (1 << 27) - 1;

/// A cell.
pub(crate) struct Node {
    /// Scaled values of the cell and its 26 neighbours, x fastest, ghosts included.
    pub(crate) stencil: [f64; 27],
    /// Which of them exist, as bits.
    exists: u32,
    /// The first of eight children; 0: a leaf cell.
    children: u32,
}

/// All cells of a data set under one scale.
pub(crate) struct Tree {
    pub(crate) nodes: Vec<Node>,
    pub(crate) root_cells: [i64; 3],
}

/// Place of neighbour `(dx, dy, dz)`, each −1 … 1, in a stencil.
pub(crate) fn stencil_place([x, y, z]: [i64; 3]) -> usize {
    (13 + x + 3 * y + 9 * z) as usize
}

impl Node {
    fn new(interpolant: &Interpolant<'_>, level: usize, index: [i64; 3]) -> Self {
        let mut node = Self { stencil: [0.0; 27], exists: 0, children: 0 };
        for n in 0..27_i64 {
            let step = [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1];
            let neighbour = [0, 1, 2].map(|a| index[a] + step[a]);
            node.stencil[n as usize] = interpolant.value(level, neighbour);
            node.exists |= u32::from(interpolant.exists(level, neighbour)) << n;
        }
        node
    }

    pub(crate) fn value(&self) -> f64 {
        self.stencil[13]
    }

    /// The child in octant `octant` (bits by axis); none for a leaf cell.
    pub(crate) fn child(&self, octant: usize) -> Option<usize> {
        (self.children > 0).then_some(self.children as usize + octant)
    }

    pub(crate) fn is_whole(&self) -> bool {
        self.exists == ALL
    }

    /// Bits of the sets of axes whose neighbour beside octant `upper` does not exist.
    pub(crate) fn missing(&self, upper: [bool; 3]) -> u32 {
        if self.is_whole() {
            return 0;
        }
        let sides = upper.map(|up| if up { 1 } else { -1 });
        let exists = |set: usize| {
            let step = [0, 1, 2].map(|a| if set >> a & 1 == 1 { sides[a] } else { 0 });
            self.exists >> stencil_place(step) & 1 == 1
        };
        SETS.filter(|set| !exists(*set)).fold(0, |missing, set| missing | 1 << set)
    }

    /// Smallest and largest value of the stencil.
    pub(crate) fn range(&self) -> [f64; 2] {
        let (low, high) = (f64::INFINITY, f64::NEG_INFINITY);
        self.stencil.iter().fold([low, high], |[l, h], v| [l.min(*v), h.max(*v)])
    }
}

impl Tree {
    /// The tree of `interpolant`'s cells under the scale of its transfer function.
    pub(crate) fn new(interpolant: &Interpolant<'_>) -> Result<Self> {
        let dataset = interpolant.dataset;
        let root_cells = dataset.root_cells();
        let mut places = root_places(root_cells);
        let mut nodes: Vec<Node> = Vec::new();
        let mut next = 0;
        while next < places.len() {
            let (level, index) = places[next];
            let mut node = Node::new(interpolant, level, index);
            if is_refined(dataset, level, index)? {
                node.children = u32::try_from(places.len()).map_err(|_| "too many cells")?;
                places.extend(children(index).map(|child| (level + 1, child)));
            }
            nodes.push(node);
            next += 1;
        }
        Ok(Self { nodes, root_cells })
    }

    /// The node of a root cell.
    pub(crate) fn root(&self, index: [i64; 3]) -> usize {
        let [nx, ny, _] = self.root_cells;
        (index[0] + nx * (index[1] + ny * index[2])) as usize
    }
}

fn root_places([nx, ny, nz]: [i64; 3]) -> Vec<(usize, [i64; 3])> {
    let row = |k: i64, j: i64| (0..nx).map(move |i| (0, [i, j, k]));
    (0..nz).flat_map(|k| (0..ny).flat_map(move |j| row(k, j))).collect()
}

fn is_refined(dataset: &Dataset, level: usize, index: [i64; 3]) -> Result<bool> {
    let cell = dataset.cell(level, index);
    Ok(cell.ok_or_else(|| format!("level {level}: {index:?} is missing"))?.refined)
}
