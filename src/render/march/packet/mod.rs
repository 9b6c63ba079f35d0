//! The march of several rays at once through one brick, in f32.
//!
//! Each ray walks from dual cell to dual cell ([`walk`]), from crossing to crossing as sums of two
//! f32 ([`long`]), so that cells at its end are placed as exactly as those at its beginning. Where
//! rays come into the brick is worked out before, in f64 (`packets/lane_rays.rs`). Within a cell
//! the interpolant ([`cube`]) at two Gauss–Legendre nodes gives emission and extinction by table
//! ([`shade`], [`crate::render::transfer::table`]): bins with two lines each, which meet at a
//! corner of the transfer function. The optical depth up to a node is that of extinction linear
//! between the nodes ([`gain`]). A cell beside a border of levels is cut where the weight of its
//! level bends, and blended at the nodes ([`blended`]).
//!
//! Nothing searches for bends of the transfer function. What passing over them may cost is bounded from
//! the values met and from how the interpolant bends along the ray ([`bends`]); where that is more
//! than a cell's share, the way through it is passed again in more parts ([`sums`]). Few rays
//! need that at a time, so their parts are dealt to all lanes: what each shows is worked out side
//! by side, depths in front of parts are summed in order, and what they gather is collected in their
//! rays' lanes ([`part_lanes`]).
//!
//! Where rays stand for squares of pixels, their account is kept in lanes too ([`square`]; its twin
//! for single rays is `render/march/brick_account.rs`, and tests hold both to all rays of a
//! square). A ray behind which no more than its share of the tolerance can follow stops inside the
//! brick. What rounding may do is graded per group of cells ([`crate::render::bounds::grade`]; kept
//! with bricks that areas pass many times, `render/brick/kept_rates.rs`); rays stop before cells
//! that are not fit for it. All numbers are the brick's own, near 1: lengths in cells, light
//! relative to the transfer function's largest. All of this is put together in [`interpolated`].
//!
//! Where cells are constant, rays walk through the cells themselves ([`cells`]). What a cell emits
//! and absorbs is known from when its brick was loaded (`render/brick/cell_shades.rs`). A crossing
//! from one to the next may be off in f32: it counts with what both emit and absorb, dimmed by what
//! lies behind it in them, so that opaque surfaces cost little; where the order of two is in doubt,
//! with the most of the group around.
//!
//! No closures here, nor what takes them: they are functions of their own, compiled without the
//! lanes' instructions.
#![allow(clippy::needless_range_loop)]

mod bends;
mod beside;
mod blended;
mod cells;
mod cube;
mod gain;
mod interpolated;
mod long;
mod part_lanes;
mod rows;
mod shade;
mod square;
mod sums;
mod walk;

pub(crate) use self::blended::Parents;
use self::walk::{Exit, Walk};
use crate::lanes::{Kernel, Lanes, MOST_LANES, Row};
use crate::render::brick::scaled::MOST_PARENTS;
use crate::render::transfer::table::TransferTable;

/// What rounding may do to places in a brick, cells.
pub(super) const SLACK: f32 = 1e-5;

/// Origins in a brick of up to 63 cells are multiples of this, so that f32 holds them and their
/// differences to planes exactly.
pub(super) const ORIGIN_STEP: f64 = 1.0 / (1 << 18) as f64;

