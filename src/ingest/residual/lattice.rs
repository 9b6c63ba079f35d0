//! The difference of two trilinear interpolants at the points where it takes its extremes.

use crate::lanes::{Kernel, Lanes, Width};

/// The points at half-integer coordinates in a brick, (2B + 1)³, and which of them count. Memory
/// is reused.
///
/// Coarser cells' faces between cells that count hold no extreme: both interpolants are linear
/// across them, between the centres of the finer cells beside them. Along y and z they are left
/// out; along x they cost less than a row of its own order.
#[derive(Debug, Default)]
pub(super) struct Lattice {
    edge: usize,
    /// Cells whose points count: a bit for each cell of a row along x, rows along y, then z.
    cells: Vec<u32>,
    /// Rows of points of which some count.
    rows: Vec<Row>,
    fine: Columns,
    coarse: Columns,
}

/// A row of points along x: where it lies, in half cells, and the cells beside it that count.
#[derive(Debug, Clone, Copy)]
struct Row {
    y: usize,
    z: usize,
    cells: u32,
}

impl Lattice {
    /// Begins with a brick of `edge` cells of which none is known.
    pub(super) fn begin(&mut self, edge: usize) {
        self.edge = edge;
        self.cells.clear();
    }

    /// Which cells of the next row along x count: their 27 points do then.
    pub(super) fn push(&mut self, cells: u32) {
        self.cells.push(cells);
    }

    /// All cells are known.
    pub(super) fn end(&mut self) {
        self.rows.clear();
        for z in 0..=2 * self.edge {
            for y in 0..=2 * self.edge {
                let cells = self.beside(y, z);
                if cells != 0 {
                    self.rows.push(Row { y, z, cells });
                }
            }
        }
    }

    /// The cells beside a row of points that count; none where the row holds no extreme.
    fn beside(&self, y: usize, z: usize) -> u32 {
        let ([y0, y1], [z0, z1]) = (self.around(y), self.around(z));
        let at = |y: usize, z: usize| self.cells.get(z * self.edge + y).copied().unwrap_or(0);
        let [a, b, c, d] = [at(y0, z0), at(y1, z0), at(y0, z1), at(y1, z1)];
        let is_inner = |h: usize| h.is_multiple_of(4) && h != 0 && h != 2 * self.edge;
        let along_y = is_inner(y) && a == b && c == d;
        let along_z = is_inner(z) && a == c && b == d;
        if along_y || along_z { 0 } else { a | b | c | d }
    }

    /// The cells on both sides of a point, along one axis.
    fn around(&self, h: usize) -> [usize; 2] {
        if h.is_multiple_of(2) {
            [(h / 2).saturating_sub(1), (h / 2).min(self.edge - 1)]
        } else {
            [h / 2; 2]
        }
    }

    /// Largest |T_l − T_{l−1}| over the points that count, of mapped values of both blocks.
    pub(super) fn difference(&mut self, fine: &[f64], coarse: &[f64]) -> f64 {
        if self.rows.is_empty() {
            return 0.0;
        }
        let values = [fine, coarse];
        match self.edge {
            8 => Width::best().run(Difference::<4, 20> { lattice: self, values }),
            16 => Width::best().run(Difference::<8, 36> { lattice: self, values }),
            _ => Width::best().run(Difference::<16, 68> { lattice: self, values }),
        }
    }
}

/// A block's values, interpolated along x, then along y.
#[derive(Debug, Default)]
struct Columns {
    along_x: Vec<f64>,
    along_y: Vec<f64>,
}

/// Bricks of 2K cells, in rows of `ROW` points along x: the 4K + 1 and some zeros. Points come by
/// where they lie in a coarser cell, so that their neighbours of either level lie side by side:
/// the K at each of its quarters, half and three quarters, then the K + 1 at its faces.
struct Difference<'l, const K: usize, const ROW: usize> {
    lattice: &'l mut Lattice,
    values: [&'l [f64]; 2],
}

