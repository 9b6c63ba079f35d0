//! A bounded cache of what is loaded on demand by several threads.

use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use crate::{Error, Result};

/// Values by key, loaded at most once while they stay, at most `limit` bytes of them together
/// (and what callers still hold).
pub(super) struct LoadCache<K, V> {
    limit: usize,
    entries: Mutex<Entries<K, V>>,
}

type Slot<V> = Arc<OnceLock<std::result::Result<Arc<V>, String>>>;

struct Entries<K, V> {
    slots: HashMap<K, (Slot<V>, usize)>,
    clock: Vec<Entry<K>>,
    hand: usize,
    bytes: usize,
}

struct Entry<K> {
    key: K,
    recent: bool,
    bytes: usize,
}

impl<K: Eq + Hash + Copy, V> LoadCache<K, V> {
    pub(super) fn new(limit: usize) -> Self {
        let entries = Entries { slots: HashMap::new(), clock: Vec::new(), hand: 0, bytes: 0 };
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
            entries.slot(key, bytes, self.limit)
        };
        let loaded = slot.get_or_init(|| load().map(Arc::new).map_err(|error| error.to_string()));
        loaded.clone().map_err(Error::Request)
    }
}

impl<K: Eq + Hash + Copy, V> Entries<K, V> {
    fn slot(&mut self, key: K, bytes: usize, limit: usize) -> Slot<V> {
        if let Some((slot, place)) = self.slots.get(&key) {
            if let Some(entry) = self.clock.get_mut(*place) {
                entry.recent = true;
            }
            return Arc::clone(slot);
        }
        while self.bytes + bytes > limit && !self.clock.is_empty() {
            self.evict();
        }
        let slot = Slot::default();
        self.slots.insert(key, (Arc::clone(&slot), self.clock.len()));
        self.clock.push(Entry { key, recent: false, bytes });
        self.bytes += bytes;
        slot
    }

    /// Drops the next entry under the clock hand that was not used since it last came by.
    fn evict(&mut self) {
        self.hand %= self.clock.len();
        let entry = &mut self.clock[self.hand];
        if entry.recent {
            entry.recent = false;
            self.hand += 1;
            return;
        }
        let gone = self.clock.swap_remove(self.hand);
        self.slots.remove(&gone.key);
        self.bytes -= gone.bytes;
        if let Some(moved) = self.clock.get(self.hand)
            && let Some(slot) = self.slots.get_mut(&moved.key)
        {
            slot.1 = self.hand;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_loaded_once_while_they_stay_and_room_is_bounded() {
        let cache = LoadCache::new(4 * 10);
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
        assert_eq!(cache.entries.lock().unwrap().slots.len(), 4);
        assert_eq!(cache.entries.lock().unwrap().clock.len(), 4);
    }

    #[test]
    fn a_failed_load_is_an_error_for_everyone() {
        let cache: LoadCache<u8, u8> = LoadCache::new(10);
        for _ in 0..2 {
            let failed = cache.get(1, 1, || Err(Error::request("no such thing")));
            assert_eq!(failed.unwrap_err().to_string(), "no such thing");
        }
    }
}
