//! Files that appear whole or not at all.

use std::ffi::{OsStr, OsString};
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind, Write};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use xxhash_rust::xxh3::xxh3_64;

use crate::leftovers::Leftover;
use crate::{Error, Result};

/// Longest target name that is repeated in the temporary name: file systems allow 255 bytes.
const MAX_REPEATED_NAME: usize = 200;

/// A file being written under a temporary name beside its target, `.NAME.deepfield-partial`, that
/// takes the target's name when it is complete.
///
/// The temporary file is locked: a second writer of the same target gets an error, and what a
/// killed run left behind, not being locked any more, is taken over and emptied. Dropped without
/// [`Self::commit`], or where a signal ends the process, the temporary file is removed and the target
/// is as before.
#[derive(Debug)]
pub struct AtomicFile {
    file: File,
    partial: PathBuf,
    target: PathBuf,
    committed: bool,
    _leftover: Leftover,
}

impl AtomicFile {
    /// Begins to write `target`; a symbolic link there is followed.
    ///
    /// # Errors
    /// A target that has no file name or exists as something else than a file, a directory that
    /// does not exist or cannot be written, and another writer of the same target.
    pub fn create(target: impl AsRef<Path>) -> Result<Self> {
        let target = resolve(target.as_ref())?;
        let partial = partial_path(&target)?;
        if fs::symlink_metadata(&partial).is_ok_and(|found| !found.is_file()) {
            let reason = "is where a file is to be written until it is complete; remove it";
            return Err(Error::request(format!("{}: {reason}", partial.display())));
        }
        // A file that was locked may have been renamed or removed between opening and locking.
        loop {
            let file = OpenOptions::new()
                .read(true)
                .write(true)
                .create(true)
                .truncate(false)
                .open(&partial)
                .map_err(|error| refused(&target, error))?;
            lock(&file, &target)?;
            if is_at(&file, &partial) {
                file.set_len(0).map_err(|error| Error::io(&partial, "cannot empty", error))?;
                let leftover = Leftover::new(&partial);
                return Ok(Self { file, partial, target, committed: false, _leftover: leftover });
            }
        }
    }

    /// The file, open for reading and writing.
    pub fn file(&self) -> &File {
        &self.file
    }

    /// The folder in which the file will be: a link's target's, if the target is a link.
    pub fn directory(&self) -> &Path {
        folder_of(&self.target)
    }

    /// Where the file will be.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Makes the file durable and gives it the target's name, replacing what was there.
    ///
    /// # Errors
    /// The system's, as a full disk; then the target is as before and nothing is left beside it. Where
    /// only the directory could not be made durable, the target is new.
    pub fn commit(mut self) -> Result<()> {
        let failed = |error| Error::io(&self.target, "cannot complete the file", error);
        self.file.sync_all().map_err(failed)?;
        fs::rename(&self.partial, &self.target).map_err(failed)?;
        self.committed = true;
        sync_directory(&self.target)
            .map_err(|error| Error::io(&self.target, "cannot sync its directory", error))
    }
}

impl Drop for AtomicFile {
    fn drop(&mut self) {
        if !self.committed {
            // Nothing can be done about a failure here; the next writer takes the file over.
            let _ = fs::remove_file(&self.partial);
        }
    }
}

/// Writes a whole text to `path`.
///
/// # Errors
/// As [`AtomicFile`]'s, and what the system refuses to write.
pub(crate) fn write(path: &Path, text: &str) -> Result<()> {
    let file = AtomicFile::create(path)?;
    let written = file.file().write_all(text.as_bytes());
    written.map_err(|source| Error::io(path, "cannot write", source))?;
    file.commit()
}

/// Whether both paths mean one file, be it there (links are followed) or to be written.
pub(crate) fn is_same_file(a: &Path, b: &Path) -> bool {
    match (fs::metadata(a), fs::metadata(b)) {
        (Ok(a), Ok(b)) => identity(&a) == identity(&b),
        (Err(_), Err(_)) => a == b || place(a).zip(place(b)).is_some_and(|(a, b)| a == b),
        _ => false,
    }
}

