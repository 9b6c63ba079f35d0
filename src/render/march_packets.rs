//! Rays of a tile through a brick: in packets where its cells are fit for that, one by one where
//! they are not.

use super::absorb::Integrator;
use super::frame::LocalRay;
use super::grade::{Care, Grades, PacketTransfer, cell_roundings};
use super::interpolant::DrawnNeighbours;
use super::lanes::{BYTE_PADDING, MOST_LANES, Width};
use super::ledger::Ledger;
use super::march::{
    Beam, CellRange, DUAL_SHIFT, Light, Passage, Region, Spread, arrive, leave, march,
};
use super::march_linear::{kind, pass_dual_cell};
use super::packet::{Ground, MOST_PARENTS, March, Packet, Parents, SLACK, UNFIT};
use super::ray_error::{Change, RayError, Sums};
use super::ray_state::RayState;
use super::relief::GROUP_EDGE;
use super::scaled::{ScaledBrick, dual};
use super::walk::{Step, clip};
use crate::cache::BrickShape;

/// A cell of the transfer function's largest extinction with a depth beyond this is none for f32.
const THICKEST: f64 = 1e30;
/// What rounding of f64 does to places in a brick, cells, and more.
const PLACE_ROUNDING: f64 = 1e-12;
/// What rounding of f32 may take off sums of errors.
const ROUNDED_UP: f64 = 1.0 + 1e-5;

/// A tile's packet, and what it knows of the brick that it is in. The memory is reused from brick
/// to brick.
#[derive(Debug)]
pub(super) struct Packets {
    width: Width,
    grades: Grades,
    kinds: Vec<u8>,
    cabin: Cabin,
}

/// A packet and whose rays are in its lanes.
#[derive(Debug)]
struct Cabin {
    packet: Packet,
    riders: Vec<Rider>,
}

/// A ray in a lane.
#[derive(Debug, Clone, Copy)]
struct Rider {
    /// The ray's number in its tile.
    index: usize,
    ray: LocalRay,
    /// σ where it enters the brick's region and where it leaves.
    span: (f64, f64),
    /// σ per unit of t.
    unit: f64,
    /// t from which on the packet's sums are not the ray's yet.
    since: f64,
    /// The square that it stands for, how far that is spread, and its account at the start.
    beam: Option<Beam>,
    spread: Spread,
    before: RayError,
}

/// A ray that is to be marched: its number in its tile, and the square that it stands for if an
/// account is kept.
#[derive(Debug, Clone, Copy)]
pub(super) struct Passenger {
    pub(super) index: usize,
    pub(super) ray: LocalRay,
    pub(super) beam: Option<Beam>,
}

/// A tile's rays: what they have gathered, and what of it may be wrong.
pub(super) struct Rays<'t> {
    pub(super) states: &'t mut [RayState],
    pub(super) errors: &'t mut [RayError],
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
    /// What stored values change.
    storage: Change,
    /// What a cell may be off by, in the picture's own unit.
    allowed: f64,
    /// Whether rays stand for squares, and whether rays of squares wider than a cell may go in packets.
    has_squares: bool,
    takes_wide: bool,
}

impl Packets {
    /// Bytes at most: what is known of the groups and dual cells of the largest brick, in vectors
    /// that have grown to at most twice what they hold.
    pub(super) const BYTES: u64 = {
        let duals = BrickShape::MOST_CELLS + 1;
        let groups = duals.div_ceil(GROUP_EDGE);
        let known = (3 * size_of::<u32>() + size_of::<[f32; 8]>()) * (groups.pow(3) + 1)
            + duals.pow(3)
            + BYTE_PADDING;
        (2 * known + size_of::<Packet>() + 2 * MOST_LANES * size_of::<Rider>()) as u64
    };

    /// Of the widest kind that this processor has.
    pub(super) fn new() -> Self {
        Self::of(Width::best())
    }

    /// Of lanes of one kind.
    pub(super) fn of(width: Width) -> Self {
        Self {
            width,
            grades: Grades::default(),
            kinds: Vec::new(),
            cabin: Cabin { packet: Packet::new(), riders: Vec::with_capacity(MOST_LANES) },
        }
    }

