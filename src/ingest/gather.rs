//! Pass 3, one brick: its cells with ghosts, and its ancestors' blocks.

use std::sync::Arc;

use super::assemble::FieldCells;
use super::neighbourhood::{Neighbourhood, direction};
use super::store::StoredBricks;
use super::tally::times_power_of_two;
use crate::Result;
use crate::cache::{Block, BrickShape, RawBrick, state};
use crate::space::cells_at;

/// Gathers the payloads of one field.
pub(super) struct Gatherer<'s> {
    /// The bricks of pass 2.
    pub(super) bricks: &'s StoredBricks<'s>,
    /// How many cells bricks have.
    pub(super) shape: BrickShape,
    /// Cells of the root grid along each axis.
    pub(super) root_cells: [u64; 3],
    /// The field's number.
    pub(super) field: usize,
    /// The field's power of two: stored values are `value · 2^-exponent`.
    pub(super) exponent: i32,
}

/// Where a block lies: the bricks around, and its first cell, counted from the lowest one of that at
/// their centre.
struct BlockPlace<'n> {
    neighbours: &'n Neighbourhood,
    first: [i32; 3],
}

impl Gatherer<'_> {
    /// The payload of the brick at the centre of `neighbours`: as many ancestors' blocks as it takes
    /// until one is complete, and at least one, which borders of level choice need. The memory of
    /// `raw` is reused.
    pub(super) fn gather(&self, neighbours: &Arc<Neighbourhood>, raw: &mut RawBrick) -> Result<()> {
        let lowest = neighbours.place.lowest_cell(self.shape);
        let mut ancestor = Some(neighbours);
        let mut places: Vec<BlockPlace<'_>> = Vec::new();
        let mut kept = usize::MAX;
        while let Some(neighbours) = ancestor {
            let up = places.len();
            raw.blocks.resize_with(raw.blocks.len().max(up + 1), Block::default);
            let first: [i32; 3] = std::array::from_fn(|a| {
                let own = neighbours.place.lowest_cell(self.shape)[a];
                ((lowest[a] >> up) - own) as i32 - 1
            });
            let place = BlockPlace { neighbours, first };
            raw.blocks[up].reset(self.shape.side(up));
            let complete = self.gather_block(&place, &mut raw.blocks[up])?;
            places.push(place);
            if complete && up > 0 {
                kept = kept.min(places.len());
                // Dropped cells take their values from above, which is not stored.
                if !has_void(&raw.blocks[up]) {
                    break;
                }
            }
            ancestor = neighbours.parent.as_ref();
        }
        raw.blocks.truncate(places.len());
        if raw.blocks.iter().any(has_void) {
            for (up, place) in places.iter().enumerate().rev() {
                let (finer, coarser) = raw.blocks.split_at_mut(up + 1);
                let Some(block) = finer.last_mut() else { continue };
                let above = coarser.first().map(|above| Above::new(above, block.side, lowest, up));
                if let Some(above) = &above {
                    above.spread_void(block);
                }
                self.fill_void(place, above.as_ref(), block)?;
            }
        }
        raw.blocks.truncate(kept);
        Ok(())
    }

    /// Gathers a block. Whether every cell inside the domain exists.
    fn gather_block(&self, place: &BlockPlace<'_>, block: &mut Block) -> Result<bool> {
        let (edge, side) = (self.shape.edge() as i32, block.side);
        let &BlockPlace { neighbours, first } = place;
        let steps = |a: usize| {
            let last = first[a] + side as i32 - 1;
            first[a].div_euclid(edge)..=last.div_euclid(edge)
        };
        for z in steps(2) {
            for y in steps(1) {
                for x in steps(0) {
                    if let Some(brick) = neighbours.bricks[direction([x, y, z])] {
                        let cells = self.bricks.get(neighbours.place.tree_level, brick)?;
                        self.copy(&cells[self.field], [x, y, z], first, block);
                    }
                }
            }
        }
        self.mark_outside(neighbours, first, block);
        // Without an end at the first: many states at a time.
        let known = |bits: u8| bits & (state::EXISTS | state::OUTSIDE) != 0;
        Ok(block.states.iter().fold(true, |all, &bits| all & known(bits)))
    }

    /// Copies what the brick `step` bricks away has of the block.
    fn copy(&self, cells: &FieldCells, step: [i32; 3], first: [i32; 3], block: &mut Block) {
        let edge = self.shape.edge() as i32;
        let corner = step.map(|s| s * edge);
        let range = |a: usize| {
            let last = first[a] + block.side as i32;
            corner[a].max(first[a])..(corner[a] + edge).min(last)
        };
        let (xs, ys, zs) = (range(0), range(1), range(2));
        let count = xs.len();
        let power = cells.exponent - self.exponent;
        for z in zs {
            for y in ys.clone() {
                let local = |p: i32, a: usize| (p - corner[a]) as usize;
                let from = (local(z, 2) * self.shape.edge() + local(y, 1)) * self.shape.edge()
                    + local(xs.start, 0);
                let place = |p: i32, a: usize| (p - first[a]) as usize;
                let to = block.at(place(xs.start, 0), place(y, 1), place(z, 2));
                put(&mut block.states[to..to + count], &cells.states[from..from + count]);
                let values = &mut block.values[to..to + count];
                put(values, &cells.values[from..from + count]);
                if power != 0 {
                    for value in values {
                        *value = times_power_of_two(f64::from(*value), power) as f32;
                    }
                }
            }
        }
    }

    /// Marks the cells beyond the domain.
    fn mark_outside(&self, neighbours: &Neighbourhood, first: [i32; 3], block: &mut Block) {
        let lowest = neighbours.place.lowest_cell(self.shape);
        let octree = neighbours.place.octree;
        let inside: [std::ops::Range<i128>; 3] = std::array::from_fn(|a| {
            let end = cells_at(octree, self.root_cells[a]);
            let start = lowest[a] + i128::from(first[a]);
            -start..end - start
        });
        let side = block.side as i128;
        if inside.iter().all(|range| range.start <= 0 && range.end >= side) {
            return;
        }
        let within = |a: usize, i: usize| inside[a].contains(&(i as i128));
        for z in 0..block.side {
            for y in 0..block.side {
                for x in 0..block.side {
                    if !(within(0, x) && within(1, y) && within(2, z)) {
                        let at = block.at(x, y, z);
                        block.states[at] = state::OUTSIDE;
                        block.values[at] = 0.0;
                    }
                }
            }
        }
    }

    /// Gives dropped cells the mean of their kept neighbours across faces, where there are none
    /// across edges, else across corners: so the interpolant beside them is what it would be
    /// beside the domain's border. Those without any have the value above them, or are holes if the
    /// level has nothing there, since holes beside them may be filled by theirs.
    fn fill_void(
        &self,
        &BlockPlace { neighbours, first }: &BlockPlace<'_>,
        above: Option<&Above<'_>>,
        block: &mut Block,
    ) -> Result<()> {
        if !has_void(block) {
            return Ok(());
        }
        let mut wider = Block::default();
        wider.reset(block.side + 2);
        self.gather_block(&BlockPlace { neighbours, first: first.map(|f| f - 1) }, &mut wider)?;
        for at in 0..block.states.len() {
            if block.states[at] & state::VOID == 0 {
                continue;
            }
            let local = [at % block.side, at / block.side % block.side, at / block.side.pow(2)];
            if let Some(value) = mean_of_kept(&wider, local) {
                block.values[at] = value;
            } else if block.states[at] == state::IN_COARSER_VOID {
                block.states[at] = 0;
            } else {
                block.values[at] = above.map_or(0.0, |above| above.block.values[above.at(local)]);
            }
        }
        Ok(())
    }
}

