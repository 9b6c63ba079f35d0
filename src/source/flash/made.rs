//! Small files, made up for tests.

use std::path::PathBuf;

use hdf5_pure::{
    CharacterSet, CompoundTypeBuilder, Datatype, FileBuilder, StringPadding, make_f64_type,
    make_i32_type,
};

use crate::Result;
use crate::source::{GridRecord, read_all};

/// A file in the making: 3 × 1 × 1 root blocks of 2 × 4 × 6 cells in [−1, 2] × [0, 1] × [0, 3];
/// the second is refined, numbers 3 to 10 are its children, number 11 is the third root block.
/// The value of a block's cell is 100 times the block's number (from 1) plus the cell's; the first
/// variable counts, the second is its negative. Parents hold NaN.
pub(super) struct MadeFile {
    pub(super) folder: tempfile::TempDir,
    pub(super) integers: Vec<(&'static str, i32)>,
    pub(super) reals: Vec<(&'static str, f64)>,
    pub(super) texts: Vec<(&'static str, &'static str)>,
    pub(super) names: Vec<&'static str>,
    pub(super) levels: Vec<i32>,
    pub(super) types: Vec<i32>,
    pub(super) gid: Vec<[i32; 15]>,
    pub(super) boxes: Vec<[f64; 6]>,
    /// Datasets that are not written.
    pub(super) without: Vec<&'static str>,
}

impl MadeFile {
    pub(super) fn new() -> Self {
        let mut gid = vec![[-1; 15]; 11];
        let mut boxes = vec![[-1.0, 0.0, 0.0, 1.0, 0.0, 3.0]; 11];
        boxes[1][..2].copy_from_slice(&[0.0, 1.0]);
        boxes[10][..2].copy_from_slice(&[1.0, 2.0]);
        for octant in 0..8 {
            gid[1][7 + octant] = octant as i32 + 3;
            gid[octant + 2][6] = 2;
            let half = |axis: usize| (octant >> axis & 1) as f64 / 2.0;
            let [x, y, z] = [half(0), half(1), 3.0 * half(2)];
            boxes[octant + 2] = [x, x + 0.5, y, y + 0.5, z, z + 1.5];
        }
        let mut levels = vec![2; 11];
        (levels[0], levels[1], levels[10]) = (1, 1, 1);
        let mut types = vec![1; 11];
        types[1] = 2;
        let integers = vec![
            ("nxb", 2),
            ("nyb", 4),
            ("nzb", 6),
            ("dimensionality", 3),
            ("globalnumblocks", 11),
            ("nblockx", 3),
            ("nblocky", 1),
            ("nblockz", 1),
        ];
        let reals = vec![
            ("time", 0.5),
            ("xmin", -1.0),
            ("xmax", 2.0),
            ("ymin", 0.0),
            ("ymax", 1.0),
            ("zmin", 0.0),
            ("zmax", 3.0),
        ];
        let texts = vec![("geometry", "cartesian"), ("pc_unitsbase", "CGS")];
        let names = vec!["ye", "dens"];
        let folder = tempfile::tempdir().unwrap();
        let without = Vec::new();
        Self { folder, integers, reals, texts, names, levels, types, gid, boxes, without }
    }

    pub(super) fn path(&self) -> PathBuf {
        self.folder.path().join("run_hdf5_chk_0001")
    }

    pub(super) fn write(&self) {
        let mut file = FileBuilder::new();
        let blocks = self.levels.len() as u64;
        let has = |name: &str| !self.without.contains(&name);
        let rows = |bytes: &[(&str, Vec<u8>)]| {
            bytes
                .iter()
                .flat_map(|(name, value)| [value.clone(), padded(name, 80)].concat())
                .collect()
        };
        let mut table = |name: &str, value: Datatype, values: Vec<(&str, Vec<u8>)>| {
            let row = CompoundTypeBuilder::new().field("value", value).field("name", text(80));
            let count = values.len() as u64;
            if has(name) {
                let row = row.build().unwrap();
                file.create_dataset(name).with_compound_data(row, rows(&values), count);
            }
        };
        let integers = self.integers.iter().map(|(n, v)| (*n, v.to_le_bytes().to_vec())).collect();
        table("integer scalars", make_i32_type(), integers);
        let reals = self.reals.iter().map(|(n, v)| (*n, v.to_le_bytes().to_vec())).collect();
        table("real runtime parameters", make_f64_type(), reals);
        let texts = self.texts.iter().map(|(n, v)| (*n, padded(v, 12))).collect();
        table("string runtime parameters", text(12), texts);
        let names: Vec<u8> = self.names.iter().flat_map(|name| padded(name, 4)).collect();
        let count = self.names.len() as u64;
        file.create_dataset("unknown names").with_raw_data(text(4), names, count);
        if has("refine level") {
            file.create_dataset("refine level").with_i32_data(&self.levels);
        }
        file.create_dataset("node type").with_i32_data(&self.types);
        if has("gid") {
            let gid: Vec<i32> = self.gid.iter().flatten().copied().collect();
            file.create_dataset("gid").with_i32_data(&gid).with_shape(&[blocks, 15]);
        }
        let boxes: Vec<f64> = self.boxes.iter().flatten().copied().collect();
        file.create_dataset("bounding box").with_f64_data(&boxes).with_shape(&[blocks, 3, 2]);
        for (name, sign) in [("ye  ", 1.0), ("dens", -1.0)] {
            let value = |i: u64| match self.types[(i / 48) as usize] {
                1 => sign * (100 * (i / 48 + 1) + i % 48) as f64,
                _ => f64::NAN,
            };
            let values: Vec<f64> = (0..blocks * 48).map(value).collect();
            file.create_dataset(name).with_f64_data(&values).with_shape(&[blocks, 6, 4, 2]);
        }
        std::fs::write(self.path(), file.finish().unwrap()).unwrap();
    }

    /// Every grid with all values of field `field`.
    pub(super) fn read(&self, field: usize) -> Result<Vec<(GridRecord, Vec<f64>)>> {
        let source = super::Flash::open(&self.path())?;
        read_all(&source, field)
    }

    #[track_caller]
    pub(super) fn error(&self) -> String {
        self.read(0).unwrap_err().to_string()
    }
}

fn text(letters: u32) -> Datatype {
    let (padding, charset) = (StringPadding::SpacePad, CharacterSet::Ascii);
    Datatype::String { size: letters, padding, charset }
}

fn padded(text: &str, letters: usize) -> Vec<u8> {
    let mut bytes = text.as_bytes().to_vec();
    bytes.resize(letters, b' ');
    bytes
}
