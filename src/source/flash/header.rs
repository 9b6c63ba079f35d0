//! What a file's lists of scalars and runtime parameters say.

use std::collections::BTreeMap;
use std::path::Path;

use crate::source::hdf5::{File, Values};
use crate::space::Domain;
use crate::{Error, Result};

/// The run's and the file's parameters.
pub(super) struct Header {
    /// The simulated box; its root grid is the blocks of refine level 1.
    pub(super) domain: Domain,
    /// Cells of a block along x, y, z.
    pub(super) block_size: [u32; 3],
    /// Blocks of refine level 1 along x, y, z.
    pub(super) root_blocks: [u32; 3],
    /// All blocks, parents included.
    pub(super) blocks: u64,
    /// Code time.
    pub(super) time: Option<f64>,
    /// What values are given in.
    pub(super) units: Units,
}

/// What a run says of its units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Units {
    /// Nothing that can be relied on.
    Unknown,
    /// They are cgs.
    Cgs,
    /// They are those of comoving quantities in cgs.
    Comoving {
        /// 1/(1 + z).
        scale_factor: f64,
    },
}

impl Header {
    /// Reads and checks the lists.
    ///
    /// # Errors
    /// Missing or malformed entries, and runs that are not three-dimensional, Cartesian,
    /// cell-centred PARAMESH trees in one file.
    pub(super) fn read(file: &File, path: &Path) -> Result<Self> {
        let lists = Lists::read(file, path)?;
        lists.check_kind()?;
        let block_size = lists.sizes(["nxb", "nyb", "nzb"])?;
        let root_blocks = lists.sizes(["nblockx", "nblocky", "nblockz"])?;
        let left = lists.edges(["xmin", "ymin", "zmin"])?;
        let right = lists.edges(["xmax", "ymax", "zmax"])?;
        let root: [u64; 3] =
            std::array::from_fn(|a| u64::from(block_size[a]) * u64::from(root_blocks[a]));
        let domain = Domain::new(left, right, root)
            .map_err(|e| Error::invalid(path.display(), e.to_string()))?;
        let blocks = block_count(file, path, &lists)?;
        let cells: u128 = block_size.iter().map(|&n| u128::from(n)).product();
        file.check_holds(blocks, cells)?;
        let time = lists.floating("time").filter(|time| time.is_finite());
        Ok(Self { domain, block_size, root_blocks, blocks, time, units: lists.units() })
    }
}

/// The number of blocks: as many as `node type` has, which is no split file's part.
fn block_count(file: &File, path: &Path, lists: &Lists<'_>) -> Result<u64> {
    let shape = file.dataset("/node type")?.shape;
    let [blocks] = shape[..] else {
        let place = format!("{}: /node type", path.display());
        return Err(Error::invalid(place, format!("expected a list, found shape {shape:?}")));
    };
    match lists.integer("globalnumblocks") {
        Some(all) if u64::try_from(all) != Ok(blocks) => Err(Error::not_supported(
            path.display(),
            format!(
                "holds {blocks} of the run's {all} blocks, as one of several split files: write \
                 whole ones (outputSplitNum = 1)"
            ),
        )),
        _ if blocks == 0 => Err(Error::invalid(path.display(), "holds no blocks")),
        _ => Ok(blocks),
    }
}

/// All lists merged by kind; scalars, which are the file's own, come before parameters.
struct Lists<'p> {
    path: &'p Path,
    values: BTreeMap<String, Values>,
}

impl<'p> Lists<'p> {
    fn read(file: &File, path: &'p Path) -> Result<Self> {
        let datasets = file.members("/")?.datasets;
        let mut values = BTreeMap::new();
        for what in ["runtime parameters", "scalars"] {
            for kind in ["integer", "real", "logical", "string"] {
                let name = format!("{kind} {what}");
                if datasets.contains(&name) {
                    values.extend(file.table(&format!("/{name}"))?);
                }
            }
        }
        if !datasets.iter().any(|name| name == "integer scalars") {
            let reason = "has no list `integer scalars`: only files of FLASH 3 and later (format \
                          version 8 and above) can be read";
            return Err(Error::not_supported(path.display(), reason));
        }
        Ok(Self { path, values })
    }

    /// Refuses what is no three-dimensional, Cartesian, cell-centred PARAMESH tree.
    fn check_kind(&self) -> Result<()> {
        let refuse = |reason: String| Err(Error::not_supported(self.path.display(), reason));
        let dimensions = self.required("dimensionality", self.integer("dimensionality"))?;
        if dimensions != 3 {
            return refuse(format!(
                "dimensionality {dimensions}: only three-dimensional runs can be read"
            ));
        }
        let geometry = self.required("geometry", self.text("geometry"))?;
        if !geometry.eq_ignore_ascii_case("cartesian") {
            let shown: String = geometry.escape_debug().take(40).collect();
            return refuse(format!("geometry `{shown}`: only cartesian ones can be read"));
        }
        if self.integer("corners").is_some_and(|corners| corners != 0) {
            return refuse("values at cells' corners: only cell-centred ones can be read".into());
        }
        if self.integer("nblockx").is_none() {
            return refuse(
                "has no runtime parameter nblockx, as files of uniform grids (UG) or Chombo: only \
                 those of PARAMESH can be read"
                    .into(),
            );
        }
        Ok(())
    }

    /// What the run computes in: `pc_unitsBase` is what physical constants are given in, and
    /// `UnitSystem` (of magnetic fields) must not contradict it.
    fn units(&self) -> Units {
        let says = |key: &str, words: &[&str]| {
            self.text(key).is_some_and(|text| words.contains(&text.to_lowercase().as_str()))
        };
        let is_cgs = says("pc_unitsbase", &["cgs"])
            && (self.text("unitsystem").is_none() || says("unitsystem", &["none", "cgs"]));
        let is_comoving = self.integer("usecosmology").is_some_and(|is_used| is_used != 0);
        match self.floating("scalefactor").filter(|factor| *factor > 0.0 && factor.is_finite()) {
            _ if !is_cgs => Units::Unknown,
            _ if !is_comoving => Units::Cgs,
            Some(scale_factor) => Units::Comoving { scale_factor },
            None => Units::Unknown,
        }
    }

    fn integer(&self, key: &str) -> Option<i64> {
        self.values.get(key)?.integers().map(|[value]| value)
    }

    fn floating(&self, key: &str) -> Option<f64> {
        self.values.get(key)?.floats().map(|[value]| value)
    }

    fn text(&self, key: &str) -> Option<&str> {
        self.values.get(key)?.text()
    }

    fn required<T>(&self, key: &str, value: Option<T>) -> Result<T> {
        value.ok_or_else(|| {
            let reason = format!("its scalars and runtime parameters have no `{key}` of its kind");
            Error::invalid(self.path.display(), reason)
        })
    }

    fn sizes(&self, keys: [&str; 3]) -> Result<[u32; 3]> {
        let mut sizes = [0; 3];
        for (size, key) in sizes.iter_mut().zip(keys) {
            let value = self.required(key, self.integer(key))?;
            *size = u32::try_from(value).ok().filter(|&n| n > 0).ok_or_else(|| {
                Error::invalid(self.path.display(), format!("{key} = {value}: must be positive"))
            })?;
        }
        Ok(sizes)
    }

    fn edges(&self, keys: [&str; 3]) -> Result<[f64; 3]> {
        let mut edges = [0.0; 3];
        for (edge, key) in edges.iter_mut().zip(keys) {
            *edge = self.required(key, self.floating(key))?;
        }
        Ok(edges)
    }
}
