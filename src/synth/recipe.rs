//! Recipes: what a synthetic data set looks like, as TOML.

use serde::Deserialize;

use crate::space::{Decimal, Domain, Levels};
use crate::{Error, Result};

mod checks;
mod component;

pub(super) use component::{Component, Spiral, Texture};

/// Octree levels beyond which 14 digits no longer tell where a grid lies.
const TEXT_EDGE_LEVELS: u32 = 34;
/// Most grids that `.hierarchy.hdf5` is built for, as it is built in memory.
pub(super) const MAX_HDF5_HIERARCHY_GRIDS: u64 = 20_000;
/// Grids up to which `.hierarchy.hdf5` is written when a recipe doesn't say.
pub(super) const DEFAULT_HDF5_HIERARCHY_GRIDS: u64 = 2_000;

/// A synthetic data set's description.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Name of the output, as Enzo numbers them: `DD0000`.
    #[serde(default = "default_name")]
    pub name: String,
    /// The simulated box and its root grid.
    pub domain: DomainRecipe,
    /// Which grids there are.
    #[serde(default)]
    pub refinement: RefinementRecipe,
    /// What the density is: a sum of components, times turbulence and grain.
    pub density: Vec<Component>,
    /// How the data set is stored.
    #[serde(default)]
    pub output: OutputRecipe,
}

/// The `[domain]` table.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DomainRecipe {
    /// Left edges, code length.
    pub left: [f64; 3],
    /// Right edges, code length.
    pub right: [f64; 3],
    /// Cells of the root grid.
    pub root: [u64; 3],
    /// Grids that the root level is cut into along each axis.
    #[serde(default = "one_each")]
    pub tiles: [u64; 3],
}

/// The `[refinement]` table.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RefinementRecipe {
    /// Refinement factor between all levels: 2 or 4.
    pub factor: u32,
    /// Refinement factors level by level, from the root, instead of `factor`; in layouts that
    /// allow for it.
    pub factors: Option<Vec<u32>>,
    /// Deepest level, 0 = root grid.
    pub max_level: u32,
    /// Varies the grids' shapes and the noise.
    pub seed: u64,
    /// Nested refinement around points.
    pub centre: Vec<CentreRecipe>,
    /// Refinement where the density is high.
    pub threshold: Option<ThresholdRecipe>,
}

/// One `[[refinement.centre]]`: boxes around a point, nested down to a depth.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CentreRecipe {
    /// The point, code length, decimals of any length.
    pub position: [Coordinate; 3],
    /// Deepest level around this point; the recipe's `max_level` where not given.
    pub depth: Option<u32>,
    /// Cells of each level from the point to its box's faces, before they are moved about.
    pub half_size: [u32; 3],
    /// Every how many levels the box gets an arm, which makes an L; 0: never.
    #[serde(default = "default_arms")]
    pub arms: u32,
    /// Every how many levels grids are put flush against a face of the box, so that levels two
    /// and three apart touch; 0: never.
    #[serde(default = "default_satellites")]
    pub satellites: u32,
}

/// `[refinement.threshold]`: blocks of cells are refined where the density is high.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ThresholdRecipe {
    /// `density[l]`: level `l` is refined where the density exceeds this.
    pub density: Vec<f64>,
    /// Smallest and largest extent of a block along an axis, in cells of the coarser level.
    #[serde(default = "default_block")]
    pub block: [u32; 2],
}

/// The `[output]` table.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OutputRecipe {
    /// The layout: `enzo`, `amrex`, `athena++`, `flash` or `athena`.
    pub format: String,
    /// Cells of a block, where the layout is a tree of equal blocks.
    pub block: [u32; 3],
    /// Precision of field values.
    pub precision: Precision,
    /// Fields to write: `Density`, and any of `Temperature` and `x-`, `y-` and `z-velocity`.
    pub fields: Vec<String>,
    /// Cells under finer grids.
    pub covered: Covered,
    /// Largest size of one file of values, MiB (a single grid may exceed it); in layouts that
    /// put several grids in a file.
    pub file_mib: f64,
    /// Whether to write `.hierarchy.hdf5`; where not given: up to 2000 grids.
    pub hierarchy_hdf5: Option<bool>,
    /// Whether fields come in another order in each grid.
    pub shuffle_fields: bool,
    /// Particles in every third grid.
    pub particles: u32,
}

/// Precision of stored field values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub enum Precision {
    /// 32-bit floats.
    #[serde(rename = "f32")]
    F32,
    /// 64-bit floats.
    #[serde(rename = "f64")]
    F64,
}

impl Precision {
    /// Size of a value.
    pub fn bytes(self) -> u64 {
        match self {
            Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Values as they are stored, little-endian.
    pub(super) fn stored(self, values: &[f64]) -> Vec<u8> {
        match self {
            Self::F32 => values.iter().flat_map(|&v| (v as f32).to_le_bytes()).collect(),
            Self::F64 => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
        }
    }
}

/// What cells under finer grids hold.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum Covered {
    /// `"average"`: the average of the leaf cells beneath.
    Average(AverageWord),
    /// A number: the model at the cell's own centre times this, which only chance makes right.
    Factor(f64),
}

/// The word `"average"`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AverageWord {
    /// The only word.
    Average,
}

