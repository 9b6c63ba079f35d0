//! Sorting more records than memory holds.

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::path::Path;

use rayon::slice::ParallelSliceMut;

use super::spool::{Spool, Stream};
use crate::Result;

/// A record of fixed size that a [`Sorter`] can keep in a file.
pub(super) trait Record: Copy + Ord + Send {
    /// Bytes of a record.
    const BYTES: usize;
    /// Writes the record to `bytes` (of length [`Self::BYTES`]).
    fn put(&self, bytes: &mut [u8]);
    /// Reads what [`Self::put`] wrote.
    fn get(bytes: &[u8]) -> Self;
}

/// Smallest read buffer of one sorted run while merging. Runs are as large as a sorter's memory, so that
/// their buffers exceed it from memory² / 4 KiB bytes of records on: 16 GiB of them for 8 MiB.
const MIN_RUN_BUFFER: usize = 4 << 10;

/// Takes records in any order and gives them back sorted, in bounded memory.
pub(super) struct Sorter<R> {
    spool: Spool,
    pending: Vec<R>,
    capacity: usize,
    runs: Vec<(u64, u64)>,
}

impl<R: Record> Sorter<R> {
    /// A sorter that keeps about `memory` bytes in memory.
    pub(super) fn new(directory: &Path, memory: usize) -> Result<Self> {
        let capacity = (memory / size_of::<R>()).max(1024);
        Ok(Self { spool: Spool::new(directory)?, pending: Vec::new(), capacity, runs: Vec::new() })
    }

    /// Adds a record.
    pub(super) fn push(&mut self, record: R) -> Result<()> {
        if self.pending.len() == self.capacity {
            self.flush()?;
        }
        if self.pending.len() == self.pending.capacity() {
            let more = self.pending.len().max(1024).min(self.capacity - self.pending.len());
            self.pending.reserve_exact(more);
        }
        self.pending.push(record);
        Ok(())
    }

    fn flush(&mut self) -> Result<()> {
        self.pending.par_sort_unstable();
        let start = self.spool.len();
        let mut bytes = vec![0; R::BYTES];
        for record in self.pending.drain(..) {
            record.put(&mut bytes);
            self.spool.append(&bytes)?;
        }
        self.runs.push((start, self.spool.len()));
        Ok(())
    }

    /// All records are in: they can now be read in order, as often as needed.
    pub(super) fn finish(mut self) -> Result<Sorted<R>> {
        self.flush()?;
        self.spool.flush()?;
        let memory = self.capacity * size_of::<R>();
        let buffer = (memory / self.runs.len()).clamp(MIN_RUN_BUFFER, 1 << 20);
        Ok(Sorted { spool: self.spool, runs: self.runs, buffer, record: std::marker::PhantomData })
    }
}

/// Sorted records on disk.
pub(super) struct Sorted<R> {
    spool: Spool,
    runs: Vec<(u64, u64)>,
    buffer: usize,
    record: std::marker::PhantomData<R>,
}

impl<R: Record> Sorted<R> {
    /// Reads the records in order.
    pub(super) fn iter(&self) -> Result<Merge<'_, R>> {
        let bytes = vec![0; R::BYTES];
        let mut merge = Merge { streams: Vec::new(), heap: BinaryHeap::new(), bytes };
        for (run, &(start, end)) in self.runs.iter().enumerate() {
            merge.streams.push(self.spool.stream(start, end, self.buffer));
            merge.advance(run)?;
        }
        Ok(merge)
    }
}

/// The merge of all runs.
pub(super) struct Merge<'s, R> {
    streams: Vec<Stream<'s>>,
    heap: BinaryHeap<Head<R>>,
    /// Room for the bytes of one record.
    bytes: Vec<u8>,
}

impl<R: Record> Merge<'_, R> {
    fn advance(&mut self, run: usize) -> Result<()> {
        if self.streams[run].read(&mut self.bytes)? {
            self.heap.push(Head { record: R::get(&self.bytes), run });
        }
        Ok(())
    }

    /// The next record without taking it.
    pub(super) fn peek(&self) -> Option<&R> {
        self.heap.peek().map(|head| &head.record)
    }

    /// Takes the next record.
    pub(super) fn next(&mut self) -> Result<Option<R>> {
        let Some(head) = self.heap.pop() else { return Ok(None) };
        self.advance(head.run)?;
        Ok(Some(head.record))
    }
}

/// First record of a run; the heap must give the smallest first.
struct Head<R> {
    record: R,
    run: usize,
}

impl<R: Ord> Ord for Head<R> {
    fn cmp(&self, other: &Self) -> Ordering {
        other.record.cmp(&self.record).then(other.run.cmp(&self.run))
    }
}

impl<R: Ord> PartialOrd for Head<R> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl<R: Ord> PartialEq for Head<R> {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl<R: Ord> Eq for Head<R> {}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
    struct Number(u64);

    impl Record for Number {
        const BYTES: usize = 8;
        fn put(&self, bytes: &mut [u8]) {
            bytes.copy_from_slice(&self.0.to_le_bytes());
        }
        fn get(bytes: &[u8]) -> Self {
            Self(u64::from_le_bytes(bytes.try_into().unwrap()))
        }
    }

    #[test]
    fn many_runs_merge_in_order() {
        let mut sorter = Sorter::new(&std::env::temp_dir(), 0).unwrap();
        let numbers = (0..50_000u64).map(|i| i.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40);
        for number in numbers.clone() {
            sorter.push(Number(number)).unwrap();
        }
        assert!(sorter.runs.len() > 10);
        let sorted = sorter.finish().unwrap();
        let mut expected: Vec<u64> = numbers.collect();
        expected.sort_unstable();
        for _ in 0..2 {
            let mut merge = sorted.iter().unwrap();
            let mut found = Vec::new();
            while let Some(Number(number)) = merge.next().unwrap() {
                found.push(number);
            }
            assert_eq!(found, expected);
        }
    }
}
