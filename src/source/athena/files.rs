//! The files of one output: `NAME[-idP][-levL][-domD].NNNN[.ID].vtk`, one for each domain and
//! process, those of levels above the root in folders `levL`, those of processes in `idP`.

use std::path::{Path, PathBuf};

use crate::source::folder::entries;
use crate::{Error, Result};

/// What the names of one output's files share.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Name {
    base: String,
    number: String,
    id: String,
}

impl Name {
    /// The output that a file of this name belongs to.
    fn parse(file: &str) -> Option<Self> {
        let stem = file.strip_suffix(".vtk")?;
        let is_number = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
        let parts: Vec<&str> = stem.split('.').collect();
        let (base, number, id) = match parts.as_slice() {
            [base @ .., number] if !base.is_empty() && is_number(number) => (base, *number, ""),
            [base @ .., number, id] if !base.is_empty() && is_number(number) => {
                (base, *number, *id)
            }
            base => (base, "", ""),
        };
        let base = base.join(".");
        let base = ["-dom", "-lev", "-id"].iter().fold(base.as_str(), |base, part| {
            match base.rsplit_once(part) {
                Some((before, number)) if is_number(number) => before,
                _ => base,
            }
        });
        Some(Self { base: base.to_owned(), number: number.to_owned(), id: id.to_owned() })
    }
}

/// One output of a run.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Output {
    /// Whether its files stand in a folder for each process.
    parallel: bool,
    name: Name,
}

/// Whether `folder`'s name is `prefix` and a number.
fn is_numbered(folder: &Path, prefix: &str) -> bool {
    let number = folder.file_name().and_then(|name| name.to_str()?.strip_prefix(prefix));
    number.is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()))
}

/// The folder of the run whose files stand in `folder`, and whether that is a process' folder.
fn run_folder(folder: &Path) -> (&Path, bool) {
    let above = |folder, prefix| match is_numbered(folder, prefix) {
        true => folder.parent(),
        false => None,
    };
    let run = above(folder, "lev").unwrap_or(folder);
    match above(run, "id") {
        Some(above) => (above, true),
        None => (run, false),
    }
}

/// One of the files that `folder` holds or the run that it is part of, of whatever output.
pub(super) fn any(folder: &Path) -> Option<PathBuf> {
    let absolute = std::path::absolute(folder).ok()?;
    all(run_folder(&absolute).0).ok()?.into_iter().next().map(|(_, file)| file)
}

/// The files of the output that `path` means: one of its files, or a folder with one output.
///
/// # Errors
/// A folder that cannot be read, or that holds several outputs.
pub(super) fn of_output(path: &Path) -> Result<Vec<PathBuf>> {
    let absolute =
        std::path::absolute(path).map_err(|e| Error::io(path, "cannot be made absolute", e))?;
    if absolute.is_dir() {
        return of_folder(path, &absolute);
    }
    let name = absolute.file_name().and_then(|name| Name::parse(name.to_str()?));
    let Some(name) = name else { return Ok(vec![absolute]) };
    let (run, parallel) = run_folder(absolute.parent().unwrap_or(Path::new("/")));
    let output = Output { parallel, name };
    let mut files = all(run)?;
    files.retain(|(of, _)| *of == output);
    Ok(files.into_iter().map(|(_, file)| file).collect())
}

fn of_folder(path: &Path, absolute: &Path) -> Result<Vec<PathBuf>> {
    let files = all(run_folder(absolute).0)?;
    let mut outputs: Vec<&Output> = files.iter().map(|(output, _)| output).collect();
    outputs.dedup();
    if let [_, .., _] = outputs.as_slice() {
        let shown = |at: Option<&(Output, PathBuf)>| {
            at.map_or(String::new(), |(_, file)| file.display().to_string())
        };
        return Err(Error::request(format!(
            "{}: holds {} Athena outputs, from {} to {}: name a file of one of them",
            path.display(),
            outputs.len(),
            shown(files.first()),
            shown(files.last())
        )));
    }
    Ok(files.into_iter().map(|(_, file)| file).collect())
}

/// All files of all outputs of the run in `folder`, output by output.
fn all(folder: &Path) -> Result<Vec<(Output, PathBuf)>> {
    let mut files = Vec::new();
    let top = entries(folder)?;
    add(&top, false, &mut files)?;
    for process in top.iter().filter(|entry| is_numbered(entry, "id") && entry.is_dir()) {
        add(&entries(process)?, true, &mut files)?;
    }
    files.sort();
    Ok(files)
}

/// Adds the files among `entries` and in folders of levels among them.
fn add(entries_here: &[PathBuf], parallel: bool, to: &mut Vec<(Output, PathBuf)>) -> Result<()> {
    for entry in entries_here {
        if is_numbered(entry, "lev") && entry.is_dir() {
            for file in entries(entry)? {
                to.extend(with_output(file, parallel));
            }
        }
        to.extend(with_output(entry.clone(), parallel));
    }
    Ok(())
}

fn with_output(file: PathBuf, parallel: bool) -> Option<(Output, PathBuf)> {
    let name = Name::parse(file.file_name()?.to_str()?)?;
    file.is_file().then_some((Output { parallel, name }, file))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_tell_what_belongs_together() {
        let name = |base: &str, number: &str, id: &str| {
            Some(Name { base: base.into(), number: number.into(), id: id.into() })
        };
        for file in [
            "Blast.0010.vtk",
            "Blast-id3.0010.vtk",
            "Blast-lev1.0010.vtk",
            "Blast-id12-lev2-dom3.0010.vtk",
        ] {
            assert_eq!(Name::parse(file), name("Blast", "0010", ""), "{file}");
        }
        assert_eq!(Name::parse("b.x-id3-dom2.0001.d.vtk"), name("b.x", "0001", "d"));
        assert_eq!(Name::parse("joined.vtk"), name("joined", "", ""));
        assert_eq!(Name::parse("B-lev.0001.vtk"), name("B-lev", "0001", ""));
        assert_eq!(Name::parse("0001.vtk"), name("0001", "", ""));
        assert_eq!(Name::parse("Blast.0010.tab"), None);
    }

    #[test]
    fn any_file_and_the_folder_mean_the_output() {
        let run = tempfile::tempdir().unwrap();
        let names = [
            "id0/B.0001.vtk",
            "id0/lev1/B-lev1.0001.vtk",
            "id1/B-id1.0001.vtk",
            "id1/lev1/B-id1-lev1-dom2.0001.vtk",
        ];
        for name in names {
            let file = run.path().join(name);
            std::fs::create_dir_all(file.parent().unwrap()).unwrap();
            std::fs::write(&file, "").unwrap();
        }
        let expected: Vec<PathBuf> = names.iter().map(|name| run.path().join(name)).collect();
        for name in names.iter().copied().chain([".", "id0", "id1/lev1"]) {
            let mut found = of_output(&run.path().join(name)).unwrap();
            found.sort();
            assert_eq!(found, expected, "{name}");
        }
        // A file joined from the processes' is an output of its own.
        std::fs::write(run.path().join("B.0001.vtk"), "").unwrap();
        let joined = of_output(&run.path().join("B.0001.vtk")).unwrap();
        assert_eq!(joined, [run.path().join("B.0001.vtk")]);
        assert_eq!(of_output(&expected[0]).unwrap().len(), 4);
        let error = of_output(run.path()).unwrap_err().to_string();
        assert!(error.contains("holds 2 Athena outputs"), "{error}");
    }
}
