//! What a program may read: standard output.

use std::io::{BufWriter, ErrorKind, Stdout, Write};

use crate::{Error, Result};

/// What errors call it.
const STANDARD_OUTPUT: &str = "standard output";

/// Standard output, buffered; errors come back instead of panics.
pub(super) struct Output {
    writer: BufWriter<Stdout>,
}

impl Output {
    /// Standard output of this process.
    pub(super) fn new() -> Self {
        Self { writer: BufWriter::new(std::io::stdout()) }
    }

    /// Prints a line; characters that would make a terminal do something, as names out of files may
    /// hold them, are left blank.
    pub(super) fn line(&mut self, line: impl std::fmt::Display) -> Result<()> {
        writeln!(self.writer, "{}", harmless(&line.to_string())).map_err(failed)
    }

    /// Prints all lines of a text, and that is everything.
    pub(super) fn end_with(mut self, text: &str) -> Result<()> {
        text.lines().try_for_each(|line| self.line(line))?;
        self.finish()
    }

    /// Everything is printed.
    pub(super) fn finish(mut self) -> Result<()> {
        self.writer.flush().map_err(failed)
    }
}

/// Prints a line that begins with "warning: " to standard error.
pub(super) fn warn(line: impl std::fmt::Display) {
    eprintln!("warning: {}", harmless(&line.to_string()));
}

/// `line` without control characters.
pub(super) fn harmless(line: &str) -> String {
    line.replace(char::is_control, " ")
}

fn failed(source: std::io::Error) -> Error {
    Error::io(STANDARD_OUTPUT, "cannot write", source)
}

/// Whether a reader of our output went away, as `head` does.
pub(super) fn is_closed_pipe(error: &Error) -> bool {
    matches!(error, Error::Io { path, source, .. }
        if path.as_os_str() == STANDARD_OUTPUT && source.kind() == ErrorKind::BrokenPipe)
}
