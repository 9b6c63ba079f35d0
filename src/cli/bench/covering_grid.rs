//! `deepfield bench covering-grid`.

use std::path::{Path, PathBuf};

use clap::Args;

use super::covering_table::{Kind, Measured, Subject, plots, rows};
use super::dense::{CoveringGrid, cells};
use super::plain_array::PlainArray;
use super::reference::largest_difference;
use super::renderer::{Cost, Limits, Renderer};
use super::table::csv;
use super::viewpoints;
use crate::atomic_file;
use crate::cache::{BrickShape, Cache, Cursor, TreeLevel};
use crate::cli::output::{Output, make_folder, warn};
use crate::cli::progress::Bar;
use crate::cli::values;
use crate::ingest::{self, Options, Progress, in_pool};
use crate::leftovers::ScratchFolder;
use crate::render::Film;
use crate::render::memory::loaded_bytes;
use crate::scene::{Interpolation, Samples, Scene};
use crate::space::Domain;
use crate::{Error, Result};

/// Cells along an edge of a grid's bricks: of the sizes that there are, the fastest to march where
/// all cells are there.
const EDGE: u32 = 16;
/// The march's relative accuracy where it is picked by hand.
const ACCURACY: f64 = 1e-3;
/// A grid's bricks hold themselves and one block of the level above.
const BLOCKS: usize = 2;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The cache
    cache: PathBuf,
    /// Scenes (TOML) that give a `range` (default: a camera outside and one in the deepest region)
    scenes: Vec<PathBuf>,
    /// A grid's level, or several as `0..4` (repeat for more; default: from 0 while --memory has
    /// room)
    #[arg(
        long,
        visible_alias = "levels",
        value_name = "L",
        value_parser = parse_levels,
        allow_hyphen_values = true
    )]
    level: Vec<(u32, u32)>,
    /// Largest error: a number, or `p%` of the picture's largest value (default: the scene's)
    #[arg(
        long,
        value_name = "T",
        value_parser = values::tolerance_text,
        allow_hyphen_values = true
    )]
    tolerance: Option<String>,
    /// n for n×n rays a pixel, or `area` (default: the scene's)
    #[arg(
        long,
        value_name = "N|area",
        value_parser = values::samples_text,
        allow_negative_numbers = true
    )]
    samples: Option<String>,
    /// Write covering-grid.csv and a plot of time for each scene to this folder too, and the scenes if
    /// none are given
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    #[command(flatten)]
    limits: Limits,
}

/// Runs the command.
///
/// # Errors
/// A cache, scene or level that does not fit, and whatever ingest and renders say.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let folder = ScratchFolder::new()?;
    let cache = Cache::open(&arguments.cache, Cursor::WINDOWS)?;
    arguments.scenes.iter().try_for_each(|scene| has_range(scene, &cache))?;
    let levels = chosen(&cache, arguments)?;
    if let Some(folder) = &arguments.output {
        make_folder(folder)?;
    }
    let scenes = match &arguments.scenes[..] {
        [] => viewpoints::write(&cache, arguments.output.as_deref().unwrap_or(folder.path()))?,
        given => given.to_vec(),
    };
    let mut bench = Bench::new(arguments, &scenes)?;
    let mut subjects = vec![bench.measure_cache(&cache)?];
    match bench.measure_all_levels(&subjects[0]) {
        Ok(subject) => subjects.push(subject),
        Err(error) => {
            let reason = "without all levels in memory, which may take twice --memory";
            warn(format!("{reason}: {error}"));
        }
    }
    for level in levels {
        subjects.push(bench.measure_grid(&cache, level, folder.path())?);
    }
    bench.repeat(&mut subjects, arguments.limits.repeat)?;
    let text = csv(&rows(&subjects, &names(&scenes, folder.path())))?;
    if let Some(folder) = &arguments.output {
        atomic_file::write(&folder.join("covering-grid.csv"), &text)?;
        for (name, plot) in plots(&subjects, &scenes) {
            atomic_file::write(&folder.join(name), &plot.svg())?;
        }
    }
    Output::new().end_with(&text)
}

/// What scenes are called: of those that vanish with `scratch` nothing but their names.
fn names(scenes: &[PathBuf], scratch: &Path) -> Vec<PathBuf> {
    scenes.iter().map(|path| path.strip_prefix(scratch).unwrap_or(path).to_owned()).collect()
}

/// `3`, or `0..4` with both ends.
fn parse_levels(text: &str) -> Result<(u32, u32), String> {
    let (first, last) = text.split_once("..").unwrap_or((text, text));
    match (first.trim().parse(), last.trim().parse()) {
        (Ok(first), Ok(last)) if first <= last => Ok((first, last)),
        _ => Err(format!("`{text}` is no level: write one as 3, or several as 0..4")),
    }
}

