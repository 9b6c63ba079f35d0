//! What recipes promise, on the recipes that the project provides.

use std::collections::HashSet;
use std::fs;
use std::path::Path;

use hdf5_reader::Hdf5File;

use super::density::cell_centre;
use super::{Grid, Grids, Recipe, write};
use crate::space::IndexBox;

fn provided(name: &str) -> Recipe {
    let path =
        Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("datasets_synthetic/{name}.toml"));
    Recipe::parse(&fs::read_to_string(&path).unwrap(), path.display()).unwrap()
}

fn all_grids(grids: &Grids) -> Vec<Grid> {
    let mut all = Vec::new();
    grids
        .for_each(&mut |grid| {
            all.push(grid);
            Ok(())
        })
        .unwrap();
    all
}

const UNTIDY: [&str; 6] = ["small", "jumps", "offdomain", "factor4", "deep25", "deep48"];

#[test]
fn grids_lie_in_one_parent_each_and_never_overlap() {
    for name in UNTIDY {
        let grids = Grids::new(&provided(name)).unwrap();
        let all = all_grids(&grids);
        for (i, grid) in all.iter().enumerate() {
            let factor = grid.level.checked_sub(1).map_or(1, |above| grids.factor(above));
            let same = all[i + 1..].iter().filter(|other| other.level == grid.level);
            for other in same {
                assert!(grid.cells.intersection(&other.cells).is_empty(), "{name}: {grid:?}");
            }
            let on_lattice = |i: &i128| grid.level == 0 || i.rem_euclid(factor) == 0;
            assert!(grid.cells.lo.iter().chain(&grid.cells.hi).all(on_lattice), "{name}: {grid:?}");
            let coarse = IndexBox {
                lo: grid.cells.lo.map(|i| i.div_euclid(factor)),
                hi: grid.cells.hi.map(|i| i.div_euclid(factor)),
            };
            let parents =
                all.iter().filter(|p| p.level + 1 == grid.level && p.cells.contains(&coarse));
            assert_eq!(parents.count(), usize::from(grid.level > 0), "{name}: {grid:?}");
        }
        let ids: Vec<u64> = all.iter().map(|grid| grid.id).collect();
        assert_eq!(ids, (1..=all.len() as u64).collect::<Vec<_>>());
    }
}

/// The finest level at the point a hair outside each face of a grid, in each of its face cells.
fn levels_across_faces(grids: &Grids, all: &[Grid], grid: &Grid) -> HashSet<u32> {
    let mut seen = HashSet::new();
    let size = grid.cells.size();
    for axis in 0..3 {
        let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
        for (i, j) in (0..size[b]).flat_map(|i| (0..size[c]).map(move |j| (i, j))) {
            for side in [grid.cells.lo[axis] - 1, grid.cells.hi[axis]] {
                let mut index = grid.cells.lo;
                index[axis] = side;
                index[b] += i;
                index[c] += j;
                seen.extend(leaf_level(grids, all, grid.level, index));
            }
        }
    }
    seen
}

/// The finest level, not beyond `level`, that has the cell `index` of level `level`.
fn leaf_level(grids: &Grids, all: &[Grid], level: u32, index: [i128; 3]) -> Option<u32> {
    let holds = |grid: &&Grid| {
        let steps = grids.octree(level) - grids.octree(grid.level);
        let cell = index.map(|i| i >> steps);
        grid.cells.contains(&IndexBox { lo: cell, hi: cell.map(|i| i + 1) })
    };
    all.iter().filter(|grid| grid.level <= level).filter(holds).map(|grid| grid.level).max()
}

#[test]
fn untidy_recipes_have_jumps_l_shapes_and_odd_offsets() {
    for name in UNTIDY {
        let recipe = provided(name);
        let grids = Grids::new(&recipe).unwrap();
        let all = all_grids(&grids);
        let largest_jump = all
            .iter()
            .filter_map(|grid| {
                let lowest = levels_across_faces(&grids, &all, grid).into_iter().min()?;
                Some(grid.level - lowest)
            })
            .max();
        assert!(largest_jump >= Some(if name == "jumps" { 3 } else { 2 }), "{name}");
        assert!(all.iter().any(|a| all.iter().any(|b| makes_an_l(a, b))), "{name}");
        let untidy = |grid: &Grid| grid.cells.lo.iter().any(|i| i.rem_euclid(8) != 0);
        assert!(all.iter().any(untidy), "{name}");
        let (root, width) = (recipe.domain.root, grids.domain().root_cell_width());
        assert!(root[0] != root[1] && root[1] != root[2], "{name}");
        assert!(width.x != width.y, "{name}");
    }
}

