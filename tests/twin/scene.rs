//! Scene files, as far as the twin needs them; any other key is refused.

use serde::Deserialize;

use super::Result;
use super::colormap;
use super::dataset::Dataset;
use super::exact::{self, Rational};
use super::transfer::{Scale, Table, Transfer};

/// A scene file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Scene {
    pub(crate) image: Image,
    pub(crate) camera: Camera,
    pub(crate) render: Render,
    volume: Vec<Volume>,
}

/// Pixels across and down.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Image {
    pub(crate) width: usize,
    pub(crate) height: usize,
}

/// `fov` in degrees, `height` in code length.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Camera {
    pub(crate) projection: Projection,
    position: [toml::Value; 3],
    look_at: [toml::Value; 3],
    up: [toml::Value; 3],
    pub(crate) fov: Option<f64>,
    pub(crate) height: Option<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Projection {
    Perspective,
    Orthographic,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Interpolation {
    Cell,
    Linear,
}

/// What a pixel is: the mean of n×n rays, or over its area.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Samples {
    Grid(usize),
    Area,
}

/// The tolerance is read past: the twin is always exact.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Render {
    pub(crate) interpolation: Interpolation,
    #[serde(rename = "tolerance")]
    _tolerance: toml::Value,
    samples: toml::Value,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Volume {
    field: String,
    scale: String,
    linthresh: Option<f64>,
    range: Option<[f64; 2]>,
    color: Option<Vec<[f64; 4]>>,
    colormap: Option<String>,
    absorption: Vec<[f64; 2]>,
    emission: Option<Vec<[f64; 2]>>,
}

impl Scene {
    pub(crate) fn parse(text: &str) -> Result<Self> {
        let scene: Self = toml::from_str(text).map_err(|error| error.to_string())?;
        if scene.volume.len() == 1 { Ok(scene) } else { Err("expected one volume".into()) }
    }

    /// The truth of a pixel.
    pub(crate) fn samples(&self) -> Result<Samples> {
        match &self.render.samples {
            toml::Value::Integer(n @ 1..) => Ok(Samples::Grid(*n as usize)),
            toml::Value::String(text) if text == "area" => Ok(Samples::Area),
            other => Err(format!("`{other}` are no samples")),
        }
    }

    /// Name of the field that is drawn.
    pub(crate) fn field(&self) -> &str {
        &self.volume[0].field
    }

    /// How the volume's values become colour; extrema and floors are `dataset`'s.
    pub(crate) fn transfer(&self, dataset: &Dataset) -> Result<Transfer> {
        let volume = &self.volume[0];
        let scale = match (volume.scale.as_str(), volume.linthresh) {
            ("linear", None) => Scale::Linear,
            ("log10", None) => Scale::Log10 { floor: dataset.smallest_positive },
            ("symlog", Some(threshold)) => Scale::SymLog { threshold },
            (other, _) => return Err(format!("scale `{other}` or its linthresh")),
        };
        let default_range = [scale.raised(dataset.minimum), scale.raised(dataset.maximum)];
        let absorption = table(&volume.absorption)?;
        let emission = volume.emission.as_ref().map_or(Ok(absorption.clone()), |t| table(t))?;
        let points = match (&volume.color, &volume.colormap) {
            (Some(points), None) => points.clone(),
            (None, Some(name)) => colormap::points(name)?,
            _ => return Err("a volume takes color or colormap".into()),
        };
        let channel = |c: usize| Table::new(points.iter().map(|p| (p[0], p[1 + c])).collect());
        let color = [channel(0)?, channel(1)?, channel(2)?];
        Transfer::new(scale, volume.range.unwrap_or(default_range), absorption, emission, color)
    }
}

fn table(points: &[[f64; 2]]) -> Result<Table> {
    Table::new(points.iter().map(|p| (p[0], p[1])).collect())
}

impl Camera {
    /// The eye (orthographic: the middle of the view), code length.
    pub(crate) fn position(&self) -> Result<[Rational; 3]> {
        coordinates(&self.position)
    }

    pub(crate) fn look_at(&self) -> Result<[Rational; 3]> {
        coordinates(&self.look_at)
    }

    pub(crate) fn up(&self) -> Result<[Rational; 3]> {
        coordinates(&self.up)
    }
}

/// Each a string or a number; a number means its shortest decimal form.
fn coordinates(values: &[toml::Value; 3]) -> Result<[Rational; 3]> {
    let coordinate = |a: usize| match &values[a] {
        toml::Value::String(text) => exact::from_decimal(text),
        toml::Value::Float(number) => exact::from_decimal(&format!("{number:e}")),
        toml::Value::Integer(number) => exact::from_decimal(&number.to_string()),
        other => Err(format!("`{other}` is no coordinate")),
    };
    Ok([coordinate(0)?, coordinate(1)?, coordinate(2)?])
}
