//! Payloads taken out of a cache, changed, and put back.

use super::anatomy::{Anatomy, PAGE, payload_checksum, word};

/// Where a field record says what of its payload.
const CHECKSUM: usize = 8;
const LENGTH: usize = 16;

impl Anatomy {
    fn payload_record(&self, node: usize, field: usize) -> usize {
        self.field_numbers(node, field)[0].at
    }

    /// The stored bytes of a payload; empty where there is none.
    pub(crate) fn stored<'b>(&self, bytes: &'b [u8], node: usize, field: usize) -> &'b [u8] {
        let record = self.payload_record(node, field);
        let start = word(bytes, record, 8) as usize;
        &bytes[start..start + word(bytes, record + LENGTH, 4) as usize]
    }

    /// The payload decompressed: states, then byte planes of the values.
    pub(crate) fn raw(&self, bytes: &[u8], node: usize, field: usize) -> Vec<u8> {
        let stored = self.stored(bytes, node, field);
        zstd::bulk::decompress(stored, 1 << 24).unwrap()
    }

    /// The same cache with another payload: everything behind it moves, and all offsets and
    /// checksums are right.
    pub(crate) fn with_payload(
        &self,
        bytes: &[u8],
        (node, field): (usize, usize),
        stored: &[u8],
    ) -> Vec<u8> {
        let record = self.payload_record(node, field);
        let start = word(bytes, record, 8) as usize;
        let old = word(bytes, record + LENGTH, 4) as usize;
        let mut index = bytes[self.index..self.index + self.pages * PAGE].to_vec();
        let mut put = |at: usize, value: u64, count: usize| {
            let at = at - self.index;
            index[at..at + count].copy_from_slice(&value.to_le_bytes()[..count]);
        };
        let all = (0..self.nodes).flat_map(|n| (0..self.fields).map(move |f| (n, f)));
        let mut end = self.header_bytes;
        for (node, field) in all {
            let record = self.payload_record(node, field);
            let offset = word(bytes, record, 8) as usize;
            end = end.max(offset + word(bytes, record + LENGTH, 4) as usize);
            if offset > start {
                put(record, (offset + stored.len() - old) as u64, 8);
            }
        }
        put(record + CHECKSUM, payload_checksum(node, field, stored), 8);
        put(record + LENGTH, stored.len() as u64, 4);
        let mut forged = [&bytes[..start], stored, &bytes[start + old..end]].concat();
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
            let at = self.payload_record(node, field) - self.index;
            let offset = word(&index, at, 8).wrapping_add_signed(moved);
            index[at..at + 8].copy_from_slice(&offset.to_le_bytes());
        }
        forged.resize(forged.len().next_multiple_of(PAGE), 0);
        Self { header_bytes, ..self.clone() }.finish(forged, &index)
    }
}

/// Compressed as the program does.
pub(crate) fn compress(raw: &[u8]) -> Vec<u8> {
    zstd::bulk::compress(raw, 3).unwrap()
}
