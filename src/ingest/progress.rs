//! How far ingest is.

/// What ingest is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Reading the hierarchy.
    Hierarchy,
    /// Reading cells and averaging.
    Cells,
    /// Compressing and writing.
    Write,
}

/// Tells a listener of stages and of bricks done.
pub struct Progress<'l> {
    listener: &'l mut (dyn FnMut(Stage, u64, u64) + Send),
    stage: Stage,
    done: u64,
    total: u64,
}

impl<'l> Progress<'l> {
    /// `listener` gets the stage, bricks done, and bricks in all (about; 0: unknown).
    pub fn new(listener: &'l mut (dyn FnMut(Stage, u64, u64) + Send)) -> Self {
        Self { listener, stage: Stage::Hierarchy, done: 0, total: 0 }
    }

    /// Tells that `stage` begins, with about `total` bricks (0: unknown).
    pub(super) fn begin(&mut self, stage: Stage, total: u64) {
        (self.stage, self.done, self.total) = (stage, 0, total);
        (self.listener)(stage, 0, total);
    }

    /// Tells that `bricks` more are done; the total grows where it was too small.
    pub(super) fn advance(&mut self, bricks: u64) {
        self.done += bricks;
        (self.listener)(self.stage, self.done, self.total.max(self.done));
    }
}
