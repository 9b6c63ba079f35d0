//! What a memory limit needs: the budget that every large allocation is charged to, the fixed
//! pool of decoded bricks, and the threads that read ahead of those who use them.
//!
//! Paging knows keys and slots: what a brick is, the [`Loader`] says.

mod budget;
mod clock;
mod counters;
mod loader;
mod pool;
mod read_ahead;
mod resident;

pub(crate) use budget::{Budget, MEBIBYTE, Reservation};
pub(crate) use counters::Counters;
pub(crate) use loader::{FORMS, Loaded, Loader, Request};
pub(crate) use pool::{Pinned, Pool};
pub(crate) use read_ahead::{ReadAhead, run_reader};
pub(crate) use resident::peak_rss_bytes;
