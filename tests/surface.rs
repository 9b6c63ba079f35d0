//! What a user is told: warnings, refusals and advice that works.

// What tests share fails as a test does.
#![allow(clippy::unwrap_used, clippy::panic)]

mod support;

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use serde_json::Value;
use support::program::{Ended, run, written};
use support::synth;

/// The small data set in a folder of its own.
struct Set {
    folder: tempfile::TempDir,
    source: PathBuf,
}

impl Set {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let source = synth("small", folder.path()).unwrap();
        Self { folder, source }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn ingest(&self, name: &str, options: &[&str]) -> Ended {
        let cache = self.path(name);
        let words: [&dyn AsRef<OsStr>; 4] = [&"ingest", &self.source, &"-o", &cache];
        let options = options.iter().map(|option| option as &dyn AsRef<OsStr>);
        run(&words.into_iter().chain(options).collect::<Vec<_>>())
    }

    fn cache(&self, options: &[&str]) -> PathBuf {
        self.ingest("cache.dfc", options).done();
        self.path("cache.dfc")
    }

    fn scene(&self, render: &str, volume: &str) -> PathBuf {
        let scene = format!(
            "[image]\nwidth = 24\nheight = 16\n[camera]\nposition = [0.45, 0.4, -1.2]\n\
             look_at = [0.45, 0.45, 0.4]\n[render]\n{render}\n[[volume]]\n{volume}\n"
        );
        written(self.folder.path(), "scene.toml", &scene)
    }

    fn render(&self, cache: &Path, scene: &Path, options: &[&str]) -> Ended {
        let picture = self.path("picture.exr");
        let words: [&dyn AsRef<OsStr>; 5] = [&"render", &cache, &scene, &"-o", &picture];
        let options = options.iter().map(|option| option as &dyn AsRef<OsStr>);
        run(&words.into_iter().chain(options).collect::<Vec<_>>())
    }
}

#[test]
fn a_logarithm_of_negative_values_is_warned_of_once() {
    let set = Set::new();
    let cache = set.cache(&["--field=Density", "--field=x-velocity"]);
    let warned = |volume: &str| {
        let ended = set.render(&cache, &set.scene("samples = 1", volume), &[]);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        ended.stderr
    };
    let told = "warning: x-velocity has values <= 0, which log10 shows as its smallest positive value: \
                use scale = \"symlog\" with linthresh, or scale = \"linear\"";
    let said = warned("field = \"x-velocity\"");
    assert!(said.starts_with(told) && said.matches("log10").count() == 1, "{said}");
    for volume in [
        "field = \"density\"",
        "field = \"x-velocity\"\nscale = \"linear\"",
        "field = \"x-velocity\"\nscale = \"symlog\"\nlinthresh = 0.1",
    ] {
        let said = warned(volume);
        assert!(!said.contains("log10"), "{said}");
    }
}

#[test]
fn advice_about_infinite_values_works() {
    let set = Set::new();
    let line = set.ingest("cache.dfc", &["--derive", "foo=1/0*Density"]).failed();
    assert!(line.contains("is infinite"), "{line}");
    let limited = "foo = max(-1e30, min(…, 1e30))";
    let advice = format!("limit its own expression, as in --derive '{limited}'");
    assert!(line.contains(&advice), "{line}");
    set.cache(&["--derive", &limited.replace('…', "1/0*Density")]);

    let line = set.ingest("cache.dfc", &["--derive", "foo=exp(Density)*1e-40"]).failed();
    let limited = "foo = min(…, 1e30)";
    assert!(
        line.contains(&format!("limit its own expression, as in --derive '{limited}'")),
        "{line}"
    );
    set.cache(&["--derive", &limited.replace('…', "exp(Density)")]);
}

#[test]
fn a_target_stays_until_the_cache_is_whole_and_is_replaced_then() {
    let set = Set::new();
    let sound = std::fs::read(set.cache(&[])).unwrap();
    let mut damaged = sound.clone();
    damaged[..20].fill(7);
    for left in [&damaged[..], &sound[..100], &sound[..5], b"a year's work", &[]] {
        let target = set.path("cache.dfc");
        std::fs::write(&target, left).unwrap();
        set.ingest("cache.dfc", &["--field", "absent"]).failed();
        assert!(std::fs::read(&target).unwrap() == left);
        assert!(std::fs::read(set.cache(&[])).unwrap() == sound);
    }
}

