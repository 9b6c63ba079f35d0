//! What is told of a picture that may not be as it was meant.

use super::output::warn;
use crate::cache::{Cache, CachedField};
use crate::render::stats::Stats;
use crate::render::{EXACT, Rendered};
use crate::scene::{Scale, Scene, Tolerance, Units};

/// What values are off by, relative, that are stored as f32.
const AS_F32: f64 = 1e-6;
/// The least that an f32 shows, which is no more than rounding of nothing.
const NOTHING: f64 = 1e-44;

/// Says so where the scene says something to no effect, or a tolerance under which it need not be drawn.
pub(super) fn of_scene(scene: &Scene, has_tolerance: bool) {
    scene.in_vain.iter().for_each(warn);
    let part = as_part(scene.render.tolerance);
    if has_tolerance && matches!(scene.render.tolerance, Tolerance::Relative(part) if part >= 1.0) {
        warn(format!(
            "the tolerance{part} is the largest value or more: a black picture is within it. Ask for less \
             than 100%"
        ));
    }
}

/// Says so where the tolerance is not kept.
pub(super) fn of_bound(Rendered { stats, film, .. }: &Rendered, cache: &Cache, scene: &Scene) {
    let largest = f64::from(film.largest_value());
    let is_lossy = field(cache, scene).is_some_and(|field| field.leaf_error > AS_F32);
    let tolerance = stats.tolerance.filter(|tolerance| *tolerance > 0.0).unwrap_or(EXACT * largest);
    if let Some(bound) = stats.error_bound
        && bound > tolerance.max(NOTHING)
    {
        let shown = format!("{tolerance:.2e}{}", as_part(scene.render.tolerance));
        warn(beyond(stats, is_lossy, bound, (tolerance, &shown)));
    }
}

/// A tolerance as it was asked for, if that is a part of the picture's largest value: ` (0.1%)`.
fn as_part(tolerance: Tolerance) -> String {
    match tolerance {
        Tolerance::Relative(0.0) | Tolerance::Absolute(_) => String::new(),
        // As many digits as were written: times 100 it may have more.
        Tolerance::Relative(part) => format!("{:.6e}", 100.0 * part)
            .parse()
            .map_or_else(|_| String::new(), |percent: f64| format!(" ({percent}%)")),
    }
}

/// That a bound is beyond the tolerance, which is shown as given, and what may be done about it.
fn beyond(stats: &Stats, is_lossy: bool, bound: f64, (tolerance, shown): (f64, &str)) -> String {
    let (cause, advice) = (cause(stats, is_lossy), other_advice(stats, is_lossy));
    // Of single rays nothing more is known than their bound.
    match stats.error_estimate.filter(|likely| *likely < bound) {
        Some(likely) if likely <= tolerance => format!(
            "not certified: as far as rays tell, pixels are within the tolerance of {shown} (off by up \
             to {likely:.2e}), but what is certain is {bound:.2e}{cause}: for a certificate ask for a \
             larger --tolerance{advice}"
        ),
        likely => {
            let likely = likely.map_or_else(String::new, |likely| {
                format!(" (as far as rays tell, by {likely:.2e})")
            });
            format!(
                "pixels may be off by {bound:.2e}, more than the tolerance of \
                 {shown}{likely}{cause}: ask for a larger --tolerance{advice}"
            )
        }
    }
}

/// What makes most of a bound.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Most {
    PixelArea,
    Storage,
    Other,
}

fn most_of_bound(stats: &Stats) -> Most {
    let shares = stats.error_shares.unwrap_or_default();
    let rest = shares.total() - shares.storage - shares.pixel_area;
    if shares.pixel_area >= rest.max(shares.storage) {
        Most::PixelArea
    } else if shares.storage >= rest {
        Most::Storage
    } else {
        Most::Other
    }
}

/// What of a bound does not show in the picture.
fn cause(stats: &Stats, is_lossy: bool) -> String {
    match stats.pixels_unsure.unwrap_or_default() {
        0 if most_of_bound(stats) == Most::Storage => {
            let storage = stats.error_shares.unwrap_or_default().storage;
            let why = if is_lossy { "of ingest --error" } else { "the cache holds values as f32" };
            format!(" ({storage:.2e} of it because {why})")
        }
        0 => String::new(),
        1 => "; 1 pixel may hold features that no ray has met".to_owned(),
        unsure => format!("; {unsure} pixels may hold features that no ray has met"),
    }
}

/// What else would bring the bound down, by what makes most of it.
fn other_advice(stats: &Stats, is_lossy: bool) -> &'static str {
    match most_of_bound(stats) {
        Most::PixelArea => " or for --samples N",
        Most::Storage if is_lossy => {
            ", for a cache without --error, or for a transfer function that is less steep"
        }
        Most::Storage => " or for a transfer function that is less steep",
        Most::Other => "",
    }
}

