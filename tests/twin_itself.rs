//! The twin against numbers worked out by hand.

#[path = "support/data.rs"]
mod data;
#[path = "support/random.rs"]
mod random;
mod twin;

use std::error::Error;

use twin::dataset::{Dataset, Precision};
use twin::double_double::DoubleDouble;
use twin::interpolant::Interpolant;
use twin::memory::MemorySource;
use twin::picture::Picture;
use twin::scene::Scene;
use twin::{exact, march_linear, walk};

type Outcome<T> = Result<T, Box<dyn Error>>;

/// Absorption and emission equal to the value, white, range 0 … 1.
const IDENTITY: &str = r#"
field = "density"
scale = "linear"
range = [0.0, 1.0]
color = [[0.0, 1.0, 1.0, 1.0]]
absorption = [[0.0, 0.0], [1.0, 1.0]]
"#;

/// One ray along +z through (x, y), from outside.
fn along_z(x: &str, y: &str, interpolation: &str, volume: &str) -> String {
    scene(
        &[x, y, "-1.0"],
        &[x, y, "0.5"],
        "orthographic\"\nheight = 1e-6 #",
        interpolation,
        1,
        volume,
    )
}

fn scene(
    eye: &[&str; 3],
    target: &[&str; 3],
    projection: &str,
    interpolation: &str,
    size: usize,
    volume: &str,
) -> String {
    format!(
        "[image]\nwidth = {size}\nheight = {size}\n[camera]\nposition = {eye:?}\n\
         look_at = {target:?}\nup = [0.0, 1.0, 0.0]\nprojection = \"{projection}\"\n\
         [render]\ninterpolation = \"{interpolation}\"\ntolerance = 0.0\nsamples = 1\n\
         [[volume]]\n{volume}"
    )
}

fn picture(source: &MemorySource, scene: &str) -> Outcome<Vec<[f64; 4]>> {
    let dataset = Dataset::load(source, "Density", Precision::Source)?;
    Ok(Picture::render(&Scene::parse(scene)?, &dataset)?.pixels)
}

fn close(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-12 * b.abs().max(1.0)
}

/// Any value in 0.1 … 1.1 for a cell, without pattern.
fn noise(level: u32, [i, j, k]: [i128; 3]) -> f64 {
    let mixed = (i * 73_856_093) ^ (j * 19_349_663) ^ (k * 83_492_791) ^ i128::from(level * 7919);
    0.1 + (mixed.rem_euclid(10_007)) as f64 / 10_007.0
}

/// Root 6×4×5 of unequal cells; three levels flush at one corner (jumps of one to three levels
/// at faces, edges and corners), an L-shaped union, and a refinement by 4.
fn flush_levels() -> Outcome<MemorySource> {
    let source = MemorySource::new([-0.3, 0.1, 0.0], [0.9, 0.9, 1.5], [6, 4, 5], &[2, 2, 4])?;
    Ok(source
        .grid(0, [0, 0, 0], [6, 4, 5], |i| noise(0, i))
        .grid(1, [4, 2, 4], [4, 4, 4], |i| noise(1, i))
        .grid(1, [8, 2, 4], [2, 2, 6], |i| noise(1, i))
        .grid(2, [8, 4, 8], [6, 4, 4], |i| noise(2, i))
        .grid(3, [32, 16, 32], [8, 8, 4], |i| noise(3, i)))
}

#[test]
fn double_doubles_keep_a_hundred_bits() {
    let tiny = DoubleDouble::from((-90_f64).exp2());
    assert_eq!((DoubleDouble::ONE + tiny - DoubleDouble::ONE).to_f64(), tiny.to_f64());
    let third = DoubleDouble::ONE / DoubleDouble::from(3.0);
    let back = third * DoubleDouble::from(3.0) - DoubleDouble::ONE;
    assert!(back.to_f64().abs() < 1e-31, "{back:?}");
    let root = DoubleDouble::from(2.0).sqrt();
    assert!((root * root - DoubleDouble::from(2.0)).to_f64().abs() < 1e-31);
    assert_eq!((-tiny).floor(), -1);
    assert_eq!((DoubleDouble::from_index(i64::MAX) - tiny).floor(), i64::MAX - 1);
}

#[test]
fn decimals_become_the_nearest_double_double_and_back() -> Outcome<()> {
    let text = "-0.6137960008835410791458469806331219";
    let exact = exact::from_decimal(text)?;
    assert_eq!(exact::to_decimal(&exact, 34), text);
    assert_eq!(exact, exact::from_decimal("-6137960008835410791458469806331219e-34")?);
    let near = exact::to_double_double(&exact);
    assert_eq!(near.to_f64(), text.parse::<f64>()?);
    let rest = exact - exact::from_double(near.to_f64());
    let low = near - DoubleDouble::from(near.to_f64());
    assert!((exact::to_double_double(&rest) - low).to_f64().abs() < 1e-32);
    Ok(())
}

