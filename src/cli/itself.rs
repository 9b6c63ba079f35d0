//! This program's own commands, run as a user would.

use std::path::Path;
use std::process::{Command, ExitStatus, Output, Stdio};

use serde::de::DeserializeOwned;

use crate::{Error, Result};

/// One of this program's commands, with nothing to read.
///
/// # Errors
/// A system that does not say where the program lies.
pub(super) fn command() -> Result<Command> {
    let program = std::env::current_exe()
        .map_err(|source| Error::io("deepfield", "cannot find this program", source))?;
    let mut command = Command::new(program);
    command.stdin(Stdio::null());
    Ok(command)
}

/// What a command prints; all of it is held.
///
/// # Errors
/// A program that cannot be started, and what a failing one says, without its "error: ".
pub(super) fn run(command: &mut Command) -> Result<Output> {
    let outcome = command
        .output()
        .map_err(|source| Error::io(command.get_program(), "cannot start", source))?;
    if outcome.status.success() {
        Ok(outcome)
    } else {
        Err(failure(&String::from_utf8_lossy(&outcome.stderr), outcome.status))
    }
}

fn failure(said: &str, status: ExitStatus) -> Error {
    match said.lines().find_map(|line| line.strip_prefix("error: ")) {
        Some(reason) => Error::request(reason),
        None => Error::request(format!("a command ended without a word: {status}")),
    }
}

/// The statistics that a command has written.
///
/// # Errors
/// A file that is not there, or holds something else.
pub(super) fn read_stats<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let text =
        std::fs::read(path).map_err(|source| Error::io(path, "cannot read the stats", source))?;
    serde_json::from_slice(&text).map_err(|error| Error::invalid(path.display(), error.to_string()))
}
