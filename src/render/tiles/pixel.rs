//! What is known of a pixel while its rays come in: its value, how far it is off at most, and,
//! where that stays too much, how far it is off as far as its rays' differences tell.
//!
//! Squares come in two ways. One by one, each with a bound of what its mean differs from its
//! centre's ray by: they make the pixel's *certified* value. Where that bound stays above the
//! tolerance, squares are quartered on, and the rays of their quarters stand for themselves. What
//! these say is closer to the truth, and the certificate holds with the distance of both values
//! added to it.

use super::waiting::Found;
use crate::render::bounds::ray_error::ErrorShares;
use crate::sum::Sum;

/// Standard deviations that an estimated error counts as.
const DEVIATIONS: f64 = 3.0;
/// The part of a square's spread that its quarters keep at least. Five rays beside an edge may be alike by
/// accident.
const LEAST_LEFT: f64 = 0.35;
/// The part of an edge's height that stays where quarters along it have not met it, if nothing speaks of it
/// but how uneven a square was: their rays are half as far from the side. It is all of it where their rays
/// lie at their centres, as an edge along a row of these is met by all or none.
const EDGE_LEFT: f64 = 0.5;
/// Where what varies linearly makes more of a square's rays than so many times their spread, its quarters'
/// rays lie at their centres.
const SMOOTH: f64 = 0.7;

/// The variance of what rises by 1 over a square's width.
const OF_LINEAR: f64 = 1.0 / 12.0;
/// How high an edge is that makes rays of quarters spread by 1, about: it is √10 where it halves them.
const OF_EDGE: f64 = 3.2;
/// The standard deviation that a square's ray is given for an edge of height 1 at one of its sides: an
/// edge anywhere in the square makes 0.29, but deep in it one would likely have been met by others.
const UNSEEN: f64 = 0.13;

/// A pixel in hand.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Pixel {
    /// What it is, as far as it is known.
    pub(super) value: [f64; 4],
    /// The sum of squares with bounds, each times its part of the pixel.
    certified: [f64; 4],
    /// What `certified` may be off by: a bound, by cause.
    pub(super) shares: ErrorShares,
    /// The part of the pixel that `certified` covers.
    pub(super) weight: f64,
    /// What squares that were taken as they are may add to what it is off by.
    taken: f64,
    /// Rays that stand for themselves, but for those at its outer sides.
    pub(super) rays_alone: u32,
    /// Squares whose rays stand for themselves, with what these alone may be off by.
    alone: Alone,
}

/// Squares that are left, added up. A core that shines adds far more than what is left of it once
/// its square is quartered, so that rounding must not stay.
#[derive(Debug, Clone, Copy, Default)]
struct Alone {
    /// The variance of what they add to the pixel, and what their means exceed their centres' rays
    /// by together, without those of which nothing is known yet.
    variance: Sum,
    bend: [Sum; 4],
    /// What those may be off by together whose rays lie at their centres, where edges may run beside all
    /// of these: a standard deviation.
    aligned: Sum,
    /// How many these are.
    unknown: u32,
    /// The same of squares that were given up for want of room: more rays in others do not change what
    /// these are off by.
    lost: Lost,
    /// What their rays may be off by, where that is known.
    own: Sum,
    /// The variance as four rays of the whole pixel told it.
    first: Option<f64>,
}

/// Squares that were given up, likewise.
#[derive(Debug, Clone, Copy, Default)]
struct Lost {
    variance: f64,
    bend: [f32; 4],
    aligned: f64,
    unknown: u32,
}

impl Pixel {
    /// The error that a square of what is not known yet may have on average, where the whole may
    /// have `allowed`.
    pub(super) fn rate(&self, allowed: f64) -> f64 {
        let open = 1.0 - self.weight;
        if open > 1e-9 { ((allowed - self.shares.total()) / open).max(allowed) } else { allowed }
    }

    /// Takes a square that is `weight` of it as it is.
    pub(super) fn take(&mut self, found: &Found, weight: f64) {
        self.certify(found, weight);
        self.taken += weight * found.shares().total();
        self.draw(found, weight);
    }

