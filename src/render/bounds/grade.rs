//! What the march of packets may be off by in each group of a brick's cells, and which groups are
//! fit for it at all.
//!
//! What depends on the values along a ray, the packet bounds itself, cutting its way into parts until
//! the bound is small (`render/march/packet/bends.rs`). What no cutting changes is bounded here, once
//! for each group: the table's deviation, and rounding of x and of light to f32.

use std::sync::atomic::{AtomicU64, Ordering};

use crate::render::brick::kept_rates::Key;
use crate::render::brick::passage::Passage;
use crate::render::brick::relief::{Group, Relief};
use crate::render::transfer::change::Change;
use crate::render::transfer::pieces::TransferPieces;
use crate::render::transfer::rounded::{two_halves, up};
use crate::render::transfer::span::Smoothness;
use crate::render::transfer::table::TransferTable;

/// The rate of a group that packets leave to the march of single rays.
pub(crate) const UNFIT: u32 = u32::MAX;
/// Optical depth that packets take for a part of a cell, at most.
pub(crate) const DEEPEST: f32 = 1.0;

/// How rays are marched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd)]
pub(crate) enum Care {
    /// In packets.
    Rough,
    /// In packets that allow a cell far less.
    Fine,
    /// One by one.
    Exact,
}

/// Parts that the way through a cell is cut into at most, whatever the care.
pub(crate) const MOST_PARTS: u32 = 64;

impl Care {
    /// The next better one.
    pub(crate) fn more(self) -> Self {
        match self {
            Self::Rough => Self::Fine,
            Self::Fine | Self::Exact => Self::Exact,
        }
    }

    /// Parts that the way through a cell is cut into, at most.
    pub(super) fn parts(self) -> u32 {
        if self == Self::Rough { 16 } else { MOST_PARTS }
    }

    /// What a single cell may be off by, as a part of what a ray may be.
    pub(super) fn share_of_cell(self) -> f64 {
        if self == Self::Rough { 1.0 / 8.0 } else { 1.0 / 64.0 }
    }
}

/// Rounding of places in a brick, cells, and of what follows from them, relative. Where rays come
/// into a cell is known as a sum of two f32 (`render/march/packet/walk.rs`); from there on, of what they
/// pass in it, rounding of its length, of their direction, and of the sum make 2⁻²⁴ at most each.
const PLACE_ROUNDING: f64 = 3e-7;
const VALUE_ROUNDING: f64 = 3.6e-7;
const LIGHT_ROUNDING: f64 = 4e-6;
/// What is lost below the smallest f32, of values relative to the table's.
const UNDERFLOW: f64 = f32::MIN_POSITIVE as f64;
/// Groups are fit that are off by no more than this many times as much as all might be.
const FITTING: f64 = 16.0;
/// What is little against emission and extinction.
const LITTLE_OF_GROUP: f64 = 0.01;
/// Cells that a ray may pass at one level, about: what a cell may be off by is this share of what
/// a ray may be.
const CELLS_OF_LEVEL: f64 = 512.0;

/// What packets march by, for a picture.
#[derive(Debug)]
pub(crate) struct PacketTransfer {
    /// No other has this one.
    number: u64,
    /// The transfer function as packets look it up.
    pub(crate) table: TransferTable,
    /// What its bends are bounded by.
    pub(super) close: TransferPieces,
    /// What the march may be off by along a ray, in the picture's own unit; where that is not
    /// known, little against what a group emits and absorbs.
    pub(crate) allowed: Option<f64>,
    /// The domain's diagonal, code length.
    pub(super) longest: f64,
    /// Light that is expected from behind.
    pub(super) behind: f64,
}

impl PacketTransfer {
    /// What packets march by: a table and what its bends are bounded by, for light that may be off
    /// by `allowed` along a ray, with so much light expected from `behind`, in a domain through
    /// which the longest way is `longest`, code length.
    pub(crate) fn new(
        table: TransferTable,
        close: TransferPieces,
        allowed: Option<f64>,
        behind: f64,
        longest: f64,
    ) -> Self {
        Self { number: next_number(), table, close, allowed, longest, behind }
    }

