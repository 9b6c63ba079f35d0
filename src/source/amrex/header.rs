//! The plotfile's `Header`.

use std::path::Path;

use super::text::{PrintedBox, numbers, stays_inside};
use crate::source::lines::{Lines, printing_error, shown};
use crate::source::names::tell_apart;
use crate::space::{AXES, Domain, IndexBox, Levels, MAX_OCTREE_LEVEL};
use crate::{Error, Result};

/// Most components accepted.
const MOST_COMPONENTS: usize = 100_000;
/// Digits that are printed at least, where they are not zeros.
const PRINTED_DIGITS: i32 = 6;
/// Relative error of edges and widths of cells in builds that compute with 32-bit floats.
const SINGLE_PRECISION: f64 = 1e-6;

/// How the names of nodes' displacements begin.
const DISPLACEMENT: &str = "amrexvec_nu";

/// What the `Header` says.
#[derive(Debug)]
pub(super) struct Header {
    /// Names of the components of every grid, in order.
    pub(super) components: Vec<String>,
    /// Code time.
    pub(super) time: Option<f64>,
    /// The simulated box and root grid.
    pub(super) domain: Domain,
    /// The levels, root grid first.
    pub(super) levels: Levels,
    /// By level, the indices of the whole domain there.
    pub(super) extents: Vec<IndexBox>,
    /// By level, the grids.
    pub(super) grids: Vec<LevelGrids>,
}

/// The grids of a level.
#[derive(Debug)]
pub(super) struct LevelGrids {
    /// How many there are.
    pub(super) count: u64,
    /// What files of their data begin with, from the plotfile: `Level_0/Cell`.
    pub(super) data: String,
}

/// The first lines: component names and dimension.
fn components(lines: &mut Lines) -> Result<(Vec<String>, i64)> {
    lines.expect("the version")?;
    let count = lines.parse("the number of components", |text| {
        text.parse().ok().filter(|count| (1..=MOST_COMPONENTS).contains(count))
    })?;
    let mut names = Vec::new();
    for _ in 0..count {
        names.push(lines.expect("a component's name")?);
    }
    tell_apart(&mut names);
    let dimension = lines.parse("the dimension", |text| {
        text.parse().ok().filter(|dimension| (1..=3).contains(dimension))
    })?;
    Ok((names, dimension))
}

/// Whether the file at `path` begins as the `Header` of a plotfile does.
pub(super) fn looks_right(path: &Path) -> bool {
    let begins = || -> Result<()> {
        let mut lines = Lines::open(path)?;
        let (_, dimension) = components(&mut lines)?;
        lines.parse("the time", float)?;
        finest_level(&mut lines)?;
        let edges = |text: &str| Some(text.split_whitespace().count() as i64 == dimension);
        let printed = lines.parse("the domain's edges", edges)?;
        if printed { Ok(()) } else { Err(lines.fault("no edges")) }
    };
    begins().is_ok()
}

fn finest_level(lines: &mut Lines) -> Result<usize> {
    let level: u32 = lines.parse("the finest level", |text| text.parse().ok())?;
    if level > MAX_OCTREE_LEVEL {
        let reason = format!("finest level {level}: at most {MAX_OCTREE_LEVEL} are supported");
        return Err(lines.fault(&reason));
    }
    Ok(level as usize)
}

fn float(text: &str) -> Option<f64> {
    text.parse().ok()
}

impl Header {
    /// Reads the `Header` at `path`. What follows the levels is left alone, but for
    /// displaced nodes: codes append lines of their own there.
    ///
    /// # Errors
    /// A file that cannot be read, is malformed or contradicts itself, and runs that are not
    /// three-dimensional and Cartesian.
    pub(super) fn read(path: &Path) -> Result<Self> {
        let mut lines = Lines::open(path)?;
        let (components, dimension) = components(&mut lines)?;
        if dimension != 3 {
            let reason = format!("dimension {dimension}: only three-dimensional runs can be read");
            return Err(Error::not_supported(path.display(), reason));
        }
        let time = lines.parse("the time", float)?;
        let finest = finest_level(&mut lines)?;
        let left = lines.parse("the domain's lower edges", three_printed)?;
        let right = lines.parse("the domain's upper edges", three_printed)?;
        let stated = lines.parse("the refinement ratios", numbers)?;
        let extents = extents(&mut lines, finest + 1)?;
        let factors = factors(&extents, &stated).map_err(|reason| lines.fault(&reason))?;
        let levels = Levels::from_factors(&factors)
            .map_err(|error| Error::not_supported(path.display(), error.to_string()))?;
        let root = extents.first().map_or([0; 3], IndexBox::size);
        let root = root.map(|cells| u64::try_from(cells).unwrap_or(0));
        let [lower, upper] = [&left, &right].map(|edges| edges.map(|edge| edge.value));
        let domain = Domain::new(lower, upper, root)
            .map_err(|error| Error::invalid(path.display(), error.to_string()))?;
        lines.expect("the steps")?;
        for (level, extent) in extents.iter().enumerate() {
            let widths = lines.parse("the cells' widths", three_printed)?;
            check_widths(&left, &right, extent, &widths)
                .map_err(|reason| lines.fault(&format!("level {level}: {reason}")))?;
        }
        check_coordinates(&mut lines, path)?;
        lines.expect("the boundary's width")?;
        let grids: Result<Vec<_>> =
            (0..=finest).map(|level| level_grids(&mut lines, level)).collect();
        let grids = grids?;
        check_mapping(&mut lines, path)?;
        let time = Some(time).filter(|time| time.is_finite());
        Ok(Self { components, time, domain, levels, extents, grids })
    }
}

