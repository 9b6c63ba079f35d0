//! A batch of rays that walk the tree together, and what they have gathered.

mod faces;
mod lattice;
mod open;
mod proxies;
mod room;

use std::iter::from_fn;
use std::ops::Range;

use glam::{DVec2, DVec3};

use self::open::{Clearness, Open};
use self::proxies::{Lending, NEAREST, Proxies, first_apart};
use self::room::Spent;
use super::waiting::Found;
use crate::cache::BrickShape;
use crate::lanes::MOST_LANES;
use crate::paging::Request;
use crate::render::bounds::grade::Care;
use crate::render::bounds::ray_error::RayError;
use crate::render::brick::interpolant::DrawnNeighbours;
use crate::render::brick::margin::{Part, parts};
use crate::render::brick::passage::Passage;
use crate::render::brick::scaled::ScaledBrick;
use crate::render::brick::thin::{FEWEST_RAYS, Thinner};
use crate::render::camera::frame::{Footprint, Frame, LocalRay};
use crate::render::camera::pixel_order::PixelOrder;
use crate::render::camera::rays::{BATCH_RAYS, PixelGrid, PixelRect, Square, TILE_SIDE};
use crate::render::camera::view::Aim;
use crate::render::march::packets::{Accounts, Packets, Rays, TileRay};
use crate::render::march::ray::{Beam, Light, march};
use crate::render::march::ray_state::RayState;
use crate::render::plan::tree_walk::Step;
use crate::render::transfer::change::Change;
use crate::render::transfer::pieces::PieceList;
use crate::scene::Interpolation;

/// How many rays are looked at one by one for the brightest that still needs light.
const FEW_RAYS: usize = 64;
/// Groups of a brick's cells that are looked at for packets in the time that a single ray takes.
const GROUPS_PER_RAY: usize = 16;
/// Rays that set off together: whole packets.
const MOST_ENTERING: usize = 2 * MOST_LANES;

/// Up to [`BATCH_RAYS`] rays through pixels of one rectangle. The memory is reused from batch to
/// batch.
#[derive(Debug)]
pub(crate) struct RayBatch {
    rect: PixelRect,
    /// Whether rays stand for their squares, not for themselves.
    has_area: bool,
    /// The squares, pixel by pixel.
    squares: Vec<Square>,
    /// Their rays.
    aims: Vec<Aim>,
    /// A pixel's width and height on the image plane.
    pixel: DVec2,
    states: Vec<RayState>,
    errors: Vec<RayError>,
    /// Which squares need more: one bit each.
    alive: Vec<u64>,
    /// Which squares have got from others what the brick in hand adds: one bit each.
    served: Vec<u64>,
    /// Where each pixel's squares begin, and one more.
    starts: Vec<u16>,
    packets: Packets,
    /// Rays for the next packets, and the squares that they stand for, if they do.
    entering: Vec<TileRay>,
    beams: Vec<Beam>,
    thinner: Thinner,
    proxies: Proxies,
    spent: Spent,
    clearness: Clearness,
}

/// How the rays of a step are marched.
#[derive(Clone, Copy)]
pub(crate) struct Settings<'s> {
    /// What they march by.
    pub(crate) light: &'s Light<'s>,
    /// The picture's pixels.
    pub(crate) grid: &'s PixelGrid,
    /// Whether accounts are kept of what may be wrong with them.
    pub(crate) accounts: bool,
    /// How carefully packets march.
    pub(crate) care: Care,
    /// How far they may be off, where bricks may be drawn in fewer cells and others may be marched in
    /// their place.
    pub(crate) thinning: Option<Thinning<'s>>,
}

/// How far light may be off by bricks that are drawn in fewer cells than they have, and by rays that
/// are marched in place of others.
#[derive(Clone, Copy)]
pub(crate) struct Thinning<'t> {
    /// The transfer function by which bricks are surveyed.
    pub(crate) pieces: &'t PieceList,
    /// What a ray may be off by in a brick that is drawn in fewer cells, in the picture's own unit.
    pub(crate) limit: f64,
    /// What a ray may be off by in all bricks through which others are marched in its place, in the
    /// picture's own unit.
    pub(crate) room: f64,
    /// Light that is expected from behind.
    pub(crate) behind: f64,
}

impl RayBatch {
    /// Most bytes that a tile takes, for bricks of `shape` with `blocks` blocks.
    pub(crate) fn bytes(shape: BrickShape, blocks: usize, interpolation: Interpolation) -> u64 {
        let of_ray = size_of::<Square>()
            + size_of::<Aim>()
            + size_of::<RayState>()
            + size_of::<RayError>()
            + 4;
        let of_entering = size_of::<TileRay>() + size_of::<Beam>();
        // Constant cells are neither thinned nor seen by proxies.
        let of_linear = match interpolation {
            Interpolation::Linear => {
                (Proxies::bytes() + Spent::BYTES + Clearness::BYTES) as u64
                    + Thinner::bytes(shape, blocks)
            }
            Interpolation::Cell => 0,
        };
        let of_all = (BATCH_RAYS * of_ray + MOST_ENTERING * of_entering) as u64;
        of_all + Packets::bytes(shape) + of_linear
    }

