//! Settings, each with its picture's error and its best time.

use std::path::Path;

use super::reference::Reference;
use super::renderer::{Cost, Renderer};
use crate::Result;

/// What is measured: renders of one scene from one cache against one reference.
#[derive(Debug)]
pub(super) struct Bench<'b> {
    /// How pictures are rendered.
    pub(super) renderer: &'b Renderer,
    /// The cache's path.
    pub(super) cache: &'b Path,
    /// The scene's path.
    pub(super) scene: &'b Path,
    /// The picture that errors are taken to.
    pub(super) reference: &'b Reference,
}

/// One setting's picture.
#[derive(Debug, Clone)]
pub(super) struct Measured {
    /// The setting, as options of `deepfield render`.
    options: Vec<String>,
    /// What its first render took.
    pub(super) cost: Cost,
    /// Least time of all its renders, seconds.
    pub(super) seconds: f64,
    /// Largest error of any channel of any pixel.
    pub(super) error: f64,
}

impl Bench<'_> {
    /// Renders by `options` and compares the picture.
    ///
    /// # Errors
    /// Whatever the render says.
    pub(super) fn measure(&self, options: Vec<String>) -> Result<Measured> {
        let cost = self.renderer.render(self.cache, self.scene, &options)?;
        let error = self.reference.error(&self.renderer.picture()?);
        Ok(Measured { options, seconds: cost.wall_seconds, cost, error })
    }

    /// Renders once more, for the time alone: equal options give equal pictures.
    ///
    /// # Errors
    /// Whatever the render says.
    pub(super) fn time_again(&self, measured: &mut Measured) -> Result<()> {
        let cost = self.renderer.render(self.cache, self.scene, &measured.options)?;
        measured.seconds = measured.seconds.min(cost.wall_seconds);
        Ok(())
    }
}
