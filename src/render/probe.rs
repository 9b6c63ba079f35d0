//! Level and value at single points.

use std::collections::HashMap;

use glam::DVec3;

use super::brick::interpolant::DrawnNeighbours;
use super::brick::scaled::{ScaledBrick, one_by_one};
use crate::cache::{
    BrickEntry, BrickPlace, Cache, Cursor, Decoder, FieldRecord, NodeRecord, Precision, RawBrick,
    state,
};
use crate::scene::Interpolation;
use crate::space::{Decimal, Position};
use crate::{Error, Result};

/// Bricks kept between points.
const KEPT: usize = 64;
/// Values of which larger ones are shrunk while they are interpolated: the interpolant's own
/// limit is 1e30.
const LARGE: f32 = 1e29;
/// The factor by which larger values are shrunk while they are interpolated; a power of two.
const SHRUNK: f64 = 1.0 / (1u64 << 30) as f64;

/// What is at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// The simulation's level of the leaf cell that holds the point. Where all of the finest brick was
    /// dropped, the cache may not say it: then that brick's level.
    pub level: u32,
    /// The cell's value, or the interpolant's; NaN where it is NaN or dropped, or draws on a value that
    /// is NaN.
    pub value: f64,
}

/// Looks up points of one field.
pub struct Probe<'c> {
    cache: &'c Cache,
    field: usize,
    interpolation: Interpolation,
    cursor: Cursor<'c>,
    decoder: Decoder,
    bricks: HashMap<u64, RawBrick>,
    scaled: ScaledBrick,
}

/// The finest brick that holds a point.
struct Finest {
    node: u64,
    place: BrickPlace,
    record: NodeRecord,
    field: FieldRecord,
}

impl<'c> Probe<'c> {
    /// A probe of the field named `field`, without regard to case.
    ///
    /// # Errors
    /// A field that is not there.
    pub fn new(cache: &'c Cache, field: &str, interpolation: Interpolation) -> Result<Self> {
        let header = cache.header();
        let index = header
            .find_field(field)
            .map_err(|reason| Error::request(format!("{}: {reason}", cache.path().display())))?;
        let decoder = Decoder::new()
            .map_err(|source| Error::io(cache.path(), "cannot set up decompression", source))?;
        Ok(Self {
            cache,
            field: index,
            interpolation,
            cursor: cache.cursor(),
            decoder,
            bricks: HashMap::new(),
            scaled: ScaledBrick::new(),
        })
    }

    /// What is at `point` (code length); `None` outside the domain.
    ///
    /// # Errors
    /// A damaged cache.
    pub fn at(&mut self, point: &[Decimal; 3]) -> Result<Option<Found>> {
        let domain = &self.cache.header().domain;
        // A point too far away to be represented is outside too.
        let Ok(position) = domain.position(point) else { return Ok(None) };
        if !domain.contains(&position) {
            return Ok(None);
        }
        let (finest, kept) = self.descend(&position)?;
        if !finest.field.is_void() {
            return self.look_up(&finest, &position).map(Some);
        }
        let level = self.level_of_dropped(&finest, kept.as_ref(), &position)?;
        Ok(Some(Found { level, value: f64::NAN }))
    }

    /// The finest brick that holds a point, and the finest of those that were not dropped altogether.
    fn descend(&mut self, position: &Position) -> Result<(Finest, Option<Finest>)> {
        let header = self.cache.header();
        let mut place = BrickPlace::root(-header.levels[0].octree);
        let (mut node, mut kept) = (0, None);
        loop {
            let record = self.cursor.node(node)?;
            let field = self.cursor.field(node, self.field)?;
            let here = Finest { node, place, record, field };
            let cell = self.cell(position, &place);
            let half = header.shape.edge() / 2;
            let octant = (0..3).fold(0, |o, a| o | u8::from(cell[a] >= half) << a);
            match record.child(octant) {
                Some(child) => {
                    (node, place) = (child, place.child(octant));
                    kept = if here.field.is_void() { kept } else { Some(here) };
                }
                None => return Ok((here, kept)),
            }
        }
    }

