//! What the pool asks of those who use it.

use std::time::Duration;

use crate::Result;

/// Forms in which a brick can be loaded, at most.
pub(crate) const FORMS: usize = 4;

/// Names a brick, and carries what is needed to load it.
pub(crate) trait Request: Copy + Send + Sync {
    /// The node's index.
    fn brick(&self) -> u64;
    /// Which of [`FORMS`] forms of the brick is asked for.
    fn form(&self) -> usize;
    /// What tells requests apart for which different things are loaded.
    fn key(&self) -> u64 {
        self.brick() * FORMS as u64 + self.form() as u64
    }
    /// Which group of the counters the brick counts in: its tree level.
    fn level(&self) -> usize;
    /// The last turn that needs the brick, of the turns that [`Pool::turns_are_over`] hears of.
    ///
    /// [`Pool::turns_are_over`]: super::Pool::turns_are_over
    fn last_turn(&self) -> u64;
}

/// What a load took from the file.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Loaded {
    /// Bytes read.
    pub read: u64,
    /// Bytes after decompression.
    pub decompressed: u64,
    /// How long the file took.
    pub reading: Duration,
}

/// Fills slots of the pool. Shared by all threads; what a thread needs of its own is its scratch.
pub(crate) trait Loader: Sync {
    /// Names a brick.
    type Request: Request;
    /// A slot: a brick ready for use. Its memory is reused.
    type Brick: Send + Sync;
    /// One thread's buffers.
    type Scratch;

    /// An empty slot.
    fn new_brick(&self) -> Self::Brick;

    /// Says that a brick will be loaded soon. Returns at once.
    fn announce(&self, request: &Self::Request);

    /// Reads, checks and prepares the brick that `request` names into `brick`, whatever that
    /// held before.
    ///
    /// # Errors
    /// A brick that cannot be read or is damaged.
    fn load(
        &self,
        request: &Self::Request,
        scratch: &mut Self::Scratch,
        brick: &mut Self::Brick,
    ) -> Result<Loaded>;
}
