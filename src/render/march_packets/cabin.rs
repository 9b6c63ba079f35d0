//! A packet on its way through a brick: rays board it, and get what it has gathered for them.

use super::cell_walk::CellWalk;
use super::{Passenger, Place, Rays, lanes};
use crate::render::absorb::Integrator;
use crate::render::frame::LocalRay;
use crate::render::lanes::{Row, Width};
use crate::render::ledger::Ledger;
use crate::render::march::{Beam, Spread, arrive, leave, march};
use crate::render::march_linear::pass_dual_cell;
use crate::render::packet::{Ground, March, ORIGIN_STEP, Packet, SLACK};
use crate::render::ray_error::{RayError, Sums};
use crate::render::ray_state::RayState;
use crate::render::walk::clip;

/// What rounding of f64 does to places in a brick, cells, and more.
const PLACE_ROUNDING: f64 = 1e-12;
/// What rounding of f32 may take off sums of errors.
const ROUNDED_UP: f64 = 1.0 + 1e-5;

/// A packet and whose rays are in its lanes.
#[derive(Debug)]
pub(super) struct Cabin {
    pub(super) packet: Packet,
    pub(super) riders: Vec<Rider>,
}

/// A ray in a lane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rider {
    /// The ray's number in its tile.
    index: usize,
    pub(super) ray: LocalRay,
    /// σ where it enters the brick's region and where it leaves.
    pub(super) span: (f64, f64),
    /// σ per unit of t.
    pub(super) unit: f64,
    /// Whether it has an account; the square that it stands for, how far that is spread, and the
    /// account at the start.
    has_account: bool,
    spread: Spread,
    square: Option<(Beam, RayError)>,
}

impl Cabin {
    /// Takes rays, as many as there are lanes at most, through the brick. Returns the number of
    /// stretches. With `all_plain` all cells may be passed as plain ones.
    pub(super) fn travel(
        &mut self,
        place: &Place<'_>,
        (ground, width, all_plain): (&Ground<'_>, Width, bool),
        rays: &[Passenger],
        film: &mut Rays<'_>,
    ) -> u64 {
        let mut single = self.board(place, rays, film);
        if all_plain && self.packet.active != 0 {
            width.run(March { ground, packet: &mut self.packet, blended: false });
        }
        while self.packet.active != 0 {
            for blended in [false, true] {
                self.go(ground, width, blended);
            }
            for lane in lanes(self.packet.active) {
                if ground.fit(self.packet.cell(lane)).is_none() {
                    self.settle(place, lane, film);
                    self.clear(place, lane, film);
                    single += self.pass_alone(place, ground, lane, film);
                }
            }
        }
        for lane in 0..self.riders.len() {
            self.settle(place, lane, film);
            self.alight(lane, film);
        }
        self.packet.count + single
    }

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
            let has_account = beam.is_some();
            let mut spread = ([0.0; 3], 0.0);
            let square = beam.filter(Beam::is_square).map(|beam| (beam, *error));
            if let Some((beam, before)) = &square {
                let region = (&place.region, span);
                spread = arrive(place.passage, &ray, region, beam, (state, error));
                let is_wide = spread.0.iter().any(|spread| *spread > 1.0 - f64::from(SLACK));
                if is_wide && !place.takes_wide {
                    *error = *before;
                    let account = Some((error, beam));
                    single += march(place.passage, &ray, place.light, state, account);
                    continue;
                }
                if span.is_none() {
                    leave(span, beam, state, (error, before));
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
                    if has_account { spread.0[a] as f32 + SLACK } else { 0.0 };
            }
            packet.turn.0[lane] = (2.0 * spread.1) as f32;
            self.riders.push(Rider { index, ray, span, unit, has_account, spread, square });
        }
        single
    }

    /// A ray has left the brick.
    fn alight(&self, lane: usize, film: &mut Rays<'_>) {
        let Rider { index, span, square, .. } = &self.riders[lane];
        if let Some((beam, before)) = square {
            let (state, error) = (&mut film.states[*index], &mut film.errors[*index]);
            leave(Some(*span), beam, state, (error, before));
        }
    }

    /// Marches the rays that have come to plain cells, or to blended ones, as far as they go.
    fn go(&mut self, ground: &Ground<'_>, width: Width, blended: bool) {
        let all = self.packet.active;
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
        let sum = |row: &Row| f64::from(row.0[lane]);
        if rider.has_account {
            let error = &mut film.errors[rider.index];
            let before = error.own_extinction();
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
            error.storage = error.storage.plus(sums(packet.stored.each_ref().map(sum)));
            error.place_behind(state.radiance, before);
        }
        let light = packet.light.each_ref().map(|row| sum(row) * seen * table.emission);
        state.gather(light);
        state.absorb(sum(&packet.depth).max(0.0));
    }

    /// A lane whose sums were given to its ray begins anew.
    fn clear(&mut self, place: &Place<'_>, lane: usize, film: &Rays<'_>) {
        let (packet, rider) = (&mut self.packet, &self.riders[lane]);
        let state = &film.states[rider.index];
        packet.fade.0[lane] = fade(state, place, (&rider.ray, rider.span));
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
        let accounts = rider.has_account;
        let mut ledger = accounts.then(|| Ledger::new(relief, error, passage.hides, rider.spread));
        let mut integrator = Integrator::new(light.pieces, &light.ending, accounts, state);
        let mut rungs = Vec::new();
        let goes_on = loop {
            if integrator.is_faded() {
                break false;
            }
            let (step, has_next) = walk.step();
            if step.from < step.to {
                let passage = (passage.brick, passage.drawn, range);
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
        let coarse = rounded(from);
        let (origin, direction) = ([coarse, from - coarse].map(|x| x as f32), split(along));
        for n in 0..2 {
            packet.origin[n][a].0[lane] = origin[n];
            packet.direction[n][a].0[lane] = direction[n];
        }
        packet.cell[a].0[lane] = cell as f32;
    }
    put(&mut packet.t, lane, [0.0; 2]);
    put(&mut packet.end, lane, split((span.1 - span.0) / unit));
}

/// The nearest multiple of [`ORIGIN_STEP`] to a number much smaller than 2⁵¹ of these.
fn rounded(x: f64) -> f64 {
    // Sums are whole multiples of it there, in one instruction that all processors have.
    const LARGE: f64 = ORIGIN_STEP * (3_i64 << 51) as f64;
    (x + LARGE) - LARGE
}

/// A number as the sum of two.
fn split(x: f64) -> [f32; 2] {
    let coarse = x as f32;
    [coarse, (x - f64::from(coarse)) as f32]
}

fn put(rows: &mut [Row; 2], lane: usize, numbers: [f32; 2]) {
    for (row, number) in rows.iter_mut().zip(numbers) {
        row.0[lane] = number;
    }
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
