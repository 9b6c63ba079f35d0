//! The interpolant along a ray within half a cell: blend to parent, as polynomials.

use super::march::Parent;
use super::polynomial::Polynomial;
use super::tree::{Node, Tree, stencil_place};

/// A straight stretch within a cell: `place + slope · t`, `t` in 0 … `length` code lengths,
/// places in cells from the cell's lower corner.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Along {
    pub(crate) place: [f64; 3],
    pub(crate) slope: [f64; 3],
    pub(crate) length: f64,
}

/// Receives the scaled value along a piece, a range that holds it, and the piece's code length.
pub(crate) type Visit<'v> = dyn FnMut(&Polynomial, [f64; 2], f64) + 'v;

/// One level's part within half a cell.
#[derive(Clone, Copy)]
struct Layer {
    corners: [f64; 8],
    upper: [bool; 3],
    /// Bits of the sets of axes whose neighbour does not exist.
    missing: u32,
    /// Place between the eight centres: at the half's start, and how far it moves.
    start: [f64; 3],
    run: [f64; 3],
}

impl Along {
    /// Hands over the parts between the planes through the cell's centre.
    pub(crate) fn each_half(&self, visit: &mut dyn FnMut(Self)) {
        let mut ends = [0.0, self.length, self.length, self.length, self.length];
        for axis in 0..3 {
            let at = (0.5 - self.place[axis]) / self.slope[axis];
            if 0.0 < at && at < self.length {
                ends[axis + 1] = at;
            }
        }
        ends.sort_unstable_by(f64::total_cmp);
        for pair in ends.windows(2).filter(|pair| pair[0] < pair[1]) {
            visit(self.from(pair[0], pair[1] - pair[0]));
        }
    }

    fn from(&self, t: f64, length: f64) -> Self {
        let place = std::array::from_fn(|a| self.place[a] + self.slope[a] * t);
        Self { place, length, ..*self }
    }

    /// The same stretch in the cell above.
    fn in_parent(&self, index: [i64; 3]) -> Self {
        Self {
            place: std::array::from_fn(|a| 0.5 * (self.place[a] + (index[a] & 1) as f64)),
            slope: self.slope.map(|d| 0.5 * d),
            length: self.length,
        }
    }
}

impl Layer {
    fn new(node: &Node, along: Along) -> Self {
        let middle = |a: usize| along.place[a] + 0.5 * along.slope[a] * along.length;
        let upper: [bool; 3] = std::array::from_fn(|a| middle(a) >= 0.5);
        let lowest = upper.map(|up| if up { 0 } else { -1 });
        let corner = |n: usize| stencil_place([0, 1, 2].map(|a| lowest[a] + (n >> a & 1) as i64));
        Self {
            corners: std::array::from_fn(|n| node.stencil[corner(n)]),
            upper,
            missing: node.missing(upper),
            start: std::array::from_fn(|a| along.place[a] - lowest[a] as f64 - 0.5),
            run: along.slope.map(|d| d * along.length),
        }
    }

    /// The part of the stretch from `low` to `high` of 0 … 1.
    fn restricted(&self, low: f64, high: f64) -> Self {
        Self {
            start: std::array::from_fn(|a| self.start[a] + self.run[a] * low),
            run: self.run.map(|run| run * (high - low)),
            ..*self
        }
    }

    /// `s_a` along the stretch: constant and slope.
    fn fade(&self, a: usize) -> [f64; 2] {
        if self.upper[a] {
            [1.0 - 2.0 * self.start[a], -2.0 * self.run[a]]
        } else {
            [2.0 * self.start[a] - 1.0, 2.0 * self.run[a]]
        }
    }

    /// The level's weight where no two of the `s_a` cross: the least over missing sets of the
    /// largest `s_a`.
    fn weight(&self) -> [f64; 2] {
        let middle = |line: &[f64; 2]| line[0] + 0.5 * line[1];
        let largest = |set: usize| {
            let lines = (0..3).filter(|a| set >> a & 1 == 1).map(|a| self.fade(a));
            lines.max_by(|a, b| middle(a).total_cmp(&middle(b)))
        };
        let sets = (1..8).filter(|set| self.missing >> set & 1 == 1).filter_map(largest);
        sets.min_by(|a, b| middle(a).total_cmp(&middle(b))).unwrap_or([1.0, 0.0])
    }