#[test]
fn files_beside_the_one_output_of_a_folder_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let recipe = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets_synthetic/flash10.toml");
    run(&[&"synth", &recipe, &"-o", &folder.path()]).done();
    let named = std::fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
    let run_folder = if named.is_dir() { named } else { folder.path().to_path_buf() };
    let settings = written(&run_folder, "flash.par", "a = 1");
    let line = run(&[&"ingest", &run_folder, &"-o", &settings]).failed();
    assert!(line.contains("flash.par: is one of the input's files"), "{line}");
    assert_eq!(std::fs::read_to_string(&settings).unwrap(), "a = 1");
    run(&[&"ingest", &run_folder, &"-o", &run_folder.join("new.dfc")]).done();
}

#[test]
fn negative_values_of_options_are_told_as_such() {
    let set = Set::new();
    let (cache, scene) = (set.path("cache.dfc"), set.path("scene.toml"));
    for (option, value, told) in [
        ("--threads", "-1", "-1 is not in 1..=1024"),
        ("--max-level", "-1", "-1 is not in 0..="),
        ("--memory", "-1GiB", "is no size"),
    ] {
        let said = set.ingest("cache.dfc", &[option, value]).misused();
        assert!(said.contains(told) && !said.contains("unexpected argument"), "{said}");
    }
    for (option, value, told) in [
        ("--threads", "-1", "-1 is not in 1..=1024"),
        ("--memory", "-1GiB", "is no size"),
        ("--tolerance", "-1%", "the tolerance is a number ≥ 0"),
        ("--size", "-3x4", "a size is WIDTHxHEIGHT"),
    ] {
        let said = set.render(&cache, &scene, &[option, value]).misused();
        assert!(said.contains(told) && !said.contains("unexpected argument"), "{said}");
    }
}

fn recipe(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("datasets_synthetic/{name}.toml"))
}

#[test]
fn options_that_cannot_be_read_are_wrong_usage() {
    let set = Set::new();
    let format = "format `ezno` is not known: there are enzo, amrex";
    for (option, value, told) in [
        ("--format", "ezno", format),
        ("--derive", "foo", "it is no definition: write one as NAME=EXPRESSION"),
        ("--derive", "foo=1", "it names no field"),
        ("--derive", "foo=Density*", "--derive"),
        ("--derive", "-foo", "it is no definition"),
    ] {
        let said = set.ingest("cache.dfc", &[option, value]).misused();
        assert!(said.contains(told) && !said.contains("unexpected argument"), "{said}");
    }
    let said = run(&[&"info", &set.source, &"--format=ezno"]).misused();
    assert!(said.contains(format), "{said}");
    let target = set.path("out");
    let said = run(&[&"synth", &recipe("small"), &"-o", &target, &"--format=ezno"]).misused();
    assert!(said.contains(format) && !said.contains("output.format"), "{said}");
}

#[test]
fn a_recipe_that_a_layout_cannot_hold_is_named_with_what_to_write() {
    let set = Set::new();
    let made =
        |recipe: &Path| run(&[&"synth", &recipe, &"-o", &set.path("out"), &"--format=flash"]);
    let line = made(&recipe("small")).failed();
    assert!(line.contains("small.toml: output.block: [8, 8, 8]"), "{line}");
    let (_, advice) = line.split_once(" flash: ").unwrap();
    let (block, _) = advice.split_once(" would").unwrap();
    let text = std::fs::read_to_string(recipe("small")).unwrap();
    let text = text.replace("[output]", &format!("[output]\n{block}"));
    made(&written(set.folder.path(), "other.toml", &text)).done();
}

#[test]
fn a_file_in_place_of_a_folder_is_told() {
    let set = Set::new();
    for line in [
        run(&[&"demo", &set.source]).failed(),
        run(&[&"synth", &recipe("small"), &"-o", &set.source]).failed(),
    ] {
        assert!(line.contains("DD0000: is a file, and a folder is needed: name another"), "{line}");
    }
}

/// An AMReX plotfile of one field, called `name`.
fn of_one_field(name: &str, folder: &Path) -> PathBuf {
    run(&[&"synth", &recipe("jumps"), &"-o", &folder, &"--format=amrex"]).done();
    let plotfile = std::fs::read_dir(folder).unwrap().next().unwrap().unwrap().path();
    let header = plotfile.join("Header");
    let text = std::fs::read_to_string(&header).unwrap();
    assert_eq!(text.lines().nth(1), Some("1"));
    let field = text.lines().nth(2).unwrap();
    std::fs::write(&header, text.replacen(field, name, 1)).unwrap();
    plotfile
}

