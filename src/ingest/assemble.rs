//! Pass 2, one brick: its cells from source grids and from the averages of its children.

use std::ops::Range;
use std::sync::Arc;

use super::cells::SourceCells;
use super::packed::pack;
use super::tally::{
    Tally, exponent, largest_errors, magnitudes, round_mantissa, sum, times_power_of_two,
};
use super::upward::{Averages, Upward, average};
use crate::cache::{BrickShape, state};
use crate::source::GridRecord;
use crate::space::{IndexBox, cells_at};
use crate::{Error, Result};

/// Largest magnitude that is taken: sums of eight stay finite.
const LARGEST: f64 = 1e300;
/// Regions that reach into a cell by no more than this share of its width do not touch it: where edges of
/// the domain are no binary fractions, decimals of faces are beside them.
const LEAST_SHARE: f64 = 1e-6;

/// What is left out of the cache, and how values are stored.
#[derive(Debug, Clone, Default)]
pub(super) struct Rules {
    /// Values below this are dropped.
    pub(super) drop_below: Option<f64>,
    /// Only leaf cells that reach into this box, at octree level 60, are kept.
    pub(super) region: Option<IndexBox>,
    /// Largest relative error of a stored value.
    pub(super) relative_error: f64,
}

/// A brick to be assembled.
pub(super) struct Job {
    /// Its octree level.
    pub(super) octree: i32,
    /// Its coordinates at that level, in bricks.
    pub(super) coordinates: [u128; 3],
    /// Grids (numbers) that reach into it.
    pub(super) grids: Vec<u64>,
    /// Children that it has.
    pub(super) children: Vec<Upward>,
}

/// One field of an assembled brick.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct FieldCells {
    /// The values are `values · 2^exponent`.
    pub(super) exponent: i32,
    /// [`state`] bits, B³, x fastest.
    pub(super) states: Vec<u8>,
    /// B³, x fastest.
    pub(super) values: Vec<f32>,
}

/// How many cells of which kind a brick has.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Counts {
    /// Cells at which the level has data, refined further or not.
    pub(super) existing: u32,
    /// Existing cells that are refined further.
    pub(super) refined: u32,
    /// Existing cells that are not: leaf cells, dropped ones included.
    pub(super) leaf: u32,
}

/// An assembled brick.
pub(super) struct Assembled {
    /// Its cells, by kind.
    pub(super) counts: Counts,
    /// All fields, [packed](super::packed); nothing where cells are not kept.
    pub(super) packed: Vec<u8>,
    /// The averages for the parent, as [`Upward::to_bytes`] makes them.
    pub(super) upward: Vec<u8>,
    /// What was counted of each field; sums are of values alone, not yet times the cells' volume.
    pub(super) tallies: Vec<Tally>,
}

/// Assembles bricks of one data set.
pub(super) struct Assembler<'s> {
    /// Where values of cells come from.
    pub(super) cells: SourceCells<'s>,
    /// How many cells bricks have.
    pub(super) shape: BrickShape,
    /// Cells of the root grid along each axis.
    pub(super) root_cells: [u64; 3],
    /// Number of fields.
    pub(super) fields: usize,
    /// What is dropped, and how exactly values are stored.
    pub(super) rules: Rules,
    /// The source's path, for messages.
    pub(super) place: String,
    /// Whether the source holds values of cells that finer levels cover.
    pub(super) has_covered_cells: bool,
    /// Whether cells are wanted, beside what is counted.
    pub(super) keeps_cells: bool,
}

