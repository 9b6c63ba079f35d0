//! The cut: which bricks of the tree are drawn as they are, and which are opened.

use glam::DVec3;

use crate::Result;
use crate::cache::{BrickPlace, BrickShape, Precision};
use crate::render::brick::interpolant::DrawnNeighbours;
use crate::scene::{Projection, Scene};
use crate::space::{Domain, Position};

/// Which bricks are opened.
#[derive(Debug, Clone, PartialEq)]
pub enum Cut {
    /// All that have children.
    FullDepth,
    /// By the size of their cells in pixels.
    Footprint(FootprintCut),
    /// By how far the light of a ray through them may be off if they are drawn as they are.
    Error(ErrorCut),
}

impl Cut {
    /// Which of the bricks around the drawn one at `place` are drawn at its level or finer, where
    /// they exist. A cut by error counts what its bricks are off by with all of them.
    pub fn drawn_neighbours(&self, place: &BrickPlace) -> DrawnNeighbours {
        match self {
            Self::Footprint(cut) => cut.drawn_neighbours(place),
            Self::FullDepth | Self::Error(_) => DrawnNeighbours::ALL,
        }
    }

    /// The same cut, but one by error leaves so many times as much to bricks of `narrow` cells.
    pub(crate) fn leaving(self, narrow: f64) -> Self {
        match self {
            Self::Error(cut) => Self::Error(ErrorCut { narrow, ..cut }),
            cut => cut,
        }
    }
}

/// Opens bricks by which a ray's light may be off by more than a limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorCut {
    /// The limit, in the picture's own unit.
    pub limit: f64,
    /// How many times as much is left to a brick whose cells are narrower than a pixel.
    pub narrow: f64,
    /// What a brick's values may be off by as they are read, likewise; none where all digits are read,
    /// whatever they make.
    pub digits: Option<f64>,
    /// Light that is expected from behind a brick.
    pub behind: f64,
}

/// A cut by geometry alone: the same for every tile, thread and memory limit. Monotone (an opened
/// brick's parent is opened), and bricks that touch differ by one level at most where the cut, and
/// not the data, ends the descent.
#[derive(Debug, Clone, PartialEq)]
pub struct FootprintCut {
    domain: Domain,
    shape: BrickShape,
    rule: Rule,
    precision: Precision,
}

/// What a brick's largest cell edge must exceed for the brick to be opened.
#[derive(Debug, Clone, PartialEq)]
enum Rule {
    /// A constant, code length: the size of an orthographic picture's pixels.
    Size(f64),
    /// `slope` times the distance of the brick from the eye.
    Distance { eye: Position, slope: f64 },
}

impl FootprintCut {
    /// The cut that opens cells while they are larger than `pixels` pixels where the brick is
    /// nearest to the eye.
    ///
    /// # Errors
    /// An eye too far from the domain.
    pub fn new(pixels: f64, scene: &Scene, domain: &Domain, shape: BrickShape) -> Result<Self> {
        let rule = Rule::of_pixels(pixels, scene, domain, shape)?;
        Ok(Self { domain: domain.clone(), shape, rule, precision: Precision::Full })
    }

    /// This cut, but with values read in [`Precision::Short`].
    pub fn in_short(self) -> Self {
        Self { precision: Precision::Short, ..self }
    }

    /// How many digits of values are read.
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// Whether the brick at `place` is opened: its children are drawn instead of it, as far as
    /// it has any. Places outside the tree have an answer too.
    pub fn opens(&self, place: &BrickPlace) -> bool {
        let cell = self.domain.cell_width(place.octree).max_element();
        match &self.rule {
            Rule::Size(size) => cell > *size,
            Rule::Distance { eye, slope } => cell > slope * self.distance(eye, place),
        }
    }

