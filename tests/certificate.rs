//! The certificate held to its word: no pixel of a picture is farther from the truth than the
//! picture's own error bound, and the bound is within the tolerance.
//!
//! The truth is the twin's reference, drawn from the source's cells. Where an average over a
//! pixel has not converged, the reference's own error is allowed on top.

#[path = "support/data.rs"]
mod data;
#[path = "support/random.rs"]
mod random;
mod twin;

use std::time::{Duration, Instant};

use deepfield::render::Rendered;
use random::Random;
use twin::reference::Reference;
use twin::reference::area::Effort;
use twin::scenes::{Trial, random_trial};
use twin::subject::{CLUMPY, Subject};

const REAL: [&str; 5] = [
    "data/enzo_small/DD0010/DD0010",
    "data/enzo_deep13/DD0010/DD0010",
    "data/enzo_deep25/DD0021/DD0021",
    "data/enzo_deep48/DD0011/DD0011",
    "data/enzo_offdomain/DD0001/DD0001",
];
const SYNTHETIC: [&str; 6] = ["small", "jumps", "offdomain", "factor4", "deep25", "deep48"];
/// Pixels across and down, all of which are compared.
const SMALL: [usize; 2] = [9, 7];
/// Pixels enough for full packets, several tiles and bricks in fewer cells, of which some are
/// compared.
const LARGE: [usize; 2] = [131, 97];
/// The same, and pixels so many that those around one are asked about its area.
const LARGER: [usize; 2] = [259, 193];
/// Pixels of a larger picture that are compared, about.
const COMPARED: usize = 65;
/// Relative error of stored values, in caches that have one.
const STORED: f64 = 1e-3;
/// What tolerance 0 promises, of the picture's largest value.
const EXACT: f64 = 1e-6;
/// Part of the tolerance to which averages over pixels converge.
const CONVERGED: f64 = 0.02;
/// Largest part of the pixels whose reference may be less exact than the bound.
const UNDECIDED: f64 = 0.1;
/// How loose bounds of n×n rays may be: most of bound / measured in the median scene.
const LOOSEST: f64 = 25.0;

/// How many scenes, of pixels that stand for areas or for n×n rays, and how hard the reference
/// tries.
#[derive(Clone, Copy)]
struct Campaign {
    seed: u64,
    areas: bool,
    size: [usize; 2],
    scenes_each: usize,
    most_rays: usize,
}

/// One scene's outcome.
struct Outcome {
    is_area: bool,
    /// Whether stored values have an error: it may be more than a tolerance allows, so that only
    /// the bound itself is held to the truth.
    is_lossy: bool,
    bound: f64,
    tolerance: f64,
    /// What of the bound no work changes: values stored as f32, and the picture's own.
    floor: f64,
    largest_value: f64,
    /// Largest measured error of any channel of any pixel.
    measured: f64,
    /// Whether all pixels are as close as was asked for, and as the picture says that they are in
    /// all likelihood, as far as the reference can tell.
    is_within: [bool; 2],
    /// Pixels compared, and those whose reference is less exact than the bound.
    pixels: usize,
    undecided: usize,
    /// Whose scene it is, and what it asks for.
    scene: String,
    failure: Option<String>,
}

/// All outcomes, and where the time went.
#[derive(Default)]
struct Tally {
    outcomes: Vec<Outcome>,
    rays: usize,
    reference_time: Duration,
    picture_time: Duration,
}

impl Campaign {
    fn run(mut self) -> twin::Result<()> {
        self.seed += other_scenes()?;
        let mut tally = Tally::default();
        for (number, subject) in (0..).zip(subjects()) {
            if let Some(subject) = subject()? {
                self.try_subject(&subject, number, &mut tally)?;
            }
        }
        tally.print();
        let failures: Vec<&str> =
            tally.outcomes.iter().filter_map(|outcome| outcome.failure.as_deref()).collect();
        let count = (failures.len(), tally.outcomes.len());
        assert!(failures.is_empty(), "{count:?} scenes failed\n{}", failures.join("\n"));
        assert!(count.1 >= SYNTHETIC.len() * self.scenes_each);
        tally.check_width(self.areas)?;
        let open = tally.open_areas();
        for (n, what) in ["tolerance", "estimate"].into_iter().enumerate() {
            let within = open.iter().filter(|o| o.is_within[n]).count();
            // What is likely may fail, but rarely.
            assert!(
                10 * within >= 9 * open.len(),
                "{within} of {} within their {what}",
                open.len()
            );
        }
        Ok(())
    }

