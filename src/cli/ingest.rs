//! `deepfield ingest`.

use std::path::{Path, PathBuf};

use clap::Args;

use super::ingest_stats::Stopwatch;
use super::output::{Output, warn};
use super::paths::refuse_same;
use super::progress::Bar;
use super::stats_file::StatsFile;
use super::{size, values};
use crate::cache::{Cache, Header};
use crate::derive::Derived;
use crate::ingest::{Options, Progress, Stage, refuse_files_of, refuse_source_files};
use crate::source::Source;
use crate::space::Decimal;
use crate::{Error, Result, source};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The simulation output: Enzo's parameter or hierarchy file, an AMReX plotfile's folder, an
    /// Athena++ `.athdf`, a FLASH file, an Athena `.vtk`; or the folder of one output's files
    input: PathBuf,
    /// The cache to write
    #[arg(short, long, value_name = "CACHE")]
    output: PathBuf,
    /// A field to ingest (repeat for more; default: the density, or the only field)
    #[arg(long, value_name = "NAME")]
    field: Vec<String>,
    /// A field to compute and ingest (repeat for more), as in `ram=Density*{x-velocity}^2`: of the
    /// source's fields and those computed before, with + - * / ^, sqrt, exp, log, log10, abs, min
    /// and max
    #[arg(
        long,
        value_name = "NAME=EXPRESSION",
        value_parser = values::definition,
        allow_hyphen_values = true
    )]
    derive: Vec<String>,
    /// Memory limit
    #[arg(
        long,
        value_name = "SIZE",
        default_value = "1GiB",
        value_parser = size::parse,
        allow_hyphen_values = true
    )]
    memory: u64,
    /// Threads (default: all cores)
    #[arg(
        long,
        value_name = "N",
        value_parser = clap::value_parser!(u32).range(1..=1024),
        allow_negative_numbers = true
    )]
    threads: Option<u32>,
    /// The input's format: enzo, amrex, athena++, flash or athena (default: told by its content)
    #[arg(long, value_name = "NAME", value_parser = values::read_format)]
    format: Option<String>,
    /// Leave out levels deeper than this
    #[arg(long, value_name = "L", allow_negative_numbers = true)]
    max_level: Option<u32>,
    /// Store values with a relative error of at most this (0: lossless)
    #[arg(
        long,
        value_name = "E",
        default_value_t = 0.0,
        value_parser = values::relative_error,
        allow_negative_numbers = true
    )]
    error: f64,
    /// Leave out, in each field, cells where that field is below this: they emit and absorb nothing
    #[arg(long, value_name = "V", allow_hyphen_values = true, value_parser = values::no_nan)]
    drop_below: Option<f64>,
    /// Keep only this box: its lower and upper corner, each `x,y,z` in code length, as in
    /// `--region 0.4,0.4,0.4 0.6,0.6,0.6`
    #[arg(
        long, value_names = ["LO", "HI"], num_args = 2, allow_hyphen_values = true,
        action = clap::ArgAction::Set,
        value_parser = values::corner
    )]
    region: Option<Vec<[Decimal; 3]>>,
    /// Cells along a brick's edge: 8, 16 or 32 (default: what costs least, or
    /// smaller where the limit has no room for it)
    #[arg(long, value_name = "B", value_parser = values::brick, allow_negative_numbers = true)]
    brick: Option<u32>,
    /// Write what the ingest took to this file (JSON)
    #[arg(long, value_name = "FILE")]
    stats: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// Whatever is wrong with the input, the options or the target.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    if let Some(stats) = &arguments.stats {
        let cache = ("the cache", arguments.output.as_path());
        refuse_same(&[("the stats", stats), cache], &[("the input", &arguments.input)])?;
    }
    if Cache::is_cache(&arguments.input) {
        return Err(Error::request(format!(
            "{}: is a cache already; name the simulation's output that is to be ingested",
            arguments.input.display()
        )));
    }
    let source = source::open(&arguments.input, arguments.format.as_deref())?;
    let source = Derived::new(source.as_ref(), &arguments.derive)?;
    let options = Options {
        fields: fields(&source, &arguments.field),
        memory: arguments.memory,
        threads: arguments.threads.map(|n| n as usize),
        max_level: arguments.max_level,
        relative_error: arguments.error,
        drop_below: arguments.drop_below,
        region: arguments.region.clone().and_then(|corners| corners.try_into().ok()),
        brick: arguments.brick,
    };
    let stats_file =
        arguments.stats.as_deref().map(|path| begin_stats(&source, path)).transpose()?;
    let mut stopwatch = Stopwatch::start();
    refuse_files_of(&arguments.input, &arguments.output)?;
    let mut hear = |stage| stopwatch.hear(stage);
    let header = ingest_with_bar(&source, &arguments.output, &options, &mut hear)?;
    if let Some(file) = stats_file {
        file.write(&stopwatch.stop(&source, options.memory, &header)?)?;
    }
    if options.fields.is_empty() && source.hierarchy().density.is_none() {
        warn(format!(
            "no field is known as a density: took {}, the only one",
            header.fields[0].name
        ));
    }
    report(&header, arguments)
}