    fn certify(&mut self, found: &Found, weight: f64) {
        add(&mut self.certified, &found.value, weight);
        self.shares.add(&found.shares(), weight);
        self.weight += weight;
    }

    /// Leaves a square to rays that stand for themselves: its bound is what it is.
    pub(super) fn leave(&mut self, found: &Found, weight: f64) {
        self.certify(found, weight);
        match &found.uneven {
            Some(uneven) => {
                self.alone.count(uneven, weight, 1.0);
                self.alone.own.add(weight * found.own());
                if found.square.halvings == 1 {
                    self.alone.first = Some(4.0 * uneven.variance(weight));
                }
            }
            None => self.alone.unknown += 1,
        }
    }

    /// Takes a square of those left, or a quarter of one, as it is.
    pub(super) fn draw(&mut self, found: &Found, weight: f64) {
        add(&mut self.value, &found.value, weight);
    }

    /// Takes a square of those left as it is, for want of room: what it may be off by stays.
    pub(super) fn give_up(&mut self, found: &Found, weight: f64) {
        self.alone.lose(found.uneven.as_ref(), weight);
        self.draw(found, weight);
    }

    /// Learns of the quarters of a square left, `weight` of the pixel: that they are uneven, and
    /// what their rays may be off by.
    pub(super) fn learn(
        &mut self,
        whole: &Found,
        quarters: &[Unevenness; 4],
        weight: f64,
        shares: &ErrorShares,
    ) {
        let alone = &mut self.alone;
        match &whole.uneven {
            Some(uneven) => {
                alone.count(uneven, weight, -1.0);
                alone.own.add(-weight * whole.own());
            }
            None => alone.unknown = alone.unknown.saturating_sub(1),
        }
        for quarter in quarters {
            alone.count(quarter, 0.25 * weight, 1.0);
        }
        if whole.square.halvings == 0 {
            alone.first = Some(quarters.iter().map(|quarter| quarter.variance(0.25)).sum());
        }
        alone.own.add(weight * shares.beside_area());
    }

    /// Takes the whole of it, which was left, by its centre's ray: its neighbours tell how it varies, and
    /// have been off by so much elsewhere.
    pub(super) fn take_as_foretold(&mut self, found: &Found, foretold: &Unevenness, doubt: f64) {
        let alone = &mut self.alone;
        alone.unknown = alone.unknown.saturating_sub(1);
        alone.count(foretold, 1.0, 1.0);
        alone.own.add(found.own() + doubt);
        self.draw(found, 1.0);
    }

    /// The variance that its first four rays told.
    pub(super) fn first_variance(&self) -> Option<f64> {
        self.alone.first
    }

    /// What its mean may be off by in all likelihood, where its variance is taken for at least
    /// `least`; infinite while something is unknown.
    pub(super) fn unlikely(&self, least: f64) -> f64 {
        let Alone { unknown, variance, bend, aligned, lost, .. } = &self.alone;
        let variance = (variance.value() + lost.variance).max(least);
        let bend = |n: usize| bend[n].value() + f64::from(lost.bend[n]);
        let aligned = aligned.value() + lost.aligned;
        likely_error(unknown + lost.unknown, variance, aligned, std::array::from_fn(bend))
    }

    /// What its mean may be off by in all likelihood as far as more rays may change it, where that
    /// variance is taken for at least `least`: squares that were given up are left out.
    pub(super) fn changeable(&self, least: f64) -> f64 {
        let Alone { unknown, variance, bend, aligned, .. } = &self.alone;
        let variance = variance.value().max(least);
        likely_error(*unknown, variance, aligned.value(), bend.map(Sum::value))
    }

    /// What it is off by at most.
    pub(super) fn bound(&self) -> ErrorShares {
        let distance = |n: usize| (self.value[n] - self.certified[n]).abs();
        let farthest = (0..4).map(distance).fold(0.0, f64::max);
        // The value's f32 may round by more than that of the certified one.
        let pixel_area = self.shares.pixel_area + farthest * (1.0 + f64::from(f32::EPSILON));
        ErrorShares { pixel_area, ..self.shares }
    }

