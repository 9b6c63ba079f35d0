//! What the pool counts.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use super::{FORMS, Loaded};

/// Bricks below this are told apart exactly when loads are counted as first or further ones; others may
/// share their marks with another (by a hash), and the second one's first load then counts as a further
/// one. It keeps the marks within 8 MiB.
pub(crate) const LARGEST_EXACT: u64 = 1 << 24;
/// Bricks whose marks stand in one number.
const TOGETHER: u64 = 64 / FORMS as u64;

/// Counts loads, from any thread and exactly (of bricks below [`LARGEST_EXACT`]).
#[derive(Debug)]
pub(crate) struct Counters {
    /// One bit for each form of a brick: loaded before.
    marks: Vec<AtomicU64>,
    first_loads: Vec<AtomicU64>,
    further_forms: AtomicU64,
    further_loads: AtomicU64,
    bytes_read: AtomicU64,
    bytes_decompressed: AtomicU64,
    reading_nanoseconds: AtomicU64,
    waited_nanoseconds: AtomicU64,
    worked_nanoseconds: AtomicU64,
}

impl Counters {
    /// Counters for bricks below `bricks` at `levels` levels.
    pub(crate) fn new(bricks: u64, levels: usize) -> Self {
        let words = usize::try_from(Self::bytes(bricks) / 8).unwrap_or(0);
        Self {
            marks: zeros(words),
            first_loads: zeros(levels),
            further_forms: AtomicU64::new(0),
            further_loads: AtomicU64::new(0),
            bytes_read: AtomicU64::new(0),
            bytes_decompressed: AtomicU64::new(0),
            reading_nanoseconds: AtomicU64::new(0),
            waited_nanoseconds: AtomicU64::new(0),
            worked_nanoseconds: AtomicU64::new(0),
        }
    }

    /// Bytes that the marks of bricks below `bricks` take.
    pub(crate) fn bytes(bricks: u64) -> u64 {
        8 * bricks.clamp(1, LARGEST_EXACT).div_ceil(TOGETHER)
    }

    /// Bricks of `level` that were loaded at least once.
    pub(crate) fn distinct_at(&self, level: usize) -> u64 {
        self.first_loads.get(level).map_or(0, load)
    }

    /// Bricks that were loaded at least once.
    pub(crate) fn distinct(&self) -> u64 {
        self.first_loads.iter().map(load).sum()
    }

    /// Loads of bricks that had been loaded before in other forms alone.
    pub(crate) fn in_other_forms(&self) -> u64 {
        load(&self.further_forms)
    }

    /// Loads of bricks that had been loaded before, in the same form.
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

    /// Counts a load of a form of a brick, as the brick's first at `level` or as a further one, and what
    /// it took from the file. A first load at a level that the counters do not have is not counted.
    pub(crate) fn count_load(&self, brick: u64, form: usize, level: usize, loaded: &Loaded) {
        self.bytes_read.fetch_add(loaded.read, Ordering::Relaxed);
        self.bytes_decompressed.fetch_add(loaded.decompressed, Ordering::Relaxed);
        add(&self.reading_nanoseconds, loaded.reading);
        let forms = self.mark(brick, form);
        if forms >> form & 1 == 1 {
            self.further_loads.fetch_add(1, Ordering::Relaxed);
        } else if forms != 0 {
            self.further_forms.fetch_add(1, Ordering::Relaxed);
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

    /// Marks a form of a brick; which were marked before.
    fn mark(&self, brick: u64, form: usize) -> u64 {
        let places = TOGETHER * self.marks.len() as u64;
        // Fibonacci hashing spreads neighbours over the marks.
        let hashed = brick.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
        let place = if brick < places { brick } else { hashed % places };
        let word = usize::try_from(place / TOGETHER).unwrap_or(0);
        let shift = place % TOGETHER * FORMS as u64;
        let before = self.marks[word].fetch_or(1 << form << shift, Ordering::Relaxed);
        before >> shift & ((1 << FORMS) - 1)
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
        let loads = [(0, 0, 0), (129, 3, 2), (64, 1, 2), (129, 3, 2), (0, 2, 0), (129, 0, 2)];
        for (brick, form, level) in loads {
            counters.count_load(brick, form, level, &loaded);
        }
        let all = (counters.distinct(), counters.in_other_forms(), counters.reloaded());
        assert_eq!(all, (3, 2, 1));
        assert_eq!([0, 1, 2, 9].map(|level| counters.distinct_at(level)), [1, 0, 2, 0]);
        let all = Loaded { read: 60, decompressed: 150, reading: 6 * reading };
        assert_eq!(counters.loaded(), all);
    }

    #[test]
    fn marks_stay_within_8_mebibytes() {
        assert_eq!(Counters::bytes(u64::MAX), 8 << 20);
        let counters = Counters::new(u64::MAX, 1);
        for brick in [5, u64::MAX, u64::MAX, LARGEST_EXACT + 1] {
            counters.count_load(brick, 0, 0, &Loaded::default());
        }
        assert_eq!(counters.distinct() + counters.reloaded(), 4);
        assert!(counters.reloaded() >= 1);
    }
}
