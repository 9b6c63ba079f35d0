//! The index' fixed-size records: one [`NodeRecord`] per brick, and per field one
//! [`FieldRecord`].

use super::bytes::{ByteReader, ByteWriter};
use super::codec::decompressed;
use super::digits::{PARTS, Precision};

/// What the index says of a brick and what lies beneath it, whatever the field.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct NodeRecord {
    /// Index of the first child; children of a node lie one after another, in the order of the
    /// set bits of `child_mask`. 0 without children.
    pub first_child: u64,
    /// Index of the parent; 0 for the root.
    pub parent: u64,
    /// Number of bricks beneath this one.
    pub descendants: u64,
    /// Cells of the simulation's own level that no finer level covers.
    pub leaf_cells: u32,
    /// Cells at which the level has data, refined further or not.
    pub existing_cells: u32,
    /// Existing cells that are refined further.
    pub refined_cells: u32,
    /// Which octants have a child: bit `x + 2y + 4z`.
    pub child_mask: u8,
    /// Number of levels beneath.
    pub depth: u8,
    /// The brick's own octant in its parent, `x + 2y + 4z`; 0 for the root.
    pub octant: u8,
}

impl NodeRecord {
    /// Bytes on disk.
    pub const BYTES: usize = 40;

    /// Index of the child in octant `octant` (`x + 2y + 4z`), if there is one.
    pub fn child(&self, octant: u8) -> Option<u64> {
        let bit = 1u8 << octant;
        (self.child_mask & bit != 0)
            .then(|| self.first_child + u64::from((self.child_mask & (bit - 1)).count_ones()))
    }

    /// Appends the record, [`Self::BYTES`] bytes.
    pub(crate) fn write(&self, bytes: &mut ByteWriter) {
        bytes.u64(self.first_child);
        bytes.u64(self.parent);
        bytes.u64(self.descendants);
        bytes.u32(self.leaf_cells);
        bytes.u32(self.existing_cells);
        bytes.u32(self.refined_cells);
        bytes.u8(self.child_mask);
        bytes.u8(self.depth);
        bytes.u8(self.octant);
        bytes.u8(0);
    }

    /// Reads what [`Self::write`] has written; `None` where bytes are missing, the padding is not 0
    /// or the octant is none.
    pub(crate) fn read(bytes: &mut ByteReader<'_>) -> Option<Self> {
        let record = Self {
            first_child: bytes.u64()?,
            parent: bytes.u64()?,
            descendants: bytes.u64()?,
            leaf_cells: bytes.u32()?,
            existing_cells: bytes.u32()?,
            refined_cells: bytes.u32()?,
            child_mask: bytes.u8()?,
            depth: bytes.u8()?,
            octant: bytes.u8()?,
        };
        (bytes.u8()? == 0 && record.octant < 8).then_some(record)
    }
}

/// What the index says of one field in a brick. Ranges are of values as stored: the field's value is
/// `stored · 2^exponent` with the exponent of [`super::CachedField`].
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct FieldRecord {
    /// Where each part of the payload lies in the file; 0 for empty ones.
    pub offsets: [u64; PARTS],
    /// Checksums of the stored bytes of the payload's parts, and of the brick's and the field's
    /// number; 0 for empty ones.
    pub checksums: [u64; PARTS],
    /// Stored (compressed) bytes of each part; 0 where there is none ([`Self::is_void`]).
    pub lengths: [u32; PARTS],
    /// [min, max] over everything in the payload: encloses what the interpolant takes in the
    /// brick's box when the brick itself is drawn. NaN cells are not in it.
    pub own: [f32; 2],
    /// [min, max] that encloses what the interpolant takes in the box at any level from this
    /// one down. NaN cells are not in it.
    pub tree: [f32; 2],
    /// Bound of |own interpolant − finest interpolant| in the box, of values as stored.
    pub residual_linear: f32,
    /// Bound of |own interpolant − finest interpolant| in the box where log10 of the field's value
    /// is interpolated (floored at the smallest positive leaf value, as scenes floor it).
    pub residual_log10: f32,
    /// Bounds of the relative difference of any value from the stored one (1: none) in each of
    /// [`Precision::FEWER`].
    pub errors: [f32; PARTS - 1],
    /// [`Self::VOID`] | [`Self::NAN_OWN`] | [`Self::NAN_TREE`] | [`Self::FILLS_VOID`].
    pub flags: u8,
    /// Number of ancestors' blocks in the payload.
    pub parent_blocks: u8,
}

