//! The march of several rays at once through one brick, in f32.
//!
//! Each ray walks from dual cell to dual cell. Within one, the interpolant at two Gauss–Legendre
//! nodes of each of a few equal parts gives emission and extinction by table; the optical depth
//! up to a node is that of extinction linear between the nodes. A cell beside a border of levels
//! is cut where the weight of its level bends ([`super::blended`]). What that may be off by is graded
//! per group of cells ([`super::grade`]); rays stop before cells that are not fit for it. All
//! numbers are the brick's own, near 1: lengths in cells, light relative to the transfer
//! function's largest.
//!
//! No closures here, nor what takes them: they are functions of their own, compiled without the
//! lanes' instructions.
#![allow(clippy::needless_range_loop)]

use super::blended::{Bends, MOST_PARENTS, Parents, Part, is_crooked};
use super::lanes::{Kernel, Lanes, MOST_LANES, Row};
use super::relief::GROUP_EDGE;
use super::scaled::dual;
use super::transfer_table::{Bends as TransferBends, TransferTable};

/// The rate of a group that packets leave to the march of single rays.
pub(super) const UNFIT: u32 = u32::MAX;
/// Gauss–Legendre nodes on [0, 1]: ½ ∓ 1/√12.
const NODES: [f32; 2] = [0.211_324_87, 0.788_675_13];
/// √3 / 12: what extinction's slope between the nodes adds to the depth at either.
const SLOPE_DEPTH: f32 = 0.144_337_57;
/// Depths from which on no f32 shows light.
const DARK: f32 = 80.0;

/// What packets see of a brick.
pub(super) struct Ground<'g> {
    /// Mapped values of the brick's block, x fastest, ghosts included, and cells along its edge.
    pub(super) values: &'g [f32],
    pub(super) side: usize,
    /// What [`dual`] kind each dual cell is, (side − 1)³ and padding for lanes; empty where all
    /// are plain.
    pub(super) kinds: &'g [u8],
    /// Which corners of each dual cell exist, likewise.
    pub(super) corners: &'g [u8],
    /// The blocks that the level is blended with, the first ones.
    pub(super) parents: [Parents<'g>; MOST_PARENTS],
    pub(super) parent_count: usize,
    /// Lowest and highest dual cell that is drawn.
    pub(super) lo: [f32; 3],
    pub(super) hi: [f32; 3],
    /// For each group of cells what emission (upper half of the bits, relative to the table's) and
    /// extinction (lower half) may be off by; [`UNFIT`] where that is too much.
    pub(super) rates: &'g [u32],
    /// The same in cells beside borders of levels.
    pub(super) blended_rates: &'g [u32],
    /// The same of what lies beneath the brick; empty where nothing does.
    pub(super) levels: &'g [u32],
    /// Groups along an edge.
    pub(super) groups: usize,
    pub(super) table: &'g TransferTable,
    /// Sums of the table's kinks at the brick's smallest and largest value.
    pub(super) kinks: [[f32; 4]; 2],
    /// Parts that the way through a cell is cut into.
    pub(super) parts: u32,
}

/// Rays in a brick: where they are, and what they gather.
#[derive(Debug, Clone)]
pub(super) struct Packet {
    /// Where each ray enters, in dual cells from the brick's lowest, and its direction per unit
    /// of t, in which no component is above 1.
    pub(super) origin: [Row; 3],
    pub(super) direction: [Row; 3],
    /// Largest extinction · code length per unit of t.
    pub(super) thickness: Row,
    /// t reached, and t where the ray leaves.
    pub(super) t: Row,
    pub(super) end: Row,
    /// The dual cell reached.
    pub(super) cell: [Row; 3],
    /// Which lanes are still on their way; the others are left alone.
    pub(super) active: u32,
    /// Emission gathered, relative to the table's and per unit of t.
    pub(super) light: [Row; 3],
    /// Optical depth passed.
    pub(super) depth: Row,
    /// ∫ T dt, and what is off as [`super::ray_error::Sums`] have it, per unit of t: by the
    /// march, and by levels.
    pub(super) lit: Row,
    pub(super) off: [Row; 3],
    pub(super) levels: [Row; 3],
    /// Cells passed by all.
    pub(super) count: u64,
}

