//! Scenes at random that try a certificate: all kinds of cameras, media, tolerances and samples.

use super::cameras::{View, away, cell_width, domain_size, random_target, typical_value};
use super::dataset::Dataset;
use super::exact::Rational;
use crate::random::Random;

/// A scene and what it is an example of.
#[derive(Debug, Clone)]
pub(crate) struct Trial {
    pub(crate) text: String,
    /// Camera and medium, for whoever reads a failure.
    pub(crate) kind: String,
}

/// What a medium is like, where on the range of values, over which length.
struct Medium {
    name: &'static str,
    /// `absorption`, `emission` as TOML.
    tables: String,
    /// About the largest value of a picture.
    unit: f64,
}

const COLOR_MAPS: [&str; 6] = ["magma", "viridis", "turbo", "inferno", "batlow", "vik"];

/// A scene of the `number`-th kind: kinds of media and cameras come in turn, the rest at random.
pub(crate) fn random_trial(
    dataset: &Dataset,
    random: &mut Random,
    number: usize,
    size: [usize; 2],
) -> Trial {
    let linear = random.pick(3) > 0;
    let (camera, mut view, value) = random_camera(dataset, random, number, size[0], linear);
    let medium = random_medium(random, number / 4 + number, view.height);
    let range = random_range(dataset, random, medium.name == "core", value);
    view.volume = format!("{range}{}\n{}\n", random_colors(random), medium.tables);
    let samples = ["1", "2", "3", "\"area\"", "\"area\"", "\"area\""][random.pick(6)];
    let tolerance = random_tolerance(random, medium.unit, samples);
    let text = view.scene_with(size, &tolerance, samples);
    Trial { text, kind: format!("{camera}, {}", medium.name) }
}

fn random_tolerance(random: &mut Random, unit: f64, samples: &str) -> String {
    let kinds = if samples == "\"area\"" { 5 } else { 6 };
    match random.pick(kinds) {
        0 => "\"10%\"".into(),
        1 => "\"1%\"".into(),
        2 => "\"0.1%\"".into(),
        3 => "\"0.01%\"".into(),
        4 => format!("{:e}", unit * 10_f64.powf(random.between(-3.5, -1.0))),
        _ => "0".into(),
    }
}

/// Outside, inside, deep inside, or a telescope; what it looks at has about the value returned.
fn random_camera(
    dataset: &Dataset,
    random: &mut Random,
    number: usize,
    pixels: usize,
    linear: bool,
) -> (&'static str, View, f64) {
    let (target, width, value) = random_target(dataset, random);
    let (deep, narrowest, densest) = deep_target(dataset, random);
    let (name, target, distance, height) = match number % 4 {
        0 => {
            let distance = domain_size(dataset) * random.between(1.2, 2.5);
            ("outside", target, distance, distance * random.between(0.3, 1.2))
        }
        1 => {
            let distance = width * random.between(1.0, 7.0).exp2();
            ("inside", target, distance, distance * random.between(0.3, 1.2))
        }
        2 => {
            let distance = narrowest * random.between(-1.5, 3.0).exp2();
            ("deep inside", deep, distance, distance * random.between(0.3, 1.5))
        }
        _ => {
            let height = narrowest * random.between(-1.0, 12.0).exp2();
            ("telescope", deep, domain_size(dataset), height)
        }
    };
    let value = match name {
        "outside" | "telescope" => typical_value(dataset, height),
        "deep inside" => densest,
        _ => value,
    };
    let view = View {
        eye: away(&target, random.direction(), distance),
        target,
        up: random.direction(),
        height,
        distance,
        perspective: random.pick(3) > 0,
        pixels,
        linear,
        volume: String::new(),
    };
    (name, view, value)
}

/// A point in a leaf cell of the deepest level, the cell's width and value.
fn deep_target(dataset: &Dataset, random: &mut Random) -> ([Rational; 3], f64, f64) {
    let level = dataset.deepest();
    let leaves = dataset.leaves(level);
    let (index, value) = leaves[random.pick(leaves.len())];
    let offset = [0; 3].map(|_| random.between(0.05, 0.95));
    (dataset.point(level, index, offset), cell_width(dataset, level), value)
}

