//! `deepfield bench reading`.

use std::fs::File;
use std::hint::black_box;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use clap::Args;

use super::reading_data::Made;
use super::table::{Columns, column, csv};
use crate::cli::output::Output;
use crate::cli::progress::Bar;
use crate::ingest::{chunks, in_pool};
use crate::source;
use crate::{Error, Result};

/// Bytes that plain reading asks for at a time, as `cat` does.
const PLAIN_BYTES: usize = 128 << 10;
/// Bytes of a megabyte.
const MEGABYTE: f64 = 1e6;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Simulation outputs (default: one made for this in each layout that `synth` writes)
    inputs: Vec<PathBuf>,
    /// Threads that read an output (default: all cores); plain reading has one
    #[arg(
        long,
        value_name = "N",
        value_parser = clap::value_parser!(u32).range(1..=1024),
        allow_negative_numbers = true
    )]
    threads: Option<u32>,
    /// Times that everything is read; the best time counts
    #[arg(
        long, value_name = "N", default_value_t = 5,
        value_parser = clap::value_parser!(u32).range(1..=1000), allow_negative_numbers = true
    )]
    repeat: u32,
}

/// Runs the command.
///
/// # Errors
/// Outputs that cannot be read or made, and standard output that cannot be written.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let made = arguments.inputs.is_empty().then(Made::new).transpose()?;
    let inputs = made.as_ref().map_or(&arguments.inputs, |made| &made.inputs);
    let mut subjects =
        inputs.iter().map(|input| Subject::new(input)).collect::<Result<Vec<_>>>()?;
    let bar = Bar::new("reading", "rounds");
    in_pool(arguments.threads.map(|n| n as usize), || {
        for round in 0..arguments.repeat {
            bar.show("reading", round.into(), arguments.repeat.into());
            subjects.iter_mut().try_for_each(Subject::measure)?;
        }
        Ok(())
    })?;
    drop(bar);
    let text = csv(&subjects.iter().map(Subject::row).collect::<Vec<_>>())?;
    Output::new().end_with(&text)
}

/// An output and what reading it took.
struct Subject<'i> {
    input: &'i Path,
    format: &'static str,
    files: Vec<PathBuf>,
    bytes: u64,
    values: u64,
    /// Least time of plain reading, seconds.
    plain: f64,
    /// Least time of reading all values, seconds.
    seconds: f64,
}

impl<'i> Subject<'i> {
    fn new(input: &'i Path) -> Result<Self> {
        let source = source::open(input, None)?;
        let (format, files) = (source.format(), source.data_files()?);
        let (plain, seconds) = (f64::INFINITY, f64::INFINITY);
        Ok(Self { input, format, files, bytes: 0, values: 0, plain, seconds })
    }

    /// Reads the files, then the output; both from the page cache if that holds them.
    fn measure(&mut self) -> Result<()> {
        let started = Instant::now();
        self.bytes = read_plainly(&self.files)?;
        self.plain = self.plain.min(started.elapsed().as_secs_f64());
        let started = Instant::now();
        self.values = read_values(self.input)?;
        self.seconds = self.seconds.min(started.elapsed().as_secs_f64());
        Ok(())
    }

    fn row(&self) -> Columns {
        let rate = |seconds: f64| format!("{:.0}", self.bytes as f64 / MEGABYTE / seconds);
        vec![
            column("format", self.format),
            column("bytes", self.bytes),
            column("files", self.files.len()),
            column("values", self.values),
            column("plain_seconds", format!("{:.6}", self.plain)),
            column("plain_megabytes_per_second", rate(self.plain)),
            column("seconds", format!("{:.6}", self.seconds)),
            column("megabytes_per_second", rate(self.seconds)),
            column("seconds_over_plain", format!("{:.2}", self.seconds / self.plain)),
            column("input", self.input.display()),
        ]
    }
}

/// Reads files from end to end, one after another, as `cat` would; how many bytes there were.
fn read_plainly(files: &[PathBuf]) -> Result<u64> {
    let mut buffer = vec![0; PLAIN_BYTES];
    let mut bytes = 0;
    for path in files {
        let failed = |error| Error::io(path, "cannot read", error);
        let mut file = File::open(path).map_err(failed)?;
        loop {
            match file.read(&mut buffer).map_err(failed)? {
                0 => break,
                read => bytes += read as u64,
            }
            black_box(&buffer);
        }
    }
    Ok(bytes)
}

/// Opens an output and reads every value of every field, in the blocks that `ingest` reads; how
/// many values there were.
fn read_values(input: &Path) -> Result<u64> {
    let source = source::open(input, None)?;
    let mut blocks = Vec::new();
    source.for_each_grid(&mut |grid| {
        blocks.extend(chunks(&grid).map(|block| (grid, block)));
        Ok(())
    })?;
    let next = AtomicUsize::new(0);
    // Values of each block go to the same memory, thread by thread.
    let counts = rayon::broadcast(|_| {
        let (mut values, mut count) = (Vec::new(), 0);
        while let Some((grid, block)) = blocks.get(next.fetch_add(1, Ordering::Relaxed)) {
            values.resize(block.len(), 0.0);
            for field in 0..source.hierarchy().fields.len() {
                source.read(grid, field, *block, &mut values)?;
                count += black_box(&values).len() as u64;
            }
        }
        Ok(count)
    });
    counts.into_iter().sum()
}
