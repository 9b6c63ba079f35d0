//! Bounding boxes: where the root blocks lie, and a check of what `gid` says of all others.

use std::path::Path;

use super::header::Header;
use super::tree::Tree;
use crate::source::hdf5::File;
use crate::space::{AXES, Domain};
use crate::{Error, Result};

/// Blocks whose boxes are read at a time.
const BATCH: u64 = 4096;
/// Numbers of a box: lower and upper edge along x, y, z.
const ROW: usize = 6;
/// How far a root block may lie from its place, in root blocks.
const ROOT_TOLERANCE: f64 = 0.01;
/// The same where few digits of its edges tell more.
const MOST_ROUNDED: f64 = 0.25;
/// How far any block may lie from its place, in its own width.
const TOLERANCE: f64 = 0.1;

/// Why a box is refused.
pub(super) enum Refusal {
    /// The list cannot be read.
    Read(Error),
    /// The box does not fit.
    Misfit(String),
}

impl Refusal {
    /// The error about block `number` (from 0) of `tree`.
    pub(super) fn into_error(self, tree: &Tree, number: usize) -> Error {
        match self {
            Self::Read(error) => error,
            Self::Misfit(reason) => tree.fault(number, reason),
        }
    }
}

/// The list of bounding boxes, read in batches.
pub(super) struct Boxes<'a> {
    file: &'a File,
    domain: &'a Domain,
    root_blocks: [u32; 3],
    blocks: u64,
    first: u64,
    batch: Vec<f64>,
}

impl<'a> Boxes<'a> {
    /// The boxes of `file`.
    ///
    /// # Errors
    /// A list that is missing or of another shape.
    pub(super) fn new(file: &'a File, path: &Path, header: &'a Header) -> Result<Self> {
        let (found, expected) = (file.dataset("/bounding box")?.shape, [header.blocks, 3, 2]);
        if found != expected {
            let reason = format!("its shape {found:?} should be {expected:?}");
            return Err(Error::invalid(format!("{}: /bounding box", path.display()), reason));
        }
        Ok(Self {
            file,
            domain: &header.domain,
            root_blocks: header.root_blocks,
            blocks: header.blocks,
            first: 0,
            batch: Vec::new(),
        })
    }

    /// Where a root block lies, in root blocks.
    ///
    /// # Errors
    /// A box that is not one of the root blocks'.
    pub(super) fn root_place(&mut self, number: usize) -> Result<[u32; 3], Refusal> {
        let edges = self.edges(number)?;
        let mut place = [0; 3];
        for axis in 0..3 {
            let (left, width) = self.extent(axis);
            let at = (edges[2 * axis] - left) / width * f64::from(self.root_blocks[axis]);
            let rounded = at.round();
            let inside = (0.0..f64::from(self.root_blocks[axis])).contains(&rounded);
            let block = width / f64::from(self.root_blocks[axis]);
            let digits = rounding(edges[2 * axis]) * (left.abs() + width) / block;
            let tolerance = ROOT_TOLERANCE.max(digits.min(MOST_ROUNDED));
            if !inside || (at - rounded).abs() > tolerance {
                return Err(Refusal::Misfit(format!(
                    "has no parent, but its left edge {} along {} is none of the {} root blocks'",
                    edges[2 * axis],
                    AXES[axis],
                    self.root_blocks[axis]
                )));
            }
            place[axis] = rounded as u32;
        }
        Ok(place)
    }

    /// Checks a block's box: it is where the tree puts the block, as far as floats tell.
    ///
    /// # Errors
    /// A box that lies elsewhere.
    pub(super) fn check(
        &mut self,
        number: usize,
        level: u32,
        at: [i128; 3],
    ) -> Result<(), Refusal> {
        let edges = self.edges(number)?;
        for axis in 0..3 {
            let (left, width) = self.extent(axis);
            let block = width / f64::from(self.root_blocks[axis]) / f64::from(level).exp2();
            for (side, &found) in edges[2 * axis..2 * axis + 2].iter().enumerate() {
                let expected = left + block * (at[axis] + side as i128) as f64;
                let digits = rounding(found) * (left.abs() + width);
                let off = (found - expected).abs();
                if off.is_nan() || off > TOLERANCE * block + digits {
                    return Err(Refusal::Misfit(format!(
                        "its bounding box has the edge {found} along {}, by gid it should be \
                         {expected}",
                        AXES[axis]
                    )));
                }
            }
        }
        Ok(())
    }

    fn extent(&self, axis: usize) -> (f64, f64) {
        let (left, right) = (self.domain.left()[axis], self.domain.right()[axis]);
        (left, right - left)
    }

    fn edges(&mut self, number: usize) -> Result<[f64; ROW], Refusal> {
        let first = number as u64 / BATCH * BATCH;
        if self.batch.is_empty() || first != self.first {
            let count = BATCH.min(self.blocks - first);
            self.batch.resize(ROW * count as usize, 0.0);
            let (start, count) = ([first, 0, 0], [count, 3, 2]);
            self.file
                .read_f64("/bounding box", &start, &count, &mut self.batch)
                .map_err(Refusal::Read)?;
            self.first = first;
        }
        let at = ROW * (number as u64 - first) as usize;
        Ok(std::array::from_fn(|i| self.batch.get(at + i).copied().unwrap_or(f64::NAN)))
    }
}

/// The relative error that an edge may have, as each level adds one rounding: plot files hold
/// floats of 32 bits, told by their digits.
fn rounding(edge: f64) -> f64 {
    if f64::from(edge as f32) == edge {
        64.0 * f64::from(f32::EPSILON)
    } else {
        256.0 * f64::EPSILON
    }
}