/// The mean of a cell's neighbours that exist, are not dropped and are numbers, of the nearest of them.
/// `wider` has one more cell on each side than the block in which the cell is.
fn mean_of_kept(wider: &Block, cell: [usize; 3]) -> Option<f32> {
    let mut sums = [(0u32, 0.0f64); 3];
    for step in 0..27 {
        let step = [step % 3, step / 3 % 3, step / 9];
        let distance = step.iter().filter(|&&s| s != 1).count();
        let [x, y, z] = std::array::from_fn(|a| cell[a] + step[a]);
        let at = wider.at(x, y, z);
        let (bits, value) = (wider.states[at], wider.values[at]);
        let is_kept = bits & state::EXISTS != 0 && bits & state::VOID == 0 && !value.is_nan();
        if distance > 0 && is_kept {
            sums[distance - 1].0 += 1;
            sums[distance - 1].1 += f64::from(value);
        }
    }
    let nearest = sums.iter().find(|(count, _)| *count > 0);
    nearest.map(|(n, sum)| (sum / f64::from(*n)) as f32)
}

fn has_void(block: &Block) -> bool {
    block.states.iter().fold(0, |any, bits| any | bits) & state::VOID != 0
}

/// The next coarser block, and which of its cells hold those of a block.
struct Above<'b> {
    block: &'b Block,
    parents: [Vec<usize>; 3],
}

