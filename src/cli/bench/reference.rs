//! What pictures are measured against: the exact one, or the mean of many exact rays.

use std::path::Path;
use std::time::{Duration, Instant};

use super::renderer::Renderer;
use crate::Result;
use crate::render::Film;
use crate::scene::Samples;

/// Most rays along a pixel's axis.
const MOST_RAYS: u32 = 64;

/// The reference and how far it can be trusted.
#[derive(Debug)]
pub(super) struct Reference {
    /// The picture.
    pub(super) film: Film,
    /// n of its n×n rays a pixel.
    pub(super) rays: u32,
    /// For the average over a pixel's area: the largest difference to the picture of half as
    /// many rays along each axis. Smaller errors cannot be measured.
    pub(super) change: f64,
}

impl Reference {
    /// The exact picture of n×n rays; for the average over the area, n is doubled until the next
    /// picture would take longer than what is left of `budget`, but once at least.
    ///
    /// # Errors
    /// Whatever a render says.
    pub(super) fn new(
        renderer: &Renderer,
        cache: &Path,
        scene: &Path,
        samples: Samples,
        budget: Duration,
    ) -> Result<Self> {
        let exact = |rays: u32| {
            let options = ["--tolerance", "0", "--samples", &rays.to_string()].map(String::from);
            renderer.render(cache, scene, &options)?;
            renderer.picture()
        };
        match samples {
            Samples::Grid(rays) => Ok(Self { film: exact(rays)?, rays, change: 0.0 }),
            Samples::Area => converge(exact, budget),
        }
    }

    /// The largest value of any channel.
    pub(super) fn largest_value(&self) -> f64 {
        f64::from(self.film.largest_value())
    }

    /// The largest error of any channel of any pixel of `film`; infinite where one of both is
    /// not a number, or where the sizes differ.
    pub(super) fn error(&self, film: &Film) -> f64 {
        largest_difference(&self.film, film)
    }
}

fn converge(exact: impl Fn(u32) -> Result<Film>, budget: Duration) -> Result<Reference> {
    let started = Instant::now();
    let (mut coarse, mut rays) = (exact(1)?, 2);
    loop {
        let begun = Instant::now();
        let film = exact(rays)?;
        let next = 4 * begun.elapsed();
        if rays >= MOST_RAYS || started.elapsed() + next > budget {
            return Ok(Reference { change: largest_difference(&coarse, &film), film, rays });
        }
        (coarse, rays) = (film, 2 * rays);
    }
}

/// The largest difference of any channel of any pixel; infinite where one of both is not a number,
/// or where the sizes differ.
pub(super) fn largest_difference(a: &Film, b: &Film) -> f64 {
    if (a.width(), a.height()) != (b.width(), b.height()) {
        return f64::INFINITY;
    }
    let pairs = a.pixels().iter().flatten().zip(b.pixels().iter().flatten());
    let differences = pairs.map(|(a, b)| (f64::from(*a) - f64::from(*b)).abs());
    differences.fold(0.0, |largest, d| if d.is_nan() { f64::INFINITY } else { d.max(largest) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn film(value: f32) -> Result<Film> {
        let mut film = Film::new(2, 1)?;
        film.write_rectangle(0, 0, 2, &[[0.0; 4], [0.5, 0.5, value, 0.5]])?;
        Ok(film)
    }

    #[test]
    fn the_largest_difference_of_any_channel_counts() {
        let [a, b, nan] = [0.25, -1.0, f32::NAN].map(|value| film(value).unwrap());
        assert_eq!(largest_difference(&a, &b), 1.25);
        assert_eq!(largest_difference(&a, &a), 0.0);
        assert_eq!(largest_difference(&a, &nan), f64::INFINITY);
        assert_eq!(largest_difference(&a, &Film::new(1, 2).unwrap()), f64::INFINITY);
    }

    #[test]
    fn rays_are_doubled_within_the_budget_and_the_last_change_is_told() {
        let exact = |rays: u32| film(1.0 / rays as f32);
        let hurried = converge(exact, Duration::ZERO).unwrap();
        assert_eq!((hurried.rays, hurried.change), (2, 0.5));
        let patient = converge(exact, Duration::from_secs(3600)).unwrap();
        assert_eq!((patient.rays, patient.change), (MOST_RAYS, 1.0 / f64::from(MOST_RAYS)));
    }
}