    /// Takes another goal: what the march may be off by along a ray, in the picture's own unit, and
    /// the light that is expected from behind.
    pub(crate) fn aim(&mut self, allowed: f64, behind: f64) {
        (self.number, self.allowed, self.behind) = (next_number(), Some(allowed), behind);
    }

    /// Emission, relative to the table's, that weighs as much as the table's largest extinction.
    pub(crate) fn darkening(&self) -> f32 {
        let light = self.table.extinction * self.behind.max(1.0) / self.table.emission;
        light.min(f64::from(f32::MAX)) as f32
    }
}

/// Rates that are kept with bricks are known by it; nothing else depends on it.
fn next_number() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    NEXT.fetch_add(1, Ordering::Relaxed)
}

/// The groups of a brick, as packets see them. Its memory is reused from brick to brick.
#[derive(Debug, Default)]
pub(crate) struct Grades {
    /// What each group may be off by: `packet::PacketBrick::rates`.
    pub(crate) rates: Vec<u32>,
    /// What levels beneath make each group be off by: `packet::PacketBrick::levels`.
    pub(crate) levels: Vec<u32>,
    /// The same of all groups together: `packet::PacketBrick::most_levels`.
    pub(crate) most_levels: [f32; 2],
    /// All that is known of each group: `packet::PacketBrick::rows`.
    pub(crate) rows: Vec<[f32; 8]>,
    /// Whether rows have what [`Self::look_around`] finds.
    has_near: bool,
    /// Slopes and ranges of each group: `packet::PacketBrick::reliefs`.
    pub(crate) reliefs: Vec<[f32; 8]>,
    /// How far kinks are looked for: `packet::PacketBrick::reach`; set only where rays stand
    /// for squares.
    pub(crate) reach: f32,
    /// Whether rays of squares wider than a cell may go through.
    pub(crate) is_fit_for_wide: bool,
    /// Parts that the way through a cell is cut into, at most.
    pub(crate) parts: u32,
    /// What a single cell may be off by ([`Care::share_of_cell`]); 1 where cells are constant.
    pub(crate) share: f64,
    /// The most that stored values make of x: `packet::PacketBrick::storage`.
    pub(crate) storage: [f32; 2],
    /// Groups that packets march through.
    pub(crate) fit: usize,
}

impl Grades {
    /// Grades the groups of the brick of a passage, whose cells measure `diagonal` code lengths from
    /// corner to corner.
    pub(crate) fn fill(
        &mut self,
        passage: &Passage<'_>,
        diagonal: f64,
        care: Care,
        has_squares: bool,
        transfer: &PacketTransfer,
    ) {
        let Passage { brick, hides, .. } = *passage;
        let relief = &brick.relief;
        let reach = if hides { relief.levels_reach } else { 0.0 };
        let count = relief.count();
        (self.parts, self.share) = (care.parts(), care.share_of_cell());
        let grader = Grader { transfer, reach, diagonal, parts: f64::from(self.parts) };
        let key = Key { transfer: transfer.number, hides, is_fine: care > Care::Rough };
        brick.rates.fill(key, &mut self.rates, |rates| {
            rates.extend((0..count).map(|n| grader.grade(relief.group(n))));
        });
        self.fit = self.rates.iter().filter(|rate| **rate != UNFIT).count();
        self.fill_levels(relief, hides, transfer);
        let is_elsewhere = hides || has_squares;
        let whole = relief.whole.storage(is_elsewhere);
        let (most, slope) = (whole.most(), whole.slope());
        let rows = (0..count).map(|n| {
            let [a, b, c, d] = stored(relief.group(n), is_elsewhere, slope, &transfer.table);
            let levels = self.levels.get(n).copied().unwrap_or(0);
            let mut row = [a, b, c, d, 0.0, 0.0, 0.0, 0.0];
            row[RATE] = f32::from_bits(self.rates[n]);
            [row[LEVELS], row[LEVELS_NEAR]] = [f32::from_bits(levels); 2];
            row
        });
        self.rows.clear();
        self.rows.extend(rows);
        self.has_near = self.levels.is_empty();
        self.storage = [most, slope].map(up);
        self.reliefs.clear();
        if has_squares {
            self.reliefs.extend((0..count).map(|n| row(relief.group(n), &transfer.table)));
            self.reliefs.push(row(&relief.whole, &transfer.table));
            self.reach = up(reach + most);
            self.is_fit_for_wide = grader.is_smooth(&relief.whole);
        }
    }

