//! Where everything lies in a cache file: a second reading of its layout, on purpose apart from
//! the program's own.

use std::ops::Range;

use xxhash_rust::xxh3::{xxh3_64, xxh3_64_with_seed};

/// Bytes of an index page.
pub(crate) const PAGE: usize = 64 << 10;
const PREFIX: usize = 24;
const NODE: usize = 40;
const FIELD: usize = 120;

/// How a number is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    U8,
    U32,
    I32,
    U64,
    F32,
    F64,
}

impl Kind {
    /// Bytes that it takes.
    pub(crate) fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::F64 => 8,
        }
    }
}

/// A number in the file.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Number {
    /// What it says.
    pub(crate) name: &'static str,
    /// How it is stored.
    pub(crate) kind: Kind,
    /// Where.
    pub(crate) at: usize,
}

/// Where everything lies.
#[derive(Debug, Clone, Default)]
pub(crate) struct Anatomy {
    /// Bytes before the first payload.
    pub(crate) header_bytes: usize,
    /// Where the index begins.
    pub(crate) index: usize,
    /// Its pages.
    pub(crate) pages: usize,
    /// Cells along a brick's edge.
    pub(crate) edge: usize,
    /// Bricks.
    pub(crate) nodes: usize,
    /// Fields.
    pub(crate) fields: usize,
    /// Every number of the header.
    pub(crate) header: Vec<Number>,
    /// The table of levels, its count included.
    pub(crate) level_table: Range<usize>,
}

const FIXED: [(&str, Kind); 16] = [
    ("file bytes", Kind::U64),
    ("index offset", Kind::U64),
    ("index pages", Kind::U64),
    ("page table checksum", Kind::U64),
    ("edge", Kind::F64),
    ("edge", Kind::F64),
    ("edge", Kind::F64),
    ("edge", Kind::F64),
    ("edge", Kind::F64),
    ("edge", Kind::F64),
    ("root cells", Kind::U64),
    ("root cells", Kind::U64),
    ("root cells", Kind::U64),
    ("time", Kind::F64),
    ("brick edge", Kind::U32),
    ("parent blocks", Kind::U32),
];

const LEVEL: [(&str, Kind); 7] = [
    ("level octree", Kind::I32),
    ("level simulation", Kind::I32),
    ("level first node", Kind::U64),
    ("level nodes", Kind::U64),
    ("level grids", Kind::U64),
    ("level cells", Kind::U64),
    ("level leaf cells", Kind::U64),
];

const CACHED_FIELD: [(&str, Kind); 13] = [
    ("field to cgs", Kind::F64),
    ("field exponent", Kind::I32),
    ("field min", Kind::F64),
    ("field max", Kind::F64),
    ("field smallest positive", Kind::F64),
    ("field sum", Kind::F64),
    ("field stored sum", Kind::F64),
    ("field NaN cells", Kind::U64),
    ("field dropped cells", Kind::U64),
    ("field dropped volume", Kind::F64),
    ("field dropped sum", Kind::F64),
    ("field relative error", Kind::F64),
    ("field leaf error", Kind::F64),
];

const NODE_RECORD: [(&str, Kind); 10] = [
    ("first child", Kind::U64),
    ("parent", Kind::U64),
    ("descendants", Kind::U64),
    ("leaf cells", Kind::U32),
    ("existing cells", Kind::U32),
    ("refined cells", Kind::U32),
    ("child mask", Kind::U8),
    ("depth", Kind::U8),
    ("octant", Kind::U8),
    ("reserved", Kind::U8),
];

const FIELD_RECORD: [(&str, Kind); 23] = [
    ("payload offset", Kind::U64),
    ("payload offset", Kind::U64),
    ("payload offset", Kind::U64),
    ("payload offset", Kind::U64),
    ("payload checksum", Kind::U64),
    ("payload checksum", Kind::U64),
    ("payload checksum", Kind::U64),
    ("payload checksum", Kind::U64),
    ("part's length", Kind::U32),
    ("part's length", Kind::U32),
    ("part's length", Kind::U32),
    ("part's length", Kind::U32),
    ("own min", Kind::F32),
    ("own max", Kind::F32),
    ("tree min", Kind::F32),
    ("tree max", Kind::F32),
    ("residual", Kind::F32),
    ("residual", Kind::F32),
    ("rounding error", Kind::F32),
    ("rounding error", Kind::F32),
    ("rounding error", Kind::F32),
    ("flags", Kind::U8),
    ("payload blocks", Kind::U8),
];