impl<'b> Above<'b> {
    /// What lies above the block of `side`³ cells that is `up` levels above the brick whose lowest cell
    /// is `lowest`.
    fn new(block: &'b Block, side: usize, lowest: [i128; 3], up: usize) -> Self {
        // A block begins one cell before the brick.
        let first = |a: usize, up: usize| (lowest[a] >> up) - 1;
        let parent = |a: usize, n: usize| {
            let parent = (first(a, up) + n as i128) >> 1;
            usize::try_from(parent - first(a, up + 1)).unwrap_or(0).min(block.side - 1)
        };
        let parents = std::array::from_fn(|a| (0..side).map(|n| parent(a, n)).collect());
        Self { block, parents }
    }

    /// Index of the cell that holds a block's cell.
    fn at(&self, [x, y, z]: [usize; 3]) -> usize {
        self.block.at(self.parents[0][x], self.parents[1][y], self.parents[2][z])
    }

    /// Marks cells of the block beneath that the level does not have and that lie in dropped ones.
    fn spread_void(&self, block: &mut Block) {
        if !has_void(self.block) {
            return;
        }
        let side = block.side;
        let holes = block.states.iter_mut().enumerate().filter(|(_, bits)| **bits == 0);
        for (at, bits) in holes {
            let parent = self.at([at % side, at / side % side, at / side.pow(2)]);
            if self.block.states[parent] & state::VOID != 0 {
                *bits = state::IN_COARSER_VOID;
            }
        }
    }
}

/// Copies cells; single ones, as most ghosts are, without a call.
fn put<T: Copy>(to: &mut [T], from: &[T]) {
    match (&mut *to, from) {
        ([to], [from]) => *to = *from,
        _ => to.copy_from_slice(from),
    }
}

/// Whether nothing in the brick's box is drawn at any level: every cell inside the domain was
/// dropped, at its own level or as part of the coarser cell that owns it.
pub(super) fn is_void(shape: BrickShape, raw: &RawBrick) -> bool {
    let edge = shape.edge();
    let local = (0..edge.pow(3)).map(|i| [i % edge, i / edge % edge, i / edge / edge]);
    local.into_iter().all(|cell| {
        for (up, block) in raw.blocks.iter().enumerate() {
            // The brick's lowest cell lies at an even multiple of 2^up until a block is one cell.
            let [x, y, z] = cell.map(|c| c.checked_shr(up as u32).unwrap_or(0) + 1);
            let bits = block.states[block.at(x, y, z)];
            if bits & state::EXISTS != 0 {
                return bits & state::VOID != 0;
            }
            if bits & state::OUTSIDE != 0 {
                return true;
            }
        }
        false
    })
}
