//! The simulation's domain and exact positions in it.

use std::f64::consts::LOG10_2;

use glam::DVec3;
use num_bigint::BigInt;
use num_integer::Integer;
use num_traits::{Signed, ToPrimitive};

use super::twofold::Twofold;
use super::{AXES, Decimal, FRACTION_BITS};
use crate::{Error, Result};

/// Most root cells along an axis.
pub const MAX_ROOT_CELLS: u64 = 1 << 24;
/// Root cells may be so many times as wide along one axis as along another: what rounding turns a ray by
/// moves it by some millionths of a cell then, at most.
const MOST_STRETCHED: f64 = 1e10;
/// Positions may lie this many root cells (as a power of two) from the domain's left edge, so
/// that neither a position nor a difference of two overflows.
const POSITION_RANGE_BITS: u32 = 29;

/// An exact position: along each axis the distance from the domain's left edge, in units of
/// 2⁻⁹⁶ ([`FRACTION_BITS`]) of that axis' root cell width, floored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Position(pub [i128; 3]);

/// The simulated box and its root grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Domain {
    left: [f64; 3],
    right: [f64; 3],
    root_cells: [u64; 3],
}

impl Domain {
    /// A domain from its edges in code length and the root grid's cells along each axis.
    ///
    /// # Errors
    /// Edges that are not finite or not in order, root grids without cells or with more than
    /// [`MAX_ROOT_CELLS`] along an axis, and root cells whose width is not within 1e-100 to 1e100, or
    /// along one axis more than 1e10 times as large as along another.
    pub fn new(left: [f64; 3], right: [f64; 3], root_cells: [u64; 3]) -> Result<Self> {
        for a in 0..3 {
            let axis = AXES[a];
            let width = right[a] - left[a];
            if !(left[a].is_finite() && right[a].is_finite() && width.is_finite() && width > 0.0) {
                return Err(Error::request(format!(
                    "the domain's edges along {axis} are {} and {}: both and their distance must be \
                     finite, the left one smaller",
                    left[a], right[a]
                )));
            }
            if root_cells[a] == 0 || root_cells[a] > MAX_ROOT_CELLS {
                return Err(Error::request(format!(
                    "the root grid has {} cells along {axis}: 1 to {MAX_ROOT_CELLS} are supported",
                    root_cells[a]
                )));
            }
            let cell = width / root_cells[a] as f64;
            if !(1e-100..=1e100).contains(&cell) {
                return Err(Error::request(format!(
                    "root cells are {cell:e} code lengths wide along {axis}: 1e-100 to 1e100 are \
                     supported"
                )));
            }
        }
        let domain = Self { left, right, root_cells };
        let widths = domain.root_cell_width();
        if widths.max_element() / widths.min_element() > MOST_STRETCHED {
            return Err(Error::request(format!(
                "root cells are {:e} code lengths wide along one axis and {:e} along another: up to \
                 {MOST_STRETCHED:e} times as wide is supported",
                widths.max_element(),
                widths.min_element()
            )));
        }
        Ok(domain)
    }

    /// Left edges in code length.
    pub fn left(&self) -> [f64; 3] {
        self.left
    }

    /// Right edges in code length; they lie outside.
    pub fn right(&self) -> [f64; 3] {
        self.right
    }

    /// Cells of the root grid along each axis.
    pub fn root_cells(&self) -> [u64; 3] {
        self.root_cells
    }

    /// Width of a root cell along each axis, code length.
    pub fn root_cell_width(&self) -> DVec3 {
        DVec3::from_array(std::array::from_fn(|a| {
            (self.right[a] - self.left[a]) / self.root_cells[a] as f64
        }))
    }

    /// Width of a cell at octree level `octree` (negative: averaged above the root grid), code
    /// length.
    pub fn cell_width(&self, octree: i32) -> DVec3 {
        self.root_cell_width() * f64::from(-octree).exp2()
    }

    /// The upper corner of the domain as a position: the first point outside along each axis.
    pub fn upper(&self) -> Position {
        Position(self.root_cells.map(|n| i128::from(n) << FRACTION_BITS))
    }

    /// Whether `position` lies inside: left faces are, right faces are not.
    pub fn contains(&self, position: &Position) -> bool {
        let upper = self.upper();
        (0..3).all(|a| (0..upper.0[a]).contains(&position.0[a]))
    }

    /// The exact position of a point given in code length, floored. Edges count as the rationals
    /// that their doubles are.
    ///
    /// # Errors
    /// A point more than 2²⁹ root cells from the domain's left edge.
    pub fn position(&self, point: &[Decimal; 3]) -> Result<Position> {
        let mut position = [0; 3];
        for a in 0..3 {
            position[a] = self.coordinate(a, &point[a])?;
        }
        Ok(Position(position))
    }