    /// What it is off by beside its mean: what was taken as it is, and what rays themselves are off
    /// by.
    pub(super) fn beside_mean(&self) -> f64 {
        self.taken + self.alone.own.value()
    }

    /// What it will be off by beside its mean once a square left, `weight` of the pixel, is known
    /// by rays that may be off by `shares`.
    pub(super) fn beside_mean_with(&self, whole: &Found, weight: f64, shares: &ErrorShares) -> f64 {
        let known = whole.uneven.map_or(0.0, |_| whole.own());
        self.beside_mean() + weight * (shares.beside_area() - known)
    }

    /// What it is off by as far as its rays tell, and not more than the bound.
    pub(super) fn estimate(&self) -> f64 {
        (self.beside_mean() + self.unlikely(0.0)).min(self.bound().total())
    }
}

/// What a mean may be off by in all likelihood; without limit where nothing is known of some squares.
fn likely_error(unknown: u32, variance: f64, aligned: f64, bend: [f64; 4]) -> f64 {
    if unknown > 0 {
        return f64::INFINITY;
    }
    let most_bend = bend.iter().fold(0.0, |most: f64, bend| most.max(bend.abs()));
    DEVIATIONS * (variance.max(0.0) + aligned * aligned).sqrt() + most_bend
}

fn add(sum: &mut [f64; 4], value: &[f64; 4], weight: f64) {
    sum.iter_mut().zip(value).for_each(|(sum, value)| *sum += weight * value);
}

/// What is known at a square's left, right, upper and lower side.
#[derive(Debug, Clone, Copy)]
pub(super) struct SquareSides {
    /// By how much its ray differs from the first ray of the pixel beside its own.
    pub(super) beyond: [f64; 4],
    /// Which sides are its pixel's.
    pub(super) own: [bool; 4],
}

/// What the centres of a square and its quarters tell of each quarter.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Unevenness {
    /// The standard deviation of its rays, but for what is alike in all quarters.
    spread: Half,
    /// The standard deviation of what varies linearly over it.
    slope: Half,
    /// By how much its mean exceeds its centre's ray, if values bend alike everywhere in the square.
    bend: [Half; 4],
    /// How the square's quarters differ crosswise: those of this quarter by a fourth of it, likewise.
    twist: [Half; 4],
    /// By how much values may change at an edge that runs through it, and has not been seen: at its
    /// left, right, upper and lower side. Rounded up.
    edges: [Half; 4],
    /// What it is off by as all others along an edge are: a standard deviation; 0 where its ray lies
    /// beside its centre, or no edges run along rows of these.
    aligned: Half,
}

impl Alone {
    /// Counts a square that is `weight` of the pixel, or, where `sign` is −1, takes it out again.
    fn count(&mut self, uneven: &Unevenness, weight: f64, sign: f64) {
        self.variance.add(sign * uneven.variance(weight));
        self.aligned.add(sign * weight * uneven.aligned.value());
        for (sum, bend) in self.bend.iter_mut().zip(uneven.bend) {
            sum.add(sign * weight * bend.value());
        }
    }

    /// Counts a square that is `weight` of the pixel among those that were given up.
    fn lose(&mut self, uneven: Option<&Unevenness>, weight: f64) {
        let Some(uneven) = uneven else {
            self.unknown = self.unknown.saturating_sub(1);
            self.lost.unknown += 1;
            return;
        };
        self.count(uneven, weight, -1.0);
        self.lost.variance += uneven.variance(weight);
        self.lost.aligned += weight * uneven.aligned.value();
        for (sum, bend) in self.lost.bend.iter_mut().zip(uneven.bend) {
            *sum += (weight * bend.value()) as f32;
        }
    }
}

/// The upper half of an f32: a number to 0.8 % of itself. Many squares wait.
#[derive(Debug, Clone, Copy, Default)]
struct Half(u16);

impl Half {
    fn of(x: f64) -> Self {
        Self(((x as f32).to_bits() >> 16) as u16)
    }

    /// No smaller than a number ≥ 0.
    fn no_less(x: f64) -> Self {
        let half = Self::of(x.min(f64::from(f32::MAX)));
        if half.value() < x { Self(half.0 + 1) } else { half }
    }

