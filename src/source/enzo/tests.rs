//! Tests of the Enzo reader on small made-up dumps.

use super::made::{Made, MadeDump};
use super::*;

#[test]
fn text_and_tables_tell_the_same_grids_and_data() {
    let dump = MadeDump::new();
    dump.write();
    let from_text = dump.read().unwrap();
    assert_eq!(from_text[0].0.lo, [0, 0, 0]);
    assert_eq!(from_text[1].0.lo, [2, 2, 2]);
    assert_eq!((from_text[2].0.lo, from_text[2].0.level), ([6, 4, 4], 2));
    assert_eq!(from_text[2].1[0], 3000.0);
    assert_eq!(from_text[2].1[31], 3031.0);
    dump.write_tables();
    std::fs::write(dump.path().with_extension("hierarchy"), "never looked at").unwrap();
    assert_eq!(dump.read().unwrap(), from_text);
}

#[test]
fn what_is_a_field_and_what_not() {
    let dump = MadeDump::new();
    dump.write();
    assert!(recognises(&dump.path()));
    let source = crate::source::open(dump.folder.path(), None).unwrap();
    let hierarchy = source.hierarchy();
    let names: Vec<&str> = hierarchy.fields.iter().map(|f| f.name.as_str()).collect();
    assert_eq!(names, ["Ax", "Density"]);
    assert_eq!((hierarchy.density, hierarchy.time), (Some(1), Some(1.5)));
    assert_eq!(hierarchy.fields[1].to_cgs, Some(2.0));
    assert_eq!(hierarchy.levels.count(), 3);
}

#[test]
fn dark_matter_is_zero_where_enzo_leaves_it_out() {
    let mut dump = MadeDump::new();
    // A second grid of level 1, which has particles where the first has none.
    let beside = Made { left: [-0.5, 1.0, 0.25], right: [0.5, 1.5, 0.75], ..dump.grids[1].clone() };
    dump.grids.push(beside);
    for with_particles in [1, 4] {
        dump.with_particles = vec![with_particles];
        dump.write();
        check_dark_matter(&dump, with_particles);
        dump.write_tables();
        check_dark_matter(&dump, with_particles);
        std::fs::remove_file(dump.path().with_extension("hierarchy.hdf5")).unwrap();
    }
    // No grid with particles has been written.
    dump.with_particles.clear();
    dump.write_data();
    let source = crate::source::open(&dump.path(), None).unwrap();
    assert!(source.hierarchy().fields.iter().all(|field| field.name != fields::DARK_MATTER));
}

fn check_dark_matter(dump: &MadeDump, with_particles: usize) {
    let source = crate::source::open(&dump.path(), None).unwrap();
    let names: Vec<&str> = source.hierarchy().fields.iter().map(|f| f.name.as_str()).collect();
    assert_eq!(names, ["Ax", "Dark_Matter_Density", "Density"]);
    let dark = crate::source::read_all(&*source, 1).unwrap();
    for ((grid, mut density), (_, dark)) in
        crate::source::read_all(&*source, 2).unwrap().into_iter().zip(dark)
    {
        if grid.id != with_particles as u64 {
            density.fill(0.0);
        }
        assert_eq!(dark, density, "grid {}", grid.id);
    }
}

#[test]
fn other_fields_and_whole_grids_are_missed_where_they_are_absent() {
    let mut dump = MadeDump::new();
    dump.with_particles = vec![1];
    let beside = Made { left: [-0.5, 1.0, 0.25], right: [0.5, 1.5, 0.75], ..dump.grids[1].clone() };
    dump.grids.push(beside);
    dump.write();
    let all = ["Ax", "Dark_Matter_Density", "Density"];
    for (left, field) in [(&["Density"][..], "Ax"), (&[], "Dark_Matter_Density")] {
        let mut file = hdf5_pure::FileBuilder::new();
        for (id, grid) in (1..).zip(&dump.grids) {
            let mut group = file.create_group(&format!("Grid{id:08}"));
            let shape: Vec<u64> = grid.size.iter().rev().map(|&n| u64::from(n)).collect();
            let values = vec![1.0; shape.iter().product::<u64>() as usize];
            for name in if id == 4 { left } else { &all } {
                group.create_dataset(name).with_f32_data(&values).with_shape(&shape);
            }
            file.add_group(group.finish());
        }
        std::fs::write(dump.path().with_extension("cpu0000"), file.finish().unwrap()).unwrap();
        let source = crate::source::open(&dump.path(), None).unwrap();
        let number = source.hierarchy().fields.iter().position(|f| f.name == field).unwrap();
        let error = crate::source::read_all(&*source, number).unwrap_err().to_string();
        assert!(error.contains(&format!("/Grid00000004/{field}")), "{error}");
    }
}

