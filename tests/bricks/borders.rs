//! Borders of levels: where they lie, and how far the interpolant jumps across them.

use crate::random::Random;
use std::collections::BTreeMap;

use deepfield::cache::state;
use deepfield::render::cut::FootprintCut;
use deepfield::space::{FRACTION_BITS, Position};

use super::{Node, Tree};

/// Borders kept of each kind at each level.
const KEPT: usize = 40;
/// The two sides are looked at this part of a cell (as a power of two) from the border.
const HAIR_BITS: u32 = 30;

/// What a border is like: levels between its sides (octree), and 1 for a face, 2 for an edge, 3
/// for a corner, which have nothing but the fine level's cells on the sets of fewer axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct Kind {
    pub(crate) levels: i32,
    pub(crate) axes: usize,
    /// Whether all cells between the two, on fewer axes, exist: the border is this edge or corner
    /// alone.
    pub(crate) is_alone: bool,
}

/// A place where a cell meets a coarser one.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Border {
    pub(crate) octree: i32,
    /// The fine cell.
    pub(crate) cell: [i128; 3],
    /// From it to the coarser one.
    pub(crate) step: [i128; 3],
}

/// What was found at one point of a border.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Jump {
    /// Largest difference of the values around the point.
    pub(crate) jump: f64,
    /// Largest change over one fine cell from the point.
    pub(crate) change: f64,
    /// Largest magnitude of a value.
    pub(crate) magnitude: f64,
}

/// Steps to the 26 cells around one.
pub(crate) fn steps() -> impl Iterator<Item = [i128; 3]> {
    (0..27).filter(|n| *n != 13).map(|n| [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1])
}

/// Borders of the data, at random, of every kind that there is.
pub(crate) fn of_data(tree: &Tree<'_>, random: &mut Random) -> BTreeMap<Kind, Vec<Border>> {
    let mut found: BTreeMap<(i32, Kind), (usize, Vec<Border>)> = BTreeMap::new();
    for node in tree.nodes.iter().filter(|node| node.record.leaf_cells > 0) {
        in_brick(tree, node, &mut |kind, border| {
            let (count, kept) = found.entry((node.place.octree, kind)).or_default();
            *count += 1;
            let at = random.below(*count);
            if kept.len() < KEPT {
                kept.push(border);
            } else if at < KEPT {
                kept[at] = border;
            }
        });
    }
    let mut of_kind: BTreeMap<Kind, Vec<Border>> = BTreeMap::new();
    for ((_, kind), (_, borders)) in found {
        of_kind.entry(kind).or_default().extend(borders);
    }
    of_kind
}

fn in_brick(tree: &Tree<'_>, node: &Node, found: &mut impl FnMut(Kind, Border)) {
    let raw = tree.raw(node);
    let lowest = node.place.lowest_cell(tree.cache.header().shape);
    let edge = tree.edge() as usize;
    let state_of = |up: u32, cell: [i128; 3]| {
        let block = &raw.blocks[up as usize];
        let [x, y, z] = std::array::from_fn(|a| ((cell[a] >> up) - (lowest[a] >> up) + 1) as usize);
        block.states[block.at(x, y, z)]
    };
    for n in 0..edge.pow(3) {
        let offset = [n % edge, n / edge % edge, n / edge / edge];
        let cell: [i128; 3] = std::array::from_fn(|a| lowest[a] + offset[a] as i128);
        if state_of(0, cell) != state::EXISTS {
            continue;
        }
        let is_missing =
            |step: [i128; 3]| state_of(0, std::array::from_fn(|a| cell[a] + step[a])) == 0;
        for step in steps().filter(|step| is_missing(*step)) {
            let beyond = std::array::from_fn(|a| cell[a] + step[a]);
            let levels = (1..raw.blocks.len() as u32)
                .find(|up| state_of(*up, beyond) & state::EXISTS != 0)
                .unwrap();
            let is_alone = parts(step).all(|part| !is_missing(part));
            let axes = step.iter().filter(|s| **s != 0).count();
            let kind = Kind { levels: levels as i32, axes, is_alone };
            found(kind, Border { octree: node.place.octree, cell, step });
        }
    }
}

/// Steps along some, not all, of the axes of `step`.
fn parts(step: [i128; 3]) -> impl Iterator<Item = [i128; 3]> {
    (1..7)
        .map(move |set| std::array::from_fn(|a| if set >> a & 1 == 1 { step[a] } else { 0 }))
        .filter(move |part: &[i128; 3]| *part != step && *part != [0; 3])
}

impl Border {
    fn cell_bits(&self) -> u32 {
        (FRACTION_BITS as i32 - self.octree) as u32
    }

    /// A random point of it.
    pub(crate) fn point(&self, random: &mut Random) -> Position {
        let bits = self.cell_bits();
        let hair = 1 << (bits - HAIR_BITS);
        let width = 1i128 << bits;
        Position(std::array::from_fn(|a| match self.step[a] {
            // One in four close to the border's own end.
            0 => {
                let within = if random.below(4) == 0 { width >> 12 } else { width };
                (self.cell[a] << bits) + (2 * hair) + random.whole(within - 4 * hair)
            }
            step => (self.cell[a] + (step + 1) / 2) << bits,
        }))
    }

