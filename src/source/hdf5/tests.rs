//! The same reads through every library.

use hdf5_pure::{
    AttrValue, CharacterSet, CompoundTypeBuilder, Datatype, DatatypeByteOrder, FileBuilder,
    FixedPointLayout, GroupBuilder, StringPadding, make_f32_type, make_f64_type, make_i32_type,
};

use super::*;

fn big_endian_i64() -> Datatype {
    let layout = FixedPointLayout { signed: true, bit_offset: 0, bit_precision: 64 };
    Datatype::FixedPoint { size: 8, byte_order: DatatypeByteOrder::BigEndian, layout }
}

fn half_float(exponent_bits: u8, mantissa_bits: u8) -> Datatype {
    let mut datatype = make_f32_type();
    if let Datatype::FloatingPoint { size, layout, .. } = &mut datatype {
        *size = 2;
        layout.bit_precision = 16;
        layout.exponent_location = mantissa_bits;
        layout.exponent_size = exponent_bits;
        layout.mantissa_size = mantissa_bits;
        layout.exponent_bias = (1 << (exponent_bits - 1)) - 1;
    }
    datatype
}

/// IEEE's float of 128 bits.
pub(crate) fn quadruple() -> Datatype {
    let mut datatype = make_f64_type();
    if let Datatype::FloatingPoint { size, layout, .. } = &mut datatype {
        *size = 16;
        layout.bit_precision = 128;
        (layout.exponent_location, layout.exponent_size) = (112, 15);
        layout.mantissa_size = 112;
        layout.exponent_bias = 16383;
    }
    datatype
}

/// A float of 64 bits with another bias than IEEE's, and integers that leave bits of their bytes unused.
fn unusual() -> [Datatype; 2] {
    let mut biased = make_f64_type();
    if let Datatype::FloatingPoint { layout, .. } = &mut biased {
        layout.exponent_bias = 1000;
    }
    let mut shifted = make_i32_type();
    if let Datatype::FixedPoint { layout, .. } = &mut shifted {
        (layout.bit_offset, layout.bit_precision) = (4, 12);
    }
    [biased, shifted]
}

fn text_type(length: u32) -> Datatype {
    let (padding, charset) = (StringPadding::SpacePad, CharacterSet::Ascii);
    Datatype::String { size: length, padding, charset }
}

/// A table with two rows, `nxb` and `geometry`, whose values come first.
fn add_table<const N: usize>(
    group: &mut GroupBuilder,
    path: &str,
    value: Datatype,
    values: &[[u8; N]; 2],
) {
    let row_type = CompoundTypeBuilder::new().field("value", value).field("name", text_type(12));
    let row_type = row_type.build().unwrap();
    let row = |value: &[u8], name: &[u8]| [value, name].concat();
    let rows = [row(&values[0], b"nxb         "), row(&values[1], b"geometry    ")].concat();
    group.create_dataset(path).with_compound_data(row_type, rows, 2);
}

/// Values that f32 and f64 both hold, with what arithmetic would lose.
fn cube() -> Vec<f64> {
    let mut values: Vec<f64> = (0..4 * 5 * 6).map(|i| f64::from(i) * 0.25 - 3.0).collect();
    values[7] = f64::INFINITY;
    values[8] = -0.0;
    values
}

