//! A folder that appears whole or not at all.

use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use crate::atomic_file::{is_at, is_being_written, lock};
use crate::leftovers::Leftover;
use crate::{Error, Result};

/// First line of the text file that every data set has; folders without it are not replaced.
pub(super) const MARK: &str = "# Synthetic data set written by deepfield synth";

/// A folder under a temporary name beside its final one, removed unless it is finished. It is locked,
/// so that what another process writes is told from what a killed one left.
pub(super) struct OutputFolder {
    partial: PathBuf,
    target: PathBuf,
    /// The target's text file that starts with [`MARK`].
    marked: String,
    finished: bool,
    _lock: File,
    _leftover: Leftover,
}

impl OutputFolder {
    /// Starts folder `name` in `directory`, which is made if need be. The data set's file `marked`
    /// starts with [`MARK`].
    ///
    /// # Errors
    /// A folder of that name which holds anything else than an earlier synthetic data set, and
    /// another process that writes it.
    pub(super) fn create(directory: &Path, name: &str, marked: &str) -> Result<Self> {
        let target = directory.join(name);
        refuse_foreign(&target, marked)?;
        fs::create_dir_all(directory)
            .map_err(|e| Error::io(directory, "cannot make this folder", e))?;
        let partial = directory.join(format!(".{name}.deepfield-partial"));
        if partial.exists() {
            // What a killed run left.
            let _lock = locked(&partial, &target)?;
            remove_folder(&partial)?;
        }
        fs::create_dir(&partial).map_err(|e| Error::io(&partial, "cannot make this folder", e))?;
        let leftover = Leftover::new(&partial);
        let lock = locked(&partial, &target)?;
        if !is_at(&lock, &partial) {
            // Another run has cleared it away before it was locked.
            return Err(is_being_written(&target));
        }
        let marked = marked.to_owned();
        let folder =
            Self { partial, target, marked, finished: false, _lock: lock, _leftover: leftover };
        let old = old_of(&folder.partial);
        if old.exists() && !folder.target.exists() {
            // A run was killed while it replaced a data set: that is still there.
            refuse_foreign(&old, &folder.marked)?;
            rename(&old, &folder.target)?;
        }
        Ok(folder)
    }

    /// A file of the folder, where it is written.
    pub(super) fn file(&self, name: &str) -> PathBuf {
        self.partial.join(name)
    }

    /// Makes a folder within, where it is written.
    ///
    /// # Errors
    /// What the operating system refuses.
    pub(super) fn make(&self, name: &str) -> Result<PathBuf> {
        let folder = self.partial.join(name);
        fs::create_dir_all(&folder)
            .map_err(|e| Error::io(&folder, "cannot make this folder", e))?;
        Ok(folder)
    }

    /// Writes text file `name`; its size.
    ///
    /// # Errors
    /// What the operating system refuses.
    pub(super) fn write_text(&self, name: &str, text: &str) -> Result<u64> {
        let path = self.file(name);
        fs::write(&path, text).map_err(|e| Error::io(&path, "cannot write", e))?;
        Ok(text.len() as u64)
    }

    /// Gives the folder its final name, in place of an earlier synthetic data set.
    pub(super) fn finish(mut self) -> Result<PathBuf> {
        if self.target.exists() {
            refuse_foreign(&self.target, &self.marked)?;
            let old = old_of(&self.partial);
            refuse_foreign(&old, &self.marked)?;
            remove_folder(&old)?;
            rename(&self.target, &old)?;
            if let Err(error) = rename(&self.partial, &self.target) {
                // The error to tell is the first; what was there should be there again.
                let _ = rename(&old, &self.target);
                return Err(error);
            }
            self.finished = true;
            remove_folder(&old)?;
        } else {
            rename(&self.partial, &self.target)?;
            self.finished = true;
        }
        Ok(self.target.clone())
    }
}

impl Drop for OutputFolder {
    fn drop(&mut self) {
        if !self.finished {
            // The run has failed already; that the folder stays is no more than litter that the
            // next run removes.
            let _ = fs::remove_dir_all(&self.partial);
        }
    }
}

