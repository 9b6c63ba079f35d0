//! What recipes may not ask for.

use super::{Component, FIELD_NAMES, Recipe, TEXT_EDGE_LEVELS};
use crate::space::MAX_OCTREE_LEVEL;
use crate::{Error, Result};

/// Most cells of one grid: grids are built in memory.
const MAX_GRID_CELLS: u128 = 1 << 25;
/// Most grids of the root level: all of these are listed.
const MAX_ROOT_GRIDS: u128 = 1 << 20;
/// Most particles of one grid: they are built in memory too.
const MAX_PARTICLES: u32 = 1 << 20;

impl Recipe {
    /// Refuses what cannot be written.
    pub(super) fn validate(&self) -> Result<()> {
        let refuse = |reason: String| Err(Error::request(reason));
        let plain = |c: char| c.is_ascii_alphanumeric() || c == '_';
        if self.name.is_empty() || self.name.len() > 64 || !self.name.chars().all(plain) {
            return refuse(format!("name: `{}` must be letters and digits", self.name));
        }
        if self.density.is_empty() {
            return refuse("density: at least one [[density]] component is needed".to_owned());
        }
        self.space()?;
        self.validate_refinement()?;
        self.validate_tiles()?;
        self.validate_output()?;
        self.density.iter().try_for_each(Component::validate)
    }

    fn validate_refinement(&self) -> Result<()> {
        let refinement = &self.refinement;
        if refinement.max_level > MAX_OCTREE_LEVEL {
            return Err(Error::request(format!(
                "refinement.max_level: at most {MAX_OCTREE_LEVEL}"
            )));
        }
        if self.needs_hdf5_hierarchy()? && self.output.hierarchy_hdf5 == Some(false) {
            return Err(Error::request(format!(
                "output.hierarchy_hdf5: needed for more than {TEXT_EDGE_LEVELS} factor-2 levels, \
                 as the text's 14 digits no longer tell where a grid lies"
            )));
        }
        let given = refinement.factors.as_ref().map_or(refinement.max_level as usize, Vec::len);
        if given != refinement.max_level as usize {
            return Err(Error::request(format!(
                "refinement.factors: {given} of them, but refinement.max_level is {}",
                refinement.max_level
            )));
        }
        for centre in &refinement.centre {
            if centre.half_size.iter().any(|&n| n == 0 || n > 64) {
                return Err(Error::request("refinement.centre.half_size: 1 to 64 cells"));
            }
            if centre.depth.is_some_and(|depth| depth > refinement.max_level) {
                return Err(Error::request(format!(
                    "refinement.centre.depth: more than refinement.max_level, {}",
                    refinement.max_level
                )));
            }
        }
        match &refinement.threshold {
            Some(t) if t.block[0] < 2 || t.block[1] < t.block[0] || t.block[1] > 64 => {
                Err(Error::request("refinement.threshold.block: [smallest, largest], 2 to 64"))
            }
            _ => Ok(()),
        }
    }

    fn validate_tiles(&self) -> Result<()> {
        let (root, tiles) = (self.domain.root, self.domain.tiles);
        if (0..3).any(|a| tiles[a] == 0 || tiles[a] > root[a]) {
            return Err(Error::request(format!(
                "domain.tiles: {tiles:?} must be 1 up to the root grid's cells {root:?}"
            )));
        }
        let grids: u128 = tiles.iter().map(|count| u128::from(*count)).product();
        if grids > MAX_ROOT_GRIDS {
            return Err(Error::request(format!(
                "domain.tiles: {grids} grids of the root level are more than {MAX_ROOT_GRIDS}: cut it \
                 into fewer tiles, or ask for a smaller --scale"
            )));
        }
        let cells: u128 = (0..3).map(|a| u128::from(root[a].div_ceil(tiles[a]))).product();
        if cells > MAX_GRID_CELLS {
            return Err(Error::request(format!(
                "domain.tiles: a root grid of {cells} cells is more than {MAX_GRID_CELLS}: cut \
                 it into more tiles"
            )));
        }
        Ok(())
    }

    fn validate_output(&self) -> Result<()> {
        let output = &self.output;
        crate::synth::check_format(&output.format)
            .map_err(|error| Error::request(format!("output.format: {error}")))?;
        if output.block.iter().any(|&n| n == 0 || n > 64) {
            return Err(Error::request("output.block: 1 to 64 cells along each axis"));
        }
        if output.particles > MAX_PARTICLES {
            return Err(Error::request(format!("output.particles: at most {MAX_PARTICLES}")));
        }
        if !(output.file_mib > 0.0 && output.file_mib <= 256.0) {
            return Err(Error::request("output.file_mib: more than 0, at most 256"));
        }
        if !output.fields.iter().any(|name| name == "Density") {
            return Err(Error::request("output.fields: `Density` must be among them"));
        }
        for (i, name) in output.fields.iter().enumerate() {
            if !FIELD_NAMES.contains(&name.as_str()) || output.fields[..i].contains(name) {
                return Err(Error::request(format!(
                    "output.fields: `{name}` is unknown or there twice; fields: {}",
                    FIELD_NAMES.join(", ")
                )));
            }
        }
        Ok(())
    }
}
