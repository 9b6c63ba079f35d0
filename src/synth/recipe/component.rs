//! Components of the density model, as recipes state them.

use serde::Deserialize;

use super::Coordinate;
use crate::{Error, Result};

/// One `[[density]]` entry. Lengths are code lengths, `r` the distance from `centre`.
#[derive(Debug, Clone, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Component {
    /// Adds `value` everywhere.
    Constant {
        /// The value.
        value: f64,
    },
    /// Adds a linear function of the offset from the domain's left edge.
    Gradient {
        /// At the domain's left edge.
        value: f64,
        /// Change per code length along each axis.
        slope: [f64; 3],
    },
    /// Adds `peak·(1 + r²/radius²)^(−slope/2)`; `slope` 5 is Plummer's sphere.
    Core {
        /// Where the core lies.
        centre: [Coordinate; 3],
        /// At the centre.
        peak: f64,
        /// Where it becomes steep.
        radius: f64,
        /// Power of the decline far out.
        slope: f64,
        /// Stretch along each axis.
        #[serde(default = "unstretched")]
        stretch: [f64; 3],
        /// Spiral arms in the plane z = 0 about the centre.
        spiral: Option<Spiral>,
        /// Noise that looks the same at every distance from the centre.
        texture: Option<Texture>,
    },
    /// Adds `value·max(r, inner)^(−slope)`.
    PowerLaw {
        /// Where it peaks.
        centre: [Coordinate; 3],
        /// At r = 1.
        value: f64,
        /// Power of the decline.
        slope: f64,
        /// Radius inside which it is constant.
        inner: f64,
    },
    /// Adds `peak·exp(−r²/(2·sigma²))`.
    Gaussian {
        /// Where it peaks.
        centre: [Coordinate; 3],
        /// At the centre.
        peak: f64,
        /// Standard deviation.
        sigma: f64,
    },
    /// Adds `peak·(1 + d²/radius²)^(−slope/2)`, `d` the distance from a line segment.
    Filament {
        /// One end.
        from: [Coordinate; 3],
        /// The other end.
        to: [Coordinate; 3],
        /// On the segment.
        peak: f64,
        /// Where it becomes steep.
        radius: f64,
        /// Power of the decline far out.
        slope: f64,
    },
    /// Multiplies the sum by the exponential of octaves of smooth noise.
    Turbulence {
        /// Lattice spacing of the first octave.
        scale: f64,
        /// Number of octaves, each at half the spacing of the one before.
        octaves: u32,
        /// Amplitude of the first octave in the exponent.
        amplitude: f64,
        /// Amplitude of an octave relative to the one before.
        persistence: f64,
    },
    /// Multiplies each cell by 1 + amplitude·(white noise in [−1, 1)).
    Grain {
        /// Relative amplitude.
        amplitude: f64,
    },
}

/// Logarithmic spiral arms: the exponent gains `amplitude·cos(arms·φ − pitch·ln r)`.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spiral {
    /// Number of arms.
    pub arms: u32,
    /// Turns of phase per e-folding of the radius, radians.
    pub pitch: f64,
    /// Amplitude in the exponent.
    pub amplitude: f64,
}

/// Noise of direction and ln r: the exponent gains `amplitude·noise(frequency·direction, ln r)`.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Texture {
    /// Lattice points per radian.
    pub frequency: f64,
    /// Amplitude in the exponent.
    pub amplitude: f64,
}

fn unstretched() -> [f64; 3] {
    [1.0; 3]
}

impl Component {
    /// Refuses numbers of which no density can be made.
    pub(super) fn validate(&self) -> Result<()> {
        let (lengths, others) = self.numbers();
        for (name, length) in lengths {
            if !(length.is_finite() && length > 0.0) {
                let reason = format!("density: {name} is {length}: it must be positive");
                return Err(Error::request(reason));
            }
        }
        if let Some(other) = others.into_iter().find(|number| !number.is_finite()) {
            return Err(Error::request(format!("density: {other} is no number that fits")));
        }
        match self {
            Self::Turbulence { octaves, .. } if *octaves > 32 => {
                Err(Error::request("density: turbulence.octaves: at most 32"))
            }
            _ => Ok(()),
        }
    }

    /// Numbers that must be positive, with their names, and those that must be finite.
    fn numbers(&self) -> (Vec<(&'static str, f64)>, Vec<f64>) {
        match *self {
            Self::Constant { value } => (vec![], vec![value]),
            Self::Gradient { value, slope: [x, y, z] } => (vec![], vec![value, x, y, z]),
            Self::Grain { amplitude } => (vec![], vec![amplitude]),
            Self::Core { radius, stretch, peak, slope, spiral, texture, .. } => {
                let mut lengths = vec![("core.radius", radius)];
                lengths.extend(stretch.map(|s| ("core.stretch", s)));
                let mut others = vec![peak, slope];
                others.extend(spiral.iter().flat_map(|s| [s.pitch, s.amplitude]));
                others.extend(texture.iter().flat_map(|t| [t.frequency, t.amplitude]));
                (lengths, others)
            }
            Self::PowerLaw { inner, value, slope, .. } => {
                (vec![("power_law.inner", inner)], vec![value, slope])
            }
            Self::Gaussian { sigma, peak, .. } => (vec![("gaussian.sigma", sigma)], vec![peak]),
            Self::Filament { radius, peak, slope, .. } => {
                (vec![("filament.radius", radius)], vec![peak, slope])
            }
            Self::Turbulence { scale, amplitude, persistence, .. } => {
                (vec![("turbulence.scale", scale)], vec![amplitude, persistence])
            }
        }
    }
}