    /// The points a hair from `point` on all sides of the border; the first lies in the cell, the
    /// last in the coarser one.
    pub(crate) fn sides(&self, point: &Position) -> Vec<Position> {
        let hair = 1i128 << (self.cell_bits() - HAIR_BITS);
        let axes: Vec<usize> = (0..3).filter(|a| self.step[*a] != 0).collect();
        (0..1 << axes.len())
            .map(|side| {
                let mut moved = *point;
                for (n, &a) in axes.iter().enumerate() {
                    let outward = if side >> n & 1 == 1 { 1 } else { -1 };
                    moved.0[a] += outward * self.step[a] * hair;
                }
                moved
            })
            .collect()
    }
}

impl Tree<'_> {
    /// How `value` jumps around `point`.
    pub(crate) fn jump(
        &self,
        border: &Border,
        point: &Position,
        value: impl Fn(&Position) -> f64,
    ) -> Jump {
        let around: Vec<f64> = border.sides(point).iter().map(&value).collect();
        let low = around.iter().copied().fold(f64::INFINITY, f64::min);
        let high = around.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let (domain, width) = (&self.cache.header().domain, 1i128 << border.cell_bits());
        let mut change = 0.0f64;
        for n in 0..6 {
            let mut beside = *point;
            beside.0[n / 2] += if n % 2 == 0 { width } else { -width };
            if domain.contains(&beside) {
                change = change.max((value(&beside) - around[0]).abs());
            }
        }
        Jump { jump: high - low, change, magnitude: low.abs().max(high.abs()) }
    }

    /// Octree levels of the cells on the border's two sides.
    pub(crate) fn levels(&self, border: &Border, point: &Position) -> [i32; 2] {
        let sides = border.sides(point);
        [&sides[0], &sides[sides.len() - 1]].map(|side| {
            let path = self.path(side, None);
            self.owner(&path, side).place.octree
        })
    }
}

/// Borders that `cut` makes: where a drawn brick touches one that is drawn coarser though it has
/// finer ones beneath.
pub(crate) fn of_cut(tree: &Tree<'_>, cut: &FootprintCut) -> BTreeMap<Kind, Vec<Border>> {
    let mut found: BTreeMap<Kind, Vec<Border>> = BTreeMap::new();
    for node in drawn(tree, cut) {
        let raw = tree.raw(node);
        for step in steps() {
            let Some((levels, border)) = coarser_beyond(tree, cut, node, step) else { continue };
            let lowest = node.place.lowest_cell(tree.cache.header().shape);
            let [x, y, z] = std::array::from_fn(|a| (border.cell[a] - lowest[a] + 1) as usize);
            if raw.blocks[0].states[raw.blocks[0].at(x, y, z)] & state::EXISTS != 0 {
                let axes = step.iter().filter(|s| **s != 0).count();
                let is_alone =
                    parts(step).all(|part| coarser_beyond(tree, cut, node, part).is_none());
                found.entry(Kind { levels, axes, is_alone }).or_default().push(border);
            }
        }
    }
    found
}

/// The bricks that are drawn, at least in some octant.
fn drawn<'n>(tree: &'n Tree<'_>, cut: &FootprintCut) -> Vec<&'n Node> {
    let mut drawn = Vec::new();
    let mut waiting = vec![&tree.nodes[0]];
    while let Some(node) = waiting.pop() {
        let children = if cut.opens(&node.place) { node.record.child_mask } else { 0 };
        let opened = (0..8).filter(|o| children >> o & 1 == 1);
        waiting.extend(opened.filter_map(|o| Some(&tree.nodes[node.record.child(o)? as usize])));
        if children != 0xff {
            drawn.push(node);
        }
    }
    drawn
}

/// A cell of the brick in the middle of its face, edge or corner toward `step`, if a brick that
/// the cut does not open lies beyond, and how many levels coarser that is.
fn coarser_beyond(
    tree: &Tree<'_>,
    cut: &FootprintCut,
    node: &Node,
    step: [i128; 3],
) -> Option<(i32, Border)> {
    let lowest = node.place.lowest_cell(tree.cache.header().shape);
    let cell = std::array::from_fn(|a| {
        lowest[a]
            + match step[a] {
                -1 => 0,
                0 => tree.edge() / 2 - 1,
                _ => tree.edge() - 1,
            }
    });
    let border = Border { octree: node.place.octree, cell, step };
    let bits = border.cell_bits();
    let beyond =
        Position(std::array::from_fn(|a| ((cell[a] + step[a]) << bits) + (1 << (bits - 1))));
    if !tree.cache.header().domain.contains(&beyond) {
        return None;
    }
    let within = Position(cell.map(|c| (c << bits) + (1 << (bits - 1))));
    let (here, there) = (tree.path(&within, Some(cut)), tree.path(&beyond, Some(cut)));
    let (here, there) = (here[here.len() - 1], there[there.len() - 1]);
    let levels = here.place.octree - there.place.octree;
    let is_cut = there.record.child_mask != 0 && !cut.opens(&there.place);
    (here.index == node.index && levels > 0 && is_cut).then_some((levels, border))
}
