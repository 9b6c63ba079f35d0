//! Tests of the Athena reader on small made-up outputs.

use super::*;
use crate::source::read_all;
use crate::space::Domain;

/// An output in the making: two processes share a root grid of 4 × 6 × 8 cells in
/// [−1, 1] × [0, 3] × [0, 2]; one domain is refined, and in it another.
struct Made {
    folder: tempfile::TempDir,
    files: Vec<(&'static str, String, u32)>,
}

fn header([level, domain]: [u32; 2], points: [u32; 3], origin: &str, spacing: &str) -> String {
    let cells: u32 = points.iter().map(|n| n - 1).product();
    format!(
        "# vtk DataFile Version 2.0\nPRIMITIVE vars at time= 1.500000e+00, level= {level}, domain= \
         {domain}\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS {} {} {}\nORIGIN {origin} \nSPACING \
         {spacing} \nCELL_DATA {cells} \n",
        points[0], points[1], points[2]
    )
}

impl Made {
    fn new() -> Self {
        let root = "5.000000e-01 5.000000e-01 2.500000e-01";
        let files = [
            ("id0/B.0001.vtk", [0, 0], [3, 7, 9], "-1.000000e+00 0.000000e+00 0.000000e+00", root),
            (
                "id1/B-id1.0001.vtk",
                [0, 0],
                [3, 7, 9],
                "0.000000e+00 0.000000e+00 0.000000e+00",
                root,
            ),
            (
                "id0/lev1/B-lev1.0001.vtk",
                [1, 0],
                [5, 3, 5],
                "-5.000000e-01 5.000000e-01 2.500000e-01",
                "2.500000e-01 2.500000e-01 1.250000e-01",
            ),
            (
                "id1/lev2/B-id1-lev2.0001.vtk",
                [2, 0],
                [5, 3, 5],
                "-2.500000e-01 5.000000e-01 2.500000e-01",
                "1.250000e-01 1.250000e-01 6.250000e-02",
            ),
        ];
        let made = |(name, place, points, origin, spacing): (_, _, [u32; 3], _, _)| {
            (name, header(place, points, origin, spacing), points.iter().map(|n| n - 1).product())
        };
        Self { folder: tempfile::tempdir().unwrap(), files: files.map(made).to_vec() }
    }

    /// Values are the file's number, then the variable's part, then the cell's place.
    fn write(&self) {
        for (number, (name, header, cells)) in self.files.iter().enumerate() {
            let value = |part: u32, cell: u32| (1000 * (10 * number as u32 + part) + cell) as f32;
            let mut bytes = header.clone().into_bytes();
            bytes.extend(b"SCALARS density float\nLOOKUP_TABLE default\n");
            bytes.extend((0..*cells).flat_map(|cell| value(0, cell).to_be_bytes()));
            bytes.extend(b"\nVECTORS velocity float\n");
            let parts = |cell| [1, 2, 3].map(|part| value(part, cell).to_be_bytes()).concat();
            bytes.extend((0..*cells).flat_map(parts));
            bytes.extend(b"\nSCALARS scalar[0] double 1\nLOOKUP_TABLE default\n");
            bytes.extend((0..*cells).flat_map(|cell| f64::from(value(4, cell)).to_be_bytes()));
            bytes.extend(b"\nTENSORS Edd_tensor float\n");
            let parts = |cell| {
                [5, 6, 7, 8, 9, 5, 6, 7, 8].map(|part| value(part, cell).to_be_bytes()).concat()
            };
            bytes.extend((0..*cells).flat_map(parts));
            let path = self.folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, bytes).unwrap();
        }
    }

    /// Every grid with all values of the field `field`.
    fn read(&self, field: usize) -> Result<Vec<(GridRecord, Vec<f64>)>> {
        let source = crate::source::open(self.folder.path(), Some("athena"))?;
        read_all(&*source, field)
    }