/// Without a range of its own a scene takes the field's extrema, and those of a grid are others.
fn has_range(path: &Path, cache: &Cache) -> Result<()> {
    let volume = Scene::load(path)?.volume;
    if volume.range.is_some() {
        return Ok(());
    }
    let header = cache.header();
    let extrema = header.field(&volume.field).and_then(|field| header.fields.get(field));
    let example = extrema.map_or_else(String::new, |field| {
        format!(", for the field's own extrema range = [{:e}, {:e}]", field.min, field.max)
    });
    Err(Error::invalid(
        path.display(),
        format!(
            "without `range` each grid would be mapped by extrema of its own: give one{example}"
        ),
    ))
}

/// The levels of the grids to compare with.
fn chosen<'c>(cache: &'c Cache, arguments: &Arguments) -> Result<Vec<&'c TreeLevel>> {
    let header = cache.header();
    let all = || header.levels.iter().filter(|level| level.simulation.is_some());
    let has_room = |level: &&TreeLevel| {
        resident_bytes(&header.domain, level.octree) <= u128::from(arguments.limits.memory)
    };
    let too_large = |level: &TreeLevel| {
        Error::request(format!(
            "the grid of level {} takes {} MiB when it is loaded: raise --memory or choose a \
             coarser --level",
            level.simulation.unwrap_or(0),
            resident_bytes(&header.domain, level.octree).div_ceil(1 << 20)
        ))
    };
    if arguments.level.is_empty() {
        let levels: Vec<_> = all().take_while(has_room).collect();
        return match (levels.is_empty(), all().next()) {
            (true, Some(first)) => Err(too_large(first)),
            _ => Ok(levels),
        };
    }
    let deepest = all().filter_map(|level| level.simulation).max().unwrap_or(0);
    if let Some((_, last)) = arguments.level.iter().find(|(_, last)| *last > deepest) {
        return Err(Error::request(format!(
            "--level {last}: the deepest level of {} is {deepest}",
            cache.path().display()
        )));
    }
    let is_asked = |level: &&TreeLevel| {
        let number = level.simulation.unwrap_or(0);
        arguments.level.iter().any(|(first, last)| (*first..=*last).contains(&number))
    };
    let levels: Vec<_> = all().filter(is_asked).collect();
    match levels.iter().find(|level| !has_room(level)) {
        Some(level) => Err(too_large(level)),
        None => Ok(levels),
    }
}

/// Bytes of the grid at octree level `octree` when all its bricks are loaded, with those of the
/// levels above it.
fn resident_bytes(domain: &Domain, octree: i32) -> u128 {
    let mut along = cells(domain, octree).map(|cells| cells.div_ceil(EDGE.into()));
    let count = |along: [u128; 3]| along.iter().fold(1, |n: u128, more| n.saturating_mul(*more));
    let mut bricks = count(along);
    while along.iter().any(|bricks| *bricks > 1) {
        along = along.map(|bricks| bricks.div_ceil(2));
        bricks = bricks.saturating_add(count(along));
    }
    let each = [Interpolation::Cell, Interpolation::Linear].map(|interpolation| {
        BrickShape::new(EDGE).map_or(0, |shape| loaded_bytes(shape, BLOCKS, interpolation))
    });
    let each = each[0].max(each[1]);
    bricks.saturating_mul(each.into())
}

/// What all measurements share.
struct Bench<'b> {
    arguments: &'b Arguments,
    scenes: &'b [PathBuf],
    renderer: Renderer,
    /// For what is loaded before: all bricks take up to the limit, what else a picture takes as much.
    resident: Renderer,
    /// The cache's pictures.
    pictures: Vec<Film>,
}

impl<'b> Bench<'b> {
    fn new(arguments: &'b Arguments, scenes: &'b [PathBuf]) -> Result<Self> {
        let memory = arguments.limits.memory.saturating_mul(2);
        let resident = Renderer::new(&Limits { memory, ..arguments.limits.clone() })?;
        let renderer = Renderer::new(&arguments.limits)?;
        Ok(Self { arguments, scenes, renderer, resident, pictures: Vec::new() })
    }

    fn measure_cache(&mut self, cache: &Cache) -> Result<Subject> {
        let header = cache.header();
        let simulated = || header.levels.iter().filter(|level| level.simulation.is_some());
        let mut subject = Subject {
            kind: Kind::Cache,
            level: simulated().filter_map(|level| level.simulation).max().unwrap_or(0),
            cells: simulated().map(|level| u128::from(level.cells)).sum(),
            file_bytes: header.file_bytes,
            path: self.arguments.cache.clone(),
            measured: Vec::new(),
        };
        for scene in self.scenes {
            let cost = self.draw(&subject, scene)?;
            let picture = self.renderer.picture()?;
            subject.measured.push(Measured::new(cost, 0.0, picture.largest_value()));
            self.pictures.push(picture);
        }
        Ok(subject)
    }

