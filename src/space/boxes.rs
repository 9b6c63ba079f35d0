//! Boxes of cell indices.

/// A half-open box of cell indices of one level: `lo <= i < hi` along each axis (x, y, z).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct IndexBox {
    /// First index along each axis.
    pub lo: [i128; 3],
    /// One past the last index along each axis.
    pub hi: [i128; 3],
}

impl IndexBox {
    /// The box of `size` cells that starts at `lo`.
    pub fn at(lo: [i128; 3], size: [u32; 3]) -> Self {
        Self { lo, hi: std::array::from_fn(|a| lo[a] + i128::from(size[a])) }
    }

    /// What both boxes hold; empty (see [`Self::is_empty`]) where they are apart.
    pub fn intersection(&self, other: &Self) -> Self {
        Self {
            lo: std::array::from_fn(|a| self.lo[a].max(other.lo[a])),
            hi: std::array::from_fn(|a| self.hi[a].min(other.hi[a])),
        }
    }

    /// Whether no cell lies inside.
    pub fn is_empty(&self) -> bool {
        (0..3).any(|a| self.lo[a] >= self.hi[a])
    }

    /// Whether every cell of `other` lies inside.
    pub fn contains(&self, other: &Self) -> bool {
        (0..3).all(|a| self.lo[a] <= other.lo[a] && other.hi[a] <= self.hi[a])
    }

    /// The box of the cells `2^steps` times as large that touch this box.
    pub fn coarsened(&self, steps: u32) -> Self {
        Self {
            lo: self.lo.map(|i| i >> steps),
            hi: self.hi.map(|i| (i + (1 << steps) - 1) >> steps),
        }
    }

    /// Extents along each axis, in cells.
    pub fn size(&self) -> [i128; 3] {
        std::array::from_fn(|a| self.hi[a] - self.lo[a])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coarsening_rounds_outward_below_zero_too() {
        let fine = IndexBox { lo: [-3, 0, 5], hi: [-1, 1, 8] };
        assert_eq!(fine.coarsened(1), IndexBox { lo: [-2, 0, 2], hi: [0, 1, 4] });
        assert_eq!(fine.coarsened(3), IndexBox { lo: [-1, 0, 0], hi: [0, 1, 1] });
    }

    #[test]
    fn boxes_that_only_touch_share_nothing() {
        let a = IndexBox::at([0, 0, 0], [4, 4, 4]);
        let b = IndexBox::at([4, 0, 0], [4, 4, 4]);
        assert!(a.intersection(&b).is_empty());
        assert!(!a.contains(&b));
        assert!(a.contains(&IndexBox::at([1, 2, 3], [3, 2, 1])));
    }
}
