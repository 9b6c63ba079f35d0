//! The sRGB transfer curve (IEC 61966-2-1).

/// Linear light, [0, 1], of an sRGB-encoded value in [0, 1].
pub fn srgb_to_linear(encoded: f64) -> f64 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// sRGB encoding, [0, 1], of linear light: clamped to [0, 1], NaN as 0.
pub fn linear_to_srgb(linear: f64) -> f64 {
    if linear.is_nan() || linear <= 0.0 {
        0.0
    } else if linear <= 0.003_130_8 {
        12.92 * linear
    } else {
        (1.055 * linear.min(1.0).powf(1.0 / 2.4) - 0.055).min(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values_and_round_trip() {
        assert!((srgb_to_linear(0.5) - 0.214_041_140_482_232_6).abs() < 1e-15);
        assert!((srgb_to_linear(0.04) - 0.04 / 12.92).abs() < 1e-18);
        assert!((srgb_to_linear(1.0) - 1.0).abs() < 1e-15);
        for step in 0..=1000 {
            let encoded = f64::from(step) / 1000.0;
            assert!((linear_to_srgb(srgb_to_linear(encoded)) - encoded).abs() < 1e-6);
        }
        assert_eq!(linear_to_srgb(f64::NAN), 0.0);
        assert_eq!(linear_to_srgb(-1.0), 0.0);
        assert!((linear_to_srgb(f64::INFINITY) - 1.0).abs() < 1e-15);
    }
}
