//! The attributes of an output, and what they must say.

use std::collections::BTreeMap;
use std::path::Path;

use crate::source::hdf5::{File, Values};
use crate::{Error, Result};

/// Coordinates whose cells are boxes along the axes: those of flat space, and of flat space-time,
/// as codes of general relativity call them.
const CARTESIAN: [&str; 2] = ["cartesian", "minkowski"];
const COORDINATES: [&str; 3] = ["x1", "x2", "x3"];

/// The attributes of the file's root group.
pub(super) struct Attributes<'f> {
    path: &'f Path,
    values: BTreeMap<String, Values>,
}

impl<'f> Attributes<'f> {
    /// Reads them.
    ///
    /// # Errors
    /// A damaged file.
    pub(super) fn read(file: &File, path: &'f Path) -> Result<Self> {
        Ok(Self { path, values: file.attributes("/")? })
    }

    /// Refuses curved coordinates, stretched meshes, and outputs of fewer than three dimensions.
    ///
    /// # Errors
    /// An output that is refused, and missing or malformed attributes.
    pub(super) fn check_mesh(&self) -> Result<()> {
        let refuse = |reason: String| Err(Error::not_supported(self.path.display(), reason));
        let coordinates = self.value("Coordinates")?.text().unwrap_or("");
        if !CARTESIAN.contains(&coordinates) {
            let shown: String = coordinates.escape_debug().take(40).collect();
            return refuse(format!("coordinates `{shown}`: only cartesian ones can be read"));
        }
        let (root, block) = (self.root_grid_size()?, self.stored_block_size()?);
        for axis in 0..3 {
            let name = COORDINATES[axis];
            if root[axis] == 1 {
                return refuse(format!(
                    "one cell along {name}: only three-dimensional runs can be read"
                ));
            }
            if block[axis] == 1 {
                return refuse(format!(
                    "a slice or sum along {name}: only outputs of the whole domain can be read"
                ));
            }
            let [_, _, ratio] = self.extent(axis)?;
            if ratio != 1.0 {
                return refuse(format!(
                    "cells are stretched along {name} (RootGrid{} says ratio {ratio}): only \
                     uniform meshes (ratio 1) can be read",
                    name.to_uppercase()
                ));
            }
        }
        Ok(())
    }

    /// Cells of the root grid.
    ///
    /// # Errors
    /// A missing or malformed attribute.
    pub(super) fn root_grid_size(&self) -> Result<[u64; 3]> {
        Ok(self.sizes("RootGridSize")?.map(u64::from))
    }

    /// Cells of a block as stored, ghost zones included where they are stored.
    ///
    /// # Errors
    /// A missing or malformed attribute.
    pub(super) fn stored_block_size(&self) -> Result<[u32; 3]> {
        self.sizes("MeshBlockSize")
    }

    /// Number of blocks.
    ///
    /// # Errors
    /// A missing or malformed attribute.
    pub(super) fn block_count(&self) -> Result<u64> {
        let count = self.value("NumMeshBlocks")?.integers::<1>();
        let count = count.and_then(|[n]| u64::try_from(n).ok()).filter(|&n| n > 0);
        count.ok_or_else(|| self.malformed("NumMeshBlocks"))
    }

    /// Left and right edges of the domain, code length, as they are stored.
    ///
    /// # Errors
    /// Missing or malformed attributes.
    pub(super) fn edges(&self) -> Result<([f64; 3], [f64; 3])> {
        let [x, y, z] = [self.extent(0)?, self.extent(1)?, self.extent(2)?];
        Ok(([x[0], y[0], z[0]], [x[1], y[1], z[1]]))
    }

    /// Code time.
    pub(super) fn time(&self) -> Option<f64> {
        let [time] = self.values.get("Time")?.floats()?;
        Some(time).filter(|time| time.is_finite())
    }

    /// The strings of attribute `name`.
    ///
    /// # Errors
    /// A missing or malformed attribute.
    pub(super) fn texts(&self, name: &str) -> Result<&[String]> {
        match self.value(name)? {
            Values::Text(list) => Ok(list),
            _ => Err(self.malformed(name)),
        }
    }

    /// The counts of attribute `name`.
    ///
    /// # Errors
    /// A missing or malformed attribute.
    pub(super) fn counts(&self, name: &str) -> Result<Vec<usize>> {
        let list = match self.value(name)? {
            Values::Integers(list) => list.iter().map(|&n| usize::try_from(n).ok()).collect(),
            _ => None,
        };
        list.ok_or_else(|| self.malformed(name))
    }

    fn value(&self, name: &str) -> Result<&Values> {
        self.values.get(name).ok_or_else(|| {
            Error::invalid(
                self.path.display(),
                format!(
                    "has no attribute {name}: is it a whole Athena++ output, written with its \
                     mesh data?"
                ),
            )
        })
    }

    fn malformed(&self, name: &str) -> Error {
        let shown = match self.values.get(name) {
            Some(Values::Integers(list)) => format!("{:?}", &list[..list.len().min(4)]),
            Some(Values::Floats(list)) => format!("{:?}", &list[..list.len().min(4)]),
            Some(Values::Extended(list)) => format!("{} numbers of 80 or 128 bits", list.len()),
            Some(Values::Text(list)) => format!("{} strings", list.len()),
            None => "missing".to_owned(),
        };
        let reason = format!("its attribute {name} is malformed ({shown})");
        Error::invalid(self.path.display(), reason)
    }

    fn sizes(&self, name: &str) -> Result<[u32; 3]> {
        let sizes = self.value(name)?.integers::<3>().map(|sizes| sizes.map(u32::try_from));
        match sizes {
            Some([Ok(x), Ok(y), Ok(z)]) if x > 0 && y > 0 && z > 0 => Ok([x, y, z]),
            _ => Err(self.malformed(name)),
        }
    }

    /// Left edge, right edge and ratio of neighbouring cells' widths along an axis.
    fn extent(&self, axis: usize) -> Result<[f64; 3]> {
        let name = ["RootGridX1", "RootGridX2", "RootGridX3"][axis];
        self.value(name)?.floats::<3>().ok_or_else(|| self.malformed(name))
    }
}
