//! The walk of a ray that a packet has left at a cell.

use crate::render::brick::walk::Step;
use crate::render::camera::frame::LocalRay;
use crate::render::march::ray::{CellRange, DUAL_SHIFT};

/// The walk of one ray from the dual cell on that its lane has reached.
pub(super) struct CellWalk<'r> {
    ray: &'r LocalRay,
    range: &'r CellRange,
    /// The dual cell reached.
    pub(super) cell: [i32; 3],
    /// σ reached.
    pub(super) from: f64,
    end: f64,
}

impl<'r> CellWalk<'r> {
    /// The walk of `ray` through dual cells in `range` from one on, between two σ.
    pub(super) fn new(
        ray: &'r LocalRay,
        range: &'r CellRange,
        cell: [i32; 3],
        from: f64,
        end: f64,
    ) -> Self {
        Self { ray, range, cell, from, end }
    }

    /// The way through the present cell, and whether there is a next one, which is gone to.
    pub(super) fn step(&mut self) -> (Step, bool) {
        let (origin, direction) = (self.ray.origin.to_array(), self.ray.direction.to_array());
        let (mut to, mut axis) = (self.end, None);
        for a in 0..3 {
            let ahead = self.cell[a] + i32::from(direction[a] > 0.0);
            let sigma = (f64::from(ahead) - origin[a] - DUAL_SHIFT) / direction[a];
            // Along an axis without motion this is no number, or infinite.
            if direction[a] != 0.0 && sigma < to {
                (to, axis) = (sigma, Some(a));
            }
        }
        let step = Step { cell: self.cell, from: self.from, to: to.max(self.from) };
        self.from = step.to;
        let Some(a) = axis else { return (step, false) };
        let last = if direction[a] > 0.0 { self.range.hi[a] } else { self.range.lo[a] };
        let has_next = self.cell[a] != last;
        if has_next {
            self.cell[a] += if direction[a] > 0.0 { 1 } else { -1 };
        }
        (step, has_next)
    }
}
