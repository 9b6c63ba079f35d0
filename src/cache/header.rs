//! The cache's header: everything that is read at open.

use super::brick::BrickShape;
use super::bytes::{ByteReader, ByteWriter};
use super::checksum::checksum;
use super::index::PAGE_BYTES;
use crate::space::{Domain, MAX_OCTREE_LEVEL};

/// First bytes of every cache: the high bit and the line ends show transfers in text mode.
pub(super) const MAGIC: [u8; 8] = *b"\x89DFC\r\n\x1a\n";
/// Version of the layout.
pub(super) const VERSION: u32 = 8;
/// Bytes before the header's variable part: magic, version, length of the whole header, checksum.
pub(super) const PREFIX_BYTES: usize = 24;
/// Longest header.
pub(super) const MAX_HEADER_BYTES: u32 = 16 << 20;
/// Most fields of a cache: the records of a brick fit into one page of the index.
pub const MAX_FIELDS: usize = 512;
/// Largest power of two that scales a field; more is never needed to bring f64 into f32's range.
const MAX_EXPONENT: u32 = 1000;
/// Most averaged levels above the root grid: what 2²⁴ root cells and 8³ bricks need.
const MAX_UPPER_LEVELS: usize = 21;

/// One level of the octree of bricks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TreeLevel {
    /// Octree level: factor-2 steps below the root grid; negative for the averaged levels above
    /// it.
    pub octree: i32,
    /// The simulation's level number; none above the root grid and for the halves of factor-4
    /// steps.
    pub simulation: Option<u32>,
    /// Index of the level's first node.
    pub first_node: u64,
    /// Number of the level's nodes (bricks), in Morton order.
    pub nodes: u64,
    /// The source's grids at this level; 0 where it is no level of the simulation.
    pub grids: u64,
    /// Cells at which the level has data, refined or not.
    pub cells: u64,
    /// Cells of the simulation's own level that no finer level covers.
    pub leaf_cells: u64,
}

/// One field of the cache. Extrema and sums run over leaf cells that are neither dropped nor
/// NaN, in code units, from the source's values before they are stored as f32.
#[derive(Debug, Clone, PartialEq)]
pub struct CachedField {
    /// The source's name.
    pub name: String,
    /// The source's name of the unit.
    pub units: Option<String>,
    /// Factor from code units to cgs.
    pub to_cgs: Option<f64>,
    /// A field value is `stored · 2^exponent`.
    pub exponent: i32,
    /// Smallest leaf value.
    pub min: f64,
    /// Largest leaf value.
    pub max: f64,
    /// Smallest leaf value above zero, if there is one.
    pub smallest_positive: Option<f64>,
    /// Σ value · volume (code length³), from the source's values.
    pub sum: f64,
    /// The same from the values as stored.
    pub stored_sum: f64,
    /// Leaf cells that are NaN.
    pub nan_cells: u64,
    /// Leaf cells dropped.
    pub dropped_cells: u64,
    /// Volume of the dropped leaf cells, code length³.
    pub dropped_volume: f64,
    /// Σ value · volume of the dropped leaf cells.
    pub dropped_sum: f64,
    /// Largest relative error of a stored value, against the source's or their exact average.
    pub relative_error: f64,
    /// The same of leaf cells alone; 0: they are lossless.
    pub leaf_error: f64,
}

impl CachedField {
    /// The field value of a stored value.
    pub fn value(&self, stored: f32) -> f64 {
        f64::from(stored) * f64::from(self.exponent).exp2()
    }

    /// The smallest magnitude that is stored with all digits: smaller ones may be off by 2⁻²⁴ of it, and
    /// so be 0.
    pub fn least_exact(&self) -> f64 {
        f64::from(f32::MIN_POSITIVE) * f64::from(self.exponent).exp2()
    }
}

