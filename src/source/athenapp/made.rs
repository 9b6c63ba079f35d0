//! Small outputs, made up for tests.

use std::path::PathBuf;

use hdf5_pure::{AttrValue, Datatype, DatatypeByteOrder, FileBuilder, make_f32_type};

use crate::Result;
use crate::source::{GridRecord, read_all};

/// How values are stored.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Kind {
    F32BigEndian,
    F64,
    F16,
    Chunked,
}

/// An output in the making: root 12 × 4 × 6 in [−1, 2] × [0, 1] × [0, 3], blocks of 4 × 2 × 6, so
/// 3 × 2 × 1 root blocks, of which the first is refined. A value is 8 times the block's number
/// plus the variable's; ghost zones hold −1.
pub(super) struct MadeOutput {
    pub(super) folder: tempfile::TempDir,
    pub(super) attributes: Vec<(&'static str, AttrValue)>,
    pub(super) places: Vec<(i32, [i64; 3])>,
    pub(super) ghosts: u64,
    pub(super) kind: Kind,
}

impl MadeOutput {
    pub(super) fn new() -> Self {
        let texts = |texts: &[&str]| {
            let texts = texts.iter().map(|&text| text.to_owned()).collect();
            AttrValue::ascii_string_array_sized(texts, 21).unwrap()
        };
        let extent = |lo, hi| AttrValue::F32Array(vec![lo, hi, 1.0]);
        let mut places: Vec<_> = (0..8).map(|i| (1, [i & 1, i >> 1 & 1, i >> 2])).collect();
        places.extend((1..6).map(|i| (0, [i % 3, i / 3, 0])));
        let attributes = vec![
            ("Coordinates", AttrValue::ascii_string_sized("cartesian", 21).unwrap()),
            ("DatasetNames", texts(&["prim", "B"])),
            ("MaxLevel", AttrValue::I32(1)),
            ("MeshBlockSize", AttrValue::I32Array(vec![4, 2, 6])),
            ("NumMeshBlocks", AttrValue::I32(13)),
            ("NumVariables", AttrValue::I32Array(vec![2, 2])),
            ("RootGridSize", AttrValue::I32Array(vec![12, 4, 6])),
            ("RootGridX1", extent(-1.0, 2.0)),
            ("RootGridX2", extent(0.0, 1.0)),
            ("RootGridX3", extent(0.0, 3.0)),
            ("Time", AttrValue::F32(0.5)),
            ("VariableNames", texts(&["press", "rho", "Bcc1", "press"])),
        ];
        let folder = tempfile::tempdir().unwrap();
        Self { folder, attributes, places, ghosts: 0, kind: Kind::F64 }
    }

    pub(super) fn path(&self) -> PathBuf {
        self.folder.path().join("run.out1.00001.athdf")
    }

    pub(super) fn set(&mut self, name: &str, value: Option<AttrValue>) {
        let at = self.attributes.iter().position(|(known, _)| *known == name).unwrap();
        match value {
            Some(value) => self.attributes[at].1 = value,
            None => drop(self.attributes.remove(at)),
        }
    }

    pub(super) fn write(&self) {
        let mut file = FileBuilder::new();
        for (name, value) in &self.attributes {
            file.set_attr(name, value.clone());
        }
        let levels: Vec<i32> = self.places.iter().map(|place| place.0).collect();
        let locations: Vec<i64> = self.places.iter().flat_map(|place| place.1).collect();
        let blocks = self.places.len() as u64;
        file.create_dataset("Levels").with_i32_data(&levels);
        file.create_dataset("LogicalLocations").with_i64_data(&locations).with_shape(&[blocks, 3]);
        self.add_data(&mut file, "prim", 0);
        self.add_data(&mut file, "B", 2);
        std::fs::write(self.path(), file.finish().unwrap()).unwrap();
    }

    fn add_data(&self, file: &mut FileBuilder, name: &str, first: u64) {
        let (blocks, ghosts) = (self.places.len() as u64, self.ghosts);
        let [nz, ny, nx] = [6, 2, 4].map(|n| n + 2 * ghosts);
        let cells = nx * ny * nz;
        let value = |i: u64| {
            let [x, y, z] = [i % nx, i / nx % ny, i / nx / ny % nz];
            let inside = |at: u64, n: u64| (ghosts..n - ghosts).contains(&at);
            let number = i / cells;
            if !(inside(x, nx) && inside(y, ny) && inside(z, nz)) {
                return -1.0;
            }
            (8 * (number % blocks) + first + number / blocks) as f64
        };
        let shape = [2, blocks, nz, ny, nx];
        let values: Vec<f64> = (0..2 * blocks * cells).map(value).collect();
        let data = file.create_dataset(name);
        match self.kind {
            Kind::F64 => data.with_f64_data(&values),
            Kind::Chunked => {
                data.with_f64_data(&values).with_chunks(&[1, 3, nz, ny, nx]).with_shuffle()
            }
            Kind::F32BigEndian => {
                let bytes = values.iter().flat_map(|&v| (v as f32).to_be_bytes()).collect();
                let mut datatype = make_f32_type();
                if let Datatype::FloatingPoint { byte_order, .. } = &mut datatype {
                    *byte_order = DatatypeByteOrder::BigEndian;
                }
                data.with_raw_data(datatype, bytes, values.len() as u64)
            }
            Kind::F16 => {
                let bytes = values.iter().flat_map(|&v| half(v).to_le_bytes()).collect();
                data.with_raw_data(half_type(), bytes, values.len() as u64)
            }
        };
        data.with_shape(&shape);
    }

    /// Every grid with all values of field `field`.
    pub(super) fn read(&self, field: usize) -> Result<Vec<(GridRecord, Vec<f64>)>> {
        let source = super::AthenaPp::open(&self.path())?;
        read_all(&source, field)
    }

    #[track_caller]
    pub(super) fn error(&self) -> String {
        self.read(0).unwrap_err().to_string()
    }
}

fn half_type() -> Datatype {
    let mut datatype = make_f32_type();
    if let Datatype::FloatingPoint { size, layout, .. } = &mut datatype {
        *size = 2;
        layout.bit_precision = 16;
        (layout.exponent_location, layout.exponent_size) = (10, 5);
        (layout.mantissa_size, layout.exponent_bias) = (10, 15);
    }
    datatype
}

/// A small whole number as a 16-bit float.
fn half(value: f64) -> u16 {
    let bits = (value as f32).to_bits();
    if value == 0.0 {
        return 0;
    }
    let exponent = (bits >> 23 & 0xff) + 15 - 127;
    ((bits >> 31) << 15 | exponent << 10 | bits >> 13 & 0x3ff) as u16
}
