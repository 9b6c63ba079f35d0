//! The density model: analytic, at any position, from offsets that are exact at any depth.

use glam::DVec3;

use super::noise::{NoiseMemory, cell_noise, fractal_noise, smooth_noise};
use super::recipe::{Component, Coordinate, Recipe};
use crate::Result;
use crate::space::{Domain, FRACTION_BITS, IndexBox, Position};

mod formulas;

use formulas::additive;

/// A recipe's density, with the positions of its components made exact.
#[derive(Debug, Clone)]
pub struct DensityModel {
    domain: Domain,
    /// Offsets are taken from here; the first is the domain's left edge.
    origins: Vec<Position>,
    terms: Vec<Term>,
    seed: u64,
    grain: f64,
}

/// One component and the origin that its offsets start from.
#[derive(Debug, Clone)]
struct Term {
    origin: usize,
    component: Component,
    /// The vector along a filament, code length.
    along: DVec3,
}

impl DensityModel {
    /// The density of `recipe`.
    ///
    /// # Errors
    /// Positions that are no decimals or lie too far from the domain.
    pub fn new(recipe: &Recipe) -> Result<Self> {
        let mut model = Self {
            domain: recipe.space()?,
            origins: vec![Position([0; 3])],
            terms: Vec::new(),
            seed: recipe.refinement.seed,
            grain: 0.0,
        };
        for component in &recipe.density {
            if let Component::Grain { amplitude } = component {
                model.grain += amplitude;
                continue;
            }
            let (origin, along) = model.placed(component)?;
            model.terms.push(Term { origin, component: component.clone(), along });
        }
        Ok(model)
    }

    /// Where the offsets of `component` start, and the vector along it.
    fn placed(&mut self, component: &Component) -> Result<(usize, DVec3)> {
        let (start, end) = match component {
            Component::Core { centre, .. }
            | Component::PowerLaw { centre, .. }
            | Component::Gaussian { centre, .. } => (centre, centre),
            Component::Filament { from, to, .. } => (from, to),
            _ => return Ok((0, DVec3::ZERO)),
        };
        let (start, end) = (position(&self.domain, start)?, position(&self.domain, end)?);
        self.origins.push(start);
        Ok((self.origins.len() - 1, self.domain.difference(&end, &start)))
    }

    /// The density at a point, without grain.
    pub fn at(&self, position: &Position) -> f64 {
        let offset = |origin: usize| self.domain.difference(position, &self.origins[origin]);
        self.combine(&offset, &mut NoiseMemory::default())
    }

    /// The density in the centre of cell `index` of octree level `octree`, grain included.
    pub fn in_cell(&self, octree: u32, index: [i128; 3]) -> f64 {
        self.at(&cell_centre(octree, index)) * self.grain(octree, index)
    }

    fn grain(&self, octree: u32, index: [i128; 3]) -> f64 {
        if self.grain == 0.0 { 1.0 } else { 1.0 + self.grain * cell_noise(octree, index) }
    }

    /// Sum of the additive components times the exponential of the turbulence; `offset` gives
    /// the offset from one of the model's origins.
    fn combine(&self, offset: &impl Fn(usize) -> DVec3, memory: &mut NoiseMemory) -> f64 {
        memory.restart();
        let (mut sum, mut exponent) = (0.0, 0.0);
        for term in &self.terms {
            let offset = offset(term.origin);
            match &term.component {
                Component::Turbulence { scale, octaves, amplitude, persistence } => {
                    exponent += amplitude
                        * fractal_noise(offset / *scale, *octaves, *persistence, self.seed, memory);
                }
                component => sum += additive(component, offset, term.along, self.seed, memory),
            }
        }
        if exponent == 0.0 { sum } else { sum * exponent.exp() }
    }

    /// Prepares the evaluation in all cells of a box.
    pub(super) fn sampler(&self, octree: u32, cells: IndexBox) -> Sampler<'_> {
        let offsets = self.origins.iter().map(|origin| self.axis_offsets(octree, &cells, origin));
        Sampler {
            model: self,
            octree,
            lo: cells.lo,
            offsets: offsets.collect(),
            memory: NoiseMemory::default(),
            velocity_memory: std::array::from_fn(|_| NoiseMemory::default()),
        }
    }

    /// Offsets of the centres of a box's cells from `origin`, along each axis.
    fn axis_offsets(&self, octree: u32, cells: &IndexBox, origin: &Position) -> [Vec<f64>; 3] {
        std::array::from_fn(|axis| {
            let offset =
                |i: i128| self.domain.difference(&cell_centre(octree, [i; 3]), origin)[axis];
            (cells.lo[axis]..cells.hi[axis]).map(offset).collect()
        })
    }
}

/// The model in the cells of one box.
pub(super) struct Sampler<'a> {
    model: &'a DensityModel,
    octree: u32,
    lo: [i128; 3],
    offsets: Vec<[Vec<f64>; 3]>,
    memory: NoiseMemory,
    velocity_memory: [NoiseMemory; 3],
}

