//! The formulas of the density's components.

use glam::DVec3;

use crate::synth::noise::{NoiseMemory, fractal_noise};
use crate::synth::recipe::{Component, Spiral, Texture};

/// What a component adds at `offset` from its origin (a filament's reaches `along` from there).
pub(super) fn additive(
    component: &Component,
    offset: DVec3,
    along: DVec3,
    seed: u64,
    memory: &mut NoiseMemory,
) -> f64 {
    match component {
        Component::Constant { value } => *value,
        Component::Gradient { value, slope } => value + DVec3::from_array(*slope).dot(offset),
        Component::Core { peak, radius, slope, stretch, spiral, texture, .. } => {
            let scaled = offset / DVec3::from_array(*stretch) / *radius;
            let square = scaled.length_squared();
            let exponent = structure(scaled, square, *spiral, *texture, seed, memory);
            peak * decline(square, *slope) * if exponent == 0.0 { 1.0 } else { exponent.exp() }
        }
        Component::PowerLaw { value, slope, inner, .. } => {
            value * offset.length().max(*inner).powf(-slope)
        }
        Component::Gaussian { peak, sigma, .. } => {
            peak * (-0.5 * (offset / *sigma).length_squared()).exp()
        }
        Component::Filament { peak, radius, slope, .. } => {
            let t = (offset.dot(along) / along.length_squared()).clamp(0.0, 1.0);
            let nearest = if t.is_nan() { DVec3::ZERO } else { along * t };
            peak * decline(((offset - nearest) / *radius).length_squared(), *slope)
        }
        Component::Turbulence { .. } | Component::Grain { .. } => 0.0,
    }
}

/// `(1 + square)^(−slope/2)`, without powf for the common slopes.
fn decline(square: f64, slope: f64) -> f64 {
    let base = 1.0 + square;
    if slope == 2.0 {
        1.0 / base
    } else if slope == 4.0 {
        1.0 / (base * base)
    } else {
        base.powf(-0.5 * slope)
    }
}

/// What spiral arms and texture add to a core's exponent; both fade inside the core's radius,
/// where the direction means nothing.
fn structure(
    scaled: DVec3,
    square: f64,
    spiral: Option<Spiral>,
    texture: Option<Texture>,
    seed: u64,
    memory: &mut NoiseMemory,
) -> f64 {
    if (spiral.is_none() && texture.is_none()) || square == 0.0 {
        return 0.0;
    }
    let log_radius = 0.5 * square.ln();
    let fade = square / (1.0 + square);
    let arms = spiral.map_or(0.0, |s| {
        let angle = scaled.y.atan2(scaled.x);
        s.amplitude * (f64::from(s.arms) * angle - s.pitch * log_radius).cos()
    });
    let noise = texture.map_or(0.0, |t| {
        let direction = scaled / square.sqrt();
        let point = (direction + log_radius * DVec3::new(0.6, 0.64, 0.48)) * t.frequency;
        t.amplitude * fractal_noise(point, 4, 0.5, seed ^ 0x7e87, memory)
    });
    fade * (arms + noise)
}
