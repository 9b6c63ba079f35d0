//! The march beside borders of levels: in each half cell, between the places where two distances
//! from the cell's centre are equal, every level's weight is linear and the interpolant one
//! polynomial.

use super::absorb::Integrator;
use crate::cache::state;
use crate::polynomial::Polynomial;
use crate::render::brick::interpolant::{Cube, DrawnNeighbours, weight};
use crate::render::brick::scaled::ScaledBrick;
use crate::render::brick::walk::Step;
use crate::render::camera::frame::LocalRay;

/// Coefficients of a blended polynomial: a cubic times the weights of four levels.
const DEGREES: usize = 8;
/// s⁸ is replaced by the polynomial of degree 7 closest to it over [0, 1] (s⁸ less the shifted
/// Chebyshev polynomial T*₈ / 2¹⁵). Where there is one, its factor is the cubic term of a level whose
/// cells are 2⁵ times as wide as the stretch is long or wider, up to 4 · 2⁻¹⁵ of what its values differ
/// by, times weights that change by 2⁰ to 2⁻⁴ along it: 2⁻²³, and with the 2⁻¹⁵ below 2⁻³⁷.
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

/// A dual cell whose eight cells are not alike: cut at their faces. The way through what was dropped, code
/// length.
#[cold]
pub(super) fn march_mixed(
    brick: &ScaledBrick,
    drawn: DrawnNeighbours,
    ray: &LocalRay,
    step: &Step,
    room: &mut BlendRoom,
    integrator: &mut Integrator<'_>,
) -> f64 {
    let (origin, direction) = (ray.origin.to_array(), ray.direction.to_array());
    let (mut cuts, mut void) = ([step.from; 5], 0.0);
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
        let length = (ends[1] - ends[0]) * ray.length;
        if own.states[own.at(cell.map(|c| c + 1))] & state::VOID == 0 {
            let line = [at(ends[0]), at(ends[1])];
            room.blend(brick, drawn, cell, line, length);
            room.march(integrator);
        } else {
            void += length;
        }
    }
    void
}

/// One level in an octant of a half cell, along the ray's stretch in it.
#[derive(Clone, Copy)]
struct BlendLevel {
    /// Which cells exist, as in [`Cube`].
    exists: u8,
    /// Distances from the cell's centre at the stretch's beginning, and how much these grow.
    from: [f64; 3],
    run: [f64; 3],
    /// The level's own interpolant.
    cubic: [f64; 4],
}

/// The levels that an octant of a half cell blends, from the finest on; in memory that is used again
/// for the next.
#[derive(Default)]
pub(super) struct BlendRoom {
    levels: Vec<BlendLevel>,
    /// The stretch's length, code length.
    length: f64,
    /// The smallest and the largest of the values that are blended.
    range: [f64; 2],
    /// 0, the s in order where some level's weight may bend, and 1.
    cuts: Vec<f64>,
}

impl BlendRoom {
    /// Takes the octant of `cell` that holds the stretch from `line[0]` to `line[1]` (local cells),
    /// `length` code lengths long.
    fn blend(
        &mut self,
        brick: &ScaledBrick,
        drawn: DrawnNeighbours,
        cell: [usize; 3],
        line: [[f64; 3]; 2],
        length: f64,
    ) {
        let Self { levels, range, .. } = self;
        *range = [f64::INFINITY, f64::NEG_INFINITY];
        let middle = std::array::from_fn(|a| 0.5 * (line[0][a] + line[1][a]));
        levels.clear();
        for up in 0..brick.used {
            let octant = brick.octant(up, cell, middle);
            let cube = brick.cube(&octant, drawn);
            let is_last = cube.exists == Cube::COMPLETE || up + 1 == brick.used;
            if cube.exists & 1 == 1 || is_last {
                let from = brick.distances(&octant, line[0]);
                let to = brick.distances(&octant, line[1]);
                let run = std::array::from_fn(|a| to[a] - from[a]);
                let Polynomial(cubic) = Polynomial::along_line(&cube.values, from, to);
                levels.push(BlendLevel { exists: cube.exists, from, run, cubic });
                for value in cube.values {
                    *range = [range[0].min(value), range[1].max(value)];
                }
            }
            if is_last {
                break;
            }
        }
        self.length = length;
    }

