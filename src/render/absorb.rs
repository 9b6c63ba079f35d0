//! Emission and absorption where the mapped value is a polynomial along the ray.

use super::polynomial::Polynomial;
use super::ray_state::{Accuracy, RayState, SERIES_DEPTH, mean_series};
use super::transfer_pieces::{Piece, PieceList, TransferPieces};

/// A stretch is halved this often at most in search of the transfer function's bends; what is
/// left then is 2⁻²⁰ of it, and as flat as an extremum.
const SEARCH_HALVINGS: u32 = 20;
/// An opaque stretch is halved this often at most: enough for depths of 1e30.
const OPAQUE_HALVINGS: u32 = 110;
/// Parts shorter than this share of a stretch count as constant.
const SHORTEST_PART: f64 = 1e-9;
/// A part may reach this share of a piece's width beyond the piece.
const OVERSHOOT: f64 = 1e-6;
/// Four nodes are exact to 1e-9 up to this optical depth, eight up to [`THICK`].
const THIN: f64 = SERIES_DEPTH;
const THICK: f64 = 3.0;

/// Gauss–Legendre nodes and weights on [0, 1].
const GAUSS_4: [[f64; 2]; 4] = [
    [0.069_431_844_202_973_71, 0.173_927_422_568_726_92],
    [0.330_009_478_207_571_87, 0.326_072_577_431_273_05],
    [0.669_990_521_792_428_1, 0.326_072_577_431_273_05],
    [0.930_568_155_797_026_3, 0.173_927_422_568_726_92],
];
const GAUSS_8: [[f64; 2]; 8] = [
    [0.019_855_071_751_231_884, 0.050_614_268_145_188_13],
    [0.101_666_761_293_186_64, 0.111_190_517_226_687_23],
    [0.237_233_795_041_835_5, 0.156_853_322_938_943_63],
    [0.408_282_678_752_175_1, 0.181_341_891_689_181],
    [0.591_717_321_247_825, 0.181_341_891_689_181],
    [0.762_766_204_958_164_5, 0.156_853_322_938_943_63],
    [0.898_333_238_706_813_4, 0.111_190_517_226_687_23],
    [0.980_144_928_248_768_1, 0.050_614_268_145_188_13],
];

/// From this relative accuracy on, single entries of a colour map are not told apart.
const LOOSE: f64 = 1e-4;

/// Adds stretches of ray, front to back, to a ray's sums.
pub(super) struct Integrator<'a> {
    /// The pieces that stretches are cut into.
    pub(super) pieces: &'a PieceList,
    /// Pieces in which emission is what they say.
    all: &'a PieceList,
    state: &'a mut RayState,
    /// Most light that the rest of the march can add before it is absorbed.
    brightest: f64,
    /// Stretches integrated.
    pub(super) count: u64,
}

impl<'a> Integrator<'a> {
    /// An integrator for at most `length` code lengths.
    pub(super) fn new(
        pieces: &'a TransferPieces,
        accuracy: &Accuracy,
        length: f64,
        state: &'a mut RayState,
    ) -> Self {
        let cut = if accuracy.relative < LOOSE { &pieces.all } else { &pieces.knots };
        let brightest = pieces.largest_emission() * length;
        Self { pieces: cut, all: &pieces.all, state, brightest, count: 0 }
    }
}

