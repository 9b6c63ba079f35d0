//! Parts of few rays' stretches dealt to all lanes, so that none are idle.
#![allow(clippy::needless_range_loop)]

use crate::render::lanes::{Lanes, MOST_LANES, Row};

/// Which ray's part is in which lane. All parts of a ray are side by side, as far as there is room.
pub(super) struct Deal<L: Lanes> {
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

impl<L: Lanes> Deal<L> {
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
    /// and parts of depths `parts`.
    #[inline(always)]
    pub(super) fn in_front(&self, l: L, mut depth: L::Float, parts: L::Float) -> L::Float {
        let mut in_front = depth;
        for n in 0..self.abreast {
            in_front = l.select(l.mask(self.firsts << n), self.ray_of(l, depth), in_front);
            depth = l.add(depth, l.deal(parts, self.part(l, n)));
        }
        in_front
    }
}