impl Packet {
    pub(super) fn new() -> Self {
        Self {
            origin: [Row::ZERO; 3],
            direction: [Row::ZERO; 3],
            thickness: Row::ZERO,
            t: Row::ZERO,
            end: Row::ZERO,
            cell: [Row::ZERO; 3],
            active: 0,
            light: [Row::ZERO; 3],
            depth: Row::ZERO,
            lit: Row::ZERO,
            off: [Row::ZERO; 3],
            levels: [Row::ZERO; 3],
            count: 0,
        }
    }

    /// The dual cell that a lane has reached.
    pub(super) fn cell(&self, lane: usize) -> [i32; 3] {
        let [x, y, z] = &self.cell;
        [x, y, z].map(|row| row.0[lane % MOST_LANES] as i32)
    }

    /// Sets the sums to nothing.
    pub(super) fn clear_sums(&mut self) {
        self.light = [Row::ZERO; 3];
        self.depth = Row::ZERO;
        self.lit = Row::ZERO;
        self.off = [Row::ZERO; 3];
        self.levels = [Row::ZERO; 3];
    }

    /// A lane's sums are nothing again.
    pub(super) fn clear_lane(&mut self, lane: usize) {
        let sums = self.light.iter_mut().chain(&mut self.off).chain(&mut self.levels);
        for row in sums.chain([&mut self.depth, &mut self.lit]) {
            row.0[lane % MOST_LANES] = 0.0;
        }
    }
}

/// The march of a packet until each active ray has left the brick, which are then active no more,
/// or has come to a cell that is not fit.
pub(super) struct March<'m> {
    pub(super) ground: &'m Ground<'m>,
    pub(super) packet: &'m mut Packet,
    /// Whether it goes through cells beside borders of levels, and not through plain ones.
    pub(super) blended: bool,
}

impl Kernel for March<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let absorbs = self.ground.table.extinction > 0.0;
        match (absorbs, self.blended) {
            (true, true) => march::<L, true, true>(lanes, self.ground, self.packet),
            (true, false) => march::<L, true, false>(lanes, self.ground, self.packet),
            (false, true) => march::<L, false, true>(lanes, self.ground, self.packet),
            (false, false) => march::<L, false, false>(lanes, self.ground, self.packet),
        }
    }
}