/// What a cache holds.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    /// Length of the whole file, bytes.
    pub file_bytes: u64,
    /// Name of the format that the source had.
    pub source_format: String,
    /// Code time of the source.
    pub time: Option<f64>,
    /// The simulated box and root grid.
    pub domain: Domain,
    /// Size of the bricks.
    pub shape: BrickShape,
    /// The tree's levels: the root's first (one node), then finer ones, each a factor of 2.
    pub levels: Vec<TreeLevel>,
    /// The fields.
    pub fields: Vec<CachedField>,
    /// Most ancestors' blocks in any payload.
    pub max_parent_blocks: u8,
    /// Where the index begins, a multiple of 64 KiB; payloads end before it.
    pub index_offset: u64,
    /// Number of 64 KiB pages of the index.
    pub index_pages: u64,
    /// Checksum of the table of page checksums.
    pub page_table_checksum: u64,
    /// The header's own checksum, which covers the index and, through it, the payloads: names
    /// the cache's content.
    pub checksum: u64,
}

impl Header {
    /// Number of bricks.
    pub fn nodes(&self) -> u64 {
        self.levels.iter().map(|level| level.nodes).sum()
    }

    /// Position in `levels` of the level of brick `node`.
    pub fn level_of(&self, node: u64) -> usize {
        self.levels.partition_point(|level| level.first_node <= node).saturating_sub(1)
    }

    /// The field of that name, without regard to case.
    pub fn field(&self, name: &str) -> Option<usize> {
        crate::spelling::position(name, self.fields.iter().map(|field| field.name.as_str()))
    }

    /// [`Self::field`], or which fields there are, the nearest to `name` first.
    pub(crate) fn find_field(&self, name: &str) -> Result<usize, String> {
        self.field(name).ok_or_else(|| {
            let names = self.fields.iter().map(|field| field.name.as_str());
            let known = crate::spelling::nearest_first(name, names).join(", ");
            format!("holds no field `{}`: it has {known}", name.escape_debug())
        })
    }
}

impl Header {
    /// The header's bytes, its own checksum and length filled in.
    pub(super) fn to_bytes(&self) -> Vec<u8> {
        let mut body = ByteWriter::default();
        self.write_body(&mut body);
        let mut bytes = ByteWriter::default();
        bytes.bytes.extend_from_slice(&MAGIC);
        bytes.u32(VERSION);
        bytes.u32(u32::try_from(PREFIX_BYTES + body.bytes.len()).unwrap_or(u32::MAX));
        bytes.u64(checksum(&body.bytes));
        bytes.bytes.extend_from_slice(&body.bytes);
        bytes.bytes
    }

    fn write_body(&self, bytes: &mut ByteWriter) {
        bytes.u64(self.file_bytes);
        bytes.u64(self.index_offset);
        bytes.u64(self.index_pages);
        bytes.u64(self.page_table_checksum);
        for edge in self.domain.left().into_iter().chain(self.domain.right()) {
            bytes.f64(edge);
        }
        for cells in self.domain.root_cells() {
            bytes.u64(cells);
        }
        bytes.optional(self.time);
        bytes.u32(u32::try_from(self.shape.edge()).unwrap_or(0));
        bytes.u32(u32::from(self.max_parent_blocks));
        bytes.text(&self.source_format);
        bytes.u32(u32::try_from(self.levels.len()).unwrap_or(0));
        self.levels.iter().for_each(|level| level.write(bytes));
        bytes.u32(u32::try_from(self.fields.len()).unwrap_or(0));
        self.fields.iter().for_each(|field| field.write(bytes));
    }

    /// Reads the part after the prefix, whose checksum is `checksum`; the reason where it
    /// contradicts itself.
    pub(super) fn from_body(body: &[u8], checksum: u64) -> Result<Self, String> {
        let mut bytes = ByteReader::new(body);
        let header = Self::read_body(&mut bytes, checksum).ok_or("its header ends too early")??;
        if !bytes.is_empty() {
            return Err("its header is longer than its content".into());
        }
        header.check()?;
        Ok(header)
    }