/// Whether two grids of a level share part of a face, but not a whole common one.
fn makes_an_l(a: &Grid, b: &Grid) -> bool {
    let meets = |axis: usize| {
        a.cells.hi[axis] == b.cells.lo[axis]
            && (0..3).filter(|&other| other != axis).all(|other| {
                a.cells.lo[other].max(b.cells.lo[other]) < a.cells.hi[other].min(b.cells.hi[other])
            })
    };
    let differs = |axis: usize| {
        (0..3).any(|other| other != axis && a.cells.size()[other] != b.cells.size()[other])
    };
    a.level == b.level && a.level > 0 && (0..3).any(|axis| meets(axis) && differs(axis))
}

#[test]
fn recipes_reach_the_levels_that_their_names_say() {
    for (name, levels) in [("demo", 14), ("deep25", 26), ("deep48", 49), ("one_level", 1)] {
        let grids = Grids::new(&provided(name)).unwrap();
        let mut deepest = 0;
        grids
            .for_each(&mut |grid| {
                deepest = deepest.max(grid.level);
                Ok(())
            })
            .unwrap();
        assert_eq!(deepest + 1, levels, "{name}");
    }
}

fn read_files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| {
            let entry = entry.unwrap();
            (entry.file_name().into_string().unwrap(), fs::read(entry.path()).unwrap())
        })
        .collect();
    files.sort();
    files
}

#[test]
fn writing_twice_gives_the_same_bytes_and_replaces_only_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let recipe = provided("small");
    let summary = write(&recipe, folder.path(), &mut |_, _| ()).unwrap();
    let first = read_files(&folder.path().join("DD0000"));
    assert_eq!(summary.bytes, first.iter().map(|(_, bytes)| bytes.len() as u64).sum::<u64>());
    assert!(first.iter().filter(|(name, _)| name.contains(".cpu")).count() > 1);
    assert_eq!(write(&recipe, folder.path(), &mut |_, _| ()).unwrap(), summary);
    assert!(first == read_files(&folder.path().join("DD0000")));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);

    fs::write(folder.path().join("DD0000/DD0000"), "InitialTime = 0\n").unwrap();
    let error = write(&recipe, folder.path(), &mut |_, _| ()).unwrap_err().to_string();
    assert!(error.contains("holds something else"), "{error}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn stored_values_are_the_models_in_leaf_cells_and_as_asked_elsewhere() {
    let folder = tempfile::tempdir().unwrap();
    for (name, average) in [("small", false), ("jumps", true)] {
        let recipe = provided(name);
        write(&recipe, folder.path(), &mut |_, _| ()).unwrap();
        let grids = Grids::new(&recipe).unwrap();
        let mut sums = [0.0; 2];
        for (file, bytes) in read_files(&folder.path().join(&recipe.name)) {
            if !file.contains(".cpu") {
                continue;
            }
            let file = Hdf5File::from_vec(bytes).unwrap();
            for grid in all_grids(&grids) {
                let path = format!("/Grid{:08}/Density", grid.id);
                let Ok(dataset) = file.dataset(&path) else { continue };
                let values = dataset.read_array::<f64>().unwrap();
                let [x, y, z] = grid.cells.size().map(|n| n as usize);
                assert_eq!(values.shape(), [z, y, x]);
                let values: Vec<f64> = values.iter().copied().collect();
                check_grid(&grids, &grid, &values, average, &mut sums);
            }
        }
        if average {
            assert!((sums[0] / sums[1] - 1.0).abs() < 1e-12, "{sums:?}");
        } else {
            assert!((sums[0] / sums[1] - 1.0).abs() > 0.01, "{sums:?}");
        }
    }
}

