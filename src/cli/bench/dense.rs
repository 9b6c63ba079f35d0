//! A cache's data on one dense grid over the whole domain: what renderers without refinement get.

use crate::cache::{
    BrickEntry, BrickPlace, Cache, Cursor, Decoder, Precision, RawBrick, TreeLevel,
};
use crate::source::{About, GridBlock, GridRecord, Hierarchy, Source, SourceField};
use crate::space::{Domain, IndexBox, Levels};
use crate::{Error, Result};

/// The covering grid of a cache at one level: where finer levels have data their averages, where
/// only coarser ones have any the value of the cell that covers the place.
pub(super) struct CoveringGrid<'c> {
    cache: &'c Cache,
    /// The grid's octree level in the cache.
    octree: i32,
    about: About,
}

impl<'c> CoveringGrid<'c> {
    /// The covering grid at `level`.
    ///
    /// # Errors
    /// Dropped cells, which an array of values cannot tell from others, and more cells along an
    /// axis than a root grid may have.
    pub(super) fn new(cache: &'c Cache, level: &TreeLevel) -> Result<Self> {
        let header = cache.header();
        if let Some(field) = header.fields.iter().find(|field| field.dropped_cells > 0) {
            return Err(Error::not_supported(
                cache.path().display(),
                format!(
                    "cells of {} were dropped, which no grid of values can tell: ingest without \
                     --drop-below and --region",
                    field.name
                ),
            ));
        }
        let fields = header.fields.iter().map(|field| SourceField {
            name: field.name.clone(),
            units: field.units.clone(),
            to_cgs: field.to_cgs,
        });
        let cells = cells(&header.domain, level.octree)
            .map(|cells| u64::try_from(cells).unwrap_or(u64::MAX));
        let hierarchy = Hierarchy {
            domain: Domain::new(header.domain.left(), header.domain.right(), cells)?,
            levels: Levels::from_factors(&[])?,
            fields: fields.collect(),
            density: None,
            time: header.time,
        };
        let path = cache.path().to_path_buf();
        let about = About { format: "covering grid", path, hierarchy };
        Ok(Self { cache, octree: level.octree, about })
    }
}

/// Cells of the domain along each axis at octree level `octree` ≥ 0.
pub(super) fn cells(domain: &Domain, octree: i32) -> [u128; 3] {
    domain.root_cells().map(|cells| u128::from(cells) << octree.clamp(0, 60))
}

impl Source for CoveringGrid<'_> {
    fn about(&self) -> &About {
        &self.about
    }

    fn for_each_grid(&self, visit: &mut dyn FnMut(GridRecord) -> Result<()>) -> Result<()> {
        let cells = self.about.hierarchy.domain.root_cells();
        let size = cells.map(|cells| u32::try_from(cells).unwrap_or(u32::MAX));
        visit(GridRecord { id: 0, level: 0, lo: [0; 3], size, locator: 0 })
    }

    fn read(
        &self,
        grid: &GridRecord,
        field: usize,
        block: GridBlock,
        out: &mut [f64],
    ) -> Result<()> {
        let decoder = Decoder::new().map_err(|source| {
            Error::io(self.cache.path(), "cannot set up decompression", source)
        })?;
        let lo = std::array::from_fn(|a| grid.lo[a] + i128::from(block.lo[a]));
        let mut sampling = Sampling {
            grid: self,
            field,
            wanted: IndexBox::at(lo, block.size),
            cursor: self.cache.cursor(),
            decoder,
            brick: RawBrick::default(),
            out,
        };
        sampling.out.fill(f64::NAN);
        let root = self.cache.header().levels.first().map_or(0, |level| level.octree);
        sampling.descend(0, BrickPlace::root(-root))
    }
}

/// One block of a grid being filled.
struct Sampling<'s, 'c> {
    grid: &'s CoveringGrid<'c>,
    field: usize,
    /// The block, in cells of the grid.
    wanted: IndexBox,
    cursor: Cursor<'c>,
    decoder: Decoder,
    brick: RawBrick,
    out: &'s mut [f64],
}

impl Sampling<'_, '_> {
    /// Fills what the brick at `place` and those beneath it hold of the block: octants that a child
    /// draws from the child, down to the grid's level, others from the brick.
    fn descend(&mut self, node: u64, place: BrickPlace) -> Result<()> {
        let record = self.cursor.node(node)?;
        let is_finest = place.octree >= self.grid.octree;
        let child = |octant: u8| record.child(octant).filter(|_| !is_finest);
        let seen = |octant: &u8| !self.part(&place, *octant).is_empty();
        let octants: Vec<u8> = (0..8).filter(seen).collect();
        let own: Vec<u8> = octants.iter().copied().filter(|o| child(*o).is_none()).collect();
        if !own.is_empty() {
            let described = self.cursor.field(node, self.field)?;
            if !described.is_void() {
                let cache = self.grid.cache;
                let (decoder, brick) = (&mut self.decoder, &mut self.brick);
                let entry = BrickEntry {
                    node,
                    field: self.field,
                    node_record: &record,
                    field_record: &described,
                };
                cache.read_brick(&entry, Precision::Full, decoder, brick)?;
                own.iter().for_each(|octant| self.copy(&place, *octant));
            }
        }
        for octant in octants {
            if let Some(child) = child(octant) {
                self.descend(child, place.child(octant))?;
            }
        }
        Ok(())
    }

    /// What the block has of an octant of the brick at `place`.
    fn part(&self, place: &BrickPlace, octant: u8) -> IndexBox {
        let half = self.grid.cache.header().shape.edge() as i128 / 2;
        let lowest = place.lowest_cell(self.grid.cache.header().shape);
        let shift = self.shift(place);
        let lo: [i128; 3] = std::array::from_fn(|a| lowest[a] + half * i128::from(octant >> a & 1));
        let octant = IndexBox { lo: lo.map(|c| c << shift), hi: lo.map(|c| (c + half) << shift) };
        octant.intersection(&self.wanted)
    }

    /// Factor-2 steps from the brick at `place` down to the grid.
    fn shift(&self, place: &BrickPlace) -> u32 {
        u32::try_from(self.grid.octree - place.octree).unwrap_or(0)
    }

    fn copy(&mut self, place: &BrickPlace, octant: u8) {
        let header = self.grid.cache.header();
        let part = self.part(place, octant);
        let (lowest, shift) = (place.lowest_cell(header.shape), self.shift(place));
        let (lo, size) = (self.wanted.lo, self.wanted.size());
        let exponent = header.fields.get(self.field).map_or(0, |field| field.exponent);
        let factor = f64::from(exponent).exp2();
        for z in part.lo[2]..part.hi[2] {
            for y in part.lo[1]..part.hi[1] {
                let row = ((z - lo[2]) * size[1] + y - lo[1]) * size[0] - lo[0];
                for x in part.lo[0]..part.hi[0] {
                    let cell = [x, y, z];
                    let cell = std::array::from_fn(|a| ((cell[a] >> shift) - lowest[a]) as usize);
                    let value = self.brick.owner(cell).map_or(f32::NAN, |(_, value, _)| value);
                    self.out[(row + x) as usize] = f64::from(value) * factor;
                }
            }
        }
    }
}