    /// Which of the bricks around the drawn one at `place` are drawn at its level or finer,
    /// where they exist: those whose parents are opened.
    pub fn drawn_neighbours(&self, place: &BrickPlace) -> DrawnNeighbours {
        // Away from perspective the cut runs between levels: what one brick's parent does, all
        // do.
        if place.tree_level == 0 || !matches!(self.rule, Rule::Distance { .. }) {
            return DrawnNeighbours::ALL;
        }
        let parent_of = |coordinates: [i128; 3]| BrickPlace {
            tree_level: place.tree_level - 1,
            octree: place.octree - 1,
            coordinates: coordinates.map(|c| c >> 1),
        };
        let own = parent_of(place.coordinates);
        let mut bits = 0;
        for direction in 0..27u32 {
            let step = [direction % 3, direction / 3 % 3, direction / 9];
            let neighbour = std::array::from_fn(|a| place.coordinates[a] + i128::from(step[a]) - 1);
            let parent = parent_of(neighbour);
            if parent == own || self.opens(&parent) {
                bits |= 1 << direction;
            }
        }
        DrawnNeighbours(bits)
    }

    /// Distance from `eye` to the nearest point of the brick, code length. Every step of it
    /// (exact difference, rounding, multiplication, sum, root) is monotone, so that a brick
    /// within another is never nearer than that, to the last bit.
    fn distance(&self, eye: &Position, place: &BrickPlace) -> f64 {
        let edge = self.shape.edge() as i128;
        let corner = |offset: i128| {
            self.domain.cell_corner(place.octree, place.coordinates.map(|c| (c + offset) * edge))
        };
        let (lo, hi) = (corner(0), corner(1));
        let nearest = Position(std::array::from_fn(|a| eye.0[a].clamp(lo.0[a], hi.0[a])));
        let gap: DVec3 = self.domain.difference(&nearest, eye);
        (gap.x * gap.x + gap.y * gap.y + gap.z * gap.z).sqrt()
    }
}

impl Rule {
    fn of_pixels(pixels: f64, scene: &Scene, domain: &Domain, shape: BrickShape) -> Result<Self> {
        let (width, height) = (f64::from(scene.image.width), f64::from(scene.image.height));
        match scene.camera.projection {
            Projection::Orthographic { height: view } => Ok(Self::Size(pixels * view / height)),
            Projection::Perspective { fov_degrees } => {
                let half = (fov_degrees.to_radians() / 2.0).tan();
                // Depth along the view is at least this part of the distance, in the picture's
                // corners.
                let cosine = (1.0 + half * half * (1.0 + (width / height).powi(2))).sqrt().recip();
                let pixel = pixels * 2.0 * half / height * cosine;
                let eye = domain.position(&scene.camera.position)?;
                Ok(Self::Distance { eye, slope: pixel.min(Self::steepest_slope(shape)) })
            }
        }
    }

    /// The slope k up to which bricks that touch differ by one level at most.
    ///
    /// Let brick n of level l be drawn, not opened: c(l) ≤ k·r(n), with c the largest cell edge
    /// and r the distance from the eye. Were a brick of level l + 2 drawn that touches n, its
    /// parent m, which touches n as well, would be opened: c(l + 1) > k·r(m). A common point of
    /// both has at least distance r(n), and no point of m is farther than r(m) + D(m), with the
    /// diagonal D(m) ≤ √3·B·c(l + 1). So c(l + 1) > k·(r(n) − D(m)) ≥ c(l) − k·D(m)
    /// ≥ 2·c(l + 1) − k·√3·B·c(l + 1), which cannot be if k ≤ 1 / (√3·B). One percent less
    /// leaves room for rounding.
    fn steepest_slope(shape: BrickShape) -> f64 {
        0.99 / (3f64.sqrt() * shape.edge() as f64)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn cut(edge: u32, eye: [i128; 3], slope: f64) -> FootprintCut {
        let domain = Domain::new([0.0; 3], [1.0, 0.3, 2.0], [48, 40, 36]).unwrap();
        let shape = BrickShape::new(edge).unwrap();
        let slope = slope.min(Rule::steepest_slope(shape));
        let rule = Rule::Distance { eye: Position(eye), slope };
        FootprintCut { domain, shape, rule, precision: Precision::Full }
    }

    /// Bricks near the eye, at any level, where the decision is close.
    fn near(octree: i32, eye: [i128; 3], edge: u32, offset: [i32; 3]) -> BrickPlace {
        let cell = eye.map(|e| e >> (i64::from(crate::space::FRACTION_BITS) - i64::from(octree)));
        let coordinates =
            std::array::from_fn(|a| cell[a].div_euclid(i128::from(edge)) + i128::from(offset[a]));
        BrickPlace { tree_level: 9, octree, coordinates }
    }

    fn shifted(place: &BrickPlace, by: [i128; 3]) -> BrickPlace {
        BrickPlace { coordinates: std::array::from_fn(|a| place.coordinates[a] + by[a]), ..*place }
    }

    fn offsets() -> impl Strategy<Value = [i32; 3]> {
        prop::array::uniform3(prop_oneof![-4i32..5, -80i32..81])
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(3000))]

