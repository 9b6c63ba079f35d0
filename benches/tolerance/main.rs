//! `cargo bench --bench tolerance`: over scenes at random and published ones, how loose the
//! certified bound is, and how the time compares with the fastest setting picked by hand that
//! reaches the same error. Every scene is one run of `deepfield bench tolerance --fixed`.
//!
//! `cargo bench --bench tolerance -- 20` takes 20 random scenes instead of 56.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::process::Command;

use deepfield::ingest::{Options, Progress, ingest};
use deepfield::synth::{Recipe, write};
use deepfield::{Error, Result, source};

#[path = "../../tests/support/random.rs"]
mod random;
mod views;

use random::Random;
use views::{SETS, Set, scene};

const PROGRAM: &str = env!("CARGO_BIN_EXE_deepfield");
/// Pixels of a picture's edge.
const SIZE: u32 = 32;
const SCENES: usize = 56;
const SEED: u64 = 2026;
/// Published scenes, each with its recipe; at [`SIZE`] as well.
const PUBLISHED: [(&str, &str, &str); 4] = [
    ("demo", "demo-outside", include_str!("../../datasets_synthetic/demo-outside.toml")),
    ("demo", "demo-inside", include_str!("../../datasets_synthetic/demo-inside.toml")),
    ("depth48", "depth-outside", include_str!("../../datasets_synthetic/depth-outside.toml")),
    ("depth48", "depth-inside", include_str!("../../datasets_synthetic/depth-inside.toml")),
];

fn main() -> Result<()> {
    // `cargo test --benches` asks for nothing but a sign of life.
    if std::env::args().any(|argument| argument == "--test") {
        return Ok(());
    }
    let count = std::env::args().find_map(|word| word.parse().ok()).unwrap_or(SCENES);
    let folder =
        tempfile::tempdir().map_err(|source| Error::io("folder", "cannot make", source))?;
    let mut caches = HashMap::new();
    for set in &SETS {
        caches.insert(set.name, make_cache(set, folder.path())?);
    }
    println!(
        "{:<20}{:>6}{:>9}{:>12}{:>13}{:>11}{:>13}",
        "scene", "rays", "asked", "error", "bound/error", "seconds", "over fixed"
    );
    let (mut random, mut found) = (Random::new(SEED), Found::default());
    for (n, set) in (0..count).zip(SETS.iter().cycle()) {
        let text = scene(set, SIZE, &mut random)?;
        found.measure(&format!("{}-{n}", set.name), &caches[set.name], &text, folder.path())?;
    }
    for (set, name, text) in PUBLISHED {
        found.measure(name, &caches[set], &resized(text), folder.path())?;
    }
    found.report();
    Ok(())
}

fn make_cache(set: &Set, folder: &Path) -> Result<PathBuf> {
    let recipe = Recipe::parse(set.recipe, set.name)?;
    let dump = write(&recipe, &folder.join(set.name), &mut |_, _| {})?.input;
    let (source, target) = (source::open(&dump, None)?, folder.join(format!("{}.dfc", set.name)));
    let mut quiet = |_, _, _| {};
    ingest(source.as_ref(), &target, &Options::default(), &mut Progress::new(&mut quiet))?;
    Ok(target)
}

fn resized(text: &str) -> String {
    let size = |line: &str| match line.split_once(" = ") {
        Some((side @ ("width" | "height"), _)) => format!("{side} = {SIZE}\n"),
        _ => format!("{line}\n"),
    };
    text.lines().map(size).collect()
}

/// What all scenes have shown, by tolerance asked for.
#[derive(Debug, Default)]
struct Found {
    looseness: BTreeMap<String, Vec<f64>>,
    over_fixed: BTreeMap<String, Vec<f64>>,
    /// Rows whose error no setting picked by hand reaches.
    unreached: usize,
    /// Rows whose error is more than their bound; and whose bound is more than was asked for, as that
    /// of areas may be.
    broken: usize,
    above: usize,
}

