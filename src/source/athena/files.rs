//! The files of one output: `NAME[-idP][-levL][-domD].NNNN[.ID].vtk`, one for each domain and
//! process, those of levels above the root in folders `levL`, those of processes in `idP`.
//!
//! `NAME` may itself end like the parts after it: folders and titles tell which of them are there.

use std::collections::{BTreeMap, HashSet};
use std::path::{Path, PathBuf};

use super::header::Title;
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
    /// The output that the file at `path` belongs to.
    fn parse(path: &Path) -> Option<Self> {
        let (base, number, id) = split(path)?;
        let base = without_parts(&base, path).to_owned();
        Some(Self { base, number: number.to_owned(), id: id.to_owned() })
    }
}

/// What stands before an output's number in a file's name, the number, and what stands after it.
fn split(path: &Path) -> Option<(String, &str, &str)> {
    let stem = path.file_name()?.to_str()?.strip_suffix(".vtk")?;
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    let parts: Vec<&str> = stem.split('.').collect();
    let (base, number, id) = match parts.as_slice() {
        [base @ .., number] if !base.is_empty() && is_number(number) => (base, *number, ""),
        [base @ .., number, id] if !base.is_empty() && is_number(number) => (base, *number, *id),
        base => (base, "", ""),
    };
    Some((base.join("."), number, id))
}

/// The run's name in `base`, without the parts that Athena appends: it numbers neither the first
/// process, nor the root level, nor a level's first domain, but for levels that follow on one of several
/// domains, whose number some versions keep.
fn without_parts<'a>(base: &'a str, path: &Path) -> &'a str {
    let folder = path.parent().unwrap_or(Path::new(""));
    let level = numbered(folder, "lev");
    // Files are opened only where neither name nor folder tells.
    let is_open =
        level.is_none() && (ends_with_number(base, "-dom") || ends_with_number(base, "-lev"));
    let title = if is_open { Title::of(path) } else { None };
    let level = level.or(title.map(|title| title.level.into()));
    let base = match level.filter(|level| *level > 0) {
        Some(level) => without_level(base, level),
        None => {
            let base = without(base, "-dom", title.map(|title| title.domain.into()));
            without(base, "-lev", level)
        }
    };
    without(base, "-id", process(path))
}

/// `base` without the parts of a file of `level`, whose domain's number is not always its own.
fn without_level(base: &str, level: u64) -> &str {
    let whole = without(base, "-dom", None);
    let before = without(whole, "-lev", Some(level));
    if before.len() < whole.len() { before } else { without(base, "-lev", Some(level)) }
}

fn ends_with_number(base: &str, part: &str) -> bool {
    without(base, part, None).len() < base.len()
}

/// `base` without `part` and a number at its end: `expected`, if that is known.
fn without<'a>(base: &'a str, part: &str, expected: Option<u64>) -> &'a str {
    let found = base.rsplit_once(part).and_then(|(before, number)| {
        let number = number.parse::<u64>().ok().filter(|&n| n > 0)?;
        (expected.is_none() || expected == Some(number)).then_some(before)
    });
    found.unwrap_or(base)
}

/// One output of a run.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Output {
    /// Whether its files stand in a folder for each process.
    parallel: bool,
    name: Name,
}

impl Output {
    /// The output that the file at `path` belongs to.
    fn of(path: &Path) -> Option<Self> {
        Some(Self { parallel: process(path).is_some(), name: Name::parse(path)? })
    }

    /// Whether the output differs from `other` by its number alone.
    fn is_of_series(&self, other: &Self) -> bool {
        let key =
            |output: &Self| (output.parallel, output.name.base.clone(), output.name.id.clone());
        key(self) == key(other)
    }
}

/// The path of a file without its output's `number`: the same for that file of all outputs of a run.
fn part(file: &Path, number: &str) -> String {
    file.to_string_lossy().replace(&format!(".{number}."), ".")
}

/// The number in `folder`'s name, where that is `prefix` and a number.
fn numbered(folder: &Path, prefix: &str) -> Option<u64> {
    let number = folder.file_name()?.to_str()?.strip_prefix(prefix)?;
    number.parse().ok().filter(|_| number.bytes().all(|b| b.is_ascii_digit()))
}

/// The folder of the run whose files stand in `folder`, and the process whose folder that is.
fn run_folder(folder: &Path) -> (&Path, Option<u64>) {
    let above = |folder, prefix| numbered(folder, prefix).and(folder.parent());
    let run = above(folder, "lev").unwrap_or(folder);
    match above(run, "id") {
        Some(above) => (above, numbered(run, "id")),
        None => (run, None),
    }
}

/// The process that wrote the file at `path`, where it stands in the folder of one.
pub(super) fn process(path: &Path) -> Option<u64> {
    run_folder(path.parent()?).1
}

/// One of the files that `folder` holds or the run that it is part of, of whatever output.
pub(super) fn any(folder: &Path) -> Option<PathBuf> {
    let absolute = std::path::absolute(folder).ok()?;
    listed(run_folder(&absolute).0).ok()?.into_iter().next()
}

/// The files of an output.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Files {
    /// Its own.
    pub(super) own: Vec<PathBuf>,
    /// Of parts of the mesh that other outputs of the run have files of, and this one has none, one
    /// such file each.
    pub(super) elsewhere: Vec<PathBuf>,
}