/// Scale and range: about `value`, or all values (always if `to_densest`).
fn random_range(dataset: &Dataset, random: &mut Random, to_densest: bool, value: f64) -> String {
    let lowest = dataset.smallest_positive;
    let low = if random.pick(2) == 0 { 0.1 * value } else { 0.5 * lowest };
    let high =
        if to_densest { dataset.maximum } else { value * 10_f64.powf(random.between(0.3, 2.0)) };
    let high = high.max(2.0 * low.abs());
    match random.pick(4) {
        0 => format!("scale = \"linear\"\nrange = [{:e}, {high:e}]\n", 0.2 * low),
        1 => {
            let threshold = 10.0 * lowest;
            format!(
                "scale = \"symlog\"\nlinthresh = {threshold:e}\nrange = [{:e}, {high:e}]\n",
                -0.1 * threshold
            )
        }
        _ => format!("scale = \"log10\"\nrange = [{low:e}, {high:e}]\n"),
    }
}

fn random_colors(random: &mut Random) -> String {
    if random.pick(3) == 0 {
        let map = COLOR_MAPS[random.pick(COLOR_MAPS.len())];
        return format!("colormap = \"{map}\"");
    }
    "color = [[0.0, 0.05, 0.1, 0.6], [0.35, 0.9, 0.3, 0.1], [1.0, 1.0, 0.9, 0.7]]".into()
}

/// A medium whose strength suits paths of `length` code lengths.
fn random_medium(random: &mut Random, number: usize, length: f64) -> Medium {
    let strength = 10_f64.powf(random.between(-0.5, 1.7)) / length;
    let medium = |name, unit, tables: String| Medium { name, tables, unit };
    let smooth = |k: f64| format!("[[0.05, 0.0], [0.4, {:e}], [1.0, {k:e}]]", 0.1 * k);
    match number % 9 {
        0 => medium("smooth", 1.0, format!("absorption = {}", smooth(strength))),
        1 => medium("shells", 1.0, format!("absorption = {}", shells(random, strength))),
        2 => medium("steps", 1.0, format!("absorption = {}", steps(random, strength))),
        3 => {
            let opaque = 10_f64.powf(random.between(3.0, 6.0)) / length;
            medium("opaque", 1.0, format!("absorption = {}", steps(random, opaque)))
        }
        4 => {
            let (thin, glow) = (1e-12 / length, 1e-12 / length);
            let tables = format!("absorption = {}\nemission = {}", smooth(thin), smooth(glow));
            medium("thin", 1e-12, tables)
        }
        5 => {
            let glow = 1e-31 / length;
            let tables = format!("absorption = [[0.0, 0.0]]\nemission = {}", smooth(glow));
            medium("faint", 1e-31, tables)
        }
        6 => {
            let tables =
                format!("absorption = [[0.0, 0.0]]\nemission = {}", steps(random, strength));
            medium("emission only", 1.0, tables)
        }
        7 => {
            let bright = 1e8 * strength;
            let emission = format!(
                "[[0.0, 0.0], [0.2, {:e}], [0.85, {:e}], [0.9, {bright:e}]]",
                0.05 * strength,
                0.1 * strength
            );
            medium(
                "core",
                1e2,
                format!(
                    "absorption = [[0.0, 0.0], [1.0, {:e}]]\nemission = {emission}",
                    0.1 * strength
                ),
            )
        }
        _ => {
            let tables = format!(
                "absorption = {}\nemission = {}",
                smooth(strength),
                shells(random, 3.0 * strength)
            );
            medium("shining shells", 1.0, tables)
        }
    }
}

/// Shells, each 2 % of the range wide.
fn shells(random: &mut Random, strength: f64) -> String {
    let shell = |n: u32| {
        let centre = 0.2 * f64::from(n + 1) + random.between(-0.05, 0.05);
        let (low, high) = (centre - 0.01, centre + 0.01);
        format!("[{low:e}, 0.0], [{centre:e}, {strength:e}], [{high:e}, 0.0]")
    };
    format!("[{}]", (0..4).map(shell).collect::<Vec<_>>().join(", "))
}

/// Two slabs of values whose ends are steps.
fn steps(random: &mut Random, strength: f64) -> String {
    let slab = |n: u32| {
        let low = 0.15 + 0.4 * f64::from(n) + random.between(0.0, 0.1);
        let high = low + random.between(0.02, 0.2);
        let weak = 0.3 * strength;
        format!("[{low:e}, 0.0], [{low:e}, {strength:e}], [{high:e}, {weak:e}], [{high:e}, 0.0]")
    };
    format!("[{}]", (0..2).map(slab).collect::<Vec<_>>().join(", "))
}
