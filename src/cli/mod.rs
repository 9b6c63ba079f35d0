//! The program's commands.
//!
//! Exit codes: 0 done; 1 a failure, told in one line on stderr; 2 wrong usage.

mod bench;
mod demo;
mod fields;
mod headers;
mod info;
mod ingest;
mod ingest_stats;
mod itself;
mod output;
mod paths;
mod probe;
mod progress;
mod render;
mod size;
mod stats_file;
mod synth;
mod values;
mod verify;
mod warnings;

use std::panic;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::{Error, allocator, leftovers};

/// Renders deep adaptive-mesh-refinement simulations within a memory limit.
#[derive(Debug, Parser)]
#[command(name = "deepfield", version, about, arg_required_else_help = true)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Make a 13-level data set, ingest it and render two pictures
    Demo(demo::Arguments),
    /// Turn a simulation output into a brick cache
    Ingest(ingest::Arguments),
    /// Say what a simulation output or a cache holds
    Info(info::Arguments),
    /// Print level and value at points
    Probe(probe::Arguments),
    /// Render one picture
    Render(render::Arguments),
    /// Read every byte of a cache and check it
    Verify(verify::Arguments),
    /// Write a synthetic data set in the layout of a simulation code
    Synth(synth::Arguments),
    /// Measure time, memory and files: against error, depth, size, covering grids, plain reading
    Bench(bench::Arguments),
}

/// Runs the program on the process' arguments.
pub fn run() -> ExitCode {
    let arguments = Arguments::parse();
    allocator::share_among_threads();
    // A panic is a fault of the program; a user gets one line about it all the same.
    panic::set_hook(Box::new(|fault| {
        let place =
            fault.location().map_or_else(String::new, |l| format!("{}:{}", l.file(), l.line()));
        eprintln!("error: internal fault at {place}: please report it with the command you ran");
    }));
    // Where signals cannot be heard they end the process at once; the next run clears up.
    let _ = leftovers::clear_on_signals(itself::end_all, progress::clear);
    let outcome = panic::catch_unwind(|| match &arguments.command {
        Command::Demo(arguments) => demo::run(arguments),
        Command::Ingest(arguments) => ingest::run(arguments),
        Command::Info(arguments) => info::run(arguments),
        Command::Probe(arguments) => probe::run(arguments),
        Command::Render(arguments) => render::run(arguments),
        Command::Verify(arguments) => verify::run(arguments),
        Command::Synth(arguments) => synth::run(arguments),
        Command::Bench(arguments) => bench::run(arguments),
    });
    match outcome {
        Ok(Ok(())) => ExitCode::SUCCESS,
        Ok(Err(error)) => report(&error),
        Err(_) => ExitCode::FAILURE,
    }
}

fn report(error: &Error) -> ExitCode {
    if output::is_closed_pipe(error) {
        return ExitCode::SUCCESS;
    }
    // One line, whatever names or other programs' messages in it hold.
    eprintln!("error: {}", output::harmless(&error.to_string()).trim());
    ExitCode::FAILURE
}
