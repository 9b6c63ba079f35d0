//! Rays that are marched through a brick in place of others between them.
//!
//! Where a brick's cells are far wider than pixels, neighbouring rays see nearly the same of it. Then
//! only rays at the corners of a square lattice on the image plane, *proxies*, are marched through
//! it, and rays between them take bilinear means of what the four around them gather, each behind
//! what it has itself met in front. A proxy stands for the square of all that may take from it, and
//! its account says how far any of these may differ from it, and how much of that is not linear in
//! their displacement (`render/march/packet/square.rs`; `docs/ACCURACY.md`, "Between proxies"). A mean of
//! pictures is off by no more than the mean of what these are off by, so the largest of four
//! accounts holds for it. Blocks of a lattice whose accounts say too much are tried with a finer
//! one, at last ray by ray. Where brick after brick all rays of a tile take from the tile's corners,
//! these gather on, and rays take what comes of it in the end.

use glam::DVec2;

use super::faces::at_faces;
use super::lattice::Lattice;
use super::*;
use crate::render::bounds::proxy_error::ProxyError;
use crate::render::bounds::sums::Sums;
use crate::render::camera::view::Basis;

/// Rays from which on proxies are tried.
const FEWEST: usize = 256;
/// Proxies are at first this many times as far apart as the steepest slopes in the brick allow:
/// along most rays there are others.
const OPTIMISM: f64 = 2.0;
/// Proxies are never closer than this, pixels: closer ones take as long as the rays themselves.
pub(super) const NEAREST: u32 = 4;
/// The proxies of the next lattice are this many times as close.
const FINER: u32 = 4;
/// Proxies are no farther apart than this, cells: accounts of rays that are more than a cell apart
/// say little.
const WIDEST: f64 = 0.9;
/// Rays do not wait longer for what the tile's corners have gathered than until so little comes
/// through, or until extinction may differ by so much along them.
const CLEAR: f64 = 0.9;
const ALIKE: f64 = 0.05;
/// Proxies are at most this many pixels apart.
const FARTHEST: f64 = TILE_SIDE as f64;

/// What a proxy has gathered, with a transmittance of 1 in front of the brick.
#[derive(Debug, Clone, Copy, Default)]
struct ProxyResult {
    gathered: Gathered,
    account: ProxyError,
    is_wanted: bool,
    /// Whether it needs no more, and may have ended in the brick.
    is_done: bool,
}

/// Light (R, G, B), and the shares of that from behind that come through and do not.
type Gathered = [f64; 5];
const THROUGH: usize = 3;

/// Corners of a block.
const CORNERS: usize = 4;

fn between(a: Gathered, b: Gathered, u: f64) -> Gathered {
    std::array::from_fn(|n| a[n] + (b[n] - a[n]) * u)
}

/// The proxies of a tile in one brick. The memory is reused from brick to brick.
#[derive(Debug, Default)]
pub(super) struct Proxies {
    states: Vec<RayState>,
    errors: Vec<RayError>,
    /// Row by row.
    results: Vec<ProxyResult>,
    /// The blocks with rays that need more.
    blocks: Vec<[u32; 2]>,
    /// What the tile's four corners have gathered since rays last took something; else none.
    kept: Vec<ProxyResult>,
}

impl Proxies {
    /// Corners of the finest lattice.
    const RESULTS: usize = ((TILE_SIDE / NEAREST) as usize + 1).pow(2);

    /// Most heap bytes.
    pub(super) fn bytes() -> usize {
        Self::RESULTS * (size_of::<ProxyResult>() + size_of::<[u32; 2]>())
            + CORNERS * size_of::<ProxyResult>()
            + MOST_ENTERING * (size_of::<RayState>() + size_of::<RayError>())
    }

    /// Takes the memory, once.
    fn reserve(&mut self) {
        let Self { states, errors, results, blocks, kept } = self;
        kept.reserve_exact(CORNERS.saturating_sub(kept.len()));
        states.reserve_exact(MOST_ENTERING.saturating_sub(states.len()));
        errors.reserve_exact(MOST_ENTERING.saturating_sub(errors.len()));
        results.reserve_exact(Self::RESULTS.saturating_sub(results.len()));
        blocks.reserve_exact(Self::RESULTS.saturating_sub(blocks.len()));
    }

    /// Forgets what corners have gathered for other rays.
    pub(super) fn forget(&mut self) {
        self.kept.clear();
    }

    /// How far a block's rays may be off.
    fn account(&self, corners: [usize; 4]) -> ProxyError {
        let [a, b, c, d] = corners.map(|corner| &self.results[corner].account);
        a.max(b).max(c).max(d)
    }

