//! What `ingest` may leave out, and what it stores for the rest.

// What tests share fails as a test does.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod support;

use std::path::{Path, PathBuf};

use serde_json::Value;
use support::program::{run, written};
use support::synth;

struct Set {
    folder: tempfile::TempDir,
    source: PathBuf,
    points: PathBuf,
}

/// Level and value at a point.
type Found = (i64, f64);

impl Set {
    fn new(name: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let source = synth(name, folder.path()).unwrap();
        let mut points = String::from("x,y,z\n");
        for i in 0..2000 {
            let at = |step: f64, size: f64| (f64::from(i) * step).fract() * size;
            let (x, y, z) = (at(0.618_033_98, 1.0), at(0.754_877_66, 1.1), at(0.569_840_29, 0.75));
            points += &format!("{x},{y},{z}\n");
            // Towards the densest core, where levels are deepest.
            let near = |x: f64, core: f64| core + (x - core) * 0.05;
            points += &format!("{},{},{}\n", near(x, 0.41), near(y, 0.59), near(z, 0.33));
        }
        let points = written(folder.path(), "points.csv", &points);
        Self { folder, source, points }
    }

    fn ingest(&self, name: &str, options: &[&str]) -> PathBuf {
        let cache = self.folder.path().join(name);
        let mut arguments: Vec<&dyn AsRef<_>> = vec![&"ingest", &self.source, &"-o", &cache];
        arguments.extend(options.iter().map(|option| option as &dyn AsRef<_>));
        run(&arguments).done();
        run(&[&"verify", &cache]).done();
        cache
    }

    fn probe(&self, cache: &Path, field: &str, interpolation: &str) -> Vec<Found> {
        let output = run(&[
            &"probe",
            &cache,
            &"--field",
            &field,
            &"--points",
            &self.points,
            &"--interpolation",
            &interpolation,
        ]);
        let found = |line: &str| {
            let mut columns = line.split(',').skip(3);
            let level = columns.next().unwrap().parse().unwrap();
            (level, columns.next().unwrap().parse().unwrap())
        };
        output.done().lines().skip(1).map(found).collect()
    }

    /// Draws what is kept within 10 % and exactly, and compares both. Returns whether the first drew
    /// coarser levels.
    fn hold_to_bound(
        &self,
        cache: &Path,
        interpolation: &str,
        position: &str,
        volume: &str,
    ) -> usize {
        let scene = format!(
            "[image]\nwidth = 16\nheight = 12\n[camera]\nposition = {position}\nfov = 30.0\n\
             look_at = [0.5, 0.62, 0.37]\n[render]\ninterpolation = \"{interpolation}\"\n\
             samples = 1\n[[volume]]\n{volume}\
             color = [[0.0, 1.0, 1.0, 1.0]]\nabsorption = [[0.0, 1.0]]\n"
        );
        let scene = written(self.folder.path(), "scene.toml", &scene);
        let draw = |tolerance: &str| {
            let [picture, stats] =
                ["picture.exr", "stats.json"].map(|n| self.folder.path().join(n));
            let options = [&"--tolerance" as &dyn AsRef<_>, &tolerance, &"--stats", &stats];
            let arguments = [&"render" as &dyn AsRef<_>, &cache, &scene, &"-o", &picture];
            run(&[&arguments[..], &options].concat()).done();
            let stats: Value = serde_json::from_slice(&std::fs::read(stats).unwrap()).unwrap();
            (support::read_exr(&picture).unwrap().2, stats)
        };
        let ((rough, stats), (exact, _)) = (draw("10%"), draw("0"));
        let bound = stats["error_bound"].as_f64().unwrap();
        assert!(bound <= stats["tolerance"].as_f64().unwrap(), "{stats}");
        let off = rough.iter().flatten().zip(exact.iter().flatten()).map(|(a, b)| (a - b).abs());
        let off = f64::from(off.fold(0.0, f32::max));
        assert!(off <= bound + 1e-6, "{off:e}, but at most {bound:e}: {position} {interpolation}");
        usize::from(stats["bricks_skipped_resolution"].as_u64() > Some(0))
    }

