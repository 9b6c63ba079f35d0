//! The average over a pixel's area: squares of it, divided where rays say that their mean is
//! least sure, until the doubts add up to no more than was asked for.
//!
//! A square's doubt is how far the mean of four rays is from that of sixteen, or how far twenty
//! rays (four in the square's corners) are from a quadratic surface: edges between rays, at which
//! both means may agree by chance, are seen by the second.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use super::super::Result;
use super::specks::Speck;
use super::surface;

/// R, G, B, A.
pub(crate) type Channels = [f64; 4];

/// A pixel's value and how far it may be off: the convergence of each channel.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Converged {
    pub(crate) value: Channels,
    pub(crate) error: Channels,
    pub(crate) rays: usize,
}

/// A ray's column and row, or its place in a square, and what it sees.
type Seen = ([f64; 2], Channels);

/// When to stop.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Effort {
    /// Largest error of any channel.
    pub(crate) accuracy: f64,
    /// Most rays in one pixel.
    pub(crate) most_rays: usize,
}

/// Places of Gauss' two points on 0 … 1.
const GAUSS: [f64; 2] = [0.211_324_865_405_187_1, 0.788_675_134_594_812_9];
/// Edge of a square over the edge of the smallest cell in it, at which its sixteen rays are one
/// cell apart.
const CELLS_ACROSS: f64 = 4.0;

/// Part of the largest distance from a quadratic surface that the mean may be off by: an edge is
/// known to 0.15 of the square, between two rays, and leaves 0.3 of its height as distance.
const DOUBT: f64 = 0.5;

/// A square of a pixel.
struct Square {
    lo: [f64; 2],
    edge: f64,
    /// The mean over each quarter, from four rays each.
    quarters: [Channels; 4],
    /// The doubt of each channel, times the square's area.
    error: Channels,
    /// What rays may have missed, as a value of the whole pixel.
    hidden: f64,
    specks: Vec<Speck>,
}

/// Averages rays over pixels.
pub(crate) struct Averager<'a> {
    /// The picture of a ray through a column and row.
    pub(crate) ray: &'a dyn Fn([f64; 2]) -> Result<Channels>,
    pub(crate) effort: Effort,
}

impl Square {
    fn priority(&self) -> f64 {
        self.error.into_iter().fold(self.hidden, f64::max)
    }

    fn mean(&self) -> Channels {
        std::array::from_fn(|c| self.quarters.iter().map(|q| 0.25 * q[c]).sum())
    }
}

impl Averager<'_> {
    /// The average over the pixel whose upper left corner is `corner`.
    pub(crate) fn pixel(&self, corner: [f64; 2], specks: &[Speck]) -> Result<Converged> {
        let mut squares = BinaryHeap::new();
        let mut rays = 0;
        for n in 0..4 {
            let lo = quarter(corner, 1.0, n);
            let coarse = self.mean_of_four(lo, 0.5, &mut Vec::new())?;
            squares.push(Ranked(self.square(lo, 0.5, coarse, specks)?));
            rays += 24;
        }
        let mut left: f64 = squares.iter().map(|square| square.0.priority()).sum();
        while rays < self.effort.most_rays && left > self.effort.accuracy {
            let Some(Ranked(worst)) = squares.pop() else { break };
            for (n, coarse) in worst.quarters.into_iter().enumerate() {
                let lo = quarter(worst.lo, worst.edge, n);
                squares.push(Ranked(self.square(lo, 0.5 * worst.edge, coarse, &worst.specks)?));
            }
            rays += 80;
            left = squares.iter().map(|square| square.0.priority()).sum();
        }
        Ok(summed(squares.into_iter().map(|ranked| ranked.0), rays))
    }

    /// A square of which four rays' mean is known.
    fn square(
        &self,
        lo: [f64; 2],
        edge: f64,
        coarse: Channels,
        specks: &[Speck],
    ) -> Result<Square> {
        let (mut quarters, mut rays) = ([[0.0; 4]; 4], Vec::with_capacity(20));
        for (n, mean) in quarters.iter_mut().enumerate() {
            *mean = self.mean_of_four(quarter(lo, edge, n), 0.5 * edge, &mut rays)?;
        }
        for (place, _) in &mut rays {
            *place = [(place[0] - lo[0]) / edge, (place[1] - lo[1]) / edge];
        }
        for place in surface::CORNERS {
            rays.push((place, (self.ray)([lo[0] + edge * place[0], lo[1] + edge * place[1]])?));
        }
        let meets = |s: &&Speck| (0..2).all(|a| s.lo[a] < lo[a] + edge && s.hi[a] > lo[a]);
        let missable = |s: &&Speck| CELLS_ACROSS * s.size < edge;
        let specks: Vec<Speck> = specks.iter().filter(missable).filter(meets).copied().collect();
        let mut square = Square { lo, edge, quarters, error: [0.0; 4], hidden: 0.0, specks };
        let mean = square.mean();
        square.error = std::array::from_fn(|c| {
            let values: Vec<_> = rays.iter().map(|(place, seen)| (*place, seen[c])).collect();
            let doubt = DOUBT * surface::distance(&values);
            (mean[c] - coarse[c]).abs().max(doubt) * edge * edge
        });
        let brightest = quarters.iter().flat_map(|q| &q[..3]).fold(0.0_f64, |b, v| b.max(*v));
        let sum = |part: fn(&Speck) -> f64| square.specks.iter().map(part).sum::<f64>();
        let (light, shade) = (sum(|s| s.light), sum(|s| s.shade).min(edge * edge));
        square.hidden = (light + shade * brightest).max(shade);
        Ok(square)
    }

    /// The mean of four rays, which are added to `rays`.
    fn mean_of_four(&self, lo: [f64; 2], edge: f64, rays: &mut Vec<Seen>) -> Result<Channels> {
        let mut mean = [0.0; 4];
        for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let place = [lo[0] + edge * GAUSS[x], lo[1] + edge * GAUSS[y]];
            let seen = (self.ray)(place)?;
            rays.push((place, seen));
            mean.iter_mut().zip(seen).for_each(|(sum, value)| *sum += 0.25 * value);
        }
        Ok(mean)
    }
}

/// The corner of quarter `n` of a square.
fn quarter(lo: [f64; 2], edge: f64, n: usize) -> [f64; 2] {
    [lo[0] + 0.5 * edge * (n & 1) as f64, lo[1] + 0.5 * edge * (n >> 1) as f64]
}

fn summed(squares: impl Iterator<Item = Square>, rays: usize) -> Converged {
    let mut sum = Converged { value: [0.0; 4], error: [0.0; 4], rays };
    for square in squares {
        let (mean, area) = (square.mean(), square.edge * square.edge);
        let doubts = sum.error.iter_mut().zip(square.error);
        doubts.for_each(|(sum, error)| *sum += error + square.hidden);
        sum.value.iter_mut().zip(mean).for_each(|(sum, value)| *sum += value * area);
    }
    sum
}

/// Ordered by what dividing the square may gain.
struct Ranked(Square);

impl Ord for Ranked {
    fn cmp(&self, other: &Self) -> Ordering {
        self.0.priority().total_cmp(&other.0.priority())
    }
}

impl PartialOrd for Ranked {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Ranked {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Ranked {}
