//! Small plotfiles, made up for tests.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use crate::Result;
use crate::source::raw::Number;
use crate::source::{GridRecord, read_all};

/// A plotfile in the making: root 4 × 6 × 8 in [−1, 1] × [0, 3] × [0, 2], refined by 2, then by 4.
/// Indices begin at (2, −3, 1) on the root level.
#[derive(Clone)]
pub(super) struct Made {
    /// Version of `Cell_H`.
    pub(super) version: u32,
    /// How numbers are stored.
    pub(super) number: Number,
    /// Ghost cells around every grid.
    pub(super) ghosts: i64,
    /// By level, first and last index of each grid, as if indices began at 0.
    pub(super) grids: [Vec<[[i64; 3]; 2]>; 3],
}

/// Refinement ratios.
const RATIOS: [i64; 2] = [2, 4];
const FIRST: [i64; 3] = [2, -3, 1];
const ROOT: [i64; 3] = [4, 6, 8];

impl Made {
    /// Two grids on each level but the last, which has one.
    pub(super) fn new() -> Self {
        Self {
            version: 1,
            number: Number::F64Little,
            ghosts: 0,
            grids: [
                vec![[[0, 0, 0], [1, 5, 7]], [[2, 0, 0], [3, 5, 7]]],
                vec![[[2, 2, 2], [5, 3, 5]], [[2, 4, 2], [3, 7, 3]]],
                vec![[[12, 8, 8], [19, 15, 11]]],
            ],
        }
    }

    fn scale(level: usize) -> i64 {
        RATIOS[..level].iter().product()
    }

    fn printed(level: usize, lo: [i64; 3], hi: [i64; 3]) -> String {
        let shift = |i: [i64; 3]| {
            let [x, y, z]: [i64; 3] = std::array::from_fn(|a| i[a] + FIRST[a] * Self::scale(level));
            format!("({x},{y},{z})")
        };
        format!("({} {} (0,0,0))", shift(lo), shift(hi))
    }

    /// The value of component `component` in cell `index` of level `level`.
    pub(super) fn value(level: usize, component: i64, index: [i64; 3]) -> f64 {
        let place = (index[2] * 100 + index[1]) * 100 + index[0];
        (place * 10 + component * 4 + level as i64) as f64 / 8.0
    }

    /// The `Header`.
    pub(super) fn header(&self) -> String {
        let mut text =
            "HyperCLaw-V1.1\n2\nAx\ndensity\n3\n1.5\n2\n-1 0 0 \n1 3 2 \n2 4 \n".to_owned();
        for level in 0..3 {
            let last = ROOT.map(|n| n * Self::scale(level) - 1);
            write!(text, "{} ", Self::printed(level, [0; 3], last)).unwrap();
        }
        text.push_str("\n7 14 56 \n0.5 0.5 0.25 \n0.25 0.25 0.125 \n.0625 .0625 .03125 \n0\n0\n");
        for (level, grids) in self.grids.iter().enumerate() {
            writeln!(text, "{level} {} 1.5\n7", grids.len()).unwrap();
            text.push_str(&"0 1\n".repeat(3 * grids.len()));
            writeln!(text, "Level_{level}/Cell").unwrap();
        }
        text
    }

    fn description(&self) -> String {
        let (float, double) = ("32 8 23 0 1 9 0 127", "64 11 52 0 1 12 0 1023");
        match self.number {
            Number::F32Little => format!("((8, ({float})),(4, (4 3 2 1)))"),
            Number::F32Big => format!("((8, ({float})),(4, (1 2 3 4)))"),
            Number::F64Little => format!("((8, ({double})),(8, (8 7 6 5 4 3 2 1)))"),
            Number::F64Big => format!("((8, ({double})),(8, (1 2 3 4 5 6 7 8)))"),
        }
    }

    fn encode(&self, value: f64) -> Vec<u8> {
        match self.number {
            Number::F32Little => (value as f32).to_le_bytes().to_vec(),
            Number::F32Big => (value as f32).to_be_bytes().to_vec(),
            Number::F64Little => value.to_le_bytes().to_vec(),
            Number::F64Big => value.to_be_bytes().to_vec(),
        }
    }

    /// `Cell_H` and `Cell_D_00000` of a level.
    pub(super) fn level(&self, level: usize) -> (String, Vec<u8>) {
        let grids = &self.grids[level];
        let ghosts = self.ghosts;
        let mut text = format!("{}\n1\n2\n{ghosts}\n({} 0\n", self.version, grids.len());
        let (mut places, mut data) = (String::new(), Vec::new());
        for &[lo, hi] in grids {
            writeln!(text, "{}", Self::printed(level, lo, hi)).unwrap();
            writeln!(places, "FabOnDisk: Cell_D_00000 {}", data.len()).unwrap();
            let (lo, hi) = (lo.map(|i| i - ghosts), hi.map(|i| i + ghosts));
            if self.version == 1 {
                let cells = Self::printed(level, lo, hi);
                data.extend(format!("FAB {}{cells} 2\n", self.description()).into_bytes());
            }
            for component in 0..2 {
                for (z, y) in (lo[2]..=hi[2]).flat_map(|z| (lo[1]..=hi[1]).map(move |y| (z, y))) {
                    for x in lo[0]..=hi[0] {
                        data.extend(self.encode(Self::value(level, component, [x, y, z])));
                    }
                }
            }
        }
        let count = grids.len();
        write!(text, ")\n{count}\n{places}\n{count},2\n{}\n", "1e0,2e0,\n".repeat(count)).unwrap();
        if self.version > 1 {
            writeln!(text, "{}", self.description()).unwrap();
        }
        (text, data)
    }

    /// Writes the plotfile as `plt` in `folder`; its path.
    pub(super) fn write(&self, folder: &Path) -> PathBuf {
        let plotfile = folder.join("plt");
        for level in 0..3 {
            let folder = plotfile.join(format!("Level_{level}"));
            std::fs::create_dir_all(&folder).unwrap();
            let (text, data) = self.level(level);
            std::fs::write(folder.join("Cell_H"), text).unwrap();
            std::fs::write(folder.join("Cell_D_00000"), data).unwrap();
        }
        std::fs::write(plotfile.join("Header"), self.header()).unwrap();
        plotfile
    }
}

/// Every grid of the plotfile at `path` with all values of field `field`.
pub(super) fn read(path: &Path, field: usize) -> Result<Vec<(GridRecord, Vec<f64>)>> {
    let source = crate::source::open(path, Some("amrex"))?;
    read_all(&*source, field)
}
