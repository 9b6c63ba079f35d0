//! Tests of the scene file as a whole.

use std::path::Path;

use glam::DVec3;
use proptest::prelude::*;

use super::*;
use crate::space::Decimal;

const SMALLEST: &str = "[camera]\nposition = [0.5, 0.5, -1.0]\nlook_at = [0.5, 0.5, 0.5]\n\
                        [[volume]]\nfield = \"density\"\n";

const FULL: &str = r##"
[image]
width = 1920
height = 1_080
exposure = -1.5

[camera]
projection = "orthographic"
position = [5e-1, 1, -1.0]
look_at  = ["0.5000000000000000000000001", 0.1, 0.300000000000000000000000000000007]
up       = [0.0, 0, 2.5]
fov      = 1e-12
height   = 1e-13

[render]
interpolation = "cell"
tolerance = "2.5%"
samples = 3
background = [0.0, 0.25, 1]

[[volume]]
field = "Dens # ity"
scale = "symlog"
linthresh = 1e-3
units = "cgs"
range = [-1e2, 1e4]
color = [[0, 0.0, 0.5, 1.0], [1.0, 1.0, 1.0, 2.0]]
absorption = [[0.0, 0.0],
              [0.5, 1.0], [0.5, 7.0]]
emission = [[0.0, 3.0]]
"##;

fn parse(text: &str) -> crate::Result<Scene> {
    Scene::parse(text, "scene.toml")
}

fn decimal(text: &str) -> Decimal {
    Decimal::parse(text).unwrap()
}

#[test]
fn defaults_are_those_that_the_scene_format_names() {
    let scene = parse(SMALLEST).unwrap();
    assert_eq!(scene.image, ImageSettings { width: 512, height: 512, exposure: 0.0 });
    assert_eq!(scene.camera.projection, Projection::Perspective { fov_degrees: 45.0 });
    assert_eq!(scene.camera.up, DVec3::Y);
    assert_eq!(scene.render.interpolation, Interpolation::Linear);
    assert_eq!(scene.render.tolerance, Tolerance::Relative(0.001));
    assert_eq!(scene.render.samples, Samples::Area);
    assert_eq!(scene.render.background, [0.0; 3]);
    let volume = scene.volume;
    assert_eq!((volume.scale, volume.units, volume.range), (Scale::Log10, Units::Code, None));
    assert_eq!(volume.color, ColorTable::Map(ColorMap::named("magma").unwrap()));
    assert_eq!((volume.absorption.value(0.5), volume.emission), ([2.5], None));
    assert_eq!(scene.source, SMALLEST);
}

#[test]
fn every_key_is_read() {
    let scene = parse(FULL).unwrap();
    assert_eq!(scene.image, ImageSettings { width: 1920, height: 1080, exposure: -1.5 });
    assert_eq!(scene.camera.projection, Projection::Orthographic { height: 1e-13 });
    assert_eq!(scene.camera.position, ["0.5", "1", "-1"].map(decimal));
    let target = ["0.5000000000000000000000001", "0.1", "0.300000000000000000000000000000007"];
    assert_eq!(scene.camera.look_at, target.map(decimal), "exactly as written");
    assert_eq!(scene.camera.up, DVec3::new(0.0, 0.0, 2.5));
    assert_eq!(scene.render.tolerance, Tolerance::Relative(0.025));
    assert_eq!(scene.render.samples, Samples::Grid(3));
    assert_eq!(scene.render.interpolation, Interpolation::Cell);
    assert_eq!(scene.render.background, [0.0, 0.25, 1.0]);
    let volume = scene.volume;
    assert_eq!(volume.field, "Dens # ity");
    assert_eq!(volume.scale, Scale::Symlog { linthresh: 1e-3 });
    assert_eq!((volume.units, volume.range), (Units::Cgs, Some([-1e2, 1e4])));
    assert_eq!(volume.color.table().value(0.5), [0.5, 0.75, 1.5]);
    assert_eq!(volume.absorption.value(0.5), [7.0]);
    assert_eq!(volume.emission.unwrap().value(0.5), [3.0]);
    for (written, width) in [("0x40", 64), ("0o17", 15), ("0b101", 5), ("1_920", 1920), ("+7", 7)] {
        let text = FULL.replace("width = 1920", &format!("width = {written}"));
        assert_eq!(parse(&text).unwrap().image.width, width, "{written}");
    }
    let fov =
        "scene.toml:12: `fov` in [camera]: has no effect: it is for projection = \"perspective\"";
    assert_eq!(scene.in_vain, [fov]);
    let telescope = FULL.replace("orthographic", "perspective");
    let projection = parse(&telescope).unwrap().camera.projection;
    assert_eq!(projection, Projection::Perspective { fov_degrees: 1e-12 });
}