    /// Bytes that a picture of all of the set reads within `tolerance`, bricks that were loaded for it,
    /// and its pixels.
    fn read_within(&self, cache: &Path, tolerance: &str) -> (u64, u64, Vec<[f32; 4]>) {
        let scene = "[image]\nwidth = 32\nheight = 24\n[camera]\nposition = [0.45, 0.4, -1.2]\n\
                     look_at = [0.45, 0.45, 0.4]\n[render]\nsamples = 1\n[[volume]]\nfield = \"density\"\n";
        let scene = written(self.folder.path(), "scene.toml", scene);
        let [picture, stats] = ["picture.exr", "stats.json"].map(|n| self.folder.path().join(n));
        let options = [&"--tolerance" as &dyn AsRef<_>, &tolerance, &"--stats", &stats];
        let arguments = [&"render" as &dyn AsRef<_>, &cache, &scene, &"-o", &picture];
        run(&[&arguments[..], &options].concat()).done();
        let stats: Value = serde_json::from_slice(&std::fs::read(stats).unwrap()).unwrap();
        let bound = stats["error_bound"].as_f64().unwrap();
        assert!(tolerance == "0" || bound <= stats["tolerance"].as_f64().unwrap(), "{stats}");
        let count = |name: &str| stats[name].as_u64().unwrap();
        (count("bytes_read"), count("bricks_loaded"), support::read_exr(&picture).unwrap().2)
    }

    fn pixels(&self, cache: &Path, volume: &str) -> Vec<[f32; 4]> {
        let scene = format!(
            "[image]\nwidth = 24\nheight = 24\n[camera]\nposition = [0.45, 0.4, -1.2]\n\
             look_at = [0.45, 0.45, 0.4]\n[[volume]]\nfield = \"density\"\n{volume}\n"
        );
        support::render(cache, &scene, "1GiB", 2).unwrap().2
    }
}

fn info(cache: &Path) -> Value {
    serde_json::from_str(&run(&[&"info", &cache, &"--json"]).done()).unwrap()
}

fn number(facts: &Value, key: &str) -> f64 {
    facts["fields"][0][key].as_f64().unwrap_or(f64::NAN)
}

fn close(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance * expected.abs(), "{found}, not {expected}");
}

#[test]
fn tolerances_read_as_many_digits_as_they_need() {
    let set = Set::new("small");
    let cache = set.ingest("whole", &["--brick=8"]);
    let (all, bricks, exact) = set.read_within(&cache, "0");
    let largest = exact.iter().flatten().copied().fold(0.0, f32::max);
    let read = ["10%", "0.5%", "0.001%"].map(|tolerance| {
        let (bytes, loaded, pixels) = set.read_within(&cache, tolerance);
        let off = pixels.iter().flatten().zip(exact.iter().flatten()).map(|(a, b)| (a - b).abs());
        let off = off.fold(0.0, f32::max) / largest;
        let part: f32 = tolerance.trim_end_matches('%').parse().unwrap();
        assert!(off <= 0.01 * part, "{off:e} within {tolerance}");
        bytes as f64 / loaded as f64
    });
    let each = all as f64 / bricks as f64;
    eprintln!("bytes a brick within 10 %, 0.5 % and 0.001 %: {read:?}, exact {each}");
    assert!(read[0] < 0.5 * each && read[0] < read[1] && read[1] < read[2]);
}

#[test]
fn what_lies_below_a_value_is_dropped_and_accounted_for() {
    let set = Set::new("small");
    let whole = set.ingest("whole", &["--brick=8"]);
    let (all, found) = (info(&whole), set.probe(&whole, "density", "cell"));
    for brick in ["--brick=8", "--brick=16"] {
        let cache = set.ingest("dropped", &[brick, "--drop-below=1.5"]);
        let kept = info(&cache);
        assert_eq!(kept["leaf_cells"], all["leaf_cells"]);
        assert!(number(&kept, "dropped_cells") > 0.0 && number(&kept, "min") >= 1.5);
        assert_eq!(number(&kept, "max"), number(&all, "max"));
        let sum = number(&kept, "sum") + number(&kept, "dropped_sum");
        close(sum, number(&all, "sum"), 1e-12);
        let probed = set.probe(&cache, "density", "cell");
        let mut dropped = 0;
        for (own, right) in probed.iter().zip(&found) {
            if right.1 < 1.5 {
                assert!(own.1.is_nan() && own.0 >= 0 && right.0 >= 0);
                dropped += 1;
            } else {
                assert!(own == right || right.1.is_nan() && own.1.is_nan(), "{own:?} {right:?}");
            }
        }
        assert!(dropped > 100, "{dropped}");
    }
}

