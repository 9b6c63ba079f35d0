//! What must not be written over.

use std::path::Path;

use crate::atomic_file::is_same_file;
use crate::cache::Cache;
use crate::source::Source;
use crate::{Error, Result};

/// Refuses a target that is a file of the source: its data, what lies in its folder if it is one, and
/// files that extend its name. A cache may be written anew wherever it lies.
///
/// # Errors
/// A target that is such a file, and data files that cannot be listed.
pub fn refuse_source_files(source: &dyn Source, target: &Path) -> Result<()> {
    let refuse = |what: &str| {
        Err(Error::request(format!("{}: {what}; name another file", target.display())))
    };
    if is_same_file(target, source.path()) {
        return refuse("is the input itself");
    }
    let is_empty = std::fs::metadata(target).map_or(true, |found| found.len() == 0);
    if is_empty || Cache::is_cache(target) {
        return Ok(());
    }
    if is_beside(source.path(), target)
        || source.data_files()?.iter().any(|file| is_same_file(target, file))
    {
        return refuse("is one of the input's files");
    }
    Ok(())
}

/// Refuses a target among the files of the folder that was named in place of the output that it holds.
///
/// # Errors
/// A target that is such a file, and no cache.
pub fn refuse_files_of(folder: &Path, target: &Path) -> Result<()> {
    let is_file = std::fs::metadata(target).is_ok_and(|found| found.len() > 0);
    if is_file && folder.is_dir() && is_beside(folder, target) && !Cache::is_cache(target) {
        let place = target.display();
        return Err(Error::request(format!(
            "{place}: is one of the input's files; name another file"
        )));
    }
    Ok(())
}

/// Whether `target` lies in the folder `source`, or extends its name beside it.
fn is_beside(source: &Path, target: &Path) -> bool {
    let (Ok(source), Ok(target)) = (source.canonicalize(), target.canonicalize()) else {
        return false;
    };
    if source.is_dir() {
        return target.starts_with(source);
    }
    let name = |path: &Path| path.file_name().map(|name| name.to_string_lossy().into_owned());
    let (Some(own), Some(other)) = (name(&source), name(&target)) else { return false };
    source.parent() == target.parent()
        && other.strip_prefix(&own).is_some_and(|rest| rest.starts_with('.'))
}
