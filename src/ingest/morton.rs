//! Morton (Z) order of brick coordinates without interleaving their bits.

use std::cmp::Ordering;

/// Compares two bricks of one level in the order of a depth-first walk of the octree, octants in
/// the order `x + 2y + 4z`. Coordinates are not negative. (The axis whose coordinates differ in
/// the highest bit decides: Chan, "A minimalist's implementation of an approximate nearest
/// neighbor algorithm", 2006.)
pub(super) fn compare(a: &[u128; 3], b: &[u128; 3]) -> Ordering {
    let (mut axis, mut highest) = (2, a[2] ^ b[2]);
    for candidate in [1, 0] {
        let difference = a[candidate] ^ b[candidate];
        if highest < difference && highest < (highest ^ difference) {
            (axis, highest) = (candidate, difference);
        }
    }
    a[axis].cmp(&b[axis])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn interleaved(c: &[u128; 3]) -> u128 {
        (0..10).fold(0, |key, bit| {
            key | (0..3).fold(0, |k, a| k | (c[a] >> bit & 1) << (3 * bit + a as u32))
        })
    }

    #[test]
    fn the_order_is_that_of_interleaved_bits() {
        let mut state = 1u128;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040);
            (state >> 33) % 1000
        };
        for _ in 0..20_000 {
            let (a, b) = ([next(), next(), next()], [next(), next() % 4, next()]);
            assert_eq!(compare(&a, &b), interleaved(&a).cmp(&interleaved(&b)), "{a:?} {b:?}");
            assert_eq!(compare(&a, &a), Ordering::Equal);
        }
    }
}