impl FieldRecord {
    /// Bytes on disk.
    pub const BYTES: usize = 120;
    /// Nothing in the box, at any level, emits or absorbs: all was dropped, or lies outside.
    pub const VOID: u8 = 1;
    /// The payload holds NaN.
    pub const NAN_OWN: u8 = 2;
    /// The payload or one beneath holds NaN.
    pub const NAN_TREE: u8 = 4;
    /// A void cell beneath lies in a cell of the brick's own that is not void.
    pub const FILLS_VOID: u8 = 8;

    /// Whether there is nothing to draw in the box at any level, and no payload.
    pub fn is_void(&self) -> bool {
        self.flags & Self::VOID != 0
    }

    /// Whether the brick, drawn in place of those beneath, shows something where there is nothing.
    pub fn fills_void(&self) -> bool {
        self.flags & Self::FILLS_VOID != 0
    }

    /// Whether no payload is named, and nothing that one would hold.
    fn is_of_nothing(&self) -> bool {
        let place = (self.offsets, self.checksums, self.lengths, self.parent_blocks);
        !self.fills_void()
            && place == ([0; PARTS], [0; PARTS], [0; PARTS], 0)
            && self.errors == [0.0; PARTS - 1]
            && self.own == EMPTY_RANGE
            && self.tree == EMPTY_RANGE
    }

    /// Whether there are the parts that errors without them ask for, and no others.
    fn has_sound_parts(&self) -> bool {
        let is_there = |part: usize| self.lengths[part] > 0;
        let is_sound = |part: usize| {
            is_there(part) == (self.errors[part - 1] > 0.0)
                && (is_there(part) || (self.offsets[part], self.checksums[part]) == (0, 0))
        };
        let is_error = |error: f32| (0.0..=1.0).contains(&error);
        let errors =
            self.errors.into_iter().all(is_error) && self.errors.is_sorted_by(|a, b| a >= b);
        errors && (1..PARTS).all(is_sound)
    }

    /// Where those parts lie in the file that values of such `precision` take and that hold something:
    /// the number, the place and the length of each.
    pub(super) fn parts(
        &self,
        precision: Precision,
    ) -> impl Iterator<Item = (usize, u64, usize)> + '_ {
        let part = |part: usize| (part, self.offsets[part], self.lengths[part] as usize);
        (0..=precision.last_part()).map(part).filter(|(_, _, length)| *length > 0)
    }

    /// Stored bytes that values of such `precision` take.
    pub fn stored_bytes(&self, precision: Precision) -> u64 {
        self.lengths[..=precision.last_part()].iter().copied().map(u64::from).sum()
    }

    /// Bytes of these after decompression, for a payload of `cells` cells.
    pub fn decompressed(&self, cells: usize, precision: Precision) -> u64 {
        decompressed(cells, self, precision)
    }

    /// How far values of such `precision` may be from those stored, relative.
    pub fn error(&self, precision: Precision) -> f32 {
        self.errors.get(precision.last_part()).copied().unwrap_or(0.0)
    }

    /// Whether what is said of the box at any level takes in what is said of a child's.
    pub(super) fn encloses(&self, child: &Self) -> bool {
        if child.is_void() {
            return true;
        }
        let [low, high] = [self.tree[0] <= child.tree[0], child.tree[1] <= self.tree[1]];
        let nan = self.has_nan(false) || !child.has_nan(false);
        let void = self.fills_void() || !child.fills_void();
        let linear = child.residual_linear <= self.residual_linear;
        low && high && nan && void && linear && child.residual_log10 <= self.residual_log10
    }

    /// Whether NaN cells may be drawn from this brick (`own`) or from it and those beneath.
    pub fn has_nan(&self, own: bool) -> bool {
        self.flags & if own { Self::NAN_OWN } else { Self::NAN_TREE } != 0
    }

    /// Appends the record, [`Self::BYTES`] bytes.
    pub(crate) fn write(&self, bytes: &mut ByteWriter) {
        self.offsets.into_iter().for_each(|offset| bytes.u64(offset));
        self.checksums.into_iter().for_each(|checksum| bytes.u64(checksum));
        self.lengths.into_iter().for_each(|length| bytes.u32(length));
        for value in [self.own[0], self.own[1], self.tree[0], self.tree[1]] {
            bytes.f32(value);
        }
        bytes.f32(self.residual_linear);
        bytes.f32(self.residual_log10);
        self.errors.into_iter().for_each(|error| bytes.f32(error));
        bytes.u8(self.flags);
        bytes.u8(self.parent_blocks);
        bytes.u8(0);
        bytes.u8(0);
    }

    /// Reads what [`Self::write`] has written; `None` where bytes are missing, the padding is not 0
    /// or the record contradicts itself: ranges that are out of order or not within each other,
    /// residuals below 0, parts that do not agree with the errors without them, a void brick with a
    /// payload.
    pub(crate) fn read(bytes: &mut ByteReader<'_>) -> Option<Self> {
        let record = Self {
            offsets: all(|| bytes.u64())?,
            checksums: all(|| bytes.u64())?,
            lengths: all(|| bytes.u32())?,
            own: [bytes.f32()?, bytes.f32()?],
            tree: [bytes.f32()?, bytes.f32()?],
            residual_linear: bytes.f32()?,
            residual_log10: bytes.f32()?,
            errors: all(|| bytes.f32())?,
            flags: bytes.u8()?,
            parent_blocks: bytes.u8()?,
        };
        let tail = bytes.u8()? == 0 && bytes.u8()? == 0 && record.flags < 16;
        let enclosed = record.tree[0] <= record.own[0] && record.own[1] <= record.tree[1];
        let is_ordered = |range: [f32; 2]| range[0] <= range[1] || range == EMPTY_RANGE;
        let ordered = is_ordered(record.own) && is_ordered(record.tree);
        let residuals = record.residual_linear >= 0.0 && record.residual_log10 >= 0.0;
        let void = !record.is_void() || record.is_of_nothing();
        (tail && enclosed && ordered && residuals && void && record.has_sound_parts())
            .then_some(record)
    }
}