/// Little-endian number of up to 8 bytes at `at`.
pub(crate) fn word(bytes: &[u8], at: usize, count: usize) -> u64 {
    let mut word = [0; 8];
    word[..count].copy_from_slice(&bytes[at..at + count]);
    u64::from_le_bytes(word)
}

fn numbers(fields: &[(&'static str, Kind)], mut at: usize) -> Vec<Number> {
    let place = |&(name, kind): &(&'static str, Kind)| {
        let number = Number { name, kind, at };
        at += kind.bytes();
        number
    };
    fields.iter().map(place).collect()
}

impl Anatomy {
    /// Reads a sound cache.
    pub(crate) fn read(bytes: &[u8]) -> Self {
        let size = |at: usize| word(bytes, at, 8) as usize;
        let mut anatomy = Self {
            header_bytes: word(bytes, 12, 4) as usize,
            index: size(PREFIX + 8),
            pages: size(PREFIX + 16),
            header: numbers(&FIXED, PREFIX),
            ..Self::default()
        };
        let mut at = PREFIX + 14 * 8;
        anatomy.edge = word(bytes, at, 4) as usize;
        at += 8;
        at += anatomy.text(bytes, at);
        let start = at;
        let levels = anatomy.count(bytes, &mut at, "level count");
        for _ in 0..levels {
            anatomy.nodes += size(at + 16);
            anatomy.add(&LEVEL, &mut at);
        }
        anatomy.level_table = start..at;
        anatomy.fields = anatomy.count(bytes, &mut at, "field count");
        for _ in 0..anatomy.fields {
            at += anatomy.text(bytes, at);
            at += anatomy.text(bytes, at);
            anatomy.add(&CACHED_FIELD, &mut at);
        }
        assert_eq!(at, anatomy.header_bytes, "the header's layout has changed");
        anatomy
    }

    fn add(&mut self, fields: &[(&'static str, Kind)], at: &mut usize) {
        self.header.extend(numbers(fields, *at));
        *at += fields.iter().map(|(_, kind)| kind.bytes()).sum::<usize>();
    }

    fn count(&mut self, bytes: &[u8], at: &mut usize, name: &'static str) -> usize {
        let count = word(bytes, *at, 4) as usize;
        self.add(&[(name, Kind::U32)], at);
        count
    }

    fn text(&mut self, bytes: &[u8], at: usize) -> usize {
        self.header.push(Number { name: "text length", kind: Kind::U32, at });
        4 + word(bytes, at, 4) as usize
    }

    /// Bytes of a brick's records.
    pub(crate) fn record_bytes(&self) -> usize {
        NODE + self.fields * FIELD
    }

    /// Where brick `node`'s records lie.
    pub(crate) fn record(&self, node: usize) -> usize {
        let per_page = PAGE / self.record_bytes();
        self.index + node / per_page * PAGE + node % per_page * self.record_bytes()
    }

    /// The numbers of a brick's own record.
    pub(crate) fn node_numbers(&self, node: usize) -> Vec<Number> {
        numbers(&NODE_RECORD, self.record(node))
    }

    /// The numbers of a brick's record of `field`.
    pub(crate) fn field_numbers(&self, node: usize, field: usize) -> Vec<Number> {
        numbers(&FIELD_RECORD, self.record(node) + NODE + field * FIELD)
    }

    /// Makes all checksums but the payloads' right again.
    pub(crate) fn seal(&self, bytes: &mut [u8]) {
        let table = self.index + self.pages * PAGE;
        for page in 0..self.pages {
            let start = self.index + page * PAGE;
            let sum = xxh3_64_with_seed(&bytes[start..start + PAGE], page as u64);
            bytes[table + 8 * page..table + 8 * page + 8].copy_from_slice(&sum.to_le_bytes());
        }
        let sum = xxh3_64(&bytes[table..table + 8 * self.pages]);
        bytes[PREFIX + 24..PREFIX + 32].copy_from_slice(&sum.to_le_bytes());
        self.seal_header(bytes);
    }

    /// Makes the header's checksum right again.
    pub(crate) fn seal_header(&self, bytes: &mut [u8]) {
        let sum = xxh3_64(&bytes[PREFIX..self.header_bytes]);
        bytes[16..PREFIX].copy_from_slice(&sum.to_le_bytes());
    }
}

/// The checksum of a payload's part in its place; 0 for one that is not there.
pub(crate) fn payload_checksum((node, field, part): (usize, usize, usize), stored: &[u8]) -> u64 {
    let place = (node as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ field as u64;
    if stored.is_empty() { 0 } else { xxh3_64_with_seed(stored, place ^ (part as u64) << 32) }
}
