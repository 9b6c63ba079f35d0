//! A brick made ready to march through: mapped values, ghosts and holes filled.

use super::blocks::{EXISTING, NarrowBlock, ScaledBlock, gather_corners, held};
use super::cell_shades::CellShades;
use super::fill::{fill_holes, fill_outside};
use super::kept_rates::KeptRates;
use super::margin::WholeCells;
use super::parents::ParentRow;
use super::relief::Relief;
use super::steepness::Surveyor;
use crate::cache::{Block, BrickPlace, BrickShape, Inside, RawBrick, state};
use crate::lanes::BYTE_PADDING;
use crate::render::transfer::distance::Distance;
use crate::render::transfer::pieces::PieceList;
use crate::scene::Interpolation;
use crate::space::MAX_OCTREE_LEVEL;
use crate::{Error, Result};

/// Levels that a brick's own may be blended with in packets.
pub(crate) const MOST_PARENTS: usize = 3;

/// What the marcher has to mind in a dual cell, the cube between eight cell centres.
pub(crate) mod dual {
    /// All eight cells exist and none is void: the interpolant is trilinear.
    pub(crate) const PLAIN: u8 = 0;
    /// Formulas or ownership differ between the cells.
    pub(crate) const MIXED: u8 = 1;
    /// All eight cells are void.
    pub(crate) const VOID: u8 = 2;
    /// Formulas or ownership differ between the cells, but none is void, and they are of so few
    /// levels that packets of rays may pass.
    pub(crate) const BLENDED: u8 = 3;
}

/// What takes many stored values to x, from what takes one: NaN becomes 0, and others are held to
/// ±10³⁰.
pub fn one_by_one(mapping: impl Fn(f32) -> f64) -> impl Fn(&[f32], &mut [f64]) {
    move |stored, out| {
        out.iter_mut().zip(stored).for_each(|(x, stored)| *x = held(mapping(*stored)));
    }
}

/// A decoded brick in the scene's own scale. Its memory is reused from brick to brick.
#[derive(Debug, Default)]
pub struct ScaledBrick {
    /// Cells along an edge.
    pub(crate) edge: usize,
    /// log2 of `edge`.
    pub(super) edge_bits: u32,
    /// The brick's block and, for `linear`, its ancestors'. For `cell`, one block whose cells
    /// hold what is drawn there, NaN where that is nothing; its ghosts are NaN.
    pub(crate) blocks: Vec<ScaledBlock>,
    /// Number of `blocks` in use.
    pub(crate) used: usize,
    /// [`dual`] of the (edge + 1)³ dual cells, x fastest, and padding for lanes; empty where all
    /// are plain.
    pub(crate) duals: Vec<u8>,
    /// The blocks as packets of rays see them: the own one, and the others where there are
    /// borders; none for `cell`.
    pub(crate) narrow: [NarrowBlock; 1 + MOST_PARENTS],
    /// For `cell`, what packets of rays see; empty where no one asks.
    pub(crate) shades: CellShades,
    /// How far values differ near any place; empty where no one asks.
    pub(crate) relief: Relief,
    /// What packets have found out by it.
    pub(crate) rates: KeptRates,
    /// Whether `prepare` was asked for `cell`.
    is_piecewise_constant: bool,
    /// Where holes do not reach, and the brick as the next coarser level has it, which takes the
    /// rest; its memory is kept where a brick does not need it.
    core: Option<WholeCells>,
    coarse: Option<Box<Self>>,
}

impl ScaledBrick {
    /// An empty brick.
    pub fn new() -> Self {
        Self::default()
    }

    /// Most heap bytes that a brick of `shape` with `blocks` blocks takes.
    pub fn bytes(shape: BrickShape, blocks: usize, interpolation: Interpolation) -> u64 {
        let has_coarse = interpolation == Interpolation::Linear && blocks > 1;
        let coarse = if has_coarse {
            size_of::<Self>() as u64
                + Self::bytes_of_one(shape.coarser(), blocks - 1, interpolation)
        } else {
            0
        };
        Self::bytes_of_one(shape, blocks, interpolation) + coarse
    }