/// (what of [`FULL`] is replaced, by what, the line, what the message says)
const FAULTS: [(&str, &str, usize, &str); 44] = [
    ("tolerance", "toleranse", 17, "`toleranse` in [render]; did you mean `tolerance`?"),
    ("[render]", "[rendr]", 15, "`rendr`; did you mean `render`?"),
    ("field =", "feild =", 22, "did you mean `field`?"),
    ("width = 1920", "width = 0", 3, "from 1 to 65536"),
    ("width = 1920", "width = 65537", 3, "from 1 to 65536"),
    ("width = 1920", "width = -5", 3, "from 1 to 65536"),
    ("width = 1920", "width = 99999999999999999999999", 3, "from 1 to 65536"),
    ("width = 1920", "width = 512.0", 3, "whole number"),
    ("width = 1920", "width = 0x10001", 3, "from 1 to 65536"),
    ("exposure = -1.5", "exposure = nan", 5, "finite"),
    ("exposure = -1.5", "exposure = 1e9", 5, "stops"),
    ("\"orthographic\"", "\"ortographic\"", 8, "did you mean `orthographic`?"),
    ("\"orthographic\"", "\"fisheye\"", 8, "not supported yet"),
    ("\"orthographic\"", "7", 8, "expected a string, found a whole number"),
    ("position = [5e-1, 1, -1.0]", "position = [5e-1, 1]", 9, "a list of 3, found 2"),
    ("position = [5e-1, 1, -1.0]", "", 7, "needs the key `position`"),
    ("position = [5e-1, 1, -1.0]", "position = [inf, 1, 1]", 9, "not a decimal number"),
    ("position = [5e-1, 1, -1.0]", "position = [true, 1, 1]", 9, "found true or false"),
    ("position = [5e-1, 1, -1.0]", "position = [0xff, 1, 1]", 9, "not decimal"),
    ("0.5000000000000000000000001", "0.5.0", 10, "not a decimal number"),
    ("[0.0, 0, 2.5]", "[0.0, 0, -0.0]", 11, "must not be [0, 0, 0]"),
    ("[0.0, 0, 2.5]", "[0.0, 0, 1e999]", 11, "finite"),
    ("1e-12", "180", 12, "below 180"),
    ("1e-12", "-0.0", 12, "above 0"),
    ("1e-13", "0", 13, "above 0"),
    ("\"cell\"", "\"nearest\"", 16, "known: linear, cell"),
    ("\"2.5%\"", "\"-1%\"", 17, "tolerance"),
    ("\"2.5%\"", "nan", 17, "tolerance"),
    ("samples = 3", "samples = 65", 18, "from 1 to 64"),
    ("samples = 3", "samples = \"aera\"", 18, "area"),
    ("0.25, 1]", "-0.25, 1]", 19, "negative"),
    ("linthresh = 1e-3", "", 21, "needs the key `linthresh`"),
    ("linthresh = 1e-3", "linthresh = 0", 24, "above 0"),
    ("\"symlog\"", "\"log10\"", 24, "symlog"),
    ("\"symlog\"\nlinthresh = 1e-3", "\"log10\"", 25, "no logarithm"),
    ("\"cgs\"", "\"si\"", 25, "known: code, cgs"),
    ("[-1e2, 1e4]", "[1e4, 1e4]", 26, "below"),
    ("units =", "color_field = \"x\"\nunits =", 25, "not supported yet"),
    ("units =", "colormap = \"magma\"\nunits =", 28, "both"),
    ("[1.0, 1.0, 1.0, 2.0]", "[1.0, 1.0, -1.0, 2.0]", 27, "outside 0 to"),
    ("[0.5, 1.0], [0.5, 7.0]", "[0.5, 1.0], [0.4, 7.0]", 28, "sorted"),
    ("[0.5, 1.0], [0.5, 7.0]", "[0.5, 1.0, 2.0]", 29, "a list of 2, found 3"),
    ("[[0.0, 3.0]]", "[]", 30, "1 to 4096"),
    ("[[volume]]", "[volume]", 21, "[[volume]]"),
];

