//! Text of a simulation output, read line by line as a stream.

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use crate::{Error, Result, regular_file};

/// Longest line accepted.
const LONGEST_LINE: u64 = 1 << 16;

/// The lines of a text file.
pub(super) struct Lines {
    path: PathBuf,
    input: BufReader<File>,
    /// Number of the line read last, where reading began with the file's first.
    number: Option<u64>,
    offset: u64,
    buffer: Vec<u8>,
}

impl Lines {
    /// Opens the file at `path`.
    ///
    /// # Errors
    /// A file that cannot be opened.
    pub(super) fn open(path: &Path) -> Result<Self> {
        let file = regular_file::open(path).map_err(|e| Error::io(path, "cannot open", e))?;
        let input = BufReader::with_capacity(1 << 16, file);
        Ok(Self { path: path.to_owned(), input, number: Some(0), offset: 0, buffer: Vec::new() })
    }

    /// Opens the file at `path` where the line at byte `offset` begins.
    ///
    /// # Errors
    /// A file that cannot be opened.
    pub(super) fn open_at(path: &Path, offset: u64) -> Result<Self> {
        let mut lines = Self::open(path)?;
        let sought = lines.input.seek(SeekFrom::Start(offset));
        sought.map_err(|e| Error::io(path, "cannot read", e))?;
        (lines.number, lines.offset) = (None, offset);
        Ok(lines)
    }

    /// The next line, its end included; none at the end of the file.
    ///
    /// # Errors
    /// A file that cannot be read, or is no text: a line too long.
    pub(super) fn next(&mut self) -> Result<Option<String>> {
        self.buffer.clear();
        self.number = self.number.map(|number| number + 1);
        let read = (&mut self.input)
            .take(LONGEST_LINE)
            .read_until(b'\n', &mut self.buffer)
            .map_err(|e| Error::io(&self.path, "cannot read", e))?;
        if read as u64 == LONGEST_LINE {
            return Err(self.fault("is too long for a text file"));
        }
        self.offset += read as u64;
        Ok((read > 0).then(|| String::from_utf8_lossy(&self.buffer).into_owned()))
    }

    /// The next line, without blanks around it, which must hold `what`.
    ///
    /// # Errors
    /// What [`Self::next`] refuses, and the end of the file.
    pub(super) fn expect(&mut self, what: &str) -> Result<String> {
        match self.next()? {
            Some(line) => Ok(line.trim().to_owned()),
            None => Err(self.fault(&format!("the file ends before {what}: is it truncated?"))),
        }
    }

    /// The next line as `parse` understands it.
    ///
    /// # Errors
    /// What [`Self::expect`] refuses, and a line that is not understood.
    pub(super) fn parse<T>(
        &mut self,
        what: &str,
        parse: impl FnOnce(&str) -> Option<T>,
    ) -> Result<T> {
        let line = self.expect(what)?;
        parse(&line)
            .ok_or_else(|| self.fault(&format!("`{}` where {what} should stand", shown(&line))))
    }

    /// Where in the file the next line begins, in bytes.
    pub(super) fn offset(&self) -> u64 {
        self.offset
    }

    /// An error at the line read last.
    pub(super) fn fault(&self, reason: &str) -> Error {
        let place = self.path.display();
        match self.number {
            Some(number) => Error::invalid(format!("{place}: line {number}"), reason),
            None => Error::invalid(place, reason),
        }
    }
}

/// At most 60 characters of `text`, for messages.
pub(super) fn shown(text: &str) -> String {
    text.chars().filter(|c| !c.is_control()).take(60).collect()
}

/// Most digits that count: doubles are far from telling more.
const MOST_DIGITS: i32 = 300;

/// How many digits of the number `text` are printed, from the first that is not 0.
pub(super) fn printed_digits(text: &str) -> i32 {
    let mantissa = text.split(['e', 'E']).next().unwrap_or("");
    let printed = mantissa.trim_start_matches(['-', '+', '0', '.']).bytes();
    let printed = printed.filter(u8::is_ascii_digit).count();
    i32::try_from(printed).unwrap_or(i32::MAX).min(MOST_DIGITS)
}

/// Largest difference between `value`, printed as `text` by a code that prints `digits`, and the
/// number that the code held: half a unit of the last digit. Trailing zeros may not be printed,
/// so fewer digits don't mean a larger error; more do mean a smaller one.
pub(super) fn printing_error(text: &str, value: f64, digits: i32) -> f64 {
    if value == 0.0 {
        return 0.0;
    }
    let digits = printed_digits(text).clamp(digits, MOST_DIGITS);
    let leading = value.abs().log10().floor();
    0.5 * 10f64.powf(leading - f64::from(digits - 1))
}