/// Where a file that is not there would lie.
fn place(path: &Path) -> Option<PathBuf> {
    Some(folder_of(path).canonicalize().ok()?.join(path.file_name()?))
}

/// The folder in which a path lies.
fn folder_of(path: &Path) -> &Path {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    folder.unwrap_or(Path::new("."))
}

fn identity(found: &fs::Metadata) -> (u64, u64) {
    (found.dev(), found.ino())
}

/// Names of what processes have open.
const DESCRIPTORS: [&str; 5] = ["/dev/fd", "/dev/stdin", "/dev/stdout", "/dev/stderr", "/proc"];
const IRREGULAR: &str = "is not a regular file; name another";

/// The target itself, behind symbolic links; refuses what is not a file.
fn resolve(target: &Path) -> Result<PathBuf> {
    let refuse = |what: &str| Error::request(format!("{}: {what}", target.display()));
    let link = fs::symlink_metadata(target).is_ok_and(|found| found.is_symlink());
    // A file behind an open descriptor is not to be replaced under those who write it.
    if DESCRIPTORS.iter().any(|place| target.starts_with(place)) {
        return Err(refuse(IRREGULAR));
    }
    let resolved = if link {
        fs::canonicalize(target).map_err(|error| match error.kind() {
            ErrorKind::NotFound => refuse("is a link to what is not there; remove it"),
            _ => Error::io(target, "cannot follow", error),
        })?
    } else {
        target.to_path_buf()
    };
    match fs::metadata(&resolved) {
        Ok(found) if found.is_dir() => {
            Err(refuse("is a directory; name a file to be written in it"))
        }
        Ok(found) if !found.is_file() => Err(refuse(IRREGULAR)),
        Err(error) if error.kind() != ErrorKind::NotFound => {
            Err(Error::io(target, "cannot write", error))
        }
        _ => Ok(resolved),
    }
}

fn partial_path(target: &Path) -> Result<PathBuf> {
    let name = target.file_name().ok_or_else(|| {
        Error::request(format!("`{}` does not name a file to be written", target.display()))
    })?;
    let mut partial = OsString::from(".");
    if name.len() <= MAX_REPEATED_NAME {
        partial.push(name);
    } else {
        partial.push(format!("{:016x}", xxh3_64(name.as_bytes())));
    }
    partial.push(OsStr::new(".deepfield-partial"));
    Ok(target.with_file_name(partial))
}

fn refused(target: &Path, error: io::Error) -> Error {
    let action = match error.kind() {
        ErrorKind::NotFound => "cannot write: its folder is to be made first",
        _ => "cannot write beside it",
    };
    Error::io(target, action, error)
}

/// Locks `file`, a file or folder under the temporary name of what is to be at `target`.
///
/// # Errors
/// Another process that holds the lock, and what the system refuses.
pub(crate) fn lock(file: &File, target: &Path) -> Result<()> {
    match file.try_lock() {
        Ok(()) => Ok(()),
        Err(TryLockError::WouldBlock) => Err(is_being_written(target)),
        // Without locks there is no protection from a second writer, but writing still works.
        Err(TryLockError::Error(error)) if error.kind() == ErrorKind::Unsupported => Ok(()),
        Err(TryLockError::Error(error)) => Err(Error::io(target, "cannot lock", error)),
    }
}

/// What is to be at `target` is another process's work.
pub(crate) fn is_being_written(target: &Path) -> Error {
    Error::request(format!(
        "{}: another process is writing it; wait for it or name another",
        target.display()
    ))
}

/// Whether `path` still names the open `file`.
pub(crate) fn is_at(file: &File, path: &Path) -> bool {
    match (file.metadata(), fs::symlink_metadata(path)) {
        (Ok(open), Ok(named)) => identity(&open) == identity(&named),
        _ => false,
    }
}

