//! A fly-by of a core smaller than a pixel.

use super::Result;
use super::cameras::{View, away, domain_size};
use super::dataset::Dataset;
use super::double_double::DoubleDouble;

/// Frames of the whole flight.
pub(crate) const FRAMES: usize = 100;
/// Distance from the core at the beginning and end, in lengths of the domain.
const DISTANCE: [f64; 2] = [1.4, 0.2];
/// Decades below the largest value down to which the core shines.
const CORE_DECADES: f64 = 1.5;
/// How far the core moves over the picture, of the view's height.
const DRIFT: f64 = 0.45;

/// A flight past a data set's densest cell.
pub(crate) struct Flight<'a> {
    dataset: &'a Dataset,
    pub(crate) size: [usize; 2],
    volume: String,
}

impl<'a> Flight<'a> {
    /// The densest cells shine so that the pixel that holds them outshines the cloud from the
    /// first frame on.
    pub(crate) fn new(dataset: &'a Dataset, size: [usize; 2]) -> Self {
        let top = dataset.maximum.log10();
        let bottom = dataset.smallest_positive.log10();
        let step = 1.0 - CORE_DECADES / (top - bottom);
        let limit = 10_f64.powf(top - CORE_DECADES);
        let domain = domain_size(dataset);
        let height = view_height(DISTANCE[0] * domain);
        let pixel = height / size[1] as f64;
        let core = 10.0 * pixel * pixel / volume_above(dataset, limit);
        let cloud = 3.0 / domain;
        let volume = format!(
            "scale = \"log10\"\nrange = [{:e}, {:e}]\ncolor = [[0.0, 0.1, 0.2, 0.6], [0.5, 0.8, 0.3, 0.1], [1.0, 1.0, 0.9, 0.8]]\n\
             absorption = [[0.0, 0.0], [{step:e}, {cloud:e}]]\n\
             emission = [[0.0, {:e}], [{step:e}, {:e}], [1.0, {core:e}]]\n",
            dataset.smallest_positive,
            dataset.maximum,
            0.1 * cloud,
            3.0 * cloud,
        );
        Self { dataset, size, volume }
    }

    /// The scene of a frame, `tolerance` absolute.
    pub(crate) fn frame(&self, number: usize, tolerance: f64) -> String {
        let part = number as f64 / (FRAMES - 1) as f64;
        let domain = domain_size(self.dataset);
        let distance = domain * DISTANCE[0] * (DISTANCE[1] / DISTANCE[0]).powf(part);
        let height = view_height(distance);
        let (level, densest) = self.dataset.densest();
        let core = self.dataset.point(level, densest, [0.5; 3]);
        let toward = [0.36, 0.48, -0.8];
        let sideways = [0.8, -0.6, 0.0];
        let target = away(&core, sideways, height * DRIFT * (2.0 * part - 1.0) * 0.9);
        let view = View {
            eye: away(&target, toward, distance),
            target,
            up: [0.1, 0.2, 1.0],
            height,
            distance,
            perspective: true,
            pixels: self.size[0],
            linear: true,
            volume: self.volume.clone(),
        };
        view.scene_with(self.size, &format!("{tolerance:e}"), "\"area\"")
    }
}

fn view_height(distance: f64) -> f64 {
    0.7 * distance
}

/// Volume of the leaf cells with values above `limit`, code length³.
fn volume_above(dataset: &Dataset, limit: f64) -> f64 {
    let root: f64 = dataset.root_cell_width().map(DoubleDouble::to_f64).iter().product();
    let above = |level: usize| {
        dataset.leaves(level).iter().filter(|(_, value)| *value >= limit).count() as f64
    };
    (0..=dataset.deepest()).map(|level| above(level) * root * (-3.0 * level as f64).exp2()).sum()
}

/// The brightest pixel, and how many times brighter it is than the median.
pub(crate) fn brightest(pixels: &[[f64; 4]]) -> Result<(usize, f64)> {
    let brightness = |pixel: &[f64; 4]| pixel[0] + pixel[1] + pixel[2];
    let values: Vec<f64> = pixels.iter().map(brightness).collect();
    let mut sorted = values.clone();
    sorted.sort_by(f64::total_cmp);
    let found = (0..values.len()).max_by(|a, b| values[*a].total_cmp(&values[*b]));
    let pixel = found.ok_or("a picture without pixels")?;
    Ok((pixel, values[pixel] / sorted[sorted.len() / 2]))
}
