//! Payloads taken out of a cache, changed, and put back.

use std::ops::Range;

use super::anatomy::{Anatomy, PAGE, payload_checksum, word};

/// Where a field record says what of its payload.
const CHECKSUM: usize = 24;
const LENGTH: usize = 48;
const ERRORS: usize = 84;

/// Parts of a payload, and bytes of a cell in each.
const BYTES_PER_CELL: [usize; 3] = [3, 1, 1];

impl Anatomy {
    fn payload_record(&self, node: usize, field: usize) -> usize {
        self.field_numbers(node, field)[0].at
    }

    /// Where the parts of a payload lie in the file.
    fn parts(&self, bytes: &[u8], record: usize) -> [Range<usize>; 3] {
        [0, 1, 2].map(|part| {
            let start = word(bytes, record + 8 * part, 8) as usize;
            start..start + word(bytes, record + LENGTH + 4 * part, 4) as usize
        })
    }

    /// The stored bytes of a payload's parts; empty where there is none.
    pub(crate) fn stored<'b>(&self, bytes: &'b [u8], node: usize, field: usize) -> [&'b [u8]; 3] {
        self.parts(bytes, self.payload_record(node, field)).map(|range| &bytes[range])
    }

    /// The payload decompressed: states, the upper two planes of the values, the third, the lowest.
    pub(crate) fn raw(&self, bytes: &[u8], node: usize, field: usize) -> Vec<u8> {
        let parts = self.stored(bytes, node, field);
        let mut raw = zstd::bulk::decompress(parts[0], 1 << 24).unwrap();
        let cells = raw.len() / BYTES_PER_CELL[0];
        for part in &parts[1..] {
            match part {
                [] => raw.resize(raw.len() + cells, 0),
                _ => raw.extend(zstd::bulk::decompress(part, 1 << 24).unwrap()),
            }
        }
        raw
    }

    /// The same cache with another payload: everything behind its parts moves, and all offsets and
    /// checksums are right. Parts that were not there come last.
    pub(crate) fn with_payload(
        &self,
        bytes: &[u8],
        (node, field): (usize, usize),
        (parts, errors): ([&[u8]; 3], [f32; 2]),
    ) -> Vec<u8> {
        let record = self.payload_record(node, field);
        let old = self.parts(bytes, record);
        let moved = |offset: usize| {
            let before = (0..3).filter(|p| !old[*p].is_empty() && old[*p].start < offset);
            before.fold(offset, |at, part| at + parts[part].len() - old[part].len())
        };
        let mut index = bytes[self.index..self.index + self.pages * PAGE].to_vec();
        let mut put = |at: usize, value: u64, count: usize| {
            let at = at - self.index;
            index[at..at + count].copy_from_slice(&value.to_le_bytes()[..count]);
        };
        let all = (0..self.nodes).flat_map(|n| (0..self.fields).map(move |f| (n, f)));
        let mut end = self.header_bytes;
        for (node, field) in all {
            let record = self.payload_record(node, field);
            for (part, range) in self.parts(bytes, record).into_iter().enumerate() {
                end = end.max(range.end);
                put(record + 8 * part, moved(range.start) as u64, 8);
            }
        }
        let mut forged = bytes[..end].to_vec();
        let mut order = [0, 1, 2];
        order.sort_by_key(|part| std::cmp::Reverse(old[*part].start));
        for part in order.into_iter().filter(|part| !old[*part].is_empty()) {
            forged.splice(old[part].clone(), parts[part].iter().copied());
        }
        for (part, stored) in parts.into_iter().enumerate() {
            put(record + CHECKSUM + 8 * part, payload_checksum((node, field, part), stored), 8);
            put(record + LENGTH + 4 * part, stored.len() as u64, 4);
            if stored.is_empty() {
                put(record + 8 * part, 0, 8);
            } else if old[part].is_empty() {
                put(record + 8 * part, forged.len() as u64, 8);
                forged.extend_from_slice(stored);
            }
            if let Some(before) = part.checked_sub(1) {
                let error = if stored.is_empty() { 0.0 } else { errors[before] };
                put(record + ERRORS + 4 * before, error.to_bits().into(), 4);
            }
        }
        forged.resize(forged.len().next_multiple_of(PAGE), 0);
        self.finish(forged, &index)
    }

    /// Payloads with an index behind them, and the header's idea of both.
    pub(crate) fn finish(&self, mut payloads: Vec<u8>, index: &[u8]) -> Vec<u8> {
        let moved = Self { index: payloads.len(), pages: index.len() / PAGE, ..self.clone() };
        payloads.extend_from_slice(index);
        payloads.resize(payloads.len() + 8 * moved.pages, 0);
        let sizes = [payloads.len(), moved.index, moved.pages];
        for (number, size) in moved.header.iter().zip(sizes) {
            payloads[number.at..number.at + 8].copy_from_slice(&(size as u64).to_le_bytes());
        }
        moved.seal(&mut payloads);
        payloads
    }

    /// The same cache with `table` for its table of levels: everything behind it moves.
    pub(crate) fn with_level_table(&self, bytes: &[u8], table: &[u8]) -> Vec<u8> {
        let range = &self.level_table;
        let mut forged = [&bytes[..range.start], table, &bytes[range.end..self.index]].concat();
        let moved = forged.len() as i64 - self.index as i64;
        let header_bytes = (self.header_bytes as i64 + moved) as usize;
        forged[12..16].copy_from_slice(&(header_bytes as u32).to_le_bytes());
        let mut index = bytes[self.index..self.index + self.pages * PAGE].to_vec();
        for (node, field) in (0..self.nodes).flat_map(|n| (0..self.fields).map(move |f| (n, f))) {
            let record = self.payload_record(node, field) - self.index;
            for at in [0, 8, 16].map(|place| record + place) {
                let offset = word(&index, at, 8);
                let offset = if offset == 0 { 0 } else { offset.wrapping_add_signed(moved) };
                index[at..at + 8].copy_from_slice(&offset.to_le_bytes());
            }
        }
        forged.resize(forged.len().next_multiple_of(PAGE), 0);
        Self { header_bytes, ..self.clone() }.finish(forged, &index)
    }
}

