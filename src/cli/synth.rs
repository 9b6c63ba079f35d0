//! `deepfield synth`.

use std::path::{Path, PathBuf};

use clap::Args;

use super::output::{self, Output};
use super::progress::Bar;
use super::{size, values};
use crate::synth::{self, Recipe};
use crate::{Error, Result, text_file};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The recipe (TOML; examples in datasets_synthetic/)
    recipe: PathBuf,
    /// The folder to write to
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// The layout to write (default: the recipe's)
    #[arg(long, value_name = "NAME", value_parser = values::written_format)]
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
    // What options make of a recipe is told by its file, as what it says itself.
    let refused = |error| match error {
        Error::Request(reason) => Error::invalid(arguments.recipe.display(), reason),
        other => other,
    };
    output::check_folder(&arguments.output)?;
    let mut recipe = load(&arguments.recipe)?;
    if let Some(format) = &arguments.format {
        recipe = recipe.with_format(format).map_err(refused)?;
    }
    if arguments.scale != 1.0 {
        recipe = recipe.scaled(arguments.scale).map_err(refused)?;
    }
    let bar = Bar::new("synth", "cells");
    let mut progress = |done, total| bar.show("synth", done, total);
    let summary = synth::write(&recipe, &arguments.output, &mut progress).map_err(refused)?;
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