        #[test]
        fn touching_bricks_differ_by_one_level_at_most(
            eye in prop::array::uniform3(-(1i128 << 101)..(1i128 << 102)),
            octree in -2i32..58,
            edge in prop_oneof![Just(8u32), Just(16), Just(32)],
            offset in offsets(),
            slope in prop_oneof![1e-4f64..1.0, Just(1.0)],
        ) {
            let cut = cut(edge, eye, slope);
            let place = near(octree, eye, edge, offset);
            if !cut.opens(&place) {
                // All bricks of the next level within it and around it, corners included.
                let first = place.child(0);
                for n in 0..64i128 {
                    let touching = shifted(&first, [n % 4 - 1, n / 4 % 4 - 1, n / 16 - 1]);
                    prop_assert!(!cut.opens(&touching), "{place:?} drawn, {touching:?} opened");
                }
            }
        }

        #[test]
        fn an_opened_bricks_parent_is_opened(
            eye in prop::array::uniform3(-(1i128 << 101)..(1i128 << 102)),
            octree in -2i32..58,
            offset in offsets(),
            slope in 1e-6f64..0.1,
        ) {
            let cut = cut(16, eye, slope);
            let place = near(octree, eye, 16, offset);
            for octant in 0..8 {
                prop_assert!(cut.opens(&place) || !cut.opens(&place.child(octant)));
            }
        }

        #[test]
        fn neighbours_are_drawn_where_their_parents_are_opened(
            eye in prop::array::uniform3(0..(1i128 << 101)),
            octree in 3i32..20,
            offset in offsets(),
        ) {
            let cut = cut(8, eye, 1.0);
            let place = near(octree, eye, 8, offset);
            let drawn = cut.drawn_neighbours(&place).0;
            for n in 0..27i128 {
                let mut parent = shifted(&place, [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1]);
                parent.octree -= 1;
                parent.coordinates = parent.coordinates.map(|c| c.div_euclid(2));
                let own = parent.coordinates == place.coordinates.map(|c| c.div_euclid(2));
                prop_assert_eq!(drawn >> n & 1 == 1, own || cut.opens(&parent));
            }
        }
    }

    #[test]
    fn the_decision_is_a_pixels_size() {
        let domain = Domain::new([0.0; 3], [1.0; 3], [16; 3]).unwrap();
        let shape = BrickShape::new(16).unwrap();
        let root = BrickPlace::root(0);
        let precision = Precision::Full;
        let at = |rule| FootprintCut { domain: domain.clone(), shape, rule, precision };
        assert!(at(Rule::Size(0.0)).opens(&root));
        assert!(at(Rule::Size(0.99 / 16.0)).opens(&root));
        assert!(!at(Rule::Size(1.0 / 16.0)).opens(&root));
        // The eye stands 2 root cells in front of the domain: 0.125.
        let eye = Position([1 << 96, 1 << 96, -(2 << 96)]);
        let slope = |slope| at(Rule::Distance { eye, slope });
        assert!(slope(0.499).opens(&root));
        assert!(!slope(0.5).opens(&root));
        assert!(!slope(1e9).opens(&root));
        assert!(!slope(1e9).opens(&BrickPlace::root(0).child(0)));
    }
}