#[test]
fn a_picture_of_nothing_is_black_and_transparent() {
    let set = Set::new("small");
    let cache = set.ingest("nothing", &["--drop-below=1e30"]);
    assert_eq!(
        number(&info(&cache), "dropped_cells"),
        info(&cache)["leaf_cells"].as_f64().unwrap()
    );
    for volume in ["", "range = [0.1, 100.0]", "range = [0.1, 100.0]\nabsorption = [[0.0, 3.0]]"] {
        assert!(set.pixels(&cache, volume).iter().all(|pixel| *pixel == [0.0; 4]), "{volume}");
    }
    assert!(set.probe(&cache, "density", "linear").iter().all(|found| found.1.is_nan()));
}

#[test]
fn an_empty_picture_says_why() {
    let set = Set::new("small");
    let (all, none) = (set.ingest("all", &[]), set.ingest("none", &["--drop-below=1e30"]));
    let picture = set.folder.path().join("empty.exr");
    let say = |cache: &Path, look_at: &str, volume: &str| {
        let scene = format!(
            "[image]\nwidth = 4\nheight = 4\n[camera]\nposition = [0.45, 0.4, -1.2]\n\
             look_at = {look_at}\n[render]\nsamples = 1\n[[volume]]\nfield = \"density\"\n\
             {volume}\n"
        );
        let scene = written(set.folder.path(), "scene.toml", &scene);
        let ended = run(&[&"render", &cache, &scene, &"-o", &picture]);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        ended.stderr
    };
    let (inside, beside) = ("[0.45, 0.45, 0.4]", "[0.45, 0.4, -2.0]");
    let seen = "range = [0.3, 500.0]\nabsorption = [[0.0, 0.0], [1.0, 3.0]]";
    let above = "range = [1e8, 1e9]\nabsorption = [[0.0, 0.0], [1.0, 3.0]]";
    let at_most = "absorption = [[0.0, 0.0], [0.9999, 0.0], [1.0, 3.0]]";
    for (cache, look_at, volume, reason) in [
        (&all, beside, seen, "no data is in view"),
        (&all, inside, above, "nothing in view shines or absorbs. Density goes from "),
        (
            &all,
            inside,
            at_most,
            "no ray met anything that shines or absorbs, which may lie between",
        ),
        (&none, inside, seen, "no leaf cell has a value of Density"),
    ] {
        let said = say(cache, look_at, volume);
        let warned = format!("warning: the picture is empty: {reason}");
        assert!(said.starts_with(&warned) && said.lines().count() == 1, "{said}");
    }
    assert_eq!(say(&all, inside, seen), "");
}

#[test]
fn only_the_region_is_kept() {
    let set = Set::new("small");
    let found = set.probe(&set.ingest("whole", &[]), "density", "cell");
    let region = ["--region", "0.2,0.3,0.15", "0.6,0.8,0.5"];
    let cache = set.ingest("region", &region);
    let probed = set.probe(&cache, "density", "cell");
    let points = std::fs::read_to_string(&set.points).unwrap();
    let (mut inside, mut outside, mut told) = (0, 0, 0);
    for (line, (own, right)) in points.lines().skip(1).zip(probed.iter().zip(&found)) {
        let point: Vec<f64> = line.split(',').map(|x| x.parse().unwrap()).collect();
        let distance = [(0.2, 0.6), (0.3, 0.8), (0.15, 0.5)].iter().zip(&point);
        let distance = distance.map(|((lo, hi), x)| (lo - x).max(x - hi)).fold(-1.0, f64::max);
        if distance < 0.0 {
            assert_eq!(own, right);
            inside += 1;
        } else if distance > 0.1 {
            assert!(own.1.is_nan() && own.0 >= right.0, "{point:?}");
            outside += 1;
            told += u32::from(own.0 == right.0);
        }
    }
    assert!(inside > 1000 && outside > 300, "{inside} {outside}");
    // By the bricks' own levels alone it would be 1068 of 1439.
    assert!(told > 1200, "levels of {told} of {outside} dropped points are told");
    let (kept, whole) = (info(&cache), info(&set.folder.path().join("whole")));
    let sum = number(&kept, "sum") + number(&kept, "dropped_sum");
    close(sum, number(&whole, "sum"), 1e-12);
}

