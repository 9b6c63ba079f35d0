//! Tests of the Athena++ reader on small made-up outputs.

use hdf5_pure::AttrValue;

use super::made::{Kind, MadeOutput};
use super::*;

#[test]
fn blocks_and_values_whatever_the_numbers_kind() {
    for kind in [Kind::F64, Kind::F32BigEndian, Kind::F16, Kind::Chunked] {
        let mut output = MadeOutput::new();
        output.kind = kind;
        output.write();
        // Field 2 is the first of the second dataset.
        let grids = output.read(2).unwrap();
        assert_eq!(grids.len(), 13);
        for (number, (grid, values)) in grids.iter().enumerate() {
            let (level, location) = output.places[number];
            assert_eq!((grid.level, grid.size), (level as u32, [4, 2, 6]));
            assert_eq!(grid.lo, [0, 1, 2].map(|a| i128::from(location[a]) * [4, 2, 6][a]));
            assert_eq!(values, &vec![(8 * number + 2) as f64; 48]);
        }
    }
}

#[test]
fn what_an_output_says_of_itself() {
    let output = MadeOutput::new();
    output.write();
    assert!(recognises(&output.path()));
    let source = crate::source::open(&output.path(), None).unwrap();
    let hierarchy = source.hierarchy();
    let names: Vec<&str> = hierarchy.fields.iter().map(|f| f.name.as_str()).collect();
    assert_eq!(names, ["prim.press", "rho", "Bcc1", "B.press"]);
    assert_eq!((hierarchy.density, hierarchy.time), (Some(1), Some(0.5)));
    assert_eq!(hierarchy.domain.root_cells(), [12, 4, 6]);
    assert_eq!(hierarchy.levels.count(), 2);
}

#[test]
fn a_truncated_output_is_told_from_one_of_no_known_format() {
    let output = MadeOutput::new();
    output.write();
    let bytes = std::fs::read(output.path()).unwrap();
    std::fs::write(output.path(), &bytes[..bytes.len() - 1]).unwrap();
    std::fs::write(output.folder.path().join("notes.txt"), "text").unwrap();
    for path in [&output.path(), output.folder.path()] {
        let error = crate::source::open(path, None).err().unwrap().to_string();
        assert!(error.contains("truncated") && !error.contains("no known format"), "{error}");
        assert!(error.contains("run.out1.00001.athdf"), "{error}");
    }
}

#[test]
fn a_folder_stands_for_the_one_output_in_it() {
    let output = MadeOutput::new();
    let folder = output.folder.path();
    let open = |format| crate::source::open(folder, format);
    let error = |format| open(format).err().map_or_else(String::new, |e| e.to_string());
    std::fs::write(folder.join("notes.txt"), "text").unwrap();
    assert!(error(None).contains("of no known format"));
    assert!(error(Some("athena++")).contains("is a folder without a file of athena++ in it"));
    output.write();
    let name = output.path().file_name().unwrap().to_str().unwrap().to_owned();
    // Names the output, and is none.
    let beside = format!("<Xdmf>{name}:/x1f</Xdmf>");
    std::fs::write(output.path().with_extension("athdf.xdmf"), beside).unwrap();
    for format in [None, Some("athena++")] {
        let source = open(format).unwrap();
        assert_eq!((source.format(), source.path()), ("athena++", output.path().as_path()));
    }
    assert!(error(Some("flash")).contains("without a file of flash"));
    for number in 2..=5 {
        let other = format!("run.out1.0000{number}.athdf");
        std::fs::copy(output.path(), folder.join(other)).unwrap();
    }
    let three = [1, 2, 3].map(|n| format!("run.out1.0000{n}.athdf")).join(", ");
    for format in [None, Some("athena++")] {
        let said = error(format);
        assert!(said.contains(&format!("holds several outputs, {three}, …: name one")), "{said}");
    }
    let deeper = tempfile::tempdir().unwrap();
    std::fs::rename(folder, deeper.path().join("run")).unwrap();
    let error = crate::source::open(deeper.path(), None).err().unwrap().to_string();
    assert!(error.contains("of no known format"), "{error}");
}

#[test]
fn variables_of_one_name_are_told_apart() {
    let mut output = MadeOutput::new();
    let names = ["press", "press", "Bcc1", "press"].map(str::to_owned).to_vec();
    output.set("VariableNames", Some(AttrValue::ascii_string_array_sized(names, 21).unwrap()));
    output.write();
    let source = crate::source::open(&output.path(), None).unwrap();
    let names: Vec<&str> = source.hierarchy().fields.iter().map(|f| f.name.as_str()).collect();
    assert_eq!(names, ["prim.press", "prim.press.1", "Bcc1", "B.press"]);
    assert_eq!(output.read(1).unwrap()[2].1[0], 17.0);
}

#[test]
fn an_xdmf_is_as_good_as_its_file() {
    let output = MadeOutput::new();
    output.write();
    let path = output.path().with_extension("athdf.xdmf");
    let text = "<?xml version=\"1.0\" ?>\n<Xdmf>\n<DataItem>run.out1.00001.athdf:/x1f</DataItem>";
    std::fs::write(&path, text).unwrap();
    let source = crate::source::open(&path, None).unwrap();
    assert_eq!((source.format(), source.path()), ("athena++", path.as_path()));
    std::fs::remove_file(output.path()).unwrap();
    let error = crate::source::open(&path, Some("athena++")).err().unwrap().to_string();
    assert!(error.contains("run.out1.00001.athdf: cannot open"), "{error}");
}

