//! Named colour maps, read from the tables that the program is built with.

use std::path::Path;

use super::Result;

/// The entries of colour map `name` as `[x, r, g, b]`, linear RGB.
pub(crate) fn points(name: &str) -> Result<Vec<[f64; 4]>> {
    let tables = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/scene/colormaps");
    let file = tables.join(format!("{name}.in"));
    let text = std::fs::read_to_string(&file).map_err(|e| format!("{}: {e}", file.display()))?;
    let numbers = text.split(|c: char| !(c.is_ascii_digit() || "+-.eE".contains(c)));
    let encoded: Vec<f64> = numbers.filter_map(|word| word.parse().ok()).collect();
    if encoded.len() != 3 * 256 {
        return Err(format!("{}: {} numbers", file.display(), encoded.len()));
    }
    let entry = |(k, rgb): (usize, &[f64])| {
        [k as f64 / 255.0, linear(rgb[0]), linear(rgb[1]), linear(rgb[2])]
    };
    Ok(encoded.chunks_exact(3).enumerate().map(entry).collect())
}

/// Linear light of an sRGB-encoded value (IEC 61966-2-1).
fn linear(encoded: f64) -> f64 {
    if encoded > 0.04045 { ((encoded + 0.055) / 1.055).powf(2.4) } else { encoded / 12.92 }
}