#[test]
fn deeper_levels_are_left_out() {
    let set = Set::new("small");
    let whole = set.ingest("whole", &[]);
    let found = set.probe(&whole, "density", "cell");
    let cache = set.ingest("coarse", &["--max-level=2"]);
    assert_eq!(
        (info(&whole)["max_level"].as_u64(), info(&cache)["max_level"].as_u64()),
        (Some(4), Some(2))
    );
    let probed = set.probe(&cache, "density", "cell");
    let mut deeper = 0;
    for (own, right) in probed.iter().zip(&found) {
        assert_eq!(own.0, right.0.min(2));
        assert!(own.1 == right.1 || right.0 > 2 || right.1.is_nan(), "{own:?} {right:?}");
        deeper += u32::from(right.0 > 2);
    }
    assert!(deeper > 100, "{deeper}");
}

#[test]
fn trees_of_leaf_blocks_have_no_coarser_levels_to_keep() {
    let folder = tempfile::tempdir().unwrap();
    let recipe = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets_synthetic/flash10.toml");
    let told = run(&[&"synth", &recipe, &"-o", &folder.path()]).done();
    let (output, cache) = (told.split(": ").next().unwrap(), folder.path().join("cache"));
    let ingest = |most: &str| run(&[&"ingest", &output, &"-o", &cache, &"--max-level", &most]);
    let line = ingest("1").failed();
    assert!(line.contains("--max-level 1") && line.contains("leave the option out"), "{line}");
    // There is nothing deeper.
    ingest("40").done();
}

#[test]
fn lossy_storage_keeps_its_relative_error() {
    let set = Set::new("small");
    let fields = ["--field=density", "--field=x-velocity"];
    let whole = set.ingest("whole", &fields);
    for error in [1e-1, 1e-2, 1e-4] {
        let cache = set.ingest("lossy", &[fields[0], fields[1], &format!("--error={error}")]);
        let size = |path: &Path| std::fs::metadata(path).unwrap().len();
        assert!(size(&cache) < size(&whole), "{error}: {} bytes", size(&cache));
        for field in ["density", "x-velocity"] {
            let exact = set.probe(&whole, field, "cell");
            for (own, right) in set.probe(&cache, field, "cell").iter().zip(&exact) {
                let within = (own.1 - right.1).abs() <= error * right.1.abs();
                assert!(own.0 == right.0 && (within || right.1.is_nan()), "{own:?} {right:?}");
            }
        }
    }
    let wrong = run(&[&"ingest", &set.source, &"-o", &set.folder.path().join("x"), &"--error=1"]);
    assert!(wrong.misused().contains("--error"));
}

/// What is dropped lies between bricks' cells, and in cells of coarser levels that are kept.
const SELECTIONS: [&[&str]; 4] = [
    &["--drop-below=1.5"],
    &["--drop-below=4.4187"],
    &["--region", "0.21,0.26,0.16", "0.63,0.94,0.57"],
    &["--drop-below=2.5", "--region", "0.05,0.3,0.1", "0.93,0.9,0.7"],
];

