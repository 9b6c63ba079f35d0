//! Byte planes: of many 4-byte values all first bytes, then all second ones and so on, in which
//! compression finds more to save.

/// Splits `values` into planes of as many bytes each: little-endian, the lowest bytes first.
/// Whatever is longer than the shortest of all is left as it is.
pub fn split(values: &[f32], planes: [&mut [u8]; 4]) {
    for (shift, plane) in [0, 8, 16, 24].into_iter().zip(planes) {
        for (byte, value) in plane.iter_mut().zip(values) {
            *byte = (value.to_bits() >> shift) as u8;
        }
    }
}

/// Puts together what [`split`] has split.
pub fn join([a, b, c, d]: [&[u8]; 4], values: &mut [f32]) {
    let planes = a.iter().zip(b).zip(c.iter().zip(d));
    for (value, ((&a, &b), (&c, &d))) in values.iter_mut().zip(planes) {
        *value = f32::from_le_bytes([a, b, c, d]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of every kind, NaN with bits of its own among them.
    fn values(count: usize) -> Vec<f32> {
        let bits = |n: usize| (n as u32).wrapping_mul(0x9e37_79b9) ^ 0x7fc1_2345;
        (0..count).map(|n| f32::from_bits(bits(n))).collect()
    }

    #[test]
    fn planes_are_those_of_a_plain_loop_and_join_to_the_same_bits() {
        for count in [0, 1, 7, 15, 16, 17, 33, 216, 1000, 5832] {
            let values = values(count);
            let mut planes = vec![vec![0u8; count]; 4];
            let [a, b, c, d] = planes.as_mut_slice() else { unreachable!() };
            split(&values, [a, b, c, d]);
            for (n, value) in values.iter().enumerate() {
                for (plane, byte) in planes.iter().zip(value.to_le_bytes()) {
                    assert_eq!(plane[n], byte, "{n} of {count}");
                }
            }
            let mut joined = vec![0.0; count];
            join([0, 1, 2, 3].map(|n| &planes[n][..]), &mut joined);
            let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&joined), bits(&values));
        }
    }
}
