//! `deepfield bench`: what pictures cost, measured on a user's own caches and scenes.

mod depth;
mod fixed;
mod measure;
mod plot;
mod plots;
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
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.subject {
        Subject::Tolerance(arguments) => tolerance::run(arguments),
        Subject::Depth(arguments) => depth::run(arguments),
    }
}