    /// Lanes of a packet.
    pub(super) fn count(&self) -> usize {
        self.width.count()
    }

    /// Looks at a brick whose cells measure `diagonal` code lengths from corner to corner, for rays
    /// that stand for squares if `has_squares`. Returns whether packets may march through it.
    pub(super) fn enter(
        &mut self,
        passage: &Passage<'_>,
        light: &Light<'_>,
        (diagonal, care): (f64, Care),
        has_squares: bool,
    ) -> bool {
        let Passage { brick, drawn, hides, .. } = *passage;
        let Some(transfer) = &light.packets else { return false };
        if care == Care::Exact
            || brick.relief.is_empty()
            || transfer.table.extinction * diagonal > THICKEST
        {
            return false;
        }
        if brick.is_piecewise_constant() {
            // More care is for single rays: there is nothing that packets could do better.
            let is_fit = care == Care::Rough && !has_squares && !brick.shades.rows.is_empty();
            if is_fit {
                self.kinds.clear();
                self.grades.fill_cells((&brick.relief, hides), transfer);
            }
            return is_fit;
        }
        if brick.narrow[0].values.is_empty() {
            return false;
        }
        self.grades.fill((&brick.relief, hides), (diagonal, care), has_squares, transfer);
        self.kinds.clear();
        if self.grades.fit == 0 {
            return false;
        }
        if drawn != DrawnNeighbours::ALL {
            let count = brick.edge as i32 + 1;
            let all = (0..count).flat_map(|z| (0..count).map(move |y| (y, z)));
            let cells = all.flat_map(|(y, z)| (0..count).map(move |x| [x, y, z]));
            self.kinds.extend(cells.map(|cell| kind(brick, cell, drawn)));
            self.kinds.extend([dual::PLAIN; BYTE_PADDING]);
        }
        true
    }

    /// Marches rays, at most [`Self::count`], through the brick that was entered last. Returns the
    /// number of stretches integrated.
    pub(super) fn march(
        &mut self,
        passage: &Passage<'_>,
        light: &Light<'_>,
        rays: &[Passenger],
        film: &mut Rays<'_>,
    ) -> u64 {
        let Some(transfer) = &light.packets else { return 0 };
        let region = passage.inside();
        let are_constant = passage.brick.is_piecewise_constant();
        let shift = if are_constant { 0.0 } else { DUAL_SHIFT };
        let range = CellRange::of(&region, shift);
        let whole = &passage.brick.relief.whole;
        let storage = self.grades.storage;
        let allowed = transfer.allowed.map_or(f64::INFINITY, |allowed| allowed * self.grades.share);
        let takes_wide = self.grades.is_fit_for_wide;
        let has_squares = !self.grades.reliefs.is_empty();
        let place = Place {
            passage,
            region,
            range,
            shift,
            light,
            transfer,
            most: whole.span.most.extinction,
            storage,
            allowed,
            has_squares,
            takes_wide,
        };
        let cabin = &mut self.cabin;
        let mut single = cabin.board(&place, rays, film);
        let kinds = if self.kinds.is_empty() { &passage.brick.duals } else { &self.kinds };
        let ground = Ground {
            values: &passage.brick.narrow[0].values,
            side: passage.brick.edge + if are_constant { 0 } else { 2 },
            kinds,
            corners: &passage.brick.narrow[0].corners,
            parents: std::array::from_fn(|n| parents(passage.brick, n + 1)),
            parent_count: passage.brick.used.saturating_sub(1).min(MOST_PARENTS),
            lo: range.lo.map(|c| c as f32),
            hi: range.hi.map(|c| c as f32),
            shades: &passage.brick.shades.rows,
            roundings: cell_roundings(passage.brick.edge),
            rates: &self.grades.rates,
            levels: &self.grades.levels,
            storages: &self.grades.storages,
            reliefs: &self.grades.reliefs,
            reach: self.grades.reach,
            groups: passage.brick.relief.side(),
            table: &transfer.table,
            kinks: if are_constant {
                [[0.0; 4]; 2]
            } else {
                transfer.table.bends.between(whole.low, whole.high)
            },
            parts: self.grades.parts,
            darkening: transfer.darkening(),
        };
        while cabin.packet.active != 0 {
            for blended in [false, true] {
                cabin.go(&ground, self.width, blended);
            }
            for lane in lanes(cabin.packet.active) {
                if ground.fit(cabin.packet.cell(lane)).is_none() {
                    cabin.settle(&place, lane, film);
                    cabin.clear(&place, lane, film);
                    single += cabin.pass_alone(&place, &ground, lane, film);
                }
            }
        }
        for lane in 0..cabin.riders.len() {
            cabin.settle(&place, lane, film);
            cabin.alight(lane, film);
        }
        cabin.packet.count + single
    }
}

