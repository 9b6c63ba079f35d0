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

pub use budget::{Budget, MEBIBYTE, Reservation};
pub use counters::{Counters, LARGEST_EXACT_KEY};
pub use loader::{Loaded, Loader, Request};
pub use pool::{Pinned, Pool};
pub use read_ahead::{ReadAhead, run_reader};
pub use resident::peak_rss_bytes;
