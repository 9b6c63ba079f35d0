//! PNG files.

use std::io::{BufWriter, Write};
use std::path::Path;

use png::{BitDepth, ColorType, Encoder, EncodingError, SrgbRenderingIntent};

use crate::atomic_file::AtomicFile;
use crate::render::Film;
use crate::scene::linear_to_srgb;
use crate::{Error, Result};

/// Writes `film` to `file` as 8-bit sRGB: (pixel + (1 − A)·background)·2^exposure, clamped.
/// `exposure` is in stops, `background` in linear RGB. Memory beyond the film: a few rows.
///
/// # Errors
/// The system's, as a full disk; nothing is left there then.
pub fn write_png(file: AtomicFile, film: &Film, exposure: f64, background: [f64; 3]) -> Result<()> {
    let mut writer = BufWriter::new(file.file());
    write_image(&mut writer, film, exposure, background)
        .and_then(|()| Ok(writer.flush()?))
        .map_err(|error| failure(file.target(), error))?;
    drop(writer);
    file.commit()
}

fn failure(path: &Path, error: EncodingError) -> Error {
    match error {
        EncodingError::IoError(error) => Error::io(path, "cannot write the picture", error),
        other => Error::invalid(path.display(), format!("cannot write the picture: {other}")),
    }
}

fn write_image(
    writer: &mut impl Write,
    film: &Film,
    exposure: f64,
    background: [f64; 3],
) -> Result<(), EncodingError> {
    let mut encoder = Encoder::new(writer, film.width(), film.height());
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_source_srgb(SrgbRenderingIntent::Perceptual);
    let mut header = encoder.write_header()?;
    let mut stream = header.stream_writer()?;
    let gain = exposure.exp2();
    let mut bytes = Vec::new();
    for row in film.rows() {
        bytes.clear();
        bytes.extend(row.iter().flat_map(|pixel| encode(pixel, gain, background)));
        stream.write_all(&bytes)?;
    }
    stream.finish()?;
    header.finish()
}

/// The 8-bit sRGB value of a pixel over the background.
fn encode(pixel: &[f32; 4], gain: f64, background: [f64; 3]) -> [u8; 3] {
    let transmittance = 1.0 - f64::from(pixel[3]);
    std::array::from_fn(|channel| {
        let light = f64::from(pixel[channel]) + transmittance * background[channel];
        // In [0, 255]: `linear_to_srgb` clamps.
        (linear_to_srgb(light * gain) * 255.0).round() as u8
    })
}