    fn try_subject(self, subject: &Subject, number: u64, tally: &mut Tally) -> twin::Result<()> {
        let mut random = Random::new(1000 * self.seed + number);
        for scene in 0..self.scenes_each {
            let kind = scene + number as usize;
            let trial = loop {
                let trial = random_trial(&subject.dataset, &mut random, kind, self.size);
                if self.areas == is_area(&trial) {
                    break trial;
                }
            };
            let stored = if scene % 4 == 3 { STORED } else { 0.0 };
            let outcome = self.try_scene(subject, &trial, stored, tally);
            tally.outcomes.push(outcome.map_err(|error| {
                format!("{}, stored error {stored}: {error}\n{}", subject.name, trial.text)
            })?);
        }
        Ok(())
    }

    /// The pixels that are compared: some all over the picture and, where rays are few enough that
    /// a picture to tolerance 0 can tell, those where it is farthest from that.
    fn places(
        self,
        subject: &Subject,
        trial: &Trial,
        stored: f64,
        picture: &Rendered,
    ) -> twin::Result<Vec<usize>> {
        let count = self.size[0] * self.size[1];
        // An odd number of a row's pixels more or less, so that all columns have their turn.
        let mut places: Vec<usize> = (0..count).step_by((count / COMPARED).max(1) | 1).collect();
        let is_exact = stored == 0.0 && picture.stats.tolerance == Some(0.0);
        if places.len() < count && !self.areas && !is_exact {
            places.extend(farthest(subject, trial, picture)?);
            places.sort_unstable();
            places.dedup();
        }
        Ok(places)
    }

    fn try_scene(
        self,
        subject: &Subject,
        trial: &Trial,
        stored: f64,
        tally: &mut Tally,
    ) -> twin::Result<Outcome> {
        let start = Instant::now();
        let picture = subject.picture(&trial.text, stored)?;
        tally.picture_time += start.elapsed();
        let places = self.places(subject, trial, stored, &picture)?;
        let start = Instant::now();
        let accuracy = CONVERGED * picture.stats.tolerance.unwrap_or(f64::NAN);
        let effort = Effort { accuracy, most_rays: self.most_rays };
        let reference = subject.reference_at(&trial.text, effort, Some(places))?;
        tally.reference_time += start.elapsed();
        tally.rays += reference.rays;
        let mut outcome = Outcome::new(&picture, &reference, trial, stored > 0.0);
        let Trial { kind, text } = trial;
        outcome.scene = format!("{}, stored error {stored}, {kind}\n{text}", subject.name);
        outcome.failure =
            outcome.fault(&picture, &reference).map(|fault| format!("{fault}: {}", outcome.scene));
        Ok(outcome)
    }
}

/// The pixels that differ most from those of a picture to tolerance 0, a few.
fn farthest(subject: &Subject, trial: &Trial, picture: &Rendered) -> twin::Result<Vec<usize>> {
    let is_tolerance = |line: &&str| line.starts_with("tolerance");
    let line = trial.text.lines().find(is_tolerance).ok_or("a scene without a tolerance")?;
    let exact = subject.picture(&trial.text.replace(line, "tolerance = 0"), 0.0)?;
    let pixels = picture.film.pixels().iter().zip(exact.film.pixels());
    let apart = pixels.map(|(a, b)| (0..4).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max));
    let mut ranked: Vec<(usize, f32)> = apart.enumerate().collect();
    ranked.sort_by(|a, b| b.1.total_cmp(&a.1));
    Ok(ranked.into_iter().take(COMPARED / 2).map(|(n, _)| n).collect())
}

