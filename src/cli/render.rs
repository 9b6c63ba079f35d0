//! `deepfield render`.

use std::path::PathBuf;
use std::sync::Once;
use std::time::Instant;

use clap::Args;

use super::paths::refuse_same;
use super::progress::Bar;
use super::stats_file::{StatsFile, json};
use super::{fields, size, warnings};
use crate::Result;
use crate::atomic_file::AtomicFile;
use crate::cache::{Cache, Cursor};
use crate::image::{Format, write_exr, write_png};
use crate::render::{FixedSetting, RenderOptions, Rendered, render};
use crate::scene::{ImageSettings, MAX_SAMPLES_PER_AXIS, Samples, Scene, Tolerance};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The cache
    cache: PathBuf,
    /// The scene (TOML)
    scene: PathBuf,
    /// The picture to write: .exr or .png
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Memory limit of the whole process
    #[arg(
        long,
        value_name = "SIZE",
        default_value = "1GiB",
        value_parser = size::parse,
        allow_hyphen_values = true
    )]
    memory: u64,
    /// Threads (default: all cores, or as many as leave half of `--memory` to bricks)
    #[arg(
        long,
        value_name = "N",
        value_parser = clap::value_parser!(u32).range(1..=1024),
        allow_negative_numbers = true
    )]
    threads: Option<u32>,
    /// Largest error: a number, or `p%` of the picture's largest value (default: the scene's)
    #[arg(
        long,
        value_name = "T",
        value_parser = Tolerance::parse,
        allow_hyphen_values = true,
        conflicts_with = "fixed"
    )]
    tolerance: Option<Tolerance>,
    /// n for n×n rays a pixel, or `area` (default: the scene's)
    #[arg(
        long,
        value_name = "N|area",
        value_parser = Samples::parse,
        allow_negative_numbers = true,
        conflicts_with = "fixed"
    )]
    samples: Option<Samples>,
    /// Pixels in a row and rows, as in `320x180` (default: the scene's)
    #[arg(
        long,
        value_name = "WxH",
        value_parser = ImageSettings::parse_size,
        allow_hyphen_values = true
    )]
    size: Option<[u32; 2]>,
    /// For comparison, set by hand instead of by tolerance and without a bound of the error: the largest
    /// cells in pixels (0: all levels), rays along a pixel's edge, and the march's relative accuracy, as
    /// in `1,3,0.001`
    #[arg(
        long,
        value_name = "PIXELS,RAYS,ACCURACY",
        value_parser = parse_fixed,
        allow_hyphen_values = true
    )]
    fixed: Option<FixedSetting>,
    /// Load all bricks of the field before drawing, as renderers do that hold everything in memory:
    /// for comparison
    #[arg(long)]
    resident: bool,
    /// Write what the picture took, as JSON
    #[arg(long, value_name = "FILE.json")]
    stats: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// A cache, scene or option that does not fit, and files that cannot be written.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let started = Instant::now();
    let format = Format::from_path(&arguments.output)?;
    let stats = arguments.stats.as_deref().map(|path| ("the stats", path));
    let written: Vec<_> =
        [("the picture", arguments.output.as_path())].into_iter().chain(stats).collect();
    refuse_same(&written, &[("the cache", &arguments.cache), ("the scene", &arguments.scene)])?;
    let picture = AtomicFile::create(&arguments.output)?;
    let stats_file = arguments.stats.as_deref().map(StatsFile::begin).transpose()?;
    let mut scene = Scene::load(&arguments.scene)?;
    let settings = &mut scene.render;
    settings.tolerance = arguments.tolerance.unwrap_or(settings.tolerance);
    settings.samples = arguments.samples.unwrap_or(settings.samples);
    let ImageSettings { width, height, .. } = scene.image;
    [scene.image.width, scene.image.height] = arguments.size.unwrap_or([width, height]);
    let cache = Cache::open(&arguments.cache, Cursor::WINDOWS)?;
    fields::check(&scene.volume.field, &cache)?;
    let opening = started.elapsed().as_secs_f64();
    let begun = Once::new();
    let warn_once = || {
        begun.call_once(|| {
            warnings::of_scene(&scene, arguments.fixed.is_none());
            warnings::of_nan(&cache, &scene);
            warnings::of_log10(&cache, &scene);
        });
    };
    let bar = Bar::new("render", "tiles");
    let progress = |done, total| {
        // Not before it is certain that there is something to draw, but well before the end.
        warn_once();
        bar.show("render", done, total);
    };
    let options = RenderOptions {
        memory: arguments.memory,
        threads: arguments.threads.map(|n| n as usize),
        progress: Some(&progress),
        fixed: arguments.fixed,
        resident: arguments.resident,
    };
    let mut rendered = render(&cache, &scene, &options)?;
    warn_once();
    drop(bar);
    rendered.stats.set_opening(opening);
    warnings::of_bound(&rendered, &cache, &scene);
    warnings::of_nothing(&rendered, &scene, &cache);
    write_picture(picture, format, &rendered, &scene, &overrides(arguments), &cache)?;
    stats_file.map_or(Ok(()), |file| file.write(&rendered.stats))
}

