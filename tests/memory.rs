//! Memory limits hold byte for byte: what ingest and render have allocated at a time stays below
//! the limit, does not grow with the data, and the program runs where the system grants no more.

// What tests share fails as a test does.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

#[path = "forge/allocator.rs"]
mod allocator;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;

use allocator::{Counting, peak_of};
use deepfield::cache::{Cache, Cursor};
use deepfield::derive::Derived;
use deepfield::ingest::{Options, Progress, ingest};
use deepfield::render::{RenderOptions, render};
use deepfield::scene::Scene;
use deepfield::source::Source;
use deepfield::{Result, source, synth};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Tests that count memory run one after another.
static ALONE: Mutex<()> = Mutex::new(());

const MEBIBYTE: usize = 1 << 20;
/// The smallest limit of ingest.
const LIMIT: usize = 64 * MEBIBYTE;
/// What pictures may take: little more than two threads' bricks and buffers do.
const PICTURE_LIMIT: usize = 36 * MEBIBYTE;
/// Of the densest of 41 fields nothing is below, of the others more and more cells.
const DROPPED_BELOW: f64 = 2.0;
/// What the program itself may take beyond its limit.
const ITSELF: usize = 48 * MEBIBYTE;

fn recipes() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets_synthetic")
}

/// `scaling.toml` at `scale`, in `folder`.
fn output(scale: f64, folder: &Path) -> PathBuf {
    let text = std::fs::read_to_string(recipes().join("scaling.toml")).unwrap();
    let recipe = synth::Recipe::parse(&text, "scaling.toml").unwrap().scaled(scale).unwrap();
    synth::write(&recipe, &folder.join(scale.to_string()), &mut |_, _| {}).unwrap().input
}

/// Ingests within [`LIMIT`]: the cache, and the most that was allocated at a time.
fn ingested(output: &Path, name: &str, folder: &Path) -> (PathBuf, usize) {
    let target = folder.join(name);
    let source = source::open(output, None).unwrap();
    let options = Options { memory: LIMIT as u64, threads: Some(2), ..Options::default() };
    let (outcome, peak) = watched(source.as_ref(), &target, &options);
    outcome.unwrap();
    (target, peak)
}

/// Ingests; what becomes of it, and the most that was allocated at a time.
fn watched(source: &dyn Source, target: &Path, options: &Options) -> (Result<()>, usize) {
    let mut quiet = |_, _, _| {};
    peak_of(|| ingest(source, target, options, &mut Progress::new(&mut quiet)).map(drop))
}

/// A small picture of everything, all levels.
fn scene_text() -> String {
    let text = std::fs::read_to_string(recipes().join("scaling-outside.toml")).unwrap();
    let text = text.replace("width = 1920", "width = 192").replace("height = 1080", "height = 108");
    text.replace("tolerance = \"1%\"", "tolerance = 0\ninterpolation = \"cell\"")
}

/// Renders within `limit` on two threads: the most that was allocated at a time.
fn rendered(cache: &Path, limit: usize) -> usize {
    let scene = Scene::parse(&scene_text(), "scaling-outside.toml").unwrap();
    let options = RenderOptions {
        memory: limit as u64,
        threads: Some(2),
        progress: None,
        fixed: None,
        resident: false,
    };
    let cache = Cache::open(cache, Cursor::WINDOWS).unwrap();
    let (outcome, peak) = peak_of(|| render(&cache, &scene, &options).map(drop));
    outcome.unwrap();
    peak
}

#[test]
fn what_is_allocated_stays_below_the_limit_whatever_the_size_of_the_data() {
    let _alone = ALONE.lock().unwrap();
    let folder = tempfile::tempdir().unwrap();
    // 108 and 213 MB, with caches of 82 and 160 MB.
    let peaks = [0.45, 0.6].map(|scale| {
        let output = output(scale, folder.path());
        let name = format!("{scale}.dfc");
        let ((cache, first), (_, second)) =
            (ingested(&output, &name, folder.path()), ingested(&output, &name, folder.path()));
        let bytes = std::fs::metadata(&cache).unwrap().len() as usize;
        let render = rendered(&cache, PICTURE_LIMIT);
        eprintln!("scale {scale}: ingest {first}, {second}, render {render}, cache {bytes} bytes");
        assert!(first.max(second) <= LIMIT, "ingest at {scale}: {first}, {second}");
        assert!(render <= PICTURE_LIMIT, "render at {scale}: {render}");
        assert!(bytes > PICTURE_LIMIT, "a cache that fits the limit shows nothing: {bytes}");
        // How far threads are ahead of each other makes some per cent.
        [first.min(second), render]
    });
    for (small, large) in peaks[0].iter().zip(peaks[1]) {
        assert!(large as f64 <= 1.15 * *small as f64, "grows with the data: {peaks:?}");
    }
}

