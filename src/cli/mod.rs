//! stub
use std::process::ExitCode;
/// run
pub fn run() -> ExitCode { ExitCode::SUCCESS }