impl Cabin {
    /// Takes in rays that meet the brick; those that may not go in packets are marched at once.
    /// Returns for how many stretches.
    fn board(&mut self, place: &Place<'_>, rays: &[Passenger], film: &mut Rays<'_>) -> u64 {
        let packet = &mut self.packet;
        self.riders.clear();
        (packet.active, packet.count) = (0, 0);
        packet.clear_sums();
        let mut single = 0;
        for &Passenger { index, ray, beam } in rays {
            let span = clip(&ray, place.region.lo, place.region.hi);
            let (state, error) = (&mut film.states[index], &mut film.errors[index]);
            let before = *error;
            let mut spread = ([0.0; 3], 0.0);
            if let Some(beam) = &beam {
                let region = (&place.region, span);
                spread = arrive(place.passage, &ray, region, beam, (state, error));
                let is_wide = spread.0.iter().any(|spread| *spread > 1.0 - f64::from(SLACK));
                if is_wide && !place.takes_wide {
                    *error = before;
                    let account = Some((error, beam));
                    single += march(place.passage, &ray, place.light, state, account);
                    continue;
                }
                if span.is_none() {
                    leave(span, beam, state, (error, &before));
                }
            }
            let Some(span) = span else { continue };
            let lane = self.riders.len();
            let unit = ray.direction.abs().max_element().recip();
            set_off(packet, lane, place, (&ray, span, unit));
            let length = ray.length * unit;
            packet.thickness.0[lane] = (length * place.transfer.table.extinction) as f32;
            let seen = state.transmittance * length;
            let allowed = place.allowed / (seen * place.transfer.table.emission);
            packet.allowed.0[lane] = allowed.min(f64::from(f32::MAX)) as f32;
            packet.fade.0[lane] = fade(state, place, (&ray, span));
            packet.active |= 1 << lane;
            for a in 0..3 {
                packet.spread[a].0[lane] =
                    if beam.is_some() { spread.0[a] as f32 + SLACK } else { 0.0 };
            }
            packet.turn.0[lane] = (2.0 * spread.1) as f32;
            self.riders.push(Rider { index, ray, span, unit, since: 0.0, beam, spread, before });
        }
        single
    }

    /// A ray has left the brick.
    fn alight(&self, lane: usize, film: &mut Rays<'_>) {
        let Rider { index, span, beam, before, .. } = &self.riders[lane];
        if let Some(beam) = beam {
            let (state, error) = (&mut film.states[*index], &mut film.errors[*index]);
            leave(Some(*span), beam, state, (error, before));
        }
    }

    /// Marches the rays that have come to plain cells, or to blended ones, as far as they go.
    fn go(&mut self, ground: &Ground<'_>, width: Width, blended: bool) {
        let all = self.packet.active;
        if !ground.shades.is_empty() && all != 0 {
            // All cells are fit, and none is blended.
            return width.run(March { ground, packet: &mut self.packet, blended });
        }
        let ready = lanes(all)
            .filter(|lane| ground.fit(self.packet.cell(*lane)) == Some(blended))
            .fold(0, |ready, lane| ready | 1 << lane);
        if ready == 0 {
            return;
        }
        self.packet.active = ready;
        width.run(March { ground, packet: &mut self.packet, blended });
        self.packet.active |= all & !ready;
    }