/// Where the data set that is replaced lies for a moment.
fn old_of(partial: &Path) -> PathBuf {
    partial.with_extension("deepfield-old")
}

/// The folder at `partial`, locked for this process until it is dropped.
fn locked(partial: &Path, target: &Path) -> Result<File> {
    let folder = File::open(partial).map_err(|e| Error::io(partial, "cannot open", e))?;
    lock(&folder, target)?;
    Ok(folder)
}

fn rename(from: &Path, to: &Path) -> Result<()> {
    fs::rename(from, to).map_err(|e| Error::io(to, format!("cannot rename {}", from.display()), e))
}

fn remove_folder(path: &Path) -> Result<()> {
    match fs::remove_dir_all(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
            Err(Error::io(path, "cannot remove this folder", e))
        }
        _ => Ok(()),
    }
}

/// Refuses a target that is not empty and not an earlier synthetic data set.
fn refuse_foreign(target: &Path, marked: &str) -> Result<()> {
    let empty = match fs::read_dir(target) {
        Ok(mut entries) => entries.next().is_none(),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => true,
        Err(e) => return Err(Error::io(target, "cannot list this folder", e)),
    };
    if empty || is_marked(&target.join(marked)) {
        return Ok(());
    }
    let reason = "exists and holds something else than a synthetic data set: choose another folder";
    Err(Error::invalid(target.display(), reason))
}

/// Whether a file starts with [`MARK`].
fn is_marked(path: &Path) -> bool {
    let mut start = Vec::new();
    let is_file = fs::metadata(path).is_ok_and(|found| found.is_file());
    let read = |file: File| file.take(MARK.len() as u64).read_to_end(&mut start);
    is_file && File::open(path).and_then(read).is_ok() && start == MARK.as_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_of_others_are_left_alone() {
        let directory = tempfile::tempdir().unwrap();
        let create = || OutputFolder::create(directory.path(), "DD0000", "DD0000");
        let file = |folder: &str| {
            let folder = directory.path().join(folder);
            fs::create_dir_all(&folder).unwrap();
            fs::write(folder.join("notes"), "mine").unwrap();
            folder.join("notes")
        };
        let notes = [".DD0000.partial", ".DD0000.old", ".DD0000.deepfield-old"].map(file);
        assert!(create().err().unwrap().to_string().contains("something else"));
        for notes in &notes {
            assert_eq!(fs::read_to_string(notes).unwrap(), "mine");
        }
        assert!(!directory.path().join("DD0000").exists());
    }

    #[test]
    fn what_is_being_written_is_left_alone() {
        let directory = tempfile::tempdir().unwrap();
        let create = || OutputFolder::create(directory.path(), "DD0000", "DD0000");
        let first = create().unwrap();
        first.write_text("DD0000", MARK).unwrap();
        let refused = create().err().unwrap().to_string();
        assert!(refused.contains("DD0000: another process is writing it"), "{refused}");
        let target = first.finish().unwrap();
        assert_eq!(fs::read_to_string(target.join("DD0000")).unwrap(), MARK);
        // What a killed run left is not locked.
        fs::create_dir(directory.path().join(".DD0000.deepfield-partial")).unwrap();
        drop(create().unwrap());
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
    }

    #[test]
    fn what_was_there_outlives_a_run_that_was_killed_or_came_too_late() {
        let directory = tempfile::tempdir().unwrap();
        let create = || OutputFolder::create(directory.path(), "DD0000", "DD0000").unwrap();
        let target = directory.path().join("DD0000");
        // Killed between both renames.
        let old = directory.path().join(".DD0000.deepfield-old");
        fs::create_dir(&old).unwrap();
        fs::write(old.join("DD0000"), MARK).unwrap();
        drop(create());
        assert_eq!(fs::read_to_string(target.join("DD0000")).unwrap(), MARK);
        assert!(!old.exists());
        // Something else has come there while data were made.
        let late = create();
        fs::write(target.join("DD0000"), "something else").unwrap();
        let refused = late.finish().unwrap_err().to_string();
        assert!(refused.contains("something else than a synthetic data set"), "{refused}");
        assert_eq!(fs::read_to_string(target.join("DD0000")).unwrap(), "something else");
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
    }
}
