//! Options' values that clap has no parser for. What is none is wrong usage.

use crate::cache::BrickShape;
use crate::scene::{ImageSettings, Samples, Tolerance};
use crate::space::Decimal;
use crate::{Result, derive, source, synth};

/// A tolerance as text, for options that are handed on to another process.
pub(super) fn tolerance_text(text: &str) -> Result<String> {
    Tolerance::parse(text).map(|_| text.to_owned())
}

/// Rays a pixel as text, for options that are handed on to another process.
pub(super) fn samples_text(text: &str) -> Result<String> {
    Samples::parse(text).map(|_| text.to_owned())
}

/// A picture's size as text, for options that are handed on to another process.
pub(super) fn size_text(text: &str) -> Result<String> {
    ImageSettings::parse_size(text).map(|_| text.to_owned())
}

/// A relative error of stored values: from 0 up to, but not, 1.
pub(super) fn relative_error(text: &str) -> Result<f64, String> {
    number(text, |error| (0.0..1.0).contains(&error))
        .ok_or_else(|| "a relative error is at least 0 and below 1".to_owned())
}

/// Cells along a brick's edge.
pub(super) fn brick(text: &str) -> Result<u32, String> {
    let edge = text.parse().map_err(|_| "a brick's edge is a number of cells".to_owned())?;
    BrickShape::new(edge).map_err(|error| error.to_string())?;
    Ok(edge)
}

/// A corner of a box, `x,y,z`, in code length.
pub(super) fn corner(text: &str) -> Result<[Decimal; 3], String> {
    let numbers: Result<Vec<_>> = text.split(',').map(Decimal::parse).collect();
    numbers
        .map_err(|error| error.to_string())?
        .try_into()
        .map_err(|_| "a corner is three numbers, x,y,z".to_owned())
}

/// A part of something: above 0 and at most 1, or as many per cent.
pub(super) fn part(text: &str) -> Result<f64, String> {
    let is_part = |part: f64| part > 0.0 && part <= 1.0;
    let part = match text.trim().strip_suffix('%') {
        Some(percent) => number(percent, |percent| is_part(percent / 100.0)).map(|p| p / 100.0),
        None => number(text, is_part),
    };
    part.ok_or_else(|| "a part is a number above 0 and at most 1, or as many per cent".to_owned())
}

/// The name of a format that can be read.
pub(super) fn read_format(text: &str) -> Result<String> {
    source::check_format(text).map(|()| text.to_owned())
}

/// The name of a format that can be written.
pub(super) fn written_format(text: &str) -> Result<String> {
    synth::check_format(text).map(|()| text.to_owned())
}

/// The definition of a derived field.
pub(super) fn definition(text: &str) -> Result<String, String> {
    derive::check_definition(text).map(|()| text.to_owned())
}

/// A number above 0.
pub(super) fn positive(text: &str) -> Result<f64, String> {
    number(text, |number| number > 0.0).ok_or_else(|| "a number above 0 is needed".to_owned())
}

/// A number, but not NaN.
pub(super) fn no_nan(text: &str) -> Result<f64, String> {
    let number = text.trim().parse().ok().filter(|number: &f64| !number.is_nan());
    number.ok_or_else(|| "a number is needed".to_owned())
}

fn number(text: &str, is_allowed: impl Fn(f64) -> bool) -> Option<f64> {
    text.trim().parse().ok().filter(|number: &f64| number.is_finite() && is_allowed(*number))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_value_is_refused() {
        assert_eq!(relative_error("1e-3"), Ok(1e-3));
        assert!(
            ["1", "-1e-9", "NaN", "much"].into_iter().all(|text| relative_error(text).is_err())
        );
        assert_eq!(brick("16"), Ok(16));
        assert!(["12", "0", "-8", "16.0"].into_iter().all(|text| brick(text).is_err()));
        assert!(corner("0.1, -2,3e-4").is_ok());
        assert!(["1,2", "1,2,3,4", "1,2,z", ""].into_iter().all(|text| corner(text).is_err()));
        assert_eq!((part(" 1"), part("1 %"), part("100%")), (Ok(1.0), Ok(0.01), Ok(1.0)));
        assert!(
            ["0", "1.5", "inf", "101%", "-1%", "%"].into_iter().all(|text| part(text).is_err())
        );
        assert_eq!(positive("2.5"), Ok(2.5));
        assert!(["0", "-1", "inf", "NaN"].into_iter().all(|text| positive(text).is_err()));
        assert_eq!(no_nan("-inf"), Ok(f64::NEG_INFINITY));
        assert!(no_nan("NaN").is_err());
    }
}