/// A coordinate: a number (its shortest decimal) or a decimal string of any length.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged)]
pub enum Coordinate {
    /// A TOML number.
    Number(f64),
    /// A decimal string.
    Text(String),
}

impl Coordinate {
    /// The exact decimal.
    ///
    /// # Errors
    /// Text that is no decimal number.
    pub fn decimal(&self) -> Result<Decimal> {
        match self {
            Self::Number(value) => Decimal::from_shortest(*value),
            Self::Text(text) => Decimal::parse(text),
        }
    }
}

/// Fields that can be written.
pub(super) const FIELD_NAMES: [&str; 5] =
    ["Density", "Temperature", "x-velocity", "y-velocity", "z-velocity"];

impl Default for RefinementRecipe {
    fn default() -> Self {
        Self {
            factor: 2,
            factors: None,
            max_level: 0,
            seed: 0,
            centre: Vec::new(),
            threshold: None,
        }
    }
}

impl Default for OutputRecipe {
    fn default() -> Self {
        Self {
            format: "enzo".to_owned(),
            block: [8; 3],
            precision: Precision::F64,
            fields: vec!["Density".to_owned()],
            covered: Covered::Factor(1.0),
            file_mib: 32.0,
            hierarchy_hdf5: None,
            shuffle_fields: false,
            particles: 0,
        }
    }
}

fn default_name() -> String {
    "DD0000".to_owned()
}

fn one_each() -> [u64; 3] {
    [1; 3]
}

fn default_arms() -> u32 {
    2
}

fn default_satellites() -> u32 {
    3
}

fn default_block() -> [u32; 2] {
    [6, 11]
}

impl Recipe {
    /// Parses a recipe; `place` (a file's path) names it in errors.
    ///
    /// # Errors
    /// Text that is no TOML, unknown keys, and whatever cannot be written.
    pub fn parse(text: &str, place: impl std::fmt::Display) -> Result<Self> {
        let recipe: Self = toml::from_str(text).map_err(|error| {
            let start = error.span().map_or(0, |span| span.start.min(text.len()));
            let line = 1 + text.as_bytes()[..start].iter().filter(|&&b| b == b'\n').count();
            let reason = error.message().replace('\n', " ");
            Error::invalid(format!("{place}: line {line}"), reason)
        })?;
        recipe.validate().map_err(|error| match error {
            Error::Request(reason) => Error::invalid(&place, reason),
            other => other,
        })?;
        Ok(recipe)
    }

    /// This recipe with another root grid, for convergence tests.
    ///
    /// # Errors
    /// A root grid that cannot be written.
    pub fn with_root(mut self, root: [u64; 3]) -> Result<Self> {
        self.domain.root = root;
        self.validate()?;
        Ok(self)
    }

    /// This recipe with `scale` times as many cells along each axis, at all levels: root grid
    /// and number of its tiles are those times `scale`, rounded.
    ///
    /// # Errors
    /// A scale that is not positive, or that makes what cannot be written.
    pub fn scaled(mut self, scale: f64) -> Result<Self> {
        if !(scale.is_finite() && scale > 0.0) {
            return Err(Error::request(format!("--scale {scale}: a positive number is needed")));
        }
        let scaled = |count: u64| (count as f64 * scale).round().max(1.0) as u64;
        self.domain.root = self.domain.root.map(scaled);
        self.domain.tiles = self.domain.tiles.map(scaled);
        for centre in &mut self.refinement.centre {
            let scaled = |cells: u32| (f64::from(cells) * scale).round().clamp(1.0, 64.0) as u32;
            centre.half_size = centre.half_size.map(scaled);
        }
        self.validate()?;
        Ok(self)
    }

    /// The simulated box.
    ///
    /// # Errors
    /// Edges or root grids that [`Domain::new`] refuses.
    pub fn space(&self) -> Result<Domain> {
        Domain::new(self.domain.left, self.domain.right, self.domain.root)
    }

    /// The levels of the recipe.
    ///
    /// # Errors
    /// Refinement that [`Levels::from_factors`] refuses.
    pub fn levels(&self) -> Result<Levels> {
        match &self.refinement.factors {
            Some(factors) => Levels::from_factors(factors),
            None => Levels::from_factors(&vec![
                self.refinement.factor;
                self.refinement.max_level as usize
            ]),
        }
    }

    /// This recipe in another layout.
    ///
    /// # Errors
    /// A layout that there is not.
    pub fn with_format(mut self, format: &str) -> Result<Self> {
        format.clone_into(&mut self.output.format);
        self.validate()?;
        Ok(self)
    }

    /// The refinement factor between all levels, for layouts that have but one.
    pub(super) fn one_factor(&self) -> Result<u32> {
        match self.refinement.factors.as_deref() {
            None => Ok(self.refinement.factor),
            Some([]) => Ok(2),
            Some([first, others @ ..]) if others.iter().all(|factor| factor == first) => Ok(*first),
            Some(factors) => Err(Error::request(format!(
                "refinement.factors: {factors:?} differ, but {} has one factor for all levels",
                self.output.format
            ))),
        }
    }

    /// Whether the text hierarchy is too short for the recipe's depth.
    pub(super) fn needs_hdf5_hierarchy(&self) -> Result<bool> {
        Ok(self.levels()?.deepest() > TEXT_EDGE_LEVELS)
    }
}