/// `CERTIFICATE_SCENES=1`, `2`, … in the environment draws other scenes than usually.
fn other_scenes() -> twin::Result<u64> {
    let Ok(text) = std::env::var("CERTIFICATE_SCENES") else { return Ok(0) };
    let number: u64 = text.parse().map_err(|_| "CERTIFICATE_SCENES is no number")?;
    Ok(1000 * number)
}

fn is_area(trial: &Trial) -> bool {
    trial.text.contains("\"area\"")
}

type Open = Box<dyn Fn() -> twin::Result<Option<Subject>>>;

/// Every subject, opened one at a time.
fn subjects() -> Vec<Open> {
    let mut all: Vec<Open> = vec![Box::new(|| Subject::of_recipe("clumpy", CLUMPY).map(Some))];
    for name in SYNTHETIC {
        all.push(Box::new(move || Subject::synthetic(name).map(Some)));
    }
    for path in REAL {
        all.push(Box::new(move || Subject::real(path)));
    }
    all
}

impl Outcome {
    fn new(picture: &Rendered, reference: &Reference, trial: &Trial, is_lossy: bool) -> Self {
        let tolerance = picture.stats.tolerance.unwrap_or(f64::NAN);
        let largest_value = f64::from(picture.film.largest_value());
        // Without a certificate nothing is allowed: no number passes.
        let bound = picture.stats.error_bound.unwrap_or(f64::NAN);
        let errors = errors(picture, reference);
        let unsure = |n: &&usize| reference.error[**n].iter().any(|e| *e > bound);
        Self {
            is_lossy,
            is_area: is_area(trial),
            bound,
            tolerance,
            floor: picture.stats.error_shares.map_or(0.0, |s| s.storage + s.rounding),
            largest_value,
            measured: errors.iter().flatten().copied().fold(0.0, f64::max),
            is_within: [tolerance, picture.stats.error_estimate.unwrap_or(bound)].map(|limit| {
                let own = reference.places.iter().map(|n| reference.error[*n]);
                own.zip(&errors).all(|(own, error)| (0..4).all(|c| error[c] <= limit + own[c]))
            }),
            pixels: reference.places.len(),
            undecided: reference.places.iter().filter(unsure).count(),
            scene: String::new(),
            failure: None,
        }
    }

    /// What the certificate has wrong; none if nothing.
    fn fault(&self, picture: &Rendered, reference: &Reference) -> Option<String> {
        let Self { bound, tolerance, .. } = *self;
        if !(bound.is_finite() && bound >= 0.0) {
            return Some(format!("an error bound of {bound}"));
        }
        // Pixels that stand for areas take a limited number of rays: then the bound may stay above
        // the tolerance, and says so.
        if tolerance > 0.0 && bound - self.floor > tolerance && !self.is_lossy && !self.is_area {
            return Some(format!("a bound of {bound:e} for a tolerance of {tolerance:e}"));
        }
        let exact = tolerance == 0.0 && !self.is_area && !self.is_lossy;
        if exact && self.measured > EXACT * self.largest_value + self.floor {
            return Some(format!("{:e} off at tolerance 0", self.measured));
        }
        let width = picture.film.width() as usize;
        let all = errors(picture, reference);
        let excess = |(&n, error): (&usize, &[f64; 4])| {
            let own = reference.error[n];
            let channel = (0..4).find(|c| error[*c].is_nan() || error[*c] > bound + own[*c])?;
            Some(format!(
                "pixel {:?}, channel {channel}: {:e} drawn, {:e} ± {:e} true, {:e} off by more \
                 than {bound:e} (tolerance {tolerance:e})",
                [n % width, n / width],
                picture.film.pixels()[n][channel],
                reference.picture.pixels[n][channel],
                own[channel],
                error[channel],
            ))
        };
        reference.places.iter().zip(&all).find_map(excess)
    }
}

/// How far each channel of each pixel that the reference has is from it.
fn errors(picture: &Rendered, reference: &Reference) -> Vec<[f64; 4]> {
    let (ours, truth) = (picture.film.pixels(), &reference.picture.pixels);
    let error = |n: usize, c: usize| (f64::from(ours[n][c]) - truth[n][c]).abs();
    reference.places.iter().map(|n| std::array::from_fn(|c| error(*n, c))).collect()
}

