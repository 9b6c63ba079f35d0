//! What `deepfield bench reading` reads where no outputs are given: one recipe in every layout.

use std::path::PathBuf;

use crate::Result;
use crate::cli::progress::Bar;
use crate::leftovers::ScratchFolder;
use crate::synth::{self, Precision, Recipe};

const RECIPE: &str = include_str!("../../../datasets_synthetic/reading.toml");

/// The layouts, each with the precision that its codes mostly write.
const LAYOUTS: [(&str, Precision); 5] = [
    ("enzo", Precision::F64),
    ("amrex", Precision::F64),
    ("athena++", Precision::F32),
    ("flash", Precision::F64),
    ("athena", Precision::F32),
];

/// Synthetic outputs, which go when this does.
#[derive(Debug)]
pub(super) struct Made {
    /// What readers open.
    pub(super) inputs: Vec<PathBuf>,
    /// Holds them.
    _folder: ScratchFolder,
}

impl Made {
    /// Writes an output in each layout.
    ///
    /// # Errors
    /// No room for them in the system's folder of temporary files.
    pub(super) fn new() -> Result<Self> {
        let folder = ScratchFolder::new()?;
        let bar = Bar::new("synth", "cells");
        let mut inputs = Vec::new();
        for (format, precision) in LAYOUTS {
            let mut recipe = Recipe::parse(RECIPE, "reading.toml")?.with_format(format)?;
            recipe.output.precision = precision;
            let target = folder.path().join(format);
            let mut show = |done, total| bar.show(format, done, total);
            inputs.push(synth::write(&recipe, &target, &mut show)?.input);
        }
        Ok(Self { inputs, _folder: folder })
    }
}