/// A file with every kind of object that a source may read.
fn example(path: &Path) {
    let mut file = FileBuilder::new();
    let single: Vec<f32> = cube().iter().map(|&v| v as f32).collect();
    let integers = [-3, 5, i64::MIN];
    let bytes = integers.iter().flat_map(|v| v.to_be_bytes()).collect();
    let mut group = file.create_group("Grid00000001");
    group.create_dataset("double").with_f64_data(&cube()).with_shape(&[4, 5, 6]);
    group.create_dataset("single").with_f32_data(&single).with_shape(&[4, 5, 6]);
    let chunked = group.create_dataset("chunked").with_f64_data(&cube()).with_shape(&[4, 5, 6]);
    chunked.with_chunks(&[2, 3, 4]).with_shuffle();
    group.create_dataset("big").with_raw_data(big_endian_i64(), bytes, 3);
    group.create_dataset("huge").with_u64_data(&[7, u64::MAX]);
    group.create_dataset("tiny").with_i8_data(&[-1, 2]);
    group.create_dataset("text").with_ascii_strings(&["dens", "pressure"]).unwrap();
    let half = vec![0x00, 0x3c, 0x00, 0xc0];
    group.create_dataset("half").with_raw_data(half_float(5, 10), half.clone(), 2);
    let (one, end) = (0x3fff_u128 << 112, 1_u128 << 30);
    let quadruples: Vec<u8> = [one, one | end].iter().flat_map(|v| v.to_le_bytes()).collect();
    group.create_dataset("quadruple").with_raw_data(quadruple(), quadruples, 2);
    group.create_dataset("brain").with_raw_data(half_float(8, 7), half, 2);
    let [biased, shifted] = unusual();
    group.create_dataset("biased").with_raw_data(biased, 1f64.to_le_bytes().to_vec(), 1);
    group.create_dataset("shifted").with_raw_data(shifted, 48i32.to_le_bytes().to_vec(), 1);
    let column = group.create_dataset("column").with_ascii_strings_sized(&["ye", "dens"], 4);
    column.unwrap().with_shape(&[2, 1]);
    add_table(&mut group, "integers", make_i32_type(), &[3i32.to_le_bytes(), 7i32.to_le_bytes()]);
    add_table(&mut group, "floats", make_f64_type(), &[0.1f64.to_le_bytes(), 2f64.to_le_bytes()]);
    add_table(&mut group, "texts", text_type(9), &[*b"cartesian", *b"none     "]);
    group.set_attr("GridRank", AttrValue::I64(3));
    group.set_attr("Time", AttrValue::F64(0.1));
    group.set_attr("Sizes", AttrValue::I32Array(vec![4, -5]));
    group.set_attr("BaryonFileName", AttrValue::AsciiString("./DD1/DD1.cpu0000".into()));
    let inner = group.create_group("DaughterGrids");
    group.add_group(inner.finish());
    file.add_group(group.finish());
    file.write(path).unwrap();
}

fn with_example(check: impl Fn(&File)) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("example.h5");
    example(&path);
    check(&File::open_with::<pure::Pure>(&path).unwrap());
    #[cfg(feature = "libhdf5")]
    check(&File::open_with::<native::Native>(&path).unwrap());
}

#[test]
fn members_and_attributes() {
    with_example(|file| {
        assert_eq!(file.members("/").unwrap().groups, ["Grid00000001"]);
        let members = file.members("/Grid00000001").unwrap();
        assert_eq!(members.groups, ["DaughterGrids"]);
        assert_eq!(members.datasets.len(), 16);
        assert_eq!(members.datasets[..4], ["biased", "big", "brain", "chunked"]);
        let attributes = file.attributes("/Grid00000001").unwrap();
        assert_eq!(attributes["GridRank"].integers(), Some([3]));
        assert_eq!(attributes["Time"].floats(), Some([0.1]));
        assert_eq!(attributes["Sizes"], Values::Integers(vec![4, -5]));
        assert_eq!(attributes["BaryonFileName"].text(), Some("./DD1/DD1.cpu0000"));
        assert!(file.attributes("/").unwrap().is_empty());
    });
}

#[test]
fn lists_of_every_kind() {
    with_example(|file| {
        let values = |name: &str| file.values(&format!("/Grid00000001/{name}")).unwrap();
        assert_eq!(values("big"), Values::Integers(vec![-3, 5, i64::MIN]));
        assert_eq!(values("huge"), Values::Integers(vec![7, i64::MAX]));
        assert_eq!(values("tiny"), Values::Integers(vec![-1, 2]));
        assert_eq!(values("text"), Values::Text(vec!["dens".into(), "pressure".into()]));
        assert_eq!(values("column"), Values::Text(vec!["ye".into(), "dens".into()]));
        assert_eq!(values("half"), Values::Floats(vec![1.0, -2.0]));
        assert!(file.values("/Grid00000001/double").is_err());
        // Other numbers than IEEE's, and integers with unused bits, are read right (by the C library) or
        // not at all.
        for (name, expected) in [
            ("brain", Values::Floats(vec![0.0078125, -2.0])),
            ("biased", Values::Floats(vec![23f64.exp2()])),
            ("shifted", Values::Integers(vec![3])),
            ("quadruple", Values::Extended(vec![[1.0, 0.0], [1.0, 2f64.powi(-82)]])),
        ] {
            let found = file.values(&format!("/Grid00000001/{name}"));
            assert!(found.as_ref().map_or(true, |found| *found == expected), "{name}: {found:?}");
        }
    });
}

