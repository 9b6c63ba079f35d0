//! Pass 3, one brick: its cells with ghosts, and its ancestors' blocks.

use std::sync::Arc;

use super::assemble::FieldCells;
use super::neighbourhood::{Neighbourhood, direction};
use super::store::StoredBricks;
use super::tally::times_power_of_two;
use crate::cache::{Block, BrickShape, RawBrick, state};
use crate::space::cells_at;
use crate::{Error, Result};

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

/// The bricks around one, all fields of each.
type Around = [Option<Arc<Vec<FieldCells>>>; 27];

impl Gatherer<'_> {
    /// The payload of the brick at the centre of `neighbours`: as many ancestors' blocks as it takes
    /// until one is complete, and at least one, which borders of level choice need. The memory of
    /// `raw` is reused.
    pub(super) fn gather(&self, neighbours: &Arc<Neighbourhood>, raw: &mut RawBrick) -> Result<()> {
        let lowest = neighbours.place.lowest_cell(self.shape);
        let mut ancestor = Some(neighbours);
        let mut up = 0;
        while let Some(neighbours) = ancestor {
            raw.blocks.resize_with(raw.blocks.len().max(up + 1), Block::default);
            let first: [i32; 3] = std::array::from_fn(|a| {
                let own = neighbours.place.lowest_cell(self.shape)[a];
                ((lowest[a] >> up) - own) as i32 - 1
            });
            let complete = self.gather_block(neighbours, first, self.shape.side(up), raw, up)?;
            up += 1;
            if complete && up > 1 {
                break;
            }
            ancestor = neighbours.parent.as_ref();
        }
        raw.blocks.truncate(up);
        Ok(())
    }

    /// The block of `side`³ cells from `first`, counted from the lowest cell of the brick at the
    /// centre of `neighbours`. Whether every cell inside the domain exists.
    fn gather_block(
        &self,
        neighbours: &Neighbourhood,
        first: [i32; 3],
        side: usize,
        raw: &mut RawBrick,
        up: usize,
    ) -> Result<bool> {
        let edge = self.shape.edge() as i32;
        let mut around = Around::default();
        let steps = |a: usize| {
            let last = first[a] + side as i32 - 1;
            first[a].div_euclid(edge)..=last.div_euclid(edge)
        };
        let block = &mut raw.blocks[up];
        block.reset(side);
        for z in steps(2) {
            for y in steps(1) {
                for x in steps(0) {
                    let at = direction([x, y, z]);
                    if let Some(brick) = neighbours.bricks[at] {
                        let cells = self.bricks.get(neighbours.place.tree_level, brick)?;
                        self.copy(&cells[self.field], [x, y, z], first, block);
                        around[at] = Some(cells);
                    }
                }
            }
        }
        self.mark_outside(neighbours, first, block);
        // Without an end at the first: many states at a time.
        let known = |bits: u8| bits & (state::EXISTS | state::OUTSIDE) != 0;
        let complete = block.states.iter().fold(true, |all, &bits| all & known(bits));
        if block.states.iter().fold(0, |any, bits| any | bits) & state::VOID != 0 {
            self.fill_void(neighbours, first, &mut around, block)?;
        }
        Ok(complete)
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
    /// beside the domain's border.
    fn fill_void(
        &self,
        neighbours: &Neighbourhood,
        first: [i32; 3],
        around: &mut Around,
        block: &mut Block,
    ) -> Result<()> {
        for at in 0..block.states.len() {
            if block.states[at] & state::VOID == 0 {
                continue;
            }
            let local = [at % block.side, at / block.side % block.side, at / block.side.pow(2)];
            let cell: [i32; 3] = std::array::from_fn(|a| first[a] + local[a] as i32);
            let mut sums = [(0u32, 0.0f64); 3];
            for step in 0..27i32 {
                let step = [step % 3 - 1, step / 3 % 3 - 1, step / 9 - 1];
                let distance = step.iter().map(|s| s.unsigned_abs() as usize).sum::<usize>();
                let neighbour = std::array::from_fn(|a| cell[a] + step[a]);
                if distance > 0
                    && let Some(value) = self.kept(neighbours, neighbour, around)?
                {
                    sums[distance - 1].0 += 1;
                    sums[distance - 1].1 += value;
                }
            }
            let nearest = sums.iter().find(|(count, _)| *count > 0);
            block.values[at] = nearest.map_or(0.0, |(n, sum)| (sum / f64::from(*n)) as f32);
        }
        Ok(())
    }

    /// The stored value of a cell that exists, is not dropped and is a number; `cell` counts
    /// from the lowest cell of the brick at the centre of `neighbours`.
    fn kept(
        &self,
        neighbours: &Neighbourhood,
        cell: [i32; 3],
        around: &mut Around,
    ) -> Result<Option<f64>> {
        let edge = self.shape.edge() as i32;
        let at = direction(cell.map(|c| c.div_euclid(edge)));
        let Some(brick) = neighbours.bricks.get(at).copied().flatten() else { return Ok(None) };
        let cells = match &around[at] {
            Some(cells) => cells,
            None => around[at].insert(self.bricks.get(neighbours.place.tree_level, brick)?),
        };
        let local = cell.map(|c| c.rem_euclid(edge) as usize);
        let index = (local[2] * self.shape.edge() + local[1]) * self.shape.edge() + local[0];
        let Some(field) = cells.get(self.field) else {
            return Err(Error::request("a field that is not ingested"));
        };
        let bits = field.states[index];
        let value = f64::from(field.values[index]);
        let kept = bits & state::EXISTS != 0 && bits & state::VOID == 0 && !value.is_nan();
        Ok(kept.then(|| times_power_of_two(value, field.exponent - self.exponent)))
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
            let [x, y, z] = cell.map(|c| (c >> up) + 1);
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