impl Integrator<'_> {
    /// Whether no light at all comes through any more.
    #[inline]
    pub(super) fn is_dark(&self) -> bool {
        self.state.transmittance == 0.0
    }

    /// A stretch of `length` code lengths along which the mapped value is `x`.
    pub(super) fn along<const N: usize>(&mut self, x: &Polynomial<N>, length: f64) {
        self.search(x, length, SEARCH_HALVINGS);
    }

    fn search<const N: usize>(&mut self, x: &Polynomial<N>, length: f64, halvings: u32) {
        let points = x.control_points();
        let [low, high] = range(&points);
        let piece = self.pieces.at(low);
        if high < piece.end {
            return self.within(x, piece, [low, high], length);
        }
        let (rising, falling) = points.windows(2).fold((true, true), |(rising, falling), pair| {
            (rising && pair[0] <= pair[1], falling && pair[0] >= pair[1])
        });
        if rising || falling {
            self.cross(x, length, rising);
        } else if halvings == 0 {
            self.constant(x.at(0.5), length);
        } else {
            self.search(&x.part(0.0, 0.5), 0.5 * length, halvings - 1);
            self.search(&x.part(0.5, 1.0), 0.5 * length, halvings - 1);
        }
    }

    /// Walks a monotone `x` from piece to piece of the transfer function.
    fn cross<const N: usize>(&mut self, x: &Polynomial<N>, length: f64, rising: bool) {
        let (mut index, last) = (self.pieces.find(x.at(0.0)), self.pieces.find(x.at(1.0)));
        let mut from = 0.0;
        loop {
            let piece = self.pieces.piece(index);
            let is_last = if rising { index >= last } else { index <= last };
            let to = match (is_last, rising) {
                (true, _) => 1.0,
                (_, true) => x.solve(piece.end, from),
                (_, false) => x.solve(piece.start, from),
            };
            self.part(x, [from, to], piece, length);
            if is_last {
                return;
            }
            from = to;
            index = if rising { index + 1 } else { index - 1 };
        }
    }

    /// The part of a monotone `x` over s in [`from`, `to`], which crosses `piece`. Where x is too
    /// steep for its ends to be found, it counts as constant: the part is short then.
    fn part<const N: usize>(
        &mut self,
        x: &Polynomial<N>,
        [from, to]: [f64; 2],
        piece: &Piece,
        length: f64,
    ) {
        if piece.is_transparent {
            return;
        }
        let part = x.part(from, to);
        let [low, high] = range(&part.control_points());
        let slack = OVERSHOOT * (piece.end - piece.start);
        let fits = low >= piece.start - slack && high <= piece.end + slack;
        if fits && to - from >= SHORTEST_PART {
            self.within(&part, piece, [low, high], (to - from) * length);
        } else {
            let middle = x.at(0.5 * (from + to)).clamp(piece.start, piece.end.next_down());
            self.constant(middle, (to - from) * length);
        }
    }

    /// A stretch of constant `x`.
    pub(super) fn constant(&mut self, x: f64, length: f64) {
        let piece = self.all.at(x);
        if !piece.is_transparent {
            self.count += 1;
            self.state.pass(piece.extinction(x), piece.emission(x), length);
        }
    }

    /// A stretch within one piece of the transfer function, `x` in `range`.
    #[inline]
    pub(super) fn within<const N: usize>(
        &mut self,
        x: &Polynomial<N>,
        piece: &Piece,
        range: [f64; 2],
        length: f64,
    ) {
        if piece.is_transparent {
            return;
        }
        let depth = length * piece.extinction(range[0]).max(piece.extinction(range[1]));
        if N <= 4 && depth <= THIN {
            self.count += 1;
            self.quadrature(x, piece, length, &GAUSS_4, thin_transmittance);
        } else {
            self.thick(x, piece, length, OPAQUE_HALVINGS);
        }
    }

    fn thick<const N: usize>(
        &mut self,
        x: &Polynomial<N>,
        piece: &Piece,
        length: f64,
        halvings: u32,
    ) {
        let largest = range(&x.control_points()).map(|x| piece.extinction(x));
        let fits = largest[0].max(largest[1]) * length <= THICK || halvings == 0;
        if fits && !self.state.is_faded(self.brightest) {
            self.count += 1;
            return self.quadrature(x, piece, length, &GAUSS_8, transmittance);
        }
        if self.state.is_faded(self.brightest) {
            // Too dark for this march's own light, but bricks behind may be larger or brighter:
            // the transmittance has to stay true.
            let [_, depth] = from_origin(x, piece, length);
            self.state.transmittance *= transmittance(depth.at(1.0));
            return;
        }
        for [from, to] in [[0.0, 0.5], [0.5, 1.0]] {
            self.thick(&x.part(from, to), piece, 0.5 * length, halvings - 1);
        }
    }

    /// A stretch by the quadrature `rule`.
    #[inline]
    fn quadrature<const N: usize, const R: usize>(
        &mut self,
        x: &Polynomial<N>,
        piece: &Piece,
        length: f64,
        rule: &[[f64; 2]; R],
        transmittance: impl Fn(f64) -> f64,
    ) {
        let [d, depth] = from_origin(x, piece, length);
        let scale = self.state.transmittance * length;
        let light = if piece.bends {
            self.bent_light(&d, piece.origin, &depth, rule, &transmittance)
        } else {
            light(&d, piece, &depth, rule, &transmittance)
        };
        for (sum, light) in self.state.radiance.iter_mut().zip(light) {
            *sum += scale * light;
        }
        self.state.transmittance *= transmittance(depth.at(1.0));
    }

    /// [`light`] with the emission looked up at every node.
    #[cold]
    fn bent_light<const N: usize, const R: usize>(
        &self,
        d: &Polynomial<N>,
        origin: f64,
        depth: &Polynomial<N>,
        rule: &[[f64; 2]; R],
        transmittance: impl Fn(f64) -> f64,
    ) -> [f64; 3] {
        let mut light = [0.0; 3];
        for &[s, weight] in rule {
            let x = origin + d.at(s);
            let share = weight * transmittance(s * depth.at(s));
            for (light, emission) in light.iter_mut().zip(self.all.at(x).emission(x)) {
                *light += share * emission;
            }
        }
        light
    }
}

