//! A bounded cache of what is loaded on demand by several threads.

use std::collections::{BTreeMap, HashMap};
use std::hash::Hash;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use crate::{Error, Result};

/// Values by key, loaded at most once while they stay, at most `limit` bytes of them together
/// (and what callers still hold).
pub(super) struct LoadCache<K, V> {
    limit: usize,
    entries: Mutex<Entries<K, V>>,
}

type Slot<V> = Arc<OnceLock<Result<Arc<V>>>>;

struct Entries<K, V> {
    known: HashMap<K, Entry<V>>,
    /// By when they were last used, about: see [`Entries::refresh`].
    order: BTreeMap<u64, K>,
    /// Uses that were noted so far.
    uses: u64,
    bytes: usize,
}

struct Entry<V> {
    slot: Slot<V>,
    used: u64,
    bytes: usize,
}

impl<K: Eq + Hash + Copy, V> LoadCache<K, V> {
    /// Bytes that an entry takes beside what its value says: its places in the map and in the order, both
    /// with room to grow, and four allocations.
    const ENTRY_BYTES: usize = 2 * (size_of::<(K, Entry<V>)>() + size_of::<(u64, K)>())
        + size_of::<OnceLock<Result<Arc<V>>>>()
        + size_of::<V>()
        + 4 * 32;

    /// An empty cache that keeps up to `limit` bytes.
    pub(super) fn new(limit: usize) -> Self {
        let (known, order) = (HashMap::new(), BTreeMap::new());
        let entries = Entries { known, order, uses: 0, bytes: 0 };
        Self { limit, entries: Mutex::new(entries) }
    }

    /// The value of `key`, which takes `bytes` bytes; loaded by `load` if it is not there.
    /// Threads that want the same value wait for the one that loads it.
    pub(super) fn get(
        &self,
        key: K,
        bytes: usize,
        load: impl FnOnce() -> Result<V>,
    ) -> Result<Arc<V>> {
        let slot = {
            let mut entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner);
            entries.slot(key, bytes + Self::ENTRY_BYTES, self.limit)
        };
        let loaded = slot.get_or_init(|| load().map(Arc::new));
        loaded.as_ref().map(Arc::clone).map_err(Error::again)
    }
}

impl<K: Eq + Hash + Copy, V> Entries<K, V> {
    fn slot(&mut self, key: K, bytes: usize, limit: usize) -> Slot<V> {
        if let Some(slot) = self.refresh(key) {
            return slot;
        }
        while self.bytes + bytes > limit
            && let Some((_, oldest)) = self.order.pop_first()
        {
            self.bytes -= self.known.remove(&oldest).map_or(0, |gone| gone.bytes);
        }
        let slot = Slot::default();
        self.uses += 1;
        self.known.insert(key, Entry { slot: Arc::clone(&slot), used: self.uses, bytes });
        self.order.insert(self.uses, key);
        self.bytes += bytes;
        slot
    }

    /// Looks `key` up. A use is noted only of what would be among the older entries else: most
    /// uses follow others closely.
    fn refresh(&mut self, key: K) -> Option<Slot<V>> {
        let count = self.known.len() as u64;
        let entry = self.known.get_mut(&key)?;
        if self.uses - entry.used > count / 4 {
            self.uses += 1;
            self.order.remove(&entry.used);
            self.order.insert(self.uses, key);
            entry.used = self.uses;
        }
        Some(Arc::clone(&entry.slot))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_loaded_once_while_they_stay_and_room_is_bounded() {
        let cache = LoadCache::new(4 * (10 + LoadCache::<u32, u32>::ENTRY_BYTES));
        let loads = std::cell::Cell::new(0);
        let get = |key: u32| {
            *cache
                .get(key, 10, || {
                    loads.set(loads.get() + 1);
                    Ok(key * 2)
                })
                .unwrap()
        };
        for key in 0..4 {
            assert_eq!((get(key), get(key)), (key * 2, key * 2));
        }
        assert_eq!(loads.get(), 4);
        for key in 4..100 {
            assert_eq!(get(key), key * 2);
        }
        assert_eq!(cache.entries.lock().unwrap().known.len(), 4);
        assert_eq!(cache.entries.lock().unwrap().order.len(), 4);
    }

    #[test]
    fn what_was_used_last_is_given_up_last() {
        let cache = LoadCache::new(20 * (10 + LoadCache::<u32, u32>::ENTRY_BYTES));
        let mut loads = 0;
        // A walk that returns to each key 9 steps later, and in between uses 18 others.
        for step in 0..1000_u32 {
            for key in [step, step.saturating_sub(9)] {
                cache
                    .get(key, 10, || {
                        loads += 1;
                        Ok(key)
                    })
                    .unwrap();
            }
        }
        assert_eq!(loads, 1000);
    }

    #[test]
    fn a_failed_load_is_an_error_for_everyone() {
        let cache: LoadCache<u8, u8> = LoadCache::new(10);
        for _ in 0..2 {
            let failed = cache.get(1, 1, || Err(Error::request("no such thing")));
            assert_eq!(failed.unwrap_err().to_string(), "no such thing");
        }
        // Of whatever kind it is.
        let load = || {
            let source = std::io::Error::from(std::io::ErrorKind::NotFound);
            Err(Error::io("a.cpu0000", "cannot read", source))
        };
        for _ in 0..2 {
            let failed = cache.get(2, 1, load).unwrap_err();
            let is_kept = |source: &std::io::Error| source.kind() == std::io::ErrorKind::NotFound;
            assert!(matches!(&failed, Error::Io { source, .. } if is_kept(source)), "{failed:?}");
        }
    }
}
