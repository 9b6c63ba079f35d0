//! A depth-first walk of the stored bricks that knows every brick's neighbours.

use std::sync::Arc;

use super::store::BrickStore;
use crate::Result;
use crate::cache::BrickPlace;

/// A brick with its 26 neighbours of the same level, and its ancestors with theirs.
#[derive(Debug)]
pub(super) struct Neighbourhood {
    /// Level and coordinates of the brick.
    pub(super) place: BrickPlace,
    /// Numbers within the level, by direction (see [`direction`]); none where no brick is.
    pub(super) bricks: [Option<u64>; 27],
    /// The parent with its neighbours; none for the root.
    pub(super) parent: Option<Arc<Neighbourhood>>,
}

/// Which of [`Neighbourhood::bricks`] lies in direction (dx, dy, dz), each −1, 0 or 1.
pub(super) fn direction(step: [i32; 3]) -> usize {
    ((step[0] + 1) + 3 * (step[1] + 1) + 9 * (step[2] + 1)).unsigned_abs() as usize
}

/// Position of the brick itself among its neighbours.
pub(super) const CENTRE: usize = 13;

impl Neighbourhood {
    /// The root: it has no neighbours.
    fn root(upper: i32) -> Self {
        let mut bricks = [None; 27];
        bricks[CENTRE] = Some(0);
        Self { place: BrickPlace::root(upper), bricks, parent: None }
    }

    /// The brick's number within its level.
    pub(super) fn brick(&self) -> u64 {
        self.bricks[CENTRE].unwrap_or(0)
    }

    /// The child in octant `octant`: its neighbours are children of this brick and of its
    /// neighbours.
    fn child(self: &Arc<Self>, octant: u8, store: &BrickStore) -> Result<Self> {
        let level = self.place.tree_level;
        let own: [i32; 3] = std::array::from_fn(|a| i32::from(octant >> a & 1));
        let mut topologies = [None; 27];
        let mut bricks = [None; 27];
        for (at, brick) in bricks.iter_mut().enumerate() {
            let at = at as i32;
            let step = [at % 3 - 1, at / 3 % 3 - 1, at / 9 - 1];
            let half: [i32; 3] = std::array::from_fn(|a| own[a] + step[a]);
            let parent = direction(half.map(|h| h >> 1));
            let Some(parent_brick) = self.bricks[parent] else { continue };
            let topology = match topologies[parent] {
                Some(topology) => topology,
                None => *topologies[parent].insert(store.topology(level, parent_brick)?),
            };
            let bit = half.iter().enumerate().fold(0u8, |o, (a, h)| o | ((h & 1) as u8) << a);
            if topology.child_mask >> bit & 1 == 1 {
                let before = topology.child_mask & ((1 << bit) - 1);
                *brick = Some(topology.first_child + u64::from(before.count_ones()));
            }
        }
        Ok(Self { place: self.place.child(octant), bricks, parent: Some(Arc::clone(self)) })
    }
}

/// Walks all bricks depth first, octants in Morton order; memory grows with the depth only.
pub(super) struct Walk<'s> {
    store: &'s BrickStore,
    /// Bricks whose children are still to come, with the octants left.
    pending: Vec<(Arc<Neighbourhood>, u8)>,
    upper: i32,
    started: bool,
}

impl<'s> Walk<'s> {
    /// A walk that begins at the root, `upper` octree levels above the root grid.
    pub(super) fn new(store: &'s BrickStore, upper: u32) -> Self {
        Self { store, pending: Vec::new(), upper: upper as i32, started: false }
    }

    /// The next brick; none after the last.
    pub(super) fn next(&mut self) -> Result<Option<Arc<Neighbourhood>>> {
        if !self.started {
            self.started = true;
            return self.enter(Neighbourhood::root(self.upper)).map(Some);
        }
        while let Some((around, octants)) = self.pending.last_mut() {
            if *octants == 0 {
                self.pending.pop();
                continue;
            }
            let octant = octants.trailing_zeros() as u8;
            *octants &= *octants - 1;
            let child = Arc::clone(around).child(octant, self.store)?;
            return self.enter(child).map(Some);
        }
        Ok(None)
    }

    fn enter(&mut self, around: Neighbourhood) -> Result<Arc<Neighbourhood>> {
        let around = Arc::new(around);
        let topology = self.store.topology(around.place.tree_level, around.brick())?;
        self.pending.push((Arc::clone(&around), topology.child_mask));
        Ok(around)
    }
}