#[test]
fn one_cell_absorbs_and_shines_by_the_closed_form() -> Outcome<()> {
    let source = MemorySource::new([0.0; 3], [1.0, 1.0, 2.0], [1; 3], &[])?;
    let source = source.grid(0, [0; 3], [1; 3], |_| 0.75);
    let pixel = picture(&source, &along_z("0.5", "0.5", "cell", IDENTITY))?[0];
    let seen = 1.0 - (-1.5_f64).exp();
    assert!(pixel.iter().all(|value| close(*value, seen)), "{pixel:?}");
    Ok(())
}

#[test]
fn the_nearer_cell_hides_the_farther_and_lengths_are_code_lengths() -> Outcome<()> {
    let source = MemorySource::new([0.0; 3], [0.1, 0.2, 3.0], [1, 1, 2], &[])?;
    let source = source.grid(0, [0; 3], [1, 1, 2], |i| [0.25, 1.0][i[2] as usize]);
    let volume = format!("{IDENTITY}emission = [[0.0, 2.0], [1.0, 4.0]]\n");
    let pixel = picture(&source, &along_z("0.05", "0.1", "cell", &volume))?[0];
    let (near, far) = ((-0.375_f64).exp(), (-1.5_f64).exp());
    // Source function j/κ: 2.5 / 0.25 and 4.
    assert!(close(pixel[0], 10.0 * (1.0 - near) + near * 4.0 * (1.0 - far)), "{pixel:?}");
    assert!(close(pixel[3], 1.0 - near * far));
    Ok(())
}

#[test]
fn refined_cells_are_seen_instead_of_what_they_cover() -> Outcome<()> {
    for (factor, levels) in [(2, 1.0), (4, 2.0)] {
        let source = MemorySource::new([0.0; 3], [1.0; 3], [2; 3], &[factor])?;
        let lo = [i128::from(factor); 3];
        let source = source.grid(0, [0; 3], [2; 3], |i| if i == [1; 3] { 1e30 } else { 0.5 }).grid(
            1,
            lo,
            [factor; 3],
            |i| if i == [i128::from(factor); 3] { 1.0 } else { 0.25 },
        );
        let pixel = picture(&source, &along_z("0.51", "0.51", "cell", IDENTITY))?[0];
        let fine = 0.5 / f64::from(factor);
        let depth = 0.25 + fine + 0.25 * (0.5 - fine);
        assert!(close(pixel[3], 1.0 - (-depth).exp()), "factor {factor}: {pixel:?}");
        let dataset = Dataset::load(&source, "density", Precision::Source)?;
        assert_eq!(dataset.deepest() as f64, levels);
        let cells = f64::from(factor.pow(3));
        let mean = dataset.cell(0, [1; 3]).map(|cell| cell.value).unwrap_or_default();
        assert!(close(mean, (1.0 + 0.25 * (cells - 1.0)) / cells), "factor {factor}: {mean}");
    }
    Ok(())
}

#[test]
fn faces_belong_to_the_cell_above_and_the_upper_edge_is_outside() -> Outcome<()> {
    let source = MemorySource::new([0.0; 3], [1.0; 3], [2; 3], &[])?;
    let source = source.grid(0, [0; 3], [2; 3], |i| if i[0] == 1 { 1.0 } else { 0.25 });
    for (x, expected) in [("0", 0.25), ("0.5", 1.0), ("0.49999999999999999999", 0.25), ("1", 0.0)] {
        let pixel = picture(&source, &along_z(x, "0.5", "cell", IDENTITY))?[0];
        assert!(close(pixel[3], 1.0 - f64::exp(-expected)), "{x}: {pixel:?}");
    }
    Ok(())
}

#[test]
fn logarithms_have_a_floor_and_clamp() -> Outcome<()> {
    let source = MemorySource::new([0.0; 3], [1.0; 3], [1, 1, 4], &[])?;
    let source = source.grid(0, [0; 3], [1, 1, 4], |i| [-5.0, 0.01, 1.0, 1e9][i[2] as usize]);
    let volume = IDENTITY.replace("linear", "log10").replace("[0.0, 1.0]", "[1e-4, 1e4]");
    let pixel = picture(&source, &along_z("0.5", "0.5", "cell", &volume))?[0];
    let depth: f64 = 0.25 * (0.25 + 0.25 + 0.5 + 1.0);
    assert!(close(pixel[3], 1.0 - (-depth).exp()), "{pixel:?}");
    Ok(())
}

