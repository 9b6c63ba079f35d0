//! The program under test, run as a user would, and the data it is tried on.

// Each test program uses only a part of it.
#![allow(dead_code)]

pub(crate) mod program;

use std::path::{Path, PathBuf};
use std::process::Command;

pub(crate) type Result<T> = std::result::Result<T, String>;

/// What may differ between two ingests of one output.
#[derive(Debug, Default, Clone)]
pub(crate) struct IngestOptions {
    /// Cells along a brick's edge.
    pub(crate) brick: Option<u32>,
    /// Memory limit, as `--memory` takes it.
    pub(crate) memory: Option<String>,
}

/// Makes the cache `name` of `input` in `folder`.
pub(crate) fn ingest(
    input: &Path,
    folder: &Path,
    name: &str,
    options: &IngestOptions,
) -> Result<PathBuf> {
    let cache = folder.join(format!("{name}.dfc"));
    let mut command = program();
    command.arg("ingest").arg(input).arg("-o").arg(&cache);
    if let Some(brick) = options.brick {
        command.arg("--brick").arg(brick.to_string());
    }
    if let Some(memory) = &options.memory {
        command.arg("--memory").arg(memory);
    }
    run(command)?;
    Ok(cache)
}

/// Width, height and R, G, B, A row by row from the top.
pub(crate) type Rendered = (usize, usize, Vec<[f32; 4]>);

/// Renders the scene `scene_toml` from `cache`.
pub(crate) fn render(
    cache: &Path,
    scene_toml: &str,
    memory: &str,
    threads: usize,
) -> Result<Rendered> {
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let (scene, image) = (folder.path().join("scene.toml"), folder.path().join("picture.exr"));
    std::fs::write(&scene, scene_toml).map_err(|error| error.to_string())?;
    let mut command = program();
    command.arg("render").arg(cache).arg(&scene).arg("-o").arg(&image);
    command.args(["--memory", memory, "--threads", &threads.to_string()]);
    run(command).map_err(|error| format!("{error}\n{scene_toml}"))?;
    read_exr(&image)
}

/// Writes the synthetic data set `name` of `datasets_synthetic` and returns what to open.
pub(crate) fn synth(name: &str, folder: &Path) -> Result<PathBuf> {
    let recipes = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets_synthetic");
    let output = folder.join(name);
    std::fs::create_dir_all(&output).map_err(|error| error.to_string())?;
    let mut command = program();
    command.arg("synth").arg(recipes.join(format!("{name}.toml"))).arg("-o").arg(&output);
    run(command)?;
    hierarchy_file(&output)
        .map(|file| file.with_extension(""))
        .ok_or_else(|| format!("{}: no .hierarchy file", output.display()))
}

/// Enzo's parameter file lies beside the hierarchy, under the same name without extension.
fn hierarchy_file(folder: &Path) -> Option<PathBuf> {
    let mut entries: Vec<_> = std::fs::read_dir(folder).ok()?.flatten().map(|e| e.path()).collect();
    entries.sort();
    entries.iter().find_map(|path| {
        if path.is_dir() {
            return hierarchy_file(path);
        }
        path.extension().is_some_and(|e| e == "hierarchy").then(|| path.clone())
    })
}

fn program() -> Command {
    Command::new(env!("CARGO_BIN_EXE_deepfield"))
}

fn run(mut command: Command) -> Result<()> {
    let output = command.output().map_err(|error| error.to_string())?;
    if output.status.success() {
        return Ok(());
    }
    let said = String::from_utf8_lossy(&output.stderr);
    Err(format!("{command:?}: {}: {said}", output.status))
}

pub(crate) fn read_exr(path: &Path) -> Result<Rendered> {
    let image = exr::prelude::read_first_rgba_layer_from_file(
        path,
        |size, _| (size.width(), vec![[0.0; 4]; size.area()]),
        |(width, pixels): &mut (usize, Vec<[f32; 4]>), at, (r, g, b, a): (f32, f32, f32, f32)| {
            pixels[at.y() * *width + at.x()] = [r, g, b, a];
        },
    )
    .map_err(|error| format!("{}: {error}", path.display()))?;
    let (width, pixels) = image.layer_data.channel_data.pixels;
    Ok((width, pixels.len() / width.max(1), pixels))
}