impl<const K: usize, const ROW: usize> Kernel for Difference<'_, K, ROW> {
    type Output = f64;

    #[inline(always)]
    fn run<L: Lanes>(self, _: L) -> f64 {
        let Lattice { rows, fine, coarse, .. } = self.lattice;
        fine_along_x::<K, ROW>(self.values[0], &mut fine.along_x);
        faces_along_y::<K, ROW>(&fine.along_x, &mut fine.along_y);
        coarse_along_x::<K, ROW>(self.values[1], &mut coarse.along_x);
        coarse_along_y::<K, ROW>(&coarse.along_x, &mut coarse.along_y);
        largest::<K, ROW>(rows, fine, coarse)
    }
}

/// Points lie at faces and centres (block index = cell + 1).
#[inline(always)]
fn fine_along_x<const K: usize, const ROW: usize>(mapped: &[f64], along_x: &mut Vec<f64>) {
    let rows = mapped.chunks_exact(2 * K + 2);
    along_x.resize(ROW * rows.len(), 0.0);
    for (row, points) in rows.zip(along_x.as_chunks_mut::<ROW>().0) {
        let row = &row[..2 * K + 2];
        for k in 0..K {
            let [a, b] = [row[2 * k + 1], row[2 * k + 2]];
            points[k] = a;
            points[K + k] = 0.5 * a + 0.5 * b;
            points[2 * K + k] = b;
        }
        for k in 0..=K {
            points[3 * K + k] = 0.5 * row[2 * k] + 0.5 * row[2 * k + 1];
        }
        points[4 * K + 1..].fill(0.0);
    }
}

/// Points lie at quarters of coarser cells.
#[inline(always)]
fn coarse_along_x<const K: usize, const ROW: usize>(mapped: &[f64], along_x: &mut Vec<f64>) {
    let rows = mapped.chunks_exact(K + 2);
    along_x.resize(ROW * rows.len(), 0.0);
    for (row, points) in rows.zip(along_x.as_chunks_mut::<ROW>().0) {
        let row = &row[..K + 2];
        for k in 0..K {
            let [a, b, c] = [row[k], row[k + 1], row[k + 2]];
            points[k] = 0.25 * a + 0.75 * b;
            points[K + k] = b;
            points[2 * K + k] = 0.75 * b + 0.25 * c;
        }
        for k in 0..=K {
            points[3 * K + k] = 0.5 * row[k] + 0.5 * row[k + 1];
        }
        points[4 * K + 1..].fill(0.0);
    }
}

/// The rows on faces along y; those at centres are what they were.
#[inline(always)]
fn faces_along_y<const K: usize, const ROW: usize>(along_x: &[f64], along_y: &mut Vec<f64>) {
    let planes = along_x.chunks_exact((2 * K + 2) * ROW);
    along_y.resize((2 * K + 1) * ROW * planes.len(), 0.0);
    for (plane, faces) in planes.zip(along_y.chunks_exact_mut((2 * K + 1) * ROW)) {
        let pairs = plane.iter().zip(&plane[ROW..]);
        faces.iter_mut().zip(pairs).for_each(|(face, (a, b))| *face = 0.5 * a + 0.5 * b);
    }
}

#[inline(always)]
fn coarse_along_y<const K: usize, const ROW: usize>(along_x: &[f64], along_y: &mut Vec<f64>) {
    let planes = along_x.chunks_exact((K + 2) * ROW);
    along_y.resize((4 * K + 1) * ROW * planes.len(), 0.0);
    for (plane, points) in planes.zip(along_y.chunks_exact_mut((4 * K + 1) * ROW)) {
        let rows = plane.as_chunks::<ROW>().0;
        for (h, points) in points.as_chunks_mut::<ROW>().0.iter_mut().enumerate() {
            let (first, [a, b]) = coarse_tap(h);
            let (p, q) = (&rows[first], &rows[first + 1]);
            for n in 0..ROW {
                points[n] = a * p[n] + b * q[n];
            }
        }
    }
}