impl Assembler<'_> {
    /// The brick's cells, its averages for the parent, and what it counts.
    pub(super) fn assemble(&self, job: &Job) -> Result<Assembled> {
        let (mut packed, mut tallies) = (Vec::new(), Vec::with_capacity(self.fields));
        let mut counts = Counts::default();
        let mut upward = Upward { coordinates: job.coordinates, fields: Vec::new() };
        for field in 0..self.fields {
            let mut draft = Draft::new(self.shape, job, self.root_cells);
            self.fill_from_grids(job, field, &mut draft)?;
            if !self.has_covered_cells {
                self.check_leaves(job, &draft)?;
            }
            for child in &job.children {
                draft.take_averages(child.octant(), &child.fields[field]);
            }
            self.check_complete(job, &draft)?;
            let mut tally = Tally::default();
            self.drop_leaves(job, &mut draft, &mut tally);
            self.check_values(job, field, &draft)?;
            counts = count_cells(&draft, &mut tally);
            let averages = average(self.shape.edge(), &draft.states, &draft.values, &draft.weights)
                .map_err(|cell| self.partial(job, cell))?;
            upward.fields.push(averages);
            let stored = draft.store(self.rules.relative_error, &mut tally);
            if self.keeps_cells {
                pack(&stored, &mut packed);
            }
            tallies.push(tally);
        }
        Ok(Assembled { counts, packed, upward: upward.to_bytes(), tallies })
    }

    fn fill_from_grids(&self, job: &Job, field: usize, draft: &mut Draft) -> Result<()> {
        let wanted = draft.cells;
        for &number in &job.grids {
            self.cells.rows(number, field, &wanted, &mut |first, values| {
                let start = draft.index(first);
                let states = &mut draft.states[start..start + values.len()];
                if states.iter().fold(0, |any, bits| any | bits) & state::EXISTS != 0 {
                    return Err(self.overlap(job, number, first)?);
                }
                states.iter_mut().for_each(|bits| *bits |= state::EXISTS);
                draft.values[start..start + values.len()].copy_from_slice(values);
                Ok(())
            })?;
        }
        Ok(())
    }

    /// Where outputs hold leaf cells alone, no grid may lie under finer ones, as a block does that stands
    /// in the file beside its own children.
    fn check_leaves(&self, job: &Job, draft: &Draft) -> Result<()> {
        let covered = job.children.iter().find_map(|child| {
            child.fields.first().and_then(|field| draft.first_under(child.octant(), field))
        });
        match covered {
            None => Ok(()),
            Some(at) => Err(self.covered(job, draft.cell(at))?),
        }
    }

    /// The root grid must cover the domain. Where it lacks whole bricks, averages above it are missing.
    fn check_complete(&self, job: &Job, draft: &Draft) -> Result<()> {
        let missing = (job.octree <= 0).then(|| draft.states.iter().position(|&bits| bits == 0));
        match missing.flatten() {
            None => Ok(()),
            Some(at) => {
                let root_cell = draft.cell(at).map(|c| c << job.octree.unsigned_abs());
                let reason = format!("no grid covers root cell {root_cell:?}");
                Err(Error::invalid(&self.place, reason))
            }
        }
    }

    /// Values must be of a size that averages and tallies can take; those under finer grids, and of
    /// cells that are dropped, have been replaced.
    fn check_values(&self, job: &Job, field: usize, draft: &Draft) -> Result<()> {
        let is_too_large = |value: &f64| value.abs() > LARGEST;
        if !draft.values.iter().fold(false, |any, value| any | is_too_large(value)) {
            return Ok(());
        }
        match draft.values.iter().position(is_too_large) {
            Some(at) => Err(self.too_large(job, field, draft.cell(at), draft.values[at])?),
            None => Ok(()),
        }
    }

    /// Marks leaf cells that are to be dropped.
    fn drop_leaves(&self, job: &Job, draft: &mut Draft, tally: &mut Tally) {
        if self.rules.drop_below.is_none() && self.rules.region.is_none() {
            return;
        }
        for at in 0..draft.states.len() {
            let value = draft.values[at];
            let is_leaf = draft.states[at] == state::EXISTS;
            if is_leaf && self.drops(job.octree, draft.cell(at), value) {
                draft.states[at] |= state::VOID;
                draft.values[at] = 0.0;
                tally.dropped_cells += 1;
                tally.dropped_sum.add(if value.abs() <= LARGEST { value } else { 0.0 });
            }
        }
    }

    fn drops(&self, octree: i32, cell: [i128; 3], value: f64) -> bool {
        self.rules.drop_below.is_some_and(|least| value < least) || !self.in_region(octree, cell)
    }

    fn in_region(&self, octree: i32, cell: [i128; 3]) -> bool {
        let Some(region) = &self.rules.region else { return true };
        let shift = i64::from(crate::space::MAX_OCTREE_LEVEL) - i64::from(octree);
        let least = ((1i128 << shift) as f64 * LEAST_SHARE) as i128;
        (0..3).all(|a| {
            // Of a region that is thinner itself all of it.
            let least = least.min((region.hi[a] - region.lo[a]) / 4);
            let [lo, hi] = [region.lo[a] + least, region.hi[a] - least];
            cell[a] << shift < hi && lo < (cell[a] + 1) << shift
        })
    }

    fn overlap(&self, job: &Job, number: u64, first: [i128; 3]) -> Result<Error> {
        let grid = self.cells.grid(number)?;
        let mut other = None;
        for &candidate in &job.grids {
            let record = self.cells.grid(candidate)?;
            if candidate != number && !record.cells().intersection(&grid.cells()).is_empty() {
                other = Some(record.id);
            }
        }
        let other = other.map_or_else(|| "another grid".to_owned(), |id| format!("grid {id}"));
        Ok(Error::invalid(
            &self.place,
            format!(
                "grid {} overlaps {other} of the same level {} near cell {first:?}",
                grid.id, grid.level
            ),
        ))
    }

    fn covered(&self, job: &Job, cell: [i128; 3]) -> Result<Error> {
        let whose = self.owner(job, cell)?.map_or_else(
            || format!("octree level {}", job.octree),
            |grid| format!("level {} in grid {}", grid.level, grid.id),
        );
        let reason = format!(
            "cell {cell:?} of {whose} is stored beside finer cells in its place: of such outputs each place \
             belongs to one block, so is a block there twice, or its parent?"
        );
        Ok(Error::invalid(&self.place, reason))
    }

    /// The grid that has `cell` of the brick's level.
    fn owner(&self, job: &Job, cell: [i128; 3]) -> Result<Option<Arc<GridRecord>>> {
        let one = IndexBox::at(cell, [1; 3]);
        for &number in &job.grids {
            let grid = self.cells.grid(number)?;
            if grid.cells().contains(&one) {
                return Ok(Some(grid));
            }
        }
        Ok(None)
    }

    fn too_large(&self, job: &Job, field: usize, cell: [i128; 3], value: f64) -> Result<Error> {
        let whose = self.owner(job, cell)?.map_or_else(
            || format!("octree level {}", job.octree),
            |grid| format!("level {} (grid {})", grid.level, grid.id),
        );
        let what = if value.is_finite() { "beyond ±1e300" } else { "infinite" };
        let name = self.cells.field_name(field).escape_debug().to_string();
        let advice = self.cells.advice(field, |values| format!("max(-1e30, min({values}, 1e30))"));
        Ok(Error::invalid(
            &self.place,
            format!(
                "field `{name}`: the value in cell {cell:?} of {whose} is {what}, and such values \
                 cannot be stored: {advice}"
            ),
        ))
    }

    fn partial(&self, job: &Job, cell: [usize; 3]) -> Error {
        let first = Draft::first_cell(self.shape, job);
        let cell: [i128; 3] = std::array::from_fn(|a| first[a] + cell[a] as i128);
        Error::invalid(
            &self.place,
            format!(
                "grids begin or end inside a cell of the level above, at cell {cell:?} of octree \
                 level {}: grids must cover whole coarser cells",
                job.octree
            ),
        )
    }
}