/// Numbers one after another; none where one is missing.
fn all<T: Copy + Default, const N: usize>(mut read: impl FnMut() -> Option<T>) -> Option<[T; N]> {
    let mut numbers = [T::default(); N];
    for number in &mut numbers {
        *number = read()?;
    }
    Some(numbers)
}

/// The [min, max] of nothing: all cells NaN, or none.
pub(crate) const EMPTY_RANGE: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

/// What the index says of a node's brick of a field.
#[derive(Debug, Clone, Copy)]
pub struct BrickEntry<'i> {
    /// The node's index.
    pub node: u64,
    /// The field's number in the header.
    pub field: usize,
    /// The node's record.
    pub node_record: &'i NodeRecord,
    /// The record of the field in the node.
    pub field_record: &'i FieldRecord,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_without_parts_are_in_order_and_the_parts_are_there() {
        let is_read = |errors: [f32; PARTS - 1], lengths: [u32; PARTS]| {
            let offsets = lengths.map(|length| u64::from(length > 0));
            let (own, tree) = ([1.0, 2.0], [1.0, 3.0]);
            let record =
                FieldRecord { offsets, lengths, own, tree, errors, ..FieldRecord::default() };
            let mut bytes = ByteWriter::default();
            record.write(&mut bytes);
            assert_eq!(bytes.bytes.len(), FieldRecord::BYTES);
            FieldRecord::read(&mut ByteReader::new(&bytes.bytes)).is_some()
        };
        assert!(is_read([0.0; 3], [1, 0, 0, 0]) && is_read([1.0, 0.5, 0.0], [1, 1, 1, 0]));
        assert!(!is_read([0.0; 3], [1, 1, 0, 0]) && !is_read([1.0, 0.5, 0.0], [1, 1, 1, 1]));
        assert!(!is_read([0.5, 1.0, 0.0], [1, 1, 1, 0]) && !is_read([2.0, 0.0, 0.0], [1, 1, 0, 0]));
        assert!(!is_read([f32::NAN, 0.0, 0.0], [1, 1, 0, 0]) && !is_read([-0.5; 3], [1; 4]));
    }

    #[test]
    fn ranges_are_in_order_or_empty_and_enclose_each_other() {
        let is_read = |own: [f32; 2], tree: [f32; 2]| {
            let (offsets, lengths) = ([1, 0, 0, 0], [1, 0, 0, 0]);
            let record = FieldRecord { offsets, lengths, own, tree, ..FieldRecord::default() };
            let mut bytes = ByteWriter::default();
            record.write(&mut bytes);
            FieldRecord::read(&mut ByteReader::new(&bytes.bytes)).is_some()
        };
        assert!(is_read([1.0, 2.0], [1.0, 3.0]) && is_read(EMPTY_RANGE, [5.0, 5.0]));
        assert!(is_read(EMPTY_RANGE, EMPTY_RANGE));
        // A subtree of nothing would be left out without a word.
        assert!(!is_read(EMPTY_RANGE, [5.0, -5.0]) && !is_read([2.0, 1.0], [0.0, 3.0]));
        assert!(!is_read([1.0, 4.0], [1.0, 3.0]) && !is_read([1.0, 2.0], EMPTY_RANGE));
    }
}
