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

/// Smooth noise in [−1, 1) with a lattice of spacing 1: hashed values at lattice points, cubic
/// Hermite weights between them.
pub(super) fn smooth_noise(point: DVec3, seed: u64) -> f64 {
    let base = point.floor();
    let t = point - base;
    let w = t * t * (DVec3::splat(3.0) - 2.0 * t);
    let lattice: [[u64; 2]; 3] = std::array::from_fn(|axis| {
        let i = base[axis] as i64;
        [i, i.wrapping_add(1)].map(|i| (i as u64).wrapping_mul(AXIS_FACTORS[axis]))
    });
    let corner = |x: usize, y: usize, z: usize| {
        signed_unit(mix(lattice[0][x] ^ lattice[1][y] ^ lattice[2][z] ^ seed))
    };
    let along_x = |y, z| corner(0, y, z) + w.x * (corner(1, y, z) - corner(0, y, z));
    let along_y = |z| along_x(0, z) + w.y * (along_x(1, z) - along_x(0, z));
    along_y(0) + w.z * (along_y(1) - along_y(0))
}

/// Octaves of [`smooth_noise`], each at half the spacing and `persistence` times the amplitude
/// of the one before.
pub(super) fn fractal_noise(point: DVec3, octaves: u32, persistence: f64, seed: u64) -> f64 {
    let (mut sum, mut amplitude, mut frequency) = (0.0, 1.0, 1.0);
    for octave in 0..octaves {
        sum += amplitude * smooth_noise(point * frequency, seed.wrapping_add(mix(octave.into())));
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
        for i in -3..4 {
            let below = smooth_noise(DVec3::new(f64::from(i) - step, 0.3, -7.6), 1);
            let above = smooth_noise(DVec3::new(f64::from(i) + step, 0.3, -7.6), 1);
            assert!((below - above).abs() < 1e-8, "{i}: {below} {above}");
        }
        let values: Vec<f64> =
            (0..64).map(|i| smooth_noise(DVec3::splat(f64::from(i) * 0.7), 1)).collect();
        assert!(values.iter().any(|&v| v > 0.2) && values.iter().any(|&v| v < -0.2));
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
