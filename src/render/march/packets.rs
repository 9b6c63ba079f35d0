//! Rays of a tile through a brick: in packets where its cells are fit for that, one by one where
//! they are not.

mod cell_walk;
mod lane_rays;
mod ray_packet;

use self::ray_packet::RayPacket;
use super::linear::kind;
use super::packet::{PacketBrick, Parents};
use super::ray::{Beam, CellRange, DUAL_SHIFT, Light};
use super::ray_state::RayState;
use crate::cache::BrickShape;
use crate::lanes::{BYTE_PADDING, MOST_LANES, Width};
use crate::render::bounds::grade::{Care, Grades, PacketTransfer, UNFIT};
use crate::render::bounds::ray_error::RayError;
use crate::render::brick::interpolant::DrawnNeighbours;
use crate::render::brick::passage::{Passage, Region};
use crate::render::brick::relief::GROUP_EDGE;
use crate::render::brick::scaled::{MOST_PARENTS, ScaledBrick, dual};
use crate::render::camera::frame::LocalRay;

/// Bricks in which one cell could have a larger optical depth than this go ray by ray: f32 overflows.
const THICKEST: f64 = 1e30;

/// A tile's packet, and what it knows of the brick that it is in. The memory is reused from brick
/// to brick.
#[derive(Debug)]
pub(crate) struct Packets {
    tables: Tables,
    ray_packet: RayPacket,
}

/// What is known of the brick that was entered last.
#[derive(Debug, Default)]
struct Tables {
    grades: Grades,
    /// Kinds of dual cells, for [`PacketBrick::kinds`], where not all drawn neighbours are there.
    kinds: Vec<u8>,
    /// Sums of the table's kinks at the brick's smallest and largest value, for [`PacketBrick::kinks`].
    kinks: [[f32; 4]; 2],
}

/// A ray that is to be marched, and its number in its tile.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TileRay {
    /// The ray's number in its tile.
    pub(crate) index: usize,
    /// The ray in the brick's coordinates.
    pub(crate) ray: LocalRay,
}

/// Which accounts are kept of rays.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Accounts<'a> {
    None,
    /// Accounts of rays that stand for themselves, where depth is so much at σ = 0.
    Alone(f64),
    /// Accounts of the squares that rays stand for, one a ray.
    Squares(&'a [Beam]),
    /// Accounts of the squares of rays in whose place these are marched, one a ray, but for where
    /// those rays enter and leave the brick.
    Proxies(&'a [Beam]),
}

impl<'a> Accounts<'a> {
    fn are_kept(self) -> bool {
        !matches!(self, Self::None)
    }

    /// The squares that rays stand for.
    fn squares(self) -> &'a [Beam] {
        match self {
            Self::Squares(beams) | Self::Proxies(beams) => beams,
            Self::None | Self::Alone(_) => &[],
        }
    }

    /// What the ray of a number among these stands for.
    pub(crate) fn beam(self, n: usize) -> Option<Beam> {
        match self {
            Self::None => None,
            Self::Alone(depth) => Some(Beam::alone(depth)),
            Self::Squares(beams) | Self::Proxies(beams) => beams.get(n).copied(),
        }
    }

    /// The accounts of some of the rays, by their numbers among these.
    fn among(self, rays: std::ops::Range<usize>) -> Self {
        match self {
            Self::Squares(beams) => Self::Squares(&beams[rays]),
            Self::Proxies(beams) => Self::Proxies(&beams[rays]),
            other => other,
        }
    }
}

/// A tile's rays: what they have gathered, and what of it may be wrong.
pub(crate) struct Rays<'t> {
    /// What each ray has gathered, by its number in the tile.
    pub(crate) states: &'t mut [RayState],
    /// The account of each ray, by its number in the tile.
    pub(crate) errors: &'t mut [RayError],
}

