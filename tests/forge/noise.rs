//! Numbers that look random and are the same in every run.

// Each program uses only a part of it.
#![allow(dead_code)]

/// xorshift (Marsaglia 2003).
pub(crate) struct Noise(u64);

impl Noise {
    /// Another sequence for every seed.
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    /// Any number.
    pub(crate) fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// A number below `limit`; 0 for none.
    pub(crate) fn below(&mut self, limit: usize) -> usize {
        (self.next() >> 11) as usize % limit.max(1)
    }

    /// One of `choices`.
    pub(crate) fn pick<'c, T>(&mut self, choices: &'c [T]) -> &'c T {
        &choices[self.below(choices.len())]
    }

    /// Flips, replaces, cuts, doubles or moves some bytes; at least one byte changes.
    pub(crate) fn damage(&mut self, original: &[u8]) -> Vec<u8> {
        let mut bytes = original.to_vec();
        while bytes == original {
            for _ in 0..=self.below(3) {
                self.damage_once(&mut bytes);
            }
        }
        bytes
    }

    fn damage_once(&mut self, bytes: &mut Vec<u8>) {
        let at = self.below(bytes.len());
        let run = 1 + self.below(4096.min(bytes.len() - at));
        match self.below(8) {
            0 => bytes.truncate(at.max(1)),
            1 => bytes.extend_from_within(at..at + run),
            2 => bytes[at..at + run].fill(0),
            3 => {
                let from = self.below(bytes.len() - run + 1);
                bytes.copy_within(from..from + run, at);
            }
            4 => bytes[at] = self.next() as u8,
            _ => bytes[at] ^= 1 << self.below(8),
        }
    }
}
