//! The rival: settings picked by hand, the same for the whole picture.

use super::measure::{Bench, Measured};
use crate::Result;
use crate::cli::progress::Bar;
use crate::render::FixedSetting;
use crate::scene::Samples;

/// Largest cells, pixels; 0: all levels.
const PIXELS: [f64; 5] = [0.0, 0.5, 1.0, 2.0, 4.0];
/// Rays along a pixel's axis, for the average over its area.
const RAYS: [u32; 6] = [1, 2, 3, 4, 6, 8];
/// Relative accuracies of the march.
const ACCURACIES: [f64; 2] = [0.0, 1e-3];
/// Of the settings that reach an error, as many are timed again: the fastest.
const TIMED_AGAIN: usize = 2;

/// A setting and its picture.
#[derive(Debug, Clone)]
pub(super) struct Rival {
    /// The setting.
    pub(super) setting: FixedSetting,
    /// Its picture.
    pub(super) measured: Measured,
}

/// All settings, each rendered once.
///
/// # Errors
/// Whatever a render says.
pub(super) fn measure_all(bench: &Bench<'_>, samples: Samples) -> Result<Vec<Rival>> {
    let (bar, settings) = (Bar::new("fixed", "settings"), grid(samples));
    let total = settings.len() as u64;
    let rival = |(done, setting): (u64, FixedSetting)| {
        bar.show("fixed", done, total);
        Ok(Rival { setting, measured: bench.measure(options(&setting))? })
    };
    (0..total).zip(settings).map(rival).collect()
}

/// Times the rivals again that may be the best at one of these `errors`.
///
/// # Errors
/// Whatever a render says.
pub(super) fn time_again(bench: &Bench<'_>, rivals: &mut [Rival], errors: &[f64]) -> Result<()> {
    rivals.sort_by(|a, b| a.measured.seconds.total_cmp(&b.measured.seconds));
    let mut chosen: Vec<usize> = errors
        .iter()
        .flat_map(|error| {
            let reaching = (0..rivals.len()).filter(|n| rivals[*n].measured.error <= *error);
            reaching.take(TIMED_AGAIN).collect::<Vec<_>>()
        })
        .collect();
    chosen.sort_unstable();
    chosen.dedup();
    chosen.into_iter().try_for_each(|n| bench.time_again(&mut rivals[n].measured))
}

/// The fastest whose error is at most `error`.
pub(super) fn best(rivals: &[Rival], error: f64) -> Option<&Rival> {
    let reaching = rivals.iter().filter(|rival| rival.measured.error <= error);
    reaching.min_by(|a, b| a.measured.seconds.total_cmp(&b.measured.seconds))
}

/// All settings that make sense: other rays than the truth's own would miss it.
fn grid(samples: Samples) -> Vec<FixedSetting> {
    let rays = match samples {
        Samples::Area => RAYS.to_vec(),
        Samples::Grid(rays) => vec![rays],
    };
    let mut settings = Vec::new();
    for pixels_per_cell in PIXELS {
        for rays_per_axis in rays.iter().copied() {
            for relative_accuracy in ACCURACIES {
                settings.push(FixedSetting { pixels_per_cell, rays_per_axis, relative_accuracy });
            }
        }
    }
    settings
}

fn options(setting: &FixedSetting) -> Vec<String> {
    let FixedSetting { pixels_per_cell, rays_per_axis, relative_accuracy } = setting;
    vec![format!("--fixed={pixels_per_cell},{rays_per_axis},{relative_accuracy}")]
}
