//! The interpolants of a brick's levels at places half a cell apart: between these they are
//! trilinear, and so are their differences to what thinner bricks make of them.

use super::blocks::ScaledBlock;
use super::scaled::{ScaledBrick, dual};

/// Where along an axis a place lies in a block: behind which of its values, and how far to the next.
#[derive(Debug, Clone, Copy)]
struct Stop {
    first: usize,
    rest: f64,
}

/// Which interpolants a place's value is a mean of: the brick's own, and those above.
const OWN: u8 = 1;
const ABOVE: u8 = 2;

/// Places along each axis of a brick, in halves of its cells from its lowest face, and where they
/// lie in its blocks. The memory is reused from brick to brick.
#[derive(Debug, Default)]
pub(super) struct Halves {
    places: Vec<usize>,
    /// For each block and axis, of each place.
    stops: Vec<[Vec<Stop>; 3]>,
    /// A row of a block, between its rows.
    between: Vec<f64>,
    /// What the row in hand draws on, dual cell by dual cell; empty where it is the brick's own
    /// interpolant alone.
    marks: Vec<u8>,
    /// The values of the blocks at the row's places.
    own: Vec<f64>,
    above: Vec<Vec<f64>>,
}

impl Halves {
    /// Heap bytes at most, of bricks of `edge` cells with `blocks` blocks.
    pub(super) fn bytes(edge: usize, blocks: usize) -> u64 {
        let (places, heads) = (2 * edge + 1, blocks.next_power_of_two().max(4));
        let stops = 3 * blocks * places * size_of::<Stop>() + heads * size_of::<[Vec<Stop>; 3]>();
        let rows = (blocks + 2) * places * size_of::<f64>() + heads * size_of::<Vec<f64>>();
        (2 * (stops + rows) + 2 * places * size_of::<usize>() + 2 * edge) as u64
    }

    /// Heap bytes in use.
    #[cfg(test)]
    pub(super) fn held(&self) -> usize {
        let stops = self.stops.iter().flatten().map(Vec::capacity).sum::<usize>();
        let above = self.above.iter().map(Vec::capacity).sum::<usize>();
        stops * size_of::<Stop>()
            + self.stops.capacity() * size_of::<[Vec<Stop>; 3]>()
            + self.above.capacity() * size_of::<Vec<f64>>()
            + (above + self.between.capacity() + self.own.capacity()) * size_of::<f64>()
            + self.places.capacity() * size_of::<usize>()
            + self.marks.capacity()
    }

    /// Looks at `places` of `brick`, in order; `shrink` is the width of the cells that they count in
    /// halves of, in the brick's own.
    pub(super) fn set(
        &mut self,
        brick: &ScaledBrick,
        shrink: f64,
        places: impl Iterator<Item = usize>,
    ) {
        self.places.clear();
        self.places.extend(places);
        let used = if brick.duals.is_empty() { 1 } else { brick.used };
        if self.stops.len() < used {
            self.stops.resize_with(used, Default::default);
            self.above.resize_with(used - 1, Vec::new);
        }
        for (along, block) in self.stops.iter_mut().zip(&brick.blocks[..used]) {
            for (a, stops) in along.iter_mut().enumerate() {
                stops.clear();
                let at = |place: &usize| 0.5 * shrink * *place as f64;
                stops.extend(self.places.iter().map(|place| stop(block, a, at(place))));
            }
        }
    }

    /// The places along an axis.
    pub(super) fn places(&self) -> &[usize] {
        &self.places
    }

    /// Finds the values of the row at these places along y and z.
    pub(super) fn look(&mut self, brick: &ScaledBrick, [y, z]: [usize; 2]) {
        self.mark(brick, [self.places[y], self.places[z]]);
        let used = if self.marks.is_empty() { 1 } else { brick.used };
        for up in 0..used {
            let [x_stops, y_stops, z_stops] = &self.stops[up];
            let row = if up == 0 { &mut self.own } else { &mut self.above[up - 1] };
            sample(&brick.blocks[up], [y_stops[y], z_stops[z]], x_stops, &mut self.between, row);
        }
    }

