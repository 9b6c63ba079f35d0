//! `deepfield synth`.

use std::path::{Path, PathBuf};

use clap::Args;

use super::output::Output;
use super::progress::Bar;
use super::{size, values};
use crate::synth::{self, Recipe};
use crate::{Result, text_file};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The recipe (TOML; examples in datasets_synthetic/)
    recipe: PathBuf,
    /// The folder to write to
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// The layout to write (default: the recipe's)
    #[arg(long, value_name = "NAME")]
    format: Option<String>,
    /// Cells along each axis, of all levels, over the recipe's: the same gas in larger data
    #[arg(
        long,
        value_name = "N",
        default_value_t = 1.0,
        value_parser = values::positive,
        allow_hyphen_values = true
    )]
    scale: f64,
}

/// Runs the command.
///
/// # Errors
/// A recipe that cannot be read or written out.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let mut recipe = load(&arguments.recipe)?;
    if let Some(format) = &arguments.format {
        recipe = recipe.with_format(format)?;
    }
    if arguments.scale != 1.0 {
        recipe = recipe.scaled(arguments.scale)?;
    }
    let bar = Bar::new("synth", "cells");
    let summary = synth::write(&recipe, &arguments.output, &mut |done, total| {
        bar.show("synth", done, total);
    })?;
    drop(bar);
    let mut output = Output::new();
    output.line(format!(
        "{}: {} levels, {} grids, {} cells, {}",
        summary.input.display(),
        summary.levels,
        summary.grids,
        summary.cells,
        size::show(summary.bytes)
    ))?;
    output.finish()
}

/// Longest recipe: the parser takes many times the text's bytes.
const MAX_RECIPE_BYTES: u64 = 1 << 20;

fn load(path: &Path) -> Result<Recipe> {
    let text = text_file::read(path, "recipe", MAX_RECIPE_BYTES)?;
    Recipe::parse(&text, path.display())
}
