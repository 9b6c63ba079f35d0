//! Where the data lie that are kept beside the repository.

// Each program uses only a part of it.
#![allow(dead_code)]

use std::path::{Path, PathBuf};

/// A file or folder beside the repository; says so where it is absent.
pub(crate) fn shared(relative: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared").join(relative);
    if path.exists() {
        return Some(path);
    }
    eprintln!("skipped: {} is not there", path.display());
    None
}
