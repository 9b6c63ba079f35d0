//! A cache beside all its levels in memory and beside covering grids, as rows and plots.

use std::path::{Path, PathBuf};

use super::plain_array::PlainArray;
use super::plot::{Line, Mark, Plot, Series};
use super::renderer::Cost;
use super::table::{Columns, column, number, optional};

/// Bytes of a value in an array of plain 32-bit floats.
const VALUE_BYTES: u128 = 4;

/// What is drawn, and how.
#[derive(Debug)]
pub(super) enum Kind {
    /// The cache, by tolerance, streamed.
    Cache,
    /// The cache, all bricks of all levels loaded before, and drawn by settings that ask nothing of
    /// the error: sparse volumes of all levels with masks, without a choice of levels.
    AllLevels,
    /// A grid, loaded before; with it the same as an array of plain values.
    Grid(PlainArray),
}

impl Kind {
    fn name(&self) -> &'static str {
        match self {
            Kind::Cache => "cache",
            Kind::AllLevels => "levels",
            Kind::Grid(_) => "grid",
        }
    }

    fn array(&self) -> Option<&PlainArray> {
        match self {
            Kind::Grid(array) => Some(array),
            _ => None,
        }
    }
}

/// The cache, or a rival.
#[derive(Debug)]
pub(super) struct Subject {
    /// Which of them it is.
    pub(super) kind: Kind,
    /// The grid's level, or the cache's deepest.
    pub(super) level: u32,
    /// Cells of the grid, or of all levels of the simulation.
    pub(super) cells: u128,
    /// Size of the file, bytes.
    pub(super) file_bytes: u64,
    /// The file.
    pub(super) path: PathBuf,
    /// What each scene took.
    pub(super) measured: Vec<Measured>,
}

/// What one picture of a subject took: the least of all its renders.
#[derive(Debug)]
pub(super) struct Measured {
    cost: Cost,
    /// Largest difference to the cache's picture, absolute.
    difference: f64,
    /// Largest value of its picture.
    largest: f64,
}

impl Measured {
    /// What the first render took.
    pub(super) fn new(cost: Cost, difference: f64, largest: f32) -> Self {
        Self { cost, difference, largest: largest.into() }
    }

    /// Another render of the same picture.
    pub(super) fn take(&mut self, again: &Cost) {
        let Cost { wall_seconds, open_seconds, load_seconds, render_seconds, .. } = &mut self.cost;
        *wall_seconds = wall_seconds.min(again.wall_seconds);
        *open_seconds = open_seconds.min(again.open_seconds);
        *load_seconds = load_seconds.min(again.load_seconds);
        *render_seconds = render_seconds.min(again.render_seconds);
    }

    /// From the file to what rays can march through, seconds: of a cache no more than opening it.
    fn loading_seconds(&self) -> f64 {
        self.cost.open_seconds + self.cost.load_seconds
    }
}

/// A row for each subject and scene; the cache comes first.
pub(super) fn rows(subjects: &[Subject], scenes: &[PathBuf]) -> Vec<Columns> {
    let Some(cache) = subjects.first() else { return Vec::new() };
    let of_scene = |(place, scene)| {
        subjects.iter().filter_map(move |subject| row(subject, cache, place, scene))
    };
    let scenes = scenes.iter().map(PathBuf::as_path);
    scenes.enumerate().flat_map(of_scene).collect()
}

fn row(subject: &Subject, cache: &Subject, place: usize, scene: &Path) -> Option<Columns> {
    let (measured, other) = (subject.measured.get(place)?, cache.measured.get(place)?);
    let (cost, cache_cost) = (&measured.cost, &other.cost);
    let array = subject.kind.array();
    let array_bytes = array.map(|_| subject.cells * VALUE_BYTES);
    let array_seconds = array.map(|array| array.seconds);
    let least_seconds = array_seconds.map(|seconds| seconds + cost.render_seconds);
    let largest = other.largest;
    let relative = (largest > 0.0).then(|| number(measured.difference / largest));
    let peak = |cost: &Cost| cost.peak_rss_bytes.map(|bytes| bytes as f64);
    let memory = peak(cost).zip(peak(cache_cost));
    let array = array_bytes.zip(peak(cache_cost));
    Some(vec![
        column("scene", scene.display()),
        column("data", subject.kind.name()),
        column("level", subject.level),
        column("cells", subject.cells),
        optional("array_bytes", array_bytes),
        column("file_bytes", subject.file_bytes),
        optional("array_seconds", array_seconds),
        column("loading_seconds", measured.loading_seconds()),
        column("render_seconds", cost.render_seconds),
        column("seconds", cost.wall_seconds),
        optional("peak_rss_bytes", cost.peak_rss_bytes),
        optional("tolerance_absolute", cost.tolerance.map(number)),
        optional("error_bound", cost.error_bound.map(number)),
        column("difference", number(measured.difference)),
        optional("difference_relative", relative),
        ratio("cells_over_cache", subject.cells as f64 / cache.cells as f64),
        ratio("file_over_cache", subject.file_bytes as f64 / cache.file_bytes as f64),
        ratio("loading_over_cache", measured.loading_seconds() / other.loading_seconds()),
        ratio("render_over_cache", cost.render_seconds / cache_cost.render_seconds),
        ratio("seconds_over_cache", cost.wall_seconds / cache_cost.wall_seconds),
        optional("memory_over_cache", memory.map(|(grid, cache)| rounded(grid / cache))),
        optional("array_over_cache", array.map(|(grid, cache)| rounded(grid as f64 / cache))),
        optional(
            "least_seconds_over_cache",
            least_seconds.map(|seconds| rounded(seconds / cache_cost.wall_seconds)),
        ),
    ])
}

fn ratio(name: &str, value: f64) -> (String, String) {
    column(name, rounded(value))
}

/// Four digits: more are not measured.
fn rounded(value: f64) -> String {
    let digits = 3 - value.abs().max(1e-9).log10().floor() as i32;
    format!("{value:.0$}", usize::try_from(digits).unwrap_or(0))
}

/// For each scene the grids' times over their cells beside the cache's, with the file's name.
pub(super) fn plots(subjects: &[Subject], scenes: &[PathBuf]) -> Vec<(String, Plot)> {
    let named = |(place, scene): (usize, &PathBuf)| {
        let name = scene.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        (format!("{}-{name}.svg", place + 1), plot(subjects, place, &name))
    };
    scenes.iter().enumerate().map(named).collect()
}

fn plot(subjects: &[Subject], place: usize, scene: &str) -> Plot {
    let series = |name: &str, seconds: fn(&Cost) -> f64| {
        let grids = subjects.iter().filter(|subject| subject.kind.array().is_some());
        let points = grids
            .filter_map(|grid| Some([grid.cells as f64, seconds(&grid.measured.get(place)?.cost)]));
        Series::new(name, Mark::Joined, points)
    };
    let line = |subject: &Subject| {
        let cost = &subject.measured.get(place)?.cost;
        let (name, at) = match subject.kind {
            Kind::Cache => ("cache, by tolerance", cost.wall_seconds),
            Kind::AllLevels => ("all levels, loaded before", cost.render_seconds),
            Kind::Grid(_) => return None,
        };
        Some(Line { name: name.to_owned(), is_vertical: false, at })
    };
    Plot {
        title: format!("{scene}: time (s)"),
        x_label: "cells of the covering grid".to_owned(),
        y_label: "time (s)".to_owned(),
        series: vec![
            series("grid, loaded before", |cost| cost.render_seconds),
            series("grid, with loading", |cost| cost.wall_seconds),
        ],
        lines: subjects.iter().filter_map(line).collect(),
    }
}