    fn value(self) -> f64 {
        f64::from(f32::from_bits(u32::from(self.0) << 16))
    }
}

impl Unevenness {
    /// The unevenness that the quarters of a square have in common, from its centre's ray and
    /// theirs, where so much was known `before`.
    pub(super) fn of(whole: &[f64; 4], before: Option<Self>, quarters: [&[f64; 4]; 4]) -> Self {
        let before = before.unwrap_or_default();
        let channel = |n: usize| {
            let [a, b, c, d] = quarters.map(|quarter| quarter[n]);
            (0.25 * ((a - b) - (c - d)), 0.25 * (a + b + c + d) - whole[n])
        };
        // Of independent values of variance σ² the first have σ²/4, the second 5/4·σ². What varies
        // linearly counts for nothing, since centres of quarters have its mean. Nor does what a quadratic
        // does that was known before: three quarters of what the mean exceeds the centre by, and the twist.
        let variance = |n: usize| {
            let (twist, beside) = channel(n);
            let twist = twist - 0.25 * before.twist[n].value();
            let beside = beside - 0.75 * before.bend[n].value();
            0.5 * (4.0 * twist * twist + 0.8 * beside * beside)
        };
        let spread = (0..4).map(variance).fold(0.0, f64::max).sqrt();
        // What changes from one quarter to the next, along each axis.
        let slope = |n: usize| {
            let [a, b, c, d] = quarters.map(|quarter| quarter[n]);
            0.25 * (((b + d) - (a + c)).powi(2) + ((c + d) - (a + b)).powi(2))
        };
        // Of a quadratic, midpoints of quarters are off by a quarter of what that of the square is.
        Self {
            spread: Half::no_less(spread.max(LEAST_LEFT * before.spread.value())),
            slope: Half::of((OF_LINEAR * (0..4).map(slope).fold(0.0, f64::max)).sqrt()),
            bend: std::array::from_fn(|n| Half::of(channel(n).1 / 3.0)),
            twist: std::array::from_fn(|n| Half::of(channel(n).0)),
            edges: before.edges,
            aligned: Half::default(),
        }
    }

    /// The unevenness of the `n`-th of these quarters alone, at whose sides so much is known. At those
    /// that are its pixel's own it keeps the edges that are known there, at others of the square a part
    /// of them, but for what its ray lies behind already; at its inner sides there may be what its rays
    /// differ by from the others', as far as that is not smooth. Where it `is_aligned`, edges
    /// may run along its ray and those of others.
    pub(super) fn of_quarter(
        &self,
        n: usize,
        quarters: [&[f64; 4]; 4],
        SquareSides { beyond, own }: SquareSides,
        is_aligned: bool,
    ) -> Self {
        let edges = std::array::from_fn(|side| {
            let axis = side / 2;
            let most = if n >> axis & 1 == side % 2 {
                let left = if own[side] || is_aligned { 1.0 } else { EDGE_LEFT };
                left * self.edges[side].value()
            } else {
                let pairs = quarters[n].iter().zip(quarters[n ^ 1 << axis]);
                let change = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                change.min(OF_EDGE * self.spread.value())
            };
            Half::no_less(most.min(beyond[side]))
        });
        let most = edges.iter().map(|edge: &Half| edge.value()).fold(0.0, f64::max);
        let aligned = Half::no_less(if is_aligned { UNSEEN * most } else { 0.0 });
        Self { edges, aligned, ..*self }
    }

    /// What is known of a square of which only edges are known, as [`Self::with_edges`] has them.
    pub(super) fn of_edges(edges: [f64; 4]) -> Self {
        Self::default().with_edges(edges)
    }

    /// This unevenness with other edges: by how much values may change at the left, right, upper
    /// and lower side.
    pub(super) fn with_edges(self, edges: [f64; 4]) -> Self {
        Self { edges: edges.map(Half::no_less), ..self }
    }