/// One field of a brick while it is assembled: B³ cells, x fastest.
struct Draft {
    edge: usize,
    cells: IndexBox,
    states: Vec<u8>,
    values: Vec<f64>,
    /// The part of each cell's volume that its value stands for, as [`Averages::weights`]; empty
    /// while all are 1.
    weights: Vec<f64>,
}

impl Draft {
    fn first_cell(shape: BrickShape, job: &Job) -> [i128; 3] {
        job.coordinates.map(|c| c as i128 * shape.edge() as i128)
    }

    fn new(shape: BrickShape, job: &Job, root_cells: [u64; 3]) -> Self {
        let edge = shape.edge();
        let first = Self::first_cell(shape, job);
        let cells = IndexBox::at(first, [edge as u32; 3]);
        let mut draft = Self {
            edge,
            cells,
            states: vec![0; shape.cells()],
            values: vec![0.0; shape.cells()],
            weights: Vec::new(),
        };
        let end = root_cells.map(|cells| cells_at(job.octree, cells));
        if (0..3).any(|a| cells.hi[a] > end[a]) {
            for at in 0..draft.states.len() {
                let cell = draft.cell(at);
                if (0..3).any(|a| cell[a] >= end[a]) {
                    draft.states[at] = state::OUTSIDE;
                }
            }
        }
        draft
    }

    /// The level index of the brick's cell number `at`.
    fn cell(&self, at: usize) -> [i128; 3] {
        let local = [at % self.edge, at / self.edge % self.edge, at / self.edge / self.edge];
        std::array::from_fn(|a| self.cells.lo[a] + local[a] as i128)
    }