#[test]
fn faults_are_named_with_line_and_key() {
    for (from, to, line, expected) in FAULTS {
        assert!(FULL.contains(from), "{from}");
        let message = parse(&FULL.replacen(from, to, 1)).expect_err(to).to_string();
        assert!(message.starts_with("scene.toml:"), "{message}");
        assert!(message.contains(expected), "{from} → {to}: {message}");
        assert!(message.contains(&format!("scene.toml:{line}: ")), "line {line}: {message}");
        assert!(!message.contains('\n'), "{message}");
    }
}

#[test]
fn whole_scenes_that_are_refused() {
    let two = format!("{SMALLEST}[[volume]]\nfield = \"b\"\n");
    let same = SMALLEST.replace("-1.0", "5.0e-1");
    for (text, expected) in [
        ("", "the scene needs the key `camera`"),
        ("[camera]\nposition = [1, 2, 3]\nlook_at = [0, 0, 0]", "needs the key `volume`"),
        (two.as_str(), "scene.toml:6: `volume`: several volumes are not supported yet"),
        (same.as_str(), "scene.toml:3: `look_at` in [camera]: the same point"),
        ("[camera\n", "scene.toml:1: not valid TOML"),
        ("a = 1\na = 2\n", "scene.toml:2: not valid TOML: duplicate key: `a`"),
        ("camera = 3\n", "scene.toml:1: `camera`: expected a table"),
    ] {
        let message = parse(text).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }
}

#[test]
fn files_that_cannot_be_read_are_named() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("scene.toml");
    let failure = |path: &Path| Scene::load(path).unwrap_err().to_string();
    assert!(failure(&path).contains("scene.toml: cannot read"), "{}", failure(&path));
    std::fs::write(&path, b"[image]\n\xff").unwrap();
    assert!(failure(&path).contains("byte 8 is not UTF-8"), "{}", failure(&path));
    std::fs::write(&path, vec![b'\n'; usize::try_from(MAX_SCENE_BYTES).unwrap() + 1]).unwrap();
    assert!(failure(&path).contains("larger than 16 MiB"), "{}", failure(&path));
    std::fs::write(&path, FULL).unwrap();
    assert_eq!(Scene::load(&path).unwrap().source, FULL);
}

#[test]
fn size_is_limited_by_what_parsing_takes() {
    let many = format!("{SMALLEST}absorption = [{}]\n", "[0, 1],".repeat(40_000));
    let message = parse(&many).unwrap_err().to_string();
    assert!(message.contains("signs and blanks"), "{message}");
    let largest = "[0.5, 1.5], ".repeat(MAX_TABLE_POINTS);
    let colors = "[0.5, 1.5, 0.5, 0.5], ".repeat(MAX_TABLE_POINTS);
    let text = format!("{SMALLEST}absorption = [{largest}]\ncolor = [{colors}]\n");
    assert_eq!(parse(&text).unwrap().volume.absorption.positions().len(), MAX_TABLE_POINTS);
    let digits = format!("[\"0.{}\", 0.5, 0.5]", "3".repeat(200_000));
    assert!(parse(&SMALLEST.replace("[0.5, 0.5, -1.0]", &digits)).is_ok());
}