    /// What reading says after `from` is replaced by `to` in the header of file `number`.
    fn edited(number: usize, from: &str, to: &str) -> Result<(), String> {
        let mut made = Self::new();
        assert!(made.files[number].1.contains(from), "{from}");
        made.files[number].1 = made.files[number].1.replacen(from, to, 1);
        made.write();
        made.read(1).map(|_| ()).map_err(|error| error.to_string())
    }
}

#[test]
fn domains_of_all_levels_and_processes_are_found() {
    let made = Made::new();
    made.write();
    let source = crate::source::open(&made.folder.path().join("id1/lev2"), None).unwrap();
    let hierarchy = source.hierarchy();
    assert_eq!(
        (source.format(), hierarchy.time, hierarchy.density),
        ("athena", Some(1.5), Some(0))
    );
    assert_eq!(
        hierarchy.domain,
        Domain::new([-1.0, 0.0, 0.0], [1.0, 3.0, 2.0], [4, 6, 8]).unwrap()
    );
    let names: Vec<&str> = hierarchy.fields.iter().map(|field| field.name.as_str()).collect();
    let scalars = ["density", "velocity_x", "velocity_y", "velocity_z", "scalar[0]"];
    assert_eq!((&names[..5], names.len()), (&scalars[..], 14));
    assert_eq!(
        (names[5], names[6], names[13]),
        ("Edd_tensor_xx", "Edd_tensor_xy", "Edd_tensor_zz")
    );
    for field in 0..10 {
        for (grid, values) in made.read(field).unwrap() {
            let number = match (grid.level, grid.lo, grid.size) {
                (0, [0, 0, 0], [2, 6, 8]) => 0,
                (0, [2, 0, 0], [2, 6, 8]) => 1,
                (1, [2, 2, 2], [4, 2, 4]) => 2,
                (2, [6, 4, 4], [4, 2, 4]) => 3,
                _ => panic!("{grid:?}"),
            };
            let expected =
                (0..values.len()).map(|cell| (1000 * (10 * number + field) + cell) as f64);
            assert_eq!(values, expected.collect::<Vec<_>>());
        }
    }
}

#[test]
fn edges_are_what_few_digits_stand_for() {
    let third = "3.333333e-01 3.333333e-01 3.333333e-01";
    let mut made = Made::new();
    made.files = vec![
        (
            "B.0001.vtk",
            header([0, 0], [4, 4, 4], "-1.000000e-01 0.000000e+00 0.000000e+00", third),
            27,
        ),
        (
            "lev1/B-lev1.0001.vtk",
            header(
                [1, 0],
                [3, 3, 3],
                "2.333333e-01 3.333333e-01 6.666667e-01",
                "1.666667e-01 1.666667e-01 1.666667e-01",
            ),
            8,
        ),
    ];
    made.write();
    let source = crate::source::open(made.folder.path(), None).unwrap();
    assert_eq!(source.hierarchy().domain.right(), [0.9, 1.0, 1.0]);
    assert_eq!(made.read(0).unwrap()[1].0.lo, [2, 2, 4]);
    // Of few digits 0 is none, and nearer to nothing else.
    let mut made = Made::new();
    let origin = "-1.000000e+00 0.000000e+00 0.000000e+00";
    made.files = vec![("B.0001.vtk", header([0, 0], [4, 4, 4], origin, third), 27)];
    made.write();
    let source = crate::source::open(made.folder.path(), None).unwrap();
    assert_eq!(source.hierarchy().domain.right(), [0.0, 1.0, 1.0]);
}

#[test]
fn edges_far_from_the_origin_have_few_digits_too() {
    // The upper edge, 54.196125, is taken for 54.1961.
    let place = "5.386800e+01 0.000000e+00 0.000000e+00";
    let width = "1.562500e-02 1.562500e-02 1.562500e-02";
    let mut made = Made::new();
    made.files = vec![("B.0001.vtk", header([0, 0], [22, 3, 3], place, width), 84)];
    made.write();
    let [(grid, _)] = &made.read(0).unwrap()[..] else { panic!("one grid") };
    assert_eq!((grid.lo, grid.size), ([0; 3], [21, 2, 2]));
}

