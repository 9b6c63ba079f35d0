//! Emission and absorption along a ray through the continuous interpolant.
//!
//! The ray is cut at the half-cell planes of each leaf cell, where octants of coarser levels
//! change too. Within a piece every `T_l` is a cubic along the ray and every weight the least
//! or largest of straight lines; cut again where those lines cross and where the value meets a
//! kink of the transfer function, extinction and emission are polynomials, whose line integral
//! Gauss' rule gives.

use super::interpolant::{Interpolant, Octant};
use super::march_cell::{Gathered, OPAQUE};
use super::polynomial::Polynomial;
use super::transfer::Transfer;
use super::walk::{Ray, Segment};

/// Gauss–Legendre nodes and weights of 8 points on −1 … 1, for the positive nodes.
const GAUSS: [(f64, f64); 4] = [
    (0.183_434_642_495_649_8, 0.362_683_783_378_362),
    (0.525_532_409_916_329, 0.313_706_645_877_887_3),
    (0.796_666_477_413_626_7, 0.222_381_034_453_374_48),
    (0.960_289_856_497_536_3, 0.101_228_536_290_376_26),
];
/// Relative error at which halving a Gauss interval ends, and the most halvings.
const CONVERGED: f64 = 1e-9;
const MOST_HALVINGS: u32 = 40;
/// What cancellation may leave of a sum of polynomial terms, relative to the terms.
const ROUNDING: f64 = 1e-14;

/// The picture of one ray.
pub(crate) fn march(interpolant: &Interpolant<'_>, transfer: &Transfer, ray: &Ray) -> Gathered {
    let mut gathered = Gathered::default();
    let kinks = transfer.kinks();
    ray.walk(interpolant.dataset, &mut |cell| {
        let bounds = (cell.index, cell.index.map(|i| i + 1));
        let cuts = ray.cuts(cell.level, bounds, 0.5, (cell.enter, cell.leave));
        for ends in cuts.windows(2) {
            let half = Segment { enter: ends[0], leave: ends[1], ..*cell };
            for (length, value) in values_along(interpolant, ray, &half) {
                add_value(transfer, &kinks, length, &value, &mut gathered);
            }
        }
        gathered.optical_depth < OPAQUE
    });
    gathered
}

/// One level's part in a piece of a ray; polynomials over the piece, 0 … 1.
#[derive(Clone)]
struct Layer {
    octant: Octant,
    /// Place between the eight centres along each axis.
    place: [Polynomial; 3],
}

impl Layer {
    /// `s_a` along the piece.
    fn fade(&self, axis: usize) -> Polynomial {
        let (value, slope) = self.octant.fade(axis);
        Polynomial::constant(value).plus(&self.place[axis].scaled(slope))
    }

    fn trilinear(&self) -> Polynomial {
        let along = |low: &Polynomial, high: &Polynomial, axis: usize| {
            low.plus(&self.place[axis].times(&high.plus(&low.scaled(-1.0))))
        };
        let corner = self.octant.corners.map(Polynomial::constant);
        let x = [0, 1, 2, 3].map(|n| along(&corner[2 * n], &corner[2 * n + 1], 0));
        let y = [0, 1].map(|n| along(&x[2 * n], &x[2 * n + 1], 1));
        along(&y[0], &y[1], 2)
    }

    /// The weight of this level where no two of the `s_a` cross: a straight line.
    fn weight(&self) -> Polynomial {
        let pick = |lines: Vec<Polynomial>, sign: f64| {
            let key = |p: &Polynomial| sign * p.at(0.5);
            lines.into_iter().max_by(|a, b| key(a).total_cmp(&key(b)))
        };
        let largest = |set: &usize| {
            let axes = (0..3).filter(|a| set >> a & 1 == 1);
            pick(axes.map(|a| self.fade(a)).collect(), 1.0)
        };
        let candidates = self.octant.missing.iter().filter_map(largest).collect();
        pick(candidates, -1.0).unwrap_or(Polynomial::constant(1.0))
    }

    fn restricted(&self, low: f64, high: f64) -> Self {
        if (low, high) == (0.0, 1.0) {
            return self.clone();
        }
        let place = self.place.each_ref().map(|p| p.restricted(low, high));
        Self { octant: self.octant.clone(), place }
    }
}

/// The interpolant along a segment that lies in one octant: pieces in order, each with its
/// length (code length) and the scaled value as a polynomial.
fn values_along(
    interpolant: &Interpolant<'_>,
    ray: &Ray,
    half: &Segment,
) -> Vec<(f64, Polynomial)> {
    let middle = (half.enter + half.leave).scaled(-1);
    let octants = interpolant.octants(half.level, ray.at(middle, 0));
    let layers: Vec<Layer> = octants
        .into_iter()
        .map(|(level, octant)| {
            let start = octant.place(ray.at(half.enter, level));
            let place = std::array::from_fn(|a| {
                let cells = ray.direction[a].scaled(level as i32).to_f64();
                Polynomial::line(start[a], cells * half.length())
            });
            Layer { octant, place }
        })
        .collect();
    let mut cuts = vec![0.0, 1.0];
    for layer in layers.iter().filter(|layer| !layer.octant.missing.is_empty()) {
        for (a, b) in [(0, 1), (0, 2), (1, 2)] {
            cuts.extend(layer.fade(a).plus(&layer.fade(b).scaled(-1.0)).crossings(&[0.0]));
        }
    }
    cuts.sort_by(f64::total_cmp);
    let pieces = cuts.windows(2).filter(|c| c[0] < c[1]);
    pieces.map(|c| ((c[1] - c[0]) * half.length(), blended(&layers, c[0], c[1]))).collect()
}

