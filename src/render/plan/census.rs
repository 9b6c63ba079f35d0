//! What becomes of the bricks of a picture.

/// What becomes of a brick, or of a subtree of them, in a walk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fate {
    /// Its subtree is beside the window or behind the eye.
    OutOfView,
    /// Nothing in it emits or absorbs.
    Transparent,
    /// It is finer than what the cut draws in its place.
    Coarser,
    /// Bricks beneath draw all of it that is in the window.
    Covered,
    /// Its subtree lies behind rays that need nothing more.
    Hidden,
    /// It is to be drawn, or some octants of it.
    Drawn,
}

/// Hears what becomes of bricks.
pub(crate) trait Tally {
    /// `bricks` bricks have met this fate.
    fn count(&mut self, fate: Fate, bricks: u64);
}

/// For those who do not want to know.
impl Tally for () {
    fn count(&mut self, _: Fate, _: u64) {}
}

/// How many bricks met which fate.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Census {
    /// [`Fate::OutOfView`].
    pub out_of_view: u64,
    /// [`Fate::Transparent`].
    pub transparent: u64,
    /// [`Fate::Coarser`].
    pub coarser: u64,
    /// [`Fate::Covered`].
    pub covered: u64,
    /// [`Fate::Hidden`].
    pub hidden: u64,
    /// [`Fate::Drawn`].
    pub drawn: u64,
}

impl Tally for Census {
    fn count(&mut self, fate: Fate, bricks: u64) {
        let counter = match fate {
            Fate::OutOfView => &mut self.out_of_view,
            Fate::Transparent => &mut self.transparent,
            Fate::Coarser => &mut self.coarser,
            Fate::Covered => &mut self.covered,
            Fate::Hidden => &mut self.hidden,
            Fate::Drawn => &mut self.drawn,
        };
        *counter = counter.saturating_add(bricks);
    }
}
