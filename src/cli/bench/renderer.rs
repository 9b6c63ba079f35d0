//! Pictures made by `deepfield render` in processes of their own: peak memory and a cold start
//! are those of one picture then.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::Args;
use serde::Deserialize;

use crate::cli::{itself, size, values};
use crate::leftovers::ScratchFolder;
use crate::render::Film;
use crate::{Error, Result};

/// How all pictures of a benchmark are made.
#[derive(Debug, Clone, Args)]
pub(super) struct Limits {
    /// Memory limit of each render
    #[arg(
        long,
        value_name = "SIZE",
        default_value = "1GiB",
        value_parser = size::parse,
        allow_hyphen_values = true
    )]
    pub(super) memory: u64,
    /// Threads (default: as `render` has it)
    #[arg(
        long,
        value_name = "N",
        value_parser = clap::value_parser!(u32).range(1..=1024),
        allow_negative_numbers = true
    )]
    pub(super) threads: Option<u32>,
    /// Pixels in a row and rows, as in `320x180` (default: the scene's)
    #[arg(long, value_name = "WxH", value_parser = values::size_text, allow_hyphen_values = true)]
    pub(super) size: Option<String>,
    /// Renders of each picture; the best time counts
    #[arg(
        long, value_name = "N", default_value_t = 3,
        value_parser = clap::value_parser!(u32).range(1..=1000), allow_negative_numbers = true
    )]
    pub(super) repeat: u32,
}

/// What one picture took, as its stats say; of keys that they may lack, nothing.
#[derive(Debug, Clone, Deserialize)]
pub(super) struct Cost {
    /// Opening, loading and rendering, without writing the picture, seconds.
    pub(super) wall_seconds: f64,
    /// Opening, seconds.
    pub(super) open_seconds: f64,
    /// Loading before anything is drawn, seconds.
    pub(super) load_seconds: f64,
    /// Rendering, with what is loaded meanwhile, seconds.
    pub(super) render_seconds: f64,
    /// Part of rendering: what marching threads waited for the file or for other threads, all
    /// together, seconds.
    pub(super) wait_seconds: f64,
    /// Part of rendering: what marching threads spent on preparing bricks themselves, all together,
    /// seconds.
    pub(super) own_loading_seconds: f64,
    /// Threads that march.
    pub(super) threads: usize,
    /// Tolerance as used, absolute.
    pub(super) tolerance: Option<f64>,
    /// The certified bound, absolute.
    pub(super) error_bound: Option<f64>,
    /// The error in all likelihood, absolute.
    pub(super) error_estimate: Option<f64>,
    /// Largest share of each part of the bound.
    pub(super) error_shares: Option<BTreeMap<String, Option<f64>>>,
    /// Bytes of payloads read.
    pub(super) bytes_read: u64,
    /// Bytes of payloads after decompression.
    pub(super) bytes_decompressed: u64,
    /// Bricks loaded, each counted once.
    pub(super) bricks_loaded: u64,
    /// Loads of bricks that had been loaded before, in the same digits.
    pub(super) bricks_reloaded: u64,
    /// Loads of bricks that had been loaded before in other digits alone.
    pub(super) bricks_in_other_digits: u64,
    /// Stretches of rays that were integrated.
    pub(super) samples: u64,
    /// Rays, over the whole picture.
    pub(super) rays: Option<u64>,
    /// Largest resident set of the process, bytes.
    pub(super) peak_rss_bytes: Option<u64>,
}

/// Runs this program's own `render`.
#[derive(Debug)]
pub(super) struct Renderer {
    folder: ScratchFolder,
    limits: Vec<String>,
}

impl Renderer {
    /// A renderer within `limits`.
    ///
    /// # Errors
    /// A system that gives no temporary folder or does not say where this program lies.
    pub(super) fn new(limits: &Limits) -> Result<Self> {
        let folder = ScratchFolder::new()?;
        let mut words = vec!["--memory".to_owned(), limits.memory.to_string()];
        words.extend(limits.threads.map(|threads| format!("--threads={threads}")));
        words.extend(limits.size.iter().map(|size| format!("--size={size}")));
        Ok(Self { folder, limits: words })
    }

    /// Renders `scene` from `cache` with further `options` of `deepfield render`.
    ///
    /// # Errors
    /// Whatever the render says.
    pub(super) fn render(&self, cache: &Path, scene: &Path, options: &[String]) -> Result<Cost> {
        let mut command = itself::command()?;
        command
            .arg("render")
            .args(options)
            .args(&self.limits)
            .arg("-o")
            .arg(self.picture_path())
            .arg("--stats")
            .arg(self.stats_path())
            .arg("--")
            .args([cache, scene]);
        itself::run(&mut command)?;
        itself::read_stats(&self.stats_path())
    }

    /// The picture of the last render.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub(super) fn picture(&self) -> Result<Film> {
        let path = self.picture_path();
        let image = exr::prelude::read_first_rgba_layer_from_file(
            &path,
            |size, _| (size.width(), vec![[0.0; 4]; size.area()]),
            |(width, pixels): &mut (usize, Vec<[f32; 4]>), at, (r, g, b, a)| {
                pixels[at.y() * *width + at.x()] = [r, g, b, a];
            },
        )
        .map_err(|error| Error::invalid(path.display(), error.to_string()))?;
        let (width, pixels) = image.layer_data.channel_data.pixels;
        let side = |pixels: usize| u32::try_from(pixels).unwrap_or(u32::MAX);
        let mut film = Film::new(side(width), side(pixels.len() / width.max(1)))?;
        film.write_rectangle(0, 0, side(width), &pixels)?;
        Ok(film)
    }

    fn picture_path(&self) -> PathBuf {
        self.folder.path().join("picture.exr")
    }

    fn stats_path(&self) -> PathBuf {
        self.folder.path().join("stats.json")
    }
}
