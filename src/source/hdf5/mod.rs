//! HDF5 files behind one small interface: the one place that knows an HDF5 library.
//!
//! The library is `hdf5-reader` (pure Rust), or the C library with the feature `libhdf5`. Both
//! return the same values; a file's claims never make either reserve more than `READ_VALUES`
//! at a time or what the file really holds.

#[cfg(any(test, not(feature = "libhdf5")))]
mod extended;
#[cfg(feature = "libhdf5")]
mod native;
mod pool;
#[cfg(any(test, not(feature = "libhdf5")))]
mod pure;
#[cfg(any(test, not(feature = "libhdf5")))]
mod pure_number;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

pub use pool::Pool;
#[cfg(test)]
pub(crate) use tests::quadruple;

use crate::{Error, Result, regular_file};

#[cfg(feature = "libhdf5")]
type Library = native::Native;
#[cfg(not(feature = "libhdf5"))]
type Library = pure::Pure;

/// Most values that one call of the library reads; larger blocks are read in parts.
const READ_VALUES: usize = 1 << 19;
/// Most values of a list that is read whole, [`File::values`].
const LIST_VALUES: usize = 1 << 20;

/// More values than a byte of a file can stand for: deflate shrinks to a 1032nd at best.
const MOST_VALUES_PER_BYTE: u128 = 1100;
/// Most rows of a table that is read whole, [`File::table`].
const TABLE_ROWS: u64 = 1 << 16;

/// What a dataset's elements are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Element {
    /// IEEE numbers of 16, 32 or 64 bits, either byte order.
    Float,
    /// Numbers of 80 or 128 bits as C's `long double`, which are read in lists alone.
    Extended,
    /// Signed or unsigned integers of 8 to 64 bits, either byte order.
    Integer,
    /// Strings of fixed or variable length.
    Text,
    /// Anything else: present, but not read.
    Other,
}

/// A dataset's shape, slowest axis first, and kind of elements.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Dataset {
    /// Extents, slowest axis first; empty for a scalar.
    pub shape: Vec<u64>,
    /// What the elements are.
    pub element: Element,
}

/// Names of a group's members.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Members {
    /// Groups, sorted.
    pub groups: Vec<String>,
    /// Datasets, sorted.
    pub datasets: Vec<String>,
}

/// An attribute's or a list's values; a scalar is a list of one.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// Integers; those beyond i64 are held at its limit.
    Integers(Vec<i64>),
    /// Floating point numbers.
    Floats(Vec<f64>),
    /// Floating point numbers of more than 64 bits, each the sum of two doubles, the first alone nearly
    /// the number.
    Extended(Vec<[f64; 2]>),
    /// Strings without padding.
    Text(Vec<String>),
}

impl Values {
    /// The integers, if these are `N` of them.
    pub fn integers<const N: usize>(&self) -> Option<[i64; N]> {
        match self {
            Self::Integers(list) => list.as_slice().try_into().ok(),
            _ => None,
        }
    }

    /// The floating point numbers, if these are `N` of them.
    pub fn floats<const N: usize>(&self) -> Option<[f64; N]> {
        match self {
            Self::Floats(list) => list.as_slice().try_into().ok(),
            _ => None,
        }
    }

    /// The floating point numbers of whatever size, each the sum of two doubles, if these are `N` of them.
    pub fn sums<const N: usize>(&self) -> Option<[[f64; 2]; N]> {
        match self {
            Self::Extended(list) => list.as_slice().try_into().ok(),
            _ => Some(self.floats()?.map(|number| [number, 0.0])),
        }
    }

    /// The string, if this is one.
    pub fn text(&self) -> Option<&str> {
        match self {
            Self::Text(list) if list.len() == 1 => list.first().map(String::as_str),
            _ => None,
        }
    }
}

/// What an HDF5 library offers. Reasons of failure are plain text; [`File`] adds the place.
trait Backend: Send + Sync {
    /// Opens the file at `path`.
    fn open(path: &Path) -> Result<Self, String>
    where
        Self: Sized;

