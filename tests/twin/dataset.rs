//! All cells of an output in memory: one table per factor-2 level.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use deepfield::source::{GridBlock, GridRecord, Source};
use num_bigint::BigInt;
use num_traits::One;

use super::Result;
use super::double_double::DoubleDouble;
use super::exact::{self, Rational};

/// What a cell holds: the leaf's value, or the mean of what lies beneath.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Cell {
    pub(crate) value: f64,
    pub(crate) refined: bool,
}

/// Mixes the three words of a cell index; the standard hasher takes most of a picture's time.
#[derive(Default)]
pub(crate) struct IndexHasher(u64);

impl Hasher for IndexHasher {
    fn finish(&self) -> u64 {
        self.0 ^ (self.0 >> 29)
    }
    fn write(&mut self, bytes: &[u8]) {
        for chunk in bytes.chunks(8) {
            let mut word = [0; 8];
            word[..chunk.len()].copy_from_slice(chunk);
            self.write_u64(u64::from_le_bytes(word));
        }
    }
    fn write_u64(&mut self, word: u64) {
        self.0 = (self.0.rotate_left(23) ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    }
}

pub(crate) type IndexMap<K, V> = HashMap<K, V, BuildHasherDefault<IndexHasher>>;
type CellTable = IndexMap<[i64; 3], Cell>;

/// Whether leaf values stay as the source has them or are rounded as the program stores them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Precision {
    Source,
    Single,
}

/// One field of an output. Levels here are factor-2 steps below the root grid: a refinement by 4
/// makes two, the first of which holds only means.
pub(crate) struct Dataset {
    left: [Rational; 3],
    cell_width: [Rational; 3],
    root_cells: [i64; 3],
    tables: Vec<CellTable>,
    /// Extrema over leaf cells, and the smallest positive leaf value.
    pub(crate) minimum: f64,
    pub(crate) maximum: f64,
    pub(crate) smallest_positive: f64,
}

impl Dataset {
    /// Reads `field` (matched without regard to case) of every grid of `source`.
    pub(crate) fn load(source: &dyn Source, field: &str, precision: Precision) -> Result<Self> {
        let hierarchy = source.hierarchy();
        let field = hierarchy
            .fields
            .iter()
            .position(|f| f.name.eq_ignore_ascii_case(field))
            .ok_or_else(|| format!("no field `{field}`"))?;
        let mut tables = read_leaves(source, field)?;
        average_upward(&mut tables)?;
        if precision == Precision::Single {
            let cells = tables.iter_mut().flat_map(CellTable::values_mut);
            cells.for_each(|cell| cell.value = f64::from(cell.value as f32));
        }
        let domain = &hierarchy.domain;
        let (left, right) = (domain.left().map(exact::from_double), domain.right());
        let root = domain.root_cells();
        let cell_width = std::array::from_fn(|a| {
            (exact::from_double(right[a]) - &left[a]) / BigInt::from(root[a])
        });
        let root_cells = root.map(|n| n as i64);
        let mut dataset = Self {
            left,
            cell_width,
            root_cells,
            tables,
            minimum: f64::INFINITY,
            maximum: f64::NEG_INFINITY,
            smallest_positive: f64::INFINITY,
        };
        dataset.find_extrema()?;
        Ok(dataset)
    }

    fn find_extrema(&mut self) -> Result<()> {
        let cells: i64 = self.root_cells.iter().product();
        if self.tables[0].len() as i64 != cells {
            return Err(format!("{} of {cells} root cells hold data", self.tables[0].len()));
        }
        for value in
            self.tables.iter().flat_map(|t| t.values()).filter(|c| !c.refined).map(|c| c.value)
        {
            self.minimum = self.minimum.min(value);
            self.maximum = self.maximum.max(value);
            if value > 0.0 {
                self.smallest_positive = self.smallest_positive.min(value);
            }
        }
        Ok(())
    }

    /// What cell `index` of `level` holds; none where no data of this level or a finer one lie.
    pub(crate) fn cell(&self, level: usize, index: [i64; 3]) -> Option<Cell> {
        self.tables.get(level)?.get(&index).copied()
    }

    /// Cells of the root grid.
    pub(crate) fn root_cells(&self) -> [i64; 3] {
        self.root_cells
    }

    /// Number of cells along each axis that the whole domain would have at `level`.
    pub(crate) fn cells_across(&self, level: usize) -> [i64; 3] {
        self.root_cells.map(|n| n << level)
    }

    /// The deepest level.
    pub(crate) fn deepest(&self) -> usize {
        self.tables.len() - 1
    }

    /// Width of a root cell along each axis, code length.
    pub(crate) fn root_cell_width(&self) -> [DoubleDouble; 3] {
        std::array::from_fn(|a| exact::to_double_double(&self.cell_width[a]))
    }