#[test]
fn reference_scenes_parse() {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/reference"));
    let Ok(files) = std::fs::read_dir(folder) else {
        eprintln!("skipped: no reference scenes at {}", folder.display());
        return;
    };
    let paths = files.map(|file| file.unwrap().path());
    let scenes: Vec<_> =
        paths.filter(|path| path.extension().is_some_and(|e| e == "toml")).collect();
    assert!(!scenes.is_empty());
    for path in scenes {
        let scene = Scene::load(&path).unwrap_or_else(|error| panic!("{error}"));
        assert!(!TransferFunction::new(&scene.volume).knots().is_empty());
    }
}

#[test]
fn options_of_the_command_line_are_read_alike() {
    assert_eq!(Tolerance::parse(" 0.5 % ").unwrap(), Tolerance::Relative(0.005));
    assert_eq!(Tolerance::parse("1e-3").unwrap(), Tolerance::Absolute(1e-3));
    assert_eq!(Samples::parse("area").unwrap(), Samples::Area);
    assert_eq!(Samples::parse("64").unwrap(), Samples::Grid(64));
    for bad in ["", "%", "inf", "-1", "nan%", "0.1 %%"] {
        assert!(Tolerance::parse(bad).is_err(), "{bad}");
    }
    for bad in ["", "0", "65", "1.5", "-1"] {
        assert!(Samples::parse(bad).is_err(), "{bad}");
    }
}

/// Pieces that damage a scene in ways that single bytes seldom do.
const SPLICES: [&str; 14] = [
    "[[",
    "]]",
    "[camera]\n",
    "\"",
    "'''",
    "= ",
    "nan",
    "-inf",
    "1e400",
    "\u{0}",
    "é",
    "\r\n",
    "#",
    ".",
];

#[derive(Debug, Clone)]
enum Damage {
    Byte(usize, u8),
    Cut(usize, usize),
    Splice(usize, usize),
    Copy(usize, usize, usize),
}

fn damage() -> impl Strategy<Value = Damage> {
    let at = || 0usize..FULL.len();
    prop_oneof![
        (at(), 0u8..128).prop_map(|(at, byte)| Damage::Byte(at, byte)),
        (at(), 1usize..40).prop_map(|(at, count)| Damage::Cut(at, count)),
        (at(), 0..SPLICES.len()).prop_map(|(at, which)| Damage::Splice(at, which)),
        (at(), at(), 1usize..60).prop_map(|(from, to, count)| Damage::Copy(from, to, count)),
    ]
}

fn apply(bytes: &mut Vec<u8>, damage: &Damage) {
    let end = bytes.len();
    let insert = |bytes: &mut Vec<u8>, at: usize, piece: &[u8]| {
        bytes.splice(at.min(end)..at.min(end), piece.iter().copied());
    };
    match damage {
        Damage::Byte(at, byte) if *at < end => bytes[*at] = *byte,
        Damage::Byte(..) => {}
        Damage::Cut(at, count) => drop(bytes.drain((*at).min(end)..(at + count).min(end))),
        Damage::Splice(at, which) => insert(bytes, *at, SPLICES[*which].as_bytes()),
        Damage::Copy(from, to, count) => {
            let piece = bytes[(*from).min(end)..(from + count).min(end)].to_vec();
            insert(bytes, *to, &piece);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(5000))]

    #[test]
    fn damaged_scenes_never_panic(damages in prop::collection::vec(damage(), 1..4)) {
        let mut bytes = FULL.as_bytes().to_vec();
        damages.iter().for_each(|damage| apply(&mut bytes, damage));
        let text = String::from_utf8_lossy(&bytes);
        match parse(&text) {
            Ok(scene) => {
                let function = TransferFunction::new(&scene.volume);
                prop_assert!(function.extinction(0.5).is_finite());
                prop_assert!(function.emission(0.5).iter().all(|channel| channel.is_finite()));
            }
            Err(error) => {
                let message = error.to_string();
                let line = message.strip_prefix("scene.toml:").and_then(|m| m.split_once(':'));
                let line = line.and_then(|(number, _)| number.parse::<usize>().ok());
                prop_assert!(line.is_some_and(|n| n >= 1 && n <= text.lines().count() + 1), "{}", message);
                prop_assert!(!message.contains('\n') && message.len() < 600, "{}", message);
            }
        }
    }
}