fn sync_directory(target: &Path) -> io::Result<()> {
    match File::open(folder_of(target))?.sync_all() {
        // Some network file systems cannot do that for directories; there is nothing else to do.
        Err(error) if matches!(error.kind(), ErrorKind::Unsupported | ErrorKind::InvalidInput) => {
            Ok(())
        }
        outcome => outcome,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(directory: &Path) -> Vec<String> {
        let entries = fs::read_dir(directory).unwrap();
        let mut names: Vec<String> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn appears_whole_or_not_at_all() {
        let directory = tempfile::tempdir().unwrap();
        let target = directory.path().join("a.dfc");
        fs::write(&target, "old").unwrap();
        let dropped = AtomicFile::create(&target).unwrap();
        dropped.file().write_all(b"half").unwrap();
        assert_eq!(fs::read_to_string(&target).unwrap(), "old");
        drop(dropped);
        assert_eq!(names(directory.path()), ["a.dfc"]);
        let kept = AtomicFile::create(&target).unwrap();
        kept.file().write_all(b"new").unwrap();
        kept.commit().unwrap();
        assert_eq!(fs::read_to_string(&target).unwrap(), "new");
        assert_eq!(names(directory.path()), ["a.dfc"]);
    }

    #[test]
    fn leftovers_of_a_killed_run_are_taken_over() {
        let directory = tempfile::tempdir().unwrap();
        fs::write(directory.path().join(".a.deepfield-partial"), "much that was left").unwrap();
        let file = AtomicFile::create(directory.path().join("a")).unwrap();
        file.file().write_all(b"new").unwrap();
        file.commit().unwrap();
        assert_eq!(fs::read_to_string(directory.path().join("a")).unwrap(), "new");
        assert_eq!(names(directory.path()), ["a"]);
    }

    #[test]
    fn a_second_writer_is_refused_and_disturbs_nothing() {
        let directory = tempfile::tempdir().unwrap();
        let target = directory.path().join("a");
        let first = AtomicFile::create(&target).unwrap();
        first.file().write_all(b"first").unwrap();
        let message = AtomicFile::create(&target).unwrap_err().to_string();
        assert!(message.contains("another process is writing"), "{message}");
        first.commit().unwrap();
        assert_eq!(fs::read_to_string(&target).unwrap(), "first");
        AtomicFile::create(&target).unwrap();
    }

    #[test]
    fn targets_that_are_no_files_are_refused() {
        let directory = tempfile::tempdir().unwrap();
        let failure = |path: &Path| AtomicFile::create(path).unwrap_err().to_string();
        assert!(failure(directory.path()).contains("is a directory"));
        assert!(failure(Path::new("/dev/null")).contains("not a regular file"));
        assert!(failure(Path::new("")).contains("does not name a file"));
        let missing = directory.path().join("missing/a");
        assert!(failure(&missing).contains("missing/a: cannot write"), "{}", failure(&missing));
        assert!(failure(&directory.path().join("n".repeat(256))).contains("nnn: cannot write"));
        assert!(names(directory.path()).is_empty());
    }

    #[test]
    fn what_is_in_the_way_is_named() {
        let directory = tempfile::tempdir().unwrap();
        let at = |name: &str| directory.path().join(name);
        fs::write(at("precious"), "kept").unwrap();
        std::os::unix::fs::symlink(at("precious"), at(".a.deepfield-partial")).unwrap();
        fs::create_dir(at(".b.deepfield-partial")).unwrap();
        for name in ["a", "b"] {
            let message = AtomicFile::create(at(name)).unwrap_err().to_string();
            assert!(message.contains(&format!(".{name}.deepfield-partial: is where")), "{message}");
        }
        assert_eq!(fs::read_to_string(at("precious")).unwrap(), "kept");
    }

    #[test]
    fn links_are_followed_and_long_names_allowed() {
        let directory = tempfile::tempdir().unwrap();
        let long = directory.path().join("n".repeat(255));
        fs::write(&long, "old").unwrap();
        let other = tempfile::tempdir().unwrap();
        let link = other.path().join("link");
        std::os::unix::fs::symlink(&long, &link).unwrap();
        let file = AtomicFile::create(&link).unwrap();
        assert!(is_same_file(file.directory(), directory.path()));
        file.commit().unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read(&long).unwrap(), b"");
    }
}
