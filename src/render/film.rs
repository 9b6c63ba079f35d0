//! The picture in memory.

use crate::{Error, Result};

/// A picture of W×H pixels of R, G, B (linear radiance) and A (1 − transmittance), row 0 on top,
/// column 0 left. Radiance is what reaches the eye, so it is premultiplied, without background.
#[derive(Debug, PartialEq)]
pub struct Film {
    width: u32,
    height: u32,
    pixels: Vec<[f32; 4]>,
}

impl Film {
    /// Bytes of memory that a film of this size takes.
    pub fn bytes_needed(width: u32, height: u32) -> u64 {
        // 2⁶⁴ pixels of 16 bytes would not fit; no such film can be asked for.
        (u64::from(width) * u64::from(height)).saturating_mul(16)
    }

    /// A black, transparent film; all its memory is taken now.
    ///
    /// # Errors
    /// A side of 0 pixels, and more memory than the system gives.
    pub fn new(width: u32, height: u32) -> Result<Self> {
        let bytes = Self::bytes_needed(width, height);
        if bytes == 0 {
            return Err(Error::request(format!("a picture of {width}×{height} has no pixels")));
        }
        let refuse = || {
            let mebibytes = bytes.div_ceil(1 << 20);
            Error::request(format!(
                "a picture of {width}×{height} takes {mebibytes}MiB, 16 bytes a pixel, which the system \
                 does not have; ask for a smaller `width` or `height`"
            ))
        };
        let count = usize::try_from(bytes / 16).map_err(|_| refuse())?;
        let mut pixels = Vec::new();
        pixels.try_reserve_exact(count).map_err(|_| refuse())?;
        pixels.resize(count, [0.0; 4]);
        Ok(Self { width, height, pixels })
    }

    /// Pixels in a row.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// All pixels, row after row.
    pub fn pixels(&self) -> &[[f32; 4]] {
        &self.pixels
    }

    /// The rows from the top, each of W pixels.
    pub fn rows(&self) -> impl ExactSizeIterator<Item = &[[f32; 4]]> {
        self.pixels.chunks_exact(self.width as usize)
    }

    /// Sets a rectangle of `width` columns whose upper left pixel is (`left`, `top`); `pixels` are
    /// its rows one after another.
    ///
    /// # Errors
    /// Pixels that do not fill whole rows, and a rectangle that does not lie inside the film.
    pub fn write_rectangle(
        &mut self,
        left: u32,
        top: u32,
        width: u32,
        pixels: &[[f32; 4]],
    ) -> Result<()> {
        let columns = width as usize;
        let rows = pixels.len().checked_div(columns).unwrap_or(0);
        let inside = left.checked_add(width).is_some_and(|right| right <= self.width)
            && (top as usize).checked_add(rows).is_some_and(|end| end <= self.height as usize);
        if rows * columns != pixels.len() || !inside {
            let (film, count) = (format!("{}×{}", self.width, self.height), pixels.len());
            return Err(Error::request(format!(
                "{count} pixels in rows of {width} at ({left}, {top}) do not fit a picture of {film}"
            )));
        }
        if columns == 0 {
            return Ok(());
        }
        let first = top as usize * self.width as usize;
        let film_rows = self.pixels[first..].chunks_exact_mut(self.width as usize);
        for (target, source) in film_rows.zip(pixels.chunks_exact(columns)) {
            target[left as usize..left as usize + columns].copy_from_slice(source);
        }
        Ok(())
    }

    /// The largest value of any channel of any pixel; 0 is the least, NaN more than any.
    pub fn largest_value(&self) -> f32 {
        // `f32::max` passes over NaN; channel by channel, several at a time.
        let (mut most, mut are_numbers) = ([0.0_f32; 4], true);
        for pixel in &self.pixels {
            for (most, value) in most.iter_mut().zip(pixel) {
                *most = if value > most { *value } else { *most };
                are_numbers &= !value.is_nan();
            }
        }
        if are_numbers { most.into_iter().fold(0.0, f32::max) } else { f32::NAN }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectangles_land_where_they_belong() {
        let mut film = Film::new(5, 4).unwrap();
        let pixels: Vec<[f32; 4]> = (1..=6u8).map(|n| [f32::from(n); 4]).collect();
        film.write_rectangle(3, 1, 2, &pixels).unwrap();
        let red: Vec<f32> = film.pixels().iter().map(|pixel| pixel[0]).collect();
        let expected = [
            [0.0; 5],
            [0.0, 0.0, 0.0, 1.0, 2.0],
            [0.0, 0.0, 0.0, 3.0, 4.0],
            [0.0, 0.0, 0.0, 5.0, 6.0],
        ];
        assert_eq!(red, expected.concat());
        assert_eq!(film.rows().len(), 4);
        assert_eq!(film.largest_value(), 6.0);
    }

    #[test]
    fn rectangles_that_do_not_fit_change_nothing() {
        let mut film = Film::new(5, 4).unwrap();
        for (left, top, width, count) in [
            (4, 0, 2, 2),
            (0, 3, 5, 10),
            (0, 0, 3, 4),
            (u32::MAX, 0, 2, 2),
            (0, u32::MAX, 1, 1),
            (0, 0, 0, 1),
        ] {
            assert!(film.write_rectangle(left, top, width, &vec![[1.0; 4]; count]).is_err());
        }
        assert_eq!(film.largest_value(), 0.0);
        film.write_rectangle(2, 2, 0, &[]).unwrap();
    }

    #[test]
    fn sizes_that_cannot_be_are_refused() {
        assert_eq!(Film::bytes_needed(1920, 1080), 33_177_600);
        assert!(Film::new(0, 5).is_err());
        let message = Film::new(u32::MAX, u32::MAX).unwrap_err().to_string();
        assert!(message.contains("MiB"), "{message}");
    }

    #[test]
    fn no_number_is_more_than_any() {
        let mut film = Film::new(2, 1).unwrap();
        film.write_rectangle(0, 0, 2, &[[-3.0, 0.5, 0.25, 0.0], [0.1; 4]]).unwrap();
        assert_eq!(film.largest_value(), 0.5);
        film.write_rectangle(0, 0, 1, &[[0.0, f32::NAN, f32::INFINITY, 0.25]]).unwrap();
        assert!(film.largest_value().is_nan());
    }
}
