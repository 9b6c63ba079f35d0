//! `deepfield bench depth`.

use std::path::{Path, PathBuf};

use clap::Args;

use super::renderer::{Cost, Limits, Renderer};
use super::table::{Columns, column, counts, csv, number, optional};
use crate::Result;
use crate::cache::Cache;
use crate::cli::output::Output;
use crate::cli::progress::Bar;
use crate::cli::values;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The scene (TOML), the same for all caches
    scene: PathBuf,
    /// The caches; times are compared with the first
    #[arg(required = true)]
    caches: Vec<PathBuf>,
    /// Largest error: a number, or `p%` of the picture's largest value
    #[arg(
        long,
        value_name = "T",
        default_value = "1%",
        value_parser = values::tolerance_text,
        allow_hyphen_values = true
    )]
    tolerance: String,
    /// Rays a pixel, n for n×n, or `area` (default: the scene's)
    #[arg(
        long,
        value_name = "N|area",
        value_parser = values::samples_text,
        allow_negative_numbers = true
    )]
    samples: Option<String>,
    #[command(flatten)]
    limits: Limits,
}

/// Runs the command.
///
/// # Errors
/// Whatever the renders say, and standard output that cannot be written.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let Arguments { scene, caches, tolerance, samples, limits } = arguments;
    let renderer = Renderer::new(limits)?;
    let mut options = vec!["--tolerance".to_owned(), tolerance.clone()];
    options.extend(samples.iter().map(|samples| format!("--samples={samples}")));
    let render = |cache: &PathBuf| renderer.render(cache, scene, &options);
    let mut costs = caches.iter().map(render).collect::<Result<Vec<_>>>()?;
    let bar = Bar::new("again", "rounds");
    for round in 1..limits.repeat {
        bar.show("again", round.into(), limits.repeat.into());
        for (cache, cost) in caches.iter().zip(&mut costs) {
            cost.wall_seconds = cost.wall_seconds.min(render(cache)?.wall_seconds);
        }
    }
    drop(bar);
    let first = costs.first().map_or(0.0, |cost| cost.wall_seconds);
    let rows = caches.iter().zip(&costs).map(|(cache, cost)| row(cache, cost, first));
    let text = csv(&rows.collect::<Result<Vec<_>>>()?)?;
    Output::new().end_with(&text)
}

fn row(path: &Path, cost: &Cost, first: f64) -> Result<Columns> {
    let cache = Cache::open(path, 1)?;
    let header = cache.header();
    let deepest = header.levels.iter().filter_map(|level| level.simulation).max();
    let mut columns = vec![
        column("cache", path.display()),
        optional("deepest_level", deepest),
        column("bricks_total", header.nodes()),
        optional("tolerance_absolute", cost.tolerance.map(number)),
        optional("error_bound", cost.error_bound.map(number)),
        column("seconds", cost.wall_seconds),
        column("seconds_over_first", cost.wall_seconds / first),
    ];
    columns.extend(counts(cost));
    Ok(columns)
}
