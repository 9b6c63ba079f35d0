//! Payloads taken out of a cache, changed, and put back.

use std::ops::Range;

use super::anatomy::{Anatomy, PAGE, payload_checksum, word};

/// Parts of a payload.
pub(crate) const PARTS: usize = 4;

/// Where a field record says what of its payload.
const CHECKSUM: usize = 8 * PARTS;
const LENGTH: usize = 16 * PARTS;
const ERRORS: usize = 20 * PARTS + 24;
const BLOCKS: usize = ERRORS + 4 * (PARTS - 1) + 1;

/// The lowest bit that each part tells of values, and how many it tells.
const DIGITS: [(u32, u32); PARTS] = [(16, 16), (12, 4), (8, 4), (0, 8)];

/// States and values of a payload, block after block.
#[derive(Debug, Clone)]
pub(crate) struct Payload {
    /// Cells along the edge of each block.
    sides: Vec<usize>,
    /// Of each cell.
    pub(crate) states: Vec<u8>,
    /// Values as the cache codes them: bits of f32 with their carries.
    coded: Vec<u32>,
}

impl Payload {
    /// Gives cell `at` another value.
    pub(crate) fn set(&mut self, at: usize, value: f32) {
        let carry = |bits: u32, middle: u32| bits.wrapping_add((bits & middle) << 1);
        self.coded[at] = [0x80, 0x800, 0x8000].into_iter().fold(value.to_bits(), carry);
    }

    /// The same without any ancestor's block, if the brick's own has no holes.
    pub(crate) fn alone(&self) -> Option<Self> {
        let cells = self.sides[0].pow(3);
        let (states, coded) = (self.states[..cells].to_vec(), self.coded[..cells].to_vec());
        let is_whole = self.sides.len() > 1 && states.iter().all(|state| *state != 0);
        is_whole.then(|| Self { sides: self.sides[..1].to_vec(), states, coded })
    }

    /// Values of all cells in the digits of the first `parts` parts; 0 where there is none.
    pub(crate) fn values(&self, parts: usize) -> Vec<f32> {
        let uncarry = |bits: u32, middle: u32| bits.wrapping_sub((bits & middle) << 1);
        let lowest = DIGITS[parts - 1].0;
        let value = |(coded, bits): (&u32, &u8)| {
            let kept = if bits & 1 == 1 { coded >> lowest << lowest } else { 0 };
            f32::from_bits([0x8000, 0x800, 0x80].into_iter().fold(kept, uncarry))
        };
        self.coded.iter().zip(&self.states).map(value).collect()
    }

    /// Calls `visit` with `numbers` of cells, a cell, and what the preceding ones of its block predict.
    fn each(&self, numbers: &mut [u32], mut visit: impl FnMut(&mut u32, usize, u32)) {
        let mut start = 0;
        for &side in &self.sides {
            for at in 0..side.pow(3) {
                let cell = [at % side, at / side % side, at / side / side];
                let mut predicted = 0u32;
                for corner in 1..8usize {
                    let back = [0, 1, 2].map(|axis| corner >> axis & 1);
                    if (0..3).all(|axis| back[axis] <= cell[axis]) {
                        let behind = back[0] + side * (back[1] + side * back[2]);
                        let number = numbers[start + at - behind];
                        let sign = if corner.count_ones() % 2 == 1 { 1 } else { u32::MAX };
                        predicted = predicted.wrapping_add(number.wrapping_mul(sign));
                    }
                }
                visit(&mut numbers[start + at], start + at, predicted);
            }
            start += side.pow(3);
        }
    }

    /// Adds to the coded values what a part tells.
    fn join(&mut self, part: usize, raw: &[u8]) {
        let (lowest, bits) = DIGITS[part];
        let cells = self.states.len();
        let difference = |cell: usize| match part {
            0 => {
                let [low, high] = [raw[cells + cell], raw[2 * cells + cell]].map(u32::from);
                let folded = high << 8 | low;
                if folded & 1 == 0 { folded >> 1 } else { !(folded >> 1) }
            }
            3 => raw[cell].into(),
            _ => u32::from(raw[cell / 2]) >> (4 * (cell % 2)),
        };
        let mut numbers = vec![0; cells];
        self.each(&mut numbers, |number, cell, predicted| {
            let predicted = if part == 3 { 0 } else { predicted };
            *number = difference(cell).wrapping_add(predicted) & ((1 << bits) - 1);
        });
        for (coded, number) in self.coded.iter_mut().zip(numbers) {
            *coded |= number << lowest;
        }
    }

    /// What the parts hold before compression.
    pub(crate) fn parts(&self) -> [Vec<u8>; PARTS] {
        let cells = self.states.len();
        std::array::from_fn(|part| {
            let (lowest, bits) = DIGITS[part];
            let digit = |coded: &u32| coded >> lowest & ((1 << bits) - 1);
            let digits: Vec<u32> = self.coded.iter().map(digit).collect();
            let mut raw = match part {
                0 => [&self.states[..], &vec![0; 2 * cells]].concat(),
                3 => return digits.iter().map(|digit| *digit as u8).collect(),
                _ => vec![0; cells.div_ceil(2)],
            };
            self.each(&mut digits.clone(), |digit, cell, predicted| {
                let difference = digit.wrapping_sub(predicted);
                if part == 0 {
                    let difference = i32::from(difference as i16);
                    let folded = if difference < 0 { 2 * !difference + 1 } else { 2 * difference };
                    raw[cells + cell] = folded as u8;
                    raw[2 * cells + cell] = (folded >> 8) as u8;
                } else {
                    raw[cell / 2] |= ((difference & 15) << (4 * (cell % 2))) as u8;
                }
            });
            raw
        })
    }

