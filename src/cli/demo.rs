//! `deepfield demo`: the newcomer's run, each step a command that could be typed.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use serde_json::Value;

use super::itself;
use super::output::{Output, make_folder};
use super::size;
use crate::atomic_file;
use crate::cache::{Cache, Header};
use crate::{Error, Result};

/// The recipe and the scenes, so that the program alone is enough.
const FILES: [(&str, &str); 3] = [
    ("demo.toml", include_str!("../../datasets_synthetic/demo.toml")),
    ("outside.toml", include_str!("../../datasets_synthetic/demo-outside.toml")),
    ("inside.toml", include_str!("../../datasets_synthetic/demo-inside.toml")),
];

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Where everything goes
    #[arg(default_value = "deepfield-demo")]
    directory: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// Files that cannot be written, and whatever a step says.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let directory = &arguments.directory;
    make_folder(directory)?;
    for (name, text) in FILES {
        write(&directory.join(name), text)?;
    }
    let mut output = Output::new();
    let mut steps = Steps { directory, rows: Vec::new() };
    steps.run(&["synth", "demo.toml", "-o", "simulation"])?;
    let dump = steps.dump()?;
    steps.run(&["ingest", &dump, "-o", "demo.dfc"])?;
    for view in ["outside", "inside"] {
        let (scene, picture) = (format!("{view}.toml"), format!("{view}.png"));
        let stats = format!("{view}.json");
        steps.run(&["render", "demo.dfc", &scene, "-o", &picture, "--stats", &stats])?;
    }
    for line in steps.rows {
        output.line(line)?;
    }
    let cache = Cache::open(&directory.join("demo.dfc"), 1)?;
    table(cache.header(), directory, &mut output)?;
    for view in ["outside.png", "inside.png"] {
        output.line(format!("picture: {}", directory.join(view).display()))?;
    }
    output.finish()
}

/// Writes one of the demo's own files, in place of none that says something else.
fn write(path: &Path, text: &str) -> Result<()> {
    let Ok(found) = std::fs::symlink_metadata(path) else { return atomic_file::write(path, text) };
    let is_as_long = found.is_file() && found.len() == text.len() as u64;
    if is_as_long && std::fs::read(path).is_ok_and(|there| there == text.as_bytes()) {
        return Ok(());
    }
    let reason = "is not as `demo` writes it: name another folder, or remove it";
    Err(Error::request(format!("{}: {reason}", path.display())))
}

/// Runs this program's own commands in the demo's folder.
struct Steps<'d> {
    directory: &'d Path,
    rows: Vec<String>,
}

impl Steps<'_> {
    fn run(&mut self, words: &[&str]) -> Result<()> {
        let line = format!("deepfield {}", words.join(" "));
        let started = Instant::now();
        let ended = itself::run(itself::command()?.args(words).current_dir(self.directory))
            .map_err(|error| Error::request(format!("`{line}` failed: {error}")))?;
        // Warnings.
        eprint!("{}", String::from_utf8_lossy(&ended.stderr));
        self.rows.push(format!("{:7.2} s  {line}", started.elapsed().as_secs_f64()));
        Ok(())
    }

    /// The parameter file of what was synthesised, relative to the folder.
    fn dump(&self) -> Result<String> {
        let recipe = crate::synth::Recipe::parse(FILES[0].1, FILES[0].0)?;
        Ok(format!("simulation/{0}/{0}", recipe.name))
    }
}

fn table(header: &Header, directory: &Path, output: &mut Output) -> Result<()> {
    let simulated = || header.levels.iter().filter(|level| level.simulation.is_some());
    let deepest = header.levels.last().map_or(0, |level| level.octree);
    let fine = f64::from(deepest).exp2();
    let covering: f64 = header.domain.root_cells().map(|n| n as f64 * fine).iter().product();
    let cells: u64 = simulated().map(|level| level.cells).sum();
    let source = folder_bytes(&directory.join("simulation"));
    let row =
        |name: &str, adaptive: String, grid: String| format!("{name:<28}{adaptive:>20}{grid:>24}");
    output.line("")?;
    output.line(row("", "brick cache".into(), "covering grid".into()))?;
    output.line(row("levels", format!("0 to {deepest}"), format!("one, at level {deepest}")))?;
    output.line(row("cells", cells.to_string(), format!("{covering:.2e}")))?;
    let grid_bytes = format!("{:.1e} GiB", 4.0 * covering / f64::from(1 << 30));
    output.line(row("file", size::show(header.file_bytes), grid_bytes))?;
    output.line(row("simulation output", size::show(source), String::new()))?;
    output.line("")?;
    let row = |name: &str, outside: String, inside: String| {
        format!("{name:<28}{outside:>20}{inside:>24}")
    };
    output.line(row("", "from outside".into(), "from inside".into()))?;
    let stats = [stats(&directory.join("outside.json"))?, stats(&directory.join("inside.json"))?];
    let mut line = |name: &str, show: &dyn Fn(&Value) -> String| {
        output.line(row(name, show(&stats[0]), show(&stats[1])))
    };
    let count = |key: &'static str| move |stats: &Value| stats[key].to_string();
    line("time to render", &|s| format!("{:.2} s", s["render_seconds"].as_f64().unwrap_or(0.0)))?;
    line("peak memory", &|s| size::show(s["peak_rss_bytes"].as_u64().unwrap_or(0)))?;
    line("bricks in the cache", &count("bricks_total"))?;
    line("bricks read", &count("bricks_loaded"))?;
    line("drawn by finer bricks", &count("bricks_covered"))?;
    let number = |stats: &Value, key| stats[key].as_u64().unwrap_or(0);
    let beside = |s: &Value| number(s, "bricks_total").saturating_sub(number(s, "bricks_in_view"));
    line("skipped: out of view", &|stats| beside(stats).to_string())?;
    line("skipped: too fine to see", &count("bricks_skipped_resolution"))?;
    line("skipped: transparent", &count("bricks_skipped_transparent"))?;
    line("skipped: needed by no ray", &count("bricks_skipped_occluded"))?;
    line("deepest level drawn", &count("deepest_level_used"))?;
    output.line("")
}

fn stats(path: &Path) -> Result<Value> {
    let text = std::fs::read_to_string(path)
        .map_err(|source| Error::io(path, "cannot read the stats", source))?;
    serde_json::from_str(&text).map_err(|error| Error::invalid(path.display(), error.to_string()))
}

/// Bytes of all files in a folder and those in it.
fn folder_bytes(folder: &Path) -> u64 {
    let Ok(entries) = std::fs::read_dir(folder) else { return 0 };
    let bytes = |entry: std::fs::DirEntry| match entry.metadata() {
        Ok(data) if data.is_dir() => folder_bytes(&entry.path()),
        Ok(data) => data.len(),
        Err(_) => 0,
    };
    entries.flatten().map(bytes).sum()
}
