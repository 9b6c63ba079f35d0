//! What is drawn without the rule across levels: in every cell the trilinear interpolant of its
//! own level, ghosts prolonged from the level above.

use std::rc::Rc;

use deepfield::cache::{Block, BrickPlace, BrickShape, RawBrick, state};
use deepfield::render::interpolant::DrawnNeighbours;
use deepfield::render::scaled::{ScaledBrick, one_by_one};
use deepfield::scene::Interpolation;
use deepfield::space::Position;

use super::{Node, Scale, Tree};

impl Tree<'_> {
    /// The trilinear interpolant of the level that owns `position`.
    pub(crate) fn unblended(&self, position: &Position, scale: Scale) -> f64 {
        let path = self.path(position, None);
        let node = self.owner(&path, position);
        self.without_holes(node, scale)
            .value_at(self.local(&node.place, position), DrawnNeighbours::ALL)
    }

    fn without_holes(&self, node: &Node, scale: Scale) -> Rc<ScaledBrick> {
        if let Some(scaled) = self.unblended.borrow().get(&(node.index, scale)) {
            return Rc::clone(scaled);
        }
        let mut raw = RawBrick::clone(&self.raw(node));
        for value in raw.blocks.iter_mut().flat_map(|block| &mut block.values) {
            *value = self.map(scale, *value) as f32;
        }
        let header = self.cache.header();
        let filled = prolonged(&raw, &node.place, header.shape);
        let mut scaled = ScaledBrick::new();
        scaled
            .prepare(
                &filled,
                &node.place,
                header.shape,
                one_by_one(f64::from),
                Interpolation::Linear,
            )
            .unwrap();
        Rc::clone(super::keep(&mut self.unblended.borrow_mut(), (node.index, scale), scaled))
    }
}

/// The brick's own block with all cells existing: prolonged from the block above where they do
/// not.
fn prolonged(raw: &RawBrick, place: &BrickPlace, shape: BrickShape) -> RawBrick {
    let lowest = place.lowest_cell(shape);
    let mut filled = raw.blocks[raw.blocks.len() - 1].clone();
    for up in (0..raw.blocks.len() - 1).rev() {
        let (first, above_first) =
            (lowest.map(|c| (c >> up) - 1), lowest.map(|c| (c >> (up + 1)) - 1));
        let mut block = raw.blocks[up].clone();
        for z in 0..block.side {
            for y in 0..block.side {
                for x in 0..block.side {
                    let at = block.at(x, y, z);
                    if block.states[at] == 0 {
                        let cell = [x, y, z];
                        let index = std::array::from_fn(|a| first[a] + cell[a] as i128);
                        block.values[at] = from_parents(&filled, above_first, index);
                        block.states[at] = state::EXISTS;
                    }
                }
            }
        }
        filled = block;
    }
    RawBrick { blocks: vec![filled] }
}

/// Along each axis ¾ of the parent and ¼ of its neighbour on the cell's side; outside the domain
/// the parent counts for its neighbour.
fn from_parents(above: &Block, first: [i128; 3], index: [i128; 3]) -> f32 {
    let value = |cell: [i128; 3]| {
        let [x, y, z] =
            std::array::from_fn(|a| (cell[a] - first[a]).clamp(0, above.side as i128 - 1) as usize);
        let at = above.at(x, y, z);
        (above.states[at] != state::OUTSIDE).then_some(f64::from(above.values[at]))
    };
    let parent = index.map(|i| i >> 1);
    let own = value(parent).unwrap_or(0.0);
    let term = |n: usize| {
        let far = |a: usize| n >> a & 1 == 1;
        let side = |a: usize| if index[a] & 1 == 0 { -1 } else { 1 };
        let cell = std::array::from_fn(|a| parent[a] + if far(a) { side(a) } else { 0 });
        let weight: f64 = (0..3).map(|a| if far(a) { 0.25 } else { 0.75 }).product();
        weight * value(cell).unwrap_or(own)
    };
    (0..8).map(term).sum::<f64>() as f32
}
