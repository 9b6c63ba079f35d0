//! The range of a payload's values.

use crate::cache::{EMPTY_RANGE, RawBrick, state};
use crate::lanes::{Kernel, Lanes, Width};

/// Values that are compared side by side.
const LANES: usize = 8;

/// [min, max] of all values that exist in the payload, and whether NaN is among them.
pub(super) fn range(raw: &RawBrick) -> ([f32; 2], bool) {
    Width::best().run(Range(raw))
}

struct Range<'r>(&'r RawBrick);

impl Kernel for Range<'_> {
    type Output = ([f32; 2], bool);

    #[inline(always)]
    fn run<L: Lanes>(self, _: L) -> ([f32; 2], bool) {
        let (mut many, mut single) = (Extent::<LANES>::NONE, Extent::<1>::NONE);
        for block in &self.0.blocks {
            let (values, last) = block.values.as_chunks();
            let (states, last_states) = block.states.as_chunks();
            values.iter().zip(states).for_each(|(values, states)| many.widen(values, states));
            let last = last.as_chunks().0.iter().zip(last_states.as_chunks().0);
            last.for_each(|(value, bits)| single.widen(value, bits));
        }
        let least = many.least.into_iter().fold(single.least[0], f32::min);
        let most = many.most.into_iter().fold(single.most[0], f32::max);
        ([least, most], many.nan.into_iter().chain(single.nan).any(|nan| nan))
    }
}

/// What lies between what and what, of every `N`th value.
struct Extent<const N: usize> {
    least: [f32; N],
    most: [f32; N],
    nan: [bool; N],
}

impl<const N: usize> Extent<N> {
    const NONE: Self =
        Self { least: [EMPTY_RANGE[0]; N], most: [EMPTY_RANGE[1]; N], nan: [false; N] };

    #[inline(always)]
    fn widen(&mut self, values: &[f32; N], states: &[u8; N]) {
        for n in 0..N {
            let (value, exists) = (values[n], states[n] & state::EXISTS != 0);
            self.least[n] = if exists & (value < self.least[n]) { value } else { self.least[n] };
            self.most[n] = if exists & (value > self.most[n]) { value } else { self.most[n] };
            self.nan[n] |= exists & value.is_nan();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cache::BrickShape;

    #[test]
    fn it_is_that_of_the_values_that_exist() {
        for (edge, blocks) in [(8, 1), (8, 4), (16, 2)] {
            let mut raw = RawBrick::default();
            raw.fit(BrickShape::new(edge).unwrap(), blocks);
            assert_eq!(range(&raw), (EMPTY_RANGE, false));
            for (up, block) in raw.blocks.iter_mut().enumerate() {
                for (n, value) in block.values.iter_mut().enumerate() {
                    let at = (n as u32 + 1).wrapping_mul(0x9e37_79b9) >> 8;
                    *value = (at as f32).sin() * (up + 1) as f32;
                    block.states[n] = if at.is_multiple_of(3) { 0 } else { state::EXISTS };
                }
            }
            let cells = raw.blocks.iter().flat_map(|block| block.values.iter().zip(&block.states));
            let existing = cells.filter(|(_, bits)| **bits != 0).map(|(&value, _)| value);
            let expected = existing.fold(EMPTY_RANGE, |[a, b], v| [a.min(v), b.max(v)]);
            assert_eq!(range(&raw), (expected, false));
            let Some(last) = raw.blocks.last_mut() else { unreachable!() };
            let hole = last.states.iter().position(|&bits| bits == 0).unwrap();
            last.values[hole] = f32::NAN;
            assert_eq!(range(&raw), (expected, false));
            let Some(last) = raw.blocks.last_mut() else { unreachable!() };
            last.states[hole] = state::EXISTS;
            assert_eq!(range(&raw), (expected, true));
        }
    }
}