    fn read_body(bytes: &mut ByteReader<'_>, checksum: u64) -> Option<Result<Self, String>> {
        let [file_bytes, index_offset, index_pages, page_table_checksum] =
            [bytes.u64()?, bytes.u64()?, bytes.u64()?, bytes.u64()?];
        let left = [bytes.f64()?, bytes.f64()?, bytes.f64()?];
        let right = [bytes.f64()?, bytes.f64()?, bytes.f64()?];
        let root_cells = [bytes.u64()?, bytes.u64()?, bytes.u64()?];
        let time = bytes.optional()?;
        let (edge, max_parent_blocks) = (bytes.u32()?, bytes.u32()?);
        let source_format = bytes.text()?;
        let mut levels = Vec::new();
        for _ in 0..bytes.u32()? {
            levels.push(TreeLevel::read(bytes)?);
        }
        let mut fields = Vec::new();
        for _ in 0..bytes.u32()? {
            fields.push(CachedField::read(bytes)?);
        }
        let build = || {
            Ok(Self {
                file_bytes,
                source_format,
                time,
                domain: Domain::new(left, right, root_cells).map_err(|e| e.to_string())?,
                shape: BrickShape::new(edge).map_err(|e| e.to_string())?,
                levels,
                fields,
                max_parent_blocks: u8::try_from(max_parent_blocks)
                    .map_err(|_| "too many ancestors' blocks")?,
                index_offset,
                index_pages,
                page_table_checksum,
                checksum,
            })
        };
        Some(build())
    }

    /// Whether the parts agree with each other.
    fn check(&self) -> Result<(), String> {
        self.check_levels()?;
        if self.fields.is_empty() || self.fields.len() > MAX_FIELDS {
            let fields = self.fields.len();
            return Err(format!("it has {fields} fields, 1 to {MAX_FIELDS} are supported"));
        }
        if self.fields.iter().any(|field| field.exponent.unsigned_abs() > MAX_EXPONENT) {
            return Err("a field's scale is out of range".into());
        }
        let is_factor = |factor: Option<f64>| factor.is_none_or(|f| f > 0.0 && f.is_finite());
        if !self.fields.iter().all(|f| is_factor(f.smallest_positive) && is_factor(f.to_cgs)) {
            return Err("a field's smallest positive value or factor to cgs is not positive".into());
        }
        let is_error = |error: f64| (0.0..=1.0).contains(&error);
        if !self.fields.iter().all(|f| is_error(f.relative_error) && is_error(f.leaf_error)) {
            return Err("a field's relative error is not between 0 and 1".into());
        }
        let table = self.index_pages.checked_mul(8);
        let index = self.index_pages.checked_mul(PAGE_BYTES as u64);
        let end = index
            .and_then(|bytes| bytes.checked_add(self.index_offset))
            .and_then(|at| at.checked_add(table?));
        if end != Some(self.file_bytes) || !self.index_offset.is_multiple_of(PAGE_BYTES as u64) {
            return Err("its index does not lie where the file ends".into());
        }
        let per_page = super::index::records_per_page(self.fields.len()) as u64;
        if self.nodes().div_ceil(per_page) != self.index_pages {
            return Err("its index is not as long as its bricks need".into());
        }
        Ok(())
    }

    fn check_levels(&self) -> Result<(), String> {
        let refined = usize::try_from(MAX_OCTREE_LEVEL).unwrap_or(0);
        if self.levels.is_empty() || self.levels.len() > MAX_UPPER_LEVELS + refined + 1 {
            return Err(format!("it has {} levels of bricks", self.levels.len()));
        }
        let mut next_node = 0u64;
        for (depth, level) in self.levels.iter().enumerate() {
            let octree = i64::from(self.levels[0].octree) + depth as i64;
            if i64::from(level.octree) != octree || level.first_node != next_node {
                return Err(format!("its level {depth} of bricks does not follow the one before"));
            }
            let most = if depth == 0 { 1 } else { self.levels[depth - 1].nodes.saturating_mul(8) };
            if level.nodes == 0 || level.nodes > most {
                return Err(format!("its level {depth} of bricks has {} bricks", level.nodes));
            }
            next_node = next_node.checked_add(level.nodes).ok_or("it has too many bricks")?;
        }
        let deepest = self.levels[self.levels.len() - 1].octree;
        if i64::from(deepest) > i64::from(MAX_OCTREE_LEVEL) {
            return Err(format!(
                "its bricks lie at level {deepest}, {MAX_OCTREE_LEVEL} at most do"
            ));
        }
        self.check_root()?;
        self.check_simulation()
    }