    /// A tile without rays, with room for thinner ones of so many bricks.
    pub(crate) fn new(thinned: usize) -> Self {
        Self {
            rect: PixelRect::NONE,
            has_area: false,
            squares: Vec::with_capacity(BATCH_RAYS),
            aims: Vec::with_capacity(BATCH_RAYS),
            pixel: DVec2::ZERO,
            states: Vec::with_capacity(BATCH_RAYS),
            errors: Vec::with_capacity(BATCH_RAYS),
            alive: Vec::with_capacity(BATCH_RAYS.div_ceil(64)),
            served: Vec::with_capacity(BATCH_RAYS.div_ceil(64)),
            starts: Vec::with_capacity(BATCH_RAYS + 1),
            packets: Packets::new(),
            entering: Vec::with_capacity(MOST_ENTERING),
            beams: Vec::with_capacity(MOST_ENTERING),
            thinner: Thinner::new(thinned),
            proxies: Proxies::default(),
            spent: Spent::new(),
            clearness: Clearness::new(),
        }
    }

    /// Sets the rays of `squares` off, which lie in pixels of `rect` and are in their order. With
    /// `has_area` they stand for these squares, else for themselves.
    pub(crate) fn start(
        &mut self,
        grid: &PixelGrid,
        rect: PixelRect,
        squares: &[Square],
        has_area: bool,
    ) {
        (self.rect, self.has_area) = (rect, has_area);
        self.squares.clear();
        self.squares.extend_from_slice(squares);
        self.aims.clear();
        self.pixel = grid.pixel_size();
        self.aims.extend(squares.iter().map(|square| grid.aim(square)));
        self.states.clear();
        self.states.resize(squares.len(), RayState::default());
        self.errors.clear();
        self.errors.resize(squares.len(), RayError::default());
        self.alive.clear();
        self.alive.resize(squares.len().div_ceil(64), u64::MAX);
        if let (Some(last), rest @ 1..) = (self.alive.last_mut(), squares.len() % 64) {
            *last = (1 << rest) - 1;
        }
        self.served.clear();
        self.served.resize(self.alive.len(), 0);
        self.starts.clear();
        for (index, square) in squares.iter().enumerate() {
            let first = u16::try_from(index).unwrap_or(u16::MAX);
            while self.starts.len() <= usize::from(square.pixel) {
                self.starts.push(first);
            }
        }
        let end = u16::try_from(squares.len()).unwrap_or(u16::MAX);
        self.starts.resize(rect.count() + 1, end);
        self.clearness.forget();
        self.spent.forget();
        self.proxies.forget();
    }

    /// Half the width on the image plane of what a ray stands for.
    fn half(&self, index: usize) -> DVec2 {
        if self.has_area { self.pixel * self.squares[index].half() } else { DVec2::ZERO }
    }

    /// The pixels of `rect`, none of which is before the tile's first, counted from that one.
    fn within(&self, rect: &PixelRect) -> PixelRect {
        if rect.is_empty() {
            return PixelRect::NONE;
        }
        let from_first = |x: [u32; 2]| std::array::from_fn(|a| x[a] - self.rect.lo[a]);
        PixelRect { lo: from_first(rect.lo), hi: from_first(rect.hi) }
    }

    /// The numbers, strip by strip, of the pixels in all blocks that have some in `rect`, which lies
    /// within the tile.
    fn strips(&self, rect: &PixelRect) -> impl Iterator<Item = Range<usize>> + use<> {
        let within = self.within(rect);
        PixelOrder::of(&self.rect).strips(within.columns(), within.rows())
    }

    /// The squares of pixels with such numbers.
    fn squares_of(&self, pixels: &Range<usize>) -> Range<usize> {
        usize::from(self.starts[pixels.start])..usize::from(self.starts[pixels.end])
    }

    /// The first square of `range` that needs more, of the brick in hand as well.
    fn next_alive(&self, range: Range<usize>) -> Option<usize> {
        let mut at = range.start;
        while at < range.end {
            let rest = (self.alive[at / 64] & !self.served[at / 64]) >> (at % 64);
            if rest != 0 {
                let found = at + rest.trailing_zeros() as usize;
                return (found < range.end).then_some(found);
            }
            at = (at / 64 + 1) * 64;
        }
        None
    }

