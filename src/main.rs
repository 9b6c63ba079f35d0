//! The `deepfield` program: see `deepfield --help`.

use std::process::ExitCode;

fn main() -> ExitCode {
    deepfield::cli::run()
}