    /// The values of the brick's own interpolant in the row.
    pub(super) fn own(&self) -> &[f64] {
        &self.own
    }

    /// What a place's value is close to; and whether it is that of the brick's own interpolant.
    pub(super) fn value(&self, x: usize) -> (f64, bool) {
        match self.marks_at(x) {
            OWN => (self.own[x], true),
            ABOVE => (self.above[0][x], false),
            _ => (0.5 * (self.own[x] + self.above[0][x]), false),
        }
    }

    /// How far `values` are at most from what the row's may be.
    pub(super) fn distances(&self, values: &[f64], apart: &mut Vec<f64>) {
        apart.clear();
        let own = self.own.iter().zip(values);
        apart.extend(own.map(|(own, value)| (own - value).abs()));
        if self.marks.is_empty() {
            return;
        }
        for (x, (most, value)) in apart.iter_mut().zip(values).enumerate() {
            let marks = self.marks_at(x);
            if marks & OWN == 0 {
                *most = 0.0;
            }
            if marks & ABOVE != 0 {
                let above = self.above.iter().filter_map(|row| row.get(x));
                *most = above.fold(*most, |most, above| most.max((above - value).abs()));
            }
        }
    }

    fn marks_at(&self, x: usize) -> u8 {
        if self.marks.is_empty() {
            return OWN;
        }
        duals_at(self.places[x]).fold(0, |marks, at| marks | self.marks[at])
    }

    /// Finds out what the dual cells beside a row draw on.
    fn mark(&mut self, brick: &ScaledBrick, [y, z]: [usize; 2]) {
        self.marks.clear();
        self.above.iter_mut().for_each(Vec::clear);
        if brick.duals.is_empty() {
            return;
        }
        let count = brick.edge + 1;
        self.marks.resize(count, 0);
        for (z, y) in duals_at(z).flat_map(|z| duals_at(y).map(move |y| (z, y))) {
            let first = (z * count + y) * count;
            let duals = brick.duals[first..].iter().zip(&brick.narrow[0].corners[first..]);
            for (mark, (kind, exists)) in self.marks.iter_mut().zip(duals) {
                *mark |= match (*kind, *exists) {
                    (dual::PLAIN, _) | (_, u8::MAX) => OWN,
                    (_, 0) => ABOVE,
                    _ => OWN | ABOVE,
                };
            }
        }
        if self.marks.iter().all(|mark| *mark == OWN) {
            self.marks.clear();
        }
    }
}

/// The dual cells that a place, in halves of a cell, lies in or between.
fn duals_at(place: usize) -> std::ops::RangeInclusive<usize> {
    place / 2..=place.div_ceil(2)
}

fn stop(block: &ScaledBlock, a: usize, place: f64) -> Stop {
    // Values lie in the middles of cells, and the first one is a ghost's.
    let at = place * block.scale + block.corner[a] + 0.5;
    let first = (at as usize).min(block.side - 2);
    Stop { first, rest: at - first as f64 }
}

/// The values of a block along a row.
fn sample(
    block: &ScaledBlock,
    [y, z]: [Stop; 2],
    along: &[Stop],
    between: &mut Vec<f64>,
    row: &mut Vec<f64>,
) {
    let values = |y: usize, z: usize| &block.values[block.at([0, y, z])..][..block.side];
    let near = values(y.first, z.first).iter().zip(values(y.first + 1, z.first));
    let far = values(y.first, z.first + 1).iter().zip(values(y.first + 1, z.first + 1));
    between.clear();
    between.extend(near.zip(far).map(|((a, b), (c, d))| {
        let (near, far) = (a + y.rest * (b - a), c + y.rest * (d - c));
        near + z.rest * (far - near)
    }));
    row.clear();
    row.extend(along.iter().map(|stop| {
        let [a, b] = [between[stop.first], between[stop.first + 1]];
        a + stop.rest * (b - a)
    }));
}