/// `F` along part of a piece, from the coarsest layer down.
fn blended(layers: &[Layer], low: f64, high: f64) -> Polynomial {
    layers.iter().rev().fold(Polynomial::constant(0.0), |coarser, layer| {
        let layer = layer.restricted(low, high);
        let change = layer.trilinear().plus(&coarser.scaled(-1.0));
        coarser.plus(&layer.weight().times(&change))
    })
}

/// Adds a piece along which the scaled value is `value`.
fn add_value(
    transfer: &Transfer,
    kinks: &[f64],
    length: f64,
    value: &Polynomial,
    gathered: &mut Gathered,
) {
    let x = transfer.map_along(value);
    let mut cuts = vec![0.0, 1.0];
    cuts.extend(x.crossings(kinks));
    cuts.sort_by(f64::total_cmp);
    for c in cuts.windows(2).filter(|c| c[0] < c[1]) {
        let part = Medium::new(transfer, kinks, &x.restricted(c[0], c[1]), length * (c[1] - c[0]));
        part.add(gathered);
    }
}

/// Optical depth and emission of each channel along a stretch, as polynomials over 0 … 1.
struct Medium {
    depth: Polynomial,
    emission: [Polynomial; 3],
}

impl Medium {
    /// `x` stays between two neighbouring kinks (or beyond the outermost).
    fn new(transfer: &Transfer, kinks: &[f64], x: &Polynomial, length: f64) -> Self {
        let middle = x.at(0.5).clamp(0.0, 1.0);
        let above = kinks.iter().position(|k| *k > middle).unwrap_or(kinks.len() - 1).max(1);
        let (low, high) = (kinks[above - 1], kinks[above]);
        let constant = !(0.0..=1.0).contains(&x.at(0.5));
        // Two points strictly inside fix the straight lines, even where a table jumps at its end.
        let [near, far] = [0.25, 0.75].map(|part| low + part * (high - low));
        let [first, second] = [near, far].map(|x| transfer.optics(x));
        let clamped = transfer.optics(middle);
        let share = x.plus(&Polynomial::constant(-near)).scaled(1.0 / (far - near));
        let line = |at: f64, a: f64, b: f64| match constant {
            true => Polynomial::constant(at),
            false => Polynomial::constant(a).plus(&share.scaled(b - a)),
        };
        let extinction = line(clamped.extinction, first.extinction, second.extinction);
        let source = line(clamped.emission, first.emission, second.emission).scaled(length);
        let emission = std::array::from_fn(|c| {
            source.times(&line(clamped.color[c], first.color[c], second.color[c]))
        });
        Self { depth: extinction.integral().scaled(length), emission }
    }

    fn add(&self, gathered: &mut Gathered) {
        let front = (-gathered.optical_depth).exp();
        let seen = self.seen(0.0, 1.0, MOST_HALVINGS);
        for (channel, radiance) in gathered.radiance.iter_mut().zip(seen) {
            *channel += front * radiance;
        }
        gathered.optical_depth += self.depth.at(1.0);
    }

    /// Radiance of `low … high` that leaves the stretch at its front.
    fn seen(&self, low: f64, high: f64, halvings: u32) -> [f64; 3] {
        let (before, after) = (self.depth.at(low), self.depth.at(high));
        if before > OPAQUE {
            return [0.0; 3];
        }
        let middle = 0.5 * (low + high);
        if after - before < 2.0 || halvings == 0 {
            let whole = self.gauss(low, high);
            let (near, far) = (self.gauss(low, middle), self.gauss(middle, high));
            let halves = [0, 1, 2].map(|c| near[c] + far[c]);
            let close = |c: usize| {
                let size: f64 = self.emission[c].0.iter().map(|a| a.abs()).sum();
                let error = (whole[c] - halves[c]).abs();
                error <= CONVERGED * halves[c].abs() + ROUNDING * size * (high - low)
            };
            if halvings == 0 || (0..3).all(close) {
                return halves;
            }
        }
        let near = self.seen(low, middle, halvings - 1);
        let far = self.seen(middle, high, halvings - 1);
        [0, 1, 2].map(|c| near[c] + far[c])
    }

    fn gauss(&self, low: f64, high: f64) -> [f64; 3] {
        let (centre, half) = (0.5 * (low + high), 0.5 * (high - low));
        let mut sum = [0.0; 3];
        for (node, weight) in GAUSS {
            for s in [centre - half * node, centre + half * node] {
                let factor = weight * half * (-self.depth.at(s)).exp();
                for (channel, emission) in sum.iter_mut().zip(&self.emission) {
                    *channel += factor * emission.at(s);
                }
            }
        }
        sum
    }
}
