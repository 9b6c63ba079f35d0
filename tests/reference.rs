//! The reference of the certificate against analytic integrals and the double-double twin, and
//! how it converges.

#[path = "support/data.rs"]
mod data;
#[path = "support/random.rs"]
mod random;
mod twin;

use random::Random;
use twin::cameras;
use twin::dataset::{Dataset, Precision};
use twin::double_double::DoubleDouble;
use twin::interpolant::Interpolant;
use twin::memory::MemorySource;
use twin::picture::Picture;
use twin::reference::Reference;
use twin::reference::area::Effort;
use twin::reference::tree::Tree;
use twin::scene::Scene;
use twin::scenes::random_trial;
use twin::subject::{CLUMPY, Subject};

const EFFORT: Effort = Effort { accuracy: 1e-4, most_rays: 4000 };
/// Along z over all of a unit square, from outside.
const ALONG_Z: &str = "[camera]\nposition = [0.5, 0.5, -1.0]\nlook_at = [0.5, 0.5, 0.5]\n\
    up = [0.0, 1.0, 0.0]\nprojection = \"orthographic\"\n";
/// Emission equal to the value in every channel, nothing absorbed.
const GLOW: &str = "[[volume]]\nfield = \"Density\"\nscale = \"linear\"\nrange = [0.0, 1.0]\n\
    color = [[0.0, 1.0, 1.0, 1.0]]\nabsorption = [[0.0, 0.0]]\nemission = [[0.0, 0.0], [1.0, 1.0]]\n";

fn reference(text: &str, dataset: &Dataset, effort: Effort) -> twin::Result<Reference> {
    let scene = Scene::parse(text)?;
    let transfer = scene.transfer(dataset)?;
    let tree = Tree::new(&Interpolant::new(dataset, &transfer))?;
    Reference::render(&scene, dataset, &tree, effort, None)
}

fn scene(pixels: usize, height: f64, interpolation: &str, samples: &str, volume: &str) -> String {
    format!(
        "[image]\nwidth = {pixels}\nheight = {pixels}\n{ALONG_Z}height = {height}\n[render]\n\
         interpolation = \"{interpolation}\"\ntolerance = 0\nsamples = {samples}\n{volume}"
    )
}

/// Simpson's rule over `low … high`.
fn integral(low: f64, high: f64, f: impl Fn(f64) -> f64) -> f64 {
    let steps = 2000;
    let step = (high - low) / f64::from(steps);
    let weight = |n| if n == 0 || n == steps { 1.0 } else { f64::from(2 + 2 * (n % 2)) };
    (0..=steps).map(|n| weight(n) * f(low + step * f64::from(n))).sum::<f64>() * step / 3.0
}

#[test]
fn rays_equal_the_double_double_twins() -> twin::Result<()> {
    for name in ["small", "jumps", "offdomain", "factor4", "deep25", "deep48"] {
        let subject = Subject::synthetic(name)?;
        let mut random = Random::new(7);
        for number in 0..8 {
            let view = cameras::random_view(&subject.dataset, &mut random, 8, number % 2 == 0);
            let text = view.scene();
            let twin = Picture::render(&Scene::parse(&text)?, &subject.dataset)?;
            if twin.largest() > 0.0 {
                let found = subject.reference(&text, EFFORT)?.picture;
                let difference = found.difference(&twin)?;
                assert!(difference.largest < 1e-9, "{name}: {difference:?}\n{text}");
            }
        }
    }
    Ok(())
}

/// Averages over pixels of a Gaussian ball: the integrals along all three axes factor. What is
/// left is the grid's own error, which falls with the square of its cells.
#[test]
fn averages_of_a_gaussian_ball_converge_to_the_analytic_ones() -> twin::Result<()> {
    const SIGMA: f64 = 0.12;
    const PIXELS: usize = 6;
    let along =
        |low: f64, high: f64| integral(low, high, |x| (-0.5 * ((x - 0.5) / SIGMA).powi(2)).exp());
    let edge = 1.0 / PIXELS as f64;
    let mean = |n: usize| along(n as f64 * edge, (n + 1) as f64 * edge) / edge;
    let mut errors = Vec::new();
    for cells in [16, 32, 64] {
        let subject = Subject::synthetic(&format!("gaussian_{cells}"))?;
        let text = scene(PIXELS, 1.0, "linear", "\"area\"", GLOW);
        let effort = Effort { accuracy: 1e-4, most_rays: 5_000 };
        let found = subject.reference(&text, effort)?;
        let error = |(n, pixel): (usize, &[f64; 4])| {
            let exact = mean(n % PIXELS) * mean(n / PIXELS) * along(0.0, 1.0);
            assert!(found.error[n][0] < 2e-4, "{:?}", found.error[n]);
            (pixel[0] - exact).abs()
        };
        errors.push(found.picture.pixels.iter().enumerate().map(error).fold(0.0, f64::max));
    }
    assert!(errors.windows(2).all(|e| e[1] < 0.3 * e[0]), "{errors:?}");
    assert!(errors[2] < 5e-4, "{errors:?}");
    Ok(())
}

