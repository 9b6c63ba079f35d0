//! How uneven a square of a pixel is, as far as rays tell: those of its quarters, of pixels around it, and
//! edges that may run between them.

/// Standard deviations that an estimated error counts as.
pub(super) const DEVIATIONS: f64 = 3.0;
/// The part of a square's spread that its quarters keep at least. Five rays beside an edge may be alike by
/// accident. (Where many squares are alike so, four times as many rays leave half of this part of what they
/// may be off by.)
const LEAST_LEFT: f64 = 0.25;
/// The part of an edge's height that stays where quarters along it have not met it, if nothing speaks of it
/// but how uneven a square was: their rays are half as far from the side. It is all of it where their rays
/// lie at their centres, as an edge along a row of these is met by all or none.
const EDGE_LEFT: f64 = 0.8;
/// Where what varies linearly makes more of a square's rays than so many times their spread, its quarters'
/// rays lie at their centres.
const SMOOTH: f64 = 0.7;

/// The variance of what rises by 1 over a square's width.
const OF_LINEAR: f64 = 1.0 / 12.0;
/// How high an edge is that makes rays of quarters spread by 1, about: it is √10 where it halves them.
const OF_EDGE: f64 = 3.2;
/// The standard deviation that a square's ray is given for an edge of height 1 at one of its sides: an
/// edge anywhere in the square makes 0.29, but deep in it one would likely have been met by others.
pub(super) const UNSEEN_EDGE_SPREAD: f64 = 0.13;

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
    /// The unevenness of each quarter of a square, from its centre's ray and theirs, where so much was known
    /// of it `before`, and at the quarters' sides. Where they are `aligned`, edges may run along their rays and
    /// those of others.
    pub(super) fn of_quarters(
        whole: &[f64; 4],
        before: Option<Self>,
        quarters: [&[f64; 4]; 4],
        sides: impl Fn(usize) -> SquareSides,
        aligned: bool,
    ) -> [Self; 4] {
        let all = Self::of(whole, before, quarters);
        std::array::from_fn(|n| all.of_quarter(n, quarters, sides(n), aligned))
    }

    /// The unevenness that the quarters of a square have in common.
    fn of(whole: &[f64; 4], before: Option<Self>, quarters: [&[f64; 4]; 4]) -> Self {
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

    /// The same with the edges of the `n`-th of these quarters, at whose sides so much is known. At those
    /// that are its pixel's own it keeps the edges that are known there, but for what its ray lies behind
    /// already, at others of the square a part of them; at its inner sides there may be what its rays
    /// differ by from the others', as far as that is not smooth.
    fn of_quarter(
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
            // What runs through the pixel may end within it, and then lies at no side of the pixel.
            Half::no_less(if own[side] { most.min(beyond[side]) } else { most })
        });
        let most = edges.iter().map(|edge: &Half| edge.value()).fold(0.0, f64::max);
        let aligned = Half::no_less(if is_aligned { UNSEEN_EDGE_SPREAD * most } else { 0.0 });
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

    /// What spreads and bends so much.
    #[cfg(test)]
    pub(super) fn spread_and_bent(spread: f64, bend: f64) -> Self {
        Self { spread: Half::of(spread), bend: [Half::of(bend); 4], ..Self::default() }
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
        self.edges
            .iter()
            .fold(self.spread.value(), |most, edge| most.max(UNSEEN_EDGE_SPREAD * edge.value()))
    }

    /// What it is off by as all others along an edge are: a standard deviation.
    pub(super) fn aligned(&self) -> f64 {
        self.aligned.value()
    }

    /// What a square that is `weight` of its pixel adds to its variance.
    pub(super) fn variance(&self, weight: f64) -> f64 {
        (weight * self.spread()).powi(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::camera::rays::Square;

    const CENTRE: [f64; 2] = [3.5, 2.5];

    fn whole() -> Square {
        Square { centre: CENTRE, offset: [0; 2], pixel: 0, halvings: 0 }
    }

    /// What a square and its quarters tell where values go by place so.
    fn uneven(
        square: Square,
        before: Option<Unevenness>,
        of: impl Fn([f64; 2]) -> f64,
    ) -> Unevenness {
        let quarters = square.quarters().map(|quarter| [of(quarter.centre); 4]);
        Unevenness::of(&[of(square.centre); 4], before, quarters.each_ref())
    }

    /// Numbers between 0 and 1 that seem to know nothing of each other.
    fn hash(n: u64) -> f64 {
        let n = (n + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let n = (n ^ n >> 31).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        (n >> 11) as f64 / (1_u64 << 53) as f64
    }

    #[test]
    fn slopes_are_even_and_bends_are_what_midpoints_miss() {
        let slope = uneven(whole(), None, |[x, y]| 5.0 + 3.0 * x - 2.0 * y);
        assert!(slope.spread.value() < 1e-6 && slope.most_bend() < 1e-6);
        // The mean of (x − c)² over a quarter is its centre's and 1/48 more.
        let bent = uneven(whole(), None, |[x, _]| (x - CENTRE[0]).powi(2));
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
            let [predicted, new] = [Some(known), None].map(|known| uneven(square, known, smooth));
            let spread = [predicted, new].map(|uneven| uneven.spread.value());
            assert!(spread[0] < 0.02 * spread[1], "{spread:?}");
            (square, known) = (square.quarters()[1], predicted);
        }
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
}
