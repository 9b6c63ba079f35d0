//! The text hierarchy: `Key = values` lines, one group of them a grid, read as a stream.

use std::path::Path;

use super::listing::{Edge, ListedGrid, PRINTED_DIGITS};
use super::parameters::parse_list;
use crate::source::lines::{Lines, printed_digits, shown};
use crate::{Error, Result};

/// Hands every grid of the hierarchy at `path`, which has numbers of so many `digits`, to `visit`.
///
/// # Errors
/// A file that cannot be read, malformed or incomplete grids, `Pointer:` lines that name grids
/// which aren't listed (a truncated file); and what `visit` returns.
pub(super) fn for_each_grid(
    path: &Path,
    digits: i32,
    visit: &mut dyn FnMut(ListedGrid) -> Result<()>,
) -> Result<()> {
    let mut lines = Lines::open(path)?;
    let mut grid: Option<Draft> = None;
    let (mut largest, mut pointed) = (0, 0);
    let (mut grids, mut pointers) = (0u64, [0u64; POINTERS.len()]);
    while let Some(line) = lines.next()? {
        if let Some((name, target)) = pointer(&line) {
            pointed = pointed.max(target);
            pointers[name] += 1;
            continue;
        }
        let Some((key, value)) = line.split_once('=') else { continue };
        let (key, value) = (key.trim(), value.trim());
        if key == "Grid" {
            let id = value.parse().map_err(|_| malformed(&lines, &line))?;
            if let Some(done) = grid.replace(Draft { id, digits, ..Draft::default() }) {
                visit(done.finish(path)?)?;
            }
            largest = largest.max(id);
            grids += 1;
        } else if let Some(grid) = &mut grid {
            grid.take(key, value).ok_or_else(|| malformed(&lines, &line))?;
        }
    }
    if let Some(done) = grid {
        visit(done.finish(path)?)?;
    }
    if pointed > largest {
        let reason = format!("refers to grid {pointed}, but ends at {largest}: is it truncated?");
        return Err(Error::invalid(path.display(), reason));
    }
    if let Some((name, count)) = POINTERS.iter().zip(pointers).find(|(_, count)| *count < grids) {
        let reason =
            format!("has {grids} grids, but {count} lines `Pointer: … {name}`: is it truncated?");
        return Err(Error::invalid(path.display(), reason));
    }
    Ok(())
}

/// Digits of the longest of all edges: shorter ones end in zeros, which `%g` does not print.
///
/// # Errors
/// A file that cannot be read.
pub(super) fn most_digits(path: &Path) -> Result<i32> {
    let mut lines = Lines::open(path)?;
    let mut digits = PRINTED_DIGITS;
    while let Some(line) = lines.next()? {
        let Some((key, value)) = line.split_once('=') else { continue };
        if ["GridLeftEdge", "GridRightEdge"].contains(&key.trim()) {
            let longest = value.split_whitespace().map(printed_digits).max();
            digits = digits.max(longest.unwrap_or(0));
        }
    }
    Ok(digits)
}

/// What each grid has one `Pointer:` line of, 0 where there is no such grid. The file ends with one.
const POINTERS: [&str; 2] = ["NextGridThisLevel", "NextGridNextLevel"];

fn malformed(lines: &Lines, line: &str) -> Error {
    lines.fault(&format!("`{}` is malformed", shown(line.trim())))
}

/// Of which of [`POINTERS`] a line `Pointer: Grid[1]->NextGridThisLevel = 2` is, and the grid that it
/// names.
fn pointer(line: &str) -> Option<(usize, u64)> {
    let (key, target) = line.strip_prefix("Pointer:")?.rsplit_once('=')?;
    let name = key.trim().rsplit_once("->")?.1;
    let name = POINTERS.iter().position(|pointer| *pointer == name)?;
    Some((name, target.trim().parse().ok()?))
}

/// A grid whose lines are being read.
#[derive(Default)]
struct Draft {
    id: u64,
    digits: i32,
    rank: Option<i64>,
    start: Option<[i64; 3]>,
    end: Option<[i64; 3]>,
    left: Option<[Edge; 3]>,
    right: Option<[Edge; 3]>,
    baryon_file: Option<String>,
    particle_file: Option<String>,
    has_particles: bool,
}

impl Draft {
    /// Takes one line's value; none where it is malformed.
    fn take(&mut self, key: &str, value: &str) -> Option<()> {
        match key {
            "GridRank" => self.rank = Some(value.parse().ok()?),
            // Grids of fewer axes have shorter lists; their rank is refused later.
            "GridStartIndex" if self.is_solid() => self.start = Some(parse_list(value)?),
            "GridEndIndex" if self.is_solid() => self.end = Some(parse_list(value)?),
            "GridLeftEdge" if self.is_solid() => self.left = Some(self.edges(value)?),
            "GridRightEdge" if self.is_solid() => self.right = Some(self.edges(value)?),
            "BaryonFileName" => self.baryon_file = Some(value.to_owned()),
            "NumberOfParticles" => self.has_particles = value.parse().is_ok_and(|n: u64| n > 0),
            "ParticleFileName" => self.particle_file = Some(value.to_owned()),
            _ => {}
        }
        Some(())
    }

    fn is_solid(&self) -> bool {
        self.rank.is_none_or(|rank| rank == 3)
    }

    fn edges(&self, text: &str) -> Option<[Edge; 3]> {
        let words: [String; 3] = parse_list(text)?;
        let edge = |text: String| {
            let value: f64 = text.parse().ok()?;
            value.is_finite().then_some(Edge::Printed { text, value, digits: self.digits })
        };
        let [x, y, z] = words.map(edge);
        Some([x?, y?, z?])
    }

    fn finish(self, path: &Path) -> Result<ListedGrid> {
        let place = format!("{}: grid {}", path.display(), self.id);
        if let Some(rank) = self.rank.filter(|&rank| rank != 3) {
            let reason = format!("GridRank = {rank}: only three-dimensional grids can be read");
            return Err(Error::not_supported(place, reason));
        }
        let missing = |key: &str| Error::invalid(&place, format!("has no {key}: truncated file?"));
        Ok(ListedGrid {
            id: self.id,
            level: None,
            start: self.start.ok_or_else(|| missing("GridStartIndex"))?,
            end: self.end.ok_or_else(|| missing("GridEndIndex"))?,
            left: self.left.ok_or_else(|| missing("GridLeftEdge"))?,
            right: self.right.ok_or_else(|| missing("GridRightEdge"))?,
            file: self.baryon_file.or(self.particle_file).ok_or_else(|| {
                let reason = "has no BaryonFileName: truncated, or a run without baryon fields?";
                Error::invalid(&place, reason)
            })?,
            has_particles: self.has_particles,
        })
    }
}
