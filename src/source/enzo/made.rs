//! Small dumps, made up for tests.

use std::fmt::Write;
use std::path::PathBuf;

use hdf5_pure::{AttrValue, FileBuilder};

use crate::Result;
use crate::source::hdf5::quadruple;
use crate::source::{GridRecord, read_all};

/// A grid of a made-up dump. Its data are its number plus the cell's place in the grid.
#[derive(Clone)]
pub(super) struct Made {
    pub(super) level: u32,
    pub(super) left: [f64; 3],
    pub(super) right: [f64; 3],
    pub(super) size: [u32; 3],
}

/// A dump in the making: root 4 × 6 × 8 in [−1, 1] × [0, 3] × [0, 2], cells 0.5, 0.5, 0.25, and
/// a grid two levels below it.
pub(super) struct MadeDump {
    pub(super) folder: tempfile::TempDir,
    pub(super) parameters: String,
    pub(super) grids: Vec<Made>,
    /// Corners of the grids, the same along x, y and z, where doubles do not hold them: the tables have
    /// numbers of 128 bits then.
    pub(super) long_edges: Vec<[i128; 2]>,
    /// The grids that particles lie in, and that therefore have dark matter.
    pub(super) with_particles: Vec<usize>,
}

impl MadeDump {
    pub(super) fn new() -> Self {
        let parameters = "TopGridRank = 3\nTopGridDimensions = 4 6 8\nRefineBy = 2\n\
            DomainLeftEdge = -1 0 0\nDomainRightEdge = 1 3 2\nInitialTime = 1.5\n\
            DataLabel[0] = Density\n#DataCGSConversionFactor[0] = 2\nCoordinate = 0\n";
        let root =
            Made { level: 0, left: [-1.0, 0.0, 0.0], right: [1.0, 3.0, 2.0], size: [4, 6, 8] };
        let fine =
            Made { level: 1, left: [-0.5, 0.5, 0.25], right: [0.5, 1.0, 0.75], size: [4, 2, 4] };
        let finest =
            Made { level: 2, left: [-0.25, 0.5, 0.25], right: [0.25, 0.75, 0.5], size: [4, 2, 4] };
        Self {
            folder: tempfile::tempdir().unwrap(),
            parameters: parameters.into(),
            grids: vec![root, fine, finest],
            long_edges: Vec::new(),
            with_particles: Vec::new(),
        }
    }

    pub(super) fn path(&self) -> PathBuf {
        self.folder.path().join("DD1")
    }

    pub(super) fn text(&self) -> String {
        let mut text = String::new();
        for (id, grid) in (1..).zip(&self.grids) {
            let list = |v: [f64; 3], side: usize| match self.long_edges.get(id - 1) {
                Some(edges) => format!("{0} {0} {0}", edges[side]),
                None => format!("{} {} {}", v[0], v[1], v[2]),
            };
            let end = grid.size.map(|n| n + 2);
            writeln!(
                text,
                "\nGrid = {id}\nGridRank = 3\nGridStartIndex = 3 3 3\n\
                 GridEndIndex = {} {} {}\nGridLeftEdge = {}\nGridRightEdge = {}\n\
                 BaryonFileName = ./run/DD1.cpu0000\nNumberOfParticles = {}\n\
                 Pointer: Grid[{id}]->NextGridNextLevel = 0\n\
                 Pointer: Grid[{id}]->NextGridThisLevel = {}",
                end[0],
                end[1],
                end[2],
                list(grid.left, 0),
                list(grid.right, 1),
                2 * usize::from(self.with_particles.contains(&id)),
                if id < self.grids.len() { id + 1 } else { 0 }
            )
            .unwrap();
        }
        text
    }

    pub(super) fn write_text(&self, text: &str) {
        std::fs::write(self.path(), &self.parameters).unwrap();
        std::fs::write(self.path().with_extension("hierarchy"), text).unwrap();
    }

