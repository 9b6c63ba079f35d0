//! What becomes of the bricks of a picture.

/// What becomes of a brick, or of a subtree of them, in a walk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum BrickFate {
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
    fn count(&mut self, fate: BrickFate, bricks: u64);
}

/// For those who do not want to know.
impl Tally for () {
    fn count(&mut self, _: BrickFate, _: u64) {}
}

/// How many bricks met which fate.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Census {
    /// [`BrickFate::OutOfView`].
    pub out_of_view: u64,
    /// [`BrickFate::Transparent`].
    pub transparent: u64,
    /// [`BrickFate::Coarser`].
    pub coarser: u64,
    /// [`BrickFate::Covered`].
    pub covered: u64,
    /// [`BrickFate::Hidden`].
    pub hidden: u64,
    /// [`BrickFate::Drawn`].
    pub drawn: u64,
}

impl Tally for Census {
    fn count(&mut self, fate: BrickFate, bricks: u64) {
        let counter = match fate {
            BrickFate::OutOfView => &mut self.out_of_view,
            BrickFate::Transparent => &mut self.transparent,
            BrickFate::Coarser => &mut self.coarser,
            BrickFate::Covered => &mut self.covered,
            BrickFate::Hidden => &mut self.hidden,
            BrickFate::Drawn => &mut self.drawn,
        };
        *counter = counter.saturating_add(bricks);
    }
}