/// Along one axis: the coarser value at a point is `weights · values[first ..= first + 1]`.
#[inline(always)]
pub(super) fn coarse_tap(h: usize) -> (usize, [f64; 2]) {
    match h % 4 {
        0 => (h / 4, [0.5, 0.5]),
        1 => (h / 4, [0.25, 0.75]),
        2 => (h / 4, [0.0, 1.0]),
        _ => (h / 4 + 1, [0.75, 0.25]),
    }
}

/// Largest |own − above| of the points of `rows` that count.
#[inline(always)]
fn largest<const K: usize, const ROW: usize>(
    rows: &[Row],
    fine: &Columns,
    coarse: &Columns,
) -> f64 {
    let centres = fine.along_x.as_chunks::<ROW>().0;
    let faces = fine.along_y.as_chunks::<ROW>().0;
    let coarse = coarse.along_y.as_chunks::<ROW>().0;
    let own = |y: usize, z: usize| match y % 2 {
        0 => &faces[z * (2 * K + 1) + y / 2],
        _ => &centres[z * (2 * K + 2) + y / 2 + 1],
    };
    let mut most = [0.0; ROW];
    let (mut cells, mut counted) = (0, [0; ROW]);
    for row in rows {
        if row.cells != cells {
            cells = row.cells;
            counted = points_of::<K, ROW>(cells);
        }
        let (first, [a, b]) = coarse_tap(row.z);
        let above = |z: usize| &coarse[z * (4 * K + 1) + row.y];
        let (r, s) = (above(first), above(first + 1));
        let (p, q) = (own(row.y, row.z / 2), own(row.y, row.z / 2 + 1));
        match row.z % 4 {
            0 => raise(&mut most, &counted, |n| 0.5 * p[n] + 0.5 * q[n] - (a * r[n] + b * s[n])),
            2 => raise(&mut most, &counted, |n| 0.5 * p[n] + 0.5 * q[n] - s[n]),
            _ => raise(&mut most, &counted, |n| q[n] - (a * r[n] + b * s[n])),
        }
    }
    most.into_iter().fold(0.0, f64::max)
}

/// Raises `most` to the magnitudes of differences that are counted.
#[inline(always)]
fn raise<const ROW: usize>(
    most: &mut [f64; ROW],
    counted: &[u64; ROW],
    difference: impl Fn(usize) -> f64,
) {
    for n in 0..ROW {
        let difference = f64::from_bits(difference(n).to_bits() & counted[n]).abs();
        most[n] = if difference > most[n] { difference } else { most[n] };
    }
}