    /// Grades the groups of the brick of a passage, whose cells are constant and far from steps:
    /// there all groups are fit, also for wide squares, and their rates say the most that they emit and
    /// absorb.
    pub(crate) fn fill_cells(
        &mut self,
        passage: &Passage<'_>,
        has_squares: bool,
        transfer: &PacketTransfer,
    ) {
        let relief = &passage.brick.relief;
        (self.parts, self.share) = (1, 1.0);
        let most = |n: usize| pack(relief.group(n).span.most, &transfer.table);
        self.rates.clear();
        self.rates.extend((0..relief.count()).map(most));
        self.fit = self.rates.len();
        self.fill_levels(relief, passage.hides, transfer);
        self.rows.clear();
        self.reliefs.clear();
        self.is_fit_for_wide = true;
        if has_squares {
            let groups = (0..relief.count()).map(|n| relief.group(n)).chain([&relief.whole]);
            self.reliefs.extend(groups.map(|group| cell_row(group, &transfer.table)));
        }
    }

    /// Takes in what levels beneath make each group be off by, where the brick is drawn in their
    /// place.
    fn fill_levels(&mut self, relief: &Relief, hides: bool, transfer: &PacketTransfer) {
        self.levels.clear();
        let most = relative(relief.whole.levels, &transfer.table);
        self.most_levels = most.map(|x| up(x.min(MOST_STORED)));
        if hides {
            let groups = (0..relief.count()).map(|n| relief.group(n));
            self.levels.extend(groups.map(|group| pack(group.levels, &transfer.table)));
        }
    }

    /// Finds the most that levels beneath make in a group or any beside it, `side` groups along an
    /// edge, unless that is known.
    pub(crate) fn look_around(&mut self, side: usize) {
        if self.has_near {
            return;
        }
        self.has_near = true;
        for stride in [1, side, side * side] {
            // Along one axis after the other, by what was there before: the last is kept.
            let mut before = vec![0; stride];
            for at in 0..self.rows.len() {
                let n = at / stride % side;
                let own = self.rows[at][LEVELS_NEAR].to_bits();
                let mut most = own;
                if n > 0 {
                    most = larger_halves(most, before[at % stride]);
                }
                if n + 1 < side {
                    most = larger_halves(most, self.rows[at + stride][LEVELS_NEAR].to_bits());
                }
                before[at % stride] = own;
                self.rows[at][LEVELS_NEAR] = f32::from_bits(most);
            }
        }
    }
}

/// Where a group's entry in `packet::PacketBrick::rows` has what it may be off by, what levels beneath
/// make of that, and the most that they make in it or beside it; before them stands what stored values
/// make.
pub(crate) const RATE: usize = 4;
pub(crate) const LEVELS: usize = 5;
pub(crate) const LEVELS_NEAR: usize = 6;

/// The larger of the upper halves and the larger of the lower ones.
fn larger_halves(a: u32, b: u32) -> u32 {
    (a & !0xffff).max(b & !0xffff) | (a & 0xffff).max(b & 0xffff)
}

/// Where a group's entry in `packet::PacketBrick::reliefs` has the range of its values, and what stored
/// values make; before them stand slopes, and what of these does not cancel.
pub(crate) const RELIEF_RANGE: usize = 6;
pub(crate) const RELIEF_STORED: usize = 7;

/// A group's entry in `packet::PacketBrick::reliefs`.
fn row(group: &Group, table: &TransferTable) -> [f32; 8] {
    let ([x, y, z], [p, q, r]) = (group.slope, group.uneven);
    let mut row = [x, y, z, p, q, r, group.high - group.low, 0.0].map(up);
    row[RELIEF_STORED] = f32::from_bits(pack(group.most_stored(true), table));
    row
}

/// The same where cells are constant.
fn cell_row(group: &Group, table: &TransferTable) -> [f32; 8] {
    let [emission, extinction] = relative(group.elsewhere(), table);
    let mut row = [0.0; 8];
    (row[0], row[1]) = (up(emission.min(MOST_STORED)), up(extinction.min(MOST_STORED)));
    row[RELIEF_STORED] = f32::from_bits(pack(group.most_stored(true), table));
    row
}