#[test]
fn a_factor_of_four_makes_levels_two_steps_apart() {
    let mut dump = MadeDump::new();
    dump.parameters = dump.parameters.replace("RefineBy = 2", "RefineBy = 4");
    dump.grids.remove(1);
    dump.grids[1].level = 1;
    dump.write();
    let grids = dump.read().unwrap();
    assert_eq!((grids[1].0.lo, grids[1].0.level), ([6, 4, 4], 1));
}

#[test]
fn parameters_that_do_not_fit_are_named() {
    for (from, to, expected) in [
        ("TopGridRank = 3", "TopGridRank = 2", "three-dimensional"),
        ("Coordinate = 0", "Coordinate = 1", "Cartesian"),
        ("RefineBy = 2", "RefineBy = 3", "factor 3"),
        ("RefineBy = 2", "RefineBy = 1", "RefineBy = 1"),
        ("RefineBy = 2\n", "", "no `RefineBy"),
        ("4 6 8", "4 6", "TopGridDimensions = 4 6"),
        ("4 6 8", "4 0 8", "along y"),
        ("4 6 8", "4 99999999999 8", "along y"),
        ("= 1 3 2", "= -1 3 2", "along x"),
        ("= 1 3 2", "= nan 3 2", "along x"),
    ] {
        let mut dump = MadeDump::new();
        dump.parameters = dump.parameters.replace(from, to);
        // Cells are cubes of a power of three, so that only the factor is amiss.
        if to == "RefineBy = 3" {
            dump.grids.truncate(2);
            dump.grids[1] = Made {
                level: 1,
                left: [-1.0, 0.0, 0.0],
                right: [1.0, 3.0, 2.0],
                size: [12, 18, 24],
            };
        }
        dump.write();
        let error = dump.error();
        assert!(error.contains("DD1") && error.contains(expected), "{to}: {error}");
    }
}

#[test]
fn grids_that_do_not_fit_are_named() {
    for (from, to, expected) in [
        ("GridRank = 3", "GridRank = 1", "grid 1: not supported: GridRank = 1"),
        ("= 6 4 6", "= 2 4 6", "grid 2: GridStartIndex 3 and GridEndIndex 2"),
        ("= 6 4 6", "= 9223372036854775807 4 6", "grid 2: GridStartIndex"),
        ("= 6 4 6", "= 6 5 6", "grid 2: its edges along y are 2 cells"),
        ("= 6 4 6", "= 6 4", "`GridEndIndex = 6 4` is malformed"),
        ("= -0.5 0.5", "= -0.42 0.5", "grid 2: its edge -0.42 along x lies 0.32 cells"),
        ("= 0.5 1 0.75", "= 0.58 1 0.75", "grid 2: its edge 0.58 along x lies 0.32 cells"),
        ("= -0.5 0.5 0.25", "= 9.5 0.5 0.25", "grid 2: "),
        ("= -0.5 0.5 0.25", "= inf 0.5 0.25", "malformed"),
        ("= 1 3 2", "= 1 3 1e300", "grid 1: "),
        ("= 1 3 2", "= 1 3 2.25", "grid 1: its edges along z are 9 cells"),
        ("Grid = 2", "Grid = two", "`Grid = two` is malformed"),
        ("Grid = 3", "Grid = 30", "/Grid00000030"),
        ("GridStartIndex = 3 3 3\nGridEndIndex = 6 8 10\n", "", "grid 1: has no GridStartIndex"),
        ("cpu0000", "cpu0007", "grid 1: its data file ./run/DD1.cpu0007 is neither"),
    ] {
        let dump = MadeDump::new();
        dump.write();
        assert!(dump.text().contains(from), "{from}");
        dump.write_text(&dump.text().replacen(from, to, 1));
        let error = dump.error();
        assert!(error.contains("DD1") && error.contains(expected), "{to}: {error}");
    }
}

