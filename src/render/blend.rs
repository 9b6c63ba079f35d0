//! The march beside borders of levels: in each half cell, between the places where two distances
//! from the cell's centre are equal, every level's weight is linear and the interpolant one
//! polynomial.

use super::absorb::Integrator;
use super::frame::LocalRay;
use super::interpolant::{CellOctant, Cube, DrawnNeighbours};
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
    rungs: &mut Rungs,
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
            let ladder = Ladder::new(brick, drawn, cell, line, rungs);
            march_half_cell(&ladder, line, (ends[1] - ends[0]) * ray.length, integrator);
        }
    }
}

/// The stretch from `line[0]` to `line[1]` (local cells) in one half-cell octant.
fn march_half_cell(
    ladder: &Ladder<'_>,
    line: [[f64; 3]; 2],
    length: f64,
    integrator: &mut Integrator<'_>,
) {
    let (cuts, count) = ladder.kinks(line);
    let at = |s: f64| -> [f64; 3] {
        std::array::from_fn(|a| line[0][a] + s * (line[1][a] - line[0][a]))
    };
    for ends in cuts[..count].windows(2).filter(|ends| ends[0] < ends[1]) {
        let x = ladder.blended([at(ends[0]), at(ends[1])]);
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

/// Of each level that an octant of a half cell blends, its part of the octant and the cells there.
pub(super) type Rungs = Vec<(CellOctant, Cube)>;

/// The levels that an octant of a half cell blends, from the finest on.
struct Ladder<'b> {
    brick: &'b ScaledBrick,
    rungs: &'b [(CellOctant, Cube)],
}

impl<'b> Ladder<'b> {
    /// Of the octant of `cell` that holds `line`, in the memory of `rungs`.
    fn new(
        brick: &'b ScaledBrick,
        drawn: DrawnNeighbours,
        cell: [usize; 3],
        line: [[f64; 3]; 2],
        rungs: &'b mut Rungs,
    ) -> Self {
        let middle = std::array::from_fn(|a| 0.5 * (line[0][a] + line[1][a]));
        rungs.clear();
        for up in 0..brick.used {
            let octant = brick.octant(up, cell, middle);
            let cube = brick.cube(&octant, drawn);
            let is_last = cube.exists == Cube::COMPLETE || up + 1 == brick.used;
            if cube.exists & 1 == 1 || is_last {
                rungs.push((octant, cube));
            }
            if is_last {
                break;
            }
        }
        Self { brick, rungs }
    }

    /// 0, the s in order where some level's weight may bend, and 1; and how many these are.
    fn kinks(&self, line: [[f64; 3]; 2]) -> ([f64; KINKS + 2], usize) {
        let mut cuts = [1.0; KINKS + 2];
        cuts[0] = 0.0;
        let mut count = 1;
        for (octant, cube) in self.rungs {
            if cube.exists == Cube::COMPLETE || cube.exists & 1 == 0 {
                continue;
            }
            let [v, w] = line.map(|point| self.brick.distances(octant, point));
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

    /// The interpolant from `line[0]` to `line[1]`, a stretch in which no weight bends: from the
    /// coarsest level on, each blended in by its weight.
    fn blended(&self, line: [[f64; 3]; 2]) -> Polynomial<DEGREES> {
        let mut sum = Polynomial::constant(0.0);
        for (number, (octant, cube)) in self.rungs.iter().enumerate().rev() {
            let [from, to] = line.map(|point| self.brick.distances(octant, point));
            let Polynomial([c0, c1, c2, c3]) = Polynomial::along_line(&cube.values, from, to);
            let level = [c0, c1, c2, c3, 0.0, 0.0, 0.0, 0.0];
            if number + 1 == self.rungs.len() {
                sum = Polynomial(level);
                continue;
            }
            let weight = cube.weight(from);
            blend_in(&mut sum.0, &level, [weight, cube.weight(to) - weight]);
        }
        sum
    }
}

/// `sum` + (weight[0] + weight[1]·s) · (`level` − `sum`).
#[inline]
fn blend_in(sum: &mut [f64; DEGREES], level: &[f64; DEGREES], weight: [f64; 2]) {
    let difference: [f64; DEGREES] = std::array::from_fn(|k| level[k] - sum[k]);
    for k in 0..DEGREES {
        let lower = if k == 0 { 0.0 } else { difference[k - 1] };
        sum[k] += weight[0] * difference[k] + weight[1] * lower;
    }
    let excess = weight[1] * difference[DEGREES - 1];
    if excess != 0.0 {
        for (sum, share) in sum.iter_mut().zip(&EIGHTH_POWER) {
            *sum += excess * share;
        }
    }
}
