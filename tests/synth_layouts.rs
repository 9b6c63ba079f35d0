//! One recipe in every layout of grids: readers find the same grids and values in each. Layouts of
//! block trees are compared with the recipe's model in `source_trees.rs`.

#![allow(clippy::unwrap_used)] // a test's way to fail

#[path = "support/data.rs"]
mod data;
#[path = "support/facts.rs"]
mod facts;

use std::path::Path;

use deepfield::source::{self, GridRecord, Source};
use deepfield::synth::{self, Recipe};

/// Layouts that list a recipe's grids as they are.
const OF_GRIDS: [&str; 3] = ["enzo", "amrex", "athena"];
/// Every layout; none may stand beside another that has a marked file of the same name.
const LAYOUTS: [&str; 5] = ["enzo", "amrex", "athena", "flash", "athena++"];

fn provided(name: &str) -> Recipe {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("datasets_synthetic")
        .join(format!("{name}.toml"));
    Recipe::parse(&std::fs::read_to_string(&path).unwrap(), path.display()).unwrap()
}

fn written(recipe: &Recipe, folder: &Path) -> Box<dyn Source> {
    let summary = synth::write(recipe, folder, &mut |_, _| {}).unwrap();
    source::open(&summary.input, None).unwrap()
}

fn sorted(source: &dyn Source) -> Vec<GridRecord> {
    let mut grids = facts::grids(source);
    grids.sort_by_key(|grid| (grid.level, grid.lo));
    grids
}

/// Which field of `source` is Enzo's `name`.
fn field(source: &dyn Source, name: &str) -> usize {
    let wanted = match (source.format(), name) {
        ("amrex", "Temperature") => "Temp",
        ("amrex", "x-velocity") => "x_velocity",
        ("athena", "x-velocity") => "velocity_x",
        _ => name,
    };
    let fields = &source.hierarchy().fields;
    fields.iter().position(|field| field.name.eq_ignore_ascii_case(wanted)).unwrap()
}

#[test]
fn one_recipe_is_the_same_data_in_every_layout() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["small", "offdomain"] {
        let [first, others @ ..] = OF_GRIDS.map(|layout| {
            let recipe = provided(name).with_format(layout).unwrap();
            let source = written(&recipe, &folder.path().join(layout));
            assert_eq!(source.format(), layout);
            source
        });
        let expected = sorted(&*first);
        let density = |s: &dyn Source| s.hierarchy().density.unwrap();
        for other in others {
            assert_eq!(other.hierarchy().domain, first.hierarchy().domain);
            assert_eq!(other.hierarchy().levels, first.hierarchy().levels);
            assert_eq!(other.hierarchy().time, first.hierarchy().time);
            assert_eq!(density(&*other), field(&*other, "Density"));
            let grids = sorted(&*other);
            assert_eq!(grids.len(), expected.len());
            for (grid, expected) in grids.iter().zip(&expected) {
                let place = |grid: &GridRecord| (grid.level, grid.lo, grid.size);
                assert_eq!(place(grid), place(expected));
                for known in &first.hierarchy().fields {
                    let values = facts::read_whole(&*other, grid, field(&*other, &known.name));
                    let original =
                        facts::read_whole(&*first, expected, field(&*first, &known.name));
                    let close = |(a, b): (&f64, &f64)| *a as f32 == *b as f32;
                    assert!(values.iter().zip(&original).all(close), "{} {grid:?}", known.name);
                }
            }
        }
    }
}

#[test]
fn ratios_may_differ_where_the_layout_allows_it() {
    let folder = tempfile::tempdir().unwrap();
    let source = written(&provided("mixed"), folder.path());
    let levels = &source.hierarchy().levels;
    let octree: Vec<_> = (0..levels.count()).map(|level| levels.octree(level).unwrap()).collect();
    assert_eq!(octree, [0, 1, 3, 4]);
    let grids = facts::grids(&*source);
    assert!((0..4).all(|level| grids.iter().any(|grid| grid.level == level)));
    for layout in LAYOUTS.into_iter().filter(|&layout| layout != "amrex") {
        let recipe = provided("mixed").with_format(layout).unwrap();
        let error = synth::write(&recipe, folder.path(), &mut |_, _| {}).unwrap_err().to_string();
        assert!(error.contains("refinement.factors: [2, 4, 2] differ"), "{error}");
    }
}

#[test]
fn what_a_layout_cannot_say_is_refused() {
    let refused = |name: &str, layout: &str| {
        let folder = tempfile::tempdir().unwrap();
        let recipe = provided(name).with_format(layout).unwrap();
        let error = synth::write(&recipe, folder.path(), &mut |_, _| {}).unwrap_err();
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        error.to_string()
    };
    assert!(refused("factor4", "athena").contains("Athena refines by 2"));
    assert!(refused("deep25", "athena").contains("seven digits"));
    assert!(refused("deep48", "amrex").contains("32 bits"));
    assert!(refused("factor4", "flash").contains("needs 2"));
    let error = provided("small").with_format("amrx").unwrap_err().to_string();
    let told = "output.format: format `amrx` is not known: there are amrex, enzo, athena++";
    assert!(error.contains(told), "{error}");
}

#[test]
fn a_data_set_is_replaced_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    for layout in LAYOUTS {
        let mut recipe = provided("small").with_format(layout).unwrap();
        // For trees: parts of the root grid.
        recipe.output.block = [10, 14, 6];
        // A data set of another layout counts as foreign.
        let first = synth::write(&recipe, folder.path(), &mut |_, _| {});
        if layout != LAYOUTS[0] {
            let error = first.unwrap_err().to_string();
            assert!(error.contains("holds something else"), "{error}");
            std::fs::remove_dir_all(folder.path().join("DD0000")).unwrap();
            synth::write(&recipe, folder.path(), &mut |_, _| {}).unwrap();
        }
        let again = synth::write(&recipe, folder.path(), &mut |_, _| {}).unwrap();
        assert!(source::open(&again.input, Some(layout)).is_ok());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
