//! Tests of the FLASH reader on small made-up files.

use super::made::MadeFile;

#[test]
fn leaves_are_grids_and_parents_are_not() {
    let file = MadeFile::new();
    file.write();
    let grids = file.read(0).unwrap();
    let ids: Vec<u64> = grids.iter().map(|(grid, _)| grid.id).collect();
    assert_eq!(ids, [1, 3, 4, 5, 6, 7, 8, 9, 10, 11]);
    for (grid, values) in &grids {
        assert_eq!(grid.size, [2, 4, 6]);
        assert!((0..).zip(values).all(|(i, &value)| value == (100 * grid.id + i) as f64));
    }
    assert_eq!((grids[0].0.level, grids[0].0.lo), (0, [0, 0, 0]));
    assert_eq!((grids[1].0.level, grids[1].0.lo), (1, [4, 0, 0]));
    assert_eq!((grids[6].0.level, grids[6].0.lo), (1, [6, 0, 6]));
    assert_eq!((grids[9].0.level, grids[9].0.lo), (0, [4, 0, 0]));
}

#[test]
fn what_a_file_says_of_itself() {
    let file = MadeFile::new();
    file.write();
    let source = crate::source::open(&file.path(), None).unwrap();
    let hierarchy = source.hierarchy();
    assert_eq!(source.format(), "flash");
    let names: Vec<&str> = hierarchy.fields.iter().map(|f| f.name.as_str()).collect();
    assert_eq!(names, ["ye", "dens"]);
    assert_eq!((hierarchy.density, hierarchy.time), (Some(1), Some(0.5)));
    assert_eq!(hierarchy.domain.root_cells(), [6, 4, 6]);
    assert_eq!(hierarchy.levels.count(), 2);
    assert_eq!((hierarchy.fields[1].to_cgs, hierarchy.fields[0].to_cgs), (Some(1.0), None));
}

#[test]
fn a_truncated_file_is_told_from_one_of_no_known_format() {
    let file = MadeFile::new();
    file.write();
    let open = |format| crate::source::open(&file.path(), format).err().unwrap().to_string();
    let bytes = std::fs::read(file.path()).unwrap();
    for length in [bytes.len() - 1, bytes.len() / 2] {
        std::fs::write(file.path(), &bytes[..length]).unwrap();
        let error = open(None);
        assert!(error.contains("cannot be read as HDF5: "), "{error}");
        // The C library has words of its own.
        assert!(error.contains("truncated") && !error.contains("no known format"), "{error}");
        assert_eq!(error, open(Some("flash")));
    }
}

#[test]
fn a_folder_stands_for_the_one_file_in_it() {
    let file = MadeFile::new();
    file.write();
    let folder = file.path().parent().unwrap().to_owned();
    for format in [None, Some("flash")] {
        let source = crate::source::open(&folder, format).unwrap();
        assert_eq!((source.format(), source.path()), ("flash", file.path().as_path()));
    }
    // A link to it is no second output, and a copy of it is one.
    std::os::unix::fs::symlink(file.path(), folder.join("latest")).unwrap();
    // Nor is what macOS keeps beside it, whatever it holds.
    std::fs::copy(file.path(), folder.join("._copy")).unwrap();
    assert!(crate::source::open(&folder, None).is_ok());
    std::fs::copy(file.path(), folder.join("other")).unwrap();
    let error = crate::source::open(&folder, None).err().unwrap().to_string();
    assert!(error.contains("holds several outputs"), "{error}");
    std::fs::remove_file(folder.join("other")).unwrap();
    // Among too many files others may be outputs as well.
    for number in 0..1001 {
        std::fs::write(folder.join(format!("log.{number}")), "").unwrap();
    }
    let error = crate::source::open(&folder, None).err().unwrap().to_string();
    assert!(error.contains("holds more than 1000 files: name the output itself"), "{error}");
}

#[test]
fn comoving_runs_say_their_scale_factor() {
    let density = |used: i32, scale_factor: Option<f64>| {
        let mut file = MadeFile::new();
        file.integers.push(("usecosmology", used));
        file.reals.extend(scale_factor.map(|factor| ("scalefactor", factor)));
        file.write();
        crate::source::open(&file.path(), None).unwrap().hierarchy().fields[1].to_cgs
    };
    assert_eq!(density(1, Some(0.5)), Some(8.0));
    assert_eq!(density(0, Some(0.5)), Some(1.0));
    for none in [None, Some(0.0), Some(f64::NAN)] {
        assert_eq!(density(1, none), None);
    }
}

/// A chain of blocks, each the first child's first child, far deeper than bounding boxes tell.
fn chain(depth: usize) -> MadeFile {
    let mut file = MadeFile::new();
    for level in 1..depth {
        let parent = file.levels.len() - if level == 1 { 9 } else { 8 };
        file.types[parent] = 3;
        let first = file.levels.len();
        for octant in 0..8 {
            let mut row = [-1; 15];
            row[6] = parent as i32 + 1;
            file.gid[parent][7 + octant] = (first + octant) as i32 + 1;
            file.gid.push(row);
            file.levels.push(level as i32 + 2);
            file.types.push(1);
            let above = file.boxes[parent];
            let middle: [f64; 3] = std::array::from_fn(|a| 0.5 * (above[2 * a] + above[2 * a + 1]));
            file.boxes.push(std::array::from_fn(|i| {
                let upper = octant >> (i / 2) & 1;
                if i % 2 != upper { middle[i / 2] } else { above[i] }
            }));
        }
    }
    for boxes in file.boxes.iter_mut().skip(3) {
        boxes.iter_mut().for_each(|edge| *edge = f64::from(*edge as f32));
    }
    file.integers[4].1 = file.levels.len() as i32;
    file
}