#[inline(always)]
fn march<L: Lanes, const ABSORBS: bool, const BLENDED: bool>(
    l: L,
    ground: &Ground<'_>,
    packet: &mut Packet,
) {
    let mut walk = Walk::new(l, ground, packet);
    let bends = Bends::new(l, walk.direction);
    let rates = if BLENDED { ground.blended_rates } else { ground.rates };
    let mut sums = Sums::load(l, packet);
    let mut active = l.mask(packet.active);
    let mut stopped = l.mask(0);
    let mut count = 0;
    let side = l.splat(ground.side as f32);
    let zero = l.splat(0.0);
    loop {
        let group = walk.group(ground.groups);
        let bits = l.gather_bits(rates, group);
        let mut unfit = l.is_index(bits, UNFIT);
        let duals = walk.index(l.splat((ground.side - 1) as f32));
        if !ground.kinds.is_empty() {
            let kind = l.gather_bytes(ground.kinds, duals);
            let expected = if BLENDED { dual::BLENDED } else { dual::PLAIN };
            let fit = l.without(l.is_index(kind, u32::from(expected)), unfit);
            unfit = l.without(l.mask(!0), fit);
        }
        stopped = l.mask(l.bits(stopped) | l.bits(l.and(active, unfit)));
        active = l.without(active, unfit);
        if l.bits(active) == 0 {
            break;
        }
        count += u64::from(l.bits(active).count_ones());
        let cube = Cube::new(l, (ground.values, ground.side), walk.index(side));
        let (next, axes) = walk.exit();
        let way = l.select(active, l.sub(next, walk.t), zero);
        let way = l.max(way, zero);
        // The rates of lanes that are not active may be no numbers.
        let emission_off = l.select(active, l.upper_half(bits), zero);
        let extinction_off = l.select(active, l.lower_half(bits), zero);
        let before = sums.lit;
        if BLENDED {
            let mut from = walk.t;
            let inside = walk.within();
            let exists = l.gather_bytes(ground.corners, duals);
            let crooked = l.and(active, is_crooked(l, exists));
            let mut ahead = active;
            while l.bits(ahead) != 0 {
                let to = bends.next(l, inside, [from, next], crooked);
                let way = l.max(l.select(ahead, l.sub(to, from), zero), zero);
                let middle = l.fma(way, l.splat(0.5), from);
                let place = walk.place(inside, middle);
                let part = Part::new(l, ground, (&walk.cell, exists), place);
                let shape = (&cube, Some(&part));
                sums.pass::<ABSORBS>(l, ground, shape, &walk, (from, way), extinction_off);
                ahead = l.and(ahead, is_less(l, to, next));
                from = l.select(ahead, to, from);
            }
        } else {
            let shape = (&cube, None);
            sums.pass::<ABSORBS>(l, ground, shape, &walk, (walk.t, way), extinction_off);
        }
        let lit = l.sub(sums.lit, before);
        sums.off = add_off::<L, ABSORBS>(l, sums.off, [emission_off, extinction_off], lit, way);
        if !ground.levels.is_empty() {
            let bits = l.gather_bits(ground.levels, group);
            let emission_off = l.select(active, l.upper_half(bits), zero);
            let extinction_off = l.select(active, l.lower_half(bits), zero);
            let rates = [emission_off, extinction_off];
            sums.levels = add_off::<L, ABSORBS>(l, sums.levels, rates, lit, way);
        }
        walk.t = l.select(active, next, walk.t);
        active = l.and(active, is_less(l, next, walk.end));
        active = walk.step(active, axes);
    }
    sums.store(l, packet);
    walk.store(packet);
    packet.active = l.bits(stopped);
    packet.count += count;
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

/// The walk from cell to cell; every plane's t is computed anew, so that nothing drifts.
struct Walk<L: Lanes> {
    l: L,
    origin: [L::Float; 3],
    direction: [L::Float; 3],
    inverse: [L::Float; 3],
    /// 1 where the plane ahead of a cell is its upper one, and ±1 as the next cell's number is
    /// larger or smaller.
    ahead: [L::Float; 3],
    sign: [L::Float; 3],
    lo: [L::Float; 3],
    hi: [L::Float; 3],
    cell: [L::Float; 3],
    t: L::Float,
    end: L::Float,
}

/// Along an axis on which a ray moves less than this it meets no plane.
const LEAST_MOTION: f32 = 1e-30;

impl<L: Lanes> Walk<L> {
    #[inline(always)]
    fn new(l: L, ground: &Ground<'_>, packet: &Packet) -> Self {
        let (zero, one) = (l.splat(0.0), l.splat(1.0));
        let mut walk = Self {
            l,
            origin: load(l, &packet.origin),
            direction: load(l, &packet.direction),
            inverse: [zero; 3],
            ahead: [zero; 3],
            sign: [zero; 3],
            lo: [zero; 3],
            hi: [zero; 3],
            cell: load(l, &packet.cell),
            t: l.load(&packet.t),
            end: l.load(&packet.end),
        };
        for a in 0..3 {
            let falls = l.is_at_most(walk.direction[a], l.splat(-LEAST_MOTION));
            let rises = l.is_at_most(l.splat(LEAST_MOTION), walk.direction[a]);
            walk.ahead[a] = l.select(falls, zero, one);
            walk.sign[a] = l.select(falls, l.splat(-1.0), one);
            let inverse = l.div(one, walk.direction[a]);
            let far = l.splat(LEAST_MOTION.recip());
            walk.inverse[a] = l.select(falls, inverse, l.select(rises, inverse, far));
            (walk.lo[a], walk.hi[a]) = (l.splat(ground.lo[a]), l.splat(ground.hi[a]));
        }
        walk
    }

    /// Where rays would be at t = 0, from the cell's lowest corner.
    #[inline(always)]
    fn within(&self) -> [L::Float; 3] {
        let mut within = self.origin;
        for a in 0..3 {
            within[a] = self.l.sub(within[a], self.cell[a]);
        }
        within
    }

    /// Where rays are at `t` that would be `within` at t = 0.
    #[inline(always)]
    fn place(&self, mut within: [L::Float; 3], t: L::Float) -> [L::Float; 3] {
        for a in 0..3 {
            within[a] = self.l.fma(self.direction[a], t, within[a]);
        }
        within
    }

    /// The number of the cell in an array of `side` along each axis.
    #[inline(always)]
    fn index(&self, side: L::Float) -> L::Index {
        let Self { l, cell: [x, y, z], .. } = *self;
        l.index(l.fma(l.fma(z, side, y), side, x))
    }

    /// The number of the cell's group.
    #[inline(always)]
    fn group(&self, groups: usize) -> L::Index {
        let l = self.l;
        let part = l.splat(1.0 / GROUP_EDGE as f32);
        let [x, y, z] = self.cell;
        let (x, y, z) = (l.floor(l.mul(x, part)), l.floor(l.mul(y, part)), l.floor(l.mul(z, part)));
        let side = l.splat(groups as f32);
        l.index(l.fma(l.fma(z, side, y), side, x))
    }

    /// t where the ray leaves the cell, or the brick, and along which axis.
    #[inline(always)]
    fn exit(&self) -> (L::Float, [L::Mask; 3]) {
        let l = self.l;
        let mut planes = self.cell;
        for a in 0..3 {
            let ahead = l.sub(l.add(planes[a], self.ahead[a]), self.origin[a]);
            planes[a] = l.mul(ahead, self.inverse[a]);
        }
        let [x, y, z] = planes;
        let yz = l.min(y, z);
        let along_x = l.is_at_most(x, yz);
        let along_y = l.without(l.is_at_most(y, z), along_x);
        let along_z = l.without(l.without(l.mask(!0), along_x), along_y);
        (l.min(l.min(x, yz), self.end), [along_x, along_y, along_z])
    }

    /// Goes on to the next cell. Returns which of the active rays have one: rounding may leave a
    /// way of no length behind the last.
    #[inline(always)]
    fn step(&mut self, active: L::Mask, axes: [L::Mask; 3]) -> L::Mask {
        let l = self.l;
        let mut inside = active;
        for a in 0..3 {
            let next = l.add(self.cell[a], self.sign[a]);
            let is_in = l.and(l.is_at_most(self.lo[a], next), l.is_at_most(next, self.hi[a]));
            let moves = l.and(active, axes[a]);
            self.cell[a] = l.select(l.and(moves, is_in), next, self.cell[a]);
            inside = l.without(inside, l.without(moves, is_in));
        }
        inside
    }

    #[inline(always)]
    fn store(&self, packet: &mut Packet) {
        self.l.store(self.t, &mut packet.t);
        store(self.l, &self.cell, &mut packet.cell);
    }
}

#[inline(always)]
fn load<L: Lanes>(l: L, rows: &[Row; 3]) -> [L::Float; 3] {
    [l.load(&rows[0]), l.load(&rows[1]), l.load(&rows[2])]
}

#[inline(always)]
fn store<L: Lanes>(l: L, values: &[L::Float; 3], rows: &mut [Row; 3]) {
    for a in 0..3 {
        l.store(values[a], &mut rows[a]);
    }
}

/// A dual cell's corners as differences along x.
#[derive(Clone, Copy)]
pub(super) struct Cube<L: Lanes> {
    lower: [L::Float; 4],
    rise: [L::Float; 4],
}

impl<L: Lanes> Cube<L> {
    /// The cube of `values` with `side` along each axis whose lowest corner is `first`.
    #[inline(always)]
    pub(super) fn new(l: L, (values, side): (&[f32], usize), first: L::Index) -> Self {
        let (row, layer) = (side, side * side);
        let rows = [0, row, layer, layer + row];
        let mut cube = Self { lower: [l.splat(0.0); 4], rise: [l.splat(0.0); 4] };
        for n in 0..4 {
            let [lower, upper] = l.gather_pair(values, first, rows[n]);
            (cube.lower[n], cube.rise[n]) = (lower, l.sub(upper, lower));
        }
        cube
    }

    /// How the interpolant may bend along any way through the cube: half its second derivative is at
    /// most the sum of its mixed differences, the coefficient of the third power that of all three.
    #[inline(always)]
    pub(super) fn bend(&self, l: L) -> Bend<L> {
        let [a, b, c, d] = self.rise;
        let xy = l.max(distance(l, b, a), distance(l, d, c));
        let xz = l.max(distance(l, c, a), distance(l, d, b));
        let [p, q, r, s] = self.lower;
        let lower = l.sub(l.sub(s, r), l.sub(q, p));
        let twist = l.sub(l.sub(d, c), l.sub(b, a));
        let (upper, zero) = (l.add(lower, twist), l.splat(0.0));
        let yz = l.max(distance(l, lower, zero), distance(l, upper, zero));
        Bend { second: l.add(l.add(xy, xz), yz), third: distance(l, twist, zero), kink: zero }
    }

    /// The interpolant at `u`.
    #[inline(always)]
    pub(super) fn at(&self, l: L, [u, v, w]: [L::Float; 3]) -> L::Float {
        let mut along = self.lower;
        for n in 0..4 {
            along[n] = l.fma(u, self.rise[n], self.lower[n]);
        }
        let [a, b, c, d] = along;
        let (near, far) = (l.fma(v, l.sub(b, a), a), l.fma(v, l.sub(d, c), c));
        l.fma(w, l.sub(far, near), near)
    }
}

/// How x bends along a way of length 1, at most: coefficients of its second and third power, and
/// how far it is off such a cubic.
#[derive(Clone, Copy)]
pub(super) struct Bend<L: Lanes> {
    pub(super) second: L::Float,
    pub(super) third: L::Float,
    pub(super) kink: L::Float,
}

impl<L: Lanes> Bend<L> {
    /// Along `share` of the way.
    #[inline(always)]
    pub(super) fn along(self, l: L, share: f32) -> Self {
        let Self { second, third, kink } = self;
        let (square, cube) = (share * share, share * share * share);
        Self { second: l.mul(second, l.splat(square)), third: l.mul(third, l.splat(cube)), kink }
    }

    /// Of a sum.
    #[inline(always)]
    pub(super) fn plus(self, l: L, other: Self) -> Self {
        Self {
            second: l.add(self.second, other.second),
            third: l.add(self.third, other.third),
            kink: l.add(self.kink, other.kink),
        }
    }

    /// How far x is from the straight line through its ends: (s − s²) and (s − s³) are at most ¼
    /// and 0.385, the latter's odd part 0.049 about the middle.
    #[inline(always)]
    pub(super) fn distance(self, l: L) -> L::Float {
        let cubic = l.fma(self.third, l.splat(0.05), l.mul(self.second, l.splat(0.25)));
        l.add(cubic, self.kink)
    }
}

/// Whether a < b; not where either is no number.
#[inline(always)]
fn is_less<L: Lanes>(l: L, a: L::Float, b: L::Float) -> L::Mask {
    l.without(l.is_at_most(a, b), l.is_at_most(b, a))
}

/// |a − b|.
#[inline(always)]
pub(super) fn distance<L: Lanes>(l: L, a: L::Float, b: L::Float) -> L::Float {
    let difference = l.sub(a, b);
    l.max(difference, l.sub(b, a))
}

/// What rays have gathered.
struct Sums<L: Lanes> {
    light: [L::Float; 3],
    depth: L::Float,
    thickness: L::Float,
    lit: L::Float,
    off: [L::Float; 3],
    levels: [L::Float; 3],
}

impl<L: Lanes> Sums<L> {
    #[inline(always)]
    fn load(l: L, packet: &Packet) -> Self {
        Self {
            light: load(l, &packet.light),
            depth: l.load(&packet.depth),
            thickness: l.load(&packet.thickness),
            lit: l.load(&packet.lit),
            off: load(l, &packet.off),
            levels: load(l, &packet.levels),
        }
    }

    #[inline(always)]
    fn store(&self, l: L, packet: &mut Packet) {
        store(l, &self.light, &mut packet.light);
        store(l, &self.off, &mut packet.off);
        store(l, &self.levels, &mut packet.levels);
        l.store(self.depth, &mut packet.depth);
        l.store(self.lit, &mut packet.lit);
    }

    /// Passes `way` through a cell, from t = `from` on; extinction is off by `rate` beside what is
    /// found out here.
    #[inline(always)]
    fn pass<const ABSORBS: bool>(
        &mut self,
        l: L,
        ground: &Ground<'_>,
        (cube, part): (&Cube<L>, Option<&Part<L>>),
        walk: &Walk<L>,
        (from, way): (L::Float, L::Float),
        rate: L::Float,
    ) {
        let step = l.mul(way, l.splat((ground.parts as f32).recip()));
        let half = l.mul(step, l.splat(0.5));
        let thickness = l.mul(step, self.thickness);
        let (within, bend, share) = (walk.within(), cube.bend(l), (ground.parts as f32).recip());
        for count in 0..ground.parts {
            let (mut shades, mut values) = ([[half; 4]; 2], [half; 2]);
            let mut blends = [[[half; 2]; MOST_PARENTS]; 2];
            for n in 0..2 {
                let t = l.fma(step, l.splat(count as f32 + NODES[n]), from);
                let place = walk.place(within, t);
                let mut x = cube.at(l, place);
                if let Some(part) = part {
                    (x, blends[n]) = part.at(l, x, place);
                }
                shades[n] = shade::<L, ABSORBS>(l, ground.table, x);
                values[n] = x;
            }
            let [a, b] = shades;
            let mut weights = [half; 2];
            if ABSORBS {
                let mean = l.mul(thickness, l.mul(l.add(a[3], b[3]), l.splat(0.5)));
                let bend = l.mul(l.mul(thickness, l.sub(b[3], a[3])), l.splat(SLOPE_DEPTH));
                for n in 0..2 {
                    let depth = l.sub(l.fma(mean, l.splat(NODES[n]), self.depth), bend);
                    weights[n] = l.mul(half, through(l, depth));
                }
                self.depth = l.add(self.depth, mean);
            }
            let mut brightest = l.splat(0.0);
            for c in 0..3 {
                let light = l.fma(weights[0], a[c], l.mul(weights[1], b[c]));
                self.light[c] = l.add(self.light[c], light);
                brightest = l.max(brightest, light);
            }
            let lit = l.add(weights[0], weights[1]);
            self.lit = l.add(self.lit, lit);
            let bend = match part {
                Some(part) => part.bend(l, bend, share, &blends),
                None => bend.along(l, share),
            };
            let [emission, extinction, crooked] = crooked::<L, ABSORBS>(l, ground, values, bend);
            self.off[0] = l.fma(emission, lit, self.off[0]);
            if ABSORBS {
                self.off[1] = l.fma(extinction, lit, self.off[1]);
                self.off[2] = l.fma(extinction, step, self.off[2]);
                // The depth in front of a node is off by up to three times as much.
                let late = l.mul(l.mul(l.add(crooked, rate), thickness), l.splat(3.3));
                self.off[0] = l.fma(late, brightest, self.off[0]);
            }
        }
    }
}

/// What emission and extinction are off by on average over a part along which x is `values` at the
/// nodes and bends as `bend` says (see [`super::grade`]); and what extinction is off by, at most,
/// if taken to be linear along it.
#[inline(always)]
fn crooked<L: Lanes, const ABSORBS: bool>(
    l: L,
    ground: &Ground<'_>,
    [a, b]: [L::Float; 2],
    bend: Bend<L>,
) -> [L::Float; 3] {
    let bends = &ground.table.bends;
    // The line rises √3 times as far as between nodes, which are off it by `bend` each.
    let (apart, off) = (distance(l, a, b), bend.distance(l));
    let width = l.fma(apart, l.splat(1.733), l.mul(off, l.splat(5.5)));
    let middle = l.mul(l.add(a, b), l.splat(0.5));
    let half = l.fma(width, l.splat(0.5), off);
    let (zero, one) = (l.splat(0.0), l.splat(1.0));
    let place =
        l.fma(middle, l.splat(TransferBends::BEND_SCALE), l.splat(TransferBends::BEND_OFFSET));
    let place = l.min(l.max(place, zero), l.splat(TransferBends::BEND_LAST));
    let near = l.is_at_most(l.mul(half, l.splat(TransferBends::BEND_SCALE)), one);
    let place = l.index(place);
    let [curved, slope, fade, _] = l.gather_row(&bends.near, place);
    let curved = l.select(near, curved, l.splat(bends.anywhere[0]));
    let slope = l.select(near, slope, l.splat(bends.anywhere[1]));
    // Where x is no cubic nodes are off its mean by as much as it is off the line, and back.
    let mean = l.mul(bend.kink, l.splat(2.0));
    let odd = l.mul(bend.third, l.fma(bend.third, l.splat(0.0011), l.mul(width, l.splat(0.0112))));
    let even = l.fma(l.mul(bend.second, bend.second), l.splat(0.0056), odd);
    let smooth = l.mul(curved, l.fma(mean, l.add(width, bend.kink), even));
    let low = kink_place(l, l.sub(middle, half), 0.0);
    let high = kink_place(l, l.add(middle, half), 1.0);
    let quarter = l.mul(width, l.splat(0.25));
    let (mut low, mut high) = (l.gather_row(&bends.kinks, low), l.gather_row(&bends.kinks, high));
    for n in 0..3 {
        low[n] = l.max(low[n], l.splat(ground.kinks[0][n]));
        high[n] = l.max(l.min(high[n], l.splat(ground.kinks[1][n])), low[n]);
    }
    // What two nodes make of a step of the slope, or of half the second derivative, in the middle
    // of a straight line: a share of what these do over it; more as x is off the line.
    let twice = l.add(off, off);
    let kink_share = l.min(quarter, l.fma(width, l.splat(0.0225), twice));
    let turn_share = l.min(quarter, l.fma(width, l.splat(0.0055), l.add(twice, twice)));
    let turned = l.mul(l.mul(l.sub(high[2], low[2]), width), turn_share);
    let kinked = l.fma(l.sub(high[0], low[0]), kink_share, turned);
    let mut rates = [l.fma(mean, slope, l.add(smooth, kinked)), zero, zero];
    if ABSORBS {
        let fade = l.select(near, fade, l.splat(bends.anywhere[2]));
        let step = l.sub(high[1], low[1]);
        rates[1] = l.fma(mean, fade, l.mul(step, kink_share));
        rates[2] = l.fma(off, fade, l.mul(step, quarter));
    }
    rates
}

/// Where x is among the sums of kinks, or what comes `after` it.
#[inline(always)]
fn kink_place<L: Lanes>(l: L, x: L::Float, after: f32) -> L::Index {
    let place = l.fma(x, l.splat(TransferBends::KINK_SCALE), l.splat(TransferBends::KINK_OFFSET));
    let place = l.min(l.max(place, l.splat(0.0)), l.splat(TransferBends::KINK_LAST));
    l.index(l.add(place, l.splat(after)))
}

/// Emission and extinction at `x`, relative to the table's.
#[inline(always)]
fn shade<L: Lanes, const ABSORBS: bool>(l: L, table: &TransferTable, x: L::Float) -> [L::Float; 4] {
    let inside = l.min(l.max(x, l.splat(0.0)), l.splat(1.0));
    let place = l.mul(inside, l.splat(TransferTable::LINES));
    let line = l.index(place);
    let rest = l.sub(place, l.floor(place));
    let row = l.gather_row(&table.lines, line);
    let mut channels = [l.splat(0.0); 4];
    for c in 0..if ABSORBS { 4 } else { 3 } {
        channels[c] = l.fma(rest, row[4 + c], row[c]);
    }
    channels
}

/// e^−depth for depths from 0 on, to 3e-7; at most e^−[`DARK`] is nothing.
#[inline(always)]
fn through<L: Lanes>(l: L, depth: L::Float) -> L::Float {
    // 2^f over [0, 1), minimax, to 2e-7.
    const TERMS: [f32; 6] = [
        1.877_576_7e-3,
        8.989_34e-3,
        5.582_631_8e-2,
        2.401_536_1e-1,
        6.931_530_7e-1,
        9.999_999_4e-1,
    ];
    let exponent = l.mul(l.min(depth, l.splat(DARK)), l.splat(-std::f32::consts::LOG2_E));
    let whole = l.floor(exponent);
    let rest = l.sub(exponent, whole);
    let mut power = l.splat(TERMS[0]);
    for n in 1..TERMS.len() {
        power = l.fma(power, rest, l.splat(TERMS[n]));
    }
    l.mul(power, l.power_of_two(whole))
}
