//! FABs: the arrays of a grid's values, and the line of text before each.

use super::text::{PrintedBox, numbers};
use crate::source::lines::shown;
use crate::source::open_file::OpenFile;
use crate::source::raw::Number;
use crate::space::IndexBox;
use crate::{Error, Result};

/// Longest line before a FAB's data.
const LONGEST_HEADER: usize = 1024;
/// AMReX's description of 32-bit and 64-bit IEEE floats: bits in all, of exponent and mantissa,
/// where sign, exponent and mantissa begin, whether a mantissa's first bit is stored, bias.
const FLOAT: [i64; 8] = [32, 8, 23, 0, 1, 9, 0, 127];
const DOUBLE: [i64; 8] = [64, 11, 52, 0, 1, 12, 0, 1023];

/// What the line before a FAB's data says.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct FabHeader {
    /// Cells of the array, ghost cells included.
    pub(super) cells: IndexBox,
    /// Components, one array each.
    pub(super) components: u64,
    /// How numbers are stored.
    pub(super) number: Number,
    /// Where the data begin in the file, bytes.
    pub(super) start: u64,
}

impl FabHeader {
    /// Reads the line at `offset` of `file`.
    ///
    /// # Errors
    /// A line that is missing, malformed or describes numbers that cannot be read.
    pub(super) fn read(file: &OpenFile, offset: u64) -> Result<Self> {
        let fault = |reason: String| {
            Error::invalid(format!("{}: byte {offset}", file.path().display()), reason)
        };
        let mut bytes = [0; LONGEST_HEADER];
        let mut filled = 0;
        while filled < bytes.len() {
            let at = offset.checked_add(filled as u64);
            let at = at.ok_or_else(|| fault("lies outside the file".to_owned()))?;
            match file.read_at(&mut bytes[filled..], at)? {
                0 => break,
                read => filled += read,
            }
        }
        let Some(end) = bytes[..filled].iter().position(|&byte| byte == b'\n') else {
            let reason = "no FAB's header is there: is the file truncated, or not the Cell_H's?";
            return Err(fault(reason.to_owned()));
        };
        let line = String::from_utf8_lossy(&bytes[..end]);
        let (cells, components, number) = parse(&line).map_err(fault)?;
        Ok(Self { cells, components, number, start: offset + end as u64 + 1 })
    }
}

/// Cells, components and numbers of the line
/// `FAB ((8, (64 11 52 0 1 12 0 1023)),(8, (8 7 6 5 4 3 2 1)))((0,0,0) (7,7,7) (0,0,0)) 2`.
fn parse(line: &str) -> Result<(IndexBox, u64, Number), String> {
    if line.starts_with("FAB:") {
        return Err(format!(
            "`{}` is a FAB in ASCII, 8 bits or another format that no longer names its numbers: \
             only 32-bit and 64-bit floats can be read; set fab.format = NATIVE or NATIVE_32 in \
             the run",
            shown(line)
        ));
    }
    let malformed = || format!("`{}` is no FAB's header", shown(line));
    let numbers = line.strip_prefix("FAB").and_then(numbers).ok_or_else(malformed)?;
    let (number, rest) = take_number(&numbers).ok_or_else(malformed)?;
    let [cells @ .., components] = rest else { return Err(malformed()) };
    let printed = PrintedBox::from_numbers(cells).ok_or_else(malformed)?;
    printed.size()?;
    let components = u64::try_from(*components).map_err(|_| malformed())?;
    Ok((printed.cells, components, number?))
}

/// How numbers are stored, by a description as AMReX prints it:
/// `((8, (64 11 52 0 1 12 0 1023)),(8, (8 7 6 5 4 3 2 1)))`.
///
/// # Errors
/// The reason, where it is malformed or not of 32-bit or 64-bit IEEE floats.
pub(super) fn described(text: &str) -> Result<Number, String> {
    let malformed = || format!("`{}` does not describe numbers", shown(text));
    let numbers = numbers(text).ok_or_else(malformed)?;
    match take_number(&numbers) {
        Some((number, [])) => number,
        _ => Err(malformed()),
    }
}

/// The description that `numbers` begin with, and what follows it.
fn take_number(numbers: &[i64]) -> Option<(Result<Number, String>, &[i64])> {
    let (format, rest) = take_list(numbers)?;
    let (order, rest) = take_list(rest)?;
    let rising = |count: i64| order.iter().copied().eq(1..=count);
    let falling = |count: i64| order.iter().rev().copied().eq(1..=count);
    let number = match (format == FLOAT, format == DOUBLE) {
        (true, _) if rising(4) => Ok(Number::F32Big),
        (true, _) if falling(4) => Ok(Number::F32Little),
        (_, true) if rising(8) => Ok(Number::F64Big),
        (_, true) if falling(8) => Ok(Number::F64Little),
        (false, false) => Err(format!(
            "numbers of format {format:?}: only IEEE floats of 32 ({FLOAT:?}) and 64 bits \
             ({DOUBLE:?}) can be read"
        )),
        _ => Err(format!(
            "bytes in the order {order:?}: only rising (big-endian) and falling (little-endian) \
             orders can be read"
        )),
    };
    Some((number, rest))
}

/// The list that `numbers` begin with, after its length, and what follows it.
fn take_list(numbers: &[i64]) -> Option<(&[i64], &[i64])> {
    let (&count, rest) = numbers.split_first()?;
    rest.split_at_checked(usize::try_from(count).ok()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    const LINE: &str = "FAB ((8, (64 11 52 0 1 12 0 1023)),(8, (8 7 6 5 4 3 2 1)))\
        ((-1,0,2) (7,7,7) (0,0,0)) 3";

    #[test]
    fn every_encoding_that_amrex_writes_today_is_understood() {
        let cells = IndexBox { lo: [-1, 0, 2], hi: [8; 3] };
        assert_eq!(parse(LINE), Ok((cells, 3, Number::F64Little)));
        let big = LINE.replace("8 7 6 5 4 3 2 1", "1 2 3 4 5 6 7 8");
        assert_eq!(parse(&big), Ok((cells, 3, Number::F64Big)));
        let float =
            |order: &str| described(&format!("((8, (32 8 23 0 1 9 0 127)),(4, ({order})))"));
        assert_eq!(float("1 2 3 4"), Ok(Number::F32Big));
        assert_eq!(float("4 3 2 1"), Ok(Number::F32Little));
    }

    #[test]
    fn other_encodings_are_refused_by_name() {
        for (from, to, expected) in [
            ("8 7 6 5 4 3 2 1", "2 1 4 3 6 5 8 7", "bytes in the order [2, 1, 4"),
            ("8, (8 7 6 5 4 3 2 1", "4, (4 3 2 1", "bytes in the order [4, 3, 2, 1]"),
            ("1023", "1024", "numbers of format [64"),
            ("FAB ", "FAB: ", "ASCII"),
            ("FAB ", "BAF ", "no FAB's header"),
            (" 3", "", "no FAB's header"),
            (" 3", " -3", "no FAB's header"),
            ("(8, (64", "(9, (64", "no FAB's header"),
            ("(8, (64", "(99999999999, (64", "no FAB's header"),
            ("(7,7,7)", "(7,7,1)", "make no box"),
            ("(0,0,0)) 3", "(1,1,1)) 3", "nodal"),
        ] {
            let error = parse(&LINE.replace(from, to)).unwrap_err();
            assert!(error.contains(expected), "{to}: {error}");
        }
    }
}