impl Tally {
    fn print(&self) {
        let count = self.outcomes.len();
        let seconds = self.reference_time.as_secs_f64();
        eprintln!(
            "{count} scenes; pictures {:.1} s; reference {seconds:.1} s, {} rays, {:.0} a second",
            self.picture_time.as_secs_f64(),
            self.rays,
            self.rays as f64 / seconds
        );
        for is_area in [false, true] {
            self.print_kind(if is_area { "area" } else { "n rays" }, is_area);
        }
        self.print_likelihood();
    }

    /// That what was compared decides, and that bounds are not loose.
    fn check_width(&self, areas: bool) -> twin::Result<()> {
        let undecided: usize = self.outcomes.iter().map(|o| o.undecided).sum();
        let pixels: usize = self.outcomes.iter().map(|o| o.pixels).sum();
        if undecided as f64 > UNDECIDED * pixels as f64 {
            return Err(format!("{undecided} of {pixels} pixels are undecided"));
        }
        if areas {
            let is_known = !self.open_areas().is_empty();
            return is_known.then_some(()).ok_or("no area was left to estimates".into());
        }
        let median = at(&self.ratios(false), 0.5).ok_or("nothing was off")?;
        if median > LOOSEST {
            return Err(format!("bounds are {median} times what is measured in the median"));
        }
        Ok(())
    }

    /// Bound / measured of every scene where something was off, in order.
    fn ratios(&self, is_area: bool) -> Vec<f64> {
        let of_kind = self.outcomes.iter().filter(|o| o.is_area == is_area);
        let measured = of_kind.filter(|o| o.measured > 0.0 && o.bound.is_finite());
        let mut ratios: Vec<f64> = measured.map(|o| o.bound / o.measured).collect();
        ratios.sort_by(f64::total_cmp);
        ratios
    }

    /// Areas that no bound certifies, where not stored values alone are off by more than the tolerance.
    fn open_areas(&self) -> Vec<&Outcome> {
        let is_open = |o: &&Outcome| o.is_area && o.tolerance > 0.0 && o.bound > o.tolerance;
        self.outcomes.iter().filter(is_open).filter(|o| o.floor <= o.tolerance).collect()
    }

    /// How they compare with their tolerances and with what their pictures say of themselves.
    fn print_likelihood(&self) {
        let open = self.open_areas();
        let part = |o: &Outcome| o.measured / o.tolerance;
        let mut parts: Vec<f64> = open.iter().map(|o| part(o)).collect();
        parts.sort_by(f64::total_cmp);
        let (Some(most), Some(median)) = (parts.last(), parts.get(parts.len() / 2)) else { return };
        for outcome in open.iter().filter(|o| !o.is_within[0]) {
            eprintln!("{:.3} tolerances off: {}", part(outcome), outcome.scene);
        }
        let count = |n: usize| open.iter().filter(|o| o.is_within[n]).count();
        eprintln!(
            "{} areas without a certificate: {} within the tolerance, {} within the estimate; \
             measured / tolerance: median {median:.3}, most {most:.3}",
            open.len(),
            count(0),
            count(1)
        );
    }

    fn print_kind(&self, name: &str, is_area: bool) {
        let of_kind: Vec<&Outcome> =
            self.outcomes.iter().filter(|outcome| outcome.is_area == is_area).collect();
        let count = |which: &dyn Fn(&Outcome) -> bool| of_kind.iter().filter(|o| which(o)).count();
        let below = count(&|o| o.tolerance > 0.0 && o.bound < o.tolerance);
        let failed = count(&|o| o.failure.is_some());
        let limited = count(&|o| o.tolerance > 0.0 && !o.is_lossy && o.floor > o.tolerance);
        let undecided: usize = of_kind.iter().map(|o| o.undecided).sum();
        let pixels: usize = of_kind.iter().map(|o| o.pixels).sum();
        let ratios = self.ratios(is_area);
        let at = |part: f64| at(&ratios, part);
        eprintln!(
            "{name}: {} scenes, {failed} failed, bound below tolerance in {below}, {limited} \
             limited by f32, {undecided} of {} pixels undecided; bound / measured: quartiles {:.3?} {:.3?} {:.3?}, 95% {:.3?}",
            of_kind.len(),
            pixels,
            at(0.25),
            at(0.5),
            at(0.75),
            at(0.95)
        );
    }
}

