//! `deepfield synth`.

use std::io::Read;
use std::path::{Path, PathBuf};

use clap::Args;

use super::output::Output;
use super::progress::Bar;
use super::{size, values};
use crate::synth::{self, Recipe};
use crate::{Error, Result};

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
    #[arg(long, value_name = "N", default_value_t = 1.0, value_parser = values::positive, allow_negative_numbers = true)]
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
    let failed = |source| Error::io(path, "cannot read the recipe", source);
    let mut bytes = Vec::new();
    let file = std::fs::File::open(path).map_err(failed)?;
    file.take(MAX_RECIPE_BYTES + 1).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 > MAX_RECIPE_BYTES {
        return Err(Error::invalid(path.display(), "a recipe is at most 1 MiB long"));
    }
    let text = String::from_utf8(bytes).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        Error::invalid(path.display(), format!("not a recipe: byte {at} is not UTF-8 text"))
    })?;
    Recipe::parse(&text, path.display())
}
