//! Payload bytes: what [`parts`] makes of states and values, each part zstd-compressed.

use super::brick::{BrickShape, RawBrick};
use super::digits::{PARTS, Precision};
use super::parts::{self, Joiner, Splitter};
use super::record::FieldRecord;

/// zstd level: what higher ones save on such bytes is not worth their time.
const COMPRESSION_LEVEL: i32 = 1;

/// A payload as it is stored.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Payload {
    /// Its parts. Where values are exact without it, one is empty.
    pub parts: [Vec<u8>; PARTS],
    /// Largest relative difference of a value in each precision but the last.
    pub errors: [f32; PARTS - 1],
}

/// Compresses payloads; holds the codec's context and scratch buffers for one thread.
pub struct Encoder {
    context: zstd::bulk::Compressor<'static>,
    splitter: Splitter,
    raw: [Vec<u8>; PARTS],
    stored: Vec<u8>,
}

impl Encoder {
    /// A codec context for one thread.
    ///
    /// # Errors
    /// What the codec says when it cannot be set up.
    pub fn new() -> std::io::Result<Self> {
        let context = zstd::bulk::Compressor::new(COMPRESSION_LEVEL)?;
        let (splitter, raw, stored) = Default::default();
        Ok(Self { context, splitter, raw, stored })
    }

    /// The stored form of `brick`, in which cells that do not exist have the value 0. All NaN become one.
    ///
    /// # Errors
    /// What the codec says.
    pub fn encode(&mut self, brick: &RawBrick) -> std::io::Result<Payload> {
        self.splitter.split(brick, &mut self.raw);
        let mut payload = Payload { errors: brick.rounding_errors(), ..Payload::default() };
        for (part, raw) in self.raw.iter().enumerate() {
            if part == 0 || payload.errors[part - 1] > 0.0 {
                self.stored.clear();
                self.stored.reserve(zstd::zstd_safe::compress_bound(raw.len()));
                self.context.compress_to_buffer(raw.as_slice(), &mut self.stored)?;
                // What is kept takes no more room than it needs.
                payload.parts[part] = self.stored.clone();
            }
        }
        Ok(payload)
    }
}

/// Decompresses payloads; holds the codec's context and buffers for one thread.
pub struct Decoder {
    context: zstd::bulk::Decompressor<'static>,
    /// Where the stored (compressed) bytes of each part are put before they are decompressed.
    pub(super) stored: [Vec<u8>; PARTS],
    raw: [Vec<u8>; PARTS],
    joiner: Joiner,
}

impl Decoder {
    /// A codec context for one thread.
    ///
    /// # Errors
    /// What the codec says when it cannot be set up.
    pub fn new() -> std::io::Result<Self> {
        let (stored, raw, joiner) = Default::default();
        Ok(Self { context: zstd::bulk::Decompressor::new()?, stored, raw, joiner })
    }

    /// Most bytes that a decoder holds for bricks of `shape` with up to `blocks` blocks: stored
    /// and raw payload, scratch, and the codec's own context.
    pub fn bytes(shape: BrickShape, blocks: usize) -> u64 {
        let cells = shape.cells_in_blocks(blocks);
        let of_part = |part: usize| stored_bytes_limit(part, cells) + parts::bytes(part, cells);
        let parts: usize = (0..PARTS).map(of_part).sum();
        (parts + Joiner::bytes(cells)) as u64 + (192 << 10)
    }

    /// Decodes `self.stored` into `brick`; empty parts but the first are left out. The reason where it
    /// is not `blocks` blocks of `shape`.
    pub(super) fn decode(
        &mut self,
        shape: BrickShape,
        blocks: usize,
        brick: &mut RawBrick,
    ) -> Result<(), &'static str> {
        let cells = shape.cells_in_blocks(blocks);
        for (part, (stored, raw)) in self.stored.iter().zip(&mut self.raw).enumerate() {
            raw.clear();
            if part == 0 || !stored.is_empty() {
                decompress(&mut self.context, stored, parts::bytes(part, cells), raw)?;
            }
        }
        brick.fit(shape, blocks);
        self.joiner.join(self.raw.each_ref().map(Vec::as_slice), brick)
    }
}

/// Most bytes that a part of a payload of `cells` cells may take when stored (zstd's own bound).
fn stored_bytes_limit(part: usize, cells: usize) -> usize {
    zstd::zstd_safe::compress_bound(parts::bytes(part, cells))
}

/// Whether a payload of `cells` cells can be as long as `record` says.
pub(super) fn can_be_stored(cells: usize, record: &FieldRecord) -> bool {
    record.parts(Precision::Full).all(|(part, _, length)| length <= stored_bytes_limit(part, cells))
}