    fn index(&self, cell: [i128; 3]) -> usize {
        let local = |a: usize| (cell[a] - self.cells.lo[a]) as usize;
        (local(2) * self.edge + local(1)) * self.edge + local(0)
    }

    /// The first cell that has a value where a child in `octant` has `averages` for it.
    fn first_under(&self, octant: u8, averages: &Averages) -> Option<usize> {
        let rows = self.octant_rows(octant).zip(averages.states.chunks_exact(self.edge / 2));
        rows.flat_map(|(row, above)| row.zip(above))
            .find(|&(at, &above)| above != 0 && self.states[at] & state::EXISTS != 0)
            .map(|(at, _)| at)
    }

    /// The rows of cells of an octant, in the order of a child's averages.
    fn octant_rows(&self, octant: u8) -> impl Iterator<Item = Range<usize>> + use<> {
        let (edge, half) = (self.edge, self.edge / 2);
        let offset = move |a: u8| usize::from(octant >> a & 1) * half;
        (0..half * half).map(move |row| {
            let (y, z) = (row % half, row / half);
            let first = ((z + offset(2)) * edge + y + offset(1)) * edge + offset(0);
            first..first + half
        })
    }

    /// Puts a child's averages into its octant.
    fn take_averages(&mut self, octant: u8, averages: &Averages) {
        let half = self.edge / 2;
        if !averages.weights.is_empty() && self.weights.is_empty() {
            self.weights = vec![1.0; self.states.len()];
        }
        for (row, to) in self.octant_rows(octant).enumerate() {
            let from = row * half..(row + 1) * half;
            take(
                &mut self.values[to.clone()],
                &averages.values[from.clone()],
                &averages.states[from.clone()],
            );
            if let Some(weights) = averages.weights.get(from.clone()) {
                take(&mut self.weights[to.clone()], weights, &averages.states[from.clone()]);
            }
            take(&mut self.states[to], &averages.states[from.clone()], &averages.states[from]);
        }
    }

    /// The field as it is stored.
    fn store(self, relative_error: f64, tally: &mut Tally) -> FieldCells {
        let (largest, smallest) = magnitudes(&self.values);
        let power = exponent(largest, smallest);
        let scaled = |&value: &f64| times_power_of_two(value, -power) as f32;
        let mut values: Vec<f32> = match power {
            0 => self.values.iter().map(|&value| value as f32).collect(),
            _ => self.values.iter().map(scaled).collect(),
        };
        if relative_error > 0.0 {
            values.iter_mut().for_each(|value| *value = round_mantissa(*value, relative_error));
        }
        let stored = kept(&self.states, values.iter().map(|&value| f64::from(value)));
        tally.stored_sum.add(times_power_of_two(sum(&stored).value(), power));
        let [leaves, averages] = largest_errors(&self.states, &self.values, &values, power);
        tally.leaf_error = tally.leaf_error.max(leaves);
        tally.relative_error = tally.relative_error.max(leaves).max(averages);
        FieldCells { exponent: power, states: self.states, values }
    }
}

/// Counts cells by kind, and values of leaf cells.
fn count_cells(draft: &Draft, tally: &mut Tally) -> Counts {
    let count = |is: fn(u8) -> bool| {
        draft.states.iter().fold(0, |count, &bits| count + u32::from(is(bits)))
    };
    let existing = count(|bits| bits & state::EXISTS != 0);
    let refined = count(|bits| bits & state::REFINED != 0);
    let leaves = kept(&draft.states, draft.values.iter().copied());
    tally.nan_cells += u64::from(count(|bits| bits == state::EXISTS)) - leaves.len() as u64;
    tally.count(&leaves);
    Counts { existing, refined, leaf: existing - refined }
}

/// The values of leaf cells that are neither dropped nor NaN, in their order.
fn kept(states: &[u8], values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut kept = vec![0.0; states.len()];
    let mut count = 0;
    for (&bits, value) in states.iter().zip(values) {
        // Written in any case, which is faster than to branch: the next takes its place.
        kept[count] = value;
        count += usize::from((bits == state::EXISTS) & !value.is_nan());
    }
    kept.truncate(count);
    kept
}

/// Takes those cells of a row that have `states`.
fn take<T: Copy>(to: &mut [T], from: &[T], states: &[u8]) {
    if states.iter().fold(true, |all, &bits| all & (bits != 0)) {
        to.copy_from_slice(from);
        return;
    }
    for ((to, &from), &bits) in to.iter_mut().zip(from).zip(states) {
        if bits != 0 {
            *to = from;
        }
    }
}