#[test]
fn edges_outside_the_domain_are_refused() {
    let mut dump = MadeDump::new();
    dump.grids[1].left[0] += 2.0;
    dump.grids[1].right[0] += 2.0;
    dump.write();
    assert!(dump.error().contains("grid 2: its edges along x lie outside the domain"));
    dump.write_tables();
    assert!(dump.error().contains("hierarchy.hdf5: grid 2: its edges along x lie outside"));
}

#[test]
fn a_cut_text_hierarchy_is_refused() {
    let dump = MadeDump::new();
    dump.write();
    let text = dump.text();
    let cut = text.find("\nGrid = 3").unwrap();
    dump.write_text(&text[..cut]);
    assert!(dump.error().contains("refers to grid 3, but ends at 2"));
    dump.write_text("");
    assert!(dump.error().contains("no grid of the root level"));
    dump.write_text(&"x".repeat(1 << 20));
    assert!(dump.error().contains("line 1: is too long"));
}

#[test]
fn edges_too_deep_for_their_digits_are_refused_but_not_as_doubles() {
    let mut dump = MadeDump::new();
    dump.parameters = dump.parameters.replace("-1 0 0", "0 0 0").replace("1 3 2", "1 1 1");
    dump.parameters = dump.parameters.replace("4 6 8", "16 16 16");
    let root = Made { level: 0, left: [0.0; 3], right: [1.0; 3], size: [16; 3] };
    dump.grids = vec![root];
    for level in 1..=44 {
        let width = 2f64.powi(-4 - level);
        let left = (0.7 / width / 2.0).floor() * 2.0 * width;
        let (left, right) = ([left; 3], [left + 4.0 * width; 3]);
        dump.grids.push(Made { level: level as u32, left, right, size: [4; 3] });
    }
    dump.write();
    let printed = dump.text().replace("\n\n", "\n");
    dump.write_text(&rounded_to_14_digits(&printed));
    let error = dump.error();
    assert!(error.contains("too few digits") && error.contains("grid 43"), "{error}");
    dump.write_tables();
    let grids = dump.read().unwrap();
    let deepest = grids.last().unwrap().0;
    assert_eq!(deepest.level, 44);
    let exact = (0.7 * 2f64.powi(47)).floor() as i128 * 2;
    assert_eq!(deepest.lo, [exact; 3]);
}

/// Edges as Enzo prints them.
fn rounded_to_14_digits(text: &str) -> String {
    let round = |word: &str| match word.parse::<f64>() {
        Ok(value) if word.contains('.') => format!("{value:.13e}"),
        _ => word.to_owned(),
    };
    let line = |line: &str| match line.split_once(" = ") {
        Some((key, list)) if key.ends_with("Edge") => {
            let words: Vec<String> = list.split(' ').map(round).collect();
            format!("{key} = {}", words.join(" "))
        }
        _ => line.to_owned(),
    };
    text.lines().map(line).collect::<Vec<_>>().join("\n")
}

/// A run 54 levels deep around 10¹⁸, where doubles are 16 of its finest cells apart.
fn deeper_than_doubles() -> MadeDump {
    let (centre, half) = (10_i128.pow(18), 1 << 60);
    let mut dump = MadeDump::new();
    let all = |edge: i128| format!("{edge} {edge} {edge}");
    dump.parameters = dump
        .parameters
        .replace("-1 0 0", &all(centre - half))
        .replace("1 3 2", &all(centre + half))
        .replace("4 6 8", "16 16 16");
    dump.grids.clear();
    for level in 0..=54 {
        let root = [centre - half, centre + half];
        let edges = if level == 0 { root } else { [centre, centre + (4 << (57 - level))] };
        let [left, right] = edges.map(|edge| [edge as f64; 3]);
        let size = if level == 0 { [16; 3] } else { [4; 3] };
        dump.grids.push(Made { level, left, right, size });
        dump.long_edges.push(edges);
    }
    dump.write_data();
    dump
}

#[test]
fn positions_of_128_bits_are_read_from_tables_and_text() {
    let dump = deeper_than_doubles();
    // `%.21Lg` prints no zeros at the end: of such a number there are few digits.
    let text = dump.text().replace(" 1000000000000000000", " 1e18");
    assert!(text.contains("GridLeftEdge = 1e18 1e18 1e18\nGridRightEdge = 1000000000000000032 "));
    dump.write_text(&text);
    let from_text = dump.read().unwrap();
    let deepest = from_text.last().unwrap().0;
    assert_eq!((deepest.level, deepest.lo), (54, [8 << 54; 3]));
    dump.write_tables();
    dump.write_text("never looked at");
    if cfg!(feature = "libhdf5") {
        // The library's crate knows no such numbers.
        let error = dump.error();
        assert!(
            error.contains("GridLeftEdge: is neither numbers of a kind that is read"),
            "{error}"
        );
    } else {
        assert_eq!(dump.read().unwrap(), from_text);
    }
}

