//! `linear` against trilinear interpolation by hand and analytic line integrals, and what must not
//! change it: the bricks' size, threads, memory.

// Helpers fail the tests that call them.
#![allow(clippy::unwrap_used)]

mod bricks;
#[path = "support/data.rs"]
mod data;
#[path = "support/random.rs"]
mod random;

use bricks::Tree;
use bricks::sets::Set;
use deepfield::cache::Cache;
use deepfield::render::{Film, Probe, RenderOptions, render};
use deepfield::scene::{Interpolation, Scene};
use deepfield::source::{self, GridBlock};
use deepfield::space::{Decimal, Domain};
use deepfield::synth::Recipe;
use random::Random;

/// The root grid's values, x fastest.
struct RootGrid {
    domain: Domain,
    values: Vec<f64>,
}

impl RootGrid {
    fn read(set: &Set) -> Self {
        let source = source::open(&set.input, None).unwrap();
        let domain = source.hierarchy().domain.clone();
        let mut values = Vec::new();
        let mut read = |grid: source::GridRecord| {
            let block = GridBlock { lo: [0; 3], size: grid.size };
            values.resize(block.len(), 0.0);
            source.read(&grid, source.hierarchy().density.unwrap(), block, &mut values)
        };
        source.for_each_grid(&mut read).unwrap();
        // The cache stores f32.
        values.iter_mut().for_each(|value| *value = f64::from(*value as f32));
        Self { domain, values }
    }

    /// Trilinear between cell centres; beyond the outermost the index is clamped.
    fn trilinear(&self, point: [f64; 3]) -> f64 {
        let cells = self.domain.root_cells();
        let along: [(usize, usize, f64); 3] = std::array::from_fn(|a| {
            let (left, right) = (self.domain.left()[a], self.domain.right()[a]);
            let x = (point[a] - left) / (right - left) * cells[a] as f64 - 0.5;
            let index = |i: f64| i.clamp(0.0, cells[a] as f64 - 1.0) as usize;
            (index(x.floor()), index(x.floor() + 1.0), x - x.floor())
        });
        let mut sum = 0.0;
        for n in 0..8 {
            let upper = |a: usize| n >> a & 1 == 1;
            let weight = |a: usize| if upper(a) { along[a].2 } else { 1.0 - along[a].2 };
            let index = |a: usize| if upper(a) { along[a].1 } else { along[a].0 };
            let at = (index(2) * cells[1] as usize + index(1)) * cells[0] as usize + index(0);
            sum += weight(0) * weight(1) * weight(2) * self.values[at];
        }
        sum
    }

    /// A random point; along each axis one in three in the outer half cell.
    fn point(&self, random: &mut Random) -> [f64; 3] {
        std::array::from_fn(|a| {
            let (left, right) = (self.domain.left()[a], self.domain.right()[a]);
            let half_cell = 0.5 / self.domain.root_cells()[a] as f64;
            let within = match random.below(6) {
                0 => half_cell * random.unit(),
                1 => 1.0 - half_cell * (random.unit() + 1e-9),
                _ => random.unit(),
            };
            left + (right - left) * within
        })
    }
}

#[test]
fn one_level_is_trilinear_between_cell_centres() {
    let set = Set::synthetic("one_level");
    let root = RootGrid::read(&set);
    let largest = root.values.iter().copied().fold(0.0, f64::max);
    for brick in [8, 16, 32] {
        let cache = set.cache(brick);
        let mut probe = Probe::new(&cache, "density", Interpolation::Linear).unwrap();
        let mut random = Random::new(u64::from(brick));
        for _ in 0..20_000 {
            let point = root.point(&mut random);
            let exact = point.map(|x| Decimal::from_f64(x).unwrap());
            let found = probe.at(&exact).unwrap().unwrap();
            let expected = root.trilinear(point);
            assert_eq!(found.level, 0);
            assert!((found.value - expected).abs() <= 1e-12 * largest, "{point:?}: {found:?}");
        }
    }
}

fn picture(cache: &Cache, scene: &str, (memory, threads): (u64, usize)) -> Film {
    let scene = Scene::parse(scene, "scene").unwrap();
    let options = RenderOptions {
        memory,
        threads: Some(threads),
        progress: None,
        fixed: None,
        resident: false,
    };
    render(cache, &scene, &options).unwrap().film
}

const AMPLE: (u64, usize) = (512 << 20, 2);

/// Largest difference of any channel, relative to the first picture's largest value.
fn difference(a: &Film, b: &Film) -> f64 {
    let pairs = a.pixels().iter().flatten().zip(b.pixels().iter().flatten());
    let largest = f64::from(a.largest_value());
    assert!(largest > 0.0 && a.pixels().len() == b.pixels().len());
    pairs.map(|(a, b)| (f64::from(*a) - f64::from(*b)).abs()).fold(0.0, f64::max) / largest
}