/// `x` from the piece's origin, and the polynomial that times s is the optical depth up to s:
/// extinction is linear in x, so that is exact.
#[inline]
fn from_origin<const N: usize>(
    x: &Polynomial<N>,
    piece: &Piece,
    length: f64,
) -> [Polynomial<N>; 2] {
    let mut d = *x;
    d.0[0] -= piece.origin;
    let [k0, k1] = piece.extinction;
    let mut depth = d;
    for (power, coefficient) in depth.0.iter_mut().enumerate() {
        let constant = if power == 0 { k0 } else { 0.0 };
        *coefficient = length * (constant + k1 * *coefficient) / (power + 1) as f64;
    }
    [d, depth]
}

/// Mean of emission times transmittance along a stretch: `d` is x from the piece's origin,
/// s · `depth` the optical depth. Emission is quadratic, so its three moments do.
#[inline]
fn light<const N: usize, const R: usize>(
    d: &Polynomial<N>,
    piece: &Piece,
    depth: &Polynomial<N>,
    rule: &[[f64; 2]; R],
    transmittance: impl Fn(f64) -> f64,
) -> [f64; 3] {
    let x: [f64; R] = std::array::from_fn(|n| d.at(rule[n][0]));
    let share: [f64; R] = std::array::from_fn(|n| {
        let [s, weight] = rule[n];
        weight * transmittance(s * depth.at(s))
    });
    let mut moments = [0.0; 3];
    for (x, share) in x.iter().zip(share) {
        moments[0] += share;
        moments[1] += share * x;
        moments[2] += share * x * x;
    }
    let [c0, c1, c2] = &piece.emission;
    std::array::from_fn(|c| moments[0] * c0[c] + moments[1] * c1[c] + moments[2] * c2[c])
}

/// e^−depth, at most 1.
#[inline]
fn transmittance(depth: f64) -> f64 {
    let depth = depth.max(0.0);
    if depth <= THIN { thin_transmittance(depth) } else { (-depth).exp() }
}

/// e^−depth up to [`THIN`], without a branch.
#[inline]
fn thin_transmittance(depth: f64) -> f64 {
    1.0 - depth * mean_series(depth)
}

#[inline]
fn range<const N: usize>(points: &[f64; N]) -> [f64; 2] {
    let low = points.iter().copied().fold(f64::INFINITY, f64::min);
    [low, points.iter().copied().fold(f64::NEG_INFINITY, f64::max)]
}