/// The files of the output that `path` means: one of its files, or a folder with one output.
///
/// # Errors
/// A folder that cannot be read, or that holds several outputs.
pub(super) fn of_output(path: &Path) -> Result<Files> {
    let absolute =
        std::path::absolute(path).map_err(|e| Error::io(path, "cannot be made absolute", e))?;
    if absolute.is_dir() {
        return Ok(Files { own: of_folder(path, &absolute)?, ..Files::default() });
    }
    let Some(output) = Output::of(&absolute) else {
        return Ok(Files { own: vec![absolute], ..Files::default() });
    };
    let (run, _) = run_folder(absolute.parent().unwrap_or(Path::new("/")));
    let (mut own, mut has, mut parts) = (Vec::new(), HashSet::new(), BTreeMap::new());
    for file in listed(run)? {
        let Some((_, number, id)) = split(&file) else { continue };
        let part = part(&file, number);
        if number != output.name.number && id == output.name.id {
            parts.entry(part).or_insert(file);
        } else if Output::of(&file).as_ref() == Some(&output) {
            has.insert(part);
            own.push(file);
        }
    }
    parts.retain(|part, _| !has.contains(part));
    let others = parts.into_values();
    let of_series = |file: &PathBuf| Output::of(file).is_some_and(|of| of.is_of_series(&output));
    Ok(Files { own, elsewhere: others.filter(of_series).collect() })
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
    let with_output = |file: PathBuf| Some((Output::of(&file)?, file));
    let mut files: Vec<_> = listed(folder)?.into_iter().filter_map(with_output).collect();
    files.sort();
    Ok(files)
}

/// All files in `folder` and in folders of processes and levels there, in order.
fn listed(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    let top = entries(folder)?;
    for process in top.iter().filter(|entry| numbered(entry, "id").is_some() && entry.is_dir()) {
        add(entries(process)?, &mut files)?;
    }
    add(top, &mut files)?;
    files.sort();
    Ok(files)
}

/// Adds the files among `here` and in folders of levels among them.
fn add(here: Vec<PathBuf>, to: &mut Vec<PathBuf>) -> Result<()> {
    for entry in here {
        if numbered(&entry, "lev").is_some() && entry.is_dir() {
            to.extend(entries(&entry)?.into_iter().filter(|file| is_vtk(file)));
        } else if is_vtk(&entry) {
            to.push(entry);
        }
    }
    Ok(())
}

fn is_vtk(path: &Path) -> bool {
    split(path).is_some() && path.is_file()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Parses the name of a file that is not there.
    fn parse(file: &str) -> Option<Name> {
        Name::parse(&Path::new("/nowhere/run").join(file))
    }

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
            assert_eq!(parse(file), name("Blast", "0010", ""), "{file}");
        }
        assert_eq!(parse("b.x-id3-dom2.0001.d.vtk"), name("b.x", "0001", "d"));
        assert_eq!(parse("joined.vtk"), name("joined", "", ""));
        assert_eq!(parse("B-lev.0001.vtk"), name("B-lev", "0001", ""));
        assert_eq!(parse("0001.vtk"), name("0001", "", ""));
        assert_eq!(parse("Blast.0010.tab"), None);
    }

    #[test]
    fn folders_tell_parts_from_names_that_end_like_them() {
        for (file, base) in [
            ("id0/B-id1.0001.vtk", "B-id1"),
            ("id1/B-id1-id1.0001.vtk", "B-id1"),
            ("id1/lev2/B-id1-id1-lev2.0001.vtk", "B-id1"),
            ("id0/lev2/B-lev1-lev2.0001.vtk", "B-lev1"),
            ("lev2/B-lev2-lev2.0001.vtk", "B-lev2"),
            ("B-lev0-dom0.0001.vtk", "B-lev0-dom0"),
        ] {
            assert_eq!(parse(file).unwrap().base, base, "{file}");
        }
    }

    #[test]
    fn titles_tell_parts_from_names_that_end_like_them() {
        let run = tempfile::tempdir().unwrap();
        for (name, level, domain) in [
            ("B-dom1.0001.vtk", 0, 0),
            ("lev1/B-dom1-lev1.0001.vtk", 1, 0),
            ("lev1/B-dom1-lev1-dom1.0001.vtk", 1, 1),
            ("lev2/B-dom1-lev2-dom1.0001.vtk", 2, 0),
            ("C-lev1.0001.vtk", 0, 0),
            ("lev1/C-lev1-lev1.0001.vtk", 1, 0),
        ] {
            let file = run.path().join(name);
            std::fs::create_dir_all(file.parent().unwrap()).unwrap();
            let title = format!("PRIMITIVE vars at time= 0, level= {level}, domain= {domain}");
            std::fs::write(&file, format!("# vtk DataFile Version 2.0\n{title}\n")).unwrap();
        }
        for (name, files) in [("B-dom1.0001.vtk", 4), ("C-lev1.0001.vtk", 2)] {
            assert_eq!(of_output(&run.path().join(name)).unwrap().own.len(), files, "{name}");
        }
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
            let mut found = of_output(&run.path().join(name)).unwrap().own;
            found.sort();
            assert_eq!(found, expected, "{name}");
        }
        // A file joined from the processes' is an output of its own.
        std::fs::write(run.path().join("B.0001.vtk"), "").unwrap();
        let joined = of_output(&run.path().join("B.0001.vtk")).unwrap().own;
        assert_eq!(joined, [run.path().join("B.0001.vtk")]);
        assert_eq!(of_output(&expected[0]).unwrap().own.len(), 4);
        let error = of_output(run.path()).unwrap_err().to_string();
        assert!(error.contains("holds 2 Athena outputs"), "{error}");
    }
}