    /// All levels in memory, as the cache's file has them.
    ///
    /// # Errors
    /// Whatever a render says; a limit without room for all bricks above all.
    fn measure_all_levels(&self, cache: &Subject) -> Result<Subject> {
        let path = cache.path.clone();
        let mut subject = Subject { kind: Kind::AllLevels, path, measured: Vec::new(), ..*cache };
        self.measure_rival(&mut subject)?;
        Ok(subject)
    }

    /// Draws all scenes once, beside the cache's pictures.
    fn measure_rival(&self, subject: &mut Subject) -> Result<()> {
        for (scene, picture) in self.scenes.iter().zip(&self.pictures) {
            let cost = self.draw(subject, scene)?;
            let film = self.renderer_of(subject).picture()?;
            let difference = largest_difference(picture, &film);
            subject.measured.push(Measured::new(cost, difference, film.largest_value()));
        }
        Ok(())
    }

    /// Writes the grid at `level` to `folder` and renders it.
    fn measure_grid(&mut self, cache: &Cache, level: &TreeLevel, folder: &Path) -> Result<Subject> {
        let number = level.simulation.unwrap_or(0);
        let path = folder.join(format!("grid-{number}.dfc"));
        let grid = CoveringGrid::new(cache, level)?;
        let file_bytes = self.write_grid(cache, &grid, &path)?;
        let array = PlainArray::write(&grid, folder.join(format!("grid-{number}.f32")))?;
        let mut subject = Subject {
            kind: Kind::Grid(array),
            level: number,
            cells: cells(&cache.header().domain, level.octree).iter().product(),
            file_bytes,
            path,
            measured: Vec::new(),
        };
        self.measure_rival(&mut subject)?;
        Ok(subject)
    }

    /// How large the file is that holds the grid, bytes.
    fn write_grid(&self, cache: &Cache, grid: &CoveringGrid<'_>, path: &Path) -> Result<u64> {
        let threads = self.arguments.limits.threads.map(|threads| threads as usize);
        let options = Options {
            fields: cache.header().fields.iter().map(|field| field.name.clone()).collect(),
            threads,
            brick: Some(EDGE),
            ..Options::default()
        };
        in_pool(threads, || {
            cache.set_index_windows((rayon::current_num_threads() + 1) * Cursor::WINDOWS + 1);
            Ok(())
        })?;
        let bar = Bar::new("grid", "bricks");
        let mut listener = |_, done, total| bar.show("grid", done, total);
        let header = ingest::ingest(grid, path, &options, &mut Progress::new(&mut listener))?;
        Ok(header.file_bytes)
    }

    /// All subjects take turns, so that what slows the machine down slows all.
    fn repeat(&self, subjects: &mut [Subject], rounds: u32) -> Result<()> {
        let bar = Bar::new("again", "rounds");
        for round in 1..rounds {
            bar.show("again", round.into(), rounds.into());
            for subject in subjects.iter_mut() {
                if let Kind::Grid(array) = &mut subject.kind {
                    array.read()?;
                }
                for (number, scene) in self.scenes.iter().enumerate() {
                    let cost = self.draw(subject, scene)?;
                    subject.measured[number].take(&cost);
                }
            }
        }
        Ok(())
    }

    /// Draws `scene` as the subject's kind asks.
    fn draw(&self, subject: &Subject, scene: &Path) -> Result<Cost> {
        let Arguments { tolerance, samples, .. } = self.arguments;
        let tolerance = tolerance.iter().map(|tolerance| format!("--tolerance={tolerance}"));
        let samples = samples.iter().map(|samples| format!("--samples={samples}"));
        let resident = || "--resident".to_owned();
        let options: Vec<_> = match subject.kind {
            Kind::Cache => tolerance.chain(samples).collect(),
            Kind::Grid(_) => tolerance.chain(samples).chain([resident()]).collect(),
            Kind::AllLevels => {
                vec![resident(), format!("--fixed=0,{},{ACCURACY:e}", self.rays(scene)?)]
            }
        };
        self.renderer_of(subject).render(&subject.path, scene, &options)
    }

    fn renderer_of(&self, subject: &Subject) -> &Renderer {
        match subject.kind {
            Kind::Cache => &self.renderer,
            Kind::AllLevels | Kind::Grid(_) => &self.resident,
        }
    }

    /// Rays along a pixel's axis: one where the program would choose.
    fn rays(&self, scene: &Path) -> Result<u32> {
        let given = self.arguments.samples.as_deref().map(Samples::parse);
        let chosen = given.unwrap_or_else(|| Ok(Scene::load(scene)?.render.samples));
        Ok(match chosen? {
            Samples::Grid(rays) => rays,
            Samples::Area => 1,
        })
    }
}
