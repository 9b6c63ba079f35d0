//! What a payload's parts hold before compression: states and values' leading 16 bits, then two times
//! four bits more, then the lowest byte. All but the last hold differences from what preceding cells
//! predict, digit by digit.

use super::brick::{Block, RawBrick, state};
use super::digits::{PARTS, code, decode};
use super::lorenzo;
use crate::lanes::{Kernel, Lanes, Width};

/// What is wrong with a part that is too short or too long.
pub(super) const OTHER_LENGTH: &str = "the payload decodes to another length than its brick needs";

/// Bytes of part `part` of a payload of `cells` cells.
pub fn bytes(part: usize, cells: usize) -> usize {
    match part {
        0 => 3 * cells,
        // Four bits of each.
        1 | 2 => cells.div_ceil(2),
        _ => cells,
    }
}

/// The digits of the first three parts in one number, which are added and subtracted together: the upper
/// half, and four bits in each of two bytes, with room beside them for what is carried.
mod word {
    const DIGITS: u32 = 0xffff_0f0f;
    const CARRIES: u32 = 0x0000_1010;

    /// Where the digits of parts 1 and 2 lie.
    pub(super) const SHIFTS: [u32; 2] = [8, 0];

    #[inline(always)]
    pub(super) fn of_coded(coded: u32) -> u32 {
        coded & 0xffff_0000 | coded >> 4 & 0xf00 | coded >> 8 & 0xf
    }

    /// Coded bits without the lowest byte.
    #[inline(always)]
    pub(super) fn coded(word: u32) -> u32 {
        word & 0xffff_0000 | (word & 0xf00) << 4 | (word & 0xf) << 8
    }

    /// Digit by digit; what is carried out of one is lost.
    #[inline(always)]
    pub(super) fn add(a: u32, b: u32) -> u32 {
        a.wrapping_add(b) & DIGITS
    }

    /// The reverse.
    #[inline(always)]
    pub(super) fn subtract(a: u32, b: u32) -> u32 {
        (a | CARRIES).wrapping_sub(b) & DIGITS
    }
}

/// Takes payloads apart; holds one thread's scratch.
#[derive(Debug, Default)]
pub struct Splitter {
    coded: Vec<u32>,
    words: Vec<u32>,
}

impl Splitter {
    /// Puts what the parts of `brick`'s payload hold into `parts`. Of cells that do not exist no value is
    /// kept.
    pub fn split(&mut self, brick: &RawBrick, parts: &mut [Vec<u8>; PARTS]) {
        self.split_by(Width::best(), brick, parts);
    }

    fn split_by(&mut self, width: Width, brick: &RawBrick, parts: &mut [Vec<u8>; PARTS]) {
        width.run(Split { splitter: self, brick, parts });
    }

    #[inline(always)]
    fn split_here(&mut self, brick: &RawBrick, parts: &mut [Vec<u8>; PARTS]) {
        let cells: usize = brick.blocks.iter().map(|block| block.values.len()).sum();
        for (part, held) in parts.iter_mut().enumerate() {
            held.resize(bytes(part, cells), 0);
        }
        self.words.resize(cells, 0);
        let [upper, halves @ .., lowest] = parts;
        let (states, planes) = upper.split_at_mut(cells);
        let (low, high) = planes.split_at_mut(cells);
        let mut start = 0;
        for block in &brick.blocks {
            let own = start..start + block.values.len();
            start = own.end;
            states[own.clone()].copy_from_slice(&block.states);
            self.code(block);
            for (byte, coded) in lowest[own.clone()].iter_mut().zip(&self.coded) {
                *byte = *coded as u8;
            }
            let words = &mut self.words[own];
            for (word, coded) in words.iter_mut().zip(&self.coded) {
                *word = word::of_coded(*coded);
            }
            lorenzo::differences(words, block.side, word::subtract);
        }
        self.pack(low, high, halves);
    }

    /// Differences of all cells as parts hold them.
    #[inline(always)]
    fn pack(&self, low: &mut [u8], high: &mut [u8], halves: &mut [Vec<u8>]) {
        for ((low, high), word) in low.iter_mut().zip(high).zip(&self.words) {
            [*low, *high] = folded((word >> 16) as u16).to_le_bytes();
        }
        for (shift, half) in word::SHIFTS.into_iter().zip(halves) {
            for (byte, pair) in half.iter_mut().zip(self.words.chunks(2)) {
                let digit =
                    |cell: usize| pair.get(cell).map_or(0, |word| (word >> shift) as u8 & 15);
                *byte = digit(0) | digit(1) << 4;
            }
        }
    }

    /// The coded values of a block; where there is none, one that costs little.
    #[inline(always)]
    fn code(&mut self, block: &Block) {
        self.coded.clear();
        self.coded.extend(block.values.iter().map(|value| code(*value)));
        let exists = |at: usize| block.states[at] & state::EXISTS != 0;
        lorenzo::fill(&mut self.coded, block.side, exists);
    }
}