#[test]
fn a_linear_function_is_interpolated_exactly_within_one_level() -> Outcome<()> {
    let source = MemorySource::new([0.0; 3], [1.0, 2.0, 4.0], [8, 4, 16], &[])?;
    let value = |[i, j, k]: [f64; 3]| 0.1 + 0.02 * i + 0.05 * j + 0.01 * k;
    let source = source.grid(0, [0; 3], [8, 4, 16], |i| value(i.map(|i| i as f64 + 0.5)));
    let dataset = Dataset::load(&source, "density", Precision::Source)?;
    let transfer = Scene::parse(&along_z("0", "0", "linear", IDENTITY))?.transfer(&dataset)?;
    let interpolant = Interpolant::new(&dataset, &transfer);
    for point in [[0.5, 0.5, 0.5], [7.49, 1.0, 3.3], [2.75, 3.125, 15.0], [4.0, 2.0, 8.0]] {
        let found = interpolant.at(point.map(DoubleDouble::from));
        assert!(close(found, value(point)), "{point:?}: {found}");
    }
    // Along z at cells (2.8, 1.9): constant in the outer half cells; a cell is 0.25 long.
    let pixel = picture(&source, &along_z("0.35", "0.95", "linear", IDENTITY))?[0];
    let ends = value([2.8, 1.9, 0.5]) + value([2.8, 1.9, 15.5]);
    let depth = 0.25 * (0.5 * ends + 15.0 * 0.5 * ends);
    assert!(close(pixel[3], 1.0 - (-depth).exp()), "{} {}", pixel[3], depth);
    assert!(close(pixel[0], pixel[3]), "emission equal to absorption: {pixel:?}");
    Ok(())
}

#[test]
fn a_refined_cell_is_blended_into_its_neighbours_by_the_rule() -> Outcome<()> {
    // Along x: root cells 0, 1, 2 hold 0, (1), 4; cell 1 is refined into two halves of 1.
    let source = MemorySource::new([0.0; 3], [3.0, 1.0, 1.0], [3, 1, 1], &[2])?;
    let source = source.grid(0, [0; 3], [3, 1, 1], |i| [0.0, 7.0, 4.0][i[0] as usize]).grid(
        1,
        [2, 0, 0],
        [2; 3],
        |_| 1.0,
    );
    let dataset = Dataset::load(&source, "density", Precision::Source)?;
    let transfer = Scene::parse(&along_z("0", "0", "linear", IDENTITY))?.transfer(&dataset)?;
    let interpolant = Interpolant::new(&dataset, &transfer);
    let at = |x: f64| interpolant.at([x, 0.5, 0.5].map(DoubleDouble::from));
    // Coarse: 0, 1, 4 at 0.5, 1.5, 2.5. Fine ghosts: 0.75 · 4 + 0.25 · 1 = 3.25 at 2.25.
    assert!(close(at(0.75), 0.25));
    assert!(close(at(1.0), 0.5), "on the border the coarse value: {}", at(1.0));
    assert!(close(at(1.5), 1.0));
    // x = 1.875: u = 0.75 in the fine cell, w = 0.5; fine 1 + 0.25 · 2.25, coarse 1 + 0.375 · 3.
    let (fine, coarse) = (1.0 + 0.25 * 2.25, 1.0 + 0.375 * 3.0);
    assert!(close(at(1.875), 0.5 * (fine + coarse)), "{}", at(1.875));
    assert!(close(at(2.25), 1.0 + 0.75 * 3.0));
    Ok(())
}

/// How far apart the interpolant's values are at the eight points `step` root cells from `point`
/// along the diagonals, within the root grid of `flush_levels`.
fn spread_around(interpolant: &Interpolant<'_>, point: [f64; 3], step: f64) -> f64 {
    let values = (0..8).map(|n| {
        let near: [f64; 3] = std::array::from_fn(|a| {
            let offset = if n >> a & 1 == 1 { step } else { -step };
            (point[a] + offset).clamp(0.0, [6.0, 4.0, 5.0][a] - 1e-14)
        });
        interpolant.at(near.map(DoubleDouble::from))
    });
    let (low, high) = values.fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
    high - low
}

#[test]
fn the_interpolant_is_continuous_wherever_levels_meet() -> Outcome<()> {
    let dataset = Dataset::load(&flush_levels()?, "density", Precision::Source)?;
    let transfer = Scene::parse(&along_z("0", "0", "linear", IDENTITY))?.transfer(&dataset)?;
    let interpolant = Interpolant::new(&dataset, &transfer);
    let (mut largest, mut change): (f64, f64) = (0.0, 0.0);
    for level in 0..=dataset.deepest() {
        for (index, _) in dataset.leaves(level) {
            // Corners, points of edges and faces, and one inside.
            for n in 0..27 {
                let point: [f64; 3] = std::array::from_fn(|a| {
                    let place = [0.0, 0.43, 1.0][n / [1, 3, 9][a] % 3];
                    (index[a] as f64 + place) * (-(level as f64)).exp2()
                });
                largest = largest.max(spread_around(&interpolant, point, 1e-12));
                change = change.max(spread_around(&interpolant, point, 0.5));
            }
        }
    }
    assert!(change > 0.3, "the field hardly changes: {change}");
    assert!(largest < 1e-9, "a jump of {largest}");
    Ok(())
}

