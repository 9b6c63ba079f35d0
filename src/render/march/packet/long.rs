//! Numbers as sums of two f32.

use crate::lanes::Lanes;

/// A number as the sum of two f32, the second of which is what the first one's rounding left, or
/// little more.
pub(super) type Long<L> = [<L as Lanes>::Float; 2];

/// a − b in one f32: where they are close, as exact as the second numbers are.
#[inline(always)]
pub(super) fn apart<L: Lanes>(l: L, a: Long<L>, b: Long<L>) -> L::Float {
    l.add(l.sub(a[0], b[0]), l.sub(a[1], b[1]))
}

/// a − b as a sum of two f32.
#[inline(always)]
pub(super) fn difference<L: Lanes>(l: L, a: Long<L>, b: Long<L>) -> Long<L> {
    let [near, rest] = sum(l, a[0], l.sub(l.splat(0.0), b[0]));
    sum(l, near, l.add(rest, l.sub(a[1], b[1])))
}

/// `a` where the mask is set, else `b`.
#[inline(always)]
pub(super) fn select<L: Lanes>(l: L, mask: L::Mask, a: Long<L>, b: Long<L>) -> Long<L> {
    [l.select(mask, a[0], b[0]), l.select(mask, a[1], b[1])]
}

/// a + b, exactly (Knuth, *The Art of Computer Programming* 2, 4.2.2).
#[inline(always)]
pub(super) fn sum<L: Lanes>(l: L, a: L::Float, b: L::Float) -> Long<L> {
    let sum = l.add(a, b);
    let of_b = l.sub(sum, a);
    let of_a = l.sub(sum, of_b);
    [sum, l.add(l.sub(a, of_a), l.sub(b, of_b))]
}

/// 1 − a, for a from 0 to 1.
#[inline(always)]
pub(super) fn left_of_one<L: Lanes>(l: L, a: Long<L>) -> Long<L> {
    let one = l.splat(1.0);
    let near = l.sub(one, a[0]);
    [near, l.sub(l.sub(l.sub(one, near), a[0]), a[1])]
}

/// a·b of single numbers, as a sum of two: exact but for underflow.
#[inline(always)]
pub(super) fn product<L: Lanes>(l: L, a: L::Float, b: L::Float) -> Long<L> {
    let product = l.mul(a, b);
    [product, l.fused(a, b, l.sub(l.splat(0.0), product))]
}

/// a·b of a sum of two and a single number, as a sum of two.
#[inline(always)]
pub(super) fn times<L: Lanes>(l: L, a: Long<L>, b: L::Float) -> Long<L> {
    let [near, rest] = product(l, a[0], b);
    [near, l.fma(a[1], b, rest)]
}

/// a·b of two numbers that are sums of two, as a sum of two; the product of both second numbers is
/// left out.
#[inline(always)]
pub(super) fn long_product<L: Lanes>(l: L, a: Long<L>, b: Long<L>) -> Long<L> {
    let [near, rest] = product(l, a[0], b[0]);
    [near, l.fma(a[1], b[0], l.fma(a[0], b[1], rest))]
}
