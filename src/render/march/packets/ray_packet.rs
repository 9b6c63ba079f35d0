//! A packet on its way through a brick: rays board it, and get what it has gathered for them.

use super::cell_walk::CellWalk;
use super::lane_rays::{EnterBrick, LaneRays, split};
use super::{Accounts, Place, Rays, TileRay, lanes};
use crate::lanes::{MOST_LANES, Row, Width};
use crate::render::bounds::grade::MOST_PARTS;
use crate::render::bounds::ray_error::RayError;
use crate::render::bounds::sums::Sums;
use crate::render::bounds::touch::Spread;
use crate::render::march::absorb::Integrator;
use crate::render::march::beside::Visit;
use crate::render::march::blend::BlendRoom;
use crate::render::march::brick_account::BrickAccount;
use crate::render::march::linear::{DualCells, pass_dual_cell};
use crate::render::march::packet::{March, Packet, PacketBrick, SLACK};
use crate::render::march::ray::{Beam, leave, march, spread_of};
use crate::render::march::ray_state::RayState;
use crate::render::transfer::rounded::up;

/// What rounding of f32 may take off sums of errors: 2⁻²⁴ for each number added. A ray meets 97 dual
/// cells of a brick of 32 cells a side at most, each in 8 stretches beside a border of levels, and of a
/// stretch [`MOST_PARTS`] parts are added up.
const ROUNDED_UP: f64 = 1.0 + (97 * 8 + MOST_PARTS) as f64 * f32::EPSILON as f64;
/// What it may take off an optical depth, whose sum keeps what is lost.
const DEPTH_ROUNDED: f64 = 1.0 + 1e-5;

/// A packet and whose rays are in its lanes.
#[derive(Debug)]
pub(super) struct RayPacket {
    width: Width,
    packet: Packet,
    lane_rays: LaneRays,
    /// The squares that rays stand for, if they do, of all lanes.
    squares: Vec<LaneSquare>,
    /// Whether rays are marched in place of others.
    are_proxies: bool,
}

/// A square whose ray is in a lane: how far it is spread, and its account at the start.
#[derive(Debug)]
struct LaneSquare {
    beam: Beam,
    spread: Spread,
    before: RayError,
}

impl RayPacket {
    /// An empty packet of lanes of this kind.
    pub(super) fn new(width: Width) -> Self {
        Self {
            width,
            packet: Packet::new(),
            lane_rays: LaneRays::new(),
            squares: Vec::with_capacity(MOST_LANES),
            are_proxies: false,
        }
    }

    /// How many lanes there are.
    pub(super) fn lane_count(&self) -> usize {
        self.width.count()
    }

    /// Most heap bytes.
    pub(super) fn bytes() -> usize {
        MOST_LANES * size_of::<LaneSquare>()
    }

    /// Takes rays, as many as there are lanes at most, through the brick. Returns the number of
    /// stretches. With `all_plain` all cells may be passed as plain ones.
    pub(super) fn travel(
        &mut self,
        place: &Place<'_>,
        brick: &PacketBrick<'_>,
        all_plain: bool,
        rays: &[TileRay],
        accounts: Accounts<'_>,
        gathered: &mut Rays<'_>,
    ) -> u64 {
        let mut single = self.board(place, rays, accounts, gathered);
        let entered = self.packet.active;
        if all_plain && entered != 0 {
            self.width.run(March { brick, packet: &mut self.packet, blended: false });
        }
        let has_accounts = accounts.are_kept();
        while self.packet.active != 0 {
            for blended in [false, true] {
                self.go(brick, blended);
            }
            if self.are_proxies {
                self.give_up(brick, rays, gathered);
            }
            for lane in lanes(self.packet.active) {
                if brick.fit(self.packet.cell(lane)).is_none() {
                    let index = rays[lane].index;
                    self.settle(place, lane, index, has_accounts, gathered);
                    self.clear(place, lane, &gathered.states[index]);
                    single += self.pass_alone(place, brick, lane, index, has_accounts, gathered);
                }
            }
        }
        for lane in lanes(entered) {
            let index = rays[lane].index;
            self.settle(place, lane, index, has_accounts, gathered);
            if let Some(LaneSquare { beam, before, .. }) = self.squares.get(lane) {
                let (state, error) = (&mut gathered.states[index], &mut gathered.errors[index]);
                leave(Some(self.lane_rays.span(lane)), beam, state, error, before);
            }
        }
        self.packet.count + single
    }