/// Emission alone, equal to the field, seen in parallel rays along `direction` through
/// `centre` in a view `height` high.
fn emission_scene(centre: [f64; 3], direction: [f64; 3], height: f64, linear: bool) -> String {
    let position: [f64; 3] = std::array::from_fn(|a| centre[a] - direction[a]);
    format!(
        "[image]\nwidth = {SIDE}\nheight = {SIDE}\n[camera]\nprojection = \"orthographic\"\n\
         position = {position:?}\nlook_at = {centre:?}\nup = [0.1, 1.0, 0.3]\nheight = {height}\n\
         [render]\ninterpolation = \"{}\"\ntolerance = 0\nsamples = 1\n[[volume]]\n\
         field = \"Density\"\nscale = \"linear\"\nrange = [0.0, 1.0]\n\
         color = [[0.0, 1.0, 1.0, 1.0], [1.0, 1.0, 1.0, 1.0]]\n\
         absorption = [[0.0, 0.0], [1.0, 0.0]]\nemission = [[0.0, 0.0], [1.0, 1.0]]\n",
        if linear { "linear" } else { "cell" }
    )
}

/// Pixels along an edge of an emission picture.
const SIDE: usize = 40;

/// Mean and largest difference from the line integral `exact` of the ray's distance from the
/// centre, relative to that through the centre.
fn errors(film: &Film, height: f64, exact: impl Fn(f64) -> f64) -> [f64; 2] {
    let (mut sum, mut largest) = (0.0, 0.0f64);
    for (n, pixel) in film.pixels().iter().enumerate() {
        let offset = |i: usize| ((i as f64 + 0.5) / SIDE as f64 - 0.5) * height;
        let distance = offset(n % SIDE).hypot(offset(n / SIDE));
        let error = (f64::from(pixel[0]) - exact(distance)).abs() / exact(1e-9);
        sum += error;
        largest = largest.max(error);
    }
    [sum / film.pixels().len() as f64, largest]
}

/// Errors of grids of 16³, 32³ and 64³ cells, for `linear` or `cell`.
fn convergence(
    sets: &[Set; 3],
    direction: [f64; 3],
    linear: bool,
    exact: impl Fn(f64) -> f64,
) -> [[f64; 2]; 3] {
    const HEIGHT: f64 = 0.5;
    let scene = emission_scene([0.5; 3], direction, HEIGHT, linear);
    let found = [0, 1, 2].map(|n| {
        let film = picture(&sets[n].cache(16), &scene, AMPLE);
        errors(&film, HEIGHT, &exact)
    });
    let name = if linear { "linear" } else { "cell" };
    println!(
        "{} {name} along {direction:?}: mean {:.2e} {:.2e} {:.2e}, largest {:.2e} {:.2e} {:.2e}, \
         orders {:.2} {:.2}, {:.2} {:.2}",
        sets[0].name,
        found[0][0],
        found[1][0],
        found[2][0],
        found[0][1],
        found[1][1],
        found[2][1],
        order(&found, 0, 0),
        order(&found, 1, 0),
        order(&found, 0, 1),
        order(&found, 1, 1),
    );
    found
}

/// log2 of the ratio of errors `of` (0: mean, 1: largest) of grid `n` and the next.
fn order(errors: &[[f64; 2]; 3], n: usize, of: usize) -> f64 {
    (errors[n][of] / errors[n + 1][of]).log2()
}

const DIRECTIONS: [[f64; 3]; 2] = [[0.0, 0.0, 1.0], [0.53, -0.31, 0.79]];

#[test]
fn a_gaussian_ball_converges_to_its_line_integrals() {
    const SIGMA: f64 = 0.12;
    let sets = ["gaussian_16", "gaussian_32", "gaussian_64"].map(Set::synthetic);
    // The domain ends at 4.2 σ, where less than 3e-5 of the integral is left.
    let exact = |r: f64| SIGMA * std::f64::consts::TAU.sqrt() * (-0.5 * (r / SIGMA).powi(2)).exp();
    for direction in DIRECTIONS {
        let linear = convergence(&sets, direction, true, exact);
        for (n, of) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let order = order(&linear, n, of);
            assert!((1.8..2.2).contains(&order), "{direction:?}: order {order}");
        }
        let cell = convergence(&sets, direction, false, exact);
        for n in [0, 1] {
            let order = order(&cell, n, 0);
            assert!((0.8..2.2).contains(&order), "{direction:?}: order {order}");
        }
    }
}

