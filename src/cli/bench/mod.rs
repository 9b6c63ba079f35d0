//! `deepfield bench`: what pictures and reading cost, measured on a user's own data.

mod depth;
mod fixed;
mod measure;
mod plot;
mod plots;
mod reading;
mod reading_data;
mod reference;
mod renderer;
mod table;
mod tolerance;

use clap::{Args, Subcommand};

use crate::Result;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    subject: Subject,
}

#[derive(Debug, Subcommand)]
enum Subject {
    /// Time against measured error, for a sweep of tolerances: CSV, and plots with -o
    Tolerance(tolerance::Arguments),
    /// The same picture from caches that differ in depth: CSV
    Depth(depth::Arguments),
    /// Reading simulation outputs against plain reading of the same files: CSV
    Reading(reading::Arguments),
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.subject {
        Subject::Tolerance(arguments) => tolerance::run(arguments),
        Subject::Depth(arguments) => depth::run(arguments),
        Subject::Reading(arguments) => reading::run(arguments),
    }
}
