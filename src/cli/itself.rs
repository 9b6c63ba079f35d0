//! This program's own commands, run as a user would.

use std::path::Path;
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};

use rustix::process::{Pid, Signal, kill_process};
use serde::de::DeserializeOwned;

use crate::{Error, Result};

/// The commands that are running.
static RUNNING: Mutex<Vec<Pid>> = Mutex::new(Vec::new());

fn running() -> MutexGuard<'static, Vec<Pid>> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Tells the commands that are running to end, for a process that is about to end itself: no other begins
/// from now on, and who waits for one waits for ever.
pub(super) fn end_all() {
    let running = running();
    for pid in running.iter() {
        // One that has ended already needs no word.
        let _ = kill_process(*pid, Signal::TERM);
    }
    std::mem::forget(running);
}

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
    let outcome = output(command)
        .map_err(|source| Error::io(command.get_program(), "cannot start", source))?;
    if outcome.status.success() {
        Ok(outcome)
    } else {
        Err(failure(&String::from_utf8_lossy(&outcome.stderr), outcome.status))
    }
}

fn output(command: &mut Command) -> std::io::Result<Output> {
    // Locked while it starts, so that none is missed.
    let mut starting = running();
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn()?;
    let pid = Pid::from_child(&child);
    starting.push(pid);
    drop(starting);
    let outcome = Child::wait_with_output(child);
    running().retain(|running| *running != pid);
    outcome
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