    fn march(&mut self, integrator: &mut Integrator<'_>) {
        let piece = integrator.pieces.at(self.range[0]);
        let is_within = self.range[1] < piece.end && integrator.is_clear(piece, self.range);
        if is_within && piece.is_transparent {
            return integrator.through_nothing(piece, self.range[1], self.length);
        }
        self.find_kinks();
        for ends in self.cuts.windows(2).filter(|ends| ends[0] < ends[1]) {
            let ends = [ends[0], ends[1]];
            // As it is where two levels meet.
            if self.levels.len() <= 2 {
                self.march_piece::<5>(ends, integrator);
            } else {
                self.march_piece::<DEGREES>(ends, integrator);
            }
        }
    }

    fn march_piece<const N: usize>(&self, [from, to]: [f64; 2], integrator: &mut Integrator<'_>) {
        let x = self.blended::<N>([from, to]).part(from, to);
        integrator.along(&x, (to - from) * self.length);
    }

    fn find_kinks(&mut self) {
        let Self { levels, cuts, .. } = self;
        cuts.clear();
        cuts.push(0.0);
        for BlendLevel { from, run, .. } in levels.iter().filter(|level| level.is_blended()) {
            for (a, b) in [(0, 1), (1, 2), (2, 0)] {
                let (before, rise) = (from[a] - from[b], run[a] - run[b]);
                if before * (before + rise) < 0.0 {
                    cuts.push(-before / rise);
                }
            }
        }
        if cuts.len() > 2 {
            cuts[1..].sort_unstable_by(f64::total_cmp);
        }
        cuts.push(1.0);
    }

    /// The interpolant in terms of the whole stretch's s, as it is over `ends`, between which no
    /// weight bends: from the coarsest level on, each blended in by its weight.
    fn blended<const N: usize>(&self, ends: [f64; 2]) -> Polynomial<N> {
        let mut sum = [0.0; N];
        for (number, level) in self.levels.iter().enumerate().rev() {
            if number + 1 == self.levels.len() {
                sum[..4].copy_from_slice(&level.cubic);
            } else {
                blend_in(&mut sum, &level.cubic, level.weight(ends));
            }
        }
        Polynomial(sum)
    }
}

impl BlendLevel {
    fn is_blended(&self) -> bool {
        self.exists != Cube::COMPLETE && self.exists & 1 == 1
    }

    /// The weight over `ends`, between which it does not bend: at s = 0 were it so there too, and
    /// its slope.
    fn weight(&self, [from, to]: [f64; 2]) -> [f64; 2] {
        let at = |s: f64| weight(self.exists, [0, 1, 2].map(|a| self.from[a] + s * self.run[a]));
        let (start, end) = (at(from), at(to));
        let slope = (end - start) / (to - from);
        [start - slope * from, slope]
    }
}

/// `sum` + `(weight[0] + weight[1]·s) · (level − sum)`.
#[inline]
fn blend_in<const N: usize>(sum: &mut [f64; N], level: &[f64; 4], weight: [f64; 2]) {
    let mut lower = 0.0;
    for (k, sum) in sum.iter_mut().enumerate() {
        let difference = level.get(k).copied().unwrap_or(0.0) - *sum;
        *sum += weight[0] * difference + weight[1] * lower;
        lower = difference;
    }
    let excess = weight[1] * lower;
    if excess != 0.0 && N == DEGREES {
        for (sum, share) in sum.iter_mut().zip(&EIGHTH_POWER) {
            *sum += excess * share;
        }
    }
}