    /// The squares in `rect`, which lies within the tile, whose rays need more.
    fn open(&self, rect: PixelRect) -> impl Iterator<Item = usize> + '_ {
        let near = self.strips(&rect).flat_map(move |strip| {
            let range = self.squares_of(&strip);
            let mut at = range.start;
            from_fn(move || {
                let found = self.next_alive(at..range.end)?;
                at = found + 1;
                Some(found)
            })
        });
        near.filter(move |index| rect.holds(self.squares[*index].centre))
    }

    /// The largest transmittance of rays in `rect` that meet what has this footprint and need more,
    /// or 1 where there are many; 0 where there is none. `rect` lies within the tile.
    pub(crate) fn needs(&self, rect: &PixelRect, footprint: &Footprint) -> f64 {
        let meeting = self
            .open(*rect)
            .filter(|index| meets(footprint, self.aims[*index].plane, self.half(*index)));
        let mut largest = 0.0_f64;
        for (seen, index) in meeting.enumerate() {
            if seen == FEW_RAYS {
                return 1.0;
            }
            largest = largest.max(self.states[index].transmittance);
        }
        largest
    }

    /// Marches the rays of a step through its brick, in fewer cells if these are off by little.
    /// Returns the number of samples.
    pub(crate) fn draw(
        &mut self,
        step: &Step,
        brick: &ScaledBrick,
        drawn: DrawnNeighbours,
        settings: Settings<'_>,
    ) -> u64 {
        let passage = Passage { brick, region: step.region, drawn, hides: step.hides };
        // Where rays stand for squares, these take what there is of a tolerance.
        let may_thin = !self.has_area && !brick.is_piecewise_constant();
        let thinning = settings.thinning.filter(|_| may_thin);
        let settings = Settings { thinning, ..settings };
        let open = thinning.map_or(Open::default(), |_| self.open_rays(&step.pixels));
        let mut thinner = std::mem::take(&mut self.thinner);
        let thin = thinning.and_then(|thinning| thin(&mut thinner, step, &passage, thinning, open));
        let samples = if let Some(part) = thin {
            self.draw_part(&part, &step.pixels, settings, open)
        } else {
            let parts = parts(&passage, &step.frame, &step.footprint);
            let draw = |part: &Part<'_>| self.draw_part(part, &step.pixels, settings, open);
            parts.iter().map(draw).sum()
        };
        self.thinner = thinner;
        samples
    }

    /// Whether so few rays in `rect` need more that looking at a brick for packets takes longer
    /// than marching these one by one.
    fn are_few(&self, rect: &PixelRect, brick: &ScaledBrick) -> bool {
        let few = brick.relief.count() / GROUPS_PER_RAY;
        self.open(*rect).nth(few).is_none()
    }

    /// Marches the rays in `pixels` through a part of a brick; `open` are those that need more of it.
    fn draw_part(
        &mut self,
        part: &Part<'_>,
        pixels: &PixelRect,
        Settings { light, grid, accounts, care, thinning }: Settings<'_>,
        open: Open,
    ) -> u64 {
        let Part { passage, frame, footprint } = part;
        let diagonal = frame.cell_width.length();
        let has_squares = accounts && self.has_area;
        let lending = thinning.and_then(|thinning| {
            let allowed = self.spent.left_for_some(&self.within(pixels), thinning.room);
            let apart = first_apart(part, pixels, grid, thinning.behind, allowed, open);
            (apart >= NEAREST).then_some(Lending { apart, thinning, open })
        });
        let in_packets = !self.are_few(pixels, passage.brick)
            && self.packets.enter(passage, light, diagonal, care, has_squares || lending.is_some());
        let mut samples = 0;
        if let Some(lending) = lending.filter(|_| in_packets) {
            samples += self.draw_by_proxies(part, pixels, light, grid, lending);
        }
        if self.served != self.alive {
            self.settle(light);
        }
        let covered = grid.covered(footprint);
        let alone = if accounts { Accounts::Alone(frame.depth) } else { Accounts::None };
        for strip in self.strips(pixels) {
            let range = self.squares_of(&strip);
            let mut at = range.start;
            while let Some(index) = self.next_alive(at..range.end) {
                at = index + 1;
                let (aim, half) = (&self.aims[index], self.half(index));
                if !meets(footprint, aim.plane, half) {
                    continue;
                }
                let ray = frame.ray_of(aim);
                if has_squares {
                    let share = covered / grid.weight(&self.squares[index]);
                    self.beams.push(beam(frame, &ray, half, share));
                }
                self.entering.push(TileRay { index, ray });
                if !in_packets || self.entering.len() == MOST_ENTERING {
                    samples += self.depart(passage, light, alone, in_packets);
                }
            }
        }
        samples += self.depart(passage, light, alone, in_packets);
        self.served.fill(0);
        samples
    }

    /// Marches the rays that wait, with accounts as `alone` says if they do not stand for squares.
    fn depart(
        &mut self,
        passage: &Passage<'_>,
        light: &Light<'_>,
        alone: Accounts<'_>,
        in_packets: bool,
    ) -> u64 {
        let accounts = if self.beams.is_empty() { alone } else { Accounts::Squares(&self.beams) };
        let mut samples = 0;
        if in_packets {
            let mut gathered = Rays { states: &mut self.states, errors: &mut self.errors };
            samples += self.packets.march(passage, light, &self.entering, accounts, &mut gathered);
        }
        for (n, TileRay { index, ray }) in self.entering.drain(..).enumerate() {
            let state = &mut self.states[index];
            if !in_packets {
                let beam = accounts.beam(n);
                let account = beam.as_ref().map(|beam| (&mut self.errors[index], beam));
                samples += march(passage, &ray, light, state, account);
            }
            if state.is_done(&light.ending) {
                self.alive[index / 64] &= !(1 << (index % 64));
            }
        }
        self.beams.clear();
        samples
    }

    /// Each square with what its ray has gathered (R, G, B, A) and how far that may be off, with what
    /// was left out `unseen`.
    pub(crate) fn outcome<'t>(
        &'t mut self,
        light: &'t Light<'_>,
        unseen: f64,
    ) -> impl Iterator<Item = Found> + 't {
        self.settle(light);
        let rays = self.squares.iter().zip(&self.states).zip(&self.errors);
        rays.map(move |((square, state), error)| {
            let [r, g, b] = state.radiance;
            let ending = &light.ending;
            // What lies behind may be opaque even where nothing shines.
            let rest = if state.is_done(ending) { ending.brightest.max(1.0) } else { 0.0 };
            let mut shares = error.shares(state.radiance, state.opacity(), ending.brightest, rest);
            shares.storage += unseen;
            let value = [r, g, b, state.opacity()];
            Found { square: *square, value, shares: shares.into(), uneven: None }
        })
    }
}