    /// One coordinate of [`Self::position`].
    fn coordinate(&self, axis: usize, value: &Decimal) -> Result<i128> {
        let (left, right) =
            (Decimal::from_f64(self.left[axis])?, Decimal::from_f64(self.right[axis])?);
        // (value − left) / (right − left) · root_cells · 2^96 over one common denominator.
        let offset = &value.numerator * &left.denominator - &left.numerator * &value.denominator;
        let offset_denominator = &value.denominator * &left.denominator;
        let width = &right.numerator * &left.denominator - &left.numerator * &right.denominator;
        let width_denominator = &right.denominator * &left.denominator;
        let numerator: BigInt =
            (offset * width_denominator * BigInt::from(self.root_cells[axis])) << FRACTION_BITS;
        let units = numerator.div_floor(&(offset_denominator * width));
        let limit = BigInt::from(1) << (FRACTION_BITS + POSITION_RANGE_BITS);
        if units.abs() > limit {
            return Err(Error::request(format!(
                "a position lies more than 2^{POSITION_RANGE_BITS} root cells from the domain \
                 along {}: move it closer",
                AXES[axis]
            )));
        }
        units.to_i128().ok_or_else(|| Error::request("a position is out of range"))
    }

    /// `position` in code length, as decimals with digits enough to tell its units apart, floored.
    ///
    /// # Errors
    /// None: edges are finite.
    pub fn decimals(&self, position: &Position) -> Result<[String; 3]> {
        let mut decimals = <[String; 3]>::default();
        for (a, decimal) in decimals.iter_mut().enumerate() {
            let (left, right) =
                (Decimal::from_f64(self.left[a])?, Decimal::from_f64(self.right[a])?);
            // left + (right − left) · position / (root_cells · 2^96) over one common denominator.
            let units = BigInt::from(self.root_cells[a]) << FRACTION_BITS;
            let from = &left.numerator * &right.denominator;
            let width = &right.numerator * &left.denominator - &from;
            let numerator = from * &units + width * BigInt::from(position.0[a]);
            let denominator = left.denominator * right.denominator * units;
            let smallest = self.root_cell_width()[a].log10() - f64::from(FRACTION_BITS) * LOG10_2;
            let digits = (-smallest).ceil().max(1.0) as usize;
            let scaled = (numerator * BigInt::from(10).pow(digits as u32)).div_floor(&denominator);
            let sign = if scaled.is_negative() { "-" } else { "" };
            let text = format!("{:0>1$}", scaled.abs().to_string(), digits + 1);
            let (whole, fraction) = text.split_at(text.len() - digits);
            *decimal = format!("{sign}{whole}.{fraction}");
        }
        Ok(decimals)
    }

    /// Units of positions in a code length along each axis.
    pub(crate) fn units_per_length(&self) -> [Twofold; 3] {
        let units = f64::from(FRACTION_BITS).exp2();
        std::array::from_fn(|a| {
            let width = Twofold::sum(self.right[a], -self.left[a]);
            Twofold::from(self.root_cells[a] as f64 * units).over(width)
        })
    }

    /// `to − from` in code length: the exact difference, rounded once along each axis.
    pub fn difference(&self, to: &Position, from: &Position) -> DVec3 {
        let units = DVec3::from_array(std::array::from_fn(|a| (to.0[a] - from.0[a]) as f64));
        units * (-f64::from(FRACTION_BITS)).exp2() * self.root_cell_width()
    }

    /// The lower corner of cell `index` of octree level `octree` (negative: above the root
    /// grid).
    pub fn cell_corner(&self, octree: i32, index: [i128; 3]) -> Position {
        let shift = i64::from(FRACTION_BITS) - i64::from(octree);
        Position(index.map(|i| i << shift))
    }

    /// The lower corner of a cell of octree level `octree` that is nearest to a point given in
    /// code length, as that cell's index, and how far the point lies above it along each axis, in
    /// such cells.
    ///
    /// # Errors
    /// A point that [`Self::position`] refuses.
    pub fn nearest_corner(
        &self,
        octree: u32,
        point: &[Decimal; 3],
    ) -> Result<([i128; 3], [f64; 3])> {
        let position = self.position(point)?.0;
        let shift = FRACTION_BITS.saturating_sub(octree).max(1);
        let index = position.map(|c| (c + (1 << (shift - 1))) >> shift);
        let width = f64::from(shift).exp2();
        let off = std::array::from_fn(|a| (position[a] - (index[a] << shift)) as f64 / width);
        Ok((index, off))
    }

    /// The cell of octree level `octree` that holds `position`, half-open.
    pub fn cell_of(&self, octree: i32, position: &Position) -> [i128; 3] {
        let shift = i64::from(FRACTION_BITS) - i64::from(octree);
        position.0.map(|c| c >> shift)
    }
}
