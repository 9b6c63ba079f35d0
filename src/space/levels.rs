//! The simulation's levels on the octree's factor-2 ladder.

use super::MAX_OCTREE_LEVEL;
use crate::{Error, Result};

/// Maps the simulation's level numbers (0 = root grid) to octree levels (factor-2 steps below
/// the root grid) and back. A refinement factor of 4 makes two steps, whose first is no level
/// of the simulation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Levels {
    octree: Vec<u32>,
}

impl Levels {
    /// Levels from the factors between them: `factors[l]` refines level `l` to `l + 1`.
    ///
    /// # Errors
    /// Factors other than 2 and 4, and more than [`MAX_OCTREE_LEVEL`] factor-2 steps.
    pub fn from_factors(factors: &[u32]) -> Result<Self> {
        let mut octree = vec![0];
        let mut step = 0;
        for (level, factor) in factors.iter().enumerate() {
            step += match factor {
                2 => 1,
                4 => 2,
                other => {
                    return Err(Error::request(format!(
                        "refinement factor {other} from level {level} to {}: only factors 2 and \
                         4 are supported",
                        level + 1
                    )));
                }
            };
            if step > MAX_OCTREE_LEVEL {
                return Err(Error::request(format!(
                    "level {} lies {step} factor-2 steps below the root grid: at most \
                     {MAX_OCTREE_LEVEL} are supported",
                    level + 1
                )));
            }
            octree.push(step);
        }
        Ok(Self { octree })
    }

    /// Number of simulation levels, the root grid's included.
    pub fn count(&self) -> usize {
        self.octree.len()
    }

    /// The octree level of simulation level `level`, if there is one.
    pub fn octree(&self, level: usize) -> Option<u32> {
        self.octree.get(level).copied()
    }

    /// The simulation level at octree level `octree`: none for the halves of factor-4 steps and
    /// beyond the deepest level.
    pub fn simulation(&self, octree: u32) -> Option<usize> {
        self.octree.binary_search(&octree).ok()
    }

    /// The deepest octree level.
    pub fn deepest(&self) -> u32 {
        self.octree.last().copied().unwrap_or(0)
    }
}

/// Cells of a domain of `root` root cells along an axis, counted at octree level `octree`; those
/// that it only touches are included.
pub fn cells_at(octree: i32, root: u64) -> i128 {
    let (root, steps) = (i128::from(root), octree.unsigned_abs().min(2 * MAX_OCTREE_LEVEL));
    if octree >= 0 { root << steps.min(MAX_OCTREE_LEVEL) } else { -(-root >> steps) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_factor_of_four_makes_two_steps() {
        let levels = Levels::from_factors(&[2, 4, 2]).unwrap();
        assert_eq!((0..4).map(|l| levels.octree(l).unwrap()).collect::<Vec<_>>(), [0, 1, 3, 4]);
        assert_eq!(levels.simulation(2), None);
        assert_eq!(levels.simulation(3), Some(2));
        assert_eq!(levels.simulation(5), None);
        assert_eq!(levels.deepest(), 4);
    }

    #[test]
    fn other_factors_and_too_many_levels_are_refused() {
        assert!(Levels::from_factors(&[2, 3]).unwrap_err().to_string().contains("factor 3"));
        assert!(Levels::from_factors(&[4; 31]).is_err());
        assert!(Levels::from_factors(&[4; 30]).is_ok());
    }
}
