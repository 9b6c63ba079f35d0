//! `deepfield probe`.

use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::path::PathBuf;

use clap::Args;

use super::fields;
use super::output::Output;
use super::verify::WINDOWS;
use crate::cache::Cache;
use crate::render::Probe;
use crate::scene::Interpolation;
use crate::space::{AXES, Decimal};
use crate::{Error, Result};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The cache
    cache: PathBuf,
    /// The field
    #[arg(long, value_name = "NAME")]
    field: String,
    /// CSV with a header `x,y,z` and positions in code length
    #[arg(long, value_name = "FILE.csv")]
    points: PathBuf,
    /// The cell's own value, or the interpolant
    #[arg(long, value_enum, default_value = "cell")]
    interpolation: Choice,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Choice {
    Cell,
    Linear,
}

/// Longest line of a file of points, bytes: positions may have many digits, but a file that is
/// none must not be read into memory as one line.
const LONGEST_LINE: usize = 1 << 20;

/// A file whose lines are all at most [`LONGEST_LINE`] long. Between quotes lines do not end.
struct ShortLines {
    file: File,
    /// Bytes since the last line end.
    length: usize,
    is_quoted: bool,
}

impl Read for ShortLines {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.file.read(buffer)?;
        let mut longest = 0;
        for &byte in &buffer[..count] {
            self.is_quoted ^= byte == b'"';
            let is_end = matches!(byte, b'\n' | b'\r') && !self.is_quoted;
            self.length = if is_end { 0 } else { self.length + 1 };
            longest = longest.max(self.length);
        }
        if longest > LONGEST_LINE {
            let reason = format!("a line is longer than {LONGEST_LINE} bytes");
            return Err(io::Error::new(ErrorKind::InvalidData, reason));
        }
        Ok(count)
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let cache = Cache::open(&arguments.cache, WINDOWS)?;
    let interpolation = match arguments.interpolation {
        Choice::Cell => Interpolation::Cell,
        Choice::Linear => Interpolation::Linear,
    };
    fields::check(&arguments.field, &cache)?;
    let mut probe = Probe::new(&cache, &arguments.field, interpolation)?;
    let file = File::open(&arguments.points)
        .map_err(|source| Error::io(&arguments.points, "cannot read the points", source))?;
    let lines = ShortLines { file, length: 0, is_quoted: false };
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(lines);
    check_title(arguments, &mut reader)?;
    let mut output = Output::new();
    output.line("x,y,z,level,value")?;
    let mut record = csv::StringRecord::new();
    while reader.read_record(&mut record).map_err(|error| unreadable(arguments, &error))? {
        let line = record.position().map_or(0, csv::Position::line);
        let point =
            parse(&record).map_err(|error| wrong(arguments, &format!("line {line}: {error}")))?;
        let (level, value) = match probe.at(&point)? {
            Some(found) => (i64::from(found.level), found.value),
            None => (-1, f64::NAN),
        };
        let [x, y, z] = [0, 1, 2].map(|column| record.get(column).unwrap_or(""));
        let value = if value.is_nan() { "nan".to_owned() } else { format!("{value:?}") };
        output.line(format!("{x},{y},{z},{level},{value}"))?;
    }
    output.finish()
}

fn check_title(arguments: &Arguments, reader: &mut csv::Reader<ShortLines>) -> Result<()> {
    let title = reader.headers().map_err(|error| unreadable(arguments, &error))?;
    if title.iter().eq(AXES) {
        return Ok(());
    }
    Err(wrong(arguments, "the first line must be `x,y,z`"))
}

fn parse(record: &csv::StringRecord) -> Result<[Decimal; 3]> {
    let column = |i: usize| Decimal::parse(record.get(i).unwrap_or(""));
    Ok([column(0)?, column(1)?, column(2)?])
}

/// What is wrong with a line that is none of the table's.
fn unreadable(arguments: &Arguments, error: &csv::Error) -> Error {
    let line = error.position().map_or(0, csv::Position::line);
    let reason = match error.kind() {
        csv::ErrorKind::UnequalLengths { len, .. } => {
            format!("line {line}: it has {len} columns; each line is `x,y,z`")
        }
        csv::ErrorKind::Utf8 { .. } => format!("line {line}: it is no UTF-8 text"),
        _ => error.to_string(),
    };
    wrong(arguments, &reason)
}

fn wrong(arguments: &Arguments, reason: &str) -> Error {
    Error::invalid(arguments.points.display(), reason)
}