    /// What rays at both ends of a block's row gather, which is `v` of its edge below its upper one.
    fn row(&self, corners: [usize; 4], v: f64) -> [Gathered; 2] {
        let [a, b, c, d] = corners.map(|corner| self.results[corner].gathered);
        [between(a, c, v), between(b, d, v)]
    }
}

/// Rays that may take from proxies.
#[derive(Clone, Copy)]
pub(super) struct Lending<'t> {
    /// How many pixels apart proxies are at first.
    pub(super) apart: u32,
    /// How far the rays may be off.
    pub(super) thinning: Thinning<'t>,
    /// The rays that need more of the brick.
    pub(super) open: Open,
}

/// The largest power of two that is not above `x`; 0 below 1.
fn floor_to_power(x: f64) -> u32 {
    if x >= 1.0 { 1 << (x.min(FARTHEST) as u32).ilog2() } else { 0 }
}

/// How many pixels apart proxies for rays in `pixels` are at first, of which some may be off by
/// `allowed` in the brick, with so much light `behind`; less than [`NEAREST`] where there are none.
pub(super) fn first_apart(
    Part { passage, frame, footprint }: &Part<'_>,
    pixels: &PixelRect,
    grid: &PixelGrid,
    behind: f64,
    allowed: f64,
    open: Open,
) -> u32 {
    if passage.brick.relief.is_empty() || open.count < FEWEST {
        return 0;
    }
    let middle: [f64; 2] = std::array::from_fn(|a| 0.5 * f64::from(pixels.lo[a] + pixels.hi[a]));
    let ray = frame.ray(grid.plane_at(middle));
    let depth = if frame.is_perspective { footprint.depth_hi } else { 1.0 };
    let spread = beam(frame, &ray, grid.pixel_size(), 1.0).spread.map(|spread| spread * depth);
    let widest = spread.iter().copied().fold(0.0, f64::max);
    let edge = passage.brick.edge as f64;
    let crossing = frame.crossing(footprint, edge);
    let whole = &passage.brick.relief.whole;
    let over = |slopes: [f64; 3]| (0..3).map(|a| slopes[a] * spread[a]).sum::<f64>();
    let uneven = over(passage.brick.relief.most_uneven());
    let rim = widest * crossing / edge;
    // What proxies a pixel from each other are off by, and what of that is left where all that is
    // linear cancels, which grows with the square of their distance.
    let change = whole.span.slope.times(over(whole.slope));
    let first = change.times(crossing).plus(whole.span.most.times(2.0 * rim));
    let second = whole.span.slope.times(uneven * widest * crossing).plus(change.times(2.0 * rim));
    let allowed = allowed / open.transmittance;
    let apart = (allowed / first.light(behind)).max((allowed / second.light(behind)).sqrt());
    floor_to_power((OPTIMISM * apart).min(WIDEST / widest))
}

impl RayBatch {
    /// Marches proxies through a part of a brick that packets may march through. Rays that need not be
    /// marched are marked as served. Returns the number of samples.
    pub(super) fn draw_by_proxies(
        &mut self,
        part: &Part<'_>,
        pixels: &PixelRect,
        light: &Light<'_>,
        grid: &PixelGrid,
        Lending { mut apart, thinning, mut open }: Lending<'_>,
    ) -> u64 {
        self.proxies.reserve();
        let mut samples = 0;
        while apart >= NEAREST && open.count >= FEWEST {
            let lattice = Lattice::over(&self.rect, pixels, apart);
            self.choose(lattice, pixels);
            samples += self.march_proxies(part, light, grid, lattice, open.transmittance);
            let served = self.lend(lattice, pixels, light, thinning, open.transmittance);
            open.count = open.count.saturating_sub(served);
            // Most of what fails does so at the brick's edges, which fewer rays of finer lattices are near.
            apart = if apart > NEAREST { (apart / FINER).max(NEAREST) } else { 0 };
        }
        samples
    }

    /// Finds the blocks with rays in `pixels` that need more, and the corners of these.
    fn choose(&mut self, lattice: Lattice, pixels: &PixelRect) {
        let mut results = std::mem::take(&mut self.proxies.results);
        results.clear();
        results.resize(lattice.results(), ProxyResult::default());
        self.proxies.blocks.clear();
        for block in lattice.blocks() {
            let rect = lattice.pixels(block).intersection(pixels);
            if self.open(rect).next().is_some() {
                self.proxies.blocks.push(block);
                for corner in lattice.corners(block) {
                    results[corner].is_wanted = true;
                }
            }
        }
        self.proxies.results = results;
    }

