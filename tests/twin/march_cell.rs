//! Emission and absorption along a ray through cells of constant value, in closed form.

use super::dataset::Dataset;
use super::transfer::Transfer;
use super::walk::Ray;

/// Optical depth behind which nothing can be seen in a double.
pub(crate) const OPAQUE: f64 = 60.0;

/// What has been gathered along a ray, front to back.
#[derive(Debug, Default, Clone, Copy)]
pub(crate) struct Gathered {
    pub(crate) radiance: [f64; 3],
    pub(crate) optical_depth: f64,
}

impl Gathered {
    /// Linear RGB and 1 − transmittance.
    pub(crate) fn pixel(&self) -> [f64; 4] {
        let [r, g, b] = self.radiance;
        [r, g, b, -(-self.optical_depth).exp_m1()]
    }
}

/// The picture of one ray.
pub(crate) fn march(dataset: &Dataset, transfer: &Transfer, ray: &Ray) -> Gathered {
    let mut gathered = Gathered::default();
    ray.walk(dataset, &mut |segment| {
        let Some(cell) = dataset.cell(segment.level, segment.index) else { return true };
        let optics = transfer.optics(transfer.map(transfer.scaled(cell.value)));
        let depth = optics.extinction * segment.length();
        // ∫ e^(−κ s) ds over the segment.
        let seen = if depth == 0.0 {
            segment.length()
        } else {
            segment.length() * (-(-depth).exp_m1() / depth)
        };
        let weight = (-gathered.optical_depth).exp() * optics.emission * seen;
        for (channel, color) in gathered.radiance.iter_mut().zip(optics.color) {
            *channel += weight * color;
        }
        gathered.optical_depth += depth;
        gathered.optical_depth < OPAQUE
    });
    gathered
}