/// 0, −1, 1, −2, 2, … as 0, 1, 2, 3, 4, …: numbers of either sign that are small have high bytes of 0.
#[inline(always)]
fn folded(difference: u16) -> u16 {
    difference << 1 ^ 0u16.wrapping_sub(difference >> 15)
}

#[inline(always)]
fn unfolded(folded: u16) -> u16 {
    folded >> 1 ^ 0u16.wrapping_sub(folded & 1)
}

/// Puts payloads together; holds one thread's scratch.
#[derive(Debug, Default)]
pub struct Joiner {
    words: Vec<u32>,
    digits: Vec<u8>,
}

impl Joiner {
    /// Most bytes that it holds for payloads of `cells` cells.
    pub(super) fn bytes(cells: usize) -> usize {
        (size_of::<u32>() + size_of::<u8>()) * (cells + 1)
    }

    /// Puts what `parts` hold into `brick`, which is set up for it; parts that are left out are empty.
    /// Cells that do not exist have the value 0.
    ///
    /// # Errors
    /// The reason: parts of another length than the brick needs, or states that there are not.
    pub fn join(
        &mut self,
        parts: [&[u8]; PARTS],
        brick: &mut RawBrick,
    ) -> Result<(), &'static str> {
        let cells: usize = brick.blocks.iter().map(|block| block.values.len()).sum();
        let fits = |(part, held): (usize, &&[u8])| {
            held.len() == bytes(part, cells) || part > 0 && held.is_empty()
        };
        if !parts.iter().enumerate().all(fits) {
            return Err(OTHER_LENGTH);
        }
        let states = &parts[0][..cells];
        if !state::are_valid(states) {
            return Err("a cell's state is none that there is");
        }
        self.join_by(Width::best(), parts, brick);
        Ok(())
    }

    fn join_by(&mut self, width: Width, parts: [&[u8]; PARTS], brick: &mut RawBrick) {
        width.run(Join { joiner: self, parts, brick });
    }

    /// Bytes that it holds.
    #[cfg(test)]
    pub(super) fn capacity(&self) -> usize {
        size_of::<u32>() * self.words.capacity() + self.digits.capacity()
    }

    #[inline(always)]
    fn join_here(&mut self, [upper, halves @ .., lowest]: [&[u8]; PARTS], brick: &mut RawBrick) {
        let cells = upper.len() / 3;
        let (states, planes) = upper.split_at(cells);
        self.differences(planes, halves);
        let mut start = 0;
        for block in &mut brick.blocks {
            let own = start..start + block.values.len();
            start = own.end;
            let words = &mut self.words[own.clone()];
            lorenzo::sums(words, block.side, word::add);
            block.states.copy_from_slice(&states[own.clone()]);
            let cells = words.iter().zip(&block.states).zip(&mut block.values);
            match lowest.get(own) {
                Some(lowest) => {
                    for (((word, bits), value), byte) in cells.zip(lowest) {
                        *value = existing(word::coded(*word) | u32::from(*byte), *bits);
                    }
                }
                None => cells.for_each(|((word, bits), value)| {
                    *value = existing(word::coded(*word), *bits);
                }),
            }
        }
    }

    /// Words of differences of all cells.
    #[inline(always)]
    fn differences(&mut self, planes: &[u8], halves: [&[u8]; 2]) {
        let (low, high) = planes.split_at(planes.len() / 2);
        resize(&mut self.words, low.len());
        for ((word, low), high) in self.words.iter_mut().zip(low).zip(high) {
            *word = u32::from(unfolded(u16::from_le_bytes([*low, *high]))) << 16;
        }
        for (shift, half) in word::SHIFTS.into_iter().zip(halves).filter(|half| !half.1.is_empty())
        {
            resize(&mut self.digits, 2 * half.len());
            for (pair, byte) in self.digits.chunks_exact_mut(2).zip(half) {
                let byte = u16::from(*byte);
                pair.copy_from_slice(&(byte & 0xf | (byte & 0xf0) << 4).to_le_bytes());
            }
            for (word, digit) in self.words.iter_mut().zip(&self.digits) {
                *word |= u32::from(*digit) << shift;
            }
        }
    }
}

/// Makes `numbers` so long, in no more memory than that takes.
fn resize<T: Copy + Default>(numbers: &mut Vec<T>, length: usize) {
    numbers.reserve_exact(length.saturating_sub(numbers.len()));
    numbers.resize(length, T::default());
}

/// The value of coded bits in a cell that exists, else 0.
#[inline(always)]
fn existing(coded: u32, bits: u8) -> f32 {
    let kept = 0u32.wrapping_sub(u32::from(bits & state::EXISTS));
    f32::from_bits(decode(coded).to_bits() & kept)
}

/// [`Splitter::split`], compiled for the processor that the lanes are of.
struct Split<'s> {
    splitter: &'s mut Splitter,
    brick: &'s RawBrick,
    parts: &'s mut [Vec<u8>; PARTS],
}

impl Kernel for Split<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, _: L) {
        self.splitter.split_here(self.brick, self.parts);
    }
}

/// [`Joiner::join`], likewise.
struct Join<'j> {
    joiner: &'j mut Joiner,
    parts: [&'j [u8]; PARTS],
    brick: &'j mut RawBrick,
}