#[test]
fn files_that_do_not_fit_are_named() {
    for (number, from, to, expected) in [
        (0, "BINARY", "ASCII", "`ASCII`: only binary"),
        (0, "STRUCTURED_POINTS", "RECTILINEAR_GRID", "only uniform Cartesian grids"),
        (0, "level= 0, domain= 0", "cycle= 3, variables= prim", "Athena's"),
        (0, "3 7 9", "3 7 1", "three-dimensional"),
        (0, "3 7 9", "3 7 8", "do not make the CELL_DATA's 96 cells"),
        (0, "3 7 9", "3 7", "has no DIMENSIONS"),
        (0, "CELL_DATA 96", "CELL_DATA x", "`CELL_DATA x"),
        (0, "CELL_DATA", "POINT_DATA", "`POINT_DATA 96"),
        (0, "ORIGIN -1.0", "ORIGIN nan -1.0", "has no ORIGIN"),
        (0, "SPACING 5.0", "SPACING -5.0", "cells are -0.5 wide along x"),
        (0, "level= 0", "level= 61", "level 61"),
        (0, "level= 0", "level= 1", "its cells are 0.5 wide along x"),
        (2, "level= 1", "level= 3", "its cells are 0.25 wide along x"),
        (2, "ORIGIN -5.0", "ORIGIN -4.2", "lies 0.32 cells from the lattice of level 1"),
        (2, "ORIGIN -5.0", "ORIGIN 9.9", "outside the domain"),
        (2, "-5.000000e-01 5.0", "-5.000000e+99 5.0", "along"),
        (2, "5 3 5", "9999999 999999 5", "do not make"),
        (3, "CELL_DATA 32", "CELL_DATA 33", "do not make"),
    ] {
        let error = Made::edited(number, from, to).unwrap_err();
        assert!(error.contains(expected), "{to}: {error}");
    }
    // Programs that join files may give the number of cells.
    Made::edited(3, "5 3 5", "4 2 4").unwrap();
}

#[test]
fn a_missing_root_level_and_cut_files_are_named() {
    let mut made = Made::new();
    made.files.drain(..2);
    made.write();
    assert!(made.read(0).unwrap_err().to_string().contains("no file is of level 0"));
    let made = Made::new();
    made.write();
    let file = made.folder.path().join("id1/B-id1.0001.vtk");
    let bytes = std::fs::read(&file).unwrap();
    for cut in [bytes.len() - 1, 900] {
        std::fs::write(&file, &bytes[..cut]).unwrap();
        let error = made.read(13).unwrap_err().to_string();
        assert!(error.contains("B-id1.0001.vtk") && error.contains("truncated"), "{error}");
    }
    std::fs::write(&file, &bytes[..300]).unwrap();
    assert!(made.read(13).unwrap_err().to_string().contains("96 cells in a file of 300 bytes"));
}

#[test]
fn a_run_of_several_outputs_is_told_apart_from_other_folders() {
    let mut made = Made::new();
    made.write();
    made.files.truncate(2);
    (made.files[0].0, made.files[1].0) = ("id0/B.0002.vtk", "id1/B-id1.0002.vtk");
    made.write();
    let error = crate::source::open(made.folder.path(), None).err().unwrap().to_string();
    assert!(error.contains("holds 2 Athena outputs") && error.contains("B.0001.vtk"), "{error}");
    assert!(recognises(&made.folder.path().join("id1/lev2")));
    assert!(!recognises(tempfile::tempdir().unwrap().path()));
}

