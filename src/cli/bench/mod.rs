//! `deepfield bench`: what pictures and reading cost, measured on a user's own data.

mod covering_grid;
mod covering_table;
mod cpu;
mod dense;
mod depth;
mod fixed;
mod measure;
mod plain_array;
mod plot;
mod plots;
mod reading;
mod reading_data;
mod reference;
mod renderer;
mod scaling;
mod scaling_data;
mod scaling_table;
mod table;
mod tolerance;
mod viewpoints;

use clap::{Args, Subcommand};

use crate::Result;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    subject: Subject,
}

#[derive(Debug, Subcommand)]
enum Subject {
    /// Time against measured error, for a sweep of tolerances: CSV and a plot, more of them with -o
    Tolerance(tolerance::Arguments),
    /// The same picture from caches that differ in depth: CSV
    Depth(depth::Arguments),
    /// A cache against dense grids of its levels, held in memory: CSV, and plots with -o
    CoveringGrid(covering_grid::Arguments),
    /// Reading simulation outputs against plain reading of the same files: CSV
    Reading(reading::Arguments),
    /// Ingest and pictures of data sets of growing size: CSV, and plots with -o
    Scaling(scaling::Arguments),
}

/// Runs the benchmark that is asked for.
///
/// # Errors
/// Whatever that one says.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.subject {
        Subject::Tolerance(arguments) => tolerance::run(arguments),
        Subject::Depth(arguments) => depth::run(arguments),
        Subject::CoveringGrid(arguments) => covering_grid::run(arguments),
        Subject::Reading(arguments) => reading::run(arguments),
        Subject::Scaling(arguments) => scaling::run(arguments),
    }
}