/// Compares leaf cells with the model, and adds root values and leaf values, both times volume.
fn check_grid(grids: &Grids, grid: &Grid, values: &[f64], average: bool, sums: &mut [f64; 2]) {
    let (octree, size) = (grids.octree(grid.level), grid.cells.size());
    let children = grids.children(grid.level, &grid.cells);
    let volume = (-3.0 * f64::from(octree)).exp2();
    for (at, &value) in (0..).zip(values) {
        let within = [at % size[0], at / size[0] % size[1], at / size[0] / size[1]];
        let index: [i128; 3] = std::array::from_fn(|a| grid.cells.lo[a] + within[a]);
        let fine = index.map(|i| i * grids.factor(grid.level));
        let covered = children
            .iter()
            .any(|child| child.contains(&IndexBox { lo: fine, hi: fine.map(|i| i + 1) }));
        let model = grids.model().at(&cell_centre(octree, index));
        if !covered {
            assert_eq!(value, model);
            sums[1] += value * volume;
        } else if !average {
            assert!((value / model - 0.8).abs() < 1e-12);
        }
        if grid.level == 0 {
            sums[0] += value;
        }
    }
}

#[test]
fn mistakes_in_recipes_are_named() {
    let sound = "[domain]\nleft = [0, 0, 0]\nright = [1, 1, 1]\nroot = [8, 8, 8]\n";
    let density = "[[density]]\nkind = \"constant\"\nvalue = 1.0\n";
    let refused = |text: String, named: &str| {
        let error = Recipe::parse(&text, "recipe.toml").unwrap_err().to_string();
        assert!(error.starts_with("recipe.toml") && error.contains(named), "{error}");
        assert!(!error.contains('\n'), "{error}");
    };
    refused(format!("{sound}{density}[output]\nfield = []\n"), "`field`");
    refused(format!("{sound}[[density]]\nkind = \"constant\"\nvalu = 1.0\n"), "`valu`");
    refused(format!("{sound}{density}[refinement]\nfactor = 3\nmax_level = 1\n"), "factor 3");
    refused(sound.to_owned(), "density");
    refused(
        format!("{sound}density = []\n").replace("[domain]", "[domain]\ntiles = [9, 1, 1]"),
        "tiles",
    );
    refused(format!("{}{density}", sound.replace("[1, 1, 1]", "[1, 0, 1]")), "edges along y");
    refused(format!("{}{density}", sound.replace("8, 8, 8", "8, 0, 8")), "root grid has 0 cells");
    refused(format!("{}{density}", sound.replace("8, 8, 8", "4096, 4096, 4096")), "tiles");
    let many = sound.replace("8, 8, 8", "600, 600, 600");
    let many = many.replace("[domain]", "[domain]\ntiles = [600, 600, 600]");
    refused(format!("{many}{density}"), "fewer tiles");
    refused(format!("{sound}{density}[output]\nfields = [\"Metal\"]\n"), "output.fields");
    refused(
        format!("{sound}{density}[refinement]\nmax_level = 40\n[output]\nhierarchy_hdf5 = false\n"),
        "output.hierarchy_hdf5",
    );
    refused(
        format!(
            "{sound}[[density]]\nkind = \"gaussian\"\ncentre = [0, 0, 0]\npeak = 1.0\nsigma = 0.0\n"
        ),
        "gaussian.sigma",
    );
}

#[test]
fn cells_too_small_for_double_edges_are_refused_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let text = "[domain]\nleft = [0, 0, 0]\nright = [1, 1, 1]\nroot = [16, 16, 16]\n\
                [refinement]\nmax_level = 55\n[[refinement.centre]]\n\
                position = [0.9, 0.9, 0.9]\nhalf_size = [4, 4, 4]\n\
                [[density]]\nkind = \"constant\"\nvalue = 1.0\n";
    let recipe = Recipe::parse(text, "test").unwrap();
    let error = write(&recipe, folder.path(), &mut |_, _| ()).unwrap_err().to_string();
    assert!(error.contains("double-precision edges"), "{error}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}