/// What a passage draws in fewer cells, if that pays for its rays and is close enough.
fn thin<'t>(
    thinner: &'t mut Thinner,
    step: &Step,
    passage: &Passage<'t>,
    Thinning { pieces, limit, behind, .. }: Thinning<'_>,
    Open { count, transmittance }: Open,
) -> Option<Part<'t>> {
    if passage.hides || count < FEWEST_RAYS {
        return None;
    }
    let crossing = step.frame.crossing(&step.footprint, passage.brick.edge as f64);
    let fits = |change: Change| change.light(behind) * crossing * transmittance <= limit;
    let (brick, halvings) = thinner.thin(step.request.key(), passage.brick, pieces, fits)?;
    let part = Part { passage: *passage, frame: step.frame, footprint: step.footprint };
    let mut part = (0..halvings).fold(part, |part, _| part.wider(brick));
    // The finer cells.
    part.passage.hides = true;
    Some(part)
}

/// Whether rays of the square at `plane` can meet what has this footprint.
pub(crate) fn meets(footprint: &Footprint, plane: DVec2, half: DVec2) -> bool {
    let (lo, hi) = (plane - half, plane + half);
    hi.x >= footprint.plane_lo.x
        && lo.x <= footprint.plane_hi.x
        && hi.y >= footprint.plane_lo.y
        && lo.y <= footprint.plane_hi.y
}

/// The square of half width `half` around `ray` as a brick sees it. In a perspective view the
/// distance from the eye is what a square's rays have in common, so they are displaced by the
/// change of the unit direction.
pub(crate) fn beam(frame: &Frame, ray: &LocalRay, half: DVec2, covered: f64) -> Beam {
    let width = frame.cell_width;
    let direction = ray.direction * width / ray.length;
    let across = |axis: DVec3| axis - direction * direction.dot(axis);
    let spread = across(frame.basis.right).abs() * half.x + across(frame.basis.up).abs() * half.y;
    let angle = if frame.is_perspective { half.length() / ray.length } else { 0.0 };
    // Directions bend a little more than their first derivative says: along themselves by 1 − cos, and
    // across by 1 + 2·angle.
    let bend = ray.direction.abs() * (0.5 * angle * angle);
    let spread = (spread / width + 2.0 * bend) * (1.0 + 2.0 * angle);
    Beam {
        spread: spread.to_array(),
        bend: bend.to_array(),
        angle,
        advance: ((direction.abs() + angle) * width).to_array(),
        depth: frame.depth,
        covered,
    }
}

#[cfg(test)]
#[path = "ray_batch_tests.rs"]
mod tests;