    /// A position in code length as distances from the left edge in root cells, floored to
    /// 2⁻⁹⁶: what lies just below a face stays below.
    pub(crate) fn in_root_cells(&self, position: &[Rational; 3]) -> [DoubleDouble; 3] {
        let unit = Rational::from(BigInt::one() << 96);
        std::array::from_fn(|a| {
            let cells: Rational = (&position[a] - &self.left[a]) / &self.cell_width[a];
            let units = (cells * &unit).floor();
            exact::to_double_double(&(units / &unit))
        })
    }

    /// A point of cell `index` of `level` (`offset` in cells from its lower corner), code length.
    pub(crate) fn point(&self, level: usize, index: [i64; 3], offset: [f64; 3]) -> [Rational; 3] {
        std::array::from_fn(|a| {
            let cells = Rational::from(BigInt::from(index[a])) + exact::from_double(offset[a]);
            &self.left[a] + &self.cell_width[a] * cells / (BigInt::one() << level)
        })
    }

    /// The leaf cells of `level` in ascending order of their index.
    pub(crate) fn leaves(&self, level: usize) -> Vec<([i64; 3], f64)> {
        let cells = self.tables[level].iter().filter(|(_, cell)| !cell.refined);
        let mut leaves: Vec<_> = cells.map(|(&index, cell)| (index, cell.value)).collect();
        leaves.sort_by_key(|(index, _)| *index);
        leaves
    }

    /// Level and index of the leaf cell with the largest value (the first of equals).
    pub(crate) fn densest(&self) -> (usize, [i64; 3]) {
        let all = (0..self.tables.len()).rev();
        let found = all.flat_map(|level| self.leaves(level).into_iter().map(move |c| (level, c)));
        let best = found.fold((0, ([0; 3], f64::NEG_INFINITY)), |best, next| {
            if next.1.1 > best.1.1 { next } else { best }
        });
        (best.0, best.1.0)
    }
}

/// Every grid's cells, as if they were all leaves.
fn read_leaves(source: &dyn Source, field: usize) -> Result<Vec<CellTable>> {
    let mut tables = Vec::new();
    let mut grids = Vec::new();
    source
        .for_each_grid(&mut |grid| {
            grids.push(grid);
            Ok(())
        })
        .map_err(|error| error.to_string())?;
    for grid in grids {
        let octree = source.hierarchy().levels.octree(grid.level as usize);
        let level = octree.ok_or_else(|| format!("grid {}: level {}", grid.id, grid.level))?;
        tables.resize_with(tables.len().max(level as usize + 1), CellTable::default);
        read_grid(source, field, &grid, &mut tables[level as usize])?;
    }
    if tables.is_empty() { Err("no grid".into()) } else { Ok(tables) }
}

fn read_grid(
    source: &dyn Source,
    field: usize,
    grid: &GridRecord,
    table: &mut CellTable,
) -> Result<()> {
    let block = GridBlock { lo: [0; 3], size: grid.size };
    let mut values = vec![0.0; block.len()];
    source.read(grid, field, block, &mut values).map_err(|error| error.to_string())?;
    let lo = grid.lo.map(|i| i as i64);
    let [nx, ny, _] = grid.size.map(|n| n as usize);
    for (at, value) in values.into_iter().enumerate() {
        let offset = [at % nx, at / nx % ny, at / nx / ny];
        let index = std::array::from_fn(|a| lo[a] + offset[a] as i64);
        if table.insert(index, Cell { value, refined: false }).is_some() {
            return Err(format!("grid {} overlaps another one of its level", grid.id));
        }
    }
    Ok(())
}

/// Replaces what finer levels cover by the mean of the eight cells beneath, bottom up.
fn average_upward(tables: &mut [CellTable]) -> Result<()> {
    for level in (1..tables.len()).rev() {
        let (coarse, fine) = tables.split_at_mut(level);
        let fine = &fine[0];
        for index in fine.keys().map(|index| index.map(|i| i >> 1)) {
            let table = &mut coarse[level - 1];
            if table.get(&index).is_some_and(|cell| cell.refined) {
                continue;
            }
            let mut sum = 0.0;
            for child in children(index) {
                let cell = fine.get(&child);
                sum += cell.ok_or_else(|| format!("level {level}: {child:?} is missing"))?.value;
            }
            table.insert(index, Cell { value: sum / 8.0, refined: true });
        }
    }
    Ok(())
}

/// The eight cells of the next level that a cell covers.
pub(crate) fn children(index: [i64; 3]) -> impl Iterator<Item = [i64; 3]> {
    (0..8).map(move |n| [0, 1, 2].map(|a| 2 * index[a] + (n >> a & 1)))
}