    /// How many bytes of decoded values it may keep at most, when nothing is read.
    fn cached_bytes(&self) -> usize;

    /// Names in a group.
    fn members(&self, group: &str) -> Result<Members, String>;

    /// A group's attributes; those of a kind that [`Values`] does not hold are left out.
    fn attributes(&self, group: &str) -> Result<BTreeMap<String, Values>, String>;

    /// A dataset's shape and elements.
    fn dataset(&self, path: &str) -> Result<Dataset, String>;

    /// All strings of a dataset.
    fn strings(&self, path: &str) -> Result<Vec<String>, String>;

    /// All numbers of a dataset of [`Element::Extended`], where the backend knows any.
    fn extended(&self, _path: &str) -> Result<Vec<[f64; 2]>, String> {
        Err("its elements are not numbers that can be read".to_owned())
    }

    /// Rows of a table of names and values: their members `name` and `value`, wherever in a row
    /// these lie. Values are lists of one.
    fn named_values(&self, path: &str) -> Result<Vec<(String, Values)>, String>;

    /// The block of `count` elements from `start`, as f64, last axis fastest.
    fn read_f64(
        &self,
        path: &str,
        start: &[u64],
        count: &[u64],
        out: &mut [f64],
    ) -> Result<(), String>;

    /// The block of `count` integers from `start`, last axis fastest.
    fn read_i64(
        &self,
        path: &str,
        start: &[u64],
        count: &[u64],
        out: &mut [i64],
    ) -> Result<(), String>;
}

/// An open HDF5 file. Reading may happen on several threads at once.
pub struct File {
    path: PathBuf,
    backend: Box<dyn Backend>,
}

impl File {
    /// Opens `path` for reading.
    ///
    /// # Errors
    /// A file that cannot be opened or is not HDF5.
    pub fn open(path: &Path) -> Result<Self> {
        Self::open_with::<Library>(path)
    }