/// Says so where leaf cells of the field are NaN.
pub(super) fn of_nan(cache: &Cache, scene: &Scene) {
    if let Some(field) = field(cache, scene).filter(|field| field.nan_cells > 0) {
        warn(format!(
            "{}: {} leaf cells are NaN: they are drawn as the lower end of the range",
            field.name, field.nan_cells
        ));
    }
}

/// Says so where the scale shows values as others.
pub(super) fn of_log10(cache: &Cache, scene: &Scene) {
    let Some(field) = field(cache, scene).filter(|field| field.min <= 0.0) else { return };
    if scene.volume.scale == Scale::Log10 && field.min <= field.max {
        let shown = match field.smallest_positive {
            Some(_) => "has values <= 0, which log10 shows as its smallest positive value",
            None => "has no value above 0, and log10 shows none of it",
        };
        warn(format!(
            "{} {shown}: use scale = \"symlog\" with linthresh, or scale = \"linear\"",
            field.name
        ));
    }
}

/// Says so where nothing is seen, and what may be the reason.
pub(super) fn of_nothing(rendered: &Rendered, scene: &Scene, cache: &Cache) {
    if let (true, Some(field)) = (rendered.film.largest_value() == 0.0, field(cache, scene)) {
        warn(nothing_seen(&rendered.stats, field, scene.volume.units));
    }
}

fn nothing_seen(stats: &Stats, field: &CachedField, units: Units) -> String {
    let CachedField { name, min, max, .. } = field;
    let extrema = extrema(field, units);
    let reason = if stats.bricks_in_view == 0 {
        "no data is in view: see `position`, `look_at` and the domain, which `deepfield info` tells"
            .to_owned()
    } else if min > max {
        format!("no leaf cell has a value of {name}")
    } else if stats.bricks_skipped_transparent < stats.bricks_in_view {
        format!(
            "no ray met anything that shines or absorbs, which may lie between rays (see `samples`). \
             {extrema}: see `range`, `absorption` and `emission`"
        )
    } else {
        format!(
            "nothing in view shines or absorbs. {extrema}: see `range`, `absorption` and `emission`"
        )
    };
    format!("the picture is empty: {reason}")
}

/// From where to where a field goes, in the units in which the scene gives its `range`.
fn extrema(CachedField { name, min, max, to_cgs, units, .. }: &CachedField, of: Units) -> String {
    let (factor, unit) = match of {
        Units::Code => (1.0, "code units"),
        Units::Cgs => (to_cgs.unwrap_or(1.0), units.as_deref().unwrap_or("cgs")),
    };
    format!("{name} goes from {:.3e} to {:.3e} ({unit})", min * factor, max * factor)
}

fn field<'c>(cache: &'c Cache, scene: &Scene) -> Option<&'c CachedField> {
    let header = cache.header();
    header.field(&scene.volume.field).map(|index| &header.fields[index])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of a picture whose bound is made of these parts by pixels' areas, by levels and by storage.
    fn warning([pixel_area, levels, storage]: [f64; 3], estimate: f64, unsure: u64) -> String {
        let mut stats = Stats { pixels_unsure: Some(unsure), ..Stats::default() };
        stats.error_estimate = Some(estimate);
        let shares = stats.error_shares.insert(Default::default());
        (shares.pixel_area, shares.levels, shares.storage) = (pixel_area, levels, storage);
        beyond(&stats, false, pixel_area + levels + storage, (1e-3, "1.00e-3 (0.1%)"))
    }

    #[test]
    fn what_rays_tell_is_not_said_to_be_more() {
        let within = warning([1.5, 0.0, 0.0], 5e-4, 12);
        assert_eq!(
            within,
            "not certified: as far as rays tell, pixels are within the tolerance of 1.00e-3 (0.1%) (off \
             by up to 5.00e-4), but what is certain is 1.50e0; 12 pixels may hold features that no ray \
             has met: for a certificate ask for a larger --tolerance or for --samples N"
        );
        let beyond = warning([1.5, 0.0, 0.0], 1.5, 1);
        assert!(beyond.contains("(0.1%); 1 pixel may hold") && !beyond.contains("rays tell"));
    }

    #[test]
    fn rounding_of_what_is_stored_is_named_where_it_makes_the_bound() {
        let stored = warning([0.0, 1e-4, 5e-3], 5.1e-3, 0);
        assert!(
            stored.contains("(5.00e-3 of it because the cache holds values as f32)"),
            "{stored}"
        );
        assert!(!warning([0.0, 2e-2, 5e-3], 2.5e-2, 0).contains("f32"));
    }
}