#[test]
fn pictures_of_what_remains_keep_their_bound() {
    let (mut coarser, mut pictures) = (0, 0);
    let volume = "field = \"density\"\nrange = [0.3, 500.0]\n";
    for (name, brick) in [("small", "--brick=8"), ("jumps", "--brick=8"), ("small", "--brick=16")] {
        let set = Set::new(name);
        for selection in SELECTIONS {
            let cache = set.ingest("kept", &[selection, &[brick]].concat());
            for interpolation in ["cell", "linear"] {
                for position in ["[2.1, 1.9, -2.6]", "[0.4, 0.5, -0.3]", "[7.0, -9.0, 6.0]"] {
                    coarser += set.hold_to_bound(&cache, interpolation, position, volume);
                    pictures += 1;
                }
            }
        }
    }
    assert!(coarser > pictures / 4, "coarser levels in {coarser} of {pictures} pictures");
}

const HUGE: &str = "name = \"DD0000\"\n[domain]\nleft = [0.0, 0.0, 0.0]\nright = [1.0, 1.25, 0.75]\n\
    root = [12, 10, 14]\n[refinement]\nmax_level = 2\n[[refinement.centre]]\n\
    position = [0.4, 0.6, 0.3]\nhalf_size = [5, 4, 6]\n[[density]]\nkind = \"gradient\"\n\
    value = 1e45\nslope = [3e44, 2e44, 1e44]\n[output]\nprecision = \"f64\"\n";

#[test]
fn values_beyond_f32_keep_their_scale() {
    let folder = tempfile::tempdir().unwrap();
    let recipe = written(folder.path(), "huge.toml", HUGE);
    run(&[&"synth", &recipe, &"-o", &folder.path().join("huge")]).done();
    let source = folder.path().join("huge/DD0000");
    let source = if source.is_dir() { source.join("DD0000") } else { source };
    let points = written(folder.path(), "points.csv", "x,y,z\n0.41,0.61,0.31\n0.86,1.06,0.67\n");
    let set = Set { folder, source, points };
    let cache = set.ingest("huge.dfc", &["--brick=8"]);
    let cell = |x: f64, size: f64, cells: f64| ((x / size * cells).floor() + 0.5) / cells * size;
    for (interpolation, tolerance) in [("cell", 1e-7), ("linear", 1e-6)] {
        let found = set.probe(&cache, "density", interpolation);
        for (own, point) in found.iter().zip([[0.41, 0.61, 0.31], [0.86, 1.06, 0.67]]) {
            let cells = f64::from(1 << own.0);
            let [x, y, z] = match interpolation {
                "cell" => [
                    cell(point[0], 1.0, 12.0 * cells),
                    cell(point[1], 1.25, 10.0 * cells),
                    cell(point[2], 0.75, 14.0 * cells),
                ],
                _ => point,
            };
            close(own.1, 1e45 + 3e44 * x + 2e44 * y + 1e44 * z, tolerance);
        }
    }
    let facts = info(&cache);
    close(number(&facts, "sum_as_stored"), number(&facts, "sum"), 1e-6);
    assert!(number(&facts, "max") > 1e45);
    assert!(set.pixels(&cache, "").iter().any(|pixel| pixel[3] > 0.0));
    // As far as its residuals say, a coarser level does.
    let volume = "field = \"density\"\nscale = \"linear\"\nrange = [1e45, 1.6e45]\n";
    assert_eq!(set.hold_to_bound(&cache, "linear", "[1.9, 2.5, -3.6]", volume), 1);
}

/// Values below a range's lower end, where nothing changes, above others beneath that lie within: in fewer
/// digits these make something of a ray that is known of rays alone if the index does not count them.
#[test]
fn what_digits_make_is_told_before_rays_are_marched() {
    let folder = tempfile::tempdir().unwrap();
    let recipe = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets_synthetic/athena13.toml");
    let made = run(&[&"synth", &recipe, &"-o", &folder.path()]).done();
    let [cache, picture, stats] = ["a.dfc", "a.exr", "a.json"].map(|n| folder.path().join(n));
    run(&[&"ingest", &made.split(": ").next().unwrap(), &"-o", &cache]).done();
    let scene = "[image]\nwidth = 1\nheight = 1\n[camera]\nposition = [0.25, -0.1, -1.3]\n\
                 look_at = [0.25, -0.1, 0.2]\n[render]\nsamples = 1\n[[volume]]\nfield = \"rho\"\n\
                 scale = \"linear\"\nrange = [16.0, 4000.0]\nabsorption = [[0.0, 0.044], [1.0, 0.17]]\n";
    let scene = written(folder.path(), "scene.toml", scene);
    for tolerance in ["1%", "0.1%", "0.01%", "1e-6"] {
        let options = [&"--tolerance" as &dyn AsRef<_>, &tolerance, &"--stats", &stats];
        let arguments = [&"render" as &dyn AsRef<_>, &cache, &scene, &"-o", &picture];
        run(&[&arguments[..], &options].concat()).done();
        let stats: Value = serde_json::from_slice(&std::fs::read(&stats).unwrap()).unwrap();
        let [bound, most] = ["error_bound", "tolerance"].map(|key| stats[key].as_f64().unwrap());
        assert!(bound <= most && stats["rays"] == 1, "{tolerance}: {stats}");
    }
}

