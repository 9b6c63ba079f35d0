//! What the pool counts.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use super::Loaded;

/// Keys below this are told apart exactly when loads are counted as first or further ones; with
/// larger keys two bricks may share a mark (by the key's hash), and the second one's first load
/// then counts as a further one. It keeps the marks within 2 MiB.
pub(crate) const LARGEST_EXACT_KEY: u64 = 1 << 24;

/// Counts loads, exactly and from any thread.
#[derive(Debug)]
pub(crate) struct Counters {
    /// One bit a key: loaded before.
    marks: Vec<AtomicU64>,
    first_loads: Vec<AtomicU64>,
    further_loads: AtomicU64,
    bytes_read: AtomicU64,
    bytes_decompressed: AtomicU64,
    reading_nanoseconds: AtomicU64,
    waited_nanoseconds: AtomicU64,
    worked_nanoseconds: AtomicU64,
}

impl Counters {
    /// Counters for keys below `keys` at `levels` levels.
    pub(crate) fn new(keys: u64, levels: usize) -> Self {
        let words = usize::try_from(Self::bytes(keys) / 8).unwrap_or(0);
        Self {
            marks: zeros(words),
            first_loads: zeros(levels),
            further_loads: AtomicU64::new(0),
            bytes_read: AtomicU64::new(0),
            bytes_decompressed: AtomicU64::new(0),
            reading_nanoseconds: AtomicU64::new(0),
            waited_nanoseconds: AtomicU64::new(0),
            worked_nanoseconds: AtomicU64::new(0),
        }
    }

    /// Bytes that the marks of keys below `keys` take.
    pub(crate) fn bytes(keys: u64) -> u64 {
        8 * keys.clamp(1, LARGEST_EXACT_KEY).div_ceil(64)
    }

    /// Bricks of `level` that were loaded at least once.
    pub(crate) fn distinct_at(&self, level: usize) -> u64 {
        self.first_loads.get(level).map_or(0, load)
    }

    /// Bricks that were loaded at least once.
    pub(crate) fn distinct(&self) -> u64 {
        self.first_loads.iter().map(load).sum()
    }

    /// Loads of bricks that had been loaded before.
    pub(crate) fn reloaded(&self) -> u64 {
        load(&self.further_loads)
    }

    /// What all loads together took from the file.
    pub(crate) fn loaded(&self) -> Loaded {
        Loaded {
            read: load(&self.bytes_read),
            decompressed: load(&self.bytes_decompressed),
            reading: time(&self.reading_nanoseconds),
        }
    }

    /// Time that users spent until bricks they asked for were read, or loaded by others, all
    /// threads together.
    pub(crate) fn waited(&self) -> Duration {
        time(&self.waited_nanoseconds)
    }

    /// Time that users spent on preparing bricks themselves after these had been read, all threads
    /// together.
    pub(crate) fn worked(&self) -> Duration {
        time(&self.worked_nanoseconds)
    }

    /// Counts a load of brick `key`, as its first at `level` or as a further one, and what it took
    /// from the file. A first load at a level that the counters do not have is not counted.
    pub(crate) fn count_load(&self, key: u64, level: usize, loaded: &Loaded) {
        self.bytes_read.fetch_add(loaded.read, Ordering::Relaxed);
        self.bytes_decompressed.fetch_add(loaded.decompressed, Ordering::Relaxed);
        add(&self.reading_nanoseconds, loaded.reading);
        if self.mark(key) {
            self.further_loads.fetch_add(1, Ordering::Relaxed);
        } else if let Some(count) = self.first_loads.get(level) {
            count.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Adds to [`Self::waited`].
    pub(super) fn count_wait(&self, time: Duration) {
        add(&self.waited_nanoseconds, time);
    }

    /// Adds to [`Self::worked`].
    pub(super) fn count_work(&self, time: Duration) {
        add(&self.worked_nanoseconds, time);
    }

    /// Marks `key`; whether it was marked before.
    fn mark(&self, key: u64) -> bool {
        let bits = 64 * self.marks.len() as u64;
        // Fibonacci hashing spreads neighbouring keys over the marks.
        let hashed = key.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
        let bit = if key < bits { key } else { hashed % bits };
        let word = usize::try_from(bit / 64).unwrap_or(0);
        let mask = 1 << (bit % 64);
        self.marks[word].fetch_or(mask, Ordering::Relaxed) & mask != 0
    }
}

fn zeros(count: usize) -> Vec<AtomicU64> {
    (0..count).map(|_| AtomicU64::new(0)).collect()
}

fn load(counter: &AtomicU64) -> u64 {
    counter.load(Ordering::Relaxed)
}

fn time(nanoseconds: &AtomicU64) -> Duration {
    Duration::from_nanos(load(nanoseconds))
}

fn add(nanoseconds: &AtomicU64, time: Duration) {
    let more = u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
    nanoseconds.fetch_add(more, Ordering::Relaxed);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_and_further_loads_are_told_apart() {
        let counters = Counters::new(130, 3);
        let reading = Duration::from_millis(2);
        let loaded = Loaded { read: 10, decompressed: 25, reading };
        for (key, level) in [(0, 0), (129, 2), (64, 2), (129, 2), (0, 0), (129, 2)] {
            counters.count_load(key, level, &loaded);
        }
        assert_eq!((counters.distinct(), counters.reloaded()), (3, 3));
        assert_eq!([0, 1, 2, 9].map(|level| counters.distinct_at(level)), [1, 0, 2, 0]);
        let all = Loaded { read: 60, decompressed: 150, reading: 6 * reading };
        assert_eq!(counters.loaded(), all);
    }

    #[test]
    fn marks_stay_within_2_mebibytes() {
        assert_eq!(Counters::bytes(u64::MAX), 2 << 20);
        let counters = Counters::new(u64::MAX, 1);
        for key in [5, u64::MAX, u64::MAX, LARGEST_EXACT_KEY + 1] {
            counters.count_load(key, 0, &Loaded::default());
        }
        assert_eq!(counters.distinct() + counters.reloaded(), 4);
        assert!(counters.reloaded() >= 1);
    }
}
