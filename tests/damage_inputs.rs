//! Damaged simulation outputs, scenes, recipes and points: errors of one line, no panic, no huge
//! allocation, and nothing left behind.

// What tests share fails as a test does.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod forge;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;

use deepfield::cache::{Cache, verify};
use deepfield::ingest::{Options, Progress, ingest};
use deepfield::scene::Scene;
use deepfield::source::{self, GridBlock, GridRecord};
use deepfield::synth::{self, Recipe};
use forge::allocator::{Counting, peak_of};
use forge::noise::Noise;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Tests that count memory run one after another.
static ALONE: Mutex<()> = Mutex::new(());
/// Most bytes that may be live at a time, beyond a memory limit of 64 MiB.
const MOST_BYTES: usize = 256 << 20;

const RECIPE: &str = "name = \"DD0000\"\n[domain]\nleft = [0.0, -1.0, 0.5]\n\
    right = [1.0, 0.25, 1.25]\nroot = [12, 10, 14]\ntiles = [2, 1, 1]\n[refinement]\n\
    max_level = 3\nseed = 3\n[[refinement.centre]]\nposition = [0.4, -0.4, 0.8]\n\
    half_size = [4, 3, 4]\nsatellites = 1\n[[density]]\nkind = \"gradient\"\nvalue = 1.0\n\
    slope = [0.3, 0.2, 0.1]\n[output]\nprecision = \"f64\"\nfile_mib = 0.02\n\
    block = [4, 2, 2]\n";

/// Layouts that the data set is written in.
const FORMATS: [&str; 5] = ["enzo", "amrex", "athena++", "flash", "athena"];

/// A dump whose files are damaged one at a time.
struct Dump {
    folder: tempfile::TempDir,
    parameters: PathBuf,
}

impl Dump {
    fn new(format: &str) -> Self {
        Self::of(&format!("{RECIPE}format = \"{format}\"\n"))
    }

    fn of(recipe: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let recipe = Recipe::parse(recipe, "recipe").unwrap();
        let written = synth::write(&recipe, &folder.path().join("run"), &mut |_, _| {}).unwrap();
        std::fs::create_dir(folder.path().join("out")).unwrap();
        Self { folder, parameters: written.input }
    }

    fn file(&self, extension: &str) -> PathBuf {
        self.parameters.with_extension(extension)
    }

    /// Files of the dump that readers open.
    fn files(&self) -> Vec<PathBuf> {
        let mut folders = vec![self.folder.path().join("run")];
        let mut files: Vec<PathBuf> = Vec::new();
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() { &mut folders } else { &mut files }.push(path);
            }
        }
        // Text beside the data says nothing that a reader needs.
        let name = |path: &Path| path.file_name().unwrap().to_str().unwrap().to_owned();
        let texts = ["flash.par", "job_info"];
        let beside = |name: String| name.starts_with("athinput.") || texts.contains(&&*name);
        files.retain(|path| !beside(name(path)));
        files.sort();
        files
    }

    /// Ingests; whatever comes of it, nothing but a sound cache may be left.
    fn ingest(&self) -> Result<(), String> {
        let target = self.folder.path().join("out/cache.dfc");
        let run = || {
            let source = source::open(&self.parameters, None)?;
            let options = Options { memory: 64 << 20, threads: Some(2), ..Options::default() };
            let mut quiet = |_, _, _| {};
            ingest(source.as_ref(), &target, &options, &mut Progress::new(&mut quiet))
        };
        let run = || std::panic::catch_unwind(std::panic::AssertUnwindSafe(run));
        let (outcome, peak) = peak_of(run);
        assert!(peak < MOST_BYTES, "{peak} bytes were live");
        let outcome = outcome.expect("the program panicked").map_err(|error| error.to_string());
        if outcome.is_ok() {
            let report = verify(&Cache::open(&target, 16).unwrap(), &mut |_, _| {}).unwrap();
            assert_eq!(report.listed, []);
            std::fs::remove_file(&target).unwrap();
        }
        let left: Vec<_> = std::fs::read_dir(target.parent().unwrap()).unwrap().collect();
        assert!(left.is_empty(), "{left:?}");
        outcome.map(|_| ())
    }

    /// Ingests what must be refused; the one line that says why.
    #[track_caller]
    fn refused(&self) -> String {
        let error = self.ingest().unwrap_err();
        assert!(error.lines().count() == 1 && error.len() < 2000, "{error}");
        error
    }

    /// Changes the hierarchy's text, which is then read instead of its twin in HDF5.
    fn edit_hierarchy(&self, edit: impl Fn(&str) -> String) {
        let _ = std::fs::remove_file(self.file("hierarchy.hdf5"));
        let text = std::fs::read_to_string(self.file("hierarchy")).unwrap();
        std::fs::write(self.file("hierarchy"), edit(&text)).unwrap();
    }

    /// Overwrites the first value of a leaf grid's density with `value`.
    fn poke(&self, value: f64) {
        let source = source::open(&self.parameters, None).unwrap();
        let density = source.hierarchy().density.unwrap();
        let mut finest: Option<GridRecord> = None;
        let mut visit = |grid: GridRecord| {
            finest = finest.filter(|finest| finest.level >= grid.level).or(Some(grid));
            Ok(())
        };
        source.for_each_grid(&mut visit).unwrap();
        let mut old = [0.0; 2];
        let block = GridBlock { lo: [0; 3], size: [2, 1, 1] };
        source.read(&finest.unwrap(), density, block, &mut old).unwrap();
        let pattern = old.map(f64::to_le_bytes).concat();
        let found = self.files().into_iter().find_map(|path| {
            let bytes = std::fs::read(&path).unwrap();
            let at = bytes.windows(16).position(|window| window == pattern)?;
            Some((path, bytes, at))
        });
        let (path, mut bytes, at) = found.expect("the dump is not stored as plain f64");
        bytes[at..at + 8].copy_from_slice(&value.to_le_bytes());
        std::fs::write(path, bytes).unwrap();
    }
}

