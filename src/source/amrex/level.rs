//! The grids of a level: `Cell_H`, which lists their boxes and where their values are.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use super::fab::{FabHeader, described};
use super::header::LevelGrids;
use super::text::{PrintedBox, numbers, stays_inside};
use crate::source::lines::{Lines, shown};
use crate::source::open_file::OpenFile;
use crate::source::raw::Number;
use crate::space::IndexBox;
use crate::{Error, Result, regular_file};

/// Versions of the file: 1 has a header before each FAB, 2 to 4 describe all numbers at the end.
const WITH_FAB_HEADERS: i64 = 1;
const VERSIONS: std::ops::RangeInclusive<i64> = 1..=4;
/// What is read of the file's end for the description of numbers.
const TAIL: u64 = 4096;
/// Bytes of the smallest number that a FAB can hold.
const SMALLEST_NUMBER: u64 = 4;
/// Most bytes of a line that says where a FAB is.
const LONGEST_PLACE: usize = 1024;

/// The data of a level.
#[derive(Debug)]
pub(super) struct LevelData {
    /// `Cell_H`.
    path: PathBuf,
    components: u64,
    /// Ghost cells around every grid along each axis.
    ghosts: [i64; 3],
    /// How numbers are stored, in versions without FAB headers.
    number: Option<Number>,
    grids: u64,
    /// Where the list of boxes begins.
    boxes: u64,
}

/// Where a grid's values are.
#[derive(Debug)]
pub(super) struct Fab {
    /// The file that has them.
    pub(super) file: OpenFile,
    /// Cells, components, numbers and where they begin.
    pub(super) header: FabHeader,
}

/// A data file's bytes, and how many of them grids are known to take: what is not there need not be
/// sorted into a tree first.
struct Room {
    length: u64,
    taken: u128,
}

impl Room {
    /// Takes `bytes` after byte `offset`.
    ///
    /// # Errors
    /// The reason, where the file is too short for them, or for all that were taken.
    fn take(&mut self, bytes: u128, offset: u64) -> Result<(), String> {
        let length = self.length;
        if u128::from(length.saturating_sub(offset)) < bytes {
            return Err(format!(
                "its values take {bytes} bytes or more from byte {offset}, but the file ends \
                 at byte {length}: is it truncated?"
            ));
        }
        self.taken = self.taken.saturating_add(bytes);
        if u128::from(length) < self.taken {
            return Err(format!(
                "its values and those of grids before it take {} bytes or more, but the file has {length}: \
                 does Cell_H name a place twice?",
                self.taken
            ));
        }
        Ok(())
    }
}

impl LevelData {
    /// Reads the start of the file of `level`, in the plotfile at `folder`.
    ///
    /// # Errors
    /// A file that cannot be read, is malformed, or contradicts the plotfile's `Header`.
    pub(super) fn open(folder: &Path, level: &LevelGrids, components: usize) -> Result<Self> {
        let path = folder.join(format!("{}_H", level.data));
        let mut lines = Lines::open(&path)?;
        let version = lines.parse("version 1, 2, 3 or 4 of the format", |text| {
            text.parse().ok().filter(|version| VERSIONS.contains(version))
        })?;
        lines.expect("how the data were written")?;
        let found: u64 = lines.parse("the number of components", |text| text.parse().ok())?;
        if found != components as u64 {
            let reason = format!("has {found} components, but Header names {components}");
            return Err(lines.fault(&reason));
        }
        let ghosts = lines.parse("the number of ghost cells", ghosts)?;
        let grids = lines.parse("the number of boxes", |text| {
            numbers(text)?.first().and_then(|&count| u64::try_from(count).ok())
        })?;
        if grids != level.count {
            let reason = format!("has {grids} grids, but Header names {}", level.count);
            return Err(lines.fault(&reason));
        }
        let number = match version {
            WITH_FAB_HEADERS => None,
            _ => Some(number_at_end(&path)?),
        };
        let boxes = lines.offset();
        Ok(Self { path, components: found, ghosts, number, grids, boxes })
    }

    /// Number of grids.
    pub(super) fn count(&self) -> u64 {
        self.grids
    }

    /// Hands the box of every grid to `visit`, with where in `Cell_H` the line stands that tells
    /// its data. Boxes and places are read side by side, so neither list is kept.
    ///
    /// # Errors
    /// Malformed lists, boxes of more cells than their files can hold; and what `visit` returns.
    pub(super) fn for_each_grid(
        &self,
        visit: &mut dyn FnMut(u64, PrintedBox, u64) -> Result<()>,
    ) -> Result<()> {
        let mut places = Lines::open_at(&self.path, self.boxes)?;
        for _ in 0..self.grids {
            places.expect("a grid's box")?;
        }
        places.parse("the end of the boxes", |text| (text == ")").then_some(()))?;
        places.parse("the number of FABs", |text| {
            text.parse().ok().filter(|&count: &u64| count == self.grids)
        })?;
        let mut boxes = Lines::open_at(&self.path, self.boxes)?;
        let mut files = HashMap::new();
        for grid in 0..self.grids {
            let cells = boxes.parse("a grid's box", PrintedBox::parse)?;
            let place = places.offset();
            let (name, offset) = places.parse("a FabOnDisk", |text| {
                fab_on_disk(text).map(|(name, offset)| (name.to_owned(), offset))
            })?;
            let room = match files.entry(name.clone()) {
                Entry::Occupied(known) => known.into_mut(),
                Entry::Vacant(new) => new.insert(Room { length: self.length(&name)?, taken: 0 }),
            };
            let fault = |reason: String| Error::invalid(self.place(grid), reason);
            let bytes = self.bytes(&cells).map_err(fault)?;
            room.take(bytes, offset).map_err(|reason| fault(format!("{name}: {reason}")))?;
            visit(grid, cells, place)?;
        }
        Ok(())
    }