    /// The unevenness of a pixel, from its centre's ray and those of the eight around it, row by
    /// row: of the quadratic that is nearest to all of them, and what is left beside it. Rows of 1,
    /// 1, 1, of −1, 0, 1 and of 1, −2, 1 and their products are orthogonal, and the three of these
    /// that are no quadratics tell what is left.
    pub(super) fn around(values: &[[f64; 4]; 9]) -> Self {
        const ROWS: [[f64; 3]; 3] = [[1.0, 1.0, 1.0], [-1.0, 0.0, 1.0], [1.0, -2.0, 1.0]];
        const SQUARES: [f64; 3] = [3.0, 2.0, 6.0];
        // The sum of squares of what a product of rows leaves, and the product itself.
        let product = |c: usize, [x, y]: [usize; 2]| {
            (0..9).map(|n| ROWS[x][n % 3] * ROWS[y][n / 3] * values[n][c]).sum::<f64>()
        };
        let left =
            |c: usize, [x, y]: [usize; 2]| product(c, [x, y]).powi(2) / (SQUARES[x] * SQUARES[y]);
        let variance = |c: usize| (left(c, [1, 2]) + left(c, [2, 1]) + left(c, [2, 2])) / 3.0;
        // The mean of x² over a pixel is 1/12, and its second difference 2; in three rows.
        let bend = |c: usize| (product(c, [2, 0]) + product(c, [0, 2])) / (3.0 * 2.0 * 12.0);
        let slope = |c: usize| {
            (product(c, [1, 0]).powi(2) + product(c, [0, 1]).powi(2)) / (3.0 * 2.0_f64).powi(2)
        };
        Self {
            spread: Half::no_less((0..4).map(variance).fold(0.0, f64::max).sqrt()),
            slope: Half::of((OF_LINEAR * (0..4).map(slope).fold(0.0, f64::max)).sqrt()),
            bend: std::array::from_fn(|c| Half::of(bend(c))),
            // Of x·y the product is 4, and a pixel's own quarters differ by a 16th, a fourth of its twist.
            twist: std::array::from_fn(|c| Half::of(product(c, [1, 1]) / 16.0)),
            edges: Default::default(),
            aligned: Half::default(),
        }
    }

    /// What a ray may be off by in all likelihood, beside what bends alike.
    pub(super) fn likely(&self) -> f64 {
        DEVIATIONS * self.spread()
    }

    /// By how much a mean exceeds its centre's ray in channel `c`.
    pub(super) fn bend(&self, c: usize) -> f64 {
        self.bend[c].value()
    }

    /// By how much a mean is from its centre's ray, at most in any channel.
    pub(super) fn most_bend(&self) -> f64 {
        (0..4).map(|c| self.bend(c).abs()).fold(0.0, f64::max)
    }

    /// How far from its centre a square's ray is to be, as a part of the way to its sides: where an
    /// edge runs through many squares alike, rays at their centres would all be off alike. Where
    /// values vary smoothly, a ray elsewhere would tell less.
    pub(super) fn scatter(&self) -> f64 {
        let [spread, slope] = [self.spread, self.slope].map(Half::value);
        if spread > SMOOTH * slope { (spread / slope).min(1.0) } else { 0.0 }
    }

    /// The standard deviation of a square's rays.
    pub(super) fn spread(&self) -> f64 {
        self.edges.iter().fold(self.spread.value(), |most, edge| most.max(UNSEEN * edge.value()))
    }