#[test]
fn a_power_law_converges_to_its_line_integrals() {
    // ρ = VALUE·max(r, INNER)⁻², at most 1.
    const INNER: f64 = 0.1;
    const VALUE: f64 = INNER * INNER;
    let text = format!(
        "name = \"DD0200\"\n[domain]\nleft = [0.0, 0.0, 0.0]\nright = [1.0, 1.0, 1.0]\n\
         root = [16, 16, 16]\n[[density]]\nkind = \"power_law\"\ncentre = [0.5, 0.5, 0.5]\n\
         value = {VALUE}\nslope = 2.0\ninner = {INNER}\n"
    );
    let recipe = Recipe::parse(&text, "power law").unwrap();
    let sets = [16, 32, 64]
        .map(|n| Set::of_recipe("power law", &recipe.clone().with_root([n; 3]).unwrap()));
    // ∫ dz / (r² + z²) = atan(z/r) / r, up to the domain's face; within INNER a constant.
    let exact = |r: f64| {
        let chord = (INNER * INNER - r * r).max(0.0).sqrt();
        VALUE * 2.0 * (chord / (INNER * INNER) + ((0.5 / r).atan() - (chord / r).atan()) / r)
    };
    let linear = convergence(&sets, DIRECTIONS[0], true, exact);
    let cell = convergence(&sets, DIRECTIONS[0], false, exact);
    for n in [0, 1] {
        assert!((1.6..2.4).contains(&order(&linear, n, 0)), "order {}", order(&linear, n, 0));
        assert!((0.7..2.2).contains(&order(&cell, n, 0)), "order {}", order(&cell, n, 0));
    }
}

/// A view of the whole domain and one from inside, at its deepest cells.
fn views(tree: &Tree<'_>, interpolation: &str, tolerance: &str) -> [String; 2] {
    let domain = &tree.cache.header().domain;
    let centre: [f64; 3] = std::array::from_fn(|a| 0.5 * (domain.left()[a] + domain.right()[a]));
    let size: f64 = (0..3).map(|a| domain.right()[a] - domain.left()[a]).fold(0.0, f64::max);
    let outside = std::array::from_fn(|a| centre[a] + size * [0.8, 0.55, -1.2][a]);
    let leaves = tree.nodes.iter().filter(|node| node.record.leaf_cells > 0);
    let deepest = leaves.max_by_key(|node| (node.place.octree, node.record.leaf_cells)).unwrap();
    let width = domain.cell_width(deepest.place.octree);
    let lowest = deepest.place.lowest_cell(tree.cache.header().shape);
    let target: [f64; 3] =
        std::array::from_fn(|a| domain.left()[a] + (lowest[a] as f64 + 3.4) * width[a]);
    let inside = std::array::from_fn(|a| target[a] - width[a] * [13.3, 4.1, -6.7][a]);
    [(outside, centre, 8.0 / size), (inside, target, 0.5 / width.max_element())].map(
        |(eye, target, extinction)| perspective(eye, target, extinction, interpolation, tolerance),
    )
}

fn perspective(
    eye: [f64; 3],
    target: [f64; 3],
    extinction: f64,
    interpolation: &str,
    tolerance: &str,
) -> String {
    let (low, high) = (0.1 * extinction, 2.0 * extinction);
    format!(
        "[image]\nwidth = 56\nheight = 44\n[camera]\nposition = {eye:?}\nlook_at = {target:?}\n\
         fov = 50.0\n[render]\ninterpolation = \"{interpolation}\"\ntolerance = {tolerance}\n\
         samples = 1\n[[volume]]\nfield = \"Density\"\nabsorption = [[0.0, 0.0], [0.2, {low}], \
         [0.45, {extinction}], [0.5, {low}], [1.0, {high}]]\n"
    )
}

fn brick_sizes_agree(set: &Set) {
    let caches = [8, 16, 32].map(|brick| set.cache(brick));
    let tree = Tree::new(&caches[0]);
    for interpolation in ["linear", "cell"] {
        for scene in views(&tree, interpolation, "0") {
            let pictures = caches.each_ref().map(|cache| picture(cache, &scene, AMPLE));
            for other in &pictures[1..] {
                let found = difference(&pictures[0], other);
                println!("{} {interpolation}: {found:.1e}", set.name);
                assert!(found <= 1e-6, "{}: {found}\n{scene}", set.name);
            }
        }
    }
}

#[test]
fn pictures_do_not_depend_on_the_brick_size() {
    for name in ["small", "jumps", "offdomain", "factor4"] {
        brick_sizes_agree(&Set::synthetic(name));
    }
}

#[test]
fn a_real_sets_picture_does_not_depend_on_the_brick_size() {
    if let Some(set) = Set::real("enzo_offdomain/DD0001/DD0001") {
        brick_sizes_agree(&set);
    }
}

#[test]
fn a_tolerance_changes_the_picture_and_threads_and_memory_do_not() {
    for name in ["jumps", "offdomain"] {
        let set = Set::synthetic(name);
        let cache = set.cache(8);
        let tree = Tree::new(&cache);
        for interpolation in ["linear", "cell"] {
            let exact = views(&tree, interpolation, "0");
            let coarse = views(&tree, interpolation, "\"2%\"");
            for (exact, coarse) in exact.iter().zip(&coarse) {
                let truth = picture(&cache, exact, AMPLE);
                let film = picture(&cache, coarse, AMPLE);
                let found = difference(&truth, &film);
                println!("{name} {interpolation}: {found:.1e} by a tolerance of 2%");
                assert!(found < 0.25, "{name}: {found}\n{coarse}");
                for options in [(512 << 20, 1), (96 << 20, 1), (96 << 20, 3)] {
                    assert!(picture(&cache, coarse, options) == film, "{options:?}\n{coarse}");
                }
            }
        }
    }
}
