//! What a cache must not be written over.

use std::fs::Metadata;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use crate::cache::Cache;
use crate::source::Source;
use crate::{Error, Result};

/// Refuses a target that is a file of the source: its data, what lies in its folder if it is one, and
/// files that extend its name. A cache may be written anew wherever it lies.
pub(super) fn refuse_source_files(source: &dyn Source, target: &Path) -> Result<()> {
    let Ok(found) = std::fs::metadata(target) else { return Ok(()) };
    let refuse = |what: &str| {
        let place = target.display();
        Err(Error::request(format!("{place}: {what}; name another file for the cache")))
    };
    if is_same(&found, source.path()) {
        return refuse("is the input itself");
    }
    if found.len() == 0 || Cache::is_cache(target) {
        return Ok(());
    }
    if is_beside(source.path(), target)
        || source.data_files()?.iter().any(|file| is_same(&found, file))
    {
        return refuse("is one of the input's files");
    }
    Ok(())
}

fn is_same(found: &Metadata, path: &Path) -> bool {
    std::fs::metadata(path)
        .is_ok_and(|other| (other.dev(), other.ino()) == (found.dev(), found.ino()))
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