    fn open_with<B: Backend + 'static>(path: &Path) -> Result<Self> {
        regular_file::open(path).map_err(|e| Error::io(path, "cannot open", e))?;
        let backend = B::open(path).map_err(|reason| {
            Error::invalid(path.display(), format!("cannot be read as HDF5: {reason}"))
        })?;
        Ok(Self { path: path.to_path_buf(), backend: Box::new(backend) })
    }

    /// The file's path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// How many bytes of decoded values the file may keep at most: [`Backend::cached_bytes`].
    fn cached_bytes(&self) -> usize {
        self.backend.cached_bytes()
    }

    /// Refuses a file too short to hold `count` blocks of `cells` numbers, however well compressed:
    /// lists that long must not be walked, as datasets without data read as endless zeros.
    ///
    /// # Errors
    /// A file that is too short, or one whose size cannot be read.
    pub fn check_holds(&self, count: u64, cells: u128) -> Result<()> {
        let bytes = std::fs::metadata(&self.path)
            .map_err(|e| Error::io(&self.path, "cannot read the size", e))?
            .len();
        let values = u128::from(count).checked_mul(cells);
        let fits = |values| values <= u128::from(bytes) * MOST_VALUES_PER_BYTE;
        if count <= bytes && values.is_some_and(fits) {
            return Ok(());
        }
        let reason =
            format!("claims {count} blocks of {cells} cells, which its {bytes} bytes cannot hold");
        Err(Error::invalid(self.path.display(), reason))
    }

    /// Names in group `group` (`/` is the root).
    ///
    /// # Errors
    /// No such group, or a damaged one.
    pub fn members(&self, group: &str) -> Result<Members> {
        let mut members = self.backend.members(group).map_err(|e| self.fault(group, e))?;
        members.groups.sort();
        members.datasets.sort();
        Ok(members)
    }

    /// Attributes of group `group`; those that are neither numbers nor strings are left out.
    ///
    /// # Errors
    /// No such group, or a damaged one.
    pub fn attributes(&self, group: &str) -> Result<BTreeMap<String, Values>> {
        self.backend.attributes(group).map_err(|e| self.fault(group, e))
    }

    /// Shape and elements of the dataset at `path`.
    ///
    /// # Errors
    /// No such dataset, or a damaged one.
    pub fn dataset(&self, path: &str) -> Result<Dataset> {
        self.backend.dataset(path).map_err(|e| self.fault(path, e))
    }

    /// All values of a short list: a scalar, or a dataset with one axis longer than 1.
    ///
    /// # Errors
    /// No such dataset, one of more axes or more than a million values, or one that is neither
    /// numbers nor strings.
    pub fn values(&self, path: &str) -> Result<Values> {
        let Dataset { shape, element } = self.dataset(path)?;
        let length = shape.first().copied().unwrap_or(1);
        let length = usize::try_from(length).unwrap_or(usize::MAX);
        if shape.iter().skip(1).any(|&n| n != 1) || length > LIST_VALUES {
            return Err(self.fault(path, format!("expected a short list, found shape {shape:?}")));
        }
        let start = vec![0; shape.len()];
        match element {
            Element::Float => {
                let mut list = vec![0.0; length];
                self.read_f64(path, &start, &shape, &mut list)?;
                Ok(Values::Floats(list))
            }
            Element::Integer => {
                let mut list = vec![0; length];
                self.read_i64(path, &start, &shape, &mut list)?;
                Ok(Values::Integers(list))
            }
            Element::Text => {
                Ok(Values::Text(self.backend.strings(path).map_err(|e| self.fault(path, e))?))
            }
            Element::Extended => {
                Ok(Values::Extended(self.backend.extended(path).map_err(|e| self.fault(path, e))?))
            }
            Element::Other => {
                let other = if cfg!(feature = "libhdf5") {
                    "; a build without the feature libhdf5 may read it"
                } else {
                    ""
                };
                let reason = "is neither numbers of a kind that is read nor strings";
                Err(self.fault(path, format!("{reason}{other}")))
            }
        }
    }

    /// A table of names and values: a 1-D dataset of compounds with members `name` (a string of
    /// fixed length) and `value` (a number or such a string). Each value is a list of one.
    ///
    /// # Errors
    /// No such dataset, one of other elements or of more than 65,536, or a damaged one.
    pub fn table(&self, path: &str) -> Result<BTreeMap<String, Values>> {
        let shape = self.dataset(path)?.shape;
        if shape.len() > 1 || shape.first().is_some_and(|&rows| rows > TABLE_ROWS) {
            return Err(self.fault(path, format!("expected a short table, found shape {shape:?}")));
        }
        let rows = self.backend.named_values(path).map_err(|e| self.fault(path, e))?;
        Ok(rows.into_iter().collect())
    }

    /// Reads the block of `count` elements from `start` (both slowest axis first) of the dataset
    /// at `path` into `out`, last axis fastest, widened to f64.
    ///
    /// # Errors
    /// No such dataset, a block that is not inside it or not of `out`'s length, elements that are
    /// not numbers, damaged or missing data.
    pub fn read_f64(
        &self,
        path: &str,
        start: &[u64],
        count: &[u64],
        out: &mut [f64],
    ) -> Result<()> {
        self.check_block(path, start, count, out.len())?;
        read_in_parts(start, count, out, &mut |start, count, out| {
            self.backend.read_f64(path, start, count, out).map_err(|e| self.fault(path, e))
        })
    }

    /// [`Self::read_f64`] for integers, kept exact; those beyond i64 are held at its limit.
    ///
    /// # Errors
    /// What [`Self::read_f64`] refuses, and elements that are not integers.
    pub fn read_i64(
        &self,
        path: &str,
        start: &[u64],
        count: &[u64],
        out: &mut [i64],
    ) -> Result<()> {
        self.check_block(path, start, count, out.len())?;
        read_in_parts(start, count, out, &mut |start, count, out| {
            self.backend.read_i64(path, start, count, out).map_err(|e| self.fault(path, e))
        })
    }

    fn check_block(&self, path: &str, start: &[u64], count: &[u64], len: usize) -> Result<()> {
        let shape = self.dataset(path)?.shape;
        let inside = shape.len() == start.len()
            && shape.len() == count.len()
            && (0..shape.len())
                .all(|a| start[a].checked_add(count[a]).is_some_and(|end| end <= shape[a]));
        let values = count.iter().try_fold(1u64, |product, &n| product.checked_mul(n));
        if inside && values == u64::try_from(len).ok() {
            return Ok(());
        }
        let reason = format!(
            "a block of {count:?} values from {start:?} was asked for, the dataset has {shape:?}"
        );
        Err(self.fault(path, reason))
    }

    fn fault(&self, object: &str, reason: impl Into<String>) -> Error {
        let reason = reason.into();
        // The library names the object as well, sometimes.
        let named = reason.strip_prefix(object).and_then(|rest| rest.strip_prefix(": "));
        let reason = named.unwrap_or(&reason).to_owned();
        Error::invalid(format!("{}: {object}", self.path.display()), reason)
    }
}

