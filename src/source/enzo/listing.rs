//! A grid as a hierarchy file lists it, before it is placed on its level's lattice.

use crate::Result;
use crate::source::lines::printing_error;
use crate::space::{AXES, Decimal};

/// Digits that Enzo prints of an edge (`%.14g`), unless it computes with positions of 128 bits.
pub(super) const PRINTED_DIGITS: i32 = 14;

/// One coordinate of a grid's corner, code length.
#[derive(Debug, Clone)]
pub(super) enum Edge {
    /// The number that the code held, as the sum of two doubles.
    Exact([f64; 2]),
    /// Decimal text.
    Printed {
        /// The number as printed.
        text: String,
        /// Its nearest double.
        value: f64,
        /// How many digits the file has of numbers that need them.
        digits: i32,
    },
}

impl Edge {
    /// The nearest double.
    pub(super) fn value(&self) -> f64 {
        match self {
            Self::Exact([value, _]) | Self::Printed { value, .. } => *value,
        }
    }

    /// The number as listed, exactly.
    pub(super) fn decimal(&self) -> Result<Decimal> {
        match self {
            Self::Exact([value, 0.0]) => Decimal::from_f64(*value),
            Self::Exact([value, rest]) => {
                Ok(Decimal::from_f64(*value)?.minus(&Decimal::from_f64(-rest)?))
            }
            Self::Printed { text, .. } => Decimal::parse(text),
        }
    }

    /// Largest difference from the number that the code held.
    pub(super) fn error(&self) -> f64 {
        match self {
            Self::Printed { text, value, digits } => printing_error(text, *value, *digits),
            Self::Exact(_) => 0.0,
        }
    }
}

/// One grid of a hierarchy file.
#[derive(Debug, Clone)]
pub(super) struct ListedGrid {
    /// Enzo's number of the grid, from 1.
    pub(super) id: u64,
    /// The level, where the file states it.
    pub(super) level: Option<u32>,
    /// First active cell among the grid's cells with ghost zones.
    pub(super) start: [i64; 3],
    /// Last active cell, inclusive.
    pub(super) end: [i64; 3],
    /// Lower corner.
    pub(super) left: [Edge; 3],
    /// Upper corner.
    pub(super) right: [Edge; 3],
    /// The data file's name, as written.
    pub(super) file: String,
    /// Whether particles lie in the grid.
    pub(super) has_particles: bool,
}

/// Grids of one level that tell what fields there are.
#[derive(Debug, Clone, Default)]
pub(super) struct Samples {
    /// The first.
    pub(super) first: Option<ListedGrid>,
    /// The first in which particles lie.
    pub(super) with_particles: Option<ListedGrid>,
    /// How many have been looked at.
    looked_at: u32,
}

impl Samples {
    /// Looks at a grid.
    pub(super) fn look_at(&mut self, grid: ListedGrid) {
        self.looked_at = self.looked_at.saturating_add(1);
        if grid.has_particles && self.with_particles.is_none() {
            self.with_particles = Some(grid.clone());
        }
        self.first.get_or_insert(grid);
    }

    /// Whether another grid may tell more, of the first `most`.
    pub(super) fn want_more(&self, most: u32) -> bool {
        self.with_particles.is_none() && self.looked_at < most
    }
}

impl ListedGrid {
    /// Active cells along x, y, z.
    ///
    /// # Errors
    /// The reason, where the indices make no grid.
    pub(super) fn size(&self) -> Result<[u32; 3], String> {
        let mut size = [0; 3];
        for a in 0..3 {
            let cells = self.end[a].checked_sub(self.start[a]).and_then(|n| n.checked_add(1));
            size[a] = cells
                .filter(|&n| n > 0 && n <= i64::from(i32::MAX))
                .and_then(|n| u32::try_from(n).ok())
                .ok_or_else(|| {
                    format!(
                        "GridStartIndex {} and GridEndIndex {} along {} make no grid",
                        self.start[a], self.end[a], AXES[a]
                    )
                })?;
        }
        Ok(size)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(text: &str) -> f64 {
        let value = text.parse().unwrap();
        Edge::Printed { text: text.into(), value, digits: PRINTED_DIGITS }.error()
    }

    #[test]
    fn the_error_is_half_a_unit_of_the_last_digit_printed() {
        let close = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-6;
        assert!(close(error("0.61379600088549"), 0.5e-14));
        assert!(close(error("0.5"), 0.5e-14));
        assert!(close(error("-12.5"), 0.5e-12));
        assert!(close(error("0.061379600088549"), 0.5e-15));
        assert!(close(error("0.6137960008854861"), 0.5e-16));
        assert!(close(error("1.25e-05"), 0.5e-18));
        assert_eq!(error("0"), 0.0);
    }
}
