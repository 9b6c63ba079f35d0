//! The memory limit and what is charged to it.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::{Error, Result};

/// Bytes of a MiB.
pub(crate) const MEBIBYTE: u64 = 1 << 20;

/// A memory limit that every large allocation is charged to before it is made. Clones share it.
#[derive(Debug, Clone)]
pub(crate) struct Budget {
    limit: u64,
    reserved: Arc<Mutex<u64>>,
}

impl Budget {
    /// A limit of `limit` bytes, nothing of it taken.
    pub(crate) fn new(limit: u64) -> Self {
        Self { limit, reserved: Arc::default() }
    }

    /// What is not taken, bytes.
    #[cfg(test)]
    pub(crate) fn available(&self) -> u64 {
        self.limit - *self.lock()
    }

    /// Takes `bytes` for `what` until the reservation is dropped.
    ///
    /// # Errors
    /// More than is left: the message names what, how much, and what is left of the limit.
    pub(crate) fn reserve(&self, what: &str, bytes: u64) -> Result<Reservation> {
        let mut reserved = self.lock();
        let left = self.limit - *reserved;
        if bytes > left {
            return Err(Error::request(format!(
                "{what} needs {bytes} bytes, but only {left} of the memory limit of {} are left: \
                 raise --memory",
                self.limit
            )));
        }
        *reserved += bytes;
        Ok(Reservation { budget: self.clone(), bytes })
    }

    fn lock(&self) -> MutexGuard<'_, u64> {
        self.reserved.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A part of a [`Budget`], given back when dropped.
#[derive(Debug)]
#[must_use = "what is reserved is given back when the reservation is dropped"]
pub(crate) struct Reservation {
    budget: Budget,
    bytes: u64,
}

impl Reservation {
    /// What it holds, bytes.
    #[cfg(test)]
    pub(crate) fn bytes(&self) -> u64 {
        self.bytes
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        *self.budget.lock() -= self.bytes;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn never_more_than_the_limit_and_all_comes_back() {
        let budget = Budget::new(100);
        let film = budget.reserve("the film", 60).unwrap();
        let refused = budget.clone().reserve("the pool", 41).unwrap_err().to_string();
        assert!(refused.contains("the pool needs 41 bytes"), "{refused}");
        assert!(refused.contains("only 40"), "{refused}");
        let _pool = budget.reserve("the pool", 40).unwrap();
        assert_eq!(budget.available(), 0);
        drop(film);
        assert_eq!(budget.available(), 60);
        assert!(budget.reserve("too much", u64::MAX).is_err());
    }
}
