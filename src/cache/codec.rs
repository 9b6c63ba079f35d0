//! Payload bytes, in three parts: states and the upper halves of values, which tell these in short,
//! then the third bytes, then the lowest. Values are byte-shuffled, each part zstd-compressed.

use super::brick::{BrickShape, RawBrick, state};
use super::planes;
use super::record::FieldRecord;

/// zstd level: what higher ones save on byte-shuffled floats is not worth their time.
const COMPRESSION_LEVEL: i32 = 1;

/// How many digits of stored values are read: how many parts of their payload.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Precision {
    /// The leading 16 bits of each, rounded.
    Short,
    /// The leading 24.
    Medium,
    /// All.
    #[default]
    Full,
}

impl Precision {
    /// The last part that is read.
    pub fn last_part(self) -> usize {
        self as usize
    }
}

/// Parts of a payload.
pub const PARTS: usize = 3;

/// Bytes of a cell in each part: its state and the upper half of its value; another one; the last.
const BYTES_PER_CELL: [usize; PARTS] = [3, 1, 1];

/// A payload as it is stored.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Payload {
    /// Its parts. Where values are exact without it, one is empty.
    pub parts: [Vec<u8>; PARTS],
    /// Largest relative difference of a value in short, and in medium precision.
    pub errors: [f32; PARTS - 1],
}

/// Compresses payloads; holds the codec's context and scratch buffers for one thread.
pub struct Encoder {
    context: zstd::bulk::Compressor<'static>,
    raw: Vec<u8>,
    stored: Vec<u8>,
}

impl Encoder {
    /// A codec context for one thread.
    ///
    /// # Errors
    /// What the codec says when it cannot be set up.
    pub fn new() -> std::io::Result<Self> {
        let context = zstd::bulk::Compressor::new(COMPRESSION_LEVEL)?;
        Ok(Self { context, raw: Vec::new(), stored: Vec::new() })
    }

    /// The stored form of `brick`. All NaN become one.
    ///
    /// # Errors
    /// What the codec says.
    pub fn encode(&mut self, brick: &RawBrick) -> std::io::Result<Payload> {
        let cells = self.shuffle(brick);
        let mut payload = Payload { errors: brick.rounding_errors(), ..Payload::default() };
        let mut begin = 0;
        for (part, bytes) in BYTES_PER_CELL.into_iter().enumerate() {
            let raw = &self.raw[begin..begin + bytes * cells];
            begin += raw.len();
            if part == 0 || payload.errors[part - 1] > 0.0 {
                self.stored.clear();
                self.stored.reserve(zstd::zstd_safe::compress_bound(raw.len()));
                self.context.compress_to_buffer(raw, &mut self.stored)?;
                // What is kept takes no more room than it needs.
                payload.parts[part] = self.stored.clone();
            }
        }
        Ok(payload)
    }

    /// Puts all parts into `raw`: states, and planes from the highest bytes down but for the first two,
    /// of which the lower ones come first. Says how many cells there are.
    fn shuffle(&mut self, brick: &RawBrick) -> usize {
        let cells: usize = brick.blocks.iter().map(|block| block.values.len()).sum();
        self.raw.resize(BYTES_PER_CELL.iter().sum::<usize>() * cells, 0);
        let (mut states, planes) = self.raw.split_at_mut(cells);
        let (high, low) = planes.split_at_mut(2 * cells);
        let ((mut c, mut d), (mut b, mut a)) = (high.split_at_mut(cells), low.split_at_mut(cells));
        for block in &brick.blocks {
            let count = block.values.len();
            let parts = [states, a, b, c, d].map(|plane| plane.split_at_mut(count));
            let [(of_states, s1), (a0, a1), (b0, b1), (c0, c1), (d0, d1)] = parts;
            of_states.copy_from_slice(&block.states);
            planes::split(&block.values, [a0, b0, c0, d0]);
            (states, a, b, c, d) = (s1, a1, b1, c1, d1);
        }
        cells
    }
}

/// Decompresses payloads; holds the codec's context and buffers for one thread.
pub struct Decoder {
    context: zstd::bulk::Decompressor<'static>,
    /// Where the stored (compressed) bytes of each part are put before they are decompressed.
    pub(super) stored: [Vec<u8>; PARTS],
    raw: [Vec<u8>; PARTS],
}

impl Decoder {
    /// A codec context for one thread.
    ///
    /// # Errors
    /// What the codec says when it cannot be set up.
    pub fn new() -> std::io::Result<Self> {
        let (stored, raw) = Default::default();
        Ok(Self { context: zstd::bulk::Decompressor::new()?, stored, raw })
    }

