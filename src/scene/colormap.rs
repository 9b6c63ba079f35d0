//! Colour maps by name: tables of 256 sRGB entries (sources and licences: `colormaps/NOTICE`).

use super::entry::shown;
use super::piecewise::PiecewiseLinear;
use super::srgb::srgb_to_linear;
use crate::spelling::nearest_first;
use crate::{Error, Result};

/// Entries of every table.
const ENTRIES: usize = 256;
/// Names that are told where one is not known.
const NAMES_TOLD: usize = 6;

type Table = [[f64; 3]; ENTRIES];
/// Some entries of a table, with their numbers.
type Knots = [(u8, [f64; 3])];

static VIRIDIS: Table = include!("colormaps/viridis.in");
static MAGMA: Table = include!("colormaps/magma.in");
static INFERNO: Table = include!("colormaps/inferno.in");
static PLASMA: Table = include!("colormaps/plasma.in");
static CIVIDIS: Table = include!("colormaps/cividis.in");
static TURBO: Table = include!("colormaps/turbo.in");
static BATLOW: Table = include!("colormaps/batlow.in");
static LAJOLLA: Table = include!("colormaps/lajolla.in");
static OSLO: Table = include!("colormaps/oslo.in");
static DEVON: Table = include!("colormaps/devon.in");
static HAWAII: Table = include!("colormaps/hawaii.in");
static VIK: Table = include!("colormaps/vik.in");
static ROMA: Table = include!("colormaps/roma.in");
static BERLIN: Table = include!("colormaps/berlin.in");
static GRAY: Table = gray();

static TABLES: [(&str, &Table); 15] = [
    ("viridis", &VIRIDIS),
    ("magma", &MAGMA),
    ("inferno", &INFERNO),
    ("plasma", &PLASMA),
    ("cividis", &CIVIDIS),
    ("turbo", &TURBO),
    ("gray", &GRAY),
    ("batlow", &BATLOW),
    ("lajolla", &LAJOLLA),
    ("oslo", &OSLO),
    ("devon", &DEVON),
    ("hawaii", &HAWAII),
    ("vik", &VIK),
    ("roma", &ROMA),
    ("berlin", &BERLIN),
];

/// matplotlib's other maps, each as the entries between which the others are linear.
#[allow(clippy::approx_constant)] // No colour is meant to be one.
static KNOTS: &[(&str, &Knots)] = &include!("colormaps/matplotlib.in");

const fn gray() -> Table {
    let mut table = [[0.0; 3]; ENTRIES];
    let mut entry = 0;
    while entry < ENTRIES {
        table[entry] = [entry as f64 / 255.0; 3];
        entry += 1;
    }
    table
}

/// The names of all colour maps; each may be followed by `_r` for the reverse.
pub fn color_map_names() -> impl Iterator<Item = &'static str> {
    TABLES.iter().map(|(name, _)| *name).chain(KNOTS.iter().map(|(name, _)| *name))
}

/// The table of that name.
fn table(name: &str) -> Option<Table> {
    let whole = TABLES.iter().find_map(|(known, table)| (*known == name).then_some(**table));
    let knots = || KNOTS.iter().find_map(|(known, knots)| (*known == name).then_some(*knots));
    whole.or_else(|| knots().map(between))
}

/// All entries, linear between some.
fn between(knots: &Knots) -> Table {
    let mut table = [[0.0; 3]; ENTRIES];
    for pair in knots.windows(2) {
        let [(first, from), (last, to)] = [pair[0], pair[1]];
        for entry in first..=last {
            let share = f64::from(entry - first) / f64::from(last - first);
            let mixed = |c: usize| from[c] + (to[c] - from[c]) * share;
            table[usize::from(entry)] = std::array::from_fn(mixed);
        }
    }
    table
}

/// A named colour map in linear RGB: entry k of 256 stands at x = k / 255, linear between.
#[derive(Debug, Clone, PartialEq)]
pub struct ColorMap {
    name: String,
    table: PiecewiseLinear<3>,
}