#[test]
fn the_only_field_is_taken_where_none_is_a_density() {
    let folder = tempfile::tempdir().unwrap();
    let plotfile = of_one_field("phi", &folder.path().join("run"));
    let cache = folder.path().join("cache.dfc");
    let ingested = |options: &[&str]| {
        let words: [&dyn AsRef<OsStr>; 4] = [&"ingest", &plotfile, &"-o", &cache];
        let options = options.iter().map(|option| option as &dyn AsRef<OsStr>);
        let ended = run(&words.into_iter().chain(options).collect::<Vec<_>>());
        let told = ended.stderr.clone();
        ended.done();
        let facts: Value =
            serde_json::from_str(&run(&[&"info", &cache, &"--json"]).done()).unwrap();
        let fields = facts["fields"].as_array().unwrap();
        let names: Vec<_> = fields.iter().map(|f| f["name"].as_str().unwrap().to_owned()).collect();
        (names.join(" "), told)
    };
    let note = "warning: no field is known as a density: took phi, the only one\n";
    assert_eq!(ingested(&[]), ("phi".to_owned(), note.to_owned()));
    assert_eq!(ingested(&["--field=phi"]), ("phi".to_owned(), String::new()));
    assert_eq!(ingested(&["--derive=twice=2*phi"]), ("twice".to_owned(), String::new()));
}

#[test]
fn what_a_scene_says_in_vain_is_warned_of() {
    let set = Set::new();
    let cache = set.cache(&[]);
    let volume = "field = \"density\"\nabsorption = [[-28.0, 0.0], [0.5, 1.0], [1.0, 2.0]]\n\
                  emission = [[0.0, 1.0], [1.5, 2.0]]\ncolor = [[0.0, 1, 1, 1], [2, 0, 0, 0]]";
    let scene = set.scene("samples = 1\ntolerance = \"100%\"", volume);
    let text = std::fs::read_to_string(&scene).unwrap();
    let text = text.replace("[camera]\n", "[camera]\nheight = 2.0\n");
    let scene = written(set.folder.path(), "scene.toml", &text);
    let said = |options: &[&str]| {
        let ended = set.render(&cache, &scene, options);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        ended.stderr
    };
    let all = said(&[]);
    for told in [
        "scene.toml:5: `height` in [camera]: has no effect: it is for projection = \"orthographic\"\n",
        "scene.toml:13: `absorption` in [[volume]]: no value reaches x = -28.0: `range` is mapped",
        "scene.toml:14: `emission` in [[volume]]: no value reaches x = 1.5: ",
        "scene.toml:15: `color` in [[volume]]: no value reaches x = 2.0: ",
    ] {
        let line = all.lines().find(|line| line.contains(told.trim_end()));
        assert!(line.is_some_and(|line| line.starts_with("warning: ")), "{told}: {all}");
    }
    assert!(all.contains("warning: the tolerance (100%) is the largest value or more: "), "{all}");
    assert!(!said(&["--tolerance=99%"]).contains("the tolerance ("));
    assert!(!said(&["--fixed=1,1,0"]).contains("the tolerance ("));
}

#[test]
fn a_size_overrides_the_scenes() {
    let set = Set::new();
    let (cache, scene) = (set.cache(&[]), set.scene("samples = 1", "field = \"density\""));
    set.render(&cache, &scene, &["--size", "7x5"]).done();
    let (width, height, small) = support::read_exr(&set.path("picture.exr")).unwrap();
    assert_eq!((width, height), (7, 5));
    let text = std::fs::read_to_string(&scene).unwrap();
    let text = text.replace("width = 24\nheight = 16", "width = 7\nheight = 5");
    let scene = written(set.folder.path(), "small.toml", &text);
    set.render(&cache, &scene, &[]).done();
    assert_eq!(support::read_exr(&set.path("picture.exr")).unwrap().2, small);
    for (size, told) in [
        ("0x5", "`width`: must be from 1 to 65536"),
        ("7x65537", "`height`: must be from 1 to 65536"),
        ("7", "a size is WIDTHxHEIGHT in pixels, as in 320x180, not `7`"),
        ("7x5x3", "not `7x5x3`"),
        ("axb", "not `axb`"),
    ] {
        let said = set.render(&cache, &scene, &["--size", size]).misused();
        assert!(said.contains(told), "{said}");
    }
}