    /// Gives a lane's sums to its ray.
    fn settle(&self, place: &Place<'_>, lane: usize, film: &mut Rays<'_>) {
        let (packet, rider) = (&self.packet, &self.riders[lane]);
        let table = &place.transfer.table;
        let length = rider.ray.length * rider.unit;
        let state = &mut film.states[rider.index];
        let seen = state.transmittance * length;
        let sum = |row: &super::lanes::Row| f64::from(row.0[lane]);
        let t = sum(&packet.t);
        if rider.beam.is_some() {
            let error = &mut film.errors[rider.index];
            let sums = |[emission, dimmed, extinction]: [f64; 3]| Sums {
                emission: emission * seen * table.emission * ROUNDED_UP,
                dimmed: dimmed * seen * table.extinction * ROUNDED_UP,
                extinction: extinction * length * table.extinction * ROUNDED_UP,
            };
            let march = sums(packet.off.each_ref().map(sum));
            error.march = error.march.plus(march);
            if place.passage.hides {
                error.levels = error.levels.plus(sums(packet.levels.each_ref().map(sum)));
            }
            if place.has_squares {
                error.farthest = error.farthest.plus(sums(packet.farthest.each_ref().map(sum)));
                error.uneven = error.uneven.plus(sums(packet.uneven.each_ref().map(sum)));
            }
            let way = (t - rider.since) * length * ROUNDED_UP;
            let lit = sum(&packet.lit) * seen * ROUNDED_UP;
            let stored = sums(packet.stored.each_ref().map(sum));
            error.storage = error.storage.plus(stored).plus(Sums::of(place.storage, way, lit));
        }
        let light = packet.light.each_ref().map(|row| sum(row) * seen * table.emission);
        state.gather(light);
        state.absorb(sum(&packet.depth).max(0.0));
    }

    /// A lane whose sums were given to its ray begins anew.
    fn clear(&mut self, place: &Place<'_>, lane: usize, film: &Rays<'_>) {
        let (packet, rider) = (&mut self.packet, &mut self.riders[lane]);
        let state = &film.states[rider.index];
        packet.fade.0[lane] = fade(state, place, (&rider.ray, rider.span));
        rider.since = f64::from(packet.t.0[lane]);
        packet.clear_lane(lane);
    }

    /// Takes a lane through cells that are not fit, up to one that is, or out of the brick.
    fn pass_alone(
        &mut self,
        place: &Place<'_>,
        ground: &Ground<'_>,
        lane: usize,
        film: &mut Rays<'_>,
    ) -> u64 {
        let Place { passage, light, range, .. } = place;
        let rider = self.riders[lane];
        let mut walk = CellWalk::new(&rider, range, &self.packet, lane);
        let relief = &passage.brick.relief;
        let state = &mut film.states[rider.index];
        let error = &mut film.errors[rider.index];
        let accounts = rider.beam.is_some();
        let mut ledger = accounts.then(|| Ledger::new(relief, error, passage.hides, rider.spread));
        let mut integrator = Integrator::new(light.pieces, &light.ending, accounts, state);
        let mut rungs = Vec::new();
        let goes_on = loop {
            if integrator.is_faded() {
                break false;
            }
            let (step, has_next) = walk.step();
            if step.from < step.to {
                let passage = (passage.brick, passage.drawn);
                pass_dual_cell(
                    passage,
                    &rider.ray,
                    &step,
                    &mut rungs,
                    &mut integrator,
                    &mut ledger,
                );
            }
            if !has_next {
                break false;
            }
            if ground.fit(walk.cell).is_some() {
                break true;
            }
        };
        if let Some(ledger) = &mut ledger {
            ledger.close(&mut integrator);
        }
        let count = integrator.count;
        let reached = (walk.from - rider.span.0) / rider.unit;
        self.riders[lane].since = reached;
        self.packet.t.0[lane] = reached as f32;
        for a in 0..3 {
            self.packet.cell[a].0[lane] = walk.cell[a] as f32;
        }
        if !goes_on {
            self.packet.active &= !(1 << lane);
        }
        count
    }
}

