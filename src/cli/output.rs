//! What a program may read: standard output.

use std::io::{BufWriter, ErrorKind, Stdout, Write};

use crate::{Error, Result};

/// Standard output, buffered; errors come back instead of panics.
pub(super) struct Output {
    writer: BufWriter<Stdout>,
}

impl Output {
    /// Standard output of this process.
    pub(super) fn new() -> Self {
        Self { writer: BufWriter::new(std::io::stdout()) }
    }

    /// Prints a line.
    pub(super) fn line(&mut self, line: impl std::fmt::Display) -> Result<()> {
        writeln!(self.writer, "{line}").map_err(failed)
    }

    /// Everything is printed.
    pub(super) fn finish(mut self) -> Result<()> {
        self.writer.flush().map_err(failed)
    }
}

fn failed(source: std::io::Error) -> Error {
    Error::io("standard output", "cannot write", source)
}

/// Whether a reader of our output went away, as `head` does.
pub(super) fn is_closed_pipe(error: &Error) -> bool {
    matches!(error, Error::Io { source, .. } if source.kind() == ErrorKind::BrokenPipe)
}