/// A number, and how far it may be from the one that was printed.
#[derive(Debug, Clone, Copy)]
struct Printed {
    value: f64,
    error: f64,
}

fn three_printed(text: &str) -> Option<[Printed; 3]> {
    let printed = |word: &str| {
        let value = float(word)?;
        Some(Printed { value, error: printing_error(word, value, PRINTED_DIGITS) })
    };
    let list: Option<Vec<_>> = text.split_whitespace().map(printed).collect();
    list?.try_into().ok()
}

/// Whether a level's cells fill the domain, as far as digits tell.
///
/// # Errors
/// The reason, where they do not.
fn check_widths(
    left: &[Printed; 3],
    right: &[Printed; 3],
    extent: &IndexBox,
    widths: &[Printed; 3],
) -> Result<(), String> {
    for a in 0..3 {
        let cells = extent.size()[a] as f64;
        let (domain, filled) = (right[a].value - left[a].value, cells * widths[a].value);
        let largest = left[a].value.abs().max(right[a].value.abs());
        let error = left[a].error + right[a].error + cells * widths[a].error;
        let off = (filled - domain).abs();
        if off.is_nan() || off > error + SINGLE_PRECISION * largest {
            return Err(format!(
                "{cells} cells {} wide along {} make {filled}, but the domain's edges are {domain} \
                 apart",
                widths[a].value, AXES[a]
            ));
        }
    }
    Ok(())
}

/// The line with the domain's indices at each of `count` levels.
fn extents(lines: &mut Lines, count: usize) -> Result<Vec<IndexBox>> {
    let numbers = lines.parse("the index box of each level", |text| {
        numbers(text).filter(|numbers| numbers.len() == 9 * count)
    })?;
    let boxes = numbers.chunks_exact(9).filter_map(PrintedBox::from_numbers);
    let mut extents = Vec::new();
    for (level, printed) in boxes.enumerate() {
        let place = |reason: String| lines.fault(&format!("the domain at level {level}: {reason}"));
        printed.size().map_err(place)?;
        extents.push(printed.cells);
    }
    Ok(extents)
}

/// The refinement factors between levels, from the domain's indices; `stated` are those that the
/// file gives, which some codes leave out.
///
/// # Errors
/// The reason, where a factor differs between axes or from what is stated.
fn factors(extents: &[IndexBox], stated: &[i64]) -> Result<Vec<u32>, String> {
    let mut factors = Vec::new();
    for (level, pair) in extents.windows(2).enumerate() {
        let (coarse, fine) = (pair[0].size(), pair[1].size());
        let factor = fine[0] / coarse[0];
        if (0..3).any(|a| coarse[a] * factor != fine[a]) {
            return Err(format!(
                "levels {level} and {} have {coarse:?} and {fine:?} cells: no one refinement \
                 ratio for all axes",
                level + 1
            ));
        }
        if (0..3).any(|a| pair[0].lo[a] * factor != pair[1].lo[a]) {
            return Err(format!(
                "the domain of level {} begins at {:?}, which is not {factor} times {:?}, where that \
                 of level {level} begins",
                level + 1,
                pair[1].lo,
                pair[0].lo
            ));
        }
        if let Some(other) = stated.get(level).filter(|&&other| i128::from(other) != factor) {
            return Err(format!(
                "the refinement ratio after level {level} is stated as {other}, but the \
                 domain's indices give {factor}"
            ));
        }
        factors.push(u32::try_from(factor).map_err(|_| "a ratio is too large".to_owned())?);
    }
    Ok(factors)
}

/// AMReX's coordinate system: 0 Cartesian, 1 cylindrical, 2 spherical.
fn check_coordinates(lines: &mut Lines, path: &Path) -> Result<()> {
    let system: i64 = lines.parse("the coordinate system", |text| text.parse().ok())?;
    if system != 0 {
        let name = ["", " (cylindrical)", " (spherical)"].get(system.unsigned_abs() as usize);
        let reason = format!(
            "coordinate system {system}{}: only Cartesian runs (0) can be read",
            name.unwrap_or(&"")
        );
        return Err(Error::not_supported(path.display(), reason));
    }
    Ok(())
}

/// Refuses cells whose corners are displaced, as ERF and REMORA write of a mesh that follows terrain: a
/// number of fields at nodes, that of their components, and these components' names.
fn check_mapping(lines: &mut Lines, path: &Path) -> Result<()> {
    const LINES_BEFORE_NAMES: usize = 2;
    for _ in 0..=LINES_BEFORE_NAMES {
        let Ok(Some(line)) = lines.next() else { return Ok(()) };
        if line.trim_start().starts_with(DISPLACEMENT) {
            let reason = format!(
                "`{}`: a mesh that follows terrain; only uniform Cartesian meshes can be read",
                shown(line.trim())
            );
            return Err(Error::not_supported(path.display(), reason));
        }
    }
    Ok(())
}

/// One level's part: its grids' edges are skipped, as `Cell_H` has their exact indices.
fn level_grids(lines: &mut Lines, level: usize) -> Result<LevelGrids> {
    let what = format!("level {level} and its number of grids");
    let count = lines.parse(&what, |text| {
        let mut words = text.split_whitespace();
        let stated: usize = words.next()?.parse().ok()?;
        words.next()?.parse().ok().filter(|_| stated == level)
    })?;
    lines.expect("a level's steps")?;
    for _ in 0..count {
        for _ in 0..3 {
            lines.parse("a grid's edges", |text| text.split_once(' ').map(|_| ()))?;
        }
    }
    let data = lines.expect("the name of a level's data")?;
    if !stays_inside(&data) {
        let reason = format!("`{}` is no path inside the plotfile", shown(&data));
        return Err(lines.fault(&reason));
    }
    Ok(LevelGrids { count, data })
}