    pub(super) fn data(&self) -> Vec<u8> {
        let mut file = FileBuilder::new();
        for (id, grid) in (1u32..).zip(&self.grids) {
            let mut group = file.create_group(&format!("Grid{id:08}"));
            let shape: Vec<u64> = grid.size.iter().rev().map(|&n| u64::from(n)).collect();
            let cells: u32 = grid.size.iter().product();
            let has_particles = self.with_particles.contains(&(id as usize));
            let values: Vec<f32> = (0..cells).map(|i| (1000 * id + i) as f32).collect();
            group.create_dataset("Density").with_f32_data(&values).with_shape(&shape);
            group.create_dataset("Ax").with_f32_data(&values).with_shape(&shape);
            if has_particles {
                let dark = group.create_dataset("Dark_Matter_Density");
                dark.with_f32_data(&values).with_shape(&shape);
            }
            group.create_dataset("particle_mass").with_f64_data(&[1.0, 2.0]);
            let face = vec![0.0; (shape[0] * shape[1] * (shape[2] + 1)) as usize];
            let face_shape = [shape[0], shape[1], shape[2] + 1];
            group.create_dataset("BxF").with_f64_data(&face).with_shape(&face_shape);
            file.add_group(group.finish());
        }
        file.finish().unwrap()
    }

    pub(super) fn write_data(&self) {
        std::fs::write(self.path().with_extension("cpu0000"), self.data()).unwrap();
    }

    pub(super) fn tables(&self) -> Vec<u8> {
        let mut file = FileBuilder::new();
        let levels: Vec<i64> = self.grids.iter().map(|grid| i64::from(grid.level)).collect();
        file.create_dataset("LevelLookupTable").with_i64_data(&levels);
        file.set_attr("TotalNumberOfGrids", AttrValue::I64(levels.len() as i64));
        for level in 0..=self.grids.iter().map(|grid| grid.level).max().unwrap() {
            let mut group = file.create_group(&format!("Level{level}"));
            for (id, grid) in (1..).zip(&self.grids).filter(|(_, grid)| grid.level == level) {
                let mut one = group.create_group(&format!("Grid{id:08}"));
                one.set_attr("GridRank", AttrValue::I64(3));
                one.set_attr("BaryonFileName", AttrValue::AsciiString("./run/DD1.cpu0000".into()));
                let end = grid.size.map(|n| i64::from(n) + 2);
                one.create_dataset("GridStartIndex").with_i64_data(&[3, 3, 3]);
                one.create_dataset("GridEndIndex").with_i64_data(&end);
                let edges = [grid.left, grid.right];
                for (side, name) in ["GridLeftEdge", "GridRightEdge"].into_iter().enumerate() {
                    let dataset = one.create_dataset(name);
                    match self.long_edges.get(id - 1) {
                        Some(edges) => {
                            let bytes = quadruple_bits(edges[side]).to_le_bytes().repeat(3);
                            dataset.with_raw_data(quadruple(), bytes, 3)
                        }
                        None => dataset.with_f64_data(&edges[side]),
                    };
                }
                let particles = 2 * i64::from(self.with_particles.contains(&id));
                one.create_dataset("NumberOfParticles").with_i64_data(&[particles]);
                group.add_group(one.finish());
            }
            file.add_group(group.finish());
        }
        file.finish().unwrap()
    }

    pub(super) fn write_tables(&self) {
        std::fs::write(self.path().with_extension("hierarchy.hdf5"), self.tables()).unwrap();
    }

    pub(super) fn write(&self) {
        self.write_text(&self.text());
        self.write_data();
    }

    /// Every grid with all its densities.
    pub(super) fn read(&self) -> Result<Vec<(GridRecord, Vec<f64>)>> {
        let source = crate::source::open(&self.path(), Some("enzo"))?;
        let density = source.hierarchy().density.unwrap_or(0);
        read_all(&*source, density)
    }

    pub(super) fn error(&self) -> String {
        self.read().unwrap_err().to_string()
    }
}

/// A whole number as IEEE's float of 128 bits.
fn quadruple_bits(number: i128) -> u128 {
    let sign = u128::from(number < 0) << 127;
    let magnitude = number.unsigned_abs();
    let Some(power) = magnitude.checked_ilog2() else { return sign };
    let fraction = (magnitude ^ 1 << power) << (112 - power);
    sign | u128::from(power + 16383) << 112 | fraction
}