    fn march_proxies(
        &mut self,
        Part { passage, frame, .. }: &Part<'_>,
        light: &Light<'_>,
        grid: &PixelGrid,
        lattice: Lattice,
        transmittance: f64,
    ) -> u64 {
        let half: DVec2 = grid.pixel_size() * f64::from(lattice.apart);
        let (mut samples, mut next) = (0, 0);
        while next < self.proxies.results.len() {
            let first = next;
            while next < self.proxies.results.len() && self.entering.len() < MOST_ENTERING {
                if self.proxies.results[next].is_wanted {
                    let ray = frame.ray(grid.plane_at(lattice.place(next)));
                    self.beams.push(beam_of_proxy(frame, &ray, half));
                    self.entering.push(TileRay { index: self.entering.len(), ray });
                }
                next += 1;
            }
            let Proxies { states, errors, results, .. } = &mut self.proxies;
            states.clear();
            states.resize(self.entering.len(), RayState::behind(transmittance));
            errors.clear();
            errors.resize(self.entering.len(), RayError::default());
            let accounts = Accounts::Proxies(&self.beams);
            let mut gathered = Rays { states, errors };
            samples += self.packets.march(passage, light, &self.entering, accounts, &mut gathered);
            let wanted = results[first..next].iter_mut().filter(|result| result.is_wanted);
            let rays = self.entering.iter().zip(&self.beams);
            for (result, ((state, error), (TileRay { ray, .. }, beam))) in
                wanted.zip(states.iter().zip(errors.iter_mut()).zip(rays))
            {
                let ends = [transmittance, state.transmittance];
                let [apart, bent] = at_faces(passage, ray, beam, ends);
                error.farthest = error.farthest.plus(apart);
                error.uneven = error.uneven.plus(bent);
                *result = ProxyResult::of(state, error, transmittance);
                result.is_done = state.is_done(&light.ending);
                result.stretch(frame, ray, half);
            }
            self.entering.clear();
            self.beams.clear();
        }
        samples
    }

    /// Gives rays in blocks whose accounts allow it what their proxies have gathered. Returns how many
    /// these are.
    fn lend(
        &mut self,
        lattice: Lattice,
        pixels: &PixelRect,
        light: &Light<'_>,
        Thinning { room, behind, .. }: Thinning<'_>,
        transmittance: f64,
    ) -> usize {
        let mut served = 0;
        let is_whole = lattice.apart == TILE_SIDE && *pixels == self.rect;
        if !is_whole {
            self.settle(light);
        }
        for n in 0..self.proxies.blocks.len() {
            let block = self.proxies.blocks[n];
            let corners = lattice.corners(block);
            let mut account = self.proxies.account(corners);
            account.cancel();
            let off = account.apart.light(behind) * transmittance;
            // Rays that take from some which have ended early, and do not end themselves, would not know
            // what they miss.
            let done =
                corners.iter().filter(|corner| self.proxies.results[**corner].is_done).count();
            let rect = lattice.pixels(block);
            let within = self.within(&rect);
            let is_close = off <= self.spent.left_for_all(&within, room);
            if is_whole && is_close && done == 0 {
                self.spent.add(&within, off);
                self.keep(corners, light);
                return self.states.len();
            }
            if is_whole {
                self.settle(light);
            }
            if is_close && (done == 0 || done == corners.len()) {
                self.spent.add(&within, off);
                served += self.lend_block(rect, pixels, corners, &account, light);
            }
        }
        served
    }

    /// All rays of the tile will take what its corners have gathered in this brick.
    fn keep(&mut self, corners: [usize; CORNERS], light: &Light<'_>) {
        let Proxies { kept, results, .. } = &mut self.proxies;
        if kept.is_empty() {
            kept.extend(corners.map(|corner| results[corner]));
        } else {
            for (result, corner) in kept.iter_mut().zip(corners) {
                *result = result.then(&results[corner]);
            }
        }
        let is_clear = |result: &ProxyResult| {
            result.gathered[THROUGH] >= CLEAR && result.account.apart.extinction <= ALIKE
        };
        if !kept.iter().all(is_clear) {
            self.settle(light);
        }
        self.served.copy_from_slice(&self.alive);
    }