/// What lies so far into sorted numbers.
fn at(sorted: &[f64], part: f64) -> Option<f64> {
    sorted.get((part * sorted.len() as f64) as usize).copied()
}

/// Cells many pixels wide, and a transfer function without kinks in their range.
const WIDE_CELLS: &str = r#"
[image]
width = 12
height = 9
[camera]
projection = "orthographic"
position = [0.5, 0.5, -2.0]
look_at = [0.5, 0.5, 0.5]
up = [0.0, 1.0, 0.0]
height = 0.006
[render]
interpolation = "linear"
tolerance = "1%"
samples = "area"
[[volume]]
field = "Density"
scale = "log10"
range = [1e-2, 1e4]
color = [[0.0, 0.1, 0.2, 0.3], [1.0, 1.0, 0.8, 0.5]]
absorption = [[0.0, 0.0], [1.0, 1.0]]
emission = [[0.0, 0.0], [1.0, 1.0]]
"#;

/// Where cells are wide and the transfer function is smooth, bounds of areas reach.
#[test]
fn areas_of_wide_cells_are_certified() -> twin::Result<()> {
    let (subject, text) = (Subject::synthetic("small")?, WIDE_CELLS);
    let picture = subject.picture(text, 0.0)?;
    let (bound, tolerance) = (picture.stats.error_bound, picture.stats.tolerance);
    let (bound, tolerance) = bound.zip(tolerance).ok_or("no bound")?;
    assert!(bound > 0.0 && bound <= tolerance, "{bound:e} of {tolerance:e}");
    let effort = Effort { accuracy: CONVERGED * tolerance, most_rays: 4000 };
    let reference = subject.reference(text, effort)?;
    let off = errors(&picture, &reference);
    for (n, error) in reference.places.iter().zip(off) {
        let own = reference.error[*n];
        assert!((0..4).all(|c| error[c] <= bound + own[c]), "{error:?}, {bound:e}, {own:?}");
    }
    Ok(())
}

#[test]
fn no_pixel_is_farther_from_the_truth_than_certified() -> twin::Result<()> {
    Campaign { seed: 1, areas: false, size: SMALL, scenes_each: 3, most_rays: 400 }.run()
}

#[test]
fn no_pixels_area_is_farther_from_the_truth_than_certified() -> twin::Result<()> {
    Campaign { seed: 5, areas: true, size: SMALL, scenes_each: 1, most_rays: 100 }.run()
}

#[test]
#[ignore = "many minutes: hundreds of scenes"]
fn no_pixel_of_many_scenes_is_farther_from_the_truth_than_certified() -> twin::Result<()> {
    Campaign { seed: 2, areas: false, size: SMALL, scenes_each: 44, most_rays: 4000 }.run()
}

#[test]
#[ignore = "many minutes: dozens of scenes"]
fn no_pixels_area_of_many_scenes_is_farther_from_the_truth_than_certified() -> twin::Result<()> {
    Campaign { seed: 6, areas: true, size: SMALL, scenes_each: 4, most_rays: 1000 }.run()
}

#[test]
#[ignore = "minutes: hundreds of scenes"]
fn no_pixel_of_larger_pictures_is_farther_from_the_truth_than_certified() -> twin::Result<()> {
    Campaign { seed: 7, areas: false, size: LARGE, scenes_each: 22, most_rays: 4000 }.run()
}

#[test]
#[ignore = "minutes: dozens of scenes"]
fn no_pixels_area_of_larger_pictures_is_farther_from_the_truth_than_certified() -> twin::Result<()>
{
    Campaign { seed: 8, areas: true, size: LARGER, scenes_each: 4, most_rays: 1000 }.run()
}
