//! Threads that load bricks before they are needed.

use crossbeam::channel::{Receiver, Sender, bounded};

use super::{Loader, Pool, Request};

/// The requesting end: names bricks that will be needed soon.
pub(crate) struct ReadAhead<R> {
    requests: Sender<R>,
}

impl<R: Request> ReadAhead<R> {
    /// The requesting end and the readers' end of a queue of at most `capacity` requests. The
    /// readers stop when every clone of the requesting end is gone.
    pub(crate) fn new(capacity: usize) -> (Self, Receiver<R>) {
        let (requests, receiver) = bounded(capacity);
        (Self { requests }, receiver)
    }

    /// Asks for a brick, unless `pool` holds it. When the readers are too busy it is announced and no
    /// more: whoever needs the brick then loads it.
    pub(crate) fn request<L: Loader<Request = R>>(&self, pool: &Pool<'_, L>, request: R) {
        if pool.announce(&request) && !self.requests.is_full() {
            // A queue that is full by now is no fault: whoever needs the brick loads it.
            let _ = self.requests.try_send(request);
        }
    }
}

impl<R> Clone for ReadAhead<R> {
    fn clone(&self) -> Self {
        Self { requests: self.requests.clone() }
    }
}

/// Loads what is asked for until no one is left to ask. An error is left to whoever needs the
/// brick, who meets it again and reports it.
pub(crate) fn run_reader<L: Loader>(
    pool: &Pool<'_, L>,
    requests: &Receiver<L::Request>,
    scratch: &mut L::Scratch,
) {
    for request in requests {
        drop(pool.load_ahead(&request, scratch));
    }
}
