//! Files that are read at places, again, or to an end that their size tells.

use std::fs::{self, File};
use std::io;
use std::path::Path;

/// Opens the file at `path` for reading; links are followed.
///
/// # Errors
/// The system's, and what is no regular file: opening a pipe would wait for a writer.
pub(crate) fn open(path: impl AsRef<Path>) -> io::Result<File> {
    if !fs::metadata(&path)?.is_file() {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "is not a regular file"));
    }
    File::open(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_regular_files_are_opened() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("file");
        fs::write(&file, "text").unwrap();
        let link = directory.path().join("link");
        std::os::unix::fs::symlink(&file, &link).unwrap();
        assert_eq!(open(&link).unwrap().metadata().unwrap().len(), 4);
        let pipe = directory.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        assert!(made.unwrap().success());
        for other in [&pipe, directory.path(), Path::new("/dev/null")] {
            assert_eq!(open(other).unwrap_err().to_string(), "is not a regular file");
        }
        assert_eq!(
            open(directory.path().join("none")).unwrap_err().kind(),
            io::ErrorKind::NotFound
        );
    }
}