/// What packets see of a brick.
pub(super) struct PacketBrick<'g> {
    /// Mapped values of the brick's block, x fastest, ghosts included.
    pub(super) values: &'g [f32],
    /// Cells along the edge of that block, ghosts included; without ghosts where cells are
    /// constant.
    pub(super) side: usize,
    /// What [`dual`] kind each dual cell is, (side − 1)³ and padding for lanes; empty where all
    /// are plain.
    pub(super) kinds: &'g [u8],
    /// Which corners of each dual cell exist, likewise.
    pub(super) corners: &'g [u8],
    /// The blocks that the level is blended with, the first ones.
    pub(super) parents: [Parents<'g>; MOST_PARENTS],
    /// How many of these there are.
    pub(super) parent_count: usize,
    /// Lowest dual cell that is drawn, along each axis.
    pub(super) lo: [f32; 3],
    /// Highest dual cell that is drawn, along each axis.
    pub(super) hi: [f32; 3],
    /// What constant cells emit (R, G, B) and absorb, x fastest, relative to the table's; then `side`
    /// is the brick's edge, cells take the place of dual cells, and there are neither values nor
    /// kinds. Else empty.
    pub(super) shades: &'g [[f32; 4]],
    /// For each group of cells what emission (upper half of the bits, relative to the table's) and
    /// extinction (lower half) may be off by; [`UNFIT`] where that is too much. Where cells are
    /// constant, the most that they are.
    pub(super) rates: &'g [u32],
    /// All that is known of each group where cells are not constant, else empty. What stored values
    /// make of emission and extinction, relative to the table's, and of x, at most, and where that is
    /// 0; then the bits of its rates, of its levels', and of the levels' near it.
    pub(super) rows: &'g [[f32; 8]],
    /// For each group what emission and extinction may be off by, packed as `rates` are, because
    /// bricks beneath are hidden; empty where none are.
    pub(super) levels: &'g [u32],
    /// The same of all groups together, for squares that are wider than a cell.
    pub(super) most_levels: [f32; 2],
    /// For each cell, where cells are constant, what emission and extinction may be off by, packed
    /// as `rates` are, because its value is not stored exactly; else empty.
    pub(super) storages: &'g [u32],
    /// The most that stored values make of x in any group, and how much more that is for each unit
    /// of x.
    pub(super) storage: [f32; 2],
    /// Where rays stand for squares, for each group, and all in one: steepest slopes of x along
    /// each axis, half the ranges of these, and the range of x; where cells are constant, what
    /// emission and extinction differ by from one to any other, relative to the table's, and
    /// fillers. Last what stored values make of emission and extinction at most, packed as `rates`
    /// are. Else empty.
    pub(super) reliefs: &'g [[f32; 8]],
    /// Whether rays are marched in place of others, near them: then what holds for places a cell beside
    /// each group counts of levels, as it does of all else that is known of groups.
    pub(super) are_proxies: bool,
    /// How far kinks are looked for around what a square's rays see.
    pub(super) reach: f32,
    /// Groups along an edge.
    pub(super) groups: usize,
    /// The transfer function.
    pub(super) table: &'g TransferTable,
    /// Sums of the table's kinks at the brick's smallest and largest value.
    pub(super) kinks: [[f32; 4]; 2],
    /// Parts that the way through a cell is cut into, at most.
    pub(super) parts: u32,
    /// Emission, relative to the table's, that weighs as much as the table's largest extinction.
    pub(super) darkening: f32,
}

/// Rays in a brick: where they are, and what they gather.
#[derive(Debug, Clone)]
pub(super) struct Packet {
    /// Where each ray enters, in dual cells from the brick's lowest: multiples of [`ORIGIN_STEP`],
    /// and what is left by their rounding.
    pub(super) origin: [[Row; 3]; 2],
    /// The direction of each ray, dual cells per unit of t, in which no component is above 1; and
    /// what is left of it by rounding to f32.
    pub(super) direction: [[Row; 3]; 2],
    /// What the first numbers of origin and direction have not, along axes along which a ray crosses no
    /// plane between constant cells: there it goes through the middle of its cell instead.
    pub(super) aside: [[Row; 3]; 2],
    /// Largest extinction · code length per unit of t.
    pub(super) thickness: Row,
    /// What emission may be off by over the way through a cell, per unit of t, where that takes
    /// only to cut it into parts.
    pub(super) allowed: Row,
    /// Optical depth from which on what lies behind may be left out.
    pub(super) fade: Row,
    /// t reached, and what is left of it by rounding.
    pub(super) t: [Row; 2],
    /// t where the ray leaves, and what is left of it by rounding.
    pub(super) end: [Row; 2],
    /// The dual cell reached.
    pub(super) cell: [Row; 3],
    /// Which lanes are still on their way; the others are left alone.
    pub(super) active: u32,
    /// Emission gathered, relative to the table's and per unit of t.
    pub(super) light: [Row; 3],
    /// Optical depth passed.
    pub(super) depth: Row,
    /// What rounding has left of light, where cells are constant (else 0), and of depth.
    pub(super) left: [Row; 4],
    /// What the march makes rays be off by, as [`crate::render::bounds::sums::Sums`] have it, per unit
    /// of t.
    pub(super) off: [Row; 3],
    /// What hidden levels make rays be off by, likewise.
    pub(super) levels: [Row; 3],
    /// What values that are not stored exactly make rays be off by, likewise.
    pub(super) stored: [Row; 3],
    /// The squares around rays: their farthest rays' displacement along each axis, cells, with
    /// [`SLACK`].
    pub(super) spread: [Row; 3],
    /// What of that does not cancel between opposite rays.
    pub(super) bend: [Row; 3],
    /// Twice half the squares' diagonal as an angle.
    pub(super) turn: Row,
    /// What other rays of the squares see differently, at most.
    pub(super) farthest: [Row; 3],
    /// What other rays of the squares see differently, on average but for what cancels.
    pub(super) uneven: [Row; 3],
    /// Parts of cells passed by all.
    pub(super) count: u64,
}