    /// Where grid `grid` is listed, for messages.
    pub(super) fn place(&self, grid: u64) -> String {
        format!("{}: grid {grid}", self.path.display())
    }

    /// Size of the data file `name`, bytes.
    fn length(&self, name: &str) -> Result<u64> {
        let path = self.data_file(name)?;
        let metadata = std::fs::metadata(&path);
        Ok(metadata.map_err(|e| Error::io(&path, "cannot open", e))?.len())
    }

    fn data_file(&self, name: &str) -> Result<PathBuf> {
        if stays_inside(name) {
            return Ok(self.path.with_file_name(name));
        }
        let reason = format!("`{}` is no file of the plotfile", shown(name));
        Err(Error::invalid(self.path.display(), reason))
    }

    /// The fewest bytes that the values in `cells` take.
    fn bytes(&self, cells: &PrintedBox) -> Result<u128, String> {
        let cells: u128 = cells.size()?.iter().map(|&n| u128::from(n)).product();
        let number = self.number.map_or(SMALLEST_NUMBER, Number::bytes);
        Ok(cells.saturating_mul(u128::from(self.components)).saturating_mul(u128::from(number)))
    }

    /// The FAB of the grid of `cells`, which the line at byte `place` of `Cell_H` tells.
    ///
    /// # Errors
    /// Data that are missing or contradict `Cell_H`.
    pub(super) fn fab(&self, cells: &IndexBox, place: u64) -> Result<Fab> {
        let (path, offset) = self.data_at(place)?;
        let file = OpenFile::open(&path)?;
        let header = match self.number {
            None => FabHeader::read(&file, offset)?,
            Some(number) => FabHeader {
                cells: self.with_ghosts(cells),
                components: self.components,
                number,
                start: offset,
            },
        };
        let stated = self.with_ghosts(cells);
        if header.cells != stated || header.components != self.components {
            let last = |cells: &IndexBox| cells.hi.map(|i| i - 1);
            let reason = format!(
                "the FAB has {} components of the cells {:?} to {:?}, but Cell_H gives it {} of \
                 {:?} to {:?}, ghost cells included: are they of one output?",
                header.components,
                header.cells.lo,
                last(&header.cells),
                self.components,
                stated.lo,
                last(&stated)
            );
            return Err(Error::invalid(format!("{}: byte {offset}", path.display()), reason));
        }
        Ok(Fab { file, header })
    }

    /// The file and the byte of it where the FAB begins that the line at byte `place` of `Cell_H`
    /// tells.
    ///
    /// # Errors
    /// A line that tells no place, or one outside the plotfile.
    pub(super) fn data_at(&self, place: u64) -> Result<(PathBuf, u64)> {
        let line = self.line_at(place)?;
        let (name, offset) = fab_on_disk(&line).ok_or_else(|| {
            Error::invalid(self.path.display(), format!("`{}` is no FabOnDisk", shown(&line)))
        })?;
        Ok((self.data_file(name)?, offset))
    }

    fn with_ghosts(&self, cells: &IndexBox) -> IndexBox {
        IndexBox {
            lo: std::array::from_fn(|a| cells.lo[a] - i128::from(self.ghosts[a])),
            hi: std::array::from_fn(|a| cells.hi[a] + i128::from(self.ghosts[a])),
        }
    }

    /// The line at byte `place` of `Cell_H`.
    fn line_at(&self, place: u64) -> Result<String> {
        let failed = |e| Error::io(&self.path, "cannot read", e);
        let file = regular_file::open(&self.path).map_err(failed)?;
        let mut bytes = [0; LONGEST_PLACE];
        let read = file.read_at(&mut bytes, place).map_err(failed)?;
        let line = bytes[..read].split(|&byte| byte == b'\n').next().unwrap_or(&[]);
        Ok(String::from_utf8_lossy(line).into_owned())
    }
}

/// Ghost cells as printed: one number, or one for each axis in brackets.
fn ghosts(text: &str) -> Option<[i64; 3]> {
    let list = numbers(text)?;
    let ghosts = match *list.as_slice() {
        [all] => [all; 3],
        [x, y, z] => [x, y, z],
        _ => return None,
    };
    ghosts.iter().all(|ghosts| (0..=1 << 20).contains(ghosts)).then_some(ghosts)
}

/// File name and offset of `FabOnDisk: Cell_D_00000 81920`.
fn fab_on_disk(text: &str) -> Option<(&str, u64)> {
    let mut words = text.strip_prefix("FabOnDisk:")?.split_whitespace();
    let (name, offset) = (words.next()?, words.next()?);
    offset.parse().ok().filter(|_| words.next().is_none()).map(|offset| (name, offset))
}

/// How numbers are stored, by the last line of the file at `path` that describes it.
fn number_at_end(path: &Path) -> Result<Number> {
    let failed = |e| Error::io(path, "cannot read", e);
    let file = regular_file::open(path).map_err(failed)?;
    let length = file.metadata().map_err(failed)?.len();
    let tail = length.min(TAIL);
    let mut bytes = vec![0; tail as usize];
    file.read_exact_at(&mut bytes, length - tail).map_err(failed)?;
    let text = String::from_utf8_lossy(&bytes);
    let described = match text.lines().map(str::trim).rfind(|line| line.starts_with("((")) {
        Some(line) => described(line),
        None => Err("ends without a description of its numbers: is it truncated?".to_owned()),
    };
    described.map_err(|reason| Error::invalid(path.display(), reason))
}
