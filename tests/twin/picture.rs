//! A whole picture, and how two pictures compare.

use super::Result;
use super::camera::Camera;
use super::dataset::Dataset;
use super::interpolant::Interpolant;
use super::scene::{Interpolation, Samples, Scene};
use super::{march_cell, march_linear};

/// R, G, B, A row by row from the top.
#[derive(Debug, Clone)]
pub(crate) struct Picture {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) pixels: Vec<[f64; 4]>,
}

/// A row's number and its pixels.
type Row<'a> = (usize, &'a mut [[f64; 4]]);

/// How far one picture is from another.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Difference {
    /// Largest absolute difference of any channel over the reference's largest value.
    pub(crate) largest: f64,
    /// Mean absolute difference over the reference's largest value.
    pub(crate) mean: f64,
    /// Column and row of the largest difference.
    pub(crate) pixel: [usize; 2],
}

impl Picture {
    /// Renders `scene` on all processors.
    pub(crate) fn render(scene: &Scene, dataset: &Dataset) -> Result<Self> {
        let (width, height) = (scene.image.width, scene.image.height);
        let camera = Camera::new(scene, dataset)?;
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let mut pixels = vec![[0.0; 4]; width * height];
        let mut shares: Vec<Vec<Row<'_>>> = (0..threads).map(|_| vec![]).collect();
        for (row, line) in pixels.chunks_mut(width).enumerate() {
            shares[row % threads].push((row, line));
        }
        std::thread::scope(|scope| {
            let work = |share| scope.spawn(|| render_rows(scene, dataset, &camera, share));
            let workers: Vec<_> = shares.into_iter().map(work).collect();
            workers.into_iter().try_for_each(|worker| {
                worker.join().map_err(|_| "a render thread panicked".to_string())?
            })
        })?;
        Ok(Self { width, height, pixels })
    }

    /// The largest value of any channel.
    pub(crate) fn largest(&self) -> f64 {
        self.pixels.iter().flatten().fold(0.0, |largest: f64, value| largest.max(*value))
    }

    /// Whether at least half of the pixels differ from the one before them.
    pub(crate) fn is_varied(&self) -> bool {
        let changes = self.pixels.windows(2).filter(|pair| pair[0] != pair[1]).count();
        2 * changes >= self.pixels.len()
    }

    /// Compares `self` with the reference; a value that is no number counts as infinitely far.
    pub(crate) fn difference(&self, reference: &Self) -> Result<Difference> {
        if (self.width, self.height) != (reference.width, reference.height) {
            return Err("the pictures differ in size".into());
        }
        let scale = 1.0 / reference.largest();
        let mut difference = Difference { largest: 0.0, mean: 0.0, pixel: [0, 0] };
        for (n, (ours, theirs)) in self.pixels.iter().zip(&reference.pixels).enumerate() {
            for (a, b) in ours.iter().zip(theirs) {
                let error = if a.is_finite() { (a - b).abs() * scale } else { f64::INFINITY };
                difference.mean += error / (4 * self.pixels.len()) as f64;
                if error > difference.largest {
                    difference.largest = error;
                    difference.pixel = [n % self.width, n / self.width];
                }
            }
        }
        Ok(difference)
    }
}

fn render_rows(
    scene: &Scene,
    dataset: &Dataset,
    camera: &Camera,
    rows: Vec<Row<'_>>,
) -> Result<()> {
    let transfer = scene.transfer(dataset)?;
    let interpolant = Interpolant::new(dataset, &transfer);
    let Samples::Grid(n) = scene.samples()? else {
        return Err("averages over pixels are for the reference".into());
    };
    // The m-th ray of pixel i lies at i + (m + ½)/n pixels.
    let place = |i: usize, m: usize| [(2 * (i * n + m) + 1) as f64, (2 * n) as f64];
    for (row, line) in rows {
        for (column, pixel) in line.iter_mut().enumerate() {
            for sample in 0..n * n {
                let ray = camera.ray(place(column, sample % n), place(row, sample / n))?;
                let gathered = match scene.render.interpolation {
                    Interpolation::Cell => march_cell::march(dataset, &transfer, &ray),
                    Interpolation::Linear => march_linear::march(&interpolant, &transfer, &ray),
                };
                for (sum, value) in pixel.iter_mut().zip(gathered.pixel()) {
                    *sum += value / (n * n) as f64;
                }
            }
        }
    }
    Ok(())
}