    /// Most bytes that a decoder holds for bricks of `shape` with up to `blocks` blocks: stored
    /// and raw payload, and the codec's own context.
    pub fn bytes(shape: BrickShape, blocks: usize) -> u64 {
        let cells = shape.cells_in_blocks(blocks);
        let stored: usize = (0..PARTS).map(|part| stored_bytes_limit(part, cells)).sum();
        (shape.payload_bytes(blocks) + stored) as u64 + (192 << 10)
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
                decompress(&mut self.context, stored, BYTES_PER_CELL[part] * cells, raw)?;
            }
        }
        brick.reset(shape, blocks);
        let (states, high) = self.raw[0].split_at(cells);
        unpack(states, [high, &self.raw[1], &self.raw[2]], brick)
    }
}

/// Most bytes that a part of a payload of `cells` cells may take when stored (zstd's own bound).
fn stored_bytes_limit(part: usize, cells: usize) -> usize {
    zstd::zstd_safe::compress_bound(BYTES_PER_CELL[part] * cells)
}

/// Whether a payload of `cells` cells can be as long as `record` says.
pub(super) fn can_be_stored(cells: usize, record: &FieldRecord) -> bool {
    record.parts(Precision::Full).all(|(part, _, length)| length <= stored_bytes_limit(part, cells))
}

/// Bytes of a payload of `cells` cells after decompression of all parts that hold something, up to
/// the one that `precision` needs.
pub(super) fn decompressed(cells: usize, record: &FieldRecord, precision: Precision) -> u64 {
    record.parts(precision).map(|(part, ..)| (BYTES_PER_CELL[part] * cells) as u64).sum()
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
    if length == expected {
        Ok(())
    } else {
        Err("the payload decodes to another length than its brick needs")
    }
}

/// Values from planes: the upper two, and one below each, where they are there.
fn unpack(
    states: &[u8],
    [high, third, lowest]: [&[u8]; PARTS],
    brick: &mut RawBrick,
) -> Result<(), &'static str> {
    if !state::are_valid(states) {
        return Err("a cell's state is none that there is");
    }
    let cells = states.len();
    let mut start = 0;
    for block in &mut brick.blocks {
        let own = start..start + block.states.len();
        start = own.end;
        block.states.copy_from_slice(&states[own.clone()]);
        let (c, d) = (&high[own.clone()], &high[cells..][own.clone()]);
        let values = &mut block.values;
        match (third.get(own.clone()), lowest.get(own)) {
            (Some(b), Some(a)) => planes::join([a, b, c, d], values),
            (Some(b), None) => planes::join_medium([b, c, d], values),
            (None, _) => planes::join_short([c, d], values),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(shape: BrickShape, blocks: usize) -> RawBrick {
        let mut brick = RawBrick::default();
        brick.reset(shape, blocks);
        for (up, block) in brick.blocks.iter_mut().enumerate() {
            for i in 0..block.values.len() {
                block.states[i] = if i % 7 == up { 0 } else { state::EXISTS };
                block.values[i] = (i as f32 * 1.7 + up as f32).sin() * 1e20;
            }
        }
        brick
    }

    #[test]
    fn what_is_encoded_is_decoded() {
        for (edge, blocks) in [(8, 1), (16, 2), (32, 7)] {
            let shape = BrickShape::new(edge).unwrap();
            let brick = sample(shape, blocks);
            let mut decoder = Decoder::new().unwrap();
            let payload = Encoder::new().unwrap().encode(&brick).unwrap();
            let Payload { parts, errors } = payload;
            assert!(errors[0] > 3e-3 && errors[0] < 4e-3 && errors[1] > 1e-5 && errors[1] < 2e-5);
            decoder.stored = parts;
            let mut decoded = RawBrick::default();
            decoder.decode(shape, blocks, &mut decoded).unwrap();
            assert_eq!(decoded, brick);
            assert!(decoder.decode(shape, blocks + 1, &mut decoded).is_err());
            for precision in [Precision::Medium, Precision::Short] {
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
            block.values.iter_mut().for_each(|value| *value = value.signum() * 1.5);
            block.values[3] = f32::NAN;
        }
        let payload = Encoder::new().unwrap().encode(&brick).unwrap();
        let lengths = payload.parts.each_ref().map(Vec::len);
        assert!(payload.errors == [0.0; 2] && lengths[0] > 0 && lengths[1..] == [0; 2]);
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
