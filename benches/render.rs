//! `cargo bench`: time of a picture by brick size and interpolation, on a synthetic set.
//!
//! Each figure is the best of several runs in one process, so ratios within one table compare
//! like with like.

use std::path::Path;
use std::time::Instant;

use deepfield::cache::{Cache, Cursor};
use deepfield::ingest::{Options, Progress, ingest};
use deepfield::render::{RenderOptions, Rendered, render};
use deepfield::scene::Scene;
use deepfield::synth::{Recipe, write};
use deepfield::{Result, source};

const RECIPE: &str = include_str!("../datasets_synthetic/demo.toml");
const SCENE: &str = include_str!("../datasets_synthetic/demo-inside.toml");
const RUNS: usize = 3;

fn main() -> Result<()> {
    // `cargo test --benches` asks for nothing but a sign of life.
    if std::env::args().any(|argument| argument == "--test") {
        return Ok(());
    }
    let directory = tempfile::tempdir()
        .map_err(|source| deepfield::Error::io("temporary folder", "cannot make", source))?;
    let recipe = Recipe::parse(RECIPE, "demo.toml")?;
    let dump = write(&recipe, directory.path(), &mut |_, _| {})?.input;
    println!(
        "{:<8}{:<8}{:>10}{:>12}{:>14}{:>12}",
        "brick", "mode", "seconds", "samples", "ns/sample", "bricks"
    );
    for brick in [8, 16, 32] {
        let target = directory.path().join(format!("{brick}.dfc"));
        make_cache(&dump, &target, brick)?;
        for (mode, tolerance) in [("cell", "0"), ("linear", "0"), ("linear", "\"0.1%\"")] {
            measure(&target, brick, mode, tolerance)?;
        }
    }
    Ok(())
}

fn make_cache(dump: &Path, target: &Path, brick: u32) -> Result<()> {
    let source = source::open(dump, None)?;
    let options = Options { brick: Some(brick), ..Options::default() };
    let mut quiet = |_, _, _| {};
    ingest(source.as_ref(), target, &options, &mut Progress::new(&mut quiet)).map(|_| ())
}

fn measure(cache: &Path, brick: u32, mode: &str, tolerance: &str) -> Result<()> {
    let text = SCENE
        .replace("width = 800", "width = 320")
        .replace("height = 450", "height = 180")
        .replace("\"linear\"", &format!("\"{mode}\""))
        .replace("\"0.1%\"", tolerance);
    let scene = Scene::parse(&text, "demo-inside.toml")?;
    let mut best: Option<(f64, Rendered)> = None;
    for _ in 0..RUNS {
        let opened = Cache::open(cache, Cursor::WINDOWS)?;
        let started = Instant::now();
        let options = RenderOptions {
            memory: 1 << 30,
            threads: Some(1),
            progress: None,
            fixed: None,
            resident: false,
        };
        let rendered = render(&opened, &scene, &options)?;
        let seconds = started.elapsed().as_secs_f64();
        if best.as_ref().is_none_or(|(least, _)| seconds < *least) {
            best = Some((seconds, rendered));
        }
    }
    if let Some((seconds, Rendered { stats, .. })) = best {
        let each = 1e9 * seconds / stats.samples.max(1) as f64;
        let mode = if tolerance == "0" { mode.to_owned() } else { format!("{mode}~") };
        println!(
            "{brick:<8}{mode:<8}{seconds:>10.3}{:>12}{each:>14.1}{:>12}",
            stats.samples, stats.bricks_loaded
        );
    }
    Ok(())
}