#[test]
fn info_says_where_a_field_is_largest() {
    let set = Set::new();
    for options in [
        &["--field=Density", "--field=x-velocity"][..],
        &["--field=Density", "--error=1e-2", "--brick=8"],
        &["--region", "0.3,0.4,0.2", "0.5,0.7,0.4"],
    ] {
        let cache = set.cache(options);
        let facts = run(&[&"info", &cache, &"--json"]).done();
        let facts: Value = serde_json::from_str(&facts).unwrap();
        let text = run(&[&"info", &cache]).done();
        for field in facts["fields"].as_array().unwrap() {
            let at = field["max_at"]["position"].as_array().unwrap();
            let at: Vec<&str> = at.iter().map(|x| x.as_str().unwrap()).collect();
            let points = format!("x,y,z\n{}\n", at.join(","));
            let points = written(set.folder.path(), "points.csv", &points);
            let name = field["name"].as_str().unwrap();
            let probed = run(&[&"probe", &cache, &"--field", &name, &"--points", &points]).done();
            let found: Vec<&str> = probed.lines().nth(1).unwrap().split(',').skip(3).collect();
            assert_eq!(found[0], field["max_at"]["level"].to_string());
            let (value, max) = (found[1].parse::<f64>().unwrap(), field["max"].as_f64().unwrap());
            let off = field["leaf_error"].as_f64().unwrap() + 1e-6;
            assert!((value - max).abs() <= off * max.abs(), "{name}: {value} of {max}");
            let line = format!("  max {} at {} (level {})", field["max"], at.join(","), found[0]);
            assert!(text.lines().any(|told| told == line), "{line}: {text}");
        }
    }
    let nothing = set.cache(&["--drop-below=1e30"]);
    let facts: Value = serde_json::from_str(&run(&[&"info", &nothing, &"--json"]).done()).unwrap();
    assert!(facts["fields"][0]["max_at"].is_null());
}

#[test]
fn info_tells_of_the_fields_that_can_be_read() {
    let folder = tempfile::tempdir().unwrap();
    let run_folder = folder.path().join("run");
    let recipe = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets_synthetic/small.toml");
    run(&[&"synth", &recipe, &"-o", &run_folder, &"--format=athena"]).done();
    let file = run_folder.join("DD0000/id0/DD0000.0000.vtk");
    let mut bytes = std::fs::read(&file).unwrap();
    let title = b"SCALARS density float\nLOOKUP_TABLE default\n";
    let at = bytes.windows(title.len()).position(|window| window == title).unwrap() + title.len();
    bytes[at..at + 4].copy_from_slice(&f32::INFINITY.to_be_bytes());
    std::fs::write(&file, bytes).unwrap();
    let Ended { code, stdout, stderr, .. } = run(&[&"info", &file, &"--json"]);
    assert!(code == Some(0) && stderr.contains("density is left out: "), "{stderr}");
    let facts: Value = serde_json::from_str(&stdout).unwrap();
    let names: Vec<_> = facts["fields"].as_array().unwrap().iter().map(|f| &f["name"]).collect();
    assert!(names.iter().any(|name| *name == "velocity_x"), "{names:?}");
    assert!(names.iter().all(|name| *name != "density"), "{names:?}");
    let left_out = &facts["unreadable_fields"][0];
    assert_eq!(left_out["name"], "density");
    assert!(left_out["reason"].as_str().unwrap().contains("is infinite"), "{left_out}");
}

#[test]
fn an_empty_picture_and_a_missed_tolerance_are_told_in_the_scenes_terms() {
    let set = Set::new();
    let text = std::fs::read_to_string(&set.source).unwrap();
    let units = "DensityUnits = 1e-24\nLengthUnits = 3e21\nTimeUnits = 3e13\n";
    std::fs::write(&set.source, format!("{text}\n{units}")).unwrap();
    let cache = set.cache(&[]);
    let facts = run(&[&"info", &cache, &"--json"]).done();
    let facts: Value = serde_json::from_str(&facts).unwrap();
    let field = &facts["fields"][0];
    let max = field["max"].as_f64().unwrap() * field["to_cgs"].as_f64().unwrap();
    let volume = "field = \"density\"\nunits = \"cgs\"\nrange = [1e3, 1e4]";
    let said = set.render(&cache, &set.scene("samples = 1", volume), &[]).stderr;
    assert!(said.contains(&format!("to {max:.3e} (g/cm^3): see `range`")), "{said}");

    let steep =
        "field = \"density\"\nabsorption = [[0.0, 0.0], [0.5, 0.0], [0.5, 1e9], [1.0, 1e9]]";
    let scene = set.scene("tolerance = \"0.007%\"\nsamples = \"area\"", steep);
    let said = set.render(&cache, &scene, &[]).stderr;
    assert!(said.contains(" (0.007%)"), "{said}");
}

#[test]
fn wrong_inputs_lead_to_the_right_command() {
    let set = Set::new();
    let scene = set.scene("samples = 1", "field = \"density\"");
    let line = set.render(set.source.parent().unwrap(), &scene, &[]).failed();
    assert!(
        line.contains("is a folder, not a deepfield cache: make one with `deepfield ingest`"),
        "{line}"
    );
    let line = set.ingest("cache.dfc", &["--field", "Density,Temperature"]).failed();
    assert!(line.contains("no field `Density,Temperature` (for several repeat --field)"), "{line}");
    let reversed = set.scene("samples = 1", "field = \"density\"\nrange = [3.0, 1.0]");
    let line = set.render(&set.cache(&[]), &reversed, &[]).failed();
    assert!(line.contains("to reverse colours use a `colormap` whose name ends in _r"), "{line}");
}
