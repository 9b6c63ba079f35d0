//! The program's pictures against the twin's, on synthetic and real outputs.

#[path = "support/data.rs"]
mod data;
#[path = "support/random.rs"]
mod random;
mod support;
mod twin;

use std::path::{Path, PathBuf};

use random::Random;
use support::IngestOptions;
use twin::cameras::{self, View};
use twin::dataset::{Dataset, Precision};
use twin::picture::{Difference, Picture};
use twin::scene::Scene;

const REAL: [&str; 5] = [
    "data/enzo_small/DD0010/DD0010",
    "data/enzo_deep13/DD0010/DD0010",
    "data/enzo_deep25/DD0021/DD0021",
    "data/enzo_deep48/DD0011/DD0011",
    "data/enzo_offdomain/DD0001/DD0001",
];
const SYNTHETIC: [&str; 6] = ["small", "jumps", "offdomain", "factor4", "deep25", "deep48"];

/// Largest and mean difference allowed, relative to the picture's largest value.
#[derive(Clone, Copy)]
struct Limit {
    largest: f64,
    mean: f64,
}

const CELL: Limit = Limit { largest: 1e-4, mean: 1e-6 };
const TELESCOPE: Limit = Limit { largest: 1e-5, mean: 1e-6 };
const LINEAR: Limit = Limit { largest: 1e-5, mean: 1e-6 };

/// An output in both forms: cells for the twin, a cache for the program.
struct Subject {
    name: String,
    dataset: Dataset,
    cache: PathBuf,
    _folder: tempfile::TempDir,
}

impl Subject {
    fn new(name: &str, locate: impl Fn(&Path) -> Option<PathBuf>) -> twin::Result<Option<Self>> {
        let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
        let Some(input) = locate(folder.path()) else { return Ok(None) };
        let source = deepfield::source::open(&input, None).map_err(|error| error.to_string())?;
        let dataset = Dataset::load(source.as_ref(), "Density", Precision::Single)?;
        let cache = support::ingest(&input, folder.path(), "cache", &IngestOptions::default())?;
        Ok(Some(Self { name: name.into(), dataset, cache, _folder: folder }))
    }

    fn real(path: &str) -> twin::Result<Option<Self>> {
        Self::new(path, |_| data::shared(path))
    }

    fn synthetic(name: &str) -> twin::Result<Option<Self>> {
        let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
        let input = support::synth(name, folder.path())?;
        Self::new(name, |_| Some(input.clone()))
    }

    /// The twin's picture and the program's.
    fn pictures(&self, view: &View) -> twin::Result<(Picture, Picture)> {
        let text = view.scene();
        let truth = Picture::render(&Scene::parse(&text)?, &self.dataset)?;
        let (width, height, pixels) = support::render(&self.cache, &text, "256MiB", 2)?;
        let pixels = pixels.into_iter().map(|pixel| pixel.map(f64::from)).collect();
        Ok((truth, Picture { width, height, pixels }))
    }

    /// Compares both pictures of a view and says whether there was something to compare.
    fn compare(&self, view: &View, limit: Limit) -> twin::Result<bool> {
        let (truth, picture) = self.pictures(view)?;
        if truth.largest() == 0.0 {
            let empty = picture.pixels.iter().flatten().all(|value| *value == 0.0);
            assert!(empty, "{}: something where nothing is\n{}", self.name, view.scene());
            return Ok(false);
        }
        self.report(view, picture.difference(&truth)?, limit);
        Ok(truth.is_varied())
    }

    fn report(&self, view: &View, difference: Difference, limit: Limit) {
        let within = difference.largest <= limit.largest && difference.mean <= limit.mean;
        assert!(within, "{}: {difference:?}\n{}", self.name, view.scene());
    }

