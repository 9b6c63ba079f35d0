//! `deepfield bench scaling`.

use std::path::{Path, PathBuf};

use clap::Args;

use super::cpu::timed;
use super::renderer::{Limits, Renderer};
use super::scaling_data::{Data, DataMaker, Scenes};
use super::scaling_table::{Measured, View, plots, row};
use super::table::csv;
use crate::atomic_file;
use crate::cache::{Cache, Cursor};
use crate::cli::output::{Output, make_folder};
use crate::cli::progress::Bar;
use crate::cli::{size, values};
use crate::{Error, Result};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Simulation outputs and caches, by size (default: one recipe written at each of --scales)
    inputs: Vec<PathBuf>,
    /// Cells along each axis of the data sets made for this, over those of
    /// `datasets_synthetic/scaling.toml`
    #[arg(
        long, value_name = "LIST", default_value = "0.5,0.7,1", conflicts_with = "inputs",
        value_delimiter = ',', value_parser = values::positive, allow_hyphen_values = true
    )]
    scales: Vec<f64>,
    /// A scene, the same for all data (repeat for more; default: the recipe's own, or a camera
    /// outside and one in the deepest region)
    #[arg(long, value_name = "SCENE")]
    scene: Vec<PathBuf>,
    /// Memory limit of each ingest
    #[arg(
        long,
        value_name = "SIZE",
        default_value = "1GiB",
        value_parser = size::parse,
        allow_hyphen_values = true
    )]
    ingest_memory: u64,
    /// Where data and caches are made and removed again (default: the system's folder of
    /// temporary files)
    #[arg(long, value_name = "DIR")]
    folder: Option<PathBuf>,
    /// Write scaling.csv and plots of time and memory to this folder too
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    #[command(flatten)]
    limits: Limits,
}

/// Runs the command.
///
/// # Errors
/// Whatever making data, ingest and renders say, and files that cannot be written.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let data = match &arguments.inputs[..] {
        [] => arguments.scales.iter().copied().map(Data::Made).collect(),
        given => given.iter().cloned().map(Data::Given).collect::<Vec<_>>(),
    };
    if let Some(folder) = &arguments.output {
        make_folder(folder)?;
    }
    let bench = Bench::new(arguments)?;
    let (mut all, mut text) = (Vec::new(), String::new());
    for data in &data {
        all.push(bench.measure(data)?);
        text = csv(&all.iter().map(row).collect::<Vec<_>>())?;
        // After each: the largest data may be more than the disk holds.
        if let Some(folder) = &arguments.output {
            save(folder, &text, &all)?;
        }
    }
    Output::new().end_with(&text)
}

fn save(folder: &Path, text: &str, all: &[Measured]) -> Result<()> {
    atomic_file::write(&folder.join("scaling.csv"), text)?;
    for (name, plot) in plots(all) {
        atomic_file::write(&folder.join(name), &plot.svg())?;
    }
    Ok(())
}

/// What all data sets share.
struct Bench<'a> {
    arguments: &'a Arguments,
    maker: DataMaker,
    renderer: Renderer,
}

impl<'a> Bench<'a> {
    fn new(arguments: &'a Arguments) -> Result<Self> {
        let Arguments { folder, ingest_memory, limits, .. } = arguments;
        let maker = DataMaker::new(folder.as_deref(), *ingest_memory, limits.threads)?;
        Ok(Self { arguments, maker, renderer: Renderer::new(limits)? })
    }

    /// Ingests a data set and renders all scenes. What was made for it is gone afterwards.
    fn measure(&self, data: &Data) -> Result<Measured> {
        let prepared = self.maker.prepare(data)?;
        let scenes = match &self.arguments.scene[..] {
            [] => Scenes::of(data, &prepared.cache, &self.maker)?,
            given => Scenes::given(given),
        };
        let bar = Bar::new("scaling", "pictures");
        let mut views = Vec::new();
        for (done, (name, scene)) in (0..).zip(&scenes.list) {
            bar.show(&data.name(), done, scenes.list.len() as u64);
            views.push(self.view(name, &prepared.cache, scene)?);
        }
        let cache = Cache::open(&prepared.cache, Cursor::WINDOWS)?;
        let header = cache.header();
        Ok(Measured {
            name: data.name(),
            ingest: prepared.ingest.clone(),
            cpu_seconds: prepared.cpu_seconds,
            cache_bytes: header.file_bytes,
            bricks: header.nodes(),
            levels: header.levels.iter().filter(|level| level.simulation.is_some()).count(),
            leaf_cells: header.levels.iter().map(|level| level.leaf_cells).sum(),
            views,
        })
    }

    /// The best of several renders.
    fn view(&self, name: &str, cache: &Path, scene: &Path) -> Result<View> {
        let mut best: Option<View> = None;
        for _ in 0..self.arguments.limits.repeat {
            let (cost, cpu_seconds) = timed(|| self.renderer.render(cache, scene, &[]));
            let cost = cost?;
            if best.as_ref().is_none_or(|best| cost.wall_seconds < best.cost.wall_seconds) {
                best = Some(View { name: name.to_owned(), cost, cpu_seconds });
            }
        }
        best.ok_or_else(|| Error::request("--repeat: at least 1"))
    }
}