    /// The level of the cell at a point of which the finest brick was dropped, and no payload says which
    /// of its cells the level owns. What was kept of coarser levels says whether they are refined
    /// there; else the brick's level stands for all.
    fn level_of_dropped(
        &mut self,
        finest: &Finest,
        kept: Option<&Finest>,
        position: &Position,
    ) -> Result<u32> {
        if let Some(kept) = kept {
            self.load(kept)?;
            let owner = self.bricks[&kept.node].owner(self.cell(position, &kept.place));
            if let Some((up, _, bits)) = owner
                && bits & state::REFINED == 0
            {
                return self.level(kept.place.tree_level.saturating_sub(up));
            }
        }
        let levels = self.cache.header().levels.iter().take(finest.place.tree_level + 1);
        Ok(levels.filter_map(|level| level.simulation).max().unwrap_or(0))
    }

    /// The cell that holds `position`, counted from the brick's lowest one.
    fn cell(&self, position: &Position, place: &BrickPlace) -> [usize; 3] {
        let header = self.cache.header();
        let index = header.domain.cell_of(place.octree, position);
        let lowest = place.lowest_cell(header.shape);
        std::array::from_fn(|a| usize::try_from(index[a] - lowest[a]).unwrap_or(0))
    }

    fn look_up(&mut self, finest: &Finest, position: &Position) -> Result<Found> {
        let cell = self.cell(position, &finest.place);
        self.load(finest)?;
        let raw = &self.bricks[&finest.node];
        let Some((up, value, bits)) = raw.owner(cell) else {
            return Err(self.damaged(finest, "no level owns a cell"));
        };
        let level = self.level(finest.place.tree_level.saturating_sub(up))?;
        let value = if bits & state::VOID != 0 || value.is_nan() {
            f64::NAN
        } else if self.interpolation == Interpolation::Cell {
            self.cache.header().fields[self.field].value(value)
        } else {
            self.interpolate(finest, position)?
        };
        Ok(Found { level, value })
    }

    fn load(&mut self, finest: &Finest) -> Result<()> {
        if self.bricks.contains_key(&finest.node) {
            return Ok(());
        }
        if self.bricks.len() >= KEPT {
            self.bricks.clear();
        }
        let mut raw = RawBrick::default();
        let entry = BrickEntry {
            node: finest.node,
            field: self.field,
            node_record: &finest.record,
            field_record: &finest.field,
        };
        self.cache.read_brick(&entry, Precision::Full, &mut self.decoder, &mut raw)?;
        self.cache.check_place(finest.node, self.field, &finest.place, &raw)?;
        self.bricks.insert(finest.node, raw);
        Ok(())
    }

    /// The interpolant of the values at `position`; NaN where one of those that it draws on there is.
    fn interpolate(&mut self, finest: &Finest, position: &Position) -> Result<f64> {
        let is_nan = |stored: f32| f64::from(u8::from(stored.is_nan()));
        if finest.field.has_nan(true) && self.interpolant(finest, position, is_nan)? > 0.0 {
            return Ok(f64::NAN);
        }
        let [low, high] = finest.field.own;
        let factor = if low.abs().max(high.abs()) > LARGE { SHRUNK } else { 1.0 };
        let value = self.interpolant(finest, position, |stored| f64::from(stored) * factor)?;
        let exponent = f64::from(self.cache.header().fields[self.field].exponent).exp2();
        Ok(value / factor * exponent)
    }

    /// The interpolant of stored values, mapped one by one.
    fn interpolant(
        &mut self,
        finest: &Finest,
        position: &Position,
        mapping: impl Fn(f32) -> f64,
    ) -> Result<f64> {
        let header = self.cache.header();
        let raw = &self.bricks[&finest.node];
        let (place, linear) = (&finest.place, Interpolation::Linear);
        self.scaled.prepare(raw, place, header.shape, one_by_one(mapping), linear)?;
        let corner = header.domain.cell_corner(place.octree, place.lowest_cell(header.shape));
        let cells =
            header.domain.difference(position, &corner) / header.domain.cell_width(place.octree);
        let inside = cells.clamp(DVec3::ZERO, DVec3::splat(header.shape.edge() as f64));
        Ok(self.scaled.value_at(inside, DrawnNeighbours::ALL))
    }

    fn level(&self, tree_level: usize) -> Result<u32> {
        let level = self.cache.header().levels.get(tree_level);
        level.and_then(|level| level.simulation).ok_or_else(|| {
            Error::invalid(self.cache.path().display(), "a level of the tree owns a cell it cannot")
        })
    }

    fn damaged(&self, finest: &Finest, reason: &str) -> Error {
        let place = self.cache.path().display();
        Error::invalid(place, format!("brick {} is damaged: {reason}", finest.node))
    }
}
