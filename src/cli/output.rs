//! What a program may read: standard output.

use std::borrow::Cow;
use std::io::{BufWriter, ErrorKind, Stdout, Write};
use std::path::Path;

use super::progress::without_bar;
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
    pub(super) fn line(&mut self, line: impl AsRef<str>) -> Result<()> {
        writeln!(self.writer, "{}", harmless(line.as_ref())).map_err(failed)
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

/// Prints a line that begins with "warning: " to standard error, where no bar is in its way.
pub(super) fn warn(line: impl AsRef<str>) {
    without_bar(|| eprintln!("warning: {}", harmless(line.as_ref())));
}

/// `line` without control characters.
pub(super) fn harmless(line: &str) -> Cow<'_, str> {
    if line.contains(char::is_control) {
        Cow::Owned(line.replace(char::is_control, " "))
    } else {
        Cow::Borrowed(line)
    }
}

/// Makes a folder that is to hold output, and those around it.
///
/// # Errors
/// A file of that name, and what the system refuses to make.
pub(super) fn make_folder(path: &Path) -> Result<()> {
    check_folder(path)?;
    std::fs::create_dir_all(path)
        .map_err(|source| Error::io(path, "cannot make the folder", source))
}

/// Refuses what is no folder in the place of one that is to hold output.
///
/// # Errors
/// A file of that name.
pub(super) fn check_folder(path: &Path) -> Result<()> {
    if path.exists() && !path.is_dir() {
        let reason = "is a file, and a folder is needed: name another";
        return Err(Error::request(format!("{}: {reason}", path.display())));
    }
    Ok(())
}

fn failed(source: std::io::Error) -> Error {
    Error::io(STANDARD_OUTPUT, "cannot write", source)
}

/// Whether a reader of our output went away, as `head` does.
pub(super) fn is_closed_pipe(error: &Error) -> bool {
    matches!(error, Error::Io { path, source, .. }
        if path.as_os_str() == STANDARD_OUTPUT && source.kind() == ErrorKind::BrokenPipe)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_make_a_terminal_do_something() {
        assert_eq!(harmless("field \u{1b}[2Jρ\n\u{9b}x"), "field  [2Jρ  x");
        assert!(matches!(harmless("density"), Cow::Borrowed("density")));
    }

    #[test]
    fn only_a_reader_that_went_away_ends_well() {
        let broken = || std::io::Error::from(ErrorKind::BrokenPipe);
        assert!(is_closed_pipe(&failed(broken())));
        assert!(!is_closed_pipe(&Error::io("a.dfc", "cannot read", broken())));
        assert!(!is_closed_pipe(&failed(ErrorKind::StorageFull.into())));
    }
}