    /// Takes in rays that meet the brick; those that may not go in packets are marched at once.
    /// Returns for how many stretches.
    fn board(
        &mut self,
        place: &Place<'_>,
        rays: &[TileRay],
        accounts: Accounts<'_>,
        gathered: &mut Rays<'_>,
    ) -> u64 {
        let Self { packet, lane_rays, squares, .. } = self;
        squares.clear();
        lane_rays.take(rays);
        let Place { region, range, shift, .. } = place;
        let (shift, count) = (*shift, rays.len());
        let met = self.width.run(EnterBrick { region, range, shift, lane_rays, packet, count });
        (packet.active, packet.count) = (met, 0);
        packet.clear_sums();
        let mut single = 0;
        self.are_proxies = matches!(accounts, Accounts::Proxies(_));
        for (lane, (tile_ray, beam)) in rays.iter().zip(accounts.squares()).enumerate() {
            single += self.take_square(place, lane, tile_ray, beam, gathered);
        }
        for lane in lanes(self.packet.active) {
            self.set_terms(place, lane, &gathered.states[rays[lane].index]);
        }
        single
    }

    /// Looks at what lies beside the ray of a square, and marches it at once if packets do not take
    /// such. Returns for how many stretches.
    fn take_square(
        &mut self,
        place: &Place<'_>,
        lane: usize,
        TileRay { index, ray }: &TileRay,
        beam: &Beam,
        gathered: &mut Rays<'_>,
    ) -> u64 {
        let span = (self.packet.active >> lane & 1 == 1).then(|| self.lane_rays.span(lane));
        let (state, error) = (&mut gathered.states[*index], &mut gathered.errors[*index]);
        let before = *error;
        let Place { passage, region, light, .. } = place;
        let spread = if self.are_proxies {
            spread_of(ray, region, span, beam)
        } else {
            Visit { passage, pieces: light.pieces, ray, region, beam, state, span }.arrive(error)
        };
        let is_wide = spread.cells.iter().any(|spread| *spread > 1.0 - f64::from(SLACK));
        let mut single = 0;
        if is_wide && self.are_proxies {
            error.farthest = Sums::ANYTHING;
            self.packet.active &= !(1 << lane);
        } else if is_wide && !place.takes_wide {
            *error = before;
            single = march(place.passage, ray, place.light, state, Some((error, beam)));
            self.packet.active &= !(1 << lane);
        } else if span.is_none() {
            leave(span, beam, state, error, &before);
        }
        for a in 0..3 {
            self.packet.spread[a].0[lane] = spread.cells[a] as f32 + SLACK;
            self.packet.bend[a].0[lane] = up(spread.bend[a]);
        }
        self.packet.turn.0[lane] = up(2.0 * spread.angle);
        self.squares.push(LaneSquare { beam: *beam, spread, before });
        single
    }

    /// Gives up proxies that have come to cells that are not fit for packets: the others for which
    /// they stand may be off by anything, since what those would find there is known for packets
    /// alone.
    fn give_up(&mut self, brick: &PacketBrick<'_>, rays: &[TileRay], gathered: &mut Rays<'_>) {
        for lane in lanes(self.packet.active) {
            if brick.fit(self.packet.cell(lane)).is_none() {
                gathered.errors[rays[lane].index].farthest = Sums::ANYTHING;
                self.packet.active &= !(1 << lane);
            }
        }
    }

    /// Sets what a lane may be off by, and where it may end.
    fn set_terms(&mut self, place: &Place<'_>, lane: usize, state: &RayState) {
        let length = self.lane_rays.length(lane) * self.lane_rays.unit(lane);
        let thickness = length * place.transfer.table.extinction;
        self.packet.thickness.0[lane] = thickness.min(f64::from(f32::MAX)) as f32;
        let seen = state.transmittance * length;
        let allowed = place.allowed / (seen * place.transfer.table.emission);
        self.packet.allowed.0[lane] = allowed.min(f64::from(f32::MAX)) as f32;
        self.packet.fade.0[lane] = fade(state, place, &self.lane_rays, lane);
    }

    /// Marches the rays that have come to plain cells, or to blended ones, as far as they go.
    fn go(&mut self, brick: &PacketBrick<'_>, blended: bool) {
        let all = self.packet.active;
        let ready = lanes(all)
            .filter(|lane| brick.fit(self.packet.cell(*lane)) == Some(blended))
            .fold(0, |ready, lane| ready | 1 << lane);
        if ready == 0 {
            return;
        }
        self.packet.active = ready;
        self.width.run(March { brick, packet: &mut self.packet, blended });
        self.packet.active |= all & !ready;
    }

