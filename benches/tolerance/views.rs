//! Scenes at random: outside, inside and through a telescope, with transfer functions smooth and
//! sharp, thin and opaque.

use deepfield::Result;
use deepfield::space::{Decimal, Domain};
use deepfield::synth::{DensityModel, Recipe};

use super::random::Random;

/// Decimal places of written positions, and what one is in units of the last.
const PLACES: usize = 30;
const ONE: f64 = 1e30;

/// A data set and the point that its levels are nested about.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Set {
    /// The recipe's name.
    pub(crate) name: &'static str,
    /// The recipe.
    pub(crate) recipe: &'static str,
    /// The deepest point, decimals.
    target: [&'static str; 3],
    /// A root cell's edge, code length, and factor-2 steps to the deepest level.
    root_cell: f64,
    steps: i32,
}

macro_rules! set {
    ($name:literal, $target:expr, $root_cell:expr, $steps:expr) => {
        Set {
            name: $name,
            recipe: include_str!(concat!("../../datasets_synthetic/", $name, ".toml")),
            target: $target,
            root_cell: $root_cell,
            steps: $steps,
        }
    };
}

const CORE: [&str; 3] = [
    "0.1137000000000000000001270013",
    "0.0931000000000000000003910017",
    "0.1219000000000000000001770019",
];

/// The published recipes that scenes are drawn from.
pub(crate) const SETS: [Set; 7] = [
    set!("small", ["0.4127", "0.5961", "0.3313"], 0.05, 4),
    set!("jumps", ["0.2931", "0.3319", "0.7717"], 0.055, 6),
    set!("factor4", ["0.4377", "0.4913", "0.6131"], 0.07, 8),
    set!("offdomain", ["-0.0123", "0.5271", "-0.6317"], 0.05, 5),
    set!("demo", ["0.5317", "0.4419", "0.5231"], 0.021, 13),
    set!("depth25", CORE, 0.042, 25),
    set!("depth48", CORE, 0.042, 48),
];

/// A scene of `set`, `size` pixels wide and high.
pub(crate) fn scene(set: &Set, size: u32, random: &mut Random) -> Result<String> {
    let recipe = Recipe::parse(set.recipe, set.name)?;
    let (domain, model) = (recipe.space()?, DensityModel::new(&recipe)?);
    let target = [0, 1, 2].map(|a| fixed_point(set.target[a]));
    // How many cells of which level the view is high.
    let cell = set.root_cell * random.between(-f64::from(set.steps).min(38.0), 0.0).exp2();
    let height = cell * random.between(3.0, 6.0).exp2();
    let height = if random.one_in(3) { 20.0 * set.root_cell } else { height };
    let distance = if random.one_in(4) { 2.0 } else { height * random.between(0.8, 2.5) };
    let eye = away(target, random.direction(), distance);
    let typical = away(target, random.direction(), random.between(0.05, 0.4) * height);
    let fov = 2.0 * (0.5 * height / distance).atan().to_degrees();
    let samples = if random.one_in(3) { "1" } else { "\"area\"" };
    Ok(format!(
        "[image]\nwidth = {size}\nheight = {size}\n[camera]\nposition = {:?}\nlook_at = {:?}\n\
         up = {:?}\nfov = {fov:e}\n[render]\nsamples = {samples}\n[[volume]]\n\
         field = \"Density\"\n{}",
        eye.map(decimal),
        target.map(decimal),
        random.direction(),
        volume(random, density(&domain, &model, typical)?, height),
    ))
}

fn density(domain: &Domain, model: &DensityModel, point: [i128; 3]) -> Result<f64> {
    let [x, y, z] = point.map(|number| Decimal::parse(&decimal(number)));
    Ok(model.at(&domain.position(&[x?, y?, z?])?))
}

/// For values about `value`, over views `length` high: what is far less can be seen through.
fn volume(random: &mut Random, value: f64, length: f64) -> String {
    let (scale, [low, high]) = if random.one_in(3) {
        ("linear", [0.2 * value, 4.0 * value])
    } else {
        ("log10", [0.1 * value, 20.0 * value])
    };
    let extinction = 10_f64.powf(random.between(-0.5, 1.7)) / length;
    let colors = if random.one_in(2) {
        "colormap = \"magma\""
    } else {
        "color = [[0.0, 0.05, 0.1, 0.6], [0.35, 0.9, 0.3, 0.1], [1.0, 1.0, 0.9, 0.7]]"
    };
    let table = if random.one_in(3) {
        shells(random, extinction)
    } else {
        format!("[[0.05, 0.0], [0.4, {:e}], [1.0, {extinction:e}]]", 0.1 * extinction)
    };
    format!("scale = \"{scale}\"\nrange = [{low:e}, {high:e}]\n{colors}\nabsorption = {table}\n")
}

/// Shells, each 4 % of the range wide.
fn shells(random: &mut Random, extinction: f64) -> String {
    let shell = |n: u32| {
        let centre = 0.2 * f64::from(n) + random.between(-0.05, 0.05);
        let (low, high) = (centre - 0.02, centre + 0.02);
        format!("[{low:e}, 0.0], [{centre:e}, {extinction:e}], [{high:e}, 0.0]")
    };
    let shells: Vec<String> = (1..=4).map(shell).collect();
    format!("[{}]", shells.join(", "))
}

/// A written decimal in units of its 30th place; what is no digit counts as nothing.
fn fixed_point(text: &str) -> i128 {
    let (whole, part) = text.split_once('.').unwrap_or((text, ""));
    let digits = whole.bytes().chain(format!("{part:0<PLACES$}").into_bytes());
    let digits = digits.filter(u8::is_ascii_digit).map(|digit| i128::from(digit - b'0'));
    let size = digits.fold(0, |sum: i128, digit| 10 * sum + digit);
    if text.starts_with('-') { -size } else { size }
}

fn decimal(number: i128) -> String {
    let digits = format!("{:0>width$}", number.unsigned_abs(), width = PLACES + 1);
    let (whole, part) = digits.split_at(digits.len() - PLACES);
    format!("{}{whole}.{part}", if number < 0 { "-" } else { "" })
}

fn away(from: [i128; 3], direction: [f64; 3], distance: f64) -> [i128; 3] {
    std::array::from_fn(|a| from[a] + (ONE * distance * direction[a]) as i128)
}