#[test]
fn numbers_of_128_bits_are_read_as_lists_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("example.h5");
    example(&path);
    let file = File::open_with::<pure::Pure>(&path).unwrap();
    let name = "/Grid00000001/quadruple";
    assert_eq!(file.dataset(name).unwrap().element, Element::Extended);
    let sums = file.values(name).unwrap().sums();
    assert_eq!(sums, Some([[1.0, 0.0], [1.0, 2f64.powi(-82)]]));
    assert!(file.read_f64(name, &[0], &[2], &mut [0.0; 2]).is_err());
    assert_eq!(Values::Floats(vec![0.5]).sums(), Some([[0.5, 0.0]]));
}

#[test]
fn tables_are_read_by_the_names_of_their_members() {
    with_example(|file| {
        let table = |name: &str| file.table(&format!("/Grid00000001/{name}"));
        assert_eq!(table("integers").unwrap()["nxb"].integers(), Some([3]));
        assert_eq!(table("integers").unwrap()["geometry"].integers(), Some([7]));
        assert_eq!(table("floats").unwrap()["nxb"].floats(), Some([0.1]));
        assert_eq!(table("texts").unwrap()["nxb"].text(), Some("cartesian"));
        assert_eq!(table("texts").unwrap()["geometry"].text(), Some("none"));
        for name in ["double", "big", "text", "absent"] {
            assert!(table(name).unwrap_err().to_string().contains(name));
        }
    });
}

#[test]
fn blocks_are_parts_of_the_whole_whatever_the_storage() {
    let whole = cube();
    with_example(|file| {
        for name in ["double", "single", "chunked"] {
            let path = format!("/Grid00000001/{name}");
            assert_eq!(file.dataset(&path).unwrap().shape, [4, 5, 6]);
            let mut out = vec![0.0; 120];
            file.read_f64(&path, &[0, 0, 0], &[4, 5, 6], &mut out).unwrap();
            assert_eq!(out, whole, "{name}");
            let mut out = vec![0.0; 12];
            file.read_f64(&path, &[1, 2, 3], &[3, 2, 2], &mut out).unwrap();
            let at = |i: usize| whole[(1 + i / 4) * 30 + (2 + i / 2 % 2) * 6 + 3 + i % 2];
            assert_eq!(out, (0..12).map(at).collect::<Vec<_>>(), "{name}");
        }
        let mut out = [0.0; 2];
        file.read_f64("/Grid00000001/huge", &[0], &[2], &mut out).unwrap();
        assert_eq!(out, [7.0, u64::MAX as f64]);
    });
}

#[test]
fn what_is_asked_amiss_is_an_error_that_names_the_object() {
    with_example(|file| {
        let mut out = [0.0; 4];
        let cases: [(&str, [u64; 3], [u64; 3]); 5] = [
            ("double", [0, 0, 3], [1, 1, 4]),
            ("double", [u64::MAX, 0, 0], [1, 1, 4]),
            ("double", [0, 0, 0], [1, 1, 3]),
            ("big", [0, 0, 0], [1, 1, 3]),
            ("absent", [0, 0, 0], [1, 1, 4]),
        ];
        for (name, start, count) in cases {
            let path = format!("/Grid00000001/{name}");
            let error = file.read_f64(&path, &start, &count, &mut out).unwrap_err().to_string();
            assert!(error.contains("example.h5") && error.contains(&path), "{error}");
        }
        assert!(file.read_i64("/Grid00000001/tiny", &[0], &[2], &mut [0; 2]).is_ok());
        assert!(file.read_i64("/Grid00000001/text", &[0], &[2], &mut [0; 2]).is_err());
        assert!(file.read_f64("/Grid00000001/text", &[0], &[2], &mut [0.0; 2]).is_err());
        assert!(file.members("/Grid00000002").is_err());
    });
}

#[test]
fn large_blocks_are_read_in_parts_that_fit_together() {
    let mut parts = 0;
    let count = [3, 1 << 10, 1 << 9];
    let mut out = vec![0; 3 << 19];
    read_in_parts(&[2, 0, 0], &count, &mut out, &mut |start, count, out: &mut [u64]| {
        parts += 1;
        assert!(out.len() <= READ_VALUES);
        let [ny, nx] = [count[1], count[2]];
        for (i, value) in (0..).zip(out) {
            let [x, y, z] = [i % nx, i / nx % ny, i / nx / ny];
            *value = ((start[0] + z) << 19) + ((start[1] + y) << 9) + start[2] + x;
        }
        Ok(())
    })
    .unwrap();
    assert_eq!(parts, 3);
    assert!(out.iter().zip(2 << 19..).all(|(&value, expected)| value == expected));
}