#[test]
fn many_fields_large_bricks_and_many_threads_stay_below_the_limit_or_are_refused() {
    let _alone = ALONE.lock().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let output = output(0.16, folder.path());
    let source = source::open(&output, None).unwrap();
    let definitions: Vec<String> = (1..=40).map(|n| format!("f{n}=Density*{n}")).collect();
    let source = Derived::new(source.as_ref(), &definitions).unwrap();
    let names = source.hierarchy().fields.iter().map(|field| field.name.clone());
    let options = Options {
        fields: names.collect(),
        memory: LIMIT as u64,
        threads: Some(16),
        ..Options::default()
    };
    let target = folder.path().join("many.dfc");
    let (outcome, peak) = watched(&source, &target, &options);
    outcome.unwrap();
    eprintln!("41 fields, 16 threads: {peak}");
    assert!(peak <= LIMIT, "{peak}");
    let dropped = Options { drop_below: Some(DROPPED_BELOW), ..options.clone() };
    let (outcome, peak) = watched(&source, &target, &dropped);
    outcome.unwrap();
    eprintln!("41 fields, 16 threads, some cells dropped: {peak}");
    assert!(peak <= LIMIT, "{peak}");
    let large = Options { brick: Some(32), ..options };
    let (outcome, peak) = watched(&source, &target, &large);
    let refusal = outcome.unwrap_err().to_string();
    assert!(refusal.contains("the smallest limit that works is"), "{refusal}");
    assert!(peak <= LIMIT, "{peak}");
}

/// Threads let go of what others have made; the resident set must not grow by that.
#[test]
fn many_threads_and_fields_stay_resident_below_the_limit() {
    const LIMIT: u64 = 128 << 20;
    let _alone = ALONE.lock().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let output = output(0.16, folder.path());
    let (cache, stats) = (folder.path().join("many.dfc"), folder.path().join("stats.json"));
    let mut command = Command::new(env!("CARGO_BIN_EXE_deepfield"));
    command.args(["ingest", "--memory=128MiB", "--brick=16", "--threads=16"]);
    command.arg(&output).arg("-o").arg(&cache).arg("--stats").arg(&stats);
    for n in 1..=48 {
        command.args(["--derive", &format!("f{n}=Density*{n}.5")]);
    }
    let ended = command.output().unwrap();
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
    let stats: serde_json::Value = serde_json::from_slice(&std::fs::read(stats).unwrap()).unwrap();
    let Some(peak) = stats["peak_rss_bytes"].as_u64() else {
        eprintln!("skipped: this system does not say how much memory is resident");
        return;
    };
    eprintln!("49 fields, 16 threads: {peak}");
    assert!(peak <= LIMIT + ITSELF as u64, "{peak}");
}

/// The program with no more address space than `bytes`. The system's allocator would reserve far
/// more for each thread than it uses, so threads share one arena.
fn confined(bytes: usize, words: &[&str]) -> std::process::Output {
    let script = format!("ulimit -v {} || exit 99; exec \"$0\" \"$@\"", bytes / 1024);
    let mut command = Command::new("sh");
    command.args(["-c", &script, env!("CARGO_BIN_EXE_deepfield")]).args(words);
    command.env("MALLOC_ARENA_MAX", "1").output().unwrap()
}

#[test]
fn the_program_runs_where_the_system_grants_no_more_than_the_limit() {
    let _alone = ALONE.lock().unwrap();
    let probe = confined(LIMIT + ITSELF, &["--version"]);
    if !cfg!(target_os = "linux") || probe.status.code() == Some(99) {
        eprintln!("skipped: this system sets no limit of address space (`ulimit -v`)");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let output = output(0.35, folder.path());
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (cache, picture) = (path("cache.dfc"), path("picture.exr"));
    let (output, scene) = (output.display().to_string(), path("scene.toml"));
    std::fs::write(&scene, scene_text()).unwrap();
    let limit = format!("--memory={LIMIT}");
    for words in [
        ["ingest", &output, "-o", &cache, &limit, "--threads=2"],
        ["render", &cache, &scene, "-o", &picture, &limit],
    ] {
        let ended = confined(LIMIT + ITSELF, &words);
        assert!(ended.status.success(), "{words:?}: {}", String::from_utf8_lossy(&ended.stderr));
        // The grant is not there for show.
        let ended = confined(ITSELF / 2, &words);
        assert!(!ended.status.success(), "{words:?} within {} bytes", ITSELF / 2);
    }
}
