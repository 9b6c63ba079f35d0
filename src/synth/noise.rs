//! Deterministic noise: hashes of integers, and smooth noise between hashed lattice points.

use glam::DVec3;

const AXIS_FACTORS: [u64; 3] =
    [0x9e37_79b9_7f4a_7c15, 0xc2b2_ae3d_27d4_eb4f, 0x1656_67b1_9e37_79f9];

/// Mixes the bits of `value` (the finaliser of MurmurHash3).
pub(super) fn mix(mut value: u64) -> u64 {
    value ^= value >> 33;
    value = value.wrapping_mul(0xff51_afd7_ed55_8ccd);
    value ^= value >> 33;
    value = value.wrapping_mul(0xc4ce_b9fe_1a85_ec53);
    value ^ (value >> 33)
}

/// One hash of several numbers, sensitive to their order.
pub(super) fn hash(numbers: &[u64]) -> u64 {
    numbers.iter().fold(0x5eed, |state, &n| mix(state ^ n.wrapping_mul(AXIS_FACTORS[0])))
}

/// A hash as a number in [−1, 1).
fn signed_unit(hash: u64) -> f64 {
    (hash >> 11) as f64 * (-52f64).exp2() - 1.0
}

/// White noise in [−1, 1): one value for each cell `index` of a level.
pub(super) fn cell_noise(level: u32, index: [i128; 3]) -> f64 {
    let mut state = u64::from(level);
    for (axis, i) in index.into_iter().enumerate() {
        state ^= (i as u64).wrapping_mul(AXIS_FACTORS[axis]).rotate_left(13 * axis as u32);
    }
    signed_unit(mix(state))
}

/// The hashed values around the last point of each noise that an evaluation asks for, in the
/// order of asking: the next cell of a row mostly lies between the same lattice points.
#[derive(Debug, Default)]
pub(super) struct NoiseMemory {
    lattices: Vec<Lattice>,
    next: usize,
}

/// Values at the 8 corners of one lattice cell, x fastest.
#[derive(Debug, Clone, Copy)]
struct Lattice {
    cell: [i64; 3],
    seed: u64,
    corners: [f64; 8],
}

impl NoiseMemory {
    /// Starts the evaluation of another point.
    pub(super) fn restart(&mut self) {
        self.next = 0;
    }

    /// The corners of lattice cell `cell` for `seed`.
    fn corners(&mut self, cell: [i64; 3], seed: u64) -> [f64; 8] {
        let place = self.next;
        self.next += 1;
        match self.lattices.get_mut(place) {
            Some(known) if known.cell == cell && known.seed == seed => known.corners,
            Some(other) => {
                *other = Lattice::new(cell, seed);
                other.corners
            }
            None => {
                let lattice = Lattice::new(cell, seed);
                self.lattices.push(lattice);
                lattice.corners
            }
        }
    }
}

impl Lattice {
    fn new(cell: [i64; 3], seed: u64) -> Self {
        let factor = |axis: usize, step: usize| {
            (cell[axis].wrapping_add(step as i64) as u64).wrapping_mul(AXIS_FACTORS[axis])
        };
        let corner = |corner: usize| {
            let [x, y, z] = std::array::from_fn(|axis| factor(axis, corner >> axis & 1));
            signed_unit(mix(x ^ y ^ z ^ seed))
        };
        Self { cell, seed, corners: std::array::from_fn(corner) }
    }
}

/// Smooth noise in [−1, 1) with a lattice of spacing 1: hashed values at lattice points, cubic
/// Hermite weights between them.
pub(super) fn smooth_noise(point: DVec3, seed: u64, memory: &mut NoiseMemory) -> f64 {
    let base = point.floor();
    let t = point - base;
    let w = t * t * (DVec3::splat(3.0) - 2.0 * t);
    let corners = memory.corners(base.to_array().map(|c| c as i64), seed);
    let along_x = |row: usize| corners[row] + w.x * (corners[row + 1] - corners[row]);
    let along_y = |plane: usize| {
        let below = along_x(plane);
        below + w.y * (along_x(plane + 2) - below)
    };
    let below = along_y(0);
    below + w.z * (along_y(4) - below)
}

/// Octaves of [`smooth_noise`], each at half the spacing and `persistence` times the amplitude
/// of the one before.
pub(super) fn fractal_noise(
    point: DVec3,
    octaves: u32,
    persistence: f64,
    seed: u64,
    memory: &mut NoiseMemory,
) -> f64 {
    let (mut sum, mut amplitude, mut frequency) = (0.0, 1.0, 1.0);
    for octave in 0..octaves {
        let octave_seed = seed.wrapping_add(mix(octave.into()));
        sum += amplitude * smooth_noise(point * frequency, octave_seed, memory);
        amplitude *= persistence;
        frequency *= 2.0;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smooth_noise_is_continuous_across_its_lattice_and_not_constant() {
        let step = 1e-9;
        let smooth_noise = |point| smooth_noise(point, 1, &mut NoiseMemory::default());
        for i in -3..4 {
            let below = smooth_noise(DVec3::new(f64::from(i) - step, 0.3, -7.6));
            let above = smooth_noise(DVec3::new(f64::from(i) + step, 0.3, -7.6));
            assert!((below - above).abs() < 1e-8, "{i}: {below} {above}");
        }
        let values: Vec<f64> =
            (0..64).map(|i| smooth_noise(DVec3::splat(f64::from(i) * 0.7))).collect();
        assert!(values.iter().any(|&v| v > 0.2) && values.iter().any(|&v| v < -0.2));
    }

    #[test]
    fn what_is_remembered_changes_nothing() {
        let mut memory = NoiseMemory::default();
        for i in 0..200 {
            let point = DVec3::new(0.07, -0.05, 0.03) * f64::from(i);
            memory.restart();
            let again = fractal_noise(point, 4, 0.5, 9, &mut memory);
            assert_eq!(again, fractal_noise(point, 4, 0.5, 9, &mut NoiseMemory::default()));
        }
    }

    #[test]
    fn neighbouring_cells_and_levels_differ_in_cell_noise() {
        let here = cell_noise(5, [10, 20, 30]);
        for other in
            [cell_noise(5, [11, 20, 30]), cell_noise(5, [20, 10, 30]), cell_noise(6, [10, 20, 30])]
        {
            assert_ne!(here, other);
        }
    }
}