/// Two numbers ≥ 0, and between them a whole one that [`Samples`] can be.
fn parse_fixed(text: &str) -> Result<FixedSetting, String> {
    let number = |text: &str| text.parse().ok().filter(|n: &f64| n.is_finite() && *n >= 0.0);
    if let [pixels, rays, accuracy] = text.split(',').map(str::trim).collect::<Vec<_>>()[..]
        && let (Some(pixels_per_cell), Some(relative_accuracy)) = (number(pixels), number(accuracy))
        && let Ok(Samples::Grid(rays_per_axis)) = Samples::parse(rays)
    {
        return Ok(FixedSetting { pixels_per_cell, rays_per_axis, relative_accuracy });
    }
    Err(format!(
        "a fixed setting is PIXELS ≥ 0, RAYS (a whole number from 1 to {MAX_SAMPLES_PER_AXIS}) and \
         ACCURACY ≥ 0, as in `1,3,0.001`"
    ))
}

/// What options say in place of the scene's `[render]` table, line by line as it would stand there, were
/// `fixed`, `resident` and `size` keys of it.
fn overrides(arguments: &Arguments) -> String {
    let samples = arguments.samples.map(|samples| match samples {
        Samples::Grid(rays) => format!("samples = {rays}\n"),
        Samples::Area => "samples = \"area\"\n".to_owned(),
    });
    let tolerance = arguments.tolerance.map(|tolerance| match tolerance {
        Tolerance::Absolute(limit) => format!("tolerance = {limit:?}\n"),
        Tolerance::Relative(part) => format!("tolerance = \"{:?}%\"\n", 100.0 * part),
    });
    let fixed = arguments.fixed.map(|fixed| {
        let FixedSetting { pixels_per_cell, rays_per_axis, relative_accuracy } = fixed;
        format!("fixed = \"{pixels_per_cell:?},{rays_per_axis},{relative_accuracy:?}\"\n")
    });
    let resident = arguments.resident.then(|| "resident = true\n".to_owned());
    let size = arguments.size.map(|[width, height]| format!("size = \"{width}x{height}\"\n"));
    [samples, tolerance, fixed, resident, size].into_iter().flatten().collect()
}

fn write_picture(
    file: AtomicFile,
    format: Format,
    rendered: &Rendered,
    scene: &Scene,
    overrides: &str,
    cache: &Cache,
) -> Result<()> {
    let film = &rendered.film;
    match format {
        Format::Png => write_png(file, film, scene.image.exposure, scene.render.background),
        Format::Exr => {
            let attributes = [
                ("deepfieldVersion", env!("CARGO_PKG_VERSION").to_owned()),
                ("deepfieldCache", format!("{:016x}", cache.header().checksum)),
                ("deepfieldScene", scene.source.clone()),
                ("deepfieldOptions", overrides.to_owned()),
                // Not what differs from run to run: equal pictures are equal files.
                ("deepfieldStats", json(&rendered.stats.accuracy())?),
            ];
            let named = attributes.map(|(name, value)| (name.to_owned(), value));
            let attributes: Vec<_> = named.into_iter().filter(|(_, v)| !v.is_empty()).collect();
            write_exr(file, film, &attributes, rendered.writers)
        }
    }
}
