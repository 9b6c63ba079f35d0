//! Finds the files of a dump.

use std::collections::HashMap;
use std::ffi::OsString;
use std::path::{Component, Path, PathBuf};

use crate::source::folder::{distinct, entries};
use crate::{Error, Result};

/// Suffixes of the files that list grids, the longer first.
const HIERARCHIES: [&str; 2] = [".hierarchy.hdf5", ".hierarchy"];
/// Folders below the dump's own, one in the other, in which data files are looked for.
const FOLDERS_BELOW: usize = 3;

/// The files that describe one dump.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Dump {
    /// The parameter file, whose name the others extend.
    pub(super) parameters: PathBuf,
}

impl Dump {
    /// The dump that `path` means: its parameter file, one of its hierarchies, or the folder
    /// that holds one dump or a folder with one.
    ///
    /// # Errors
    /// A folder that cannot be read, or that holds several dumps.
    pub(super) fn locate(path: &Path) -> Result<Option<Self>> {
        if !path.is_dir() {
            return Ok(Some(Self { parameters: without_suffix(path) }));
        }
        let mut dumps = dumps_in(path)?;
        if dumps.is_empty() {
            for folder in entries(path)?.iter().filter(|entry| entry.is_dir()) {
                dumps.extend(dumps_in(folder)?);
            }
        }
        let dumps = distinct(dumps);
        match dumps.as_slice() {
            [] => Ok(None),
            [one] => Ok(Some(Self { parameters: one.clone() })),
            [first, .., last] => Err(Error::request(format!(
                "{}: holds {} Enzo dumps, from {} to {}: name one of them",
                path.display(),
                dumps.len(),
                first.display(),
                last.display()
            ))),
        }
    }

    /// The text hierarchy.
    pub(super) fn text(&self) -> PathBuf {
        self.with_suffix(".hierarchy")
    }

    /// The hierarchy with exact edges.
    pub(super) fn tables(&self) -> PathBuf {
        self.with_suffix(".hierarchy.hdf5")
    }

    fn with_suffix(&self, suffix: &str) -> PathBuf {
        let mut name = OsString::from(&self.parameters);
        name.push(suffix);
        PathBuf::from(name)
    }

    /// The data file that a hierarchy names. Names are relative to where the code ran; dumps are moved
    /// and copied, so the end of the name counts: a file of that name beside the parameter file, or one
    /// in the last folders named, where these lie below. Outside the dump's own folder a file of that
    /// name may be another run's, and only one named by its full path is read.
    fn data_file(&self, name: &str) -> Option<PathBuf> {
        let written = Path::new(name);
        let folder = self.parameters.parent().unwrap_or(Path::new(""));
        let is_name = |part: &Component| matches!(part, Component::Normal(_));
        let parts: Vec<Component> = written.components().collect();
        let ends = (1..=1 + FOLDERS_BELOW)
            .filter_map(|length| parts.get(parts.len().checked_sub(length)?..))
            .take_while(|end| end.iter().all(is_name))
            .map(|end| folder.join(end.iter().collect::<PathBuf>()));
        let full = Some(written.to_path_buf()).filter(|path| path.is_absolute());
        ends.chain(full).find(|path| path.is_file())
    }
}

/// Dumps whose hierarchy stands in `folder`.
fn dumps_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut dumps: Vec<PathBuf> = entries(folder)?
        .iter()
        .map(|entry| (without_suffix(entry), entry))
        .filter(|(dump, entry)| dump != *entry)
        .map(|(dump, _)| dump)
        .collect();
    dumps.sort();
    dumps.dedup();
    Ok(dumps)
}

/// `path` without a hierarchy's suffix.
fn without_suffix(path: &Path) -> PathBuf {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or("");
    HIERARCHIES
        .iter()
        .find_map(|suffix| name.strip_suffix(suffix))
        .map_or_else(|| path.to_path_buf(), |stem| path.with_file_name(stem))
}

/// The distinct data files that a hierarchy names, in the order met.
#[derive(Debug, Default)]
pub(super) struct DataFiles {
    paths: Vec<PathBuf>,
    numbers: HashMap<String, u64>,
}