/// Whether a group has values, and no void.
fn is_full(group: &Group) -> bool {
    group.low <= group.high && !group.has_void
}

struct Grader<'g> {
    transfer: &'g PacketTransfer,
    reach: f64,
    diagonal: f64,
    parts: f64,
}

impl Grader<'_> {
    /// The values of a group, and what they may be in truth, of squares as well: these share the rates.
    fn range(&self, group: &Group) -> [f64; 2] {
        let reach = self.reach + group.storage(true).most();
        [group.low - reach, group.high + reach]
    }

    /// Whether a group is without void, and the transfer function without steps over it.
    fn is_smooth(&self, group: &Group) -> bool {
        let [low, high] = self.range(group);
        is_full(group) && self.transfer.close.merged.over(low, high).jumps == Change::default()
    }

    fn grade(&self, group: &Group) -> u32 {
        if !is_full(group) {
            return UNFIT;
        }
        let [low, high] = self.range(group);
        let smoothness = self.transfer.close.merged.smoothness(low, high);
        if smoothness.steps {
            return UNFIT;
        }
        let off = self.off(group, &smoothness);
        let most = self.allowed(&smoothness).times(FITTING);
        let is_fit = off.emission <= most.emission && off.extinction <= most.extinction;
        if is_fit { pack(off, &self.transfer.table) } else { UNFIT }
    }

    /// What emission and extinction may be off by.
    fn allowed(&self, smoothness: &Smoothness) -> Change {
        let PacketTransfer { allowed, longest, behind, .. } = *self.transfer;
        let Some(allowed) = allowed else { return smoothness.most.times(LITTLE_OF_GROUP) };
        let least = smoothness.least_extinction;
        let share = longest.recip().max(least).max((CELLS_OF_LEVEL * self.diagonal).recip());
        Change { emission: allowed * share, extinction: allowed * share / behind.max(1.0) }
    }

    /// What emission and extinction are off by.
    fn off(&self, group: &Group, smoothness: &Smoothness) -> Change {
        let Smoothness { deviation, slope, most, .. } = *smoothness;
        let depth = most.extinction * self.diagonal / self.parts;
        if depth.is_nan() || depth > f64::from(DEEPEST) {
            return Change { emission: f64::INFINITY, extinction: f64::INFINITY };
        }
        let table = self.transfer.table.deviation(group.low, group.high);
        let largest = group.low.abs().max(group.high.abs());
        let whole: f64 = group.slope.iter().sum();
        let rounded = PLACE_ROUNDING * whole + VALUE_ROUNDING * largest;
        let lost = Change {
            emission: table[0] + UNDERFLOW * self.transfer.table.emission + 2.0 * deviation,
            extinction: table[1] + UNDERFLOW * self.transfer.table.extinction,
        };
        lost.plus(most.times(LIGHT_ROUNDING)).plus(slope.times(rounded))
    }
}

/// The first numbers of a row of `packet::PacketBrick::rows`, where what values make of x grows
/// by so much a unit of it in all groups.
fn stored(group: &Group, is_elsewhere: bool, slope: f64, table: &TransferTable) -> [f32; 4] {
    let storage = group.storage(is_elsewhere);
    let most = storage.most();
    let [emission, extinction] = relative(group.most_stored(is_elsewhere), table);
    let base = storage.base_for(slope, group.low);
    // Adding the slope's share to it rounds.
    let base = base + BASE_ROUNDING * base.abs();
    [emission, extinction, most, base].map(|x| up(x.min(MOST_STORED)))
}

/// Rounding of a sum in f32, relative to one of the two.
const BASE_ROUNDING: f64 = 3e-7;
/// More than anything that is stored makes, in f32.
const MOST_STORED: f64 = 1e38;

/// Emission and extinction of `off`, each relative to the table's scale of it.
fn relative(off: Change, table: &TransferTable) -> [f64; 2] {
    let extinction = if table.extinction > 0.0 { off.extinction / table.extinction } else { 0.0 };
    [off.emission / table.emission, extinction]
}

/// What [`relative`] says, rounded up to the upper halves of f32 and packed into one number; never
/// [`UNFIT`].
fn pack(off: Change, table: &TransferTable) -> u32 {
    two_halves(relative(off, table)).min(UNFIT - 1)
}
