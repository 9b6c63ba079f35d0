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
/// How many of the settings that reach an error are timed again: the fastest ones.
const TIMED_AGAIN: usize = 2;

/// A rival this many times as slow as the slowest of what it is compared with has lost.
const TOO_SLOW: f64 = 2.0;

/// A setting and its picture.
#[derive(Debug, Clone)]
pub(super) struct Rival {
    /// The setting.
    pub(super) setting: FixedSetting,
    /// Its picture.
    pub(super) measured: Measured,
}

/// What rivals are tried for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Goal {
    /// The least error that they need to reach.
    pub(super) error: f64,
    /// The time of which more than [`TOO_SLOW`] times is no rival's, seconds.
    pub(super) seconds: f64,
}

/// All settings by which the fastest that reaches some error can be told, each rendered once.
/// More rays take longer: they are not tried where fewer reach the goal, or are too slow already;
/// nor are as many as the reference has, which would be compared with themselves.
///
/// # Errors
/// Whatever a render says.
pub(super) fn measure_all(bench: &Bench<'_>, samples: Samples, goal: Goal) -> Result<Vec<Rival>> {
    let bar = Bar::new("fixed", "settings");
    let (families, mut rivals) = (families(samples, bench.reference.rays), Vec::new());
    for (done, family) in (0..).zip(&families) {
        bar.show("fixed", done, families.len() as u64);
        for setting in family {
            let measured = bench.measure(options(setting))?;
            let is_enough =
                measured.error <= goal.error || measured.seconds > TOO_SLOW * goal.seconds;
            rivals.push(Rival { setting: *setting, measured });
            if is_enough {
                break;
            }
        }
    }
    Ok(rivals)
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

/// All settings that make sense (other rays than the truth's own would miss it), those that differ
/// in their rays alone together.
fn families(samples: Samples, most_rays: u32) -> Vec<Vec<FixedSetting>> {
    let rays = match samples {
        Samples::Area => RAYS.iter().copied().filter(|rays| *rays < most_rays).collect(),
        Samples::Grid(rays) => vec![rays],
    };
    let family = |pixels_per_cell: f64, relative_accuracy: f64| {
        let setting =
            |&rays_per_axis| FixedSetting { pixels_per_cell, rays_per_axis, relative_accuracy };
        rays.iter().map(setting).collect()
    };
    PIXELS.iter().flat_map(|pixels| ACCURACIES.map(|accuracy| family(*pixels, accuracy))).collect()
}

fn options(setting: &FixedSetting) -> Vec<String> {
    let FixedSetting { pixels_per_cell, rays_per_axis, relative_accuracy } = setting;
    vec![format!("--fixed={pixels_per_cell},{rays_per_axis},{relative_accuracy}")]
}
