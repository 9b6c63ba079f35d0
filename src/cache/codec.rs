//! Payload bytes: states as they are, values byte-shuffled, the whole zstd-compressed.

use super::brick::{Block, BrickShape, RawBrick, state};
use super::planes;

/// zstd level: what higher ones save on byte-shuffled floats is not worth their time.
const COMPRESSION_LEVEL: i32 = 1;

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

    /// The stored form of `brick`.
    ///
    /// # Errors
    /// What the codec says.
    pub fn encode(&mut self, brick: &RawBrick) -> std::io::Result<Vec<u8>> {
        let cells: usize = brick.blocks.iter().map(|block| block.values.len()).sum();
        self.raw.resize(5 * cells, 0);
        let (mut states, planes) = self.raw.split_at_mut(cells);
        for block in &brick.blocks {
            let (of_block, rest) = states.split_at_mut(block.states.len());
            of_block.copy_from_slice(&block.states);
            states = rest;
        }
        let (low, high) = planes.split_at_mut(2 * cells);
        let ((mut a, mut b), (mut c, mut d)) = (low.split_at_mut(cells), high.split_at_mut(cells));
        for Block { values, .. } in &brick.blocks {
            let parts = [a, b, c, d].map(|plane| plane.split_at_mut(values.len()));
            let [(a0, a1), (b0, b1), (c0, c1), (d0, d1)] = parts;
            planes::split(values, [a0, b0, c0, d0]);
            (a, b, c, d) = (a1, b1, c1, d1);
        }
        self.stored.clear();
        self.stored.reserve(stored_bytes_limit(self.raw.len()));
        self.context.compress_to_buffer(&self.raw, &mut self.stored)?;
        // What is kept takes no more room than it needs.
        Ok(self.stored.as_slice().to_vec())
    }
}

/// Decompresses payloads; holds the codec's context and buffers for one thread.
pub struct Decoder {
    context: zstd::bulk::Decompressor<'static>,
    pub(super) stored: Vec<u8>,
    raw: Vec<u8>,
}

impl Decoder {
    /// A codec context for one thread.
    ///
    /// # Errors
    /// What the codec says when it cannot be set up.
    pub fn new() -> std::io::Result<Self> {
        Ok(Self { context: zstd::bulk::Decompressor::new()?, stored: Vec::new(), raw: Vec::new() })
    }

    /// Most bytes that a decoder holds for bricks of `shape` with up to `blocks` blocks: stored
    /// and raw payload, and the codec's own context.
    pub fn bytes(shape: BrickShape, blocks: usize) -> u64 {
        let raw = shape.payload_bytes(blocks);
        (raw + stored_bytes_limit(raw)) as u64 + (192 << 10)
    }

    /// Decodes `self.stored` into `brick`; the reason where it is not `blocks` blocks of `shape`.
    pub(super) fn decode(
        &mut self,
        shape: BrickShape,
        blocks: usize,
        brick: &mut RawBrick,
    ) -> Result<(), &'static str> {
        let expected = shape.payload_bytes(blocks);
        self.raw.clear();
        self.raw.reserve_exact(expected);
        let length = self
            .context
            .decompress_to_buffer(&self.stored, &mut self.raw)
            .map_err(|_| "the compressed bytes cannot be decoded")?;
        if length != expected {
            return Err("the payload decodes to another length than its brick needs");
        }
        brick.reset(shape, blocks);
        let cells = shape.cells_in_blocks(blocks);
        let (states, planes) = self.raw.split_at(cells);
        unpack(states, planes, brick)
    }
}

/// Most bytes that a payload of `raw` bytes may take when stored (zstd's own bound).
pub(super) fn stored_bytes_limit(raw: usize) -> usize {
    zstd::zstd_safe::compress_bound(raw)
}

fn unpack(states: &[u8], planes: &[u8], brick: &mut RawBrick) -> Result<(), &'static str> {
    if !state::are_valid(states) {
        return Err("a cell's state is none that there is");
    }
    let cells = states.len();
    let mut start = 0;
    for block in &mut brick.blocks {
        let end = start + block.states.len();
        block.states.copy_from_slice(&states[start..end]);
        let plane = |n: usize| &planes[n * cells + start..n * cells + end];
        planes::join([plane(0), plane(1), plane(2), plane(3)], &mut block.values);
        start = end;
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
            decoder.stored = Encoder::new().unwrap().encode(&brick).unwrap();
            let mut decoded = RawBrick::default();
            decoder.decode(shape, blocks, &mut decoded).unwrap();
            assert_eq!(decoded, brick);
            assert!(decoder.decode(shape, blocks + 1, &mut decoded).is_err());
        }
    }

    #[test]
    fn impossible_states_are_refused() {
        let shape = BrickShape::new(8).unwrap();
        let mut brick = sample(shape, 1);
        brick.blocks[0].states[5] = state::REFINED;
        let mut decoder = Decoder::new().unwrap();
        decoder.stored = Encoder::new().unwrap().encode(&brick).unwrap();
        assert!(decoder.decode(shape, 1, &mut RawBrick::default()).is_err());
    }
}