    /// Most heap bytes that such a brick takes without its next coarser level.
    fn bytes_of_one(shape: BrickShape, blocks: usize, interpolation: Interpolation) -> u64 {
        let heads = blocks.max(4).next_power_of_two() * size_of::<ScaledBlock>();
        let values = match interpolation {
            Interpolation::Cell => {
                size_of::<f64>() * shape.cells_in_blocks(1) + CellShades::bytes(shape.edge())
            }
            Interpolation::Linear => {
                let duals = (shape.edge() + 1).pow(3) + BYTE_PADDING;
                let narrow = blocks.min(1 + MOST_PARENTS);
                let of_narrow = (1 + size_of::<f32>()) * shape.cells_in_blocks(narrow);
                9 * shape.cells_in_blocks(blocks) + duals + of_narrow + BYTE_PADDING * narrow
            }
        };
        (values + heads) as u64 + Relief::bytes(shape.edge()) + KeptRates::bytes(shape.edge())
    }

    /// Fills the brick from `raw`, the payload of the brick at `place`; `mapping` takes stored
    /// values to the transfer function's x, unclamped but between ±10³⁰, as many as there is room for.
    ///
    /// # Errors
    /// A payload whose shape or states contradict `shape` or themselves.
    pub fn prepare(
        &mut self,
        raw: &RawBrick,
        place: &BrickPlace,
        shape: BrickShape,
        mapping: impl Fn(&[f32], &mut [f64]),
        interpolation: Interpolation,
    ) -> Result<()> {
        check(raw, place, shape)?;
        self.reset(shape.edge(), interpolation);
        match interpolation {
            Interpolation::Cell => self.load_cells(raw, mapping),
            Interpolation::Linear => {
                self.load_linear(raw, place, shape, mapping);
                self.find_margin(raw);
            }
        }
        Ok(())
    }

    /// Sets up the next coarser level where the own one does not fill the brick. Constant cells do
    /// without: they have no borders, and more parts cost packets more than fewer cells gain.
    fn find_margin(&mut self, raw: &RawBrick) {
        let core = WholeCells::of(&raw.blocks[0], self.edge);
        if raw.blocks.len() == 1 || core.is_all(self.edge) {
            return;
        }
        let mut coarse = self.coarse.take().unwrap_or_default();
        coarse.reset(self.edge / 2, Interpolation::Linear);
        coarse.take_above(self, &raw.blocks[1..]);
        (self.core, self.coarse) = (Some(core), Some(coarse));
    }

    /// Where its own level lies, and the brick as the next coarser level has it, to be drawn where
    /// that one does not; none where it lies everywhere.
    pub(super) fn margin(&self) -> Option<(&WholeCells, &Self)> {
        self.core.as_ref().zip(self.coarse.as_deref())
    }

    fn reset(&mut self, edge: usize, interpolation: Interpolation) {
        self.edge = edge;
        self.edge_bits = edge.trailing_zeros();
        self.is_piecewise_constant = interpolation == Interpolation::Cell;
        self.duals.clear();
        self.shades.clear();
        self.relief.clear();
        self.rates.clear();
        self.narrow.iter_mut().for_each(NarrowBlock::clear);
        self.core = None;
    }

    /// Finds out how far values differ near any place of the brick, which is prepared, and what
    /// cells of constant value look like to packets.
    pub(crate) fn survey(
        &mut self,
        pieces: &PieceList,
        distance: &Distance,
        surveyor: &mut Surveyor,
    ) {
        let mut relief = std::mem::take(&mut self.relief);
        relief.fill(self, pieces, distance, surveyor);
        if self.is_piecewise_constant {
            self.shades.fill(&self.blocks[0], pieces, &relief);
        }
        self.relief = relief;
        if let Some(coarse) = self.coarse.as_mut().filter(|_| self.core.is_some()) {
            // Nothing lies beneath.
            let distance = Distance { residual: 0.0, child_mask: 0, ..*distance };
            coarse.survey(pieces, &distance, surveyor);
        }
    }

    /// Whether the values are constant in each cell, as in `cell`.
    pub(crate) fn is_piecewise_constant(&self) -> bool {
        self.is_piecewise_constant
    }