    /// What a square that is `weight` of its pixel adds to its variance.
    fn variance(&self, weight: f64) -> f64 {
        (weight * self.spread()).powi(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::bounds::ray_error::RayShares;
    use crate::render::camera::rays::Square;

    const CENTRE: [f64; 2] = [3.5, 2.5];

    fn found(square: Square, of: impl Fn([f64; 2]) -> f64) -> Found {
        let value = [of(square.centre); 4];
        Found { square, value, shares: RayShares::default(), uneven: None }
    }

    fn whole() -> Square {
        Square { centre: CENTRE, offset: [0; 2], pixel: 0, halvings: 0 }
    }

    fn uneven(of: impl Fn([f64; 2]) -> f64 + Copy) -> Unevenness {
        let quarters = whole().quarters().map(|quarter| found(quarter, of));
        Unevenness::of(&found(whole(), of).value, None, std::array::from_fn(|n| &quarters[n].value))
    }

    #[test]
    fn slopes_are_even_and_bends_are_what_midpoints_miss() {
        let slope = uneven(|[x, y]| 5.0 + 3.0 * x - 2.0 * y);
        assert!(slope.spread.value() < 1e-6 && slope.most_bend() < 1e-6);
        // The mean of (x − c)² over a quarter is its centre's and 1/48 more.
        let bent = uneven(|[x, _]| (x - CENTRE[0]).powi(2));
        assert!((bent.most_bend() * 48.0 - 1.0).abs() < 0.004, "{bent:?}");
    }

    #[test]
    fn what_bends_and_twists_as_it_was_known_to_is_not_uneven() {
        let smooth = |[x, y]: [f64; 2]| {
            let (x, y) = (x - CENTRE[0], y - CENTRE[1]);
            0.3 + x - 2.0 * y + 0.7 * x * x + 1.5 * x * y - 0.4 * y * y
        };
        let places = std::array::from_fn(|n| {
            smooth([CENTRE[0] + (n % 3) as f64 - 1.0, CENTRE[1] + (n / 3) as f64 - 1.0])
        });
        let mut known = Unevenness::around(&places.map(|value| [value; 4]));
        let mut square = whole();
        for _ in 0..4 {
            let quarters = square.quarters().map(|quarter| found(quarter, smooth));
            let values = std::array::from_fn(|n| &quarters[n].value);
            let whole = found(square, smooth).value;
            let [foretold, new] =
                [Some(known), None].map(|known| Unevenness::of(&whole, known, values));
            let spread = [foretold, new].map(|uneven| uneven.spread.value());
            assert!(spread[0] < 0.02 * spread[1], "{spread:?}");
            (square, known) = (quarters[1].square, foretold);
        }
    }

    /// Numbers between 0 and 1 that seem to know nothing of each other.
    fn hash(n: u64) -> f64 {
        let n = (n + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let n = (n ^ n >> 31).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        (n >> 11) as f64 / (1_u64 << 53) as f64
    }

    #[test]
    fn neighbours_tell_of_bends_and_of_what_is_no_quadratic() {
        let around = |of: &dyn Fn(f64, f64) -> f64| {
            Unevenness::around(&std::array::from_fn(|n| [of((n % 3) as f64, (n / 3) as f64); 4]))
        };
        let even = around(&|x, y| 5.0 + 3.0 * x - 2.0 * y + x * y + 6.0 * x * x - 2.0 * y * y);
        assert!(even.likely() < 1e-6);
        // The mean over a pixel of x² is 1/12 above that of its centre.
        assert!(
            (even.bend(0) - 4.0 / 12.0).abs() < 0.004 / 3.0 && even.most_bend() == even.bend(3)
        );
        let count = 20_000_u32;
        let variance: f64 = (0..count)
            .map(|k| around(&|x, y| hash(9 * u64::from(k) + (3.0 * y + x) as u64)).spread().powi(2))
            .sum::<f64>()
            / f64::from(count);
        assert!((variance * 12.0 - 1.0).abs() < 0.03, "{variance}");
    }

    #[test]
    fn independent_rays_spread_as_they_do() {
        let count = 20_000;
        let variance: f64 = (0..count)
            .map(|n| {
                let values: [[f64; 4]; 5] = std::array::from_fn(|k| [hash(5 * n + k as u64); 4]);
                let quarters = std::array::from_fn(|k| &values[k + 1]);
                Unevenness::of(&values[0], None, quarters).spread.value().powi(2)
            })
            .sum::<f64>()
            / count as f64;
        // Of numbers between 0 and 1: 1/12.
        assert!((variance * 12.0 - 1.0).abs() < 0.03, "{variance}");
    }

    #[test]
    fn what_is_given_up_is_likely_as_before_and_no_longer_changeable() {
        let bend = [Half::of(0.1); 4];
        let rough = Unevenness { spread: Half::of(0.5), bend, ..Unevenness::default() };
        let quarters = whole()
            .quarters()
            .map(|quarter| Found { uneven: Some(rough), ..found(quarter, |_| 1.0) });
        let mut pixel = Pixel::default();
        pixel.leave(&found(whole(), |_| 1.0), 1.0);
        pixel.learn(&found(whole(), |_| 1.0), &[rough; 4], 1.0, &ErrorShares::default());
        let likely = pixel.unlikely(0.0);
        let bend = rough.most_bend();
        assert!((likely - DEVIATIONS * 0.25 - bend).abs() < 1e-7);
        assert_eq!(pixel.changeable(0.0), likely);
        quarters[..3].iter().for_each(|quarter| pixel.give_up(quarter, 0.25));
        assert!((pixel.unlikely(0.0) - likely).abs() < 1e-7);
        assert!((pixel.changeable(0.0) - DEVIATIONS * 0.125 - 0.25 * bend).abs() < 1e-7);
        assert_eq!(pixel.value, [0.75; 4]);
        // Of what is not known at all.
        let mut pixel = Pixel::default();
        pixel.leave(&found(whole(), |_| 1.0), 1.0);
        assert_eq!(pixel.changeable(0.0), f64::INFINITY);
        pixel.give_up(&found(whole(), |_| 1.0), 1.0);
        assert_eq!((pixel.changeable(0.0), pixel.unlikely(0.0)), (0.0, f64::INFINITY));
    }

    #[test]
    fn squares_along_an_edge_are_off_alike_where_their_rays_lie_at_their_centres() {
        let beside_edge = |is_aligned: bool| {
            let sides = SquareSides { beyond: [1.0; 4], own: [false, true, false, false] };
            let around = Unevenness::of_edges([0.0, 1.0, 0.0, 0.0]);
            around.of_quarter(1, [&[1.0; 4]; 4], sides, is_aligned)
        };
        let likely = |is_aligned: bool| {
            let square = Found { uneven: Some(beside_edge(is_aligned)), ..found(whole(), |_| 1.0) };
            let mut pixel = Pixel::default();
            (0..16).for_each(|_| pixel.leave(&square, 1.0 / 256.0));
            let likely = pixel.changeable(0.0);
            (0..16).for_each(|_| pixel.give_up(&square, 1.0 / 256.0));
            assert!((pixel.unlikely(0.0) - likely).abs() < 1e-9 && pixel.changeable(0.0) < 1e-9);
            likely
        };
        // They cover a sixteenth of the pixel, which the edge may halve.
        assert!((likely(false) - DEVIATIONS * UNSEEN / 64.0).abs() < 1e-3 * UNSEEN);
        assert!(likely(true) > DEVIATIONS * UNSEEN / 16.0 && likely(true) > 0.3 / 16.0);
    }

    #[test]
    fn what_is_bright_leaves_nothing_behind_once_it_is_known() {
        let mut pixel = Pixel::default();
        let bright = |spread: f64| {
            let bend = [Half::of(-spread); 4];
            Unevenness { spread: Half::of(spread), bend, ..Unevenness::default() }
        };
        let mut square = whole();
        pixel.leave(&found(square, |_| 0.0), 1.0);
        assert_eq!(pixel.unlikely(0.0), f64::INFINITY);
        let mut weight = 1.0;
        let mut before = None;
        for spread in [1e17, 1e19, 1e12, 1e-3] {
            let whole = Found { uneven: before, ..found(square, |_| 0.0) };
            let quarters = bright(spread);
            pixel.learn(&whole, &[quarters; 4], weight, &ErrorShares::default());
            // The other three turn out to be dark.
            for quarter in &square.quarters()[1..] {
                let quarter = Found { uneven: Some(quarters), ..found(*quarter, |_| 0.0) };
                pixel.learn(&quarter, &[bright(0.0); 4], 0.25 * weight, &ErrorShares::default());
            }
            (square, before) = (square.quarters()[0], Some(quarters));
            weight *= 0.25;
        }
        let last = bright(1e-3);
        let expected = weight * (last.spread.value() * DEVIATIONS + last.most_bend());
        assert!((pixel.unlikely(0.0) / expected - 1.0).abs() < 1e-5, "{}", pixel.unlikely(0.0));
    }
}