/// All bits for the points of a row's `cells`, none for others.
#[inline(always)]
fn points_of<const K: usize, const ROW: usize>(cells: u32) -> [u64; ROW] {
    let cells = u64::from(cells);
    let bits = |counts: u64| (counts & 1).wrapping_neg();
    let mut points = [0; ROW];
    for k in 0..K {
        let pair = cells >> (2 * k);
        points[k] = bits(pair);
        points[K + k] = bits(pair | pair >> 1);
        points[2 * K + k] = bits(pair >> 1);
    }
    for k in 0..=K {
        points[3 * K + k] = bits((cells << 1 | cells) >> (2 * k));
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cache::Block;

    fn block(side: usize, seed: u64) -> Block {
        let value = |i: u64| (((i + 7) * seed) % 1009) as f32 / 100.0;
        let values: Vec<f32> = (0..side.pow(3) as u64).map(value).collect();
        Block { side, states: vec![1; values.len()], values }
    }

    fn wide(block: &Block) -> Vec<f64> {
        block.values.iter().copied().map(f64::from).collect()
    }

    fn lattice(edge: usize, cells: impl Fn(usize, usize) -> u32) -> Lattice {
        let mut lattice = Lattice::default();
        lattice.begin(edge);
        for at in 0..edge * edge {
            lattice.push(cells(at % edge, at / edge));
        }
        lattice.end();
        lattice
    }

    /// The interpolant of a block at a point in its own cells, counted from its first centre.
    fn trilinear(block: &Block, at: [f64; 3]) -> f64 {
        let first = at.map(|c| (c.floor() as usize).min(block.side - 2));
        let part: [f64; 3] = std::array::from_fn(|a| at[a] - first[a] as f64);
        (0..8).fold(0.0, |sum, corner| {
            let [dx, dy, dz] = [corner & 1, corner >> 1 & 1, corner >> 2];
            let weight = |part: f64, d: usize| if d == 1 { part } else { 1.0 - part };
            let weight = weight(part[0], dx) * weight(part[1], dy) * weight(part[2], dz);
            let at = block.at(first[0] + dx, first[1] + dy, first[2] + dz);
            sum + weight * f64::from(block.values[at])
        })
    }

    /// The largest difference at the 27 points of each cell that counts.
    fn plainly(edge: usize, cells: impl Fn(usize, usize) -> u32, blocks: [&Block; 2]) -> f64 {
        let mut most = 0.0_f64;
        for at in 0..27 * edge.pow(3) {
            let (cell, point) = (at / 27, [at % 3, at / 3 % 3, at / 9 % 3]);
            let cell = [cell % edge, cell / edge % edge, cell / edge / edge];
            if cells(cell[1], cell[2]) >> cell[0] & 1 == 1 {
                let own = std::array::from_fn(|a| (cell[a] as f64) + 0.5 * (point[a] + 1) as f64);
                let above = own.map(|c: f64| (c - 0.5) / 2.0 + 0.5);
                let pair = [trilinear(blocks[0], own), trilinear(blocks[1], above)];
                most = most.max((pair[0] - pair[1]).abs());
            }
        }
        most
    }

    #[test]
    fn the_largest_difference_is_that_of_all_points() {
        let kinds: [fn(usize, usize) -> u32; 5] = [
            |_, _| u32::MAX,
            |y, z| if y < 3 || z > 5 { 0x00ff_0ff0 } else { 0 },
            |y, z| {
                let noise = (y as u32).wrapping_mul(0x9e37_79b9);
                noise ^ (z as u32).wrapping_mul(0x85eb_ca6b).rotate_left(7)
            },
            |y, z| if (y, z) == (5, 2) { 1 } else { 0 },
            |y, z| if y == 7 && z == 7 { 0x8080_8080 } else { 0 },
        ];
        for edge in [8, 16, 32] {
            for (kind, seed) in kinds.into_iter().zip([31, 77, 1003, 205, 58]) {
                let cells = |y: usize, z: usize| kind(y, z) & (u32::MAX >> (32 - edge));
                let (fine, coarse) = (block(edge + 2, seed), block(edge / 2 + 2, seed + 4));
                let expected = plainly(edge, cells, [&fine, &coarse]);
                let found = lattice(edge, cells).difference(&wide(&fine), &wide(&coarse));
                assert!((found - expected).abs() <= 1e-12 * expected, "{edge}, {seed}");
                assert!(expected > 1.0);
            }
        }
    }

    #[test]
    fn only_counted_cells_count() {
        let (fine, mut coarse) = (block(10, 0), block(6, 0));
        coarse.values[3 * 36 + 3 * 6 + 3] = 8.0;
        let one = |x: u32, at: usize| {
            lattice(8, move |y, z| if y == at && z == at { 1 << x } else { 0 })
                .difference(&wide(&fine), &wide(&coarse))
        };
        assert_eq!(lattice(8, |_, _| 0).difference(&wide(&fine), &wide(&coarse)), 0.0);
        assert_eq!(one(0, 0), 0.0);
        // A corner of this cell is the centre of the coarser cell that differs.
        assert_eq!(one(4, 4), 8.0);
    }
}
