//! The domain and the places of files in it, from coordinates printed with seven digits.

use super::header::{Header, PRINTED_DIGITS, Printed};
use crate::Result;
use crate::source::GridRecord;
use crate::source::lattice::{LARGEST_DEVIATION, nearest_corner};
use crate::space::{AXES, Domain, IndexBox};

/// Athena refines by this everywhere.
pub(super) const FACTOR: u32 = 2;
/// Digits after which a double's decimal does not change.
const MOST_DIGITS: usize = 17;

/// What the files of the root level cover along an axis.
struct Extent<'a> {
    /// The lowest corner.
    left: &'a Printed,
    /// Width of the cells.
    spacing: &'a Printed,
    /// How far files reach, in cells from the lowest corner.
    cells: f64,
}

/// The domain that the files of the root level cover.
///
/// # Errors
/// The reason, where they cover none.
pub(super) fn domain(root: &[&Header]) -> Result<Domain, String> {
    let (mut left, mut right, mut cells) = ([0.0; 3], [0.0; 3], [0; 3]);
    for a in 0..3 {
        let extent = extent(root, a)?;
        left[a] = extent.left.value;
        right[a] = extent.right();
        cells[a] = extent.cells.round() as u64;
    }
    Domain::new(left, right, cells).map_err(|e| e.to_string())
}

fn extent<'a>(root: &[&'a Header], axis: usize) -> Result<Extent<'a>, String> {
    let low = |header: &&&Header| header.origin[axis].value;
    let first = root.iter().min_by(|a, b| low(a).total_cmp(&low(b)));
    let first = first.ok_or("no file is of level 0: are folders of the run missing?")?;
    let (left, spacing) = (&first.origin[axis], &first.spacing[axis]);
    if spacing.value <= 0.0 {
        return Err(format!("cells are {} wide along {}", spacing.value, AXES[axis]));
    }
    let reach = |header: &&Header| {
        let before = (header.origin[axis].value - left.value) / spacing.value;
        before.round() + f64::from(header.cells[axis])
    };
    let cells = root.iter().map(reach).fold(0.0, f64::max);
    if cells * spacing.error() > LARGEST_DEVIATION * spacing.value {
        return Err(format!(
            "{cells} cells along {}: too many for the {} digits of SPACING {}",
            AXES[axis], PRINTED_DIGITS, spacing.value
        ));
    }
    Ok(Extent { left, spacing, cells })
}

impl Extent<'_> {
    /// The upper edge: of all numbers that it can be in view of the printed digits the one with
    /// the fewest digits. A third printed as 3.333333e-01 makes 1 when counted three times.
    fn right(&self) -> f64 {
        let nearest = self.left.value + self.cells * self.spacing.value;
        let error = self.cells * self.spacing.error() + self.left.error();
        if nearest.abs() <= error {
            return 0.0;
        }
        (0..MOST_DIGITS)
            .filter_map(|digits| format!("{nearest:.digits$e}").parse::<f64>().ok())
            .find(|short| (short - nearest).abs() <= error)
            .unwrap_or(nearest)
    }
}

/// The grid of the file `number`, whose header is `header`.
///
/// # Errors
/// The reason, where it does not fit the lattice of its level, or its digits do not tell where it
/// lies.
pub(super) fn place(header: &Header, domain: &Domain, number: u64) -> Result<GridRecord, String> {
    let IndexBox { lo, hi } = cells(header, domain)?;
    for a in 0..3 {
        let last = i128::from(domain.root_cells()[a]) << header.level();
        if lo[a] < 0 || hi[a] > last {
            return Err(format!("reaches outside the domain along {}", AXES[a]));
        }
    }
    Ok(GridRecord { id: number, level: header.level(), lo, size: header.cells, locator: number })
}

/// The cells of a file, wherever they lie on the lattice of their level.
///
/// # Errors
/// The reason, where they do not fit the lattice, or their digits do not tell where they lie.
pub(super) fn cells(header: &Header, domain: &Domain) -> Result<IndexBox, String> {
    // As many factors of 2 as levels.
    let level = header.level();
    let width = domain.cell_width(level.cast_signed());
    for a in 0..3 {
        let spacing = &header.spacing[a];
        // The domain's width is of few digits too, and its upper edge of as few as the lower one.
        let farthest = domain.left()[a].abs().max(domain.right()[a].abs());
        let cells = (domain.root_cells()[a] as f64) * f64::from(level).exp2();
        let slack = spacing.error().max(1e-6 * width[a]).max(1e-6 * farthest / cells);
        if (spacing.value - width[a]).abs() > 4.0 * slack {
            return Err(format!(
                "its cells are {} wide along {}, but those of level {level} are {:e}",
                spacing.value, AXES[a], width[a]
            ));
        }
        if header.origin[a].error() > LARGEST_DEVIATION * width[a] {
            return Err(format!(
                "its origin {} along {} has too few digits for cells {:e} wide",
                header.origin[a].value, AXES[a], width[a]
            ));
        }
    }
    let shown = header.origin.each_ref().map(|printed| printed.value);
    let origin = header.origin.iter().map(Printed::decimal);
    let lo = nearest_corner(domain, level, level, origin, "origin", shown)?;
    Ok(IndexBox::at(lo, header.cells))
}
