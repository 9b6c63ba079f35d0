//! Derived fields from run to picture: values against the run's own, units against pictures in
//! code units.

#![allow(clippy::unwrap_used)] // a test's way to fail

#[path = "support/data.rs"]
mod data;
#[path = "support/facts.rs"]
mod facts;
mod support;

use std::path::{Path, PathBuf};

use data::shared;
use deepfield::cache::Cache;
use deepfield::render::Probe;
use deepfield::scene::Interpolation;
use deepfield::source;
use deepfield::space::Decimal;
use support::program::{run, written};
use support::{read_exr, synth};

/// Points spread over the unit cube without order.
fn points(count: u32) -> impl Iterator<Item = [f64; 3]> {
    // The plastic number's powers (Roberts' additive recurrence).
    const STEP: [f64; 3] = [0.8191725134, 0.6710436067, 0.5497004779];
    (1..=count).map(|n| STEP.map(|step| (step * f64::from(n)).fract()))
}

/// Every derived value is the expression of the source's values in the leaf cell, rounded once.
fn check_values(
    input: &Path,
    folder: &Path,
    operands: &[&str],
    definition: &str,
    of: &dyn Fn(&[f64]) -> f64,
) {
    let cache = folder.join("derived.dfc");
    run(&[&"ingest", &input, &"-o", &cache, &"--derive", &definition]).done();
    let cache = Cache::open(&cache, 8).unwrap();
    let name = definition.split_once('=').unwrap().0;
    assert_eq!(cache.header().fields.len(), 2, "the density and the derived field");
    let mut probe = Probe::new(&cache, name, Interpolation::Cell).unwrap();

    let source = source::open(input, None).unwrap();
    let hierarchy = source.hierarchy();
    let fields: Vec<usize> = operands
        .iter()
        .map(|name| hierarchy.fields.iter().position(|field| field.name == *name).unwrap())
        .collect();
    let mut grids = facts::grids(source.as_ref());
    grids.sort_by_key(|grid| std::cmp::Reverse(grid.level));
    let values: Vec<Vec<Vec<f64>>> = grids
        .iter()
        .map(|grid| fields.iter().map(|&f| facts::read_whole(source.as_ref(), grid, f)).collect())
        .collect();
    let (left, right) = (hierarchy.domain.left(), hierarchy.domain.right());
    let mut levels = std::collections::BTreeSet::new();
    for point in points(2000) {
        let place = |a: usize| left[a] + point[a] * (right[a] - left[a]);
        let point = [0, 1, 2].map(|a| Decimal::from_f64(place(a)).unwrap());
        let (grid, cell) = facts::find(&grids, hierarchy, &point).unwrap();
        let number = grids.iter().position(|other| other == grid).unwrap();
        let [x, y, z] = [0, 1, 2].map(|a| (cell[a] - grid.lo[a]) as usize);
        let at = x + grid.size[0] as usize * (y + grid.size[1] as usize * z);
        let own: Vec<f64> = values[number].iter().map(|values| values[at]).collect();
        let found = probe.at(&point).unwrap().unwrap();
        assert_eq!(found.level, grid.level);
        assert_eq!(found.value, f64::from(of(&own) as f32), "{definition} of {own:?}");
        levels.insert(found.level);
    }
    assert!(levels.len() > 1, "{levels:?}");
}

#[test]
fn derived_values_are_the_expression_of_the_runs_own() {
    let folder = tempfile::tempdir().unwrap();
    let input = synth("small", folder.path()).unwrap();
    let operands = ["Density", "x-velocity", "Temperature"];
    let ram = |own: &[f64]| own[0] * (own[1] * own[1]) / own[2].sqrt();
    let definition = "odd name=Density*{x-velocity}^2/sqrt(temperature)";
    check_values(&input, folder.path(), &operands, definition, &ram);
}

