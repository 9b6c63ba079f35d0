//! The rates of a brick's groups, kept with the brick: rays that stand for areas come through it many
//! times, and grading takes as long as marching some of them.

use std::sync::{Mutex, MutexGuard, PoisonError};

use super::relief::Relief;

/// What rates depend on beside the brick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Key {
    /// The number of the transfer function that packets march by.
    pub(crate) transfer: u64,
    /// Whether something lies beneath.
    pub(crate) hides: bool,
    /// Whether the way through a cell may be cut into many parts.
    pub(crate) is_fine: bool,
}

/// The last rates that were found with few and with many parts. The memory is reused from brick to
/// brick.
#[derive(Debug, Default)]
pub(crate) struct KeptRates(Mutex<[Kept; 2]>);

#[derive(Debug, Default)]
struct Kept {
    key: Option<Key>,
    rates: Vec<u32>,
}

impl KeptRates {
    /// Most heap bytes for a brick of `edge` cells.
    pub(crate) fn bytes(edge: usize) -> u64 {
        (2 * size_of::<u32>() * Relief::side_of(edge).pow(3)) as u64
    }

    /// Forgets all.
    pub(crate) fn clear(&mut self) {
        self.lock().iter_mut().for_each(|kept| kept.key = None);
    }

    /// Puts the rates of a key into `rates`: kept ones, or what `find` adds to an empty vector.
    pub(crate) fn fill(&self, key: Key, rates: &mut Vec<u32>, find: impl FnOnce(&mut Vec<u32>)) {
        let number = usize::from(key.is_fine);
        rates.clear();
        {
            let kept = &self.lock()[number];
            if kept.key == Some(key) {
                rates.extend_from_slice(&kept.rates);
                return;
            }
        }
        find(rates);
        let kept = &mut self.lock()[number];
        kept.key = Some(key);
        kept.rates.clear();
        kept.rates.reserve_exact(rates.len());
        kept.rates.extend_from_slice(rates);
    }

    fn lock(&self) -> MutexGuard<'_, [Kept; 2]> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_found_once_for_each_key() {
        let mut kept = KeptRates::default();
        let rough = Key { transfer: 1, hides: false, is_fine: false };
        let fine = Key { is_fine: true, ..rough };
        let mut rates = vec![9];
        kept.fill(rough, &mut rates, |rates| rates.extend([1, 2]));
        kept.fill(fine, &mut rates, |rates| rates.extend([3]));
        kept.fill(rough, &mut rates, |_| panic!("these are known"));
        assert_eq!(rates, [1, 2]);
        kept.fill(fine, &mut rates, |_| panic!("these are known"));
        assert_eq!(rates, [3]);
        for other in [Key { transfer: 2, ..rough }, Key { hides: true, ..rough }] {
            kept.fill(other, &mut rates, |rates| rates.extend([4, 5, 6]));
            assert_eq!(rates, [4, 5, 6]);
        }
        kept.clear();
        kept.fill(fine, &mut rates, |rates| rates.push(7));
        assert_eq!(rates, [7]);
    }
}