#[test]
fn values_may_begin_and_end_with_bytes_that_end_lines() {
    // As 32-bit floats: line ends and blanks alone.
    let values = [0x0a0d_0a20u32, 0x0d0a_0a0a, 0x2020_2020, 0x0a0a_0a0a];
    let place = "0.000000e+00 0.000000e+00 0.000000e+00";
    for (end, table) in [
        ("\n", "LOOKUP_TABLE default"),
        ("\r\n", "LOOKUP_TABLE default"),
        ("\n", "LOOKUP_TABLE   default  "),
        (" \n", "LOOKUP_TABLE"),
    ] {
        let mut made = Made::new();
        let text = header([0, 0], [3; 3], place, place.replace("0.0", "1.0").as_str());
        made.files = vec![("B.0001.vtk", text.replace('\n', end), 8)];
        made.write();
        let file = made.folder.path().join("B.0001.vtk");
        let numbers = values.repeat(2).into_iter().flat_map(u32::to_be_bytes);
        let mut bytes = made.files[0].1.clone().into_bytes();
        bytes.extend(format!("SCALARS pressure float{end}{table}{end}").bytes());
        bytes.extend(numbers.clone());
        bytes.extend(format!("{end}VECTORS velocity float{end}").bytes());
        bytes.extend(numbers.clone().chain(numbers.clone()).chain(numbers));
        std::fs::write(&file, bytes).unwrap();
        let expected =
            |step: usize| (0..8).map(move |i| f64::from(f32::from_bits(values[step * i % 4])));
        let read = |field| made.read(field).unwrap()[0].1.clone();
        assert_eq!(read(0), expected(1).collect::<Vec<_>>(), "{end:?} {table}");
        assert_eq!(read(1), expected(3).collect::<Vec<_>>(), "{end:?} {table}");
    }
}

/// A file of 2³ cells: name, level and domain, width of its cells, and place, counted in these.
type File<'a> = (&'a str, [u32; 2], f64, [f64; 3]);

