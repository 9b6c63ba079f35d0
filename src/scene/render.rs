//! `[render]`.

use super::entry::{Entry, Table, shown};
use crate::{Error, Result};

/// The keys that `[render]` may have.
pub(super) const KEYS: [&str; 4] = ["interpolation", "tolerance", "samples", "background"];

/// Most rays per pixel and axis that `samples` may ask for.
pub const MAX_SAMPLES_PER_AXIS: u32 = 64;

/// What the field is between cell centres.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interpolation {
    /// Scaled values are interpolated between cell centres, continuous across levels.
    Linear,
    /// Constant in each leaf cell of the simulation.
    Cell,
}

/// The largest error of any channel of any pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Tolerance {
    /// In the picture's own unit; 0 is exact.
    Absolute(f64),
    /// A fraction of the picture's largest channel value: "0.1%" is 0.001.
    Relative(f64),
}

impl Tolerance {
    /// Parses a number ≥ 0 (absolute) or "p%" (relative).
    ///
    /// # Errors
    /// Anything else.
    pub fn parse(text: &str) -> Result<Self> {
        let trimmed = text.trim();
        let (digits, relative) = match trimmed.strip_suffix('%') {
            Some(digits) => (digits.trim_end(), true),
            None => (trimmed, false),
        };
        match digits.parse::<f64>() {
            Ok(number) if number.is_finite() && number >= 0.0 => {
                Ok(if relative { Self::Relative(number / 100.0) } else { Self::Absolute(number) })
            }
            _ => Err(Error::request(format!(
                "the tolerance is a number ≥ 0 (absolute) or \"p%\" (of the picture's largest \
                 value), not `{}`",
                shown(text)
            ))),
        }
    }
}

/// The truth that the tolerance refers to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Samples {
    /// The average over the pixel's area.
    Area,
    /// The mean of n×n rays at ((i + ½)/n, (j + ½)/n) of the pixel, n in 1..=64.
    Grid(u32),
}

impl Samples {
    /// Parses "area" or a whole number from 1 to [`MAX_SAMPLES_PER_AXIS`].
    ///
    /// # Errors
    /// Anything else.
    pub fn parse(text: &str) -> Result<Self> {
        match text.trim() {
            "area" => Ok(Self::Area),
            digits => digits
                .parse()
                .ok()
                .filter(|n| (1..=MAX_SAMPLES_PER_AXIS).contains(n))
                .map(Self::Grid)
                .ok_or_else(|| {
                    Error::request(format!(
                        "samples are \"area\" or a whole number from 1 to {MAX_SAMPLES_PER_AXIS}, \
                         not `{}`",
                        shown(text)
                    ))
                }),
        }
    }
}

/// How the picture is computed.
#[derive(Debug, Clone, PartialEq)]
pub struct RenderSettings {
    /// What the field is between cell centres.
    pub interpolation: Interpolation,
    /// How exact the picture must be, as written.
    pub tolerance: Tolerance,
    /// What it is compared to.
    pub samples: Samples,
    /// Linear RGB ≥ 0 behind everything, in PNG only.
    pub background: [f64; 3],
}

impl Default for RenderSettings {
    fn default() -> Self {
        Self {
            interpolation: Interpolation::Linear,
            tolerance: Tolerance::Relative(0.001),
            samples: Samples::Area,
            background: [0.0; 3],
        }
    }
}

impl RenderSettings {
    /// Reads `[render]`; keys that are missing have their defaults.
    ///
    /// # Errors
    /// A malformed key.
    pub(super) fn parse(table: &Table<'_>) -> Result<Self> {
        let mut settings = Self::default();
        if let Some(entry) = table.get("interpolation") {
            settings.interpolation = entry
                .choice(&[("linear", Interpolation::Linear), ("cell", Interpolation::Cell)])?;
        }
        if let Some(entry) = table.get("tolerance") {
            settings.tolerance = parsed(entry, Tolerance::parse)?;
        }
        if let Some(entry) = table.get("samples") {
            settings.samples = parsed(entry, Samples::parse)?;
        }
        if let Some(entry) = table.get("background") {
            settings.background = parse_background(entry)?;
        }
        Ok(settings)
    }
}

fn parsed<T>(entry: Entry<'_>, parse: fn(&str) -> Result<T>) -> Result<T> {
    parse(entry.number_or_string()?).map_err(|error| entry.error(error))
}

fn parse_background(entry: Entry<'_>) -> Result<[f64; 3]> {
    let color = entry.numbers::<3>()?;
    match color.iter().find(|channel| **channel < 0.0) {
        Some(channel) => Err(entry.error(format_args!("{channel:?} is negative"))),
        None => Ok(color),
    }
}
