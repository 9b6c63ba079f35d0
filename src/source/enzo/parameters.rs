//! Enzo's parameter file: plain text, `Key = values` a line.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;
use std::str::FromStr;

use crate::source::lines::shown;
use crate::space::Domain;
use crate::{Error, Result, regular_file};

/// Largest parameter file read; real ones have 20 to 60 kB.
const MOST_BYTES: u64 = 4 << 20;

/// What the parameter file says that a reader needs.
#[derive(Debug)]
pub(super) struct Parameters {
    /// The simulated box and root grid.
    pub(super) domain: Domain,
    /// The refinement factor between any two levels.
    pub(super) refine_by: u32,
    /// Code time of the output.
    pub(super) time: Option<f64>,
    /// Stated factors to cgs, by data label.
    pub(super) factors: BTreeMap<String, f64>,
    /// Stated names of units, by data label.
    pub(super) unit_names: BTreeMap<String, String>,
    /// Density, length and time units in cgs.
    pub(super) units: [Option<f64>; 3],
}

/// Reads the parameter file's text, whatever bytes its comments hold.
///
/// # Errors
/// A file that cannot be read or is far larger than any parameter file.
pub(super) fn read_text(path: &Path) -> Result<String> {
    let mut bytes = Vec::new();
    regular_file::open(path)
        .and_then(|file| file.take(MOST_BYTES + 1).read_to_end(&mut bytes))
        .map_err(|e| Error::io(path, "cannot read the parameter file", e))?;
    if bytes.len() as u64 > MOST_BYTES {
        let reason = format!("is larger than {MOST_BYTES} bytes: no Enzo parameter file");
        return Err(Error::invalid(path.display(), reason));
    }
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// Whether `text` is a parameter file's, by the keys that every one has.
pub(super) fn looks_right(text: &str) -> bool {
    let keys = keys(text);
    ["TopGridRank", "TopGridDimensions", "DomainLeftEdge"].iter().all(|key| keys.contains_key(key))
}

impl Parameters {
    /// Parses `text`, read from `path`.
    ///
    /// # Errors
    /// Missing or malformed keys; a run that is not three-dimensional and Cartesian.
    pub(super) fn parse(path: &Path, text: &str) -> Result<Self> {
        let file = Reader { path, keys: keys(text) };
        let [rank] = file.numbers::<i64, 1>("TopGridRank")?;
        if rank != 3 {
            let reason = format!("TopGridRank = {rank}: only three-dimensional runs can be read");
            return Err(Error::not_supported(path.display(), reason));
        }
        file.refuse_curved_coordinates()?;
        let [refine_by] = file.numbers::<u32, 1>("RefineBy")?;
        if refine_by < 2 {
            let reason = format!("RefineBy = {refine_by}: must be 2 or 4");
            return Err(Error::invalid(path.display(), reason));
        }
        let domain = Domain::new(
            file.numbers("DomainLeftEdge")?,
            file.numbers("DomainRightEdge")?,
            file.numbers("TopGridDimensions")?,
        )
        .map_err(|e| Error::invalid(path.display(), e.to_string()))?;
        Ok(Self {
            domain,
            refine_by,
            time: file.optional("InitialTime"),
            factors: file.by_label("#DataCGSConversionFactor", |text| positive(first(text))),
            unit_names: file.by_label("DataUnits", unit_name),
            units: ["DensityUnits", "LengthUnits", "TimeUnits"]
                .map(|key| file.keys.get(key).and_then(|text| positive(first(text)))),
        })
    }
}

/// Every `Key = value` line; of repeated keys the last.
fn keys(text: &str) -> BTreeMap<&str, &str> {
    text.lines()
        .filter_map(|line| line.split_once('='))
        .map(|(key, value)| (key.trim(), value.trim()))
        .collect()
}

struct Reader<'a> {
    path: &'a Path,
    keys: BTreeMap<&'a str, &'a str>,
}

impl Reader<'_> {
    fn numbers<T: FromStr, const N: usize>(&self, key: &str) -> Result<[T; N]> {
        let Some(text) = self.keys.get(key) else {
            let reason = format!("has no `{key} = …`: is it the parameter file of an Enzo output?");
            return Err(Error::invalid(self.path.display(), reason));
        };
        parse_list(text).ok_or_else(|| {
            let reason = format!("`{key} = {}`: expected {N} number(s)", shown(text));
            Error::invalid(self.path.display(), reason)
        })
    }

    fn optional(&self, key: &str) -> Option<f64> {
        self.keys.get(key).and_then(|text| first(text).parse().ok()).filter(|v: &f64| v.is_finite())
    }

    /// Enzo's `Coordinate`: 0 Cartesian, 1 spherical, 2 cylindrical.
    fn refuse_curved_coordinates(&self) -> Result<()> {
        match self.keys.get("Coordinate").map(|text| first(text)) {
            None | Some("0" | "") => Ok(()),
            Some(other) => Err(Error::not_supported(
                self.path.display(),
                format!("Coordinate = {}: only Cartesian runs (0) can be read", shown(other)),
            )),
        }
    }

    /// `prefix[i] = value` by the name that `DataLabel[i]` gives.
    fn by_label<T>(&self, prefix: &str, parse: impl Fn(&str) -> Option<T>) -> BTreeMap<String, T> {
        let label_of = |key: &str| {
            let index = key.strip_prefix(prefix)?;
            let label = self.keys.get(format!("DataLabel{index}").as_str())?;
            Some((*label).to_owned())
        };
        self.keys.iter().filter_map(|(key, value)| Some((label_of(key)?, parse(value)?))).collect()
    }
}

/// The first `N` numbers of a blank-separated list, which may go on with a remark.
pub(super) fn parse_list<T: FromStr, const N: usize>(text: &str) -> Option<[T; N]> {
    let mut words = text.split_whitespace();
    let mut list = Vec::with_capacity(N);
    for _ in 0..N {
        list.push(words.next()?.parse().ok()?);
    }
    list.try_into().ok()
}

fn first(text: &str) -> &str {
    text.split_whitespace().next().unwrap_or("")
}

fn positive(text: &str) -> Option<f64> {
    text.parse().ok().filter(|v: &f64| v.is_finite() && *v > 0.0)
}

fn unit_name(text: &str) -> Option<String> {
    Some(text).filter(|t| !t.is_empty() && *t != "(null)" && *t != "none").map(str::to_owned)
}
