//! Light and depth of a stretch within one piece of the transfer function, where emission is
//! quadratic in x and extinction linear.

use super::absorb::{Integrator, range};
use super::ray_state::{SERIES_DEPTH, mean_series};
use crate::polynomial::Polynomial;
use crate::render::transfer::piece::Piece;

/// An opaque stretch is halved this often at most: enough for depths of 1e30.
const OPAQUE_HALVINGS: u32 = 110;
/// Optical depths below this are thin: four or six nodes do where x hardly bends.
const THIN: f64 = SERIES_DEPTH;
/// Four nodes are exact to 1e-9 where depth · bend² is below this.
const STRAIGHT: f64 = 2e-6;
/// Eight nodes are exact to 1e-9 up to this optical depth if x bends little …
const THICK: f64 = 2.0;
/// … up to this if it bends as a cubic may …
const THICK_BENT: f64 = 0.25;
/// … and up to this if it bends as a polynomial of degree 7 may.
const THICK_TWISTED: f64 = 1e-5;

/// Gauss–Legendre nodes and weights on [0, 1].
const GAUSS_4: [[f64; 2]; 4] = [
    [0.069_431_844_202_973_71, 0.173_927_422_568_726_92],
    [0.330_009_478_207_571_87, 0.326_072_577_431_273_05],
    [0.669_990_521_792_428_1, 0.326_072_577_431_273_05],
    [0.930_568_155_797_026_3, 0.173_927_422_568_726_92],
];
const GAUSS_6: [[f64; 2]; 6] = [
    [0.033_765_242_898_423_99, 0.085_662_246_189_585_18],
    [0.169_395_306_766_867_74, 0.180_380_786_524_069_3],
    [0.380_690_406_958_401_55, 0.233_956_967_286_345_52],
    [0.619_309_593_041_598_4, 0.233_956_967_286_345_52],
    [0.830_604_693_233_132_3, 0.180_380_786_524_069_3],
    [0.966_234_757_101_576, 0.085_662_246_189_585_18],
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

impl Integrator<'_> {
    /// The stretch by as many nodes as it takes. Returns ∫ T ds, as do the others.
    #[inline]
    pub(super) fn exactly<const N: usize>(
        &mut self,
        x: &Polynomial<N>,
        piece: &Piece,
        range: [f64; 2],
        length: f64,
    ) -> f64 {
        let depth = length * piece.extinction(range[0]).max(piece.extinction(range[1]));
        // From the piece's origin on: beside it x is rounding where the piece is narrow.
        let mut d = *x;
        d.0[0] -= piece.origin;
        let bend = bend(&d);
        if N <= 4 && depth <= THIN && depth * bend * bend <= STRAIGHT {
            self.count += 1;
            self.quadrature(&d, piece, length, &GAUSS_4, thin_transmittance)
        } else if N <= 4 && depth <= THIN && bend <= 1.0 {
            self.count += 1;
            self.quadrature(&d, piece, length, &GAUSS_6, thin_transmittance)
        } else {
            self.thick(&d, piece, length, OPAQUE_HALVINGS)
        }
    }

    /// The stretch with x as constant as its mean, if that is close enough: then the optical
    /// depth is exact. With Δ the width of x's range, the mean of an emission of slope j′ and
    /// half second derivative c is off by at most c·Δ²/4 (a variance is at most Δ²/4); the mean
    /// of the product of emission and transmittance differs from the product of means by at most
    /// a quarter of the product of their ranges (Grüss, Math. Z. 39, 1935); and the depth at any
    /// place by at most a quarter of length times the range of κ.
    #[inline]
    pub(super) fn simply<const N: usize>(
        &mut self,
        x: &Polynomial<N>,
        piece: &Piece,
        range: [f64; 2],
        length: f64,
    ) -> Option<f64> {
        if piece.allowed == 0.0 {
            return None;
        }
        let mean = x.mean();
        let width = range[1] - range[0];
        let (emission, extinction) = (piece.emission(mean), piece.extinction(mean));
        let depth = extinction * length;
        let off = piece.bend * width * width;
        let coupled = piece.slope[0] * width * depth.min(1.0);
        let [r, g, b] = emission;
        let bent = r.max(g).max(b) * piece.slope[1] * width * length;
        let error = 0.25 * (off + coupled + bent);
        // What is allowed is meant for what is seen, of a deep stretch a part of 1 / depth or so.
        if error * (1.0 + depth) > piece.allowed {
            return None;
        }
        self.count += 1;
        self.tally.quadrature += error * self.state.transmittance * length;
        Some(self.state.pass(extinction, emission, length))
    }

    /// A stretch along which x is `d` from the piece's origin, halved until nodes suffice.
    fn thick<const N: usize>(
        &mut self,
        d: &Polynomial<N>,
        piece: &Piece,
        length: f64,
        halvings: u32,
    ) -> f64 {
        let largest =
            range(&d.control_points()).map(|d| piece.extinction[0] + piece.extinction[1] * d);
        let deepest = if bend(d) <= 1.0 {
            THICK
        } else if N <= 4 || halvings < OPAQUE_HALVINGS {
            THICK_BENT
        } else {
            THICK_TWISTED
        };
        if largest[0].max(largest[1]) * length <= deepest || halvings == 0 {
            self.count += 1;
            return self.quadrature(d, piece, length, &GAUSS_8, transmittance);
        }
        let mut lit = 0.0;
        for [from, to] in [[0.0, 0.5], [0.5, 1.0]] {
            // What lies behind a faded ray counts as its end.
            if !self.is_faded() {
                lit += self.thick(&d.part(from, to), piece, 0.5 * length, halvings - 1);
            }
        }
        lit
    }

    /// Extinction is linear in `d`, x from the piece's origin, so the optical depth is a
    /// polynomial, exact.
    #[inline]
    fn quadrature<const N: usize, const R: usize>(
        &mut self,
        d: &Polynomial<N>,
        piece: &Piece,
        length: f64,
        rule: &[[f64; 2]; R],
        transmittance: impl Fn(f64) -> f64,
    ) -> f64 {
        let [k0, k1] = piece.extinction;
        let mut depth = Polynomial(d.0);
        for (power, coefficient) in depth.0.iter_mut().enumerate() {
            let constant = if power == 0 { k0 } else { 0.0 };
            *coefficient = length * (constant + k1 * *coefficient) / (power + 1) as f64;
        }
        let scale = self.state.transmittance * length;
        let (light, mean) = light(d, piece, &depth, rule, &transmittance);
        self.state.gather(light.map(|light| scale * light));
        self.state.absorb(depth.at(1.0).max(0.0));
        scale * mean
    }
}

/// Mean of emission times transmittance along a stretch, and of transmittance: `d` is x from the
/// piece's origin, s · `depth` the optical depth. Emission is quadratic, so its three moments do.
#[inline]
fn light<const N: usize, const R: usize>(
    d: &Polynomial<N>,
    piece: &Piece,
    depth: &Polynomial<N>,
    rule: &[[f64; 2]; R],
    transmittance: impl Fn(f64) -> f64,
) -> ([f64; 3], f64) {
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
    let light = |c: usize| moments[0] * c0[c] + moments[1] * c1[c] + moments[2] * c2[c];
    (std::array::from_fn(light), moments[0])
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

/// How much x bends against its slope at the start: 0 for a straight line.
#[inline]
fn bend<const N: usize>(x: &Polynomial<N>) -> f64 {
    let bent: f64 = x.0.iter().skip(2).map(|c| c.abs()).sum();
    // A constant makes 0 / 0.
    (bent / x.0.get(1).map_or(0.0, |c| c.abs())).max(0.0)
}