#[test]
fn ghost_zones_are_left_out() {
    let mut output = MadeOutput::new();
    output.ghosts = 2;
    output.set("MeshBlockSize", Some(AttrValue::I32Array(vec![8, 6, 10])));
    output.write();
    for (number, (grid, values)) in output.read(1).unwrap().iter().enumerate() {
        assert_eq!(grid.size, [4, 2, 6]);
        assert_eq!(values, &vec![(8 * number + 1) as f64; 48]);
    }
}

#[test]
fn locations_beyond_32_bits_are_exact() {
    let mut output = MadeOutput::new();
    let (level, location) = (40, (1i64 << 41) + 3);
    output.places[12] = (level, [location, 1, 0]);
    output.write();
    let (deep, _) = output.read(0).unwrap()[12];
    assert_eq!((deep.level, deep.lo[0]), (40, i128::from(location) * 4));
}

#[test]
fn flat_space_time_is_flat_space() {
    let mut output = MadeOutput::new();
    output.set("Coordinates", Some(AttrValue::ascii_string_sized("minkowski", 21).unwrap()));
    output.write();
    assert_eq!(output.read(0).unwrap().len(), 13);
}

#[test]
fn other_meshes_are_refused_by_name() {
    let integers = |values: [i32; 3]| Some(AttrValue::I32Array(values.to_vec()));
    let floats = |values: [f32; 3]| Some(AttrValue::F32Array(values.to_vec()));
    let text = |text: &str| Some(AttrValue::ascii_string_sized(text, 21).unwrap());
    for (name, value, expected) in [
        ("Coordinates", text("cylindrical"), "coordinates `cylindrical`: only cartesian"),
        ("Coordinates", None, "no attribute Coordinates"),
        ("RootGridX2", floats([0.0, 1.0, 1.05]), "cells are stretched along x2 (RootGridX2"),
        ("RootGridX2", floats([1.0, 1.0, 1.0]), "along y are 1 and 1"),
        ("RootGridX2", floats([f32::NAN, 1.0, 1.0]), "along y are NaN"),
        (
            "RootGridX1",
            None,
            "no attribute RootGridX1: is it a whole Athena++ output, written with",
        ),
        ("RootGridSize", integers([12, 4, 1]), "one cell along x3: only three-dimensional"),
        ("MeshBlockSize", integers([4, 1, 6]), "a slice or sum along x2"),
        ("MeshBlockSize", integers([4, 0, 6]), "MeshBlockSize is malformed ([4, 0, 6])"),
        ("MeshBlockSize", integers([4, 4, 6]), "do not make up a root grid"),
        ("RootGridSize", integers([13, 4, 6]), "do not make up a root grid"),
        ("NumMeshBlocks", Some(AttrValue::I32(14)), "/Levels: its shape [13] should be [14]"),
        ("NumMeshBlocks", Some(AttrValue::I64(1 << 40)), "cannot hold"),
        ("NumMeshBlocks", Some(AttrValue::I32(0)), "NumMeshBlocks is malformed"),
        ("NumVariables", Some(AttrValue::I32Array(vec![2, 1])), "do not fit each other"),
        ("NumVariables", Some(AttrValue::I32Array(vec![3, 1])), "/prim: its shape"),
        ("NumVariables", Some(AttrValue::I32Array(vec![5, -1])), "NumVariables is malformed"),
        ("DatasetNames", text("prim"), "1 DatasetNames, 2 NumVariables and 4 VariableNames"),
    ] {
        let mut output = MadeOutput::new();
        output.set(name, value);
        output.write();
        let error = output.error();
        assert!(error.contains("run.out1.00001.athdf") && error.contains(expected), "{error}");
    }
}

#[test]
fn places_that_cannot_be_are_refused() {
    for (place, expected) in [
        ((-1, [0, 0, 0]), "block 12: its level -1 and location"),
        ((0, [0, -2, 0]), "block 12: its level 0 and location [0, -2, 0] must not be negative"),
        ((61, [0, 0, 0]), "block 12: not supported: lies at level 61"),
        ((0, [3, 0, 0]), "reach over [4, 2, 1] root blocks"),
        ((0, [i64::MAX, 0, 0]), "root blocks"),
    ] {
        let mut output = MadeOutput::new();
        output.places[12] = place;
        output.write();
        let error = output.error();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn missing_and_cut_data_are_named() {
    let mut output = MadeOutput::new();
    output.set(
        "DatasetNames",
        Some(AttrValue::ascii_string_array_sized(vec!["prim".into(), "cons".into()], 21).unwrap()),
    );
    output.write();
    assert!(output.error().contains("run.out1.00001.athdf: /cons"));
    let output = MadeOutput::new();
    output.write();
    let bytes = std::fs::read(output.path()).unwrap();
    std::fs::write(output.path(), &bytes[..bytes.len() / 2]).unwrap();
    assert!(output.error().contains("run.out1.00001.athdf"));
}
