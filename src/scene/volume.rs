//! `[[volume]]`.

use super::colormap::ColorMap;
use super::entry::{Entry, Table};
use super::piecewise::PiecewiseLinear;
use super::scale::Scale;
use crate::Result;

/// The keys that a `[[volume]]` may have.
pub(super) const KEYS: [&str; 10] = [
    "field",
    "scale",
    "linthresh",
    "units",
    "range",
    "colormap",
    "color",
    "absorption",
    "emission",
    "color_field",
];

/// The colour map where a scene names none.
const DEFAULT_COLOR_MAP: &str = "magma";
/// Absorption where a scene gives none, (x, 1 / code length): a domain of width 1 in code length
/// goes from clear to nearly opaque.
const DEFAULT_ABSORPTION: [(f64, [f64; 1]); 2] = [(0.0, [0.0]), (1.0, [5.0])];

/// The units that a field's values, and so `range` and `linthresh`, are taken in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Units {
    /// The simulation's own.
    Code,
    /// Centimetres, grams, seconds.
    Cgs,
}

/// Linear RGB over the mapped value.
#[derive(Debug, Clone, PartialEq)]
pub enum ColorTable {
    /// A colour map by name.
    Map(ColorMap),
    /// The scene's own list.
    List(PiecewiseLinear<3>),
}

impl ColorTable {
    /// The colours as a function of x.
    pub fn table(&self) -> &PiecewiseLinear<3> {
        match self {
            Self::Map(map) => map.table(),
            Self::List(list) => list,
        }
    }
}

/// What is shown, and how its values become colours.
#[derive(Debug, Clone, PartialEq)]
pub struct VolumeSettings {
    /// The field's name, to be matched without regard to case.
    pub field: String,
    /// The scale of mapping and interpolation; log10 if not given.
    pub scale: Scale,
    /// The units of values; code units if not given.
    pub units: Units,
    /// Values that map to 0 and 1; without it the field's extrema over leaf cells.
    pub range: Option<[f64; 2]>,
    /// Colour, linear RGB.
    pub color: ColorTable,
    /// κ(x), 1 / code length.
    pub absorption: PiecewiseLinear,
    /// Radiance / code length, times the colour; without it the same as the absorption.
    pub emission: Option<PiecewiseLinear>,
}

impl VolumeSettings {
    /// Reads a `[[volume]]`.
    ///
    /// # Errors
    /// A missing or malformed key, and `color_field`, which is reserved.
    pub(super) fn parse(table: &Table<'_>) -> Result<Self> {
        if let Some(entry) = table.get("color_field") {
            return Err(entry.error("reserved: colour by another field is not supported yet"));
        }
        let scale = parse_scale(table)?;
        Ok(Self {
            field: parse_field(table.required("field")?)?,
            scale,
            units: table.get("units").map_or(Ok(Units::Code), |entry| {
                entry.choice(&[("code", Units::Code), ("cgs", Units::Cgs)])
            })?,
            range: table.get("range").map(|entry| parse_range(entry, scale)).transpose()?,
            color: parse_color(table)?,
            absorption: match table.get("absorption") {
                Some(entry) => parse_points(entry, |[x, value]| (x, [value]))?,
                None => PiecewiseLinear::new(&DEFAULT_ABSORPTION)?,
            },
            emission: table
                .get("emission")
                .map(|entry| parse_points(entry, |[x, value]| (x, [value])))
                .transpose()?,
        })
    }
}

/// What `table` says in vain: points of tables where no value is mapped to.
pub(super) fn in_vain(table: &Table<'_>, settings: &VolumeSettings) -> Vec<String> {
    let list = match &settings.color {
        ColorTable::List(list) => list.positions(),
        ColorTable::Map(_) => &[],
    };
    let emission = settings.emission.as_ref().map_or(&[][..], PiecewiseLinear::positions);
    [("absorption", settings.absorption.positions()), ("emission", emission), ("color", list)]
        .into_iter()
        .filter_map(|(key, positions)| {
            let x = positions.iter().find(|x| !(0.0..=1.0).contains(*x))?;
            let reason = format_args!(
                "no value reaches x = {x:?}: `range` is mapped to x from 0 to 1, and what lies beyond to \
                 its ends"
            );
            Some(table.get(key)?.error(reason).to_string())
        })
        .collect()
}

fn parse_field(entry: Entry<'_>) -> Result<String> {
    let name = entry.string()?;
    if name.trim().is_empty() {
        return Err(entry.error("the name of a field is expected"));
    }
    Ok(name.to_owned())
}

fn parse_scale(table: &Table<'_>) -> Result<Scale> {
    let linthresh = table.get("linthresh");
    let placeholder = Scale::Symlog { linthresh: 1.0 };
    let scale = match table.get("scale") {
        Some(entry) => entry.choice(&[
            ("linear", Scale::Linear),
            ("log10", Scale::Log10),
            ("symlog", placeholder),
        ])?,
        None => Scale::Log10,
    };
    match (scale, linthresh) {
        (Scale::Symlog { .. }, _) => {
            let entry = table.required("linthresh")?;
            let linthresh = entry.number()?;
            if linthresh <= 0.0 {
                return Err(entry.error(format_args!("must be above 0, not {linthresh}")));
            }
            Ok(Scale::Symlog { linthresh })
        }
        (_, Some(entry)) => Err(entry.error("goes with scale = \"symlog\" only; remove it")),
        (other, None) => Ok(other),
    }
}

fn parse_range(entry: Entry<'_>, scale: Scale) -> Result<[f64; 2]> {
    let [low, high] = entry.numbers::<2>()?;
    if low >= high {
        return Err(entry.error(format_args!(
            "the first value, {low}, must be below the second; to reverse colours use a `colormap` \
             whose name ends in _r"
        )));
    }
    if scale == Scale::Log10 && low <= 0.0 {
        return Err(entry.error(format_args!(
            "{low} has no logarithm; give a first value above 0 or another `scale`"
        )));
    }
    Ok([low, high])
}

fn parse_color(table: &Table<'_>) -> Result<ColorTable> {
    match (table.get("colormap"), table.get("color")) {
        (Some(_), Some(entry)) => {
            Err(entry.error("both `colormap` and `color` are given; remove one"))
        }
        (None, Some(entry)) => {
            parse_points(entry, |[x, r, g, b]| (x, [r, g, b])).map(ColorTable::List)
        }
        (Some(entry), None) => {
            let map = ColorMap::named(entry.string()?).map_err(|error| entry.error(error))?;
            Ok(ColorTable::Map(map))
        }
        (None, None) => ColorMap::named(DEFAULT_COLOR_MAP).map(ColorTable::Map),
    }
}

fn parse_points<const ROW: usize, const CHANNELS: usize>(
    entry: Entry<'_>,
    split: fn([f64; ROW]) -> (f64, [f64; CHANNELS]),
) -> Result<PiecewiseLinear<CHANNELS>> {
    let rows = entry.elements()?;
    let points: Vec<_> = rows.iter().map(|row| row.numbers().map(split)).collect::<Result<_>>()?;
    PiecewiseLinear::new(&points).map_err(|error| entry.error(error))
}