    /// Levels of the simulation begin at the root grid and follow each other in one or two steps;
    /// all others own nothing. No level has more cells than its bricks.
    fn check_simulation(&self) -> Result<(), String> {
        let (mut next, mut halves) = (0, 0);
        for (depth, level) in self.levels.iter().enumerate() {
            let refuse = |what: &str| Err(format!("its level {depth} of bricks {what}"));
            let cells = level.nodes.saturating_mul(self.shape.cells() as u64);
            if level.cells > cells || level.leaf_cells > level.cells || level.grids > level.cells {
                return refuse("has more cells than its bricks hold");
            }
            match level.simulation {
                Some(simulation) if level.octree >= 0 && simulation == next => {
                    (next, halves) = (next + 1, 0);
                }
                None if level.octree < 0 || (level.octree > 0 && halves == 0) => {
                    halves += u32::from(level.octree > 0);
                    if level.leaf_cells > 0 || level.grids > 0 {
                        return refuse("is no level of the simulation but owns cells");
                    }
                }
                _ => return refuse("is not the simulation's level that is due there"),
            }
        }
        if halves == 0 { Ok(()) } else { Err("its finest bricks are no simulation level's".into()) }
    }

    /// The root brick must cover the domain, and no more than that needs.
    fn check_root(&self) -> Result<(), String> {
        let upper = -i64::from(self.levels[0].octree);
        let covers = |levels: i64| {
            let cells = (self.shape.edge() as u64) << levels;
            self.domain.root_cells().into_iter().all(|n| n <= cells)
        };
        let fits = (0..=MAX_UPPER_LEVELS as i64).contains(&upper) && covers(upper);
        if !fits || (upper > 0 && covers(upper - 1)) {
            return Err("its root brick is not the smallest that covers the domain".into());
        }
        if self.levels.len() as i64 <= upper {
            return Err("its root grid has no bricks".into());
        }
        Ok(())
    }
}

impl TreeLevel {
    fn write(&self, bytes: &mut ByteWriter) {
        bytes.i32(self.octree);
        bytes.i32(self.simulation.map_or(-1, |level| i32::try_from(level).unwrap_or(-1)));
        for number in [self.first_node, self.nodes, self.grids, self.cells, self.leaf_cells] {
            bytes.u64(number);
        }
    }

    fn read(bytes: &mut ByteReader<'_>) -> Option<Self> {
        Some(Self {
            octree: bytes.i32()?,
            simulation: match bytes.i32()? {
                -1 => None,
                level => Some(u32::try_from(level).ok()?),
            },
            first_node: bytes.u64()?,
            nodes: bytes.u64()?,
            grids: bytes.u64()?,
            cells: bytes.u64()?,
            leaf_cells: bytes.u64()?,
        })
    }
}

impl CachedField {
    fn write(&self, bytes: &mut ByteWriter) {
        bytes.text(&self.name);
        bytes.text(self.units.as_deref().unwrap_or(""));
        bytes.optional(self.to_cgs);
        bytes.i32(self.exponent);
        bytes.f64(self.min);
        bytes.f64(self.max);
        bytes.optional(self.smallest_positive);
        bytes.f64(self.sum);
        bytes.f64(self.stored_sum);
        bytes.u64(self.nan_cells);
        bytes.u64(self.dropped_cells);
        bytes.f64(self.dropped_volume);
        bytes.f64(self.dropped_sum);
        bytes.f64(self.relative_error);
        bytes.f64(self.leaf_error);
    }

    fn read(bytes: &mut ByteReader<'_>) -> Option<Self> {
        Some(Self {
            name: bytes.text()?,
            units: bytes.text().map(|text| (!text.is_empty()).then_some(text))?,
            to_cgs: bytes.optional()?,
            exponent: bytes.i32()?,
            min: bytes.f64()?,
            max: bytes.f64()?,
            smallest_positive: bytes.optional()?,
            sum: bytes.f64()?,
            stored_sum: bytes.f64()?,
            nan_cells: bytes.u64()?,
            dropped_cells: bytes.u64()?,
            dropped_volume: bytes.f64()?,
            dropped_sum: bytes.f64()?,
            relative_error: bytes.f64()?,
            leaf_error: bytes.f64()?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::VERSION;

    #[test]
    fn the_format_s_description_is_of_this_version() {
        let page = include_str!("../../docs/FORMAT.md");
        for said in [format!("Version {VERSION}. "), format!("| 8 | u32 | version, {VERSION} |")] {
            assert!(page.contains(&said), "docs/FORMAT.md does not say `{said}`");
        }
    }
}