impl Sampler<'_> {
    /// The density in cell `at` of the box, counted from its first.
    pub(super) fn density(&mut self, at: [usize; 3]) -> f64 {
        let index = std::array::from_fn(|a| self.lo[a] + at[a] as i128);
        let offset = |origin: usize| axis_offset(&self.offsets[origin], at);
        self.model.combine(&offset, &mut self.memory) * self.model.grain(self.octree, index)
    }

    /// One component of a made-up velocity in cell `at`: smooth noise.
    pub(super) fn velocity(&mut self, axis: usize, at: [usize; 3]) -> f64 {
        let domain = &self.model.domain;
        let width = domain.right()[0] - domain.left()[0];
        let point = axis_offset(&self.offsets[0], at) * (4.0 / width);
        let memory = &mut self.velocity_memory[axis];
        memory.restart();
        smooth_noise(point, self.model.seed.wrapping_add(axis as u64 + 1), memory)
    }
}

fn axis_offset([x, y, z]: &[Vec<f64>; 3], at: [usize; 3]) -> DVec3 {
    DVec3::new(x[at[0]], y[at[1]], z[at[2]])
}

/// The exact position of decimal coordinates.
pub(super) fn position(domain: &Domain, point: &[Coordinate; 3]) -> Result<Position> {
    let [x, y, z] = point;
    domain.position(&[x.decimal()?, y.decimal()?, z.decimal()?])
}

/// The exact centre of a cell.
pub(super) fn cell_centre(octree: u32, index: [i128; 3]) -> Position {
    let half_cell = FRACTION_BITS - 1 - octree;
    Position(index.map(|i| (2 * i + 1) << half_cell))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model(density: &str, root: &str) -> DensityModel {
        let text = format!(
            "[domain]\nleft = [0, 0, 0]\nright = [1, 1, 1]\nroot = {root}\n\
             [refinement]\nmax_level = 55\n{density}"
        );
        DensityModel::new(&Recipe::parse(&text, "test").unwrap()).unwrap()
    }

    #[test]
    fn neighbours_at_level_55_differ_as_the_formula_says() {
        let model = model(
            "[[density]]\nkind = \"core\"\ncentre = [\"0.3125\", 0.25, 0.5]\npeak = 8.0\n\
             radius = 1e-17\nslope = 2.0\n",
            "[16, 16, 16]",
        );
        // The centre is the corner of cell `lo`; cells are 2⁻⁵⁹ wide.
        let lo: [i128; 3] = [5 << 55, 4 << 55, 8 << 55];
        let width = (-59f64).exp2() / 1e-17;
        for steps in 0..3_i128 {
            let x = (steps as f64 + 0.5) * width;
            let expected = 8.0 / (1.0 + x * x + 0.5 * width * width);
            let value = model.in_cell(55, [lo[0] + steps, lo[1], lo[2]]);
            assert!((value / expected - 1.0).abs() < 1e-14, "{steps}: {value} {expected}");
        }
    }

    #[test]
    fn a_box_is_evaluated_as_single_cells_are() {
        let model = model(
            "[[density]]\nkind = \"gradient\"\nvalue = 1.0\nslope = [1.0, 2.0, 3.0]\n\
             [[density]]\nkind = \"filament\"\nfrom = [0.1, 0.1, 0.1]\nto = [0.9, 0.8, 0.7]\n\
             peak = 5.0\nradius = 0.05\nslope = 3.0\n\
             [[density]]\nkind = \"turbulence\"\nscale = 0.2\noctaves = 3\namplitude = 0.5\n\
             persistence = 0.6\n[[density]]\nkind = \"grain\"\namplitude = 0.1\n",
            "[12, 10, 14]",
        );
        let cells = IndexBox::at([6, 4, 10], [5, 4, 3]);
        let mut sampler = model.sampler(1, cells);
        for at in [[0, 0, 0], [4, 3, 2], [1, 2, 1]] {
            let index = std::array::from_fn(|a| cells.lo[a] + at[a] as i128);
            assert_eq!(sampler.density(at), model.in_cell(1, index));
        }
    }

    #[test]
    fn a_filament_is_highest_on_its_segment() {
        let model = model(
            "[[density]]\nkind = \"filament\"\nfrom = [0.2, 0.5, 0.5]\nto = [0.8, 0.5, 0.5]\n\
             peak = 3.0\nradius = 0.1\nslope = 2.0\n",
            "[16, 16, 16]",
        );
        let at = |text: [&str; 3]| {
            let point = text.map(|t| Coordinate::Text(t.to_owned()));
            model.at(&position(&model.domain, &point).unwrap())
        };
        assert!((at(["0.5", "0.5", "0.5"]) - 3.0).abs() < 1e-12);
        assert!((at(["0.5", "0.6", "0.5"]) - 1.5).abs() < 1e-12);
        assert!((at(["0.9", "0.5", "0.5"]) - 1.5).abs() < 1e-12);
    }
}
