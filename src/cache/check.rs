//! Whether a decoded payload is what the index says, and fits its place.

use super::brick::{Block, BrickPlace, RawBrick, state};
use super::digits::NAN_BITS;
use super::header::Header;
use super::record::{FieldRecord, NodeRecord};
use crate::lanes::{Kernel, Lanes, Width};
use crate::space::cells_at;

/// Whether a decoded payload is what its records say.
pub(super) fn check_brick(
    edge: usize,
    node: &NodeRecord,
    record: &FieldRecord,
    brick: &RawBrick,
) -> Result<(), &'static str> {
    for block in &brick.blocks {
        if !Width::best().run(InRange { block, range: record.own, nan: record.has_nan(true) }) {
            return Err("a value lies outside the range that the index gives");
        }
    }
    let is_hole = |bits| bits & (state::EXISTS | state::OUTSIDE) == 0;
    if brick.blocks.last().is_none_or(|block| state::any(&block.states, is_hole)) {
        return Err("its last block has holes");
    }
    check_cells(edge, node, brick)
}

/// Whether the values of cells that exist are in a range, or NaN if `nan`.
struct InRange<'b> {
    block: &'b Block,
    range: [f32; 2],
    nan: bool,
}

impl Kernel for InRange<'_> {
    type Output = bool;

    // Without an end at the first that is not: several values at a time.
    #[inline(always)]
    fn run<L: Lanes>(self, _: L) -> bool {
        let Self { block, range: [low, high], nan } = self;
        let sound = |value: f32, bits: u8| {
            (bits & state::EXISTS == 0)
                | ((low <= value) & (value <= high))
                | (nan & (value.to_bits() == NAN_BITS))
        };
        let cells = block.values.iter().zip(&block.states);
        cells.fold(true, |all, (&value, &bits)| all & sound(value, bits))
    }
}

/// Counts and children must agree with the cells' states.
fn check_cells(edge: usize, node: &NodeRecord, brick: &RawBrick) -> Result<(), &'static str> {
    let Some(block) = brick.blocks.first() else { return Err("it has no cells") };
    let (mut existing, mut refined, mut octants) = (0, 0, 0u8);
    for z in 0..edge {
        for y in 0..edge {
            let start = block.at(1, y + 1, z + 1);
            let upper = ((2 * y / edge) << 1) | ((2 * z / edge) << 2);
            let row = &block.states[start..start + edge];
            existing += row.iter().map(|&bits| u32::from(state::is_own(bits))).sum::<u32>();
            for (x, half) in row.chunks_exact(edge / 2).enumerate() {
                let count = half.iter().map(|bits| u32::from(bits & state::REFINED)).sum::<u32>();
                refined += count / u32::from(state::REFINED);
                octants |= u8::from(count > 0) << (x | upper);
            }
        }
    }
    if existing != node.existing_cells || refined != node.refined_cells {
        return Err("it has other cells than the index counts");
    }
    if octants != node.child_mask {
        return Err("its refined cells are not where it has children");
    }
    Ok(())
}

/// Whether just those cells are marked as beyond the domain that are, in every block.
pub(super) fn marks_outside(header: &Header, place: &BrickPlace, brick: &RawBrick) -> bool {
    let lowest = place.lowest_cell(header.shape);
    brick.blocks.iter().enumerate().all(|(up, block)| {
        let up = u32::try_from(up).unwrap_or(u32::MAX).min(126);
        let octree = place.octree.saturating_sub_unsigned(up);
        let domain = header.domain.root_cells().map(|cells| cells_at(octree, cells));
        let inside = std::array::from_fn(|a| {
            let first = (lowest[a] >> up) - 1;
            [-first, domain[a] - first]
        });
        block_marks_outside(block, inside)
    })
}

/// Whether just those cells of one block are marked as beyond the domain that are; `inside` are the
/// first cell of the domain and the first one beyond it along each axis, counted from the block's
/// lower corner.
fn block_marks_outside(block: &Block, inside: [[i128; 2]; 3]) -> bool {
    let side = block.side as i128;
    if inside.iter().all(|[first, end]| *first <= 0 && side <= *end) {
        return !state::any(&block.states, |bits| bits == state::OUTSIDE);
    }
    let within = |a: usize, i: usize| (inside[a][0]..inside[a][1]).contains(&(i as i128));
    (0..block.side).all(|z| {
        (0..block.side).all(|y| {
            let in_row = within(1, y) && within(2, z);
            let row = block.at(0, y, z);
            let states = &block.states[row..row + block.side];
            states
                .iter()
                .enumerate()
                .all(|(x, &bits)| (bits == state::OUTSIDE) != (in_row && within(0, x)))
        })
    })
}
