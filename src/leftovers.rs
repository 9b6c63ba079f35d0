//! Files and folders that must not outlive the process, be it told to end by a signal.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;

use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGUSR1, SIGUSR2, SIGXCPU, SIGXFSZ};
use signal_hook::iterator::Signals;
use signal_hook::low_level::emulate_default_handler;
use tempfile::TempDir;

use crate::{Error, Result};

/// What there is to remove at this moment.
static LEFTOVERS: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());
/// How often a folder is removed that is not empty yet.
const TRIES: usize = 1000;
/// Stack of the thread that waits for signals, bytes.
const STACK: usize = 256 << 10;

/// A file or folder that a signal that ends the process removes, while this lives.
#[derive(Debug)]
pub(crate) struct Leftover(PathBuf);

impl Leftover {
    /// Notes `path`, which may not exist yet.
    pub(crate) fn new(path: &Path) -> Self {
        // The working folder may change until the signal comes.
        let path = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
        noted().push(path.clone());
        Self(path)
    }
}

impl Drop for Leftover {
    fn drop(&mut self) {
        let mut noted = noted();
        if let Some(place) = noted.iter().position(|path| *path == self.0) {
            noted.swap_remove(place);
        }
    }
}

fn noted() -> MutexGuard<'static, Vec<PathBuf>> {
    LEFTOVERS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A folder of temporary files that is removed in the end.
#[derive(Debug)]
pub(crate) struct ScratchFolder {
    folder: TempDir,
    _leftover: Leftover,
}

impl ScratchFolder {
    /// A new folder in `parent`.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn new_in(parent: &Path) -> Result<Self> {
        let folder = TempDir::new_in(parent)
            .map_err(|source| Error::io(parent, "cannot make a folder", source))?;
        let leftover = Leftover::new(folder.path());
        Ok(Self { folder, _leftover: leftover })
    }

    /// A new folder where the system wants temporary files.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn new() -> Result<Self> {
        Self::new_in(&std::env::temp_dir())
    }

    /// The folder.
    pub(crate) fn path(&self) -> &Path {
        self.folder.path()
    }
}

/// Signals that end the process and can be heard before; batch systems warn by some of them of limits
/// that are near.
const ENDING: [i32; 7] = [SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGUSR1, SIGUSR2, SIGXCPU];

/// From now on signals that ask the process to end first run `before`, remove what is noted and run
/// `last`, and a file that grows beyond the system's limit (`ulimit -f`) is an error of writing, not
/// the process' end. Signals that the process was started to ignore stay ignored, as `nohup` relies on.
///
/// # Errors
/// The system's.
pub(crate) fn clear_on_signals(
    before: impl Fn() + Send + 'static,
    last: impl Fn() + Send + 'static,
) -> io::Result<()> {
    let ignored = ignored_signals()?;
    let is_heard = |signal: &i32| (ignored >> (signal - 1)) & 1 == 0;
    if is_heard(&SIGXFSZ) {
        // A handler that does nothing of note: without one the signal ends the process.
        signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)))?;
    }
    let mut signals = Signals::new(ENDING.iter().filter(|signal| is_heard(signal)))?;
    let wait = move || {
        for signal in &mut signals {
            before();
            // Kept locked: nothing new may begin.
            let noted = noted();
            noted.iter().for_each(|path| remove(path));
            last();
            let _ = emulate_default_handler(signal);
        }
    };
    thread::Builder::new().name("signals".to_owned()).stack_size(STACK).spawn(wait)?;
    Ok(())
}

/// Removes a file, or a folder in which others may still be making files: again, then. Nothing can be done
/// about other failures at the process' end.
fn remove(path: &Path) {
    for _ in 0..TRIES {
        let removed = if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
        match removed {
            Err(error) if error.kind() == io::ErrorKind::DirectoryNotEmpty => {}
            _ => return,
        }
    }
}

/// The signals that the process ignores, the first in the lowest bit, as Linux tells
/// (`proc_pid_status(5)`).
fn ignored_signals() -> io::Result<u64> {
    let mut status = String::new();
    File::open("/proc/self/status")?.read_to_string(&mut status)?;
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok())
        .ok_or_else(|| io::Error::other("the system does not tell which signals are ignored"))
}