#[test]
fn the_line_integral_is_that_of_the_interpolant() -> Outcome<()> {
    let dataset = Dataset::load(&flush_levels()?, "density", Precision::Source)?;
    let volume =
        IDENTITY.replace("[[0.0, 0.0], [1.0, 1.0]]", "[[0.3, 0.0], [0.5, 9.0], [0.7, 1.0]]");
    let transfer = Scene::parse(&along_z("0", "0", "linear", &volume))?.transfer(&dataset)?;
    let interpolant = Interpolant::new(&dataset, &transfer);
    for (y, slope) in [(1.3, 0.11), (1.9, 0.02), (2.2, -0.13)] {
        let ray = walk::Ray {
            origin: [-1.0, y, 2.1].map(DoubleDouble::from),
            direction: [1.0, slope, 0.07].map(DoubleDouble::from),
            forward_only: true,
        };
        let found = march_linear::march(&interpolant, &transfer, &ray);
        let (samples, mut depth, mut radiance) = (40_000, 0.0, 0.0);
        let step = 6.0 / f64::from(samples);
        for n in 0..samples {
            let t = DoubleDouble::from(1.0 + (f64::from(n) + 0.5) * step);
            let optics = transfer.optics(transfer.map(interpolant.at(ray.at(t, 0))));
            let half = 0.5 * optics.extinction * step;
            radiance += optics.emission * step * (-depth - half).exp();
            depth += 2.0 * half;
        }
        assert!((found.optical_depth - depth).abs() < 1e-6 * depth, "{found:?} {depth}");
        assert!((found.radiance[0] - radiance).abs() < 1e-6, "{found:?} {radiance}");
    }
    Ok(())
}

#[test]
fn a_large_unit_of_the_field_changes_nothing() -> Outcome<()> {
    let source = |unit: f64| -> Outcome<MemorySource> {
        let source = MemorySource::new([0.0; 3], [1.0; 3], [4; 3], &[])?;
        Ok(source.grid(0, [0; 3], [4; 3], |i| unit * noise(0, i)))
    };
    for interpolation in ["cell", "linear"] {
        let scene = |range: &str| {
            let volume = IDENTITY.replace("range = [0.0, 1.0]", &format!("range = {range}"));
            along_z("0.41", "0.3", interpolation, &volume)
        };
        let small = picture(&source(1.0)?, &scene("[0.1, 1.0]"))?[0];
        let large = picture(&source(1e30)?, &scene("[1e29, 1e30]"))?[0];
        assert!(small[3] > 0.1, "{small:?}");
        assert!(small.iter().zip(large).all(|(a, b)| (a - b).abs() < 1e-12), "{small:?} {large:?}");
    }
    Ok(())
}

#[test]
fn far_and_near_eyes_see_the_same_at_level_forty_eight() -> Outcome<()> {
    let mut source = MemorySource::new([0.0; 3], [1.0; 3], [4; 3], &[2; 48])?;
    let mut lo = [0; 3];
    for level in 0..=48_u32 {
        source = source.grid(level, lo, [4; 3], |i| noise(level, i));
        lo = lo.map(|i| 2 * (i + 1 + i128::from(level % 2)));
    }
    let dataset = Dataset::load(&source, "density", Precision::Source)?;
    let index = lo.map(|i| (i / 2) as i64);
    let shown = |number: &exact::Rational| exact::to_decimal(number, 60);
    let target = dataset.point(48, index, [0.4; 3]).each_ref().map(shown);
    let eye = |distance: &str| -> Outcome<[String; 3]> {
        let away = exact::from_decimal(distance)?;
        Ok([
            target[0].clone(),
            target[1].clone(),
            shown(&(exact::from_decimal(&target[2])? - away)),
        ])
    };
    let volume = IDENTITY.replace("[[0.0, 0.0], [1.0, 1.0]]", "[[0.0, 0.0], [1.0, 1e13]]");
    let mut pictures = Vec::new();
    for distance in ["1", "1e-13"] {
        let eye = eye(distance)?;
        let (eye, target) =
            (eye.each_ref().map(String::as_str), target.each_ref().map(String::as_str));
        let camera = "orthographic\"\nheight = 2.8e-14 #";
        let scene = scene(&eye, &target, camera, "cell", 24, &volume);
        let scene = Scene::parse(&scene)?;
        pictures.push(Picture::render(&scene, &dataset)?);
    }
    let difference = pictures[0].difference(&pictures[1])?;
    assert!(difference.largest < 1e-12, "{difference:?}");
    assert!(pictures[0].largest() > 0.01);
    Ok(())
}