    /// Gives all rays what the tile's corners have gathered for them. None is served of the brick in
    /// hand.
    pub(super) fn settle(&mut self, light: &Light<'_>) {
        if self.proxies.kept.is_empty() {
            return;
        }
        let Proxies { kept, results, .. } = &mut self.proxies;
        std::mem::swap(kept, results);
        let rect = self.rect;
        let lattice = Lattice::over(&rect, &rect, TILE_SIDE);
        let (corners, block) = (lattice.corners([0; 2]), lattice.pixels([0; 2]));
        let mut account = self.proxies.account(corners);
        account.cancel();
        self.lend_block(block, &rect, corners, &account, light);
        let Proxies { kept, results, .. } = &mut self.proxies;
        std::mem::swap(kept, results);
        kept.clear();
        self.served.fill(0);
    }

    fn lend_block(
        &mut self,
        block: PixelRect,
        pixels: &PixelRect,
        corners: [usize; CORNERS],
        account: &ProxyError,
        light: &Light<'_>,
    ) -> usize {
        let mut served = 0;
        let part = block.intersection(pixels);
        let width = f64::from(block.hi[0] - block.lo[0]);
        let (mut ends, mut at_v) = ([Gathered::default(); 2], f64::NAN);
        for strip in self.strips(&part) {
            let range = self.squares_of(&strip);
            let mut at = range.start;
            while let Some(index) = self.next_alive(at..range.end) {
                at = index + 1;
                let place = self.squares[index].place();
                if !part.holds(place) {
                    continue;
                }
                let [u, v] = std::array::from_fn(|a| (place[a] - f64::from(block.lo[a])) / width);
                if v != at_v {
                    (ends, at_v) = (self.proxies.row(corners, v), v);
                }
                let state = &mut self.states[index];
                self.errors[index].take_from_proxies(account, state.transmittance, state.radiance);
                state.take(between(ends[0], ends[1], u));
                self.served[index / 64] |= 1 << (index % 64);
                served += 1;
                if state.is_done(&light.ending) {
                    self.alive[index / 64] &= !(1 << (index % 64));
                }
            }
        }
        served
    }
}

/// The square of half width `half` around a proxy. Rays are compared at equal depths along the view,
/// not at equal distances from the eye: there their places are linear in those on the image plane.
fn beam_of_proxy(frame: &Frame, ray: &LocalRay, half: DVec2) -> Beam {
    let Basis { right, up, .. } = frame.basis;
    let spread = (right.abs() * half.x + up.abs() * half.y) / frame.cell_width;
    Beam { spread: spread.to_array(), bend: [0.0; 3], angle: 0.0, ..beam(frame, ray, half, 1.0) }
}

impl ProxyResult {
    fn of(state: &RayState, error: &RayError, transmittance: f64) -> Self {
        let seen = transmittance.recip();
        let absorbed = (transmittance - state.transmittance) + state.transmittance_excess;
        let [r, g, b] = state.radiance;
        let gathered = [r, g, b, state.transmittance, absorbed].map(|x| x * seen);
        let account = error.of_proxy(transmittance);
        Self { gathered, account, is_wanted: true, is_done: false }
    }

    /// What it gathers in this brick and in one behind it.
    fn then(&self, behind: &Self) -> Self {
        let through = self.gathered[THROUGH];
        let mut gathered: Gathered =
            std::array::from_fn(|n| self.gathered[n] + behind.gathered[n] * through);
        gathered[THROUGH] = through * behind.gathered[THROUGH];
        Self { gathered, account: self.account.then(&behind.account, through), ..*behind }
    }

    /// Adds what rays of the proxy's square are off by because they are longer or shorter between
    /// equal depths, and what of that is not linear in their displacement. |forward + aside| has
    /// slopes of at most |aside| over itself, and second derivatives of at most 1 over itself.
    fn stretch(&mut self, frame: &Frame, ray: &LocalRay, half: DVec2) {
        if !frame.is_perspective {
            return;
        }
        let aside = (ray.length * ray.length - 1.0).max(0.0).sqrt() + half.length();
        let [slope, bend] = [aside, half.length()].map(|x| x * half.length() / ray.length.powi(2));
        let [r, g, b, through, absorbed] = self.gathered;
        let all = Sums {
            emission: r.max(g).max(b),
            dimmed: absorbed,
            extinction: -through.max(f64::MIN_POSITIVE).ln(),
        };
        let ProxyError { apart, bent, .. } = &mut self.account;
        *bent = bent.plus(all.times(bend)).plus(apart.times(slope));
        *apart = apart.plus(all.times(slope + bend));
    }
}

#[cfg(test)]
#[path = "proxies_tests.rs"]
mod tests;
