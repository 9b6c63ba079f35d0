//! What lies in a folder.

use std::io;
use std::path::{Path, PathBuf};

use crate::{Error, Result, regular_file};

/// Entries of a folder that are looked at for whether they may be read, or are outputs.
const MOST_TRIED: usize = 1000;
/// Outputs that a message names.
const NAMED: usize = 3;

/// The paths of all that lies in `folder` but for what [`is_shadow`], in no order.
///
/// # Errors
/// A folder that cannot be listed.
pub(super) fn entries(folder: &Path) -> Result<Vec<PathBuf>> {
    first_entries(folder, usize::MAX)
}

/// The same of no more than `most` entries.
fn first_entries(folder: &Path, most: usize) -> Result<Vec<PathBuf>> {
    let fault = |e| Error::io(folder, "cannot list the folder", e);
    let entries = std::fs::read_dir(folder).map_err(fault)?;
    let paths = entries.map(|entry| entry.map(|e| e.path()).map_err(fault));
    paths.filter(|path| !path.as_ref().is_ok_and(|path| is_shadow(path))).take(most).collect()
}

/// Whether macOS has put a file there to keep another's attributes (AppleDouble, `._NAME`): of that
/// other's name and extension, but of none of its content.
fn is_shadow(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"._"))
}

/// `files`, sorted, each once: links to one file are one.
pub(super) fn distinct(mut files: Vec<PathBuf>) -> Vec<PathBuf> {
    let meant = |file: &Path| file.canonicalize().unwrap_or_else(|_| file.to_path_buf());
    // Of several names the first remains.
    files.sort();
    files.sort_by_cached_key(|file| meant(file));
    files.dedup_by(|a, b| meant(a) == meant(b));
    files.sort();
    files
}

/// The one output directly in `folder` that `is_output` recognises among its files; none where there
/// is none.
///
/// # Errors
/// A folder that cannot be listed, that holds several outputs, or too much to look at all of it.
pub(super) fn only_output(
    folder: &Path,
    is_output: impl Fn(&Path) -> bool,
) -> Result<Option<PathBuf>> {
    let entries = first_entries(folder, MOST_TRIED + 1)?;
    let is_whole = entries.len() <= MOST_TRIED;
    let found = distinct(entries.into_iter().filter(|entry| is_output(entry)).collect());
    let refuse = |reason: String| Err(Error::request(format!("{}: {reason}", folder.display())));
    match found.as_slice() {
        [_, _, ..] => refuse(format!("holds several outputs, {}: name one", some(&found))),
        _ if !is_whole => {
            refuse(format!("holds more than {MOST_TRIED} files: name the output itself"))
        }
        one => Ok(one.first().cloned()),
    }
}

/// The names of some files.
fn some(files: &[PathBuf]) -> String {
    let name = |file: &PathBuf| file.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let names: Vec<String> = files.iter().take(NAMED).map(name).collect();
    format!("{}{}", names.join(", "), if files.len() > NAMED { ", …" } else { "" })
}

/// Why the file or folder at `path` is of no known format, if that is that it may not be read.
pub(super) fn denied(path: &Path) -> Option<Error> {
    let opened = if path.is_dir() {
        std::fs::read_dir(path).map(|_| ())
    } else {
        regular_file::open(path).map(|_| ())
    };
    let error = opened.err().filter(|error| error.kind() == io::ErrorKind::PermissionDenied)?;
    Some(Error::io(path, "cannot open the input", error))
}

/// The first that `look` finds of the files directly in `folder`, if it is a folder.
pub(super) fn first_found<T>(folder: &Path, look: impl Fn(&Path) -> Option<T>) -> Option<T> {
    let files = distinct(first_entries(folder, MOST_TRIED).ok()?);
    files.iter().filter(|file| file.is_file()).find_map(|file| look(file))
}

/// The first file in `folder` that may not be read, if it is a folder.
pub(super) fn denied_within(folder: &Path) -> Option<PathBuf> {
    first_found(folder, |file| denied(file).map(|_| file.to_path_buf()))
}