    fn reserve(&mut self, blocks: usize) {
        if self.blocks.len() < blocks {
            self.blocks.reserve_exact(blocks - self.blocks.len());
            self.blocks.resize_with(blocks, ScaledBlock::default);
        }
        self.used = blocks;
    }

    fn load_cells(&mut self, raw: &RawBrick, mapping: impl Fn(&[f32], &mut [f64])) {
        self.reserve(1);
        let (edge, bits) = (self.edge, self.edge_bits);
        let (block, own) = (&mut self.blocks[0], &raw.blocks[0]);
        block.side = own.side;
        block.states.clear();
        block.values.clear();
        block.values.reserve_exact(own.side.pow(3));
        block.values.resize(own.side.pow(3), f64::NAN);
        let mut stored = [0.0; BrickShape::MOST_CELLS];
        let stored = &mut stored[..edge];
        for z in 0..edge {
            for y in 0..edge {
                let first = own.at(1, y + 1, z + 1);
                let mut states = [0; BrickShape::MOST_CELLS];
                for x in 0..edge {
                    (stored[x], states[x]) = match own.states[first + x] {
                        0 => owner(&raw.blocks, [x, y, z], bits),
                        states => (own.values[first + x], states),
                    };
                }
                let row = &mut block.values[first..first + edge];
                mapping(stored, row);
                for (x, bits) in row.iter_mut().zip(states) {
                    let is_drawn = bits & (state::EXISTS | state::VOID) == state::EXISTS;
                    *x = if is_drawn { *x } else { f64::NAN };
                }
            }
        }
    }

    fn load_linear(
        &mut self,
        raw: &RawBrick,
        place: &BrickPlace,
        shape: BrickShape,
        mapping: impl Fn(&[f32], &mut [f64]),
    ) {
        self.reserve(raw.blocks.len());
        let (lowest, mut row) = (place.lowest_cell(shape), ParentRow::default());
        for (up, own) in raw.blocks.iter().enumerate().rev() {
            let (lower, upper) = self.blocks.split_at_mut(up + 1);
            let block = &mut lower[up];
            block.load(own, &mapping);
            let shift = u32::try_from(up).unwrap_or(u32::MAX).min(126);
            block.scale = (-f64::from(shift)).exp2();
            block.corner = lowest.map(|c| (c & ((1 << shift) - 1)) as f64 * block.scale);
            block.upper = lowest.map(|c| (c >> shift.saturating_sub(1) & 1) as usize);
            if let Some(above) = upper.first().filter(|_| up + 1 < raw.blocks.len()) {
                fill_holes(block, above, &mut row);
            }
            fill_outside(block);
        }
        self.complete(&raw.blocks);
    }

    /// Takes over the blocks above a finer brick's own, whose payload they are in.
    fn take_above(&mut self, finer: &Self, raw: &[Block]) {
        self.reserve(raw.len());
        for (own, block) in self.blocks.iter_mut().zip(&finer.blocks[1..finer.used]) {
            own.copy(block);
            own.scale *= 2.0;
        }
        self.complete(raw);
    }

    /// Becomes a brick of `edge` cells that have these values, ghosts included, at one level.
    pub(super) fn take_values(&mut self, edge: usize, values: &[f64]) {
        self.reset(edge, Interpolation::Linear);
        self.reserve(1);
        self.blocks[0].take(edge + 2, values);
        self.narrow[0].fill(&self.blocks[0], false);
    }

    /// Finds out what follows from the blocks' values.
    fn complete(&mut self, raw: &[Block]) {
        self.mark_holes(raw);
        self.mark_outside();
        self.mark_duals();
        let has_borders = !self.duals.is_empty();
        let blocks = if has_borders { self.used } else { 1 };
        for (narrow, block) in self.narrow.iter_mut().zip(&self.blocks[..blocks]) {
            narrow.fill(block, has_borders);
        }
    }

