//! Scenes for comparing two renderers: at random, and at places where rounding decides.

use super::dataset::Dataset;
use super::double_double::DoubleDouble;
use super::exact::{self, Rational};
use crate::random::Random;

/// Decimal places of written positions: far below the deepest cell.
const DIGITS: usize = 70;

/// A scene before it is written down.
#[derive(Debug, Clone)]
pub(crate) struct View {
    pub(crate) eye: [Rational; 3],
    pub(crate) target: [Rational; 3],
    pub(crate) up: [f64; 3],
    /// Height of the view at the target, code length.
    pub(crate) height: f64,
    pub(crate) distance: f64,
    pub(crate) perspective: bool,
    pub(crate) pixels: usize,
    pub(crate) linear: bool,
    /// Keys of the volume but its field.
    pub(crate) volume: String,
}

impl View {
    /// The same view from 10⁻⁶⁰ code lengths lower along each axis: rays in a face come to lie
    /// as little below it as positions can tell.
    pub(crate) fn lowered(&self) -> Self {
        let lower = |point: &[Rational; 3]| away(point, [-1.0; 3], 1e-60);
        Self { eye: lower(&self.eye), target: lower(&self.target), ..self.clone() }
    }

    /// The scene file, of one ray a pixel, exact.
    pub(crate) fn scene(&self) -> String {
        self.scene_with([self.pixels; 2], "0", "1")
    }

    /// The scene file; tolerance and samples as TOML.
    pub(crate) fn scene_with(
        &self,
        [width, height]: [usize; 2],
        tolerance: &str,
        samples: &str,
    ) -> String {
        let text = |point: &[Rational; 3]| point.each_ref().map(|x| exact::to_decimal(x, DIGITS));
        let lens = if self.perspective {
            let fov = 2.0 * (0.5 * self.height / self.distance).atan().to_degrees();
            format!("projection = \"perspective\"\nfov = {fov:e}")
        } else {
            format!("projection = \"orthographic\"\nheight = {:e}", self.height)
        };
        format!(
            "[image]\nwidth = {width}\nheight = {height}\n[camera]\nposition = {0:?}\n\
             look_at = {1:?}\nup = {2:?}\n{lens}\n[render]\ninterpolation = \"{3}\"\n\
             tolerance = {tolerance}\nsamples = {samples}\n[[volume]]\n\
             field = \"Density\"\n{4}",
            text(&self.eye),
            text(&self.target),
            self.up,
            if self.linear { "linear" } else { "cell" },
            self.volume,
        )
    }
}

/// `target + direction · distance`, exactly.
pub(crate) fn away(target: &[Rational; 3], direction: [f64; 3], distance: f64) -> [Rational; 3] {
    let distance = exact::from_double(distance);
    std::array::from_fn(|a| &target[a] + exact::from_double(direction[a]) * &distance)
}

/// Longest edge of the domain, code length.
pub(crate) fn domain_size(dataset: &Dataset) -> f64 {
    let width = dataset.root_cell_width();
    let edges = (0..3).map(|a| width[a].to_f64() * dataset.root_cells()[a] as f64);
    edges.fold(0.0, f64::max)
}

/// A point inside a leaf cell of a random level, the cell's largest width and its value.
pub(crate) fn random_target(dataset: &Dataset, random: &mut Random) -> ([Rational; 3], f64, f64) {
    loop {
        let level = random.pick(dataset.deepest() + 1);
        let leaves = dataset.leaves(level);
        if leaves.is_empty() {
            continue;
        }
        let (index, value) = leaves[random.pick(leaves.len())];
        let offset = [0; 3].map(|_| random.between(0.05, 0.95));
        return (dataset.point(level, index, offset), cell_width(dataset, level), value);
    }
}

pub(crate) fn cell_width(dataset: &Dataset, level: usize) -> f64 {
    let widest =
        dataset.root_cell_width().map(DoubleDouble::to_f64).into_iter().fold(0.0, f64::max);
    widest * (-(level as f64)).exp2()
}

/// A camera inside or outside, perspective or orthographic, with a random transfer function.
pub(crate) fn random_view(
    dataset: &Dataset,
    random: &mut Random,
    pixels: usize,
    linear: bool,
) -> View {
    let (target, width, value) = random_target(dataset, random);
    let outside = random.pick(3) == 0;
    let distance = if outside {
        domain_size(dataset) * random.between(1.2, 2.5)
    } else {
        width * random.between(2.0, 6.0).exp2()
    };
    let height = distance * random.between(0.3, 1.2);
    View {
        eye: away(&target, random.direction(), distance),
        target,
        up: random.direction(),
        height,
        distance,
        perspective: random.pick(2) == 0,
        pixels,
        linear,
        volume: random_volume(
            random,
            if outside { typical_value(dataset, height) } else { value },
            height,
        ),
    }
}

/// The median value of the leaf cells of the level of which some 20 span `height`, or of the
/// nearest level that has leaf cells.
pub(crate) fn typical_value(dataset: &Dataset, height: f64) -> f64 {
    let mut levels: Vec<usize> = (0..=dataset.deepest()).collect();
    let apart = |level: &usize| (20.0 * cell_width(dataset, *level) / height).log2().abs();
    levels.sort_by(|a, b| apart(a).total_cmp(&apart(b)));
    let leaves = levels.into_iter().map(|level| dataset.leaves(level)).find(|l| !l.is_empty());
    let mut values: Vec<f64> = leaves.iter().flatten().map(|(_, value)| *value).collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(1.0)
}

