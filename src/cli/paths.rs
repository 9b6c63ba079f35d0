//! Which files a command reads and writes.

use std::path::Path;

use crate::atomic_file::is_same_file;
use crate::{Error, Result};

/// Refuses a file that is written twice, or read as well. Each comes with what it is.
pub(super) fn refuse_same(written: &[(&str, &Path)], read: &[(&str, &Path)]) -> Result<()> {
    for (n, (what, path)) in written.iter().enumerate() {
        let others = written[n + 1..].iter().chain(read);
        if let Some((other, _)) = others.into_iter().find(|(_, other)| is_same_file(path, other)) {
            return Err(Error::request(format!(
                "{}: is named for {what} and for {other}; name another file",
                path.display()
            )));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;

    #[test]
    fn files_are_told_apart_by_where_they_lie() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("scene.toml"), "").unwrap();
        std::os::unix::fs::symlink(at("scene.toml"), at("link.toml")).unwrap();
        std::fs::hard_link(at("scene.toml"), at("hard.toml")).unwrap();
        let check = |written: &[&str], read: &[&str]| {
            let paths = |names: &[&str]| names.iter().map(|name| at(name)).collect::<Vec<_>>();
            let (written, read) = (paths(written), paths(read));
            let named = |paths: &'static str| move |path| (paths, path);
            let written: Vec<_> =
                written.iter().map(PathBuf::as_path).map(named("writing")).collect();
            let read: Vec<_> = read.iter().map(PathBuf::as_path).map(named("reading")).collect();
            refuse_same(&written, &read).is_ok()
        };
        assert!(check(&["new.exr", "stats.json"], &["scene.toml"]));
        assert!(!check(&["new.exr", "./new.exr"], &[]));
        assert!(!check(&["scene.toml"], &["scene.toml"]));
        assert!(!check(&["link.toml"], &["scene.toml"]));
        assert!(!check(&["hard.toml"], &["scene.toml"]));
        assert!(check(&["no/such/folder"], &["scene.toml"]));
    }
}