    /// Gives holes their owner's VOID bit.
    fn mark_holes(&mut self, raw: &[Block]) {
        let (edge, bits) = (self.edge, self.edge_bits);
        let block = &mut self.blocks[0];
        let none = |block: &Block, holds: fn(u8) -> bool| !state::any(&block.states, holds);
        // No owner is void, and none is missing.
        let all_shown = raw.iter().all(|block| none(block, |bits| bits & state::VOID != 0))
            && raw.last().is_some_and(|last| none(last, |bits| bits & state::EXISTS == 0));
        if all_shown || !state::any(&block.states, |bits| bits == 0) {
            return;
        }
        for z in 0..edge {
            for y in 0..edge {
                let first = block.at([1, y + 1, z + 1]);
                let row = &mut block.states[first..first + edge];
                if !row.contains(&0) {
                    continue;
                }
                for (x, states) in row.iter_mut().enumerate().filter(|(_, states)| **states == 0) {
                    *states = owner(raw, [x, y, z], bits).1 & state::VOID;
                }
            }
        }
    }

    /// Gives cells beyond the domain the VOID bit of the nearest inside, whose value they have: where a
    /// ray leaves the domain, rounding may place it in either.
    fn mark_outside(&mut self) {
        let ScaledBlock { side, states, .. } = &mut self.blocks[0];
        if !state::any(states, |bits| bits & state::VOID != 0) {
            return;
        }
        let Some(inside) = Inside::of(*side, states) else { return };
        for at in 0..states.len() {
            if states[at] == state::OUTSIDE {
                states[at] |= states[inside.nearest(at)] & state::VOID;
            }
        }
    }

    fn mark_duals(&mut self) {
        let block = &self.blocks[0];
        let is_plain = |bits| (bits & EXISTING != 0) & (bits & state::VOID == 0);
        if !state::any(&block.states, |bits| !is_plain(bits)) {
            return;
        }
        const PLAIN: u8 = 1;
        const VOID: u8 = 2;
        const HOLE: u8 = 4;
        let is_blended = (2..=1 + MOST_PARENTS).contains(&self.used);
        let flags = |bits| {
            let is_void = bits & state::VOID != 0;
            let shown = if bits & EXISTING != 0 { PLAIN } else { HOLE };
            if is_void { VOID } else { shown }
        };
        gather_corners(&mut self.duals, block, flags, [0; 3]);
        for kind in &mut self.duals {
            *kind = match *kind {
                PLAIN => dual::PLAIN,
                VOID => dual::VOID,
                found if found & VOID != 0 || !is_blended => dual::MIXED,
                _ => dual::BLENDED,
            };
        }
        self.duals.extend([dual::PLAIN; BYTE_PADDING]);
    }
}

/// Stored value and state of the nearest ancestor's cell that exists where the brick's cell is a
/// hole.
fn owner(raw: &[Block], cell: [usize; 3], edge_bits: u32) -> (f32, u8) {
    for (up, block) in raw.iter().enumerate().skip(1) {
        // Beyond the brick's own size its whole block is one cell.
        let [x, y, z] = cell.map(|c| if up <= edge_bits as usize { c >> up } else { 0 });
        let at = block.at(x + 1, y + 1, z + 1);
        if block.states[at] & state::EXISTS != 0 {
            return (block.values[at], block.states[at]);
        }
    }
    (0.0, state::VOID)
}

fn check(raw: &RawBrick, place: &BrickPlace, shape: BrickShape) -> Result<()> {
    let wrong = |what: &str| {
        let [x, y, z] = place.coordinates;
        Err(Error::invalid(
            format!("brick ({x}, {y}, {z}) of tree level {}", place.tree_level),
            format!("{what}; the cache is damaged: check it with `deepfield verify`"),
        ))
    };
    let limit = 1_i128 << 90;
    if place.octree > MAX_OCTREE_LEVEL as i32
        || place.coordinates.iter().any(|c| !(0..limit).contains(c))
    {
        return wrong("it lies outside every octree");
    }
    for (up, block) in raw.blocks.iter().enumerate() {
        let cells = shape.side(up).pow(3);
        if block.side != shape.side(up)
            || block.values.len() != cells
            || block.states.len() != cells
        {
            return wrong("a block has the wrong number of cells");
        }
        if !state::are_valid(&block.states) {
            return wrong("a cell's state means nothing");
        }
    }
    match raw.blocks.last() {
        None => wrong("it has no values"),
        Some(last) if state::any(&last.states, |bits| bits == 0) => {
            wrong("cells without data have no ancestor that holds them")
        }
        Some(_) => Ok(()),
    }
}