/// Sets a lane to where a ray comes into a brick, which it passes over `span` of σ, and to its
/// direction.
fn set_off(
    packet: &mut Packet,
    lane: usize,
    place: &Place<'_>,
    (ray, span, unit): (&LocalRay, (f64, f64), f64),
) {
    let [origin, end] =
        [span.0, span.1].map(|sigma| ray.origin + ray.direction * sigma + place.shift);
    let direction = ray.direction * unit;
    for a in 0..3 {
        let cell = (origin[a] as i32).clamp(place.range.lo[a], place.range.hi[a]);
        // Between two planes a ray through constant cells is as good as one in the middle.
        let stays = direction[a] == 0.0 || is_between_planes(origin[a], end[a]);
        let is_between = place.shift == 0.0 && stays;
        let middle = f64::from(cell) + 0.5;
        let (from, along) = if is_between { (middle, 0.0) } else { (origin[a], direction[a]) };
        packet.origin[a].0[lane] = from as f32;
        packet.direction[a].0[lane] = along as f32;
        packet.cell[a].0[lane] = cell as f32;
    }
    packet.t.0[lane] = 0.0;
    packet.end.0[lane] = ((span.1 - span.0) / unit) as f32;
}

/// Whether a ray that goes from one place to another along an axis crosses no plane, nor comes as
/// close to one as rounding.
fn is_between_planes(from: f64, to: f64) -> bool {
    (from.min(to) - PLACE_ROUNDING) as i32 == (from.max(to) + PLACE_ROUNDING) as i32
}

/// Optical depth behind which a ray may end that goes through `span` of a brick, whatever it has
/// gathered.
fn fade(state: &RayState, place: &Place<'_>, (ray, span): (&LocalRay, (f64, f64))) -> f32 {
    let ending = &place.light.ending;
    let least = ending.allowed / ending.brightest.max(1.0);
    let ratio = state.transmittance / least;
    // Where the brick is not as deep as that, how deep it would be need not be known.
    let deepest = place.most * (span.1 - span.0) * ray.length * ROUNDED_UP;
    let halvings = (ratio.to_bits() >> 52) as f64 - 1023.0;
    if halvings * std::f64::consts::LN_2 >= deepest {
        return f32::MAX;
    }
    let depth = ratio.ln().max(0.0);
    // Rounding of f32 must not end a ray that then would go on.
    let depth = depth * ROUNDED_UP + (ROUNDED_UP - 1.0);
    if depth.is_nan() { f32::MAX } else { depth.min(f64::from(f32::MAX)) as f32 }
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

impl Ground<'_> {
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

/// The walk of one ray from the dual cell on that its lane has reached.
struct CellWalk<'r> {
    rider: &'r LocalRay,
    range: &'r CellRange,
    cell: [i32; 3],
    from: f64,
    end: f64,
}

impl<'r> CellWalk<'r> {
    fn new(rider: &'r Rider, range: &'r CellRange, packet: &Packet, lane: usize) -> Self {
        let reached = f64::from(packet.t.0[lane]);
        Self {
            rider: &rider.ray,
            range,
            cell: packet.cell(lane),
            from: (rider.span.0 + reached * rider.unit).min(rider.span.1),
            end: rider.span.1,
        }
    }

    /// The way through the present cell, and whether there is a next one, which is gone to.
    fn step(&mut self) -> (Step, bool) {
        let (origin, direction) = (self.rider.origin.to_array(), self.rider.direction.to_array());
        let (mut to, mut axis) = (self.end, None);
        for a in 0..3 {
            let ahead = self.cell[a] + i32::from(direction[a] > 0.0);
            let sigma = (f64::from(ahead) - origin[a] - DUAL_SHIFT) / direction[a];
            // Along an axis without motion this is no number, or infinite.
            if direction[a] != 0.0 && sigma < to {
                (to, axis) = (sigma, Some(a));
            }
        }
        let step = Step { cell: self.cell, from: self.from, to: to.max(self.from) };
        self.from = step.to;
        let Some(a) = axis else { return (step, false) };
        let last = if direction[a] > 0.0 { self.range.hi[a] } else { self.range.lo[a] };
        let has_next = self.cell[a] != last;
        if has_next {
            self.cell[a] += if direction[a] > 0.0 { 1 } else { -1 };
        }
        (step, has_next)
    }
}