impl DataFiles {
    /// The number of the file that the hierarchy calls `name`, for [`Self::path`].
    ///
    /// # Errors
    /// The reason, where there is no such file.
    pub(super) fn number(&mut self, dump: &Dump, name: &str) -> Result<u64, String> {
        if let Some(&number) = self.numbers.get(name) {
            return Ok(number);
        }
        let path = dump.data_file(name).ok_or_else(|| {
            format!(
                "its data file {name} is neither beside {} nor below, in folders that it names: has it \
                 been left behind?",
                dump.parameters.display()
            )
        })?;
        let number = self.paths.len() as u64;
        self.paths.push(path);
        self.numbers.insert(name.to_owned(), number);
        Ok(number)
    }

    /// The paths of all files met.
    pub(super) fn paths(&self) -> &[PathBuf] {
        &self.paths
    }

    /// The path of file `number`.
    pub(super) fn path(&self, number: u64) -> Option<PathBuf> {
        self.paths.get(usize::try_from(number).ok()?).cloned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn touch(path: &Path) {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, "x").unwrap();
    }

    #[test]
    fn every_name_of_a_dump_means_the_same_dump() {
        let run = tempfile::tempdir().unwrap();
        let dump = run.path().join("DD0010/DD0010");
        for name in ["DD0010", "DD0010.hierarchy", "DD0010.hierarchy.hdf5", "DD0010.cpu0000"] {
            touch(&dump.with_file_name(name));
        }
        for name in ["DD0010/DD0010", "DD0010/DD0010.hierarchy.hdf5", "DD0010", "."] {
            let found = Dump::locate(&run.path().join(name)).unwrap().unwrap();
            assert_eq!(found.parameters.canonicalize().unwrap(), dump.canonicalize().unwrap());
        }
        // Neither a link to it nor what macOS keeps beside files is a second dump.
        std::os::unix::fs::symlink("DD0010", run.path().join("latest")).unwrap();
        touch(&run.path().join("DD0010/._DD0010.hierarchy"));
        touch(&run.path().join("._DD0010/DD0010.hierarchy"));
        for name in [".", "DD0010"] {
            let found = Dump::locate(&run.path().join(name)).unwrap().unwrap();
            assert_eq!(found.parameters.canonicalize().unwrap(), dump.canonicalize().unwrap());
        }
        touch(&run.path().join("DD0011/DD0011.hierarchy"));
        let error = Dump::locate(run.path()).unwrap_err().to_string();
        assert!(error.contains("2 Enzo dumps"), "{error}");
        assert_eq!(Dump::locate(tempfile::tempdir().unwrap().path()).unwrap(), None);
    }

    #[test]
    fn data_files_are_found_beside_the_dump_and_in_folders_below() {
        let run = tempfile::tempdir().unwrap();
        let dump = Dump { parameters: run.path().join("DD1/DD1") };
        touch(&run.path().join("DD1/DD1.cpu0000"));
        touch(&run.path().join("DD1/task0/DD1.cpu0001"));
        let mut files = DataFiles::default();
        assert_eq!(files.number(&dump, "./DD1/DD1.cpu0000").unwrap(), 0);
        assert_eq!(files.number(&dump, "DD1/task0/DD1.cpu0001").unwrap(), 1);
        assert_eq!(files.number(&dump, "./DD1/DD1.cpu0000").unwrap(), 0);
        assert!(files.path(1).unwrap().ends_with("task0/DD1.cpu0001"));
        assert!(files.number(&dump, "./DD1/DD1.cpu0002").unwrap_err().contains("DD1.cpu0002"));
        assert_eq!(files.path(2), None);
    }

    #[test]
    fn other_runs_data_files_are_not_taken_for_missing_ones() {
        let project = tempfile::tempdir().unwrap();
        let dump = Dump { parameters: project.path().join("run/DD1/DD1") };
        let others = ["DD1/DD1.cpu0000", "run/DD1.cpu0000", "DD1.cpu0000"];
        for other in others {
            touch(&project.path().join(other));
        }
        touch(&dump.parameters);
        for name in ["./DD1/DD1.cpu0000", "DD1.cpu0000", "../DD1.cpu0000", "DD1/../../DD1.cpu0000"]
        {
            assert_eq!(dump.data_file(name), None, "{name}");
        }
        // What is named in full cannot be another.
        let full = project.path().join(others[0]);
        assert_eq!(dump.data_file(&full.display().to_string()), Some(full));
        let beside = dump.parameters.with_file_name("DD1.cpu0000");
        touch(&beside);
        assert_eq!(dump.data_file("/gone/DD1/DD1.cpu0000"), Some(beside));
    }
}
