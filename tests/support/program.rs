//! The built program, run as a user would, and what comes of it.

#![allow(clippy::unwrap_used)] // a test's way to fail

use std::ffi::OsStr;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// How a run ended.
#[derive(Debug)]
pub(crate) struct Ended {
    /// Exit code; none after a signal.
    pub(crate) code: Option<i32>,
    /// Standard output.
    pub(crate) stdout: String,
    /// Standard error.
    pub(crate) stderr: String,
    /// Peak resident set (VmHWM), bytes.
    pub(crate) peak: u64,
}

impl Ended {
    /// What a run that did what it was asked printed.
    #[track_caller]
    pub(crate) fn done(self) -> String {
        assert_eq!(self.code, Some(0), "{}", self.stderr);
        self.stdout
    }

    /// The one line in which a run told why it failed.
    #[track_caller]
    pub(crate) fn failed(self) -> String {
        assert_eq!(self.code, Some(1), "{self:?}");
        let is_clear = self.stderr.starts_with("error: ") && self.stderr.lines().count() == 1;
        assert!(is_clear && !self.stderr.contains("internal fault"), "{self:?}");
        self.stderr
    }
}

impl Ended {
    /// What a run was told that was called in a way that it does not take.
    #[track_caller]
    pub(crate) fn misused(self) -> String {
        assert_eq!(self.code, Some(2), "{self:?}");
        self.stderr
    }
}

/// Starts the program.
pub(crate) fn start(arguments: &[&dyn AsRef<OsStr>]) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_deepfield"));
    command.args(arguments);
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// The longest that a run may take: one that does not end fails, as if stopped by a signal.
const LONGEST: Duration = Duration::from_secs(600);

/// Waits until a run has ended.
pub(crate) fn end(mut child: Child) -> Ended {
    let read = |stream: Option<Box<dyn Read + Send>>| {
        std::thread::spawn(move || {
            let mut text = String::new();
            stream.map(|mut stream| stream.read_to_string(&mut text).unwrap());
            text
        })
    };
    let stdout = read(child.stdout.take().map(|stream| Box::new(stream) as _));
    let stderr = read(child.stderr.take().map(|stream| Box::new(stream) as _));
    let mut peak = 0;
    let began = Instant::now();
    let status = loop {
        peak = peak.max(peak_of(child.id()));
        if began.elapsed() > LONGEST {
            let _ = child.kill();
        }
        match child.try_wait().unwrap() {
            Some(status) => break status,
            None => std::thread::sleep(Duration::from_millis(2)),
        }
    };
    let [stdout, stderr] = [stdout, stderr].map(|thread| thread.join().unwrap());
    Ended { code: status.code(), stdout, stderr, peak }
}

/// Runs the program.
pub(crate) fn run(arguments: &[&dyn AsRef<OsStr>]) -> Ended {
    end(start(arguments))
}

/// VmHWM of a running process, bytes; 0 where the system does not tell.
fn peak_of(process: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kibibytes = line.and_then(|rest| rest.split_whitespace().next()?.parse::<u64>().ok());
    kibibytes.unwrap_or(0) * 1024
}

/// Names of all that lies in a folder, sorted.
pub(crate) fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Writes a file, and where it lies.
pub(crate) fn written(folder: &Path, name: &str, text: &str) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, text).unwrap();
    path
}
