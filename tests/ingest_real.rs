//! Ingest of real runs: what the cache's header says against independently computed facts.

#[path = "support/data.rs"]
mod data;
#[path = "support/hexadecimal.rs"]
mod hexadecimal;

use deepfield::cache::{self, Cache};
use deepfield::ingest::{Options, Progress, ingest, survey};
use deepfield::render::Probe;
use deepfield::scene::Interpolation;
use deepfield::source;
use deepfield::space::Decimal;
use serde_json::Value;

const SETS: [(&str, &str); 5] = [
    ("enzo_small", "DD0010/DD0010"),
    ("enzo_deep13", "DD0010/DD0010"),
    ("enzo_deep25", "DD0021/DD0021"),
    ("enzo_deep48", "DD0011/DD0011"),
    ("enzo_offdomain", "DD0001/DD0001"),
];

fn close(found: f64, expected: &Value, tolerance: f64) {
    let expected = expected.as_f64().unwrap_or(f64::NAN);
    assert!(
        (found - expected).abs() <= tolerance * expected.abs(),
        "{found} instead of {expected}"
    );
}

/// Every sample point has the level that the facts give, and the value rounded to f32.
fn check_samples(cache: &Cache, facts: &Value, set: &str) {
    let mut probe = Probe::new(cache, "density", Interpolation::Cell).ok();
    let samples = facts["samples"].as_array().map_or(&[][..], Vec::as_slice);
    assert_eq!(samples.len(), 1000);
    for sample in samples {
        let point = [0, 1, 2].map(|a| {
            let double = sample["pos_hex"][a].as_str().and_then(hexadecimal::parse);
            Decimal::from_f64(double.unwrap_or(f64::NAN)).ok()
        });
        let found = match (&mut probe, point) {
            (Some(probe), [Some(x), Some(y), Some(z)]) => probe.at(&[x, y, z]).ok().flatten(),
            _ => None,
        };
        let value = sample["density"].as_str().and_then(|text| text.parse::<f64>().ok());
        let expected = value.map(|value| f64::from(value as f32));
        assert_eq!(found.map(|found| found.value), expected, "{set}: {sample}");
        assert_eq!(found.map(|found| u64::from(found.level)), sample["level"].as_u64());
    }
}

#[test]
fn caches_of_real_runs_hold_what_the_runs_hold() {
    let Some(data) = data::shared("data") else { return };
    let directory = tempfile::tempdir().unwrap();
    for (set, dump) in SETS {
        let facts = std::fs::read_to_string(data.join(set).join("yt_facts.json")).unwrap();
        let facts: Value = serde_json::from_str(&facts).unwrap();
        let source = source::open(&data.join(set).join(dump), None).unwrap();
        for brick in [8, 16, 32] {
            let target = directory.path().join(format!("{set}-{brick}.dfc"));
            let options = Options { brick: Some(brick), ..Options::default() };
            let mut quiet = |_, _, _| {};
            let header =
                ingest(source.as_ref(), &target, &options, &mut Progress::new(&mut quiet)).unwrap();
            let opened = Cache::open(&target, 8).unwrap();
            assert_eq!(opened.header(), &header);
            let report = cache::verify(&opened, &mut |_, _| {}).unwrap();
            assert_eq!(report.listed, []);
            check_samples(&opened, &facts, set);
            let simulated = header.levels.iter().filter(|level| level.simulation.is_some());
            for (level, found) in simulated.enumerate() {
                let of = |key: &str| facts[key][level.to_string()].as_u64().unwrap();
                assert_eq!(found.leaf_cells, of("leaf_cells_per_level"), "{set} level {level}");
                assert_eq!(found.cells, of("cells_per_level"), "{set} level {level}");
                assert_eq!(found.grids, of("grids_per_level"), "{set} level {level}");
            }
            let field = &header.fields[0];
            close(field.min, &facts["density_min_leaf"], 0.0);
            close(field.max, &facts["density_max_leaf"], 0.0);
            close(field.sum, &facts["sum_density_volume_leaf"], 1e-12);
            close(field.stored_sum, &facts["sum_density_volume_leaf"], 1e-6);
            println!("{set} {brick}: {} bricks, {} bytes", header.nodes(), header.file_bytes);
        }
        let mut quiet = |_, _, _| {};
        let surveyed = survey(
            source.as_ref(),
            directory.path(),
            &Options::default(),
            &mut Progress::new(&mut quiet),
        )
        .unwrap();
        println!("{set}: brick {} chosen", surveyed.shape.edge());
    }
    let left: Vec<_> = std::fs::read_dir(directory.path()).unwrap().collect();
    assert_eq!(left.len(), 15);
}