/// What opening the file `named` says of a run of `files`.
fn opened(named: &str, files: &[File<'_>]) -> Result<(), String> {
    let folder = tempfile::tempdir().unwrap();
    for &(name, place, width, cell) in files {
        let three = |values: [f64; 3]| values.map(|v| format!("{v:.6e}")).join(" ");
        let header = header(place, [3; 3], &three(cell.map(|c| c * width)), &three([width; 3]));
        let mut bytes = header.into_bytes();
        bytes.extend(b"SCALARS density float\nLOOKUP_TABLE default\n");
        bytes.extend([0; 32]);
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
    let source = crate::source::open(&folder.path().join(named), None);
    source.map(|_| ()).map_err(|error| error.to_string())
}

/// Four processes of a root grid, and two of a domain in it.
const WHOLE: [File<'_>; 6] = [
    ("id0/B.0002.vtk", [0, 0], 1.0, [0.0, 0.0, 0.0]),
    ("id1/B-id1.0002.vtk", [0, 0], 1.0, [2.0, 0.0, 0.0]),
    ("id2/B-id2.0002.vtk", [0, 0], 1.0, [0.0, 2.0, 0.0]),
    ("id3/B-id3.0002.vtk", [0, 0], 1.0, [2.0, 2.0, 0.0]),
    ("id0/lev1/B-lev1.0002.vtk", [1, 0], 0.5, [2.0, 2.0, 0.0]),
    ("id1/lev1/B-id1-lev1.0002.vtk", [1, 0], 0.5, [4.0, 2.0, 0.0]),
];

fn without(missing: &[usize]) -> Vec<File<'static>> {
    (0..WHOLE.len()).filter(|i| !missing.contains(i)).map(|i| WHOLE[i]).collect()
}

#[test]
fn files_that_leave_a_gap_are_missed() {
    opened(WHOLE[1].0, &WHOLE).unwrap();
    for (missing, expected) in [
        (&[0][..], "process 0 has no file of the root grid"),
        (&[1], "the file in id1 is missing"),
        (&[3, 4, 5], "domain 0 of level 0 leave a gap in it, as at cell [2, 2, 0]"),
    ] {
        let files = without(missing);
        let error = opened(files[0].0, &files).unwrap_err();
        assert!(error.contains(expected), "{error}");
    }
    // Of a domain that three processes share the one in the middle.
    let mut files = WHOLE.to_vec();
    files[5] = ("id2/lev1/B-id2-lev1.0002.vtk", [1, 0], 0.5, [6.0, 2.0, 0.0]);
    let error = opened(files[0].0, &files).unwrap_err();
    assert!(error.contains("domain 0 of level 1") && error.contains("in id1"), "{error}");
    // Of one that four share the first.
    let mut files = WHOLE.to_vec();
    files[4] = ("id2/lev1/B-id2-lev1.0002.vtk", [1, 0], 0.5, [2.0, 4.0, 0.0]);
    files.push(("id3/lev1/B-id3-lev1.0002.vtk", [1, 0], 0.5, [4.0, 4.0, 0.0]));
    let error = opened(files[0].0, &files).unwrap_err();
    assert!(error.contains("as at cell [2, 3, 0]"), "{error}");
}

#[test]
fn domains_and_levels_without_files_are_missed() {
    let file = |place: [u32; 2], name| (name, place, 0.5f64.powi(place[0] as i32), [0.0; 3]);
    let root = file([0, 0], "B.0001.vtk");
    let first = file([1, 0], "lev1/B-lev1.0001.vtk");
    let third = file([1, 2], "lev1/B-lev1-dom2.0001.vtk");
    let deep = file([2, 0], "lev2/B-lev2.0001.vtk");
    for (files, expected) in [
        (
            &[root, third][..],
            "no file is of domain 0 of level 1, but some are of domain 2 of level 1",
        ),
        (&[root, first, third], "no file is of domain 1 of level 1"),
        (&[root, deep], "no file is of domain 0 of level 1, but some are of domain 0 of level 2"),
    ] {
        let error = opened(root.0, files).unwrap_err();
        assert!(error.contains(expected), "{error}");
    }
    opened(root.0, &[root, first, deep]).unwrap();
}

#[test]
fn files_that_other_outputs_have_are_missed() {
    for (lacking, others, expected) in [
        // The last processes' parts of the root grid, without which it is a box as well.
        (&[2, 3, 4, 5][..], &[2, 3][..], "id2/B-id2.0001.vtk has in another output"),
        (&[5], &[4, 5], "id1/lev1/B-id1-lev1.0001.vtk has in another output"),
        (&[4, 5], &[4], "the part of domain 0 of level 1 that"),
    ] {
        let other = |i: usize| WHOLE[i].0.replace("0002", "0001");
        let names: Vec<String> = others.iter().map(|&i| other(i)).collect();
        let mut files = without(lacking);
        for (name, &i) in names.iter().zip(others) {
            files.push((name, WHOLE[i].1, WHOLE[i].2, WHOLE[i].3));
        }
        let error = opened(files[0].0, &files).unwrap_err();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn files_of_other_runs_and_of_more_processes_are_not_missed() {
    let mut files = vec![WHOLE[0]];
    // Before the run was continued by fewer processes; and cells of another width.
    files.push(("id1/B-id1.0001.vtk", [0, 0], 1.0, [0.0; 3]));
    files.push(("id2/B-id2.0001.vtk", [0, 0], 0.75, [4.0, 0.0, 0.0]));
    opened(files[0].0, &files).unwrap();
}

#[test]
fn other_vtk_files_are_told_from_athenas() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("old.0001.vtk");
    let title = "PRIMITIVE vars at time= 1.500000e+00";
    std::fs::write(&path, format!("# vtk DataFile Version 2.0\n{title}\nBINARY\n")).unwrap();
    let error = crate::source::open(&path, None).err().unwrap().to_string();
    assert!(error.contains("a VTK file whose title names no level and domain"), "{error}");
}