/// The hierarchy's text grid by grid.
fn grids(text: &str) -> Vec<String> {
    text.split("\nGrid = ").skip(1).map(|grid| format!("\nGrid = {grid}")).collect()
}

/// A grid's text with another value of `key`.
fn with(grid: &str, key: &str, value: &str) -> String {
    let line = |line: &str| match line.split_once('=') {
        Some((name, _)) if name.trim() == key => format!("{key} = {value}\n"),
        _ => format!("{line}\n"),
    };
    grid.lines().map(line).collect()
}

fn value<'g>(grid: &'g str, key: &str) -> &'g str {
    let of = |line: &'g str| line.split_once('=').filter(|(name, _)| name.trim() == key);
    grid.lines().find_map(of).unwrap().1.trim()
}

#[test]
fn a_root_grid_that_lacks_whole_bricks_is_refused() {
    let _alone = ALONE.lock().unwrap();
    let dump = Dump::of(
        "[domain]\nleft = [0, 0, 0]\nright = [1, 1, 1]\nroot = [64, 64, 64]\ntiles = [2, 2, 2]\n\
         [[density]]\nkind = \"constant\"\nvalue = 1.0\n",
    );
    dump.ingest().unwrap();
    dump.edit_hierarchy(|text| grids(text)[1..].concat());
    let line = dump.refused();
    assert!(line.ends_with("no grid covers root cell [0, 0, 0]"), "{line}");
}

#[test]
fn outputs_that_contradict_themselves_are_refused() {
    let _alone = ALONE.lock().unwrap();
    Dump::new("enzo").ingest().unwrap();
    let edited = |edit: &dyn Fn(Vec<String>) -> Vec<String>| {
        let dump = Dump::new("enzo");
        dump.edit_hierarchy(|text| edit(grids(text)).concat());
        dump.refused()
    };
    let line = edited(&|all| all[1..].to_vec());
    assert!(line.contains("no grid covers root cell [0, 0, 0]"), "{line}");
    let line = edited(&|mut all| {
        let last = all.len() - 1;
        all[last] = all[last].split("Pointer").next().unwrap().to_owned();
        all
    });
    assert!(line.contains("is it truncated?"), "{line}");
    let line = edited(&|mut all| {
        // The root grid's two tiles have one shape.
        for key in ["GridLeftEdge", "GridRightEdge"] {
            all[1] = with(&all[1], key, value(&all[0], key));
        }
        all
    });
    assert!(line.contains("grid 2 overlaps grid 1 of the same level 0"), "{line}");
    let line = edited(&|mut all| {
        let last = all.len() - 1;
        for key in ["GridLeftEdge", "GridRightEdge"] {
            let edges = value(&all[last], key).split_whitespace();
            let moved: Vec<String> =
                edges.map(|edge| (edge.parse::<f64>().unwrap() + 0.003).to_string()).collect();
            all[last] = with(&all[last], key, &moved.join(" "));
        }
        all
    });
    assert!(line.contains("cells from the lattice of level 3"), "{line}");
    let line = edited(&|mut all| {
        all[3] = with(&all[3], "GridRightEdge", "1e9 1e9 1e9");
        all
    });
    assert!(line.contains("grid 4"), "{line}");
    let line = edited(&|mut all| {
        all[2] = with(&all[2], "BaryonFileName", "./DD0000.cpu7777");
        all
    });
    assert!(line.contains("cpu7777"), "{line}");
}

#[test]
fn values_that_are_no_numbers_are_counted_or_refused() {
    let _alone = ALONE.lock().unwrap();
    // Athena's numbers have 32 bits, which hold no 1e301.
    for format in FORMATS.into_iter().filter(|&format| format != "athena") {
        for infinite in [f64::INFINITY, f64::NEG_INFINITY, 1e301] {
            let dump = Dump::new(format);
            dump.poke(infinite);
            let line = dump.refused();
            assert!(line.contains("grid ") && line.contains("cell"), "{line}");
        }
        let dump = Dump::new(format);
        dump.poke(f64::NAN);
        one_value_is_nan(&dump);
    }
}

