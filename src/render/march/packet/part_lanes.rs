//! Parts of few rays' stretches dealt to all lanes, so that none are idle.
#![allow(clippy::needless_range_loop)]

use crate::lanes::{Lanes, MOST_LANES, Row};

/// Which ray's part is in which lane. All parts of a ray are side by side, as far as there is room.
pub(super) struct PartLanes<L: Lanes> {
    /// The lanes whose rays take part, one bit each.
    pub(super) rays: u32,
    /// Parts of a ray at a time.
    pub(super) abreast: u32,
    /// In each lane the number of its part.
    pub(super) number: L::Float,
    /// In each lane the lane of its part's ray.
    ray: L::Index,
    /// In each ray's lane that of its first part.
    first: L::Float,
    /// The lanes with first parts, one bit each.
    firsts: u32,
}

impl<L: Lanes> PartLanes<L> {
    /// Deals so many parts of each of the first rays in `lanes`, of which there is one at least.
    #[inline(always)]
    pub(super) fn new(l: L, lanes: u32, parts: u32) -> Self {
        let abreast = parts.min(L::COUNT as u32);
        // Lanes that are left over do as the first ray's.
        let mut ray = Row([lanes.trailing_zeros() as f32; MOST_LANES]);
        let (mut number, mut first) = (Row::ZERO, Row::ZERO);
        let (mut rays, mut firsts, mut left) = (0, 0, lanes);
        let mut lane = 0;
        while left != 0 && lane + abreast as usize <= L::COUNT {
            let own = left.trailing_zeros();
            first.0[own as usize % MOST_LANES] = lane as f32;
            (rays, firsts, left) = (rays | 1 << own, firsts | 1 << lane, left & (left - 1));
            for n in 0..abreast {
                (ray.0[lane], number.0[lane]) = (own as f32, n as f32);
                lane += 1;
            }
        }
        let (ray, number) = (l.index(l.load(&ray)), l.load(&number));
        Self { rays, abreast, number, ray, first: l.load(&first), firsts }
    }

    /// In each lane what `x` is for its part's ray.
    #[inline(always)]
    pub(super) fn ray_of(&self, l: L, x: L::Float) -> L::Float {
        l.deal(x, self.ray)
    }

    /// In each ray's lane that of its part number `n`.
    #[inline(always)]
    pub(super) fn part(&self, l: L, n: u32) -> L::Index {
        l.index(l.add(self.first, l.splat(n as f32)))
    }

    /// In each lane the optical depth in front of its part: of rays that have come through `depth`,
    /// and parts of depths `parts`. And in each ray's lane that behind its last one.
    #[inline(always)]
    pub(super) fn in_front(&self, l: L, mut depth: L::Float, parts: L::Float) -> [L::Float; 2] {
        let mut in_front = depth;
        for n in 0..self.abreast {
            in_front = l.select(l.mask(self.firsts << n), self.ray_of(l, depth), in_front);
            depth = l.add(depth, l.deal(parts, self.part(l, n)));
        }
        [in_front, depth]
    }
}

#[cfg(test)]
mod tests {
    use std::array::from_fn;

    use proptest::prelude::*;

    use super::*;
    use crate::lanes::{Kernel, Width};

    /// Deals parts, of a depth each, of the rays in `lanes`, which have come through `before`.
    struct Dealt {
        lanes: u32,
        parts: u32,
        before: [f32; MOST_LANES],
        depths: [f32; MOST_LANES],
    }

    /// What is found in each lane.
    struct Found {
        rays: u32,
        abreast: u32,
        numbers: [f32; MOST_LANES],
        ray_of: [f32; MOST_LANES],
        in_front: [f32; MOST_LANES],
        /// For each part the lane that it is in, in its ray's lane.
        parts: Vec<[f32; MOST_LANES]>,
    }

    fn stored<L: Lanes>(l: L, x: L::Float) -> [f32; MOST_LANES] {
        let mut row = Row::ZERO;
        l.store(x, &mut row);
        row.0
    }

    impl Kernel for &Dealt {
        type Output = Found;

        #[inline(always)]
        fn run<L: Lanes>(self, l: L) -> Found {
            let deal = PartLanes::new(l, self.lanes & ((1 << L::COUNT) - 1), self.parts);
            let lanes = l.load(&Row(from_fn(|n| n as f32)));
            let (before, depths) = (l.load(&Row(self.before)), l.load(&Row(self.depths)));
            let mut parts = Vec::new();
            for n in 0..deal.abreast {
                parts.push(stored(l, l.float(deal.part(l, n))));
            }
            Found {
                rays: deal.rays,
                abreast: deal.abreast,
                numbers: stored(l, deal.number),
                ray_of: stored(l, deal.ray_of(l, lanes)),
                in_front: stored(l, deal.in_front(l, before, depths)[0]),
                parts,
            }
        }
    }

    proptest! {
        #[test]
        fn parts_lie_behind_each_other_in_lanes_of_their_own(
            lanes in any::<u32>(),
            parts in prop_oneof![Just(4_u32), Just(16), Just(64)],
            before in prop::array::uniform16(0.0..9.0_f32),
            depths in prop::array::uniform16(0.0..9.0_f32),
        ) {
            // The narrowest kinds have 8 lanes, one of which is to have a ray.
            let dealt = Dealt { lanes: lanes | 0x10, parts, before, depths };
            for width in Width::all() {
                let found = width.run(&dealt);
                let (count, abreast) = (width.count(), found.abreast as usize);
                prop_assert_eq!(abreast, count.min(parts as usize));
                let open = dealt.lanes & ((1 << count) - 1);
                let rays: Vec<_> = (0..count).filter(|ray| open >> ray & 1 == 1).collect();
                let rays = &rays[..rays.len().min(count / abreast)];
                prop_assert_eq!(found.rays, rays.iter().fold(0, |bits, ray| bits | 1 << ray));
                for (place, ray) in rays.iter().enumerate() {
                    let mut depth = before[*ray];
                    for n in 0..abreast {
                        let lane = place * abreast + n;
                        prop_assert_eq!(found.parts[n][*ray], lane as f32);
                        prop_assert_eq!(found.ray_of[lane], *ray as f32);
                        prop_assert_eq!(found.numbers[lane], n as f32);
                        prop_assert_eq!(found.in_front[lane], depth);
                        depth += depths[lane];
                    }
                }
            }
        }
    }
}