/// A box that covers parts of pixels: values jump at its edges, where averages converge slowest.
#[test]
fn parts_of_pixels_are_measured_within_the_error_stated() -> twin::Result<()> {
    let source = MemorySource::new([0.0; 3], [1.0; 3], [1; 3], &[]).map_err(|e| e.to_string())?;
    let dataset =
        Dataset::load(&source.grid(0, [0; 3], [1; 3], |_| 0.75), "density", Precision::Source)?;
    let text = scene(3, 1.7, "cell", "\"area\"", GLOW);
    let covered = (1.0 - 1.7 / 3.0) / 2.0 / (1.7 / 3.0);
    let mut last = f64::INFINITY;
    for accuracy in [1e-1, 1e-2, 1e-3] {
        let found = reference(&text, &dataset, Effort { accuracy, most_rays: 200_000 })?;
        let mut largest = 0.0_f64;
        for (n, (pixel, error)) in found.picture.pixels.iter().zip(&found.error).enumerate() {
            let part = |n: usize| if n == 1 { 1.0 } else { covered };
            let exact = 0.75 * part(n % 3) * part(n / 3);
            assert!((pixel[0] - exact).abs() <= error[0], "{n}: {pixel:?} {exact} {error:?}");
            assert!(error[0] <= accuracy, "{n}: {error:?}");
            largest = largest.max((pixel[0] - exact).abs());
        }
        assert!(largest < last, "{largest} after {last}");
        last = largest;
    }
    Ok(())
}

/// Without absorption, pixels that cover the domain hold all of its light: no core is lost,
/// however small.
#[test]
fn all_light_of_deep_cores_is_seen() -> twin::Result<()> {
    for name in ["jumps", "deep25", "deep48"] {
        let subject = Subject::synthetic(name)?;
        let dataset = &subject.dataset;
        let width: [f64; 3] = dataset.root_cell_width().map(DoubleDouble::to_f64);
        // Only what is within a tenth of the decades below the largest value shines.
        let glow = format!(
            "[[volume]]\nfield = \"Density\"\nscale = \"log10\"\n\
             color = [[0.0, 1.0, 1.0, 1.0]]\nabsorption = [[0.0, 0.0]]\n\
             emission = [[0.9, 0.0], [0.9, {:e}], [1.0, {0:e}]]\n",
            (3.0 * dataset.deepest() as f64).exp2()
        );
        let transfer = Scene::parse(&scene(1, 1.0, "cell", "1", &glow))?.transfer(dataset)?;
        let light = |level: usize| {
            let cell = width.iter().product::<f64>() * (-3.0 * level as f64).exp2();
            let shine = |value| transfer.optics(transfer.map(transfer.scaled(value))).emission;
            dataset.leaves(level).iter().map(|(_, value)| cell * shine(*value)).sum::<f64>()
        };
        let (pixels, height) = (5, 3.0);
        let text = scene(pixels, height, "cell", "\"area\"", &glow);
        let pixel_area = (height / pixels as f64).powi(2);
        let all: f64 = (0..=dataset.deepest()).map(light).sum();
        let effort = Effort { accuracy: 0.05 * all / pixel_area, most_rays: 10_000 };
        let found = subject.reference(&text, effort)?;
        let seen = found.picture.pixels.iter().map(|p| p[0]).sum::<f64>() * pixel_area;
        let error = found.error.iter().map(|e| e[0]).sum::<f64>() * pixel_area;
        eprintln!("{name}: {seen} ± {error} of {all}, {} rays", found.rays);
        assert!((seen - all).abs() <= error, "{name}: {seen} ± {error} of {all}");
        assert!(error < 0.15 * all, "{name}: {seen} ± {error} of {all}");
    }
    Ok(())
}

/// More rays change an average by no more than the fewer rays' error, and even spreads of rays
/// come to the same.
#[test]
fn averages_change_by_no_more_than_their_stated_error() -> twin::Result<()> {
    let size = [4, 3];
    let subjects = [Subject::of_recipe("clumpy", CLUMPY)?, Subject::synthetic("jumps")?];
    for (number, subject) in subjects.iter().enumerate() {
        let mut random = Random::new(11);
        for kind in 0..4 {
            let trial = random_trial(&subject.dataset, &mut random, 2 * kind + number, size);
            let text = with_samples(&trial.text, "\"area\"");
            let even = subject.reference(&with_samples(&text, "32"), EFFORT)?.picture;
            let coarse = subject.reference(&with_samples(&text, "16"), EFFORT)?.picture;
            let efforts = [3e-2, 3e-3]
                .map(|part| Effort { accuracy: part * even.largest(), most_rays: 3_000 });
            let few = subject.reference(&text, efforts[0])?;
            let many = subject.reference(&text, efforts[1])?;
            for n in 0..size[0] * size[1] {
                for c in 0..4 {
                    let value = |picture: &Picture| picture.pixels[n][c];
                    let change = (value(&few.picture) - value(&many.picture)).abs();
                    let stated = few.error[n][c] + many.error[n][c];
                    assert!(change <= stated, "{change:e} {stated:e} pixel {n}\n{text}");
                    let spread = 2.0 * (value(&even) - value(&coarse)).abs();
                    let change = (value(&even) - value(&many.picture)).abs();
                    let allowed = spread + many.error[n][c] + 1e-3 * even.largest();
                    assert!(change <= allowed, "{change:e} {allowed:e} pixel {n}\n{text}");
                }
            }
        }
    }
    Ok(())
}

fn with_samples(text: &str, samples: &str) -> String {
    let line = |line: &str| match line.starts_with("samples = ") {
        true => format!("samples = {samples}"),
        false => line.to_owned(),
    };
    text.lines().map(line).collect::<Vec<_>>().join("\n")
}