    fn trilinear(&self) -> Polynomial {
        let [x, y, z] = std::array::from_fn(|a| [self.start[a], self.run[a]]);
        let c = &self.corners;
        let along_x = |n: usize| {
            let change = c[n + 1] - c[n];
            [c[n] + change * x[0], change * x[1]]
        };
        let along_y = |n: usize| {
            let (low, high) = (along_x(n), along_x(n + 2));
            let change = [high[0] - low[0], high[1] - low[1]];
            [
                low[0] + change[0] * y[0],
                low[1] + change[1] * y[0] + change[0] * y[1],
                change[1] * y[1],
            ]
        };
        let (low, high) = (along_y(0), along_y(4));
        let change: [f64; 3] = std::array::from_fn(|n| high[n] - low[n]);
        Polynomial::new(&[
            low[0] + change[0] * z[0],
            low[1] + change[1] * z[0] + change[0] * z[1],
            low[2] + change[2] * z[0] + change[1] * z[1],
            change[2] * z[1],
        ])
    }

    fn range(&self) -> [f64; 2] {
        let (low, high) = (f64::INFINITY, f64::NEG_INFINITY);
        self.corners.iter().fold([low, high], |[l, h], v| [l.min(*v), h.max(*v)])
    }
}

/// Hands over the pieces of half a cell in which the value is one polynomial.
pub(crate) fn each_piece(tree: &Tree, leaf: &Parent<'_>, half: Along, visit: &mut Visit<'_>) {
    let layer = Layer::new(&tree.nodes[leaf.node], half);
    if layer.missing == 0 {
        visit(&layer.trilinear(), layer.range(), half.length);
    } else {
        each_blended(&layers_above(tree, leaf, layer, half), half.length, visit);
    }
}

/// The layers from the leaf's up to the first where nothing is missing, or the root grid's.
fn layers_above(tree: &Tree, leaf: &Parent<'_>, first: Layer, half: Along) -> Vec<Layer> {
    let mut layers = vec![first];
    let (mut cell, mut along) = (leaf, half);
    while let (Some(above), true) = (cell.above, layers[layers.len() - 1].missing != 0) {
        along = along.in_parent(cell.index);
        layers.push(Layer::new(&tree.nodes[above.node], along));
        cell = above;
    }
    layers
}

fn each_blended(layers: &[Layer], length: f64, visit: &mut Visit<'_>) {
    let mut cuts = vec![0.0, 1.0];
    for layer in layers.iter().filter(|layer| layer.missing != 0) {
        for (a, b) in [(0, 1), (0, 2), (1, 2)] {
            let (a, b) = (layer.fade(a), layer.fade(b));
            let at = (b[0] - a[0]) / (a[1] - b[1]);
            if 0.0 < at && at < 1.0 {
                cuts.push(at);
            }
        }
    }
    cuts.sort_unstable_by(f64::total_cmp);
    let ranges = layers.iter().map(Layer::range);
    let hull =
        ranges.fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], r| [l.min(r[0]), h.max(r[1])]);
    for pair in cuts.windows(2).filter(|pair| pair[0] < pair[1]) {
        let value = blended(layers, pair[0], pair[1]);
        visit(&value, hull, length * (pair[1] - pair[0]));
    }
}

/// `F` from `low` to `high`, from the coarsest layer down. Chains of more levels than a
/// polynomial has room for give NaN.
fn blended(layers: &[Layer], low: f64, high: f64) -> Polynomial {
    let coarsest_first = layers.iter().rev().map(|layer| layer.restricted(low, high));
    let start = Polynomial::new(&[0.0]);
    coarsest_first.fold(start, |coarser, layer| {
        let fine = layer.trilinear();
        if layer.missing == 0 {
            return fine;
        }
        coarser.blended(layer.weight(), &fine).unwrap_or(Polynomial::new(&[f64::NAN]))
    })
}