/// Bytes of a payload of `cells` cells after decompression of all parts that hold something, up to
/// the one that `precision` needs.
pub(super) fn decompressed(cells: usize, record: &FieldRecord, precision: Precision) -> u64 {
    record.parts(precision).map(|(part, ..)| parts::bytes(part, cells) as u64).sum()
}

/// One part of a payload, into `raw`.
fn decompress(
    context: &mut zstd::bulk::Decompressor<'_>,
    stored: &[u8],
    expected: usize,
    raw: &mut Vec<u8>,
) -> Result<(), &'static str> {
    raw.reserve_exact(expected);
    let length = context
        .decompress_to_buffer(stored, raw)
        .map_err(|_| "the compressed bytes cannot be decoded")?;
    if length == expected { Ok(()) } else { Err(parts::OTHER_LENGTH) }
}

#[cfg(test)]
mod tests {
    use super::super::brick::state;
    use super::*;

    fn sample(shape: BrickShape, blocks: usize) -> RawBrick {
        let mut brick = RawBrick::default();
        brick.fit(shape, blocks);
        for (up, block) in brick.blocks.iter_mut().enumerate() {
            for i in 0..block.values.len() {
                if i % 7 != up {
                    block.states[i] = state::EXISTS;
                    block.values[i] = (i as f32 * 1.7 + up as f32).sin() * 1e20;
                }
            }
        }
        brick
    }

    #[test]
    fn what_is_encoded_is_decoded() {
        // Four, five and six blocks have an odd number of cells.
        for (edge, blocks) in [(8, 1), (8, 4), (16, 2), (16, 5), (32, 6), (32, 7)] {
            let shape = BrickShape::new(edge).unwrap();
            let brick = sample(shape, blocks);
            let mut decoder = Decoder::new().unwrap();
            let payload = Encoder::new().unwrap().encode(&brick).unwrap();
            let Payload { parts, errors } = payload;
            for (error, least) in errors.into_iter().zip([3.5e-3, 2.2e-4, 1.4e-5]) {
                assert!(error > least && error < 1.2 * least, "{errors:?}");
            }
            decoder.stored = parts;
            let mut decoded = RawBrick::default();
            decoder.decode(shape, blocks, &mut decoded).unwrap();
            assert_eq!(decoded, brick);
            let buffers = decoder.raw.iter().map(Vec::capacity).sum::<usize>();
            let held = buffers + decoder.joiner.capacity();
            assert!(held as u64 <= Decoder::bytes(shape, blocks), "{held}");
            assert!(decoder.decode(shape, blocks + 1, &mut decoded).is_err());
            for precision in Precision::FEWER.into_iter().rev() {
                let part = precision.last_part();
                decoder.stored[part + 1].clear();
                decoder.decode(shape, blocks, &mut decoded).unwrap();
                for (rounded, full) in decoded.blocks.iter().zip(&brick.blocks) {
                    assert_eq!(rounded.states, full.states);
                    let mut pairs = rounded.values.iter().zip(&full.values);
                    assert!(pairs.all(|(a, b)| (a - b).abs() <= errors[part] * b.abs()));
                }
            }
        }
    }

    #[test]
    fn what_is_exact_in_short_has_no_other_parts() {
        let shape = BrickShape::new(8).unwrap();
        let mut brick = sample(shape, 2);
        for block in &mut brick.blocks {
            for value in block.values.iter_mut().filter(|value| **value != 0.0) {
                *value = value.signum() * 1.5;
            }
            block.values[3] = f32::NAN;
        }
        let payload = Encoder::new().unwrap().encode(&brick).unwrap();
        let lengths = payload.parts.each_ref().map(Vec::len);
        assert!(
            payload.errors == [0.0; PARTS - 1] && lengths[0] > 0 && lengths[1..] == [0; PARTS - 1]
        );
        let mut decoder = Decoder::new().unwrap();
        decoder.stored = payload.parts;
        let mut decoded = RawBrick::default();
        decoder.decode(shape, 2, &mut decoded).unwrap();
        for (decoded, block) in decoded.blocks.iter().zip(&brick.blocks) {
            let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&decoded.values), bits(&block.values));
        }
    }

    #[test]
    fn impossible_states_are_refused() {
        let shape = BrickShape::new(8).unwrap();
        let mut brick = sample(shape, 1);
        brick.blocks[0].states[5] = state::REFINED;
        let mut decoder = Decoder::new().unwrap();
        let payload = Encoder::new().unwrap().encode(&brick).unwrap();
        decoder.stored = payload.parts;
        let decoded = decoder.decode(shape, 1, &mut RawBrick::default());
        assert!(decoded.is_err());
    }
}