/// Compressed as the program does.
pub(crate) fn compress(raw: &[u8]) -> Vec<u8> {
    zstd::bulk::compress(raw, 3).unwrap()
}

/// What a raw payload's values are off by without its last parts.
pub(crate) fn rounding_errors(raw: &[u8]) -> [f32; 2] {
    let cells = raw.len() / BYTES_PER_CELL.iter().sum::<usize>();
    let byte = |cell: usize, plane: usize| i64::from(raw[plane * cells + cell]);
    let signed = |byte: i64| if byte < 128 { byte } else { byte - 256 };
    let (mut most, mut subnormal) = ([0; 2], false);
    for cell in 0..cells {
        // The lowest byte, and the one above it, which has taken its carry.
        let (low, middle) = (signed(byte(cell, 4)), signed(byte(cell, 3)));
        most = [most[0].max((256 * middle + low).abs()), most[1].max(low.abs())];
        let bits = (byte(cell, 2) << 24) + (byte(cell, 1) << 16) + 256 * middle + low;
        let magnitude = bits & 0x7fff_ffff;
        subnormal |= (1..1 << 23).contains(&magnitude);
    }
    let relative = |off: i64| off as f32 / (1 << 23) as f32;
    most.map(|off| if subnormal && off > 0 { 1.0 } else { relative(off) })
}

/// A raw payload's parts, as they are.
pub(crate) fn raw_parts(raw: &[u8]) -> [&[u8]; 3] {
    let cells = raw.len() / BYTES_PER_CELL.iter().sum::<usize>();
    let (first, rest) = raw.split_at(BYTES_PER_CELL[0] * cells);
    let (second, third) = rest.split_at(cells);
    [first, second, third]
}

/// The same compressed; the second where it or the third holds something, and the third where it does.
pub(crate) fn compress_parts(raw: &[u8]) -> [Vec<u8>; 3] {
    let parts = raw_parts(raw);
    let is_empty = |part: usize| parts[part..].concat().iter().all(|byte| *byte == 0);
    let compressed = |part: usize| {
        if part > 0 && is_empty(part) { Vec::new() } else { compress(parts[part]) }
    };
    [0, 1, 2].map(compressed)
}
