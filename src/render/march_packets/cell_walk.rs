//! The walk of a ray that a packet has left at a cell.

use super::cabin::Rider;
use crate::render::frame::LocalRay;
use crate::render::march::{CellRange, DUAL_SHIFT};
use crate::render::packet::Packet;
use crate::render::walk::Step;

/// The walk of one ray from the dual cell on that its lane has reached.
pub(super) struct CellWalk<'r> {
    rider: &'r LocalRay,
    range: &'r CellRange,
    pub(super) cell: [i32; 3],
    pub(super) from: f64,
    end: f64,
}

impl<'r> CellWalk<'r> {
    pub(super) fn new(
        rider: &'r Rider,
        range: &'r CellRange,
        packet: &Packet,
        lane: usize,
    ) -> Self {
        let reached = packet.reached(lane);
        Self {
            rider: &rider.ray,
            range,
            cell: packet.cell(lane),
            from: (rider.span.0 + reached * rider.unit).min(rider.span.1),
            end: rider.span.1,
        }
    }

    /// The way through the present cell, and whether there is a next one, which is gone to.
    pub(super) fn step(&mut self) -> (Step, bool) {
        let (origin, direction) = (self.rider.origin.to_array(), self.rider.direction.to_array());
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