fn begin_stats(source: &dyn Source, path: &Path) -> Result<StatsFile> {
    refuse_source_files(source, path)?;
    StatsFile::begin(path)
}

/// The fields asked for, else the density if there is one, and the derived ones.
fn fields(source: &Derived<'_>, asked: &[String]) -> Vec<String> {
    let mut fields = asked.to_vec();
    if asked.is_empty() {
        let hierarchy = source.hierarchy();
        fields.extend(hierarchy.density.map(|field| hierarchy.fields[field].name.clone()));
    }
    fields.extend(source.names().map(str::to_owned));
    fields
}

/// Ingests, with a progress bar on a terminal; `hear` is told the stage again and again.
pub(super) fn ingest_with_bar(
    source: &dyn Source,
    target: &Path,
    options: &Options,
    hear: &mut (dyn FnMut(Stage) + Send),
) -> Result<Header> {
    let bar = Bar::new("hierarchy", "bricks");
    let mut listener = |stage, done, total| {
        hear(stage);
        bar.show(label(stage), done, total);
    };
    crate::ingest::ingest(source, target, options, &mut Progress::new(&mut listener))
}

/// What a stage is called on the bar.
pub(super) fn label(stage: Stage) -> &'static str {
    match stage {
        Stage::Hierarchy => "hierarchy",
        Stage::Cells => "cells",
        Stage::Write => "write",
    }
}

fn report(header: &Header, arguments: &Arguments) -> Result<()> {
    let mut output = Output::new();
    let cells: u64 = header.levels.iter().map(|level| level.leaf_cells).sum();
    output.line(format!(
        "{}: {} leaf cells in {} bricks of {}³, {}",
        arguments.output.display(),
        cells,
        header.nodes(),
        header.shape.edge(),
        size::show(header.file_bytes),
    ))?;
    if let (Some(least), 2..) = (arguments.drop_below, header.fields.len()) {
        warn(format!(
            "--drop-below {least}: each field has lost the cells where its own value is below that: ingest \
             fields alone that need limits of their own"
        ));
    }
    for field in &header.fields {
        if cells > 0 && field.dropped_cells == cells {
            warn(format!(
                "{}: all {cells} leaf cells were dropped: pictures of it are black",
                field.name
            ));
        }
        if field.nan_cells > 0 {
            warn(format!(
                "{}: {} leaf cells are NaN: they are left out of averages, extrema and \
                 sums, and drawn as the lower end of the scene's range",
                field.name, field.nan_cells
            ));
        }
        if arguments.error > 0.0 && field.leaf_error > arguments.error {
            warn(format!(
                "{}: values are off by up to {:.1e} of themselves, more than --error {:e}, as 32-bit \
                 floats have it",
                field.name, field.leaf_error, arguments.error
            ));
        }
        if field.smallest_positive.is_some_and(|least| least < field.least_exact()) {
            warn(format!(
                "{}: values below {:.1e} are held with fewer digits than others, or as 0, as \
                 32-bit floats have it",
                field.name,
                field.least_exact()
            ));
        }
    }
    output.finish()
}
