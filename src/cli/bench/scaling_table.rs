//! The rows and plots of `deepfield bench scaling`.

use super::plot::{Mark, Plot, Series};
use super::renderer::Cost;
use super::table::{Columns, column, optional};
use crate::cli::ingest_stats::IngestStats;

const MEGABYTE: f64 = 1e6;

/// One scene's best picture.
#[derive(Debug)]
pub(super) struct View {
    /// The scene's name.
    pub(super) name: String,
    /// What the picture took.
    pub(super) cost: Cost,
    /// Processor time of the process, seconds.
    pub(super) cpu_seconds: Option<f64>,
}

/// What a data set took.
#[derive(Debug)]
pub(super) struct Measured {
    /// The data set's name.
    pub(super) name: String,
    /// None where a cache was given.
    pub(super) ingest: Option<IngestStats>,
    /// Processor time of the ingest, seconds.
    pub(super) cpu_seconds: Option<f64>,
    /// Size of the cache, bytes.
    pub(super) cache_bytes: u64,
    /// Bricks of the cache.
    pub(super) bricks: u64,
    /// Levels of the simulation.
    pub(super) levels: usize,
    /// Leaf cells of all levels.
    pub(super) leaf_cells: u64,
    /// The picture of each scene.
    pub(super) views: Vec<View>,
}

/// A data set's row.
pub(super) fn row(measured: &Measured) -> Columns {
    let ingest = measured.ingest.as_ref();
    let seconds = |of: fn(&IngestStats) -> f64| ingest.map(|i| format!("{:.2}", of(i)));
    let rate = |i: &IngestStats| format!("{:.1}", megabytes_per_second(i));
    let mut columns = vec![
        column("data", &measured.name),
        optional("source_bytes", ingest.map(|i| i.source_bytes)),
        column("levels", measured.levels),
        column("leaf_cells", measured.leaf_cells),
        column("bricks", measured.bricks),
        column("cache_bytes", measured.cache_bytes),
        optional("ingest_seconds", seconds(|i| i.wall_seconds)),
        optional("ingest_cpu_seconds", measured.cpu_seconds.map(|s| format!("{s:.2}"))),
        optional("ingest_hierarchy_seconds", seconds(|i| i.hierarchy_seconds)),
        optional("ingest_cells_seconds", seconds(|i| i.cells_seconds)),
        optional("ingest_write_seconds", seconds(|i| i.write_seconds)),
        optional("ingest_megabytes_per_second", ingest.map(rate)),
        optional("ingest_peak_rss_bytes", ingest.and_then(|i| i.peak_rss_bytes)),
    ];
    measured.views.iter().for_each(|view| columns.extend(of_view(view)));
    columns
}

/// Megabytes of the source a second.
fn megabytes_per_second(ingest: &IngestStats) -> f64 {
    ingest.source_bytes as f64 / MEGABYTE / ingest.wall_seconds
}

fn of_view(View { name, cost, cpu_seconds }: &View) -> Columns {
    let named = |what: &str| format!("{name}_{what}");
    let threads = cost.threads as f64 * cost.render_seconds;
    vec![
        column(named("seconds"), format!("{:.3}", cost.wall_seconds)),
        optional(named("cpu_seconds"), cpu_seconds.map(|s| format!("{s:.2}"))),
        column(named("open_seconds"), format!("{:.6}", cost.open_seconds)),
        column(named("wait_share"), format!("{:.4}", cost.wait_seconds / threads)),
        column(named("own_loading_share"), format!("{:.4}", cost.own_loading_seconds / threads)),
        optional(named("peak_rss_bytes"), cost.peak_rss_bytes),
        column(named("bricks_loaded"), cost.bricks_loaded),
        column(named("bricks_reloaded"), cost.bricks_reloaded),
        column(named("bricks_in_other_digits"), cost.bricks_in_other_digits),
        column(named("bytes_read"), cost.bytes_read),
    ]
}

/// Time and memory against the number of bricks, each with its file's name.
pub(super) fn plots(all: &[Measured]) -> Vec<(&'static str, Plot)> {
    let series = |name: &str, of: &dyn Fn(&Measured) -> Option<f64>| {
        let points = all.iter().filter_map(|m| Some([m.bricks as f64, of(m)?]));
        Series::new(name, Mark::Joined, points)
    };
    let views = all.first().map_or(&[][..], |first| &first.views);
    let of_views = |of: fn(&Cost) -> Option<f64>| {
        views.iter().enumerate().map(move |(n, view)| {
            series(&view.name, &|m| m.views.get(n).and_then(|view| of(&view.cost)))
        })
    };
    let plot = |what: &str, series: Vec<Series>| Plot {
        title: format!("{what} against the size of the data"),
        x_label: "bricks".to_owned(),
        y_label: what.to_owned(),
        series,
        lines: Vec::new(),
    };
    let ingest = |of: fn(&IngestStats) -> Option<f64>| {
        series("ingest", &move |m: &Measured| m.ingest.as_ref().and_then(of))
    };
    let mut seconds = vec![ingest(|i| Some(i.wall_seconds))];
    seconds.extend(of_views(|cost| Some(cost.wall_seconds)));
    let mut memory = vec![ingest(|i| i.peak_rss_bytes.map(|bytes| bytes as f64))];
    memory.extend(of_views(|cost| cost.peak_rss_bytes.map(|bytes| bytes as f64)));
    let peak = plot("peak resident set (bytes)", memory);
    vec![("seconds.svg", plot("time (s)", seconds)), ("memory.svg", peak)]
}
