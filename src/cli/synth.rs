//! `deepfield synth`.

use std::path::PathBuf;

use clap::Args;

use super::output::Output;
use super::progress::Bar;
use super::size;
use crate::Result;
use crate::synth::{self, Recipe};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The recipe (TOML; examples in datasets_synthetic/)
    recipe: PathBuf,
    /// The folder to write to
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let recipe = Recipe::load(&arguments.recipe)?;
    let bar = Bar::new("synth", "grids");
    let summary = synth::write(&recipe, &arguments.output, &mut |done, total| {
        bar.show("synth", done, total);
    })?;
    drop(bar);
    let mut output = Output::new();
    output.line(format!(
        "{}: {} levels, {} grids, {} cells, {}",
        summary.path.display(),
        summary.levels,
        summary.grids,
        summary.cells,
        size::show(summary.bytes)
    ))?;
    output.finish()
}