/// Blocks that lie in few large chunks, or in many small ones, are read from chunks that are kept: one that
/// has been read once is there when the file's values are not.
#[test]
fn chunks_of_any_size_are_decoded_once() {
    for chunk in [[96, 96, 96], [1, 1, 96]] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("chunks.h5");
        let mut builder = FileBuilder::new();
        let values: Vec<f64> = (0..96_u32.pow(3)).map(f64::from).collect();
        let dataset = builder.create_dataset("values").with_f64_data(&values);
        dataset.with_shape(&[96, 96, 96]).with_chunks(&chunk).with_shuffle();
        builder.write(&path).unwrap();
        let file = File::open_with::<pure::Pure>(&path).unwrap();
        let kept = file.cached_bytes();
        let read = |start: [u64; 3]| {
            let mut block = vec![0.0; 32 * 32 * 4];
            file.read_f64("/values", &start, &[32, 32, 4], &mut block).unwrap();
            block
        };
        let first = read([0; 3]);
        assert_eq!(first[..5], [0.0, 1.0, 2.0, 3.0, 96.0]);
        assert!(file.cached_bytes() > kept, "{chunk:?}");
        // Nothing is left of the file.
        std::fs::write(&path, vec![0; std::fs::metadata(&path).unwrap().len() as usize]).unwrap();
        assert_eq!(read([0; 3]), first);
        assert_eq!(read([0, 0, 4])[..2], [4.0, 5.0]);
    }
}

#[test]
fn what_is_not_hdf5_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("text.h5");
    std::fs::write(&path, "not this").unwrap();
    assert!(File::open(&path).err().unwrap().to_string().contains("text.h5"));
    assert!(matches!(File::open(&folder.path().join("absent")), Err(Error::Io { .. })));
}

/// Every dataset of every grid of a real run, bit by bit.
#[cfg(feature = "libhdf5")]
#[test]
fn both_libraries_read_the_same_of_real_runs() {
    let data = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data"));
    for name in ["enzo_deep25/DD0021/DD0021", "enzo_offdomain/DD0001/DD0001"] {
        let path = data.join(format!("{name}.cpu0000"));
        if !path.is_file() {
            eprintln!("skipped: {} is not there", path.display());
            continue;
        }
        let pure = File::open_with::<pure::Pure>(&path).unwrap();
        let native = File::open_with::<native::Native>(&path).unwrap();
        let groups = pure.members("/").unwrap();
        assert_eq!(groups, native.members("/").unwrap());
        for group in groups.groups {
            let members = pure.members(&group).unwrap();
            assert_eq!(members, native.members(&group).unwrap());
            for dataset in members.datasets {
                let dataset = format!("/{group}/{dataset}");
                assert_eq!(bits(&pure, &dataset), bits(&native, &dataset), "{dataset}");
            }
        }
    }
}

#[cfg(feature = "libhdf5")]
fn bits(file: &File, dataset: &str) -> Vec<u64> {
    let shape = file.dataset(dataset).unwrap().shape;
    let mut out = vec![0.0; shape.iter().product::<u64>() as usize];
    file.read_f64(dataset, &vec![0; shape.len()], &shape, &mut out).unwrap();
    out.iter().map(|v| v.to_bits()).collect()
}

#[test]
fn what_stands_behind_a_user_block_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let behind = |block: usize| {
        let path = folder.path().join(format!("{block}.h5"));
        std::fs::write(&path, [&vec![7; block], &b"\x89HDF\r\n\x1a\nmore"[..]].concat()).unwrap();
        path
    };
    let found = [0, 512, 1024, 700].map(|block| {
        let path = behind(block);
        (is_hdf5(&path), is_behind_user_block(&path))
    });
    assert_eq!(found, [(true, false), (false, true), (false, true), (false, false)]);
    let said = crate::source::open(&behind(2048), None).err().unwrap().to_string();
    assert!(said.contains("is an HDF5 file behind a user block"), "{said}");
}