#[test]
fn derived_values_of_a_real_run_are_the_expression_of_its_own() {
    let Some(input) = shared("data/enzo_small/DD0010/DD0010") else { return };
    let folder = tempfile::tempdir().unwrap();
    let operands = ["x-velocity", "y-velocity", "z-velocity"];
    let speed = |v: &[f64]| (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    let definition = "speed=sqrt({x-velocity}^2 + {y-velocity}^2 + {z-velocity}^2)";
    check_values(&input, folder.path(), &operands, definition, &speed);
}

/// A scene of `field` in `units`, from `lo` to `hi`.
fn scene(field: &str, units: &str, [lo, hi]: [f64; 2]) -> String {
    format!(
        "[image]\nwidth = 24\nheight = 20\n[camera]\nprojection = \"orthographic\"\n\
         position = [0.4, 0.5, -1.0]\nlook_at = [0.4, 0.5, 0.3]\nheight = 1.0\n\
         [render]\nsamples = 1\ntolerance = 0\n\
         [[volume]]\nfield = \"{field}\"\nunits = \"{units}\"\nscale = \"log10\"\n\
         range = [{lo:e}, {hi:e}]\n"
    )
}

/// A picture in cgs equals the one in code units whose range is that of cgs over `factor`.
fn check_cgs(cache: &Path, field: &str, factor: f64, folder: &Path) {
    let header = Cache::open(cache, 8).unwrap().header().clone();
    let cached = &header.fields[header.field(field).unwrap()];
    let stated = cached.to_cgs.unwrap();
    assert!((stated / factor - 1.0).abs() < 1e-12, "{field}: {stated} instead of {factor}");
    let code = [cached.smallest_positive.unwrap(), cached.max];
    let picture = |units: &str, range: [f64; 2]| {
        let scene = written(folder, "scene.toml", &scene(field, units, range));
        let image: PathBuf = folder.join("picture.exr");
        run(&[&"render", &cache, &scene, &"-o", &image]).done();
        read_exr(&image).unwrap().2
    };
    let (code, cgs) = (picture("code", code), picture("cgs", code.map(|value| value * factor)));
    let brightest = code.iter().flatten().fold(0.0f32, |most, &value| most.max(value));
    assert!(brightest > 0.01);
    for (code, cgs) in code.iter().flatten().zip(cgs.iter().flatten()) {
        assert!((code - cgs).abs() <= 2e-6 * brightest, "{field}: {cgs} instead of {code}");
    }
}

/// A set in Enzo's layout, whose units are those of real runs.
fn with_units(folder: &Path) -> PathBuf {
    let input = synth("small", folder).unwrap();
    let mut text = std::fs::read_to_string(&input).unwrap();
    for (unit, factor) in
        [("Density", "1.673e-20"), ("Time", "315570000000"), ("Length", "3.0857e+18")]
    {
        let line = text.lines().find(|line| line.starts_with(&format!("{unit}Units "))).unwrap();
        text = text.replace(line, &format!("{unit}Units = {factor}"));
    }
    std::fs::write(&input, text).unwrap();
    input
}

#[test]
fn pictures_in_cgs_are_those_in_code_units_enzo() {
    let folder = tempfile::tempdir().unwrap();
    let (input, cache) = (with_units(folder.path()), folder.path().join("units.dfc"));
    let definition = "ram=Density*{x-velocity}^2";
    run(&[
        &"ingest",
        &input,
        &"-o",
        &cache,
        &"--field",
        &"density",
        &"--field",
        &"x-velocity",
        &"--field",
        &"temperature",
        &"--derive",
        &definition,
    ])
    .done();
    let said = run(&[&"info", &cache]).done();
    for (field, unit) in [
        ("Density", "in 1.673e-20 g/cm^3"),
        ("x-velocity", "cm/s"),
        ("Temperature", "K"),
        ("ram", "g/(cm*s^2)"),
    ] {
        let line = said.lines().find(|line| line.starts_with(&format!("field {field}: "))).unwrap();
        assert!(line.contains(unit), "{line}");
    }
    let velocity = 3.0857e18 / 3.1557e11;
    check_cgs(&cache, "density", 1.673e-20, folder.path());
    check_cgs(&cache, "ram", 1.673e-20 * velocity * velocity, folder.path());
}

#[test]
fn pictures_in_cgs_are_those_in_code_units_flash() {
    let folder = tempfile::tempdir().unwrap();
    let recipe = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets_synthetic/flash10.toml");
    let (output, cache) = (folder.path().join("flash"), folder.path().join("flash.dfc"));
    run(&[&"synth", &recipe, &"-o", &output]).done();
    let input = output.join("clump10/clump10_hdf5_chk_0000");
    run(&[&"ingest", &input, &"-o", &cache, &"--derive", &"root=sqrt(dens)"]).done();
    let header = Cache::open(&cache, 8).unwrap().header().clone();
    assert_eq!(header.fields[1].units.as_deref(), Some("g^(1/2)/cm^(3/2)"));
    check_cgs(&cache, "dens", 1.0, folder.path());
    check_cgs(&cache, "root", 1.0, folder.path());
}

/// A plotfile that names its gas density as Quokka does, and says what its units are.
fn quokka(folder: &Path, mass: &str) -> PathBuf {
    let recipe = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets_synthetic/mixed.toml");
    run(&[&"synth", &recipe, &"-o", &folder]).done();
    let plotfile = folder.join("plt00042");
    let header = std::fs::read_to_string(plotfile.join("Header")).unwrap();
    written(&plotfile, "Header", &header.replacen("density", "gasDensity", 1));
    let units = format!("k_B: 1\nunit_length: 3e+18\nunit_mass: {mass}\nunit_time: 3.1557e13\n");
    written(&plotfile, "metadata.yaml", &units);
    plotfile
}

#[test]
fn pictures_in_cgs_are_those_in_code_units_amrex() {
    let folder = tempfile::tempdir().unwrap();
    let (input, cache) = (quokka(folder.path(), "2e33"), folder.path().join("units.dfc"));
    run(&[&"ingest", &input, &"-o", &cache, &"--derive", &"square=gasDensity^2"]).done();
    let density = 2e33 / 3e18f64.powi(3);
    check_cgs(&cache, "gasDensity", density, folder.path());
    check_cgs(&cache, "square", density * density, folder.path());

    let input = quokka(folder.path(), ".nan");
    run(&[&"ingest", &input, &"-o", &cache]).done();
    let scene = written(folder.path(), "scene.toml", &scene("gasDensity", "cgs", [1.0, 2.0]));
    let refused = run(&[&"render", &cache, &scene, &"-o", &folder.path().join("no.exr")]).failed();
    assert!(refused.contains("`gasDensity` has no conversion to cgs"), "{refused}");
}

#[test]
fn what_cannot_be_derived_or_shown_is_one_clear_line() {
    let folder = tempfile::tempdir().unwrap();
    let (input, cache) = (with_units(folder.path()), folder.path().join("units.dfc"));
    let derive = |definition: &str| {
        let failed = run(&[&"ingest", &input, &"-o", &cache, &"--derive", &definition]).failed();
        assert!(!cache.exists());
        failed
    };
    let unknown = derive("a=Densty*2");
    assert!(unknown.contains("no field `Densty`: there are Density,"), "{unknown}");
    let units = derive("a=Density+Temperature");
    assert!(units.contains("g/cm^3 and K"), "{units}");
    let infinite = derive("a=log(Density-Density)");
    assert!(
        infinite.contains("field `a`: the value in cell [") && infinite.contains("is infinite"),
        "{infinite}"
    );

    run(&[&"ingest", &input, &"-o", &cache, &"--derive", &"log=log10(Density)"]).done();
    let shown = |field: &str, units: &str| {
        let scene = written(folder.path(), "scene.toml", &scene(field, units, [1.0, 2.0]));
        run(&[&"render", &cache, &scene, &"-o", &folder.path().join("picture.exr")]).failed()
    };
    let expression = shown("density * temperature", "code");
    let advice = "`deepfield ingest` with --derive \"NAME=density * temperature\"";
    assert!(expression.contains(advice), "{expression}");
    assert!(shown("log", "cgs").contains("`log` has no conversion to cgs"));
    let points = written(folder.path(), "points.csv", "x,y,z\n0.5,0.5,0.5\n");
    let probed = run(&[&"probe", &cache, &"--field", &"density^2", &"--points", &points]).failed();
    assert!(probed.contains("--derive"), "{probed}");
}
