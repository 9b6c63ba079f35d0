//! Cells smaller than a pixel: rays spread over a pixel may pass between them, so what they
//! could emit and absorb is known beforehand, and squares are divided until rays meet them.

use super::super::camera::{BoxView, Camera};
use super::super::double_double::DoubleDouble;
use super::march::Scenery;

/// Leaf cells of one cell (or one root cell) that appear smaller than a pixel.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Speck {
    /// Column and row, pixels.
    pub(crate) lo: [f64; 2],
    pub(crate) hi: [f64; 2],
    /// Smallest edge of one of its leaf cells, pixels.
    pub(crate) size: f64,
    /// At most its light, as radiance over a whole pixel.
    pub(crate) light: f64,
    /// At most the part of a pixel that it takes away.
    pub(crate) shade: f64,
}

/// Specks of each pixel, row by row.
pub(crate) struct Specks {
    by_pixel: Vec<Vec<Speck>>,
}

/// A cell on the way down.
struct Place {
    node: usize,
    level: usize,
    index: [i64; 3],
    /// Range of the values that the interpolant may take, from the cells above.
    range: [f64; 2],
}

struct Search<'a> {
    scenery: Scenery<'a>,
    camera: &'a Camera,
    root_cell_width: [f64; 3],
    size: [usize; 2],
    found: Specks,
}

impl Specks {
    pub(crate) fn find(
        scenery: Scenery<'_>,
        camera: &Camera,
        root_cell_width: [f64; 3],
        size: [usize; 2],
    ) -> Self {
        let found = Self { by_pixel: vec![Vec::new(); size[0] * size[1]] };
        let mut search = Search { scenery, camera, root_cell_width, size, found };
        let [nx, ny, nz] = scenery.tree.root_cells;
        for n in 0..nx * ny * nz {
            let index = [n % nx, n / nx % ny, n / nx / ny];
            let node = n as usize;
            let range = scenery.tree.nodes[node].range();
            search.visit(&Place { node, level: 0, index, range });
        }
        search.found
    }

    /// Specks of pixel `n`.
    pub(crate) fn of(&self, n: usize) -> &[Speck] {
        &self.by_pixel[n]
    }
}

impl Search<'_> {
    fn visit(&mut self, place: &Place) {
        let view = self.view(place);
        if self.is_beside(&view) {
            return;
        }
        let tree = self.scenery.tree;
        let (mut light, mut shade) = (0.0, 0.0);
        let mut add = |[own_light, own_shade]: [f64; 2]| {
            light += own_light;
            shade += own_shade;
        };
        let Some(first) = tree.nodes[place.node].child(0) else {
            if place.level == 0 {
                add(self.strength(place, &view));
                self.keep(place, &view, [light, shade]);
            }
            return;
        };
        for octant in 0..8 {
            let child = self.child(place, first + octant, octant);
            if tree.nodes[child.node].child(0).is_some() {
                self.visit(&child);
            } else {
                add(self.strength(&child, &view));
            }
        }
        let size = Place { level: place.level + 1, ..*place };
        self.keep(&size, &view, [light, shade]);
    }

    fn child(&self, place: &Place, node: usize, octant: usize) -> Place {
        let own = self.scenery.tree.nodes[node].range();
        let range = if self.scenery.tree.nodes[node].is_whole() {
            own
        } else {
            [own[0].min(place.range[0]), own[1].max(place.range[1])]
        };
        let index = [0, 1, 2].map(|a| 2 * place.index[a] + (octant >> a & 1) as i64);
        Place { node, level: place.level + 1, index, range }
    }

    fn view(&self, place: &Place) -> BoxView {
        let half = DoubleDouble::from(0.5);
        let centre =
            place.index.map(|i| (DoubleDouble::from_index(i) + half).scaled(-(place.level as i32)));
        self.camera.view_of(centre, self.widths(place.level).map(|width| 0.5 * width))
    }

    /// Edges of a cell, code length.
    fn widths(&self, level: usize) -> [f64; 3] {
        self.root_cell_width.map(|width| width * (-(level as f64)).exp2())
    }

    fn is_beside(&self, view: &BoxView) -> bool {
        let outside = |a: usize| view.hi[a] <= 0.0 || view.lo[a] >= self.size[a] as f64;
        view.far <= 0.0 || (view.near > 0.0 && (outside(0) || outside(1)))
    }

    /// Light and shade of one leaf cell over a pixel, at most.
    fn strength(&self, leaf: &Place, view: &BoxView) -> [f64; 2] {
        let node = &self.scenery.tree.nodes[leaf.node];
        let [low, high] = if self.scenery.is_linear { leaf.range } else { [node.value(); 2] };
        let most = self.scenery.medium.strongest(low, high);
        let [x, y, z] = self.widths(leaf.level);
        let share = x * y * z * view.stretch / (view.near * view.near);
        let outline = (x * y + y * z + z * x) * view.stretch / (view.near * view.near);
        [most.emission * share, (most.extinction * share).min(outline)]
    }

    fn keep(&mut self, place: &Place, view: &BoxView, [light, shade]: [f64; 2]) {
        let smallest = self.widths(place.level).into_iter().fold(f64::INFINITY, f64::min);
        let size = smallest / view.far;
        if size >= 1.0 || view.near <= 0.0 || (light == 0.0 && shade == 0.0) {
            return;
        }
        let speck = Speck { lo: view.lo, hi: view.hi, size, light, shade };
        let pixels = |a: usize| {
            let end = self.size[a] - 1;
            (view.lo[a].max(0.0) as usize).min(end)..=(view.hi[a].max(0.0) as usize).min(end)
        };
        for row in pixels(1) {
            for column in pixels(0) {
                self.found.by_pixel[row * self.size[0] + column].push(speck);
            }
        }
    }
}