fn one_value_is_nan(dump: &Dump) {
    dump.ingest().unwrap();
    let target = dump.folder.path().join("nan.dfc");
    let mut command = Command::new(env!("CARGO_BIN_EXE_deepfield"));
    let output = command.arg("ingest").arg(&dump.parameters).arg("-o").arg(&target).output();
    let said = String::from_utf8(output.unwrap().stderr).unwrap();
    assert!(said.starts_with("warning: ") && said.contains(": 1 leaf cells are NaN"), "{said}");
    assert_eq!(Cache::open(&target, 16).unwrap().header().fields[0].nan_cells, 1);
}

/// Most files are mostly data, where damage is another value: half of it goes to some few kB.
/// Of text some digits become others.
fn damaged(noise: &mut Noise, bytes: &[u8]) -> Vec<u8> {
    let head = &bytes[..bytes.len().min(1 << 12)];
    let digits: Vec<usize> = (0..head.len()).filter(|&at| head[at].is_ascii_digit()).collect();
    if digits.len() > 20 && noise.below(3) == 0 {
        let mut bytes = bytes.to_vec();
        for _ in 0..=noise.below(3) {
            bytes[*noise.pick(&digits)] = *noise.pick(b"0123456789-.e (),\n\0");
        }
        return bytes;
    }
    if noise.below(2) == 0 || bytes.len() < 1 << 14 {
        return noise.damage(bytes);
    }
    // What tells how to read the rest stands at the start or the end.
    let at = *noise.pick(&[0, bytes.len() - (1 << 13)]);
    let part = noise.damage(&bytes[at..at + (1 << 13)]);
    [&bytes[..at], &part, &bytes[at + (1 << 13)..]].concat()
}

fn attack_outputs(format: &str, rounds: u64) {
    let _alone = ALONE.lock().unwrap();
    let dump = Dump::new(format);
    let files: Vec<(PathBuf, Vec<u8>)> =
        dump.files().into_iter().map(|path| (path.clone(), std::fs::read(path).unwrap())).collect();
    let tables = dump.file("hierarchy.hdf5");
    let (mut read, mut refused) = (0, 0);
    for round in 0..rounds {
        let mut noise = Noise::new(round);
        let (path, bytes) = &files[noise.below(files.len())];
        std::fs::write(path, damaged(&mut noise, bytes)).unwrap();
        if path != &tables && noise.below(2) == 0 {
            // Then the text is what is read.
            let _ = std::fs::remove_file(&tables);
        }
        match dump.ingest() {
            Ok(()) => read += 1,
            Err(error) => {
                assert!(error.lines().count() == 1 && !error.is_empty(), "{round}: {error}");
                refused += 1;
            }
        }
        for (path, bytes) in files.iter().filter(|(other, _)| other == path || other == &tables) {
            std::fs::write(path, bytes).unwrap();
        }
    }
    println!("{format}: {read} read, {refused} refused");
    assert!(refused > rounds / 5 && read > rounds / 50, "{read} read, {refused} refused");
}

#[test]
fn damaged_outputs_are_read_or_refused() {
    for format in FORMATS {
        attack_outputs(format, 150);
    }
}

#[test]
#[ignore = "takes minutes"]
fn thousands_of_damaged_outputs_are_read_or_refused() {
    for format in FORMATS {
        attack_outputs(format, 10_000);
    }
}

/// Parses damaged copies of `text`.
fn attack_text(text: &str, rounds: u64, parse: &dyn Fn(&str) -> Result<(), String>) {
    let _alone = ALONE.lock().unwrap();
    for round in 0..rounds {
        let bytes = Noise::new(round).damage(text.as_bytes());
        let damaged = String::from_utf8_lossy(&bytes);
        let (outcome, peak) = peak_of(|| parse(&damaged));
        assert!(peak < 64 << 20, "{round}: {peak} bytes were live");
        if let Err(error) = outcome {
            assert!(error.lines().count() == 1, "{round}: {error}\n{damaged}");
        }
    }
}

fn example(name: &str) -> String {
    let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets_synthetic");
    std::fs::read_to_string(examples.join(name)).unwrap()
}

#[test]
fn damaged_scenes_and_recipes_are_read_or_refused() {
    let scene = |text: &str| Scene::parse(text, "scene").map(|_| ()).map_err(|e| e.to_string());
    attack_text(&example("demo-inside.toml"), 3000, &scene);
    let recipe = |text: &str| Recipe::parse(text, "recipe").map(|_| ()).map_err(|e| e.to_string());
    attack_text(&example("jumps.toml"), 3000, &recipe);
}
