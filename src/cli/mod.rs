//! The program's commands.

use std::process::ExitCode;

/// Runs the program on the process' arguments.
pub fn run() -> ExitCode {
    ExitCode::SUCCESS
}