#[test]
fn boxes_that_no_longer_tell_do_no_harm() {
    let file = chain(59);
    file.write();
    let grids = file.read(1).unwrap();
    let deepest = grids.iter().find(|(grid, _)| grid.level == 59).unwrap().0;
    // Every block of the chain is the lowest of its siblings, from the root block at 1 on.
    assert_eq!((deepest.level, deepest.lo), (59, [2 << 59, 0, 0]));
    let last = grids.last().unwrap().0;
    assert!(last.lo.iter().zip([2 << 59, 0, 0]).all(|(&lo, first)| lo > first));
}

#[test]
fn runs_deeper_than_supported_are_refused() {
    let file = chain(61);
    file.write();
    assert!(file.error().contains("more than 60 levels"), "{}", file.error());
}

#[test]
fn other_kinds_of_runs_are_refused_by_name() {
    for (key, value, expected) in [
        ("dimensionality", 2, "dimensionality 2: only three-dimensional"),
        ("corners", 1, "corners"),
        ("nxb", 0, "nxb = 0"),
        ("nxb", 3, "should be [11, 6, 4, 3]"),
        ("globalnumblocks", 22, "holds 11 of the run's 22 blocks, as one of several split files"),
        ("nblockx", 2, "block 2: has no parent, but its left edge 0 along x is none of the 2 root"),
        (
            "nblockx",
            6,
            "block 1: its bounding box has the edge 0 along x, by gid it should be -0.5",
        ),
        ("nblockx", i32::MAX, "the root grid has"),
    ] {
        let mut file = MadeFile::new();
        file.integers.retain(|(known, _)| *known != key);
        file.integers.push((key, value));
        file.write();
        let error = file.error();
        assert!(error.contains("run_hdf5_chk_0001") && error.contains(expected), "{error}");
    }
    for geometry in ["cylindrical", "spherical", "polar"] {
        let mut file = MadeFile::new();
        file.texts[0].1 = geometry;
        file.write();
        let expected = format!("geometry `{geometry}`: only cartesian");
        assert!(file.error().contains(&expected), "{}", file.error());
    }
    // As parameter files may have it.
    let mut file = MadeFile::new();
    file.texts[0].1 = "Cartesian";
    file.write();
    file.read(0).unwrap();
}

#[test]
fn what_is_missing_is_named() {
    for (without, expected) in [
        ("integer scalars", "only files of FLASH 3 and later"),
        ("gid", "/gid"),
        ("refine level", "/refine level"),
        ("real runtime parameters", "no `xmin`"),
        ("string runtime parameters", "no `geometry`"),
    ] {
        let mut file = MadeFile::new();
        file.without.push(without);
        file.write();
        let error = file.error();
        assert!(error.contains("run_hdf5_chk_0001") && error.contains(expected), "{error}");
    }
    let mut file = MadeFile::new();
    file.integers.retain(|(key, _)| *key != "nblockx");
    file.write();
    assert!(file.error().contains("as files of uniform grids (UG) or Chombo"));
    let mut file = MadeFile::new();
    file.names = vec!["temp"];
    file.write();
    assert!(
        file.error().contains("/unknown names: lists no variable that has a dataset of its own")
    );
    file.names = vec!["temp", "dens"];
    file.write();
    assert_eq!(file.read(0).unwrap()[0].1[0], -100.0);
}

/// A file with a change is refused, with what is expected in the line about it.
#[track_caller]
fn check(change: impl Fn(&mut MadeFile), expected: &str) {
    let mut file = MadeFile::new();
    change(&mut file);
    file.write();
    let error = file.error();
    assert!(error.contains(expected), "{error}");
}

#[test]
fn trees_that_contradict_themselves_are_refused() {
    check(|file| file.levels[4] = 3, "block 5: its refine level 3 should be 2 by gid");
    check(|file| file.gid[4][6] = 1, "block 5: its parent 1 does not name it as a child");
    check(|file| file.gid[4][6] = 12, "block 5: refers to block 12 of 11");
    check(|file| file.gid[1].swap(7, 8), "block 3: its bounding box has the edge 0 along x");
    check(|file| file.boxes[0][0] = f64::NAN, "block 1: has no parent");
    check(|file| file.boxes[0][1] = f64::INFINITY, "block 1: its bounding box has the edge inf");
    check(|file| file.boxes[10] = [9.0; 6], "block 11: has no parent");
    // Two blocks that are each other's parent, with seven more children of the second.
    check(
        |file| {
            (file.gid[1][6], file.types[2], file.gid[2][7]) = (3, 2, 2);
            for child in 12..19 {
                file.gid[2][child as usize - 4] = child;
                file.gid.push([-1; 15]);
                file.gid[child as usize - 1][6] = 3;
                file.levels.push(3);
                file.types.push(1);
                file.boxes.push([0.0; 6]);
            }
            file.integers[4].1 = 18;
        },
        "block 2: lies at more than 60 levels below the root grid, or gid runs in circles",
    );
}

#[test]
fn node_types_that_contradict_the_tree_are_refused() {
    check(|file| file.types[1] = 1, "block 2: its node type is 1, but it has 8 children by gid");
    check(|file| file.types[0] = 2, "block 1: its node type is 2, but it has 0 children by gid");
    check(|file| file.types[0] = 0, "block 1: its node type is 0");
    check(|file| file.gid[1][9] = -1, "block 2: its node type is 2, but it has 7 children by gid");
    check(|file| file.gid[1][9] = 3, "block 3: is a child of block 2 and again of block 2");
    check(|file| file.gid[10][7] = 3, "block 3: is a child of block 2 and again of block 11");
}