impl Kernel for Join<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, _: L) {
        self.joiner.join_here(self.parts, self.brick);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_added_and_subtracted_each_for_itself() {
        let noise = |n: u32| n.wrapping_mul(0x9e37_79b9) ^ n << 7;
        for (a, b) in (0..10_000).map(|n| (noise(n), noise(n + 77_777))) {
            let digits = |coded: u32| [coded >> 16, coded >> 12 & 15, coded >> 8 & 15];
            let both = |of: fn(u32, u32) -> u32| {
                let pairs = digits(a).into_iter().zip(digits(b)).zip([0xffff, 15, 15]);
                pairs.map(|((a, b), all)| of(a, b) & all).collect::<Vec<_>>()
            };
            let [one, other] = [a, b].map(word::of_coded);
            assert_eq!(word::coded(one), a & !0xff);
            let [sum, difference] = [word::add(one, other), word::subtract(one, other)];
            assert_eq!(digits(word::coded(sum))[..], both(u32::wrapping_add));
            assert_eq!(digits(word::coded(difference))[..], both(u32::wrapping_sub));
        }
    }

    /// The values of a payload's blocks in their digits, cell by cell.
    fn plain_join(parts: [&[u8]; PARTS], brick: &RawBrick) -> Vec<Vec<u32>> {
        let cells = parts[0].len() / 3;
        let mut start = 0;
        let mut join = |side: usize| {
            let mut values = vec![0; side.pow(3)];
            for (lowest, bits, part) in [(16, 16, 0), (12, 4, 1), (8, 4, 2), (0, 8, 3)] {
                let difference = |cell: usize| -> u32 {
                    match part {
                        _ if parts[part].is_empty() => 0,
                        0 => {
                            let [low, high] = [cells, 2 * cells].map(|p| parts[0][p + cell]);
                            unfolded(u16::from_le_bytes([low, high])).into()
                        }
                        3 => parts[3][cell].into(),
                        _ => u32::from(parts[part][cell / 2] >> (4 * (cell % 2)) & 15),
                    }
                };
                let mut digits: Vec<u32> = (start..start + values.len()).map(difference).collect();
                for axis in [1, side, side * side].into_iter().filter(|_| part < 3) {
                    for at in (0..digits.len()).filter(|at| at / axis % side > 0) {
                        digits[at] = digits[at].wrapping_add(digits[at - axis]);
                    }
                }
                for (value, digit) in values.iter_mut().zip(digits) {
                    *value |= (digit & ((1 << bits) - 1)) << lowest;
                }
            }
            start += values.len();
            values
        };
        brick.blocks.iter().map(|block| join(block.side)).collect()
    }

    #[test]
    fn payloads_are_taken_apart_and_put_together_alike_in_all_widths() {
        // An odd number of cells, some without a value, and all kinds of these.
        let block = |side: usize| {
            let noise = |n: usize| (n as u32).wrapping_mul(0x9e37_79b9) ^ side as u32;
            let exists = |n: &usize| n % 11 != 3 && n / 50 != 2;
            let value = |n| if exists(&n) { f32::from_bits(noise(n) & 0x7eff_ffff) } else { 0.0 };
            let states = (0..side.pow(3)).map(|n| if exists(&n) { state::EXISTS } else { 0 });
            Block { side, values: (0..side.pow(3)).map(value).collect(), states: states.collect() }
        };
        let brick = RawBrick { blocks: [10, 6, 4, 3].map(block).to_vec() };
        let mut first: Option<[Vec<u8>; PARTS]> = None;
        for width in Width::all() {
            let mut parts: [Vec<u8>; PARTS] = Default::default();
            Splitter::default().split_by(width, &brick, &mut parts);
            assert_eq!(first.get_or_insert_with(|| parts.clone()), &parts, "{width:?}");
            for read in 1..=PARTS {
                let mut some = [&[][..]; PARTS];
                for (some, part) in some.iter_mut().zip(&parts).take(read) {
                    *some = part;
                }
                let mut joined = brick.clone();
                joined.blocks.iter_mut().for_each(|block| block.values.fill(7.0));
                Joiner::default().join_by(width, some, &mut joined);
                let plain = plain_join(some, &brick);
                for ((block, plain), sound) in joined.blocks.iter().zip(plain).zip(&brick.blocks) {
                    assert_eq!(block.states, sound.states);
                    for ((value, coded), bits) in block.values.iter().zip(plain).zip(&block.states)
                    {
                        let expected = if *bits == 0 { 0.0 } else { decode(coded) };
                        assert_eq!(value.to_bits(), expected.to_bits(), "{width:?}, {read} parts");
                    }
                }
                assert!(read < PARTS || joined == brick);
            }
        }
    }

    #[test]
    fn small_differences_of_either_sign_have_high_bytes_of_zero() {
        for difference in -128i16..128 {
            assert!(folded(difference as u16) < 256);
        }
        assert!((0..=u16::MAX).all(|difference| unfolded(folded(difference)) == difference));
    }
}