    /// The same compressed; those behind the first as far as any of them tells something.
    pub(crate) fn compressed(&self) -> [Vec<u8>; PARTS] {
        let errors = self.rounding_errors();
        let parts = self.parts();
        std::array::from_fn(|part| {
            let is_there = part == 0 || errors[part - 1] > 0.0;
            if is_there { compress(&parts[part]) } else { Vec::new() }
        })
    }

    /// What values are off by without the last parts.
    pub(crate) fn rounding_errors(&self) -> [f32; PARTS - 1] {
        let mut start = 0;
        let mut all = [0f32; PARTS - 1];
        for side in &self.sides {
            let own = start..start + side.pow(3);
            start = own.end;
            let cells = self.coded[own.clone()].iter().zip(&self.states[own]);
            let held = cells.filter(|(_, bits)| *bits & 1 == 1).map(|cell| *cell.0);
            all = std::array::from_fn(|part| Self::errors_of(held.clone())[part].max(all[part]));
        }
        all
    }

    fn errors_of(held: impl Iterator<Item = u32>) -> [f32; PARTS - 1] {
        let signed = |digit: u32, bits: u32| {
            let (digit, half) = (i64::from(digit), 1 << (bits - 1));
            if digit < half { digit } else { digit - 2 * half }
        };
        let (mut most, mut subnormal) = ([0; PARTS - 1], false);
        for coded in held {
            // From the lowest byte up: what is left out without it and those above it.
            let low = signed(coded & 0xff, 8);
            let middle = low + 256 * signed(coded >> 8 & 15, 4);
            let all = middle + 4096 * signed(coded >> 12 & 15, 4);
            let [all_off, middle, low] = [all, middle, low].map(i64::abs);
            let offs = [all_off.max(middle).max(low), middle.max(low), low];
            for (most, off) in most.iter_mut().zip(offs) {
                *most = off.max(*most);
            }
            let magnitude = (i64::from(coded >> 16 << 16) + all) & 0x7fff_ffff;
            subnormal |= (1..1 << 23).contains(&magnitude);
        }
        let relative = |off: i64| off as f32 / (1 << 23) as f32;
        most.map(|off| if subnormal && off > 0 { 1.0 } else { relative(off) })
    }
}

impl Anatomy {
    fn payload_record(&self, node: usize, field: usize) -> usize {
        self.field_numbers(node, field)[0].at
    }

    /// Where the parts of a payload lie in the file.
    fn parts(&self, bytes: &[u8], record: usize) -> [Range<usize>; PARTS] {
        std::array::from_fn(|part| {
            let start = word(bytes, record + 8 * part, 8) as usize;
            start..start + word(bytes, record + LENGTH + 4 * part, 4) as usize
        })
    }

    /// The stored bytes of a payload's parts; empty where there is none.
    pub(crate) fn stored<'b>(
        &self,
        bytes: &'b [u8],
        node: usize,
        field: usize,
    ) -> [&'b [u8]; PARTS] {
        self.parts(bytes, self.payload_record(node, field)).map(|range| &bytes[range])
    }

    /// What a payload holds.
    pub(crate) fn payload(&self, bytes: &[u8], node: usize, field: usize) -> Payload {
        let blocks = usize::from(bytes[self.payload_record(node, field) + BLOCKS]);
        let sides: Vec<usize> = (0..=blocks).map(|up| (self.edge >> up).max(1) + 2).collect();
        let cells = sides.iter().map(|side| side.pow(3)).sum();
        let parts = self.stored(bytes, node, field);
        let first = decompress(parts[0]);
        let states = first[..cells].to_vec();
        let mut payload = Payload { sides, states, coded: vec![0; cells] };
        payload.join(0, &first);
        for part in (1..PARTS).filter(|part| !parts[*part].is_empty()) {
            payload.join(part, &decompress(parts[part]));
        }
        payload
    }

    /// Says in a brick's record that its payload has no ancestor's block.
    pub(crate) fn forget_parents(&self, bytes: &mut [u8], node: usize, field: usize) {
        bytes[self.payload_record(node, field) + BLOCKS] = 0;
        self.seal(bytes);
    }

    /// The same cache with another payload: everything behind its parts moves, and all offsets and
    /// checksums are right. Parts that were not there come last.
    pub(crate) fn with_payload(
        &self,
        bytes: &[u8],
        (node, field): (usize, usize),
        (parts, errors): ([&[u8]; PARTS], [f32; PARTS - 1]),
    ) -> Vec<u8> {
        let record = self.payload_record(node, field);
        let old = self.parts(bytes, record);
        let moved = |offset: usize| {
            let before = (0..PARTS).filter(|p| !old[*p].is_empty() && old[*p].start < offset);
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
        let mut order: [usize; PARTS] = std::array::from_fn(|part| part);
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
            for at in (0..PARTS).map(|part| record + 8 * part) {
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

/// The reverse.
pub(crate) fn decompress(stored: &[u8]) -> Vec<u8> {
    zstd::bulk::decompress(stored, 1 << 24).unwrap()
}
