//! The leaf blocks: levels and logical locations, read as a stream.

use std::path::Path;

use super::attributes::Attributes;
use crate::source::GridRecord;
use crate::source::hdf5::File;
use crate::space::MAX_OCTREE_LEVEL;
use crate::{Error, Result};

/// Blocks whose places are read at a time.
const BATCH: u64 = 4096;

/// What all blocks have in common.
pub(super) struct Blocks {
    /// The file, for messages.
    place: String,
    count: u64,
    size: [u32; 3],
    ghosts: u32,
    deepest: u32,
}

/// A block's place: its location counts in blocks of its own level.
struct Place {
    number: u64,
    level: u32,
    location: [i64; 3],
}

impl Blocks {
    /// Reads all places once: where the blocks end tells how many of them the root grid has, and
    /// so how many of a block's stored cells are ghost zones.
    ///
    /// # Errors
    /// Missing or damaged lists, levels that are not supported, and blocks that do not tile the
    /// root grid.
    pub(super) fn read(file: &File, path: &Path, attributes: &Attributes<'_>) -> Result<Self> {
        let (root, stored) = (attributes.root_grid_size()?, attributes.stored_block_size()?);
        let mut blocks = Self {
            place: path.display().to_string(),
            count: attributes.block_count()?,
            size: stored,
            ghosts: 0,
            deepest: 0,
        };
        let cells: u128 = stored.iter().map(|&n| u128::from(n)).product();
        file.check_holds(blocks.count, cells)?;
        blocks.check_lists(file)?;
        let (mut deepest, mut root_blocks) = (0, [0; 3]);
        blocks.for_each_place(file, &mut |place| {
            deepest = place.level.max(deepest);
            for (most, location) in root_blocks.iter_mut().zip(place.location) {
                *most = (*most).max((i128::from(location) >> place.level) + 1);
            }
            Ok(())
        })?;
        blocks.deepest = deepest;
        let ghosts: [Option<u32>; 3] =
            std::array::from_fn(|a| ghost_zones(root[a], root_blocks[a], stored[a]));
        let ghosts = match ghosts {
            [Some(x), Some(y), Some(z)] if x == y && y == z => x,
            _ => return Err(blocks.misfit(root, root_blocks)),
        };
        blocks.ghosts = ghosts;
        blocks.size = stored.map(|n| n - 2 * ghosts);
        Ok(blocks)
    }

    /// Number of blocks.
    pub(super) fn count(&self) -> u64 {
        self.count
    }

    /// The deepest level.
    pub(super) fn deepest(&self) -> u32 {
        self.deepest
    }

    /// Ghost zones stored on each side of each block.
    pub(super) fn ghosts(&self) -> u64 {
        self.ghosts.into()
    }

    /// Hands every block to `visit`.
    ///
    /// # Errors
    /// Damaged lists, and what `visit` returns.
    pub(super) fn for_each(
        &self,
        file: &File,
        visit: &mut dyn FnMut(GridRecord) -> Result<()>,
    ) -> Result<()> {
        self.for_each_place(file, &mut |place| {
            visit(GridRecord {
                id: place.number,
                level: place.level,
                lo: std::array::from_fn(|a| {
                    i128::from(place.location[a]) * i128::from(self.size[a])
                }),
                size: self.size,
                locator: place.number,
            })
        })
    }

    fn check_lists(&self, file: &File) -> Result<()> {
        for (name, shape) in
            [("/Levels", vec![self.count]), ("/LogicalLocations", vec![self.count, 3])]
        {
            let found = file.dataset(name)?.shape;
            if found != shape {
                let reason = format!("its shape {found:?} should be {shape:?} by NumMeshBlocks");
                return Err(Error::invalid(format!("{}: {name}", self.place), reason));
            }
        }
        Ok(())
    }

    fn for_each_place(
        &self,
        file: &File,
        visit: &mut dyn FnMut(Place) -> Result<()>,
    ) -> Result<()> {
        let mut first = 0;
        while first < self.count {
            let count = BATCH.min(self.count - first);
            let mut levels = vec![0; count as usize];
            let mut locations = vec![0; 3 * count as usize];
            file.read_i64("/Levels", &[first], &[count], &mut levels)?;
            file.read_i64("/LogicalLocations", &[first, 0], &[count, 3], &mut locations)?;
            let rows = locations.chunks_exact(3).map(|row| [row[0], row[1], row[2]]);
            for ((number, level), location) in (first..).zip(levels).zip(rows) {
                visit(self.checked(number, level, location)?)?;
            }
            first += count;
        }
        Ok(())
    }

    fn checked(&self, number: u64, level: i64, location: [i64; 3]) -> Result<Place> {
        let place = || format!("{}: block {number}", self.place);
        if location.iter().any(|&i| i < 0) || level < 0 {
            let reason =
                format!("its level {level} and location {location:?} must not be negative");
            return Err(Error::invalid(place(), reason));
        }
        match u32::try_from(level) {
            Ok(level) if level <= MAX_OCTREE_LEVEL => Ok(Place { number, level, location }),
            _ => Err(Error::not_supported(
                place(),
                format!(
                    "lies at level {level}: at most {MAX_OCTREE_LEVEL} levels below the root grid \
                     are supported"
                ),
            )),
        }
    }

    fn misfit(&self, root: [u64; 3], root_blocks: [i128; 3]) -> Error {
        let reason = format!(
            "its blocks of {:?} stored cells reach over {root_blocks:?} root blocks, which do not \
             make up a root grid of {root:?} cells: are attributes or LogicalLocations damaged?",
            self.size
        );
        Error::invalid(&self.place, reason)
    }
}

/// Ghost zones on each side of a block's `stored` cells along an axis, of whose root grid's `root`
/// cells `blocks` blocks take equal parts; none where that cannot be.
fn ghost_zones(root: u64, blocks: i128, stored: u32) -> Option<u32> {
    let blocks = u64::try_from(blocks).ok().filter(|&n| n > 0 && root.is_multiple_of(n))?;
    let extra = u64::from(stored).checked_sub(root / blocks)?;
    u32::try_from(extra / 2).ok().filter(|_| extra.is_multiple_of(2))
}