impl Found {
    fn measure(&mut self, name: &str, cache: &Path, scene: &str, folder: &Path) -> Result<()> {
        let path = folder.join(format!("{name}.toml"));
        std::fs::write(&path, scene).map_err(|why| Error::io(&path, "cannot write", why))?;
        let outcome = Command::new(PROGRAM)
            .args(["bench", "tolerance", "--fixed", "--threads=1", "--reference-seconds=20"])
            .args(["--tolerances=1e-1,1e-2,1e-3", "--no-exact"])
            .args([cache, &path])
            .output()
            .map_err(|why| Error::io(PROGRAM, "cannot start", why))?;
        if !outcome.status.success() {
            let said = String::from_utf8_lossy(&outcome.stderr);
            return Err(Error::request(format!("{name}: {said}\n{scene}")));
        }
        let rows = csv::Reader::from_reader(outcome.stdout.as_slice()).into_deserialize();
        for row in rows {
            let row: Row = row.map_err(|why| Error::invalid(name, why.to_string()))?;
            self.add(name, &row);
        }
        Ok(())
    }

    fn add(&mut self, name: &str, row: &Row) {
        let show = |value: Option<f64>| value.map_or("-".to_owned(), short);
        println!(
            "{name:<20}{:>6}{:>9}{:>12.2e}{:>13}{:>11.4}{:>13}",
            row.reference_rays,
            row.tolerance,
            row.error,
            show(row.bound_over_error),
            row.seconds,
            show(row.seconds_over_fixed)
        );
        let key = format!("{:e}", row.tolerance);
        self.looseness.entry(key.clone()).or_default().extend(row.bound_over_error);
        self.over_fixed.entry(key).or_default().extend(row.seconds_over_fixed);
        self.unreached += usize::from(row.seconds_over_fixed.is_none());
        let error = row.error - row.reference_change;
        self.broken += usize::from(row.error_bound.is_some_and(|bound| error > bound));
        let tolerance = row.tolerance_absolute;
        self.above += usize::from(row.error_bound.is_some_and(|bound| bound > tolerance));
    }

    fn report(&self) {
        for (what, groups) in
            [("bound / error", &self.looseness), ("time / best by hand", &self.over_fixed)]
        {
            println!(
                "\n{what:<20}{:>8}{:>9}{:>9}{:>9}{:>9}",
                "rows", "least", "median", "90 %", "most"
            );
            let all = groups.values().flatten().copied().collect();
            for (tolerance, values) in groups.iter().chain([(&"all".to_owned(), &all)]) {
                println!("{tolerance:<20}{}", spread(values));
            }
        }
        println!("\nerrors that no setting by hand reaches: {}", self.unreached);
        println!("errors above their bounds: {}", self.broken);
        println!("bounds above the tolerance: {}", self.above);
    }
}

/// One row of the sweep.
#[derive(Debug, serde::Deserialize)]
struct Row {
    tolerance: f64,
    tolerance_absolute: f64,
    error_bound: Option<f64>,
    error: f64,
    bound_over_error: Option<f64>,
    seconds: f64,
    reference_rays: u32,
    reference_change: f64,
    seconds_over_fixed: Option<f64>,
}

/// A ratio in eight characters at most.
fn short(ratio: f64) -> String {
    if ratio < 1e5 { format!("{ratio:.2}") } else { format!("{ratio:.1e}") }
}

/// Number, least, median, 90th percentile and most.
fn spread(values: &[f64]) -> String {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let Some(last) = sorted.len().checked_sub(1) else { return format!("{:>8}", 0) };
    let at = |part: f64| sorted[(part * last as f64).round() as usize];
    let parts = [0.0, 0.5, 0.9, 1.0].map(|part| format!("{:>9}", short(at(part))));
    format!("{:>8}{}", sorted.len(), parts.concat())
}
