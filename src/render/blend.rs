//! The march beside borders of levels: in each half cell, between the places where two distances
//! from the cell's centre are equal, every level's weight is linear and the interpolant one
//! polynomial.

use super::absorb::Integrator;
use super::frame::LocalRay;
use super::interpolant::{Cube, DrawnNeighbours};
use super::polynomial::Polynomial;
use super::scaled::ScaledBrick;
use super::walk::Step;
use crate::cache::state;

/// Coefficients of a blended polynomial: a cubic times the weights of four levels.
const DEGREES: usize = 8;
/// s⁸ is replaced by the polynomial of degree 7 closest to it over [0, 1] (s⁸ less the shifted
/// Chebyshev polynomial T*₈ / 2¹⁵). Weights of so many levels vary so little along a piece that
/// this is below rounding to f32.
const EIGHTH_POWER: [f64; DEGREES] = [
    -1.0 / 32768.0,
    128.0 / 32768.0,
    -2688.0 / 32768.0,
    21504.0 / 32768.0,
    -84480.0 / 32768.0,
    180_224.0 / 32768.0,
    -212_992.0 / 32768.0,
    131_072.0 / 32768.0,
];

/// A dual cell whose eight cells are not alike: cut at their faces.
#[cold]
pub(super) fn march_mixed(
    brick: &ScaledBrick,
    drawn: DrawnNeighbours,
    ray: &LocalRay,
    step: &Step,
    integrator: &mut Integrator<'_>,
) {
    let (origin, direction) = (ray.origin.to_array(), ray.direction.to_array());
    let mut cuts = [step.from; 5];
    for a in 0..3 {
        let sigma = (f64::from(step.cell[a]) - origin[a]) / direction[a];
        cuts[a + 1] = if sigma.is_finite() { sigma.clamp(step.from, step.to) } else { step.from };
    }
    cuts[4] = step.to;
    cuts.sort_unstable_by(f64::total_cmp);
    let at = |sigma: f64| -> [f64; 3] { std::array::from_fn(|a| origin[a] + direction[a] * sigma) };
    for ends in cuts.windows(2).filter(|ends| ends[0] < ends[1]) {
        let middle = at(0.5 * (ends[0] + ends[1]));
        let cell: [usize; 3] = std::array::from_fn(|a| {
            let cell = step.cell[a] - i32::from(middle[a] < f64::from(step.cell[a]));
            cell.clamp(0, brick.edge as i32 - 1) as usize
        });
        let own = &brick.blocks[0];
        if own.states[own.at(cell.map(|c| c + 1))] & state::VOID == 0 {
            let line = [at(ends[0]), at(ends[1])];
            march_half_cell(brick, drawn, cell, line, (ends[1] - ends[0]) * ray.length, integrator);
        }
    }
}

/// The stretch from `line[0]` to `line[1]` (local cells) in one half-cell octant of `cell`.
fn march_half_cell(
    brick: &ScaledBrick,
    drawn: DrawnNeighbours,
    cell: [usize; 3],
    line: [[f64; 3]; 2],
    length: f64,
    integrator: &mut Integrator<'_>,
) {
    let at = |s: f64| -> [f64; 3] {
        std::array::from_fn(|a| line[0][a] + s * (line[1][a] - line[0][a]))
    };
    let (cuts, count) = kinks(brick, drawn, cell, line);
    for ends in cuts[..count].windows(2).filter(|ends| ends[0] < ends[1]) {
        let x = blended(brick, drawn, cell, [at(ends[0]), at(ends[1])]);
        let length = (ends[1] - ends[0]) * length;
        // As it is where two levels meet.
        match x.0 {
            [c0, c1, c2, c3, c4, 0.0, 0.0, 0.0] => {
                integrator.along(&Polynomial([c0, c1, c2, c3, c4]), length);
            }
            _ => integrator.along(&x, length),
        }
    }
}

/// Most kinks looked at: three for each of eight levels.
const KINKS: usize = 24;

/// 0, the s in order where some level's weight may bend, and 1; and how many these are.
fn kinks(
    brick: &ScaledBrick,
    drawn: DrawnNeighbours,
    cell: [usize; 3],
    line: [[f64; 3]; 2],
) -> ([f64; KINKS + 2], usize) {
    let mut cuts = [1.0; KINKS + 2];
    cuts[0] = 0.0;
    let mut count = 1;
    let middle = std::array::from_fn(|a| 0.5 * (line[0][a] + line[1][a]));
    for up in 0..brick.used {
        let octant = brick.octant(up, cell, middle);
        let exists = brick.cube(&octant, drawn).exists;
        if exists == Cube::COMPLETE {
            break;
        }
        if exists & 1 == 0 {
            continue;
        }
        let [v, w] = line.map(|point| brick.distances(&octant, point));
        for (a, b) in [(0, 1), (1, 2), (2, 0)] {
            let (before, after) = (v[a] - v[b], w[a] - w[b]);
            if before * after < 0.0 && count <= KINKS {
                cuts[count] = before / (before - after);
                count += 1;
            }
        }
    }
    cuts[1..count].sort_unstable_by(f64::total_cmp);
    (cuts, count + 1)
}

/// The interpolant from `line[0]` to `line[1]`, a stretch in which no weight bends.
fn blended(
    brick: &ScaledBrick,
    drawn: DrawnNeighbours,
    cell: [usize; 3],
    line: [[f64; 3]; 2],
) -> Polynomial<DEGREES> {
    let middle = std::array::from_fn(|a| 0.5 * (line[0][a] + line[1][a]));
    let (mut sum, mut share) = (Polynomial::constant(0.0), Polynomial::constant(1.0));
    for up in 0..brick.used {
        let octant = brick.octant(up, cell, middle);
        let cube = brick.cube(&octant, drawn);
        let [from, to] = line.map(|point| brick.distances(&octant, point));
        let level = Polynomial::along_line(&cube.values, from, to);
        if cube.exists == Cube::COMPLETE || up + 1 == brick.used {
            return added(&sum, &product(&share, &level.0), 1.0);
        }
        if cube.exists & 1 == 0 {
            continue;
        }
        let weight = cube.weight(from);
        let taken = product(&share, &[weight, cube.weight(to) - weight]);
        sum = added(&sum, &product(&taken, &level.0), 1.0);
        share = added(&share, &taken, -1.0);
    }
    sum
}

fn added(sum: &Polynomial<DEGREES>, term: &Polynomial<DEGREES>, sign: f64) -> Polynomial<DEGREES> {
    Polynomial(std::array::from_fn(|k| sum.0[k] + sign * term.0[k]))
}

fn product<const M: usize>(left: &Polynomial<DEGREES>, right: &[f64; M]) -> Polynomial<DEGREES> {
    let mut all = [0.0; DEGREES + 3];
    let degrees = left.0.iter().rposition(|c| *c != 0.0).map_or(0, |degree| degree + 1);
    for (i, a) in left.0[..degrees].iter().enumerate() {
        for (j, b) in right.iter().enumerate() {
            all[i + j] += a * b;
        }
    }
    for power in (DEGREES..degrees + M - 1).rev() {
        let excess = all[power];
        for (k, share) in EIGHTH_POWER.iter().enumerate() {
            all[power - DEGREES + k] += excess * share;
        }
    }
    Polynomial(std::array::from_fn(|k| all[k]))
}