/// A brick that packets march through.
struct Place<'p> {
    passage: &'p Passage<'p>,
    region: Region,
    /// The cells that rays walk through, dual ones or not, and where they begin.
    range: CellRange,
    shift: f64,
    light: &'p Light<'p>,
    transfer: &'p PacketTransfer,
    /// The brick's largest extinction, 1 / code length.
    most: f64,
    /// What a cell may be off by, in the picture's own unit.
    allowed: f64,
    /// Whether rays of squares wider than a cell may go in packets.
    takes_wide: bool,
}

impl Packets {
    /// Bytes at most, for bricks of `shape`: what is known of groups and dual cells, in vectors that
    /// have grown to at most twice what they hold.
    pub(crate) fn bytes(shape: BrickShape) -> u64 {
        let duals = shape.edge() + 1;
        let groups = duals.div_ceil(GROUP_EDGE);
        let known = (2 * size_of::<u32>() + 2 * size_of::<[f32; 8]>()) * (groups.pow(3) + 1)
            + duals.pow(3)
            + BYTE_PADDING;
        (2 * known + size_of::<Packets>() + RayPacket::bytes()) as u64
    }

    /// A packet of the widest lanes that this processor has.
    pub(crate) fn new() -> Self {
        Self::of(Width::best())
    }

    /// A packet of lanes of this kind.
    pub(super) fn of(width: Width) -> Self {
        Self { tables: Tables::default(), ray_packet: RayPacket::new(width) }
    }

    /// Looks at a brick whose cells measure `diagonal` code lengths from corner to corner, for rays
    /// that stand for squares if `has_squares`. Returns whether packets may march through it.
    pub(crate) fn enter(
        &mut self,
        passage: &Passage<'_>,
        light: &Light<'_>,
        diagonal: f64,
        care: Care,
        has_squares: bool,
    ) -> bool {
        let Passage { brick, drawn, .. } = *passage;
        let Tables { grades, kinds, kinks } = &mut self.tables;
        let Some(transfer) = &light.packets else { return false };
        if care == Care::Exact
            || brick.relief.is_empty()
            || transfer.table.extinction * diagonal > THICKEST
        {
            return false;
        }
        if brick.is_piecewise_constant() {
            // More care is for single rays: there is nothing that packets could do better.
            let is_fit = care == Care::Rough && !brick.shades.rows.is_empty();
            if is_fit {
                kinds.clear();
                *kinks = [[0.0; 4]; 2];
                grades.fill_cells(passage, has_squares, transfer);
            }
            return is_fit;
        }
        if brick.narrow[0].values.is_empty() {
            return false;
        }
        grades.fill(passage, diagonal, care, has_squares, transfer);
        kinds.clear();
        if grades.fit == 0 {
            return false;
        }
        let whole = &brick.relief.whole;
        *kinks = transfer.table.bends.between(whole.low, whole.high);
        if drawn != DrawnNeighbours::ALL {
            let count = brick.edge as i32 + 1;
            let all = (0..count).flat_map(|z| (0..count).map(move |y| (y, z)));
            let cells = all.flat_map(|(y, z)| (0..count).map(move |x| [x, y, z]));
            kinds.extend(cells.map(|cell| kind(brick, cell, drawn)));
            kinds.extend([dual::PLAIN; BYTE_PADDING]);
        }
        true
    }