/// Smooth or sharp, thin or opaque over `length`, with or without an emission of its own; made
/// for values about `value`: what is far less can be seen through.
fn random_volume(random: &mut Random, value: f64, length: f64) -> String {
    let extinction = 10_f64.powf(random.between(-0.5, 1.7)) / length;
    let table = if random.pick(2) == 0 {
        format!("[[0.05, 0.0], [0.4, {:e}], [1.0, {extinction:e}]]", 0.1 * extinction)
    } else {
        sharp_table(random, extinction)
    };
    let mut volume = range(random.pick(3) != 0, value);
    volume += &format!("absorption = {table}\n");
    if random.pick(2) == 0 {
        let (dim, bright) = (0.2 / length, 3.0 / length);
        volume += &format!("emission = [[0.05, 0.0], [0.5, {dim:e}], [1.0, {bright:e}]]\n");
    }
    volume
}

/// Shells, each 2 % of the range wide.
fn sharp_table(random: &mut Random, extinction: f64) -> String {
    let shell = |centre: f64| {
        let (low, high) = (centre - 0.01, centre + 0.01);
        format!("[{low:e}, 0.0], [{centre:e}, {extinction:e}], [{high:e}, 0.0]")
    };
    let shells: Vec<String> =
        (0..4).map(|n| shell(0.2 * f64::from(n + 1) + random.between(-0.05, 0.05))).collect();
    format!("[{}]", shells.join(", "))
}

/// Scale, range and colours for values about `value`.
fn range(log: bool, value: f64) -> String {
    let (scale, low, high) = if log && value > 0.0 {
        ("log10", 0.1 * value, 20.0 * value)
    } else {
        ("linear", value - 0.8 * value.abs(), value + 3.0 * value.abs() + f64::MIN_POSITIVE)
    };
    format!(
        "scale = \"{scale}\"\nrange = [{low:e}, {high:e}]\n\
         color = [[0.0, 0.05, 0.1, 0.6], [0.35, 0.9, 0.3, 0.1], [1.0, 1.0, 0.9, 0.7]]\n"
    )
}

/// Cameras whose rays run exactly along axes, in faces, along cell edges, and eyes on the
/// domain's edges. Pictures are odd in size, so that the middle ray is the axis itself.
pub(crate) fn special_views(
    dataset: &Dataset,
    random: &mut Random,
    pixels: usize,
    linear: bool,
) -> Vec<View> {
    let level = dataset.deepest();
    let (_, densest) = dataset.densest();
    let size = domain_size(dataset);
    let typical = |height| typical_value(dataset, height);
    let corner = dataset.point(level, densest, [0.0; 3]);
    let width = cell_width(dataset, level);
    let domain_corner = dataset.point(0, [0; 3], [0.0; 3]);
    let upper_corner = dataset.point(0, dataset.root_cells(), [0.0; 3]);
    let centre: [Rational; 3] =
        std::array::from_fn(|a| (&domain_corner[a] + &upper_corner[a]) / exact::from_double(2.0));
    let base = View {
        eye: corner.clone(),
        target: corner.clone(),
        up: [0.0, 0.0, 1.0],
        height: 12.0 * width,
        distance: 16.0 * width,
        perspective: true,
        pixels: pixels | 1,
        linear,
        volume: random_volume(random, typical(12.0 * width), 12.0 * width),
    };
    let mut views = Vec::new();
    for (direction, perspective) in
        [([1.0, 0.0, 0.0], true), ([0.0, -1.0, 0.0], false), ([-1.0, 0.0, 0.0], false)]
    {
        let eye = away(&corner, direction, base.distance);
        views.push(View { eye, perspective, ..base.clone() });
    }
    // The eye on a cell's corner, looking along a diagonal.
    let target = away(&corner, [1.0, 1.0, -1.0], width);
    views.push(View { target, distance: 1.7 * width, height: width, ..base.clone() });
    for edge in [domain_corner, upper_corner] {
        let volume = random_volume(random, typical(size), size);
        let (eye, target, distance, height) = (edge, centre.clone(), size, 0.7 * size);
        views.push(View { eye, target, distance, height, volume, ..base.clone() });
    }
    views
}

/// An eye at distance 1 that looks at a view `height` high on the densest cell.
pub(crate) fn telescope(dataset: &Dataset, height: f64, perspective: bool) -> View {
    let (level, densest) = dataset.densest();
    let target = dataset.point(level, densest, [0.3, 0.6, 0.45]);
    View {
        eye: away(&target, [0.48, 0.36, -0.8], 1.0),
        target,
        up: [0.1, 1.0, 0.0],
        height,
        distance: 1.0,
        perspective,
        pixels: 20,
        linear: false,
        volume: format!(
            "{}absorption = [[0.0, 0.0], [0.05, 0.0], [1.0, {:e}]]\n",
            range(true, typical_value(dataset, height)),
            2.0 / height
        ),
    }
}