impl ColorMap {
    /// The colour map called `name`, as in matplotlib: one of [`color_map_names`], `_r` behind it
    /// reverses, and `cmc.` before one of Crameri's is allowed.
    ///
    /// # Errors
    /// An unknown name; the message names the nearest.
    pub fn named(name: &str) -> Result<Self> {
        let plain = name.strip_prefix("cmc.").unwrap_or(name);
        let (plain, reversed) = match plain.strip_suffix("_r") {
            Some(forward) => (forward, true),
            None => (plain, false),
        };
        let table = table(plain).ok_or_else(|| unknown(name, plain))?;
        let entry = |k: usize| table[if reversed { ENTRIES - 1 - k } else { k }];
        let points = (0..ENTRIES).map(|k| (k as f64 / 255.0, entry(k).map(srgb_to_linear)));
        Ok(Self { name: name.to_owned(), table: PiecewiseLinear::from_sorted(points) })
    }

    /// The name it was asked for by.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Linear RGB over x in [0, 1].
    pub fn table(&self) -> &PiecewiseLinear<3> {
        &self.table
    }
}

fn unknown(name: &str, plain: &str) -> Error {
    let shown = shown(name);
    let mut near = nearest_first(plain, color_map_names());
    near.truncate(NAMES_TOLD);
    Error::request(format!(
        "unknown colour map `{shown}`; did you mean `{}`? (known are matplotlib's and some of \
         Crameri's; near: {}; `_r` reverses)",
        near.first().copied().unwrap_or_default(),
        near.join(", ")
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Entries 0, 100 and 255 as matplotlib 3.11.2 and cmcrameri 1.10 print them.
    #[test]
    fn entries_are_matplotlibs_in_linear_light() {
        for (name, entry, srgb) in [
            ("viridis", 0, [0.267004, 0.004874, 0.329415]),
            ("viridis", 100, [0.166617, 0.463708, 0.558119]),
            ("viridis", 255, [0.993248, 0.906157, 0.143936]),
            ("magma_r", 255, [0.001462, 0.000466, 0.013866]),
            ("turbo", 0, [0.18995, 0.07176, 0.23217]),
            ("cmc.batlow", 0, [0.005193, 0.098238, 0.349842]),
            ("gray", 51, [0.2, 0.2, 0.2]),
        ] {
            let found = ColorMap::named(name).unwrap().table.value(f64::from(entry) / 255.0);
            for (channel, encoded) in found.iter().zip(srgb) {
                assert!((channel - srgb_to_linear(encoded)).abs() < 1e-12, "{name} {entry}");
            }
        }
    }

    /// As matplotlib 3.11.2 prints them, of maps stored by some entries: to 1e-7 and what rounding adds.
    #[test]
    fn entries_between_others_are_matplotlibs() {
        for (name, entry, srgb) in [
            ("jet", 100, [0.13598988, 1.0, 0.83175206]),
            ("Blues", 200, [0.10249904, 0.40868897, 0.6828912]),
            ("tab10_r", 100, [0.89019608, 0.46666667, 0.76078431]),
            ("twilight", 100, [0.33566979, 0.12954074, 0.51142807]),
            ("cubehelix", 77, [0.1224721, 0.40198515, 0.25497905]),
        ] {
            let found = table(name.trim_end_matches("_r")).unwrap();
            let entry = if name.ends_with("_r") { ENTRIES - 1 - entry } else { entry };
            for (channel, expected) in found[entry].iter().zip(srgb) {
                assert!((channel - expected).abs() < 2e-7, "{name} {entry}: {channel} {expected}");
            }
        }
    }

    #[test]
    fn names_are_told_apart() {
        let names: Vec<_> = color_map_names().collect();
        assert!(names.iter().all(|name| !name.ends_with("_r")) && names.len() > 90);
        assert!((1..names.len()).all(|n| !names[..n].contains(&names[n])));
        assert!(KNOTS.iter().all(|(_, knots)| knots[0].0 == 0 && knots[knots.len() - 1].0 == 255));
    }

    #[test]
    fn every_map_is_light_and_reverses() {
        for name in color_map_names() {
            let map = ColorMap::named(name).unwrap();
            let reverse = ColorMap::named(&format!("{name}_r")).unwrap();
            assert_eq!(map.table.positions().len(), ENTRIES);
            assert!(map.table.values().iter().flatten().all(|v| (0.0..=1.0).contains(v)), "{name}");
            assert_eq!(map.table.values()[3], reverse.table.values()[252]);
        }
    }

    #[test]
    fn an_unknown_name_gets_the_nearest() {
        let message = ColorMap::named("virdis").unwrap_err().to_string();
        assert!(message.contains("did you mean `viridis`") && message.len() < 300, "{message}");
        assert!(ColorMap::named("").is_err() && ColorMap::named("_r").is_err());
    }
}