    /// Marches rays through the brick that was entered last. Returns the number of stretches
    /// integrated.
    pub(crate) fn march(
        &mut self,
        passage: &Passage<'_>,
        light: &Light<'_>,
        rays: &[TileRay],
        accounts: Accounts<'_>,
        gathered: &mut Rays<'_>,
    ) -> u64 {
        let Some(transfer) = &light.packets else { return 0 };
        let Self { tables, ray_packet } = self;
        let grades = &mut tables.grades;
        let region = passage.inside();
        let shift = if passage.brick.is_piecewise_constant() { 0.0 } else { DUAL_SHIFT };
        let range = CellRange::of(&region, shift);
        let allowed = transfer.allowed.map_or(f64::INFINITY, |allowed| allowed * grades.share);
        let takes_wide = grades.is_fit_for_wide;
        let most = passage.brick.relief.whole.span.most.extinction;
        let place =
            Place { passage, region, range, shift, light, transfer, most, allowed, takes_wide };
        if matches!(accounts, Accounts::Proxies(_)) {
            grades.look_around(passage.brick.relief.side());
        }
        let brick = tables.brick(&place, accounts);
        let all_plain = brick.kinds.is_empty() && tables.grades.fit == brick.rates.len();
        let count = ray_packet.lane_count();
        let mut samples = 0;
        for first in (0..rays.len()).step_by(count) {
            let some = first..(first + count).min(rays.len());
            let (rays, accounts) = (&rays[some.clone()], accounts.among(some));
            samples += ray_packet.travel(&place, &brick, all_plain, rays, accounts, gathered);
        }
        samples
    }
}

impl Tables {
    /// What packets see of the brick at `place`, for rays with `accounts`.
    fn brick<'b>(&'b self, place: &Place<'b>, accounts: Accounts<'_>) -> PacketBrick<'b> {
        let Place { range, transfer, passage: Passage { brick, .. }, .. } = place;
        let ghosts = if brick.is_piecewise_constant() { 0 } else { 2 };
        let has_squares = !accounts.squares().is_empty();
        PacketBrick {
            values: &brick.narrow[0].values,
            side: brick.edge + ghosts,
            kinds: if self.kinds.is_empty() { &brick.duals } else { &self.kinds },
            corners: &brick.narrow[0].corners,
            parents: std::array::from_fn(|n| parents(brick, n + 1)),
            parent_count: brick.used.saturating_sub(1).min(MOST_PARENTS),
            lo: range.lo.map(|c| c as f32),
            hi: range.hi.map(|c| c as f32),
            shades: &brick.shades.rows,
            rates: &self.grades.rates,
            rows: &self.grades.rows,
            levels: &self.grades.levels,
            most_levels: self.grades.most_levels,
            are_proxies: matches!(accounts, Accounts::Proxies(_)),
            storages: &brick.shades.storages,
            storage: self.grades.storage,
            reliefs: if has_squares { &self.grades.reliefs } else { &[] },
            reach: self.grades.reach,
            groups: brick.relief.side(),
            table: &transfer.table,
            kinks: self.kinks,
            parts: self.grades.parts,
            darkening: transfer.darkening(),
        }
    }
}

/// The block `up` levels above the brick's own, or that one where there is none.
fn parents(brick: &ScaledBrick, up: usize) -> Parents<'_> {
    let up = if up < brick.used { up } else { 0 };
    let (block, narrow) = (&brick.blocks[up], &brick.narrow[up]);
    Parents {
        values: &narrow.values,
        side: block.side,
        corners: &narrow.corners,
        corner: block.corner.map(|c| c as f32),
        scale: block.scale as f32,
    }
}

/// The lanes in `mask`.
fn lanes(mask: u32) -> impl Iterator<Item = usize> {
    (0..MOST_LANES).filter(move |lane| mask >> lane & 1 == 1)
}

impl PacketBrick<'_> {
    /// Whether packets may pass a cell: as a plain one (`false`) or a blended one.
    fn fit(&self, cell: [i32; 3]) -> Option<bool> {
        let [x, y, z] = cell.map(|c| c as usize);
        let duals = self.side - 1;
        let kind = self.kinds.get((z * duals + y) * duals + x).copied().unwrap_or(dual::PLAIN);
        let [x, y, z] = [x, y, z].map(|c| c / GROUP_EDGE);
        let group = (z * self.groups + y) * self.groups + x;
        let is_fit = self.rates.get(group).is_some_and(|rate| *rate != UNFIT);
        match kind {
            dual::PLAIN if is_fit => Some(false),
            dual::BLENDED if is_fit => Some(true),
            _ => None,
        }
    }
}
