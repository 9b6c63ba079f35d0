//! Bricks between the passes, as bytes: states as runs, and values of those cells only that exist.

use super::assemble::FieldCells;
use crate::cache::{BrickShape, state};
use crate::{Error, Result};

/// Appends one field of a brick to `bytes`.
pub(super) fn pack(field: &FieldCells, bytes: &mut Vec<u8>) {
    bytes.extend_from_slice(&field.exponent.to_le_bytes());
    for run in field.states.chunk_by(|a, b| a == b) {
        // A brick has at most 32³ cells.
        let length = u16::try_from(run.len()).unwrap_or(u16::MAX);
        bytes.push(run[0]);
        bytes.extend_from_slice(&length.to_le_bytes());
    }
    let mut values = field.values.as_slice();
    for run in field.states.chunk_by(|a, b| a == b) {
        let (of_run, rest) = values.split_at(run.len());
        if run[0] & state::EXISTS != 0 {
            let start = bytes.len();
            bytes.resize(start + 4 * of_run.len(), 0);
            for (word, value) in bytes[start..].chunks_exact_mut(4).zip(of_run) {
                word.copy_from_slice(&value.to_le_bytes());
            }
        }
        values = rest;
    }
}

/// Takes one field of a brick of `shape` off the front of `bytes`, which [`pack`] has made.
///
/// # Errors
/// Bytes that another program has changed.
pub(super) fn unpack(shape: BrickShape, bytes: &mut &[u8]) -> Result<FieldCells> {
    let changed = || Error::request("temporary data were changed by another program");
    let exponent = i32::from_le_bytes(*take(bytes).ok_or_else(changed)?);
    let mut states = Vec::with_capacity(shape.cells());
    let mut runs = *bytes;
    while states.len() < shape.cells() {
        let [bits, low, high] = *take(bytes).ok_or_else(changed)?;
        let length = usize::from(u16::from_le_bytes([low, high]));
        if length == 0 || states.len() + length > shape.cells() {
            return Err(changed());
        }
        states.resize(states.len() + length, bits);
    }
    runs = &runs[..runs.len() - bytes.len()];
    let mut values = Vec::with_capacity(shape.cells());
    for run in runs.chunks_exact(3) {
        let length = usize::from(u16::from_le_bytes([run[1], run[2]]));
        if run[0] & state::EXISTS == 0 {
            values.resize(values.len() + length, 0.0);
            continue;
        }
        let (words, rest) = bytes.split_at_checked(4 * length).ok_or_else(changed)?;
        let words = words.as_chunks::<4>().0;
        values.extend(words.iter().map(|&word| f32::from_le_bytes(word)));
        *bytes = rest;
    }
    Ok(FieldCells { exponent, states, values })
}

fn take<'b, const N: usize>(bytes: &mut &'b [u8]) -> Option<&'b [u8; N]> {
    let (first, rest) = bytes.split_first_chunk()?;
    *bytes = rest;
    Some(first)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_packed_comes_back_and_holes_take_no_room() {
        let shape = BrickShape::new(8).unwrap();
        let kinds = [0, state::EXISTS, state::EXISTS | state::REFINED, state::OUTSIDE];
        let states: Vec<u8> = (0..512).map(|at| kinds[at / 100 % 4]).collect();
        let value = |(at, bits): (usize, &u8)| match bits & state::EXISTS {
            0 => 0.0,
            _ => (at as f32 * 0.37).sin(),
        };
        let values = states.iter().enumerate().map(value).collect();
        let field = FieldCells { exponent: -3, states, values };
        let mut bytes = Vec::new();
        pack(&field, &mut bytes);
        pack(&field, &mut bytes);
        assert_eq!(bytes.len(), 2 * (4 + 6 * 3 + 4 * 212));
        let mut rest = bytes.as_slice();
        assert_eq!(unpack(shape, &mut rest).unwrap(), field);
        assert_eq!(unpack(shape, &mut rest).unwrap(), field);
        for cut in [0, 3, 5, 20, 21, 25, 600] {
            assert!(unpack(shape, &mut &bytes[..cut]).is_err(), "{cut}");
        }
    }
}