    /// Gives a lane's sums to its ray.
    fn settle(
        &self,
        place: &Place<'_>,
        lane: usize,
        index: usize,
        has_account: bool,
        gathered: &mut Rays<'_>,
    ) {
        let Self { packet, lane_rays, .. } = self;
        let table = &place.transfer.table;
        let length = lane_rays.length(lane) * lane_rays.unit(lane);
        let state = &mut gathered.states[index];
        let seen = state.transmittance * length;
        let sum = |row: &Row| f64::from(row.0[lane]);
        if has_account {
            let error = &mut gathered.errors[index];
            let before = error.own_extinction();
            // What overflows f32 may come to no number.
            let times = |sum: f64, unit: f64| {
                let product = sum * unit * ROUNDED_UP;
                if product.is_nan() { f64::INFINITY } else { product }
            };
            let sums = |[emission, dimmed, extinction]: [f64; 3]| Sums {
                emission: times(emission, seen * table.emission),
                dimmed: times(dimmed, seen * table.extinction),
                extinction: times(extinction, length * table.extinction),
            };
            let march = sums(packet.off.each_ref().map(sum));
            error.causes.march = error.causes.march.plus(march);
            if place.passage.hides {
                error.causes.levels =
                    error.causes.levels.plus(sums(packet.levels.each_ref().map(sum)));
            }
            if !self.squares.is_empty() {
                error.farthest = error.farthest.plus(sums(packet.farthest.each_ref().map(sum)));
                error.uneven = error.uneven.plus(sums(packet.uneven.each_ref().map(sum)));
            }
            let of_stored = error.of_stored(place.passage.brick.relief.is_rounded);
            *of_stored = of_stored.plus(sums(packet.stored.each_ref().map(sum)));
            error.place_behind(state.radiance, before);
        }
        let [red, green, blue, depth] = packet.left.each_ref().map(sum);
        let [r, g, b] = packet.light.each_ref().map(sum);
        let light = [r + red, g + green, b + blue];
        state.gather(light.map(|light| light * seen * table.emission));
        state.absorb((sum(&packet.depth) + depth).max(0.0));
    }

    /// A lane whose sums were given to its ray begins anew.
    fn clear(&mut self, place: &Place<'_>, lane: usize, state: &RayState) {
        self.packet.fade.0[lane] = fade(state, place, &self.lane_rays, lane);
        self.packet.clear_lane(lane);
    }

    /// Takes a lane through cells that are not fit, up to one that is, or out of the brick.
    fn pass_alone(
        &mut self,
        place: &Place<'_>,
        brick: &PacketBrick<'_>,
        lane: usize,
        index: usize,
        accounts: bool,
        gathered: &mut Rays<'_>,
    ) -> u64 {
        let Place { passage, light, range, .. } = place;
        let (ray, span, unit) =
            (self.lane_rays.ray(lane), self.lane_rays.span(lane), self.lane_rays.unit(lane));
        let from = (span.0 + self.packet.reached(lane) * unit).min(span.1);
        let mut walk = CellWalk::new(&ray, range, self.packet.cell(lane), from, span.1);
        let relief = &passage.brick.relief;
        let (state, error) = (&mut gathered.states[index], &mut gathered.errors[index]);
        let spread = self.squares.get(lane).map_or_else(Spread::default, |square| square.spread);
        let mut account = accounts.then(|| BrickAccount::new(relief, error, passage.hides, spread));
        let mut integrator = Integrator::new(light.pieces, &light.ending, accounts, state);
        let cells = DualCells { brick: passage.brick, drawn: passage.drawn, range };
        let mut room = BlendRoom::default();
        let goes_on = loop {
            if integrator.is_faded() {
                break false;
            }
            let (step, has_next) = walk.step();
            if step.from < step.to {
                pass_dual_cell(cells, &ray, &step, &mut room, &mut integrator, &mut account);
            }
            if !has_next {
                break false;
            }
            if brick.fit(walk.cell).is_some() {
                break true;
            }
        };
        if let Some(account) = &mut account {
            account.close(&mut integrator);
        }
        let count = integrator.count;
        let reached = (walk.from - span.0) / unit;
        put(&mut self.packet.t, lane, split(reached));
        for a in 0..3 {
            self.packet.cell[a].0[lane] = walk.cell[a] as f32;
        }
        if !goes_on {
            self.packet.active &= !(1 << lane);
        }
        count
    }
}

fn put(rows: &mut [Row; 2], lane: usize, numbers: [f32; 2]) {
    for (row, number) in rows.iter_mut().zip(numbers) {
        row.0[lane] = number;
    }
}

/// Optical depth behind which the ray in a lane may end, whatever it has gathered.
fn fade(state: &RayState, place: &Place<'_>, lane_rays: &LaneRays, lane: usize) -> f32 {
    let ending = &place.light.ending;
    let least = ending.allowed / ending.brightest.max(1.0);
    let ratio = state.transmittance / least;
    // Where the brick is not as deep as that, how deep it would be need not be known.
    let (from, to) = lane_rays.span(lane);
    let deepest = place.most * (to - from) * lane_rays.length(lane) * DEPTH_ROUNDED;
    let halvings = (ratio.to_bits() >> 52) as f64 - 1023.0;
    if halvings * std::f64::consts::LN_2 >= deepest {
        return f32::MAX;
    }
    let depth = ratio.ln().max(0.0);
    // Rounding of f32 must not end a ray that then would go on.
    let depth = depth * DEPTH_ROUNDED + (DEPTH_ROUNDED - 1.0);
    if depth.is_nan() { f32::MAX } else { depth.min(f64::from(f32::MAX)) as f32 }
}
