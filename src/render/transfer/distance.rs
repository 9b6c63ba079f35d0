//! How far a brick's values are from those that they stand for.

use crate::scene::Rounding;

/// Values farther off than this count by the transfer function's whole variation over the range
/// that they may take, steps included; nearer ones by its slope, and steps where they are met.
pub(crate) const FAR: f64 = 1e-3;

/// How far from the truth a brick's values are, in x.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Distance {
    /// Bound of the difference to the finest interpolant, where children hide.
    pub(crate) residual: f64,
    /// Which octants have children.
    pub(crate) child_mask: u8,
    /// Whether something is shown where there is nothing beneath.
    pub(crate) fills_void: bool,
    /// What x can be in the brick's box at any level.
    pub(crate) tree: [f64; 2],
    /// How far stored values are from those of the source, averages included.
    pub(crate) storage: Rounding,
    /// How far stored values of leaf cells are from those of the source.
    pub(crate) leaf_storage: Rounding,
    /// Whether values are read in fewer digits than are stored: then that is what makes the two above,
    /// and finer cuts change it.
    pub(crate) is_rounded: bool,
}

impl Distance {
    /// How far values beneath are, if that is near.
    pub(crate) fn near_beneath(&self) -> f64 {
        if self.residual < FAR && self.child_mask != 0 { self.residual } else { 0.0 }
    }

    /// What values beneath may be in whose place there are some between `low` and `high`.
    pub(crate) fn range_beneath(&self, range: [f64; 2]) -> [f64; 2] {
        range_beneath(range, self.residual, self.tree)
    }

    /// None: nothing lies beneath, and values within `tree` are the source's.
    pub(crate) fn none(tree: [f64; 2]) -> Self {
        let stored = Rounding::default();
        Self {
            residual: 0.0,
            child_mask: 0,
            fills_void: false,
            tree,
            storage: stored,
            leaf_storage: stored,
            is_rounded: false,
        }
    }
}

/// What values may be that are no more than `beneath` from some between `low` and `high`, and within
/// `tree` if these are.
pub(super) fn range_beneath([low, high]: [f64; 2], beneath: f64, tree: [f64; 2]) -> [f64; 2] {
    [(low - beneath).max(tree[0].min(low)), (high + beneath).min(tree[1].max(high))]
}