#[test]
fn help_names_all_formats() {
    let set = Set::new("small");
    let none = [&"info" as &dyn AsRef<_>, &set.source, &"--format", &"none"];
    let told = run(&none).misused();
    let line = told.lines().next().unwrap();
    let known: Vec<_> = line.split_once("there are ").unwrap().1.split(", ").collect();
    assert!(known.len() >= 5, "{told}");
    for command in ["ingest", "info"] {
        let help = run(&[&command, &"--help"]).done();
        assert!(known.iter().all(|name| help.contains(name)), "{known:?} in {help}");
    }
}

#[test]
fn info_reads_within_a_limit() {
    let set = Set::new("small");
    let limited = |limit: &str| run(&[&"info", &set.source, &"--json", &"--memory", &limit]);
    let facts: Value = serde_json::from_str(&limited("256MiB").done()).unwrap();
    assert_eq!(facts, info(&set.source));
    assert!(limited("1MiB").failed().contains("--memory"));
}

#[test]
fn info_counts_the_cells_that_an_output_has() {
    let folder = tempfile::tempdir().unwrap();
    let recipe = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets_synthetic/flash10.toml");
    for (format, has_covered_cells) in
        [("enzo", true), ("amrex", true), ("athena++", false), ("flash", false)]
    {
        let target = folder.path().join(format);
        let made = run(&[&"synth", &recipe, &"-o", &target, &"--format", &format]).done();
        let facts = info(Path::new(made.split(": ").next().unwrap()));
        let sum = |key: &str| {
            let levels = facts["levels"].as_array().unwrap().iter();
            let levels = levels.filter(|level| !level["level"].is_null());
            levels.map(|level| level[key].as_u64().unwrap()).sum::<u64>()
        };
        let (cells, leaves) = (sum("cells"), sum("leaf_cells"));
        assert_eq!(
            (facts["cells"].as_u64(), facts["leaf_cells"].as_u64()),
            (Some(cells), Some(leaves))
        );
        assert_eq!(cells > leaves, has_covered_cells, "{format}: {facts}");
        assert!(cells >= leaves);
    }
}

#[test]
fn what_lies_under_finer_grids_may_be_of_any_size() {
    let folder = tempfile::tempdir().unwrap();
    let recipe = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets_synthetic/factor4.toml");
    let text = std::fs::read_to_string(recipe).unwrap();
    let facts = ["0.5", "1e305", "-1e308"].map(|covered| {
        let target = folder.path().join(covered);
        let edited = text.replacen("covered = 0.5", &format!("covered = {covered}"), 1);
        assert!(covered == "0.5" || edited != text);
        let recipe = written(folder.path(), &format!("{covered}.toml"), &edited);
        let made = run(&[&"synth", &recipe, &"-o", &target, &"--format", &"amrex"]).done();
        let input = Path::new(made.split(": ").next().unwrap());
        let mut facts = info(input);
        let cache = folder.path().join("derived.dfc");
        run(&[&"ingest", &input, &"-o", &cache, &"--derive", &"a=1e200*density*density"]).done();
        let fields = facts["fields"].take();
        assert!(fields[0]["sum"].is_number(), "{fields}");
        fields
    });
    assert_eq!(facts[0], facts[1]);
    assert_eq!(facts[0], facts[2]);
}
