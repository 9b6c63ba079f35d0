//! `deepfield bench tolerance`.

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;

use super::fixed::{self, Goal, Rival};
use super::measure::Bench;
use super::plots::plots;
use super::reference::Reference;
use super::renderer::{Limits, Renderer};
use super::table::{self, Row};
use crate::Result;
use crate::atomic_file;
use crate::cli::output::{Output, make_folder};
use crate::cli::progress::Bar;
use crate::cli::values;
use crate::scene::Scene;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The cache
    cache: PathBuf,
    /// The scene (TOML)
    scene: PathBuf,
    /// Tolerances, parts of the picture's largest value; the exact picture follows
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        value_parser = values::part,
        allow_hyphen_values = true,
        default_value = "1e-1,3e-2,1e-2,3e-3,1e-3,3e-4,1e-4,3e-5,1e-5"
    )]
    tolerances: Vec<f64>,
    /// Do without the exact picture: where it is of areas it takes most of the time
    #[arg(long)]
    no_exact: bool,
    /// Write tolerance.csv and the plots seconds.svg, bytes.svg and samples.svg to this folder too,
    /// not SCENE-tolerance.svg, the first of them, to the working folder
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Compare with the fastest setting picked by hand that reaches the same error
    #[arg(long)]
    fixed: bool,
    /// Time for the reference of a scene with samples = "area": its rays are doubled while they
    /// fit
    #[arg(long, value_name = "S", default_value_t = 60, allow_negative_numbers = true)]
    reference_seconds: u32,
    #[command(flatten)]
    limits: Limits,
}

/// Runs the command.
///
/// # Errors
/// A scene that cannot be read, whatever the renders say, and files that cannot be written.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let samples = Scene::load(&arguments.scene)?.render.samples;
    let renderer = Renderer::new(&arguments.limits)?;
    let Arguments { cache, scene, output, .. } = arguments;
    if let Some(folder) = output {
        make_folder(folder)?;
    }
    let budget = Duration::from_secs(arguments.reference_seconds.into());
    let reference = Reference::new(&renderer, cache, scene, samples, budget)?;
    let bench = Bench { renderer: &renderer, cache, scene, reference: &reference };
    let mut rows = measure_rows(&bench, arguments)?;
    let rivals = arguments.fixed.then(|| fixed::measure_all(&bench, samples, goal(&bench, &rows)));
    let mut rivals = rivals.transpose()?;
    time_again(&bench, &mut rows, rivals.as_deref_mut(), arguments.limits.repeat)?;
    let text = table::sweep(&rows, &reference, rivals.as_deref())?;
    let name = scene.file_stem().unwrap_or_default().to_string_lossy();
    let plots = plots(&name, &rows, &reference, rivals.as_deref().unwrap_or_default());
    if let Some(folder) = output {
        atomic_file::write(&folder.join("tolerance.csv"), &text)?;
        for (file, plot) in plots {
            atomic_file::write(&folder.join(file), &plot.svg())?;
        }
        return Output::new().end_with(&text);
    }
    // What was measured is told even where the plot cannot be written.
    Output::new().end_with(&text)?;
    let file = format!("{name}-tolerance.svg");
    plots.first().map_or(Ok(()), |(_, plot)| atomic_file::write(Path::new(&file), &plot.svg()))
}

fn measure_rows(bench: &Bench<'_>, arguments: &Arguments) -> Result<Vec<Row>> {
    let bar = Bar::new("tolerance", "pictures");
    let exact = (!arguments.no_exact).then_some(0.0);
    let all: Vec<f64> = arguments.tolerances.iter().copied().chain(exact).collect();
    let row = |(done, &tolerance): (u64, &f64)| {
        bar.show("tolerance", done, all.len() as u64);
        let text = if tolerance > 0.0 { format!("{}%", 100.0 * tolerance) } else { "0".into() };
        Ok(Row { tolerance, measured: bench.measure(vec!["--tolerance".into(), text])? })
    };
    (0..).zip(&all).map(row).collect()
}

/// What rivals are tried for: the least error of all rows, and no longer than those by tolerance
/// take.
fn goal(bench: &Bench<'_>, rows: &[Row]) -> Goal {
    let errors = rows.iter().map(|row| table::reachable(&row.measured, bench.reference));
    let approximate = rows.iter().filter(|row| row.tolerance > 0.0);
    Goal {
        error: errors.fold(f64::INFINITY, f64::min),
        seconds: approximate.map(|row| row.measured.seconds).fold(0.0, f64::max),
    }
}

/// Rows and their rivals take turns, so that what slows the machine down slows both.
fn time_again(
    bench: &Bench<'_>,
    rows: &mut [Row],
    mut rivals: Option<&mut [Rival]>,
    repeat: u32,
) -> Result<()> {
    let bar = Bar::new("again", "rounds");
    let errors: Vec<f64> =
        rows.iter().map(|row| table::reachable(&row.measured, bench.reference)).collect();
    for round in 1..repeat {
        bar.show("again", round.into(), repeat.into());
        rows.iter_mut().try_for_each(|row| bench.time_again(&mut row.measured))?;
        if let Some(rivals) = rivals.as_deref_mut() {
            fixed::time_again(bench, rivals, &errors)?;
        }
    }
    Ok(())
}