    /// Random views, and the special ones.
    fn try_views(&self, seed: u64, count: usize, pixels: usize, linear: bool) -> twin::Result<()> {
        let mut random = Random::new(seed);
        let limit = if linear { LINEAR } else { CELL };
        let mut views: Vec<View> = (0..count)
            .map(|_| cameras::random_view(&self.dataset, &mut random, pixels, linear))
            .collect();
        views.extend(cameras::special_views(&self.dataset, &mut random, pixels, linear));
        let mut varied = 0;
        for view in &views {
            varied += usize::from(self.compare(view, limit)?);
        }
        assert!(2 * varied >= views.len(), "{}: {varied} of {} show much", self.name, views.len());
        Ok(())
    }

    /// From distance 1: as exact as any, and no pixel repeated where the twin's differ.
    fn try_telescope(&self) -> twin::Result<()> {
        for (power, perspective) in [(-30.0, false), (-30.0, true), (-45.0, false), (-45.0, true)] {
            let view = cameras::telescope(&self.dataset, f64::exp2(power), perspective);
            let (truth, picture) = self.pictures(&view)?;
            assert!(truth.largest() > 1e-3, "{}: nothing seen\n{}", self.name, view.scene());
            self.report(&view, picture.difference(&truth)?, TELESCOPE);
            let repeated = repeated_pixels(&picture, &truth);
            assert_eq!(repeated, 0, "{}: repeated pixels\n{}", self.name, view.scene());
        }
        Ok(())
    }
}

/// Neighbours that are equal in `picture` and differ in `truth` by more than f32 can hide.
fn repeated_pixels(picture: &Picture, truth: &Picture) -> usize {
    let visible = 1e-6 * truth.largest();
    let repeated = |a: usize, b: usize| {
        let pairs = truth.pixels[a].iter().zip(&truth.pixels[b]);
        picture.pixels[a] == picture.pixels[b]
            && pairs.into_iter().any(|(x, y)| (x - y).abs() > visible)
    };
    let width = truth.width;
    let across = (0..truth.pixels.len()).filter(|n| n % width > 0 && repeated(n - 1, *n));
    let down = (width..truth.pixels.len()).filter(|n| repeated(n - width, *n));
    across.count() + down.count()
}

fn every_subject(mut work: impl FnMut(&Subject) -> twin::Result<()>) -> twin::Result<()> {
    for path in REAL {
        if let Some(subject) = Subject::real(path)? {
            work(&subject)?;
        }
    }
    for name in SYNTHETIC {
        if let Some(subject) = Subject::synthetic(name)? {
            work(&subject)?;
        }
    }
    Ok(())
}

#[test]
fn cell_pictures_are_exact() -> twin::Result<()> {
    every_subject(|subject| subject.try_views(1, 4, 16, false))
}

#[test]
fn linear_pictures_are_exact() -> twin::Result<()> {
    every_subject(|subject| subject.try_views(2, 2, 5, true))
}

#[test]
fn rays_just_below_faces_see_the_same_in_linear_pictures() -> twin::Result<()> {
    for name in ["jumps", "offdomain"] {
        let Some(subject) = Subject::synthetic(name)? else { continue };
        let views = cameras::special_views(&subject.dataset, &mut Random::new(5), 5, true);
        for view in views {
            subject.compare(&view.lowered(), LINEAR)?;
        }
    }
    Ok(())
}

#[test]
fn telescopes_are_exact() -> twin::Result<()> {
    if let Some(real) = Subject::real("data/enzo_deep48/DD0011/DD0011")? {
        real.try_telescope()?;
    }
    Subject::synthetic("deep48")?.map_or(Ok(()), |subject| subject.try_telescope())
}

#[test]
#[ignore = "minutes: many cameras"]
fn many_cell_pictures_are_exact() -> twin::Result<()> {
    every_subject(|subject| subject.try_views(3, 40, 64, false))
}

#[test]
#[ignore = "many minutes: many cameras"]
fn many_linear_pictures_are_exact() -> twin::Result<()> {
    every_subject(|subject| subject.try_views(4, 20, 17, true))
}