#[test]
fn edges_that_are_the_same_number_are_refused() {
    let dump = deeper_than_doubles();
    dump.write_text(&dump.text().replace("1000000000000000032", "1000000000000000000"));
    let error = dump.error();
    let expected = "grid 55: its edges along z are the same number, 1000000000000000000, so they have too \
                    few digits";
    assert!(error.contains(expected), "{error}");
    dump.write_text(&dump.text().replace("1000000000000000032", "999999999999999999"));
    assert!(dump.error().contains("grid 55: its edges along z go from"));
}

#[test]
fn runs_deeper_than_supported_are_refused() {
    let mut dump = MadeDump::new();
    dump.grids[2].level = 61;
    dump.write();
    dump.write_tables();
    assert!(dump.error().contains("grid 3: not supported: lies at level 61"));
}

#[test]
fn data_that_contradict_the_hierarchy_are_refused() {
    let mut dump = MadeDump::new();
    dump.write_text(&dump.text());
    dump.grids[2].size = [2, 2, 4];
    dump.write_data();
    let error = dump.error();
    // The first grid of a level tells the fields: none of its datasets have its shape.
    assert!(error.contains("no field in common"), "{error}");
    dump.grids.pop();
    dump.write_data();
    let error = dump.error();
    assert!(error.contains("DD1.cpu0000: /Grid00000003"), "{error}");
}

#[test]
fn missing_and_cut_files_are_named() {
    let dump = MadeDump::new();
    dump.write();
    let data = dump.data();
    std::fs::write(dump.path().with_extension("cpu0000"), &data[..data.len() / 2]).unwrap();
    assert!(dump.error().contains("DD1.cpu0000"));
    std::fs::remove_file(dump.path().with_extension("hierarchy")).unwrap();
    assert!(dump.error().contains("DD1.hierarchy: is missing"));
    std::fs::remove_file(dump.path()).unwrap();
    assert!(dump.error().contains("DD1: cannot open"));
}

#[test]
fn formats_are_told_by_content_and_named_where_none_fits() {
    let dump = MadeDump::new();
    dump.write();
    let path = dump.folder.path().join("notes.txt");
    std::fs::write(&path, "nothing").unwrap();
    let error = crate::source::open(&path, None).err().unwrap().to_string();
    assert!(error.contains("notes.txt") && error.contains("of no known format: enzo ("), "{error}");
    assert!(error.chars().count() - path.display().to_string().chars().count() < 250, "{error}");
    let error = crate::source::open(&dump.path(), Some("tiff")).err().unwrap().to_string();
    assert!(error.contains("`tiff` is not known: there are") && error.contains("enzo"), "{error}");
}

#[test]
fn a_table_longer_than_its_file_can_hold_is_refused() {
    let dump = MadeDump::new();
    dump.write();
    // Each grid takes a group beside its entry, so no table is longer than its file, compressed or not.
    let mut file = hdf5_pure::FileBuilder::new();
    let table = file.create_dataset("LevelLookupTable").with_i64_data(&[0; 1 << 18]);
    table.with_chunks(&[1 << 16]).with_lzf();
    let path = dump.path().with_extension("hierarchy.hdf5");
    std::fs::write(path, file.finish().unwrap()).unwrap();
    let error = dump.error();
    assert!(error.contains("hierarchy.hdf5: claims 262144 blocks"), "{error}");
}

#[test]
fn dumps_without_packed_amr_are_refused_by_name() {
    let dump = MadeDump::new();
    dump.write();
    let mut file = hdf5_pure::FileBuilder::new();
    file.create_dataset("Density").with_f32_data(&[0.0; 192]).with_shape(&[8, 6, 4]);
    let bytes = file.finish().unwrap();
    std::fs::write(dump.path().with_extension("cpu0000"), bytes).unwrap();
    let error = dump.error();
    assert!(error.contains("DD1.cpu0000: not supported: its fields stand in no group"), "{error}");
    assert!(error.contains("only packed AMR is read"), "{error}");
}