/// Whether a file starts as HDF5 files do (a user block before it is not looked behind).
pub fn is_hdf5(path: &Path) -> bool {
    starts_at(path, 0)
}

/// Why what starts as HDF5 files do cannot be read as one: it is truncated, or its root group damaged.
/// Where no format is told by the content, that may be why.
pub fn damage(path: &Path) -> Option<Error> {
    let read = || {
        let file = File::open(path)?;
        file.members("/")?;
        file.attributes("/")
    };
    is_hdf5(path).then(read)?.err()
}

/// Whether what starts as HDF5 files do stands behind a user block, of 512 bytes or twice, four times
/// that, and so on (HDF5 File Format Specification, II.A): such files are not read.
pub fn is_behind_user_block(path: &Path) -> bool {
    const LARGEST: u32 = 20;
    (9..=LARGEST).any(|power| starts_at(path, 1 << power))
}

fn starts_at(path: &Path, place: u64) -> bool {
    const SIGNATURE: &[u8; 8] = b"\x89HDF\r\n\x1a\n";
    let mut start = [0; 8];
    let read = regular_file::open(path).and_then(|mut file| {
        file.seek(SeekFrom::Start(place))?;
        file.read_exact(&mut start)
    });
    read.is_ok() && start == *SIGNATURE
}

/// `text` up to its end mark, without the blanks or zeros that fill up strings of fixed length.
fn unpadded(text: &str) -> String {
    text.split('\0').next().unwrap_or("").trim_end_matches(' ').to_owned()
}

/// Calls `read` for parts of at most [`READ_VALUES`] values, halving the slowest axis that has
/// more than one index, so that each part is contiguous in `out`.
fn read_in_parts<T>(
    start: &[u64],
    count: &[u64],
    out: &mut [T],
    read: &mut impl FnMut(&[u64], &[u64], &mut [T]) -> Result<()>,
) -> Result<()> {
    if out.is_empty() {
        return Ok(());
    }
    let axis = count.iter().position(|&n| n > 1).filter(|_| out.len() > READ_VALUES);
    let Some(axis) = axis else {
        return read(start, count, out);
    };
    let half = count[axis] / 2;
    let inner: u64 = count[axis + 1..].iter().product();
    let (lower, upper) = out.split_at_mut(usize::try_from(half * inner).unwrap_or(usize::MAX));
    let (mut lower_count, mut upper_count) = (count.to_vec(), count.to_vec());
    lower_count[axis] = half;
    upper_count[axis] -= half;
    let mut upper_start = start.to_vec();
    upper_start[axis] += half;
    read_in_parts(start, &lower_count, lower, read)?;
    read_in_parts(&upper_start, &upper_count, upper, read)
}
