//! The truth that a picture is held to, by brute force: every pixel's exact value, and how far
//! this value itself may be off.
//!
//! All levels, the interpolant across levels, transfer functions and line integrals are exact as
//! in the twin's other renderer, whose rays this one's must equal; it is some hundred times
//! faster, which averages over pixels need.

pub(crate) mod area;
mod layers;
pub(crate) mod march;
mod medium;
mod polynomial;
mod specks;
mod surface;
pub(crate) mod tree;

use std::sync::atomic::{AtomicUsize, Ordering};

use super::Result;
use super::camera::Camera;
use super::dataset::Dataset;
use super::double_double::DoubleDouble;
use super::picture::Picture;
use super::scene::{Interpolation, Samples, Scene};
use area::{Averager, Converged, Effort};
use march::Scenery;
use medium::Medium;
use specks::Specks;
use tree::Tree;

/// Relative error of a single ray, from rounding along it.
const ROUNDING: f64 = 1e-11;

/// A picture and its convergence.
#[derive(Debug, Clone)]
pub(crate) struct Reference {
    /// No numbers where nothing was drawn.
    pub(crate) picture: Picture,
    /// The pixels that were drawn, by number.
    pub(crate) places: Vec<usize>,
    /// How far each channel of each pixel may be off.
    pub(crate) error: Vec<[f64; 4]>,
    /// Rays of the whole picture.
    pub(crate) rays: usize,
}

/// What all pixels share.
struct Work<'a> {
    scenery: Scenery<'a>,
    camera: &'a Camera,
    specks: &'a Specks,
    samples: Samples,
    effort: Effort,
    width: usize,
    next: AtomicUsize,
    places: &'a [usize],
}

impl Reference {
    /// Renders all pixels of `scene`, or those at `places` (by number, row by row), on all
    /// processors; `tree` holds `dataset` under the scene's scale.
    pub(crate) fn render(
        scene: &Scene,
        dataset: &Dataset,
        tree: &Tree,
        effort: Effort,
        places: Option<Vec<usize>>,
    ) -> Result<Self> {
        let (width, height) = (scene.image.width, scene.image.height);
        let camera = Camera::new(scene, dataset)?;
        let medium = Medium::new(&scene.transfer(dataset)?);
        let is_linear = scene.render.interpolation == Interpolation::Linear;
        let scenery = Scenery { tree, medium: &medium, is_linear };
        let cell = dataset.root_cell_width().map(DoubleDouble::to_f64);
        let specks = Specks::find(scenery, &camera, cell, [width, height]);
        let places = places.unwrap_or_else(|| (0..width * height).collect());
        let work = Work {
            scenery,
            camera: &camera,
            specks: &specks,
            samples: scene.samples()?,
            effort,
            width,
            next: AtomicUsize::new(0),
            places: &places,
        };
        let drawn = work.on_all_processors()?;
        let rays = drawn.iter().map(|(_, pixel)| pixel.rays).sum();
        let [mut pixels, mut error] = [(); 2].map(|()| vec![[f64::NAN; 4]; width * height]);
        for (n, pixel) in drawn {
            (pixels[n], error[n]) = (pixel.value, pixel.error);
        }
        Ok(Self { picture: Picture { width, height, pixels }, places, error, rays })
    }
}

impl Work<'_> {
    /// The pixels with their numbers, in any order.
    fn on_all_processors(&self) -> Result<Vec<(usize, Converged)>> {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let done = std::thread::scope(|scope| {
            let workers: Vec<_> =
                (0..threads).map(|_| scope.spawn(|| self.pixels_one_by_one())).collect();
            let joined = workers
                .into_iter()
                .map(|worker| worker.join().map_err(|_| "a render thread panicked".to_string())?);
            joined.collect::<Result<Vec<_>>>()
        })?;
        Ok(done.into_iter().flatten().collect())
    }

    fn pixels_one_by_one(&self) -> Result<Vec<(usize, Converged)>> {
        let mut done = Vec::new();
        loop {
            let next = self.next.fetch_add(1, Ordering::Relaxed);
            let Some(&n) = self.places.get(next) else { return Ok(done) };
            done.push((n, self.pixel(n)?));
        }
    }

    fn pixel(&self, n: usize) -> Result<Converged> {
        let (column, row) = (n % self.width, n / self.width);
        let mut pixel = match self.samples {
            Samples::Grid(rays) => self.grid([column, row], rays)?,
            Samples::Area => {
                let ray = |[x, y]: [f64; 2]| self.ray([x, 1.0], [y, 1.0]);
                let averager = Averager { ray: &ray, effort: self.effort };
                averager.pixel([column as f64, row as f64], self.specks.of(n))?
            }
        };
        for (error, value) in pixel.error.iter_mut().zip(pixel.value) {
            *error += ROUNDING * value;
        }
        Ok(pixel)
    }

    /// The mean of n×n rays: the m-th lies at i + (m + ½)/n pixels.
    fn grid(&self, [column, row]: [usize; 2], n: usize) -> Result<Converged> {
        let place = |i: usize, m: usize| [(2 * (i * n + m) + 1) as f64, (2 * n) as f64];
        let mut value = [0.0; 4];
        for sample in 0..n * n {
            let seen = self.ray(place(column, sample % n), place(row, sample / n))?;
            value.iter_mut().zip(seen).for_each(|(sum, v)| *sum += v / (n * n) as f64);
        }
        Ok(Converged { value, error: [0.0; 4], rays: n * n })
    }

    fn ray(&self, column: [f64; 2], row: [f64; 2]) -> Result<[f64; 4]> {
        Ok(march::march(self.scenery, &self.camera.ray(column, row)?).pixel())
    }
}