impl Packet {
    /// A packet without rays.
    pub(super) fn new() -> Self {
        Self {
            origin: [[Row::ZERO; 3]; 2],
            direction: [[Row::ZERO; 3]; 2],
            aside: [[Row::ZERO; 3]; 2],
            thickness: Row::ZERO,
            allowed: Row::ZERO,
            fade: Row::ZERO,
            t: [Row::ZERO; 2],
            end: [Row::ZERO; 2],
            cell: [Row::ZERO; 3],
            active: 0,
            light: [Row::ZERO; 3],
            depth: Row::ZERO,
            left: [Row::ZERO; 4],
            off: [Row::ZERO; 3],
            levels: [Row::ZERO; 3],
            stored: [Row::ZERO; 3],
            spread: [Row::ZERO; 3],
            bend: [Row::ZERO; 3],
            turn: Row::ZERO,
            farthest: [Row::ZERO; 3],
            uneven: [Row::ZERO; 3],
            count: 0,
        }
    }

    /// The dual cell that a lane has reached.
    pub(super) fn cell(&self, lane: usize) -> [i32; 3] {
        let [x, y, z] = &self.cell;
        [x, y, z].map(|row| row.0[lane % MOST_LANES] as i32)
    }

    /// The t that a lane has reached.
    pub(super) fn reached(&self, lane: usize) -> f64 {
        self.t.iter().map(|row| f64::from(row.0[lane % MOST_LANES])).sum()
    }

    /// Sets the sums to nothing.
    pub(super) fn clear_sums(&mut self) {
        self.light = [Row::ZERO; 3];
        self.depth = Row::ZERO;
        self.left = [Row::ZERO; 4];
        self.off = [Row::ZERO; 3];
        self.levels = [Row::ZERO; 3];
        self.stored = [Row::ZERO; 3];
        self.farthest = [Row::ZERO; 3];
        self.uneven = [Row::ZERO; 3];
    }

    /// Sets the sums of a lane to nothing.
    pub(super) fn clear_lane(&mut self, lane: usize) {
        let sums = self.light.iter_mut().chain(&mut self.off).chain(&mut self.levels);
        let sums = sums.chain(&mut self.stored).chain(&mut self.farthest).chain(&mut self.uneven);
        let sums = sums.chain(&mut self.left);
        for row in sums.chain([&mut self.depth]) {
            row.0[lane % MOST_LANES] = 0.0;
        }
    }
}

/// The march of a packet until each active ray has left the brick or faded, which are then active
/// no more, or has come to a cell that is not fit.
pub(super) struct March<'m> {
    /// The brick.
    pub(super) brick: &'m PacketBrick<'m>,
    /// The rays.
    pub(super) packet: &'m mut Packet,
    /// Whether it goes through cells beside borders of levels, and not through plain ones.
    pub(super) blended: bool,
}

impl Kernel for March<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let absorbs = self.brick.table.extinction > 0.0;
        if !self.brick.shades.is_empty() {
            return if absorbs {
                cells::march::<L, true>(lanes, self.brick, self.packet);
            } else {
                cells::march::<L, false>(lanes, self.brick, self.packet);
            };
        }
        use interpolated::march;
        match (absorbs, self.blended) {
            (true, true) => march::<L, true, true>(lanes, self.brick, self.packet),
            (true, false) => march::<L, true, false>(lanes, self.brick, self.packet),
            (false, true) => march::<L, false, true>(lanes, self.brick, self.packet),
            (false, false) => march::<L, false, false>(lanes, self.brick, self.packet),
        }
    }
}

/// Takes active lanes to their next cells. Returns those that are still on their way: neither out of
/// the brick nor behind a depth beyond `fade`.
#[inline(always)]
fn go_on<L: Lanes, const ABSORBS: bool>(
    l: L,
    walk: &mut Walk<L>,
    exit: &Exit<L>,
    active: L::Mask,
    depth: L::Float,
    fade: L::Float,
) -> L::Mask {
    let goes_on = walk.step(active, exit);
    if ABSORBS { l.and(goes_on, l.is_at_most(depth, fade)) } else { goes_on }
}

/// What emission and extinction are off by in a group, in active lanes.
#[inline(always)]
fn rates_at<L: Lanes>(l: L, rates: &[u32], group: L::Index, active: L::Mask) -> [L::Float; 2] {
    unpacked(l, l.gather_bits(rates, group), active)
}

/// Both halves of rates, in active lanes: those of others may be no numbers.
#[inline(always)]
fn unpacked<L: Lanes>(l: L, bits: L::Index, active: L::Mask) -> [L::Float; 2] {
    let zero = l.splat(0.0);
    [l.select(active, l.upper_half(bits), zero), l.select(active, l.lower_half(bits), zero)]
}

/// Adds what is off over `way`, of which `lit` is seen.
#[inline(always)]
fn add_off<L: Lanes, const ABSORBS: bool>(
    l: L,
    [emission, dimmed, extinction]: [L::Float; 3],
    rates: [L::Float; 2],
    lit: L::Float,
    way: L::Float,
) -> [L::Float; 3] {
    let emission = l.fma(rates[0], lit, emission);
    if !ABSORBS {
        return [emission, dimmed, extinction];
    }
    [emission, l.fma(rates[1], lit, dimmed), l.fma(rates[1], way, extinction)]
}
