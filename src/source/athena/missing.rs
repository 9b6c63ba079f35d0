//! Files of an output that are missing, as far as the others tell: a domain is a box of which
//! processes have parts, and all outputs of a run have the same parts.

use std::collections::{BTreeMap, HashSet};
use std::path::{Path, PathBuf};

use super::Piece;
use super::header::Header;
use super::{files, lattice};
use crate::space::{Domain, IndexBox};
use crate::{Error, Result};

/// The files of each domain, by its level and its number there.
type Domains<'a> = BTreeMap<(u32, u32), Vec<&'a Piece>>;

/// Refuses an output, which the user named `path`, that lacks files. `elsewhere` are those that other
/// outputs of the run have of parts of which this one has none.
///
/// # Errors
/// Files that are missing, by the part of a domain that no file has.
pub(super) fn check(
    path: &Path,
    domain: &Domain,
    pieces: &[Piece],
    elsewhere: &[PathBuf],
) -> Result<()> {
    let invalid = |reason| Error::invalid(path.display(), reason);
    let mut domains = Domains::new();
    for piece in pieces {
        domains.entry(piece.header.place()).or_default().push(piece);
    }
    check_numbers(&domains).map_err(invalid)?;
    check_processes(domains.get(&(0, 0)).map_or(&[], Vec::as_slice)).map_err(invalid)?;
    for (of, pieces) in &domains {
        check_filled(*of, pieces).map_err(invalid)?;
    }
    elsewhere.iter().try_for_each(|file| check_elsewhere(file, domain, &domains)).map_err(invalid)
}

/// Levels, and the domains of each, are numbered from 0 on.
fn check_numbers(domains: &Domains<'_>) -> Result<(), String> {
    let mut next = (0, 0);
    for &(level, domain) in domains.keys() {
        // After the last domain of a level the first of the next one.
        let expected = if level > next.0 { (next.0 + 1, 0) } else { next };
        if (level, domain) != expected {
            return Err(format!(
                "no file is of domain {} of level {}, but some are of domain {domain} of level \
                 {level}: files are missing",
                expected.1, expected.0
            ));
        }
        next = (level, domain + 1);
    }
    Ok(())
}

/// Athena deals parts to processes in turn, those of the root grid first.
fn check_processes(root: &[&Piece]) -> Result<(), String> {
    let processes = processes(root);
    match (0..).zip(&processes).find(|(expected, found)| expected != *found) {
        None => Ok(()),
        Some((missing, _)) => Err(format!(
            "process {missing} has no file of the root grid, but process {} has one: the file \
             in id{missing} is missing",
            processes.last().copied().unwrap_or(0)
        )),
    }
}

/// The numbers of the processes that wrote `pieces`, in order, each once.
fn processes(pieces: &[&Piece]) -> Vec<u64> {
    let mut numbers: Vec<u64> =
        pieces.iter().filter_map(|piece| files::process(&piece.path)).collect();
    numbers.sort_unstable();
    numbers.dedup();
    numbers
}

/// The smallest box around the cells of `pieces`.
fn around(pieces: &[&Piece]) -> IndexBox {
    let boxes = || pieces.iter().map(|piece| piece.grid.cells());
    let edge = |a: usize, pick: fn(&IndexBox) -> [i128; 3]| boxes().map(move |one| pick(&one)[a]);
    IndexBox {
        lo: std::array::from_fn(|a| edge(a, |one| one.lo).min().unwrap_or(0)),
        hi: std::array::from_fn(|a| edge(a, |one| one.hi).max().unwrap_or(0)),
    }
}

/// Refuses files that leave a gap in the box around them; overlaps are found where cells are read.
fn check_filled((level, domain): (u32, u32), pieces: &[&Piece]) -> Result<(), String> {
    let count =
        |cells: IndexBox| cells.size().iter().try_fold(1i128, |product, &n| product.checked_mul(n));
    let all = around(pieces);
    let held =
        pieces.iter().try_fold(0i128, |sum, piece| sum.checked_add(count(piece.grid.cells())?));
    if held.is_some() && held >= count(all) {
        return Ok(());
    }
    let place = gap(pieces, &all).map_or_else(String::new, |cell| format!(", as at cell {cell:?}"));
    let numbers = processes(pieces);
    let skipped = numbers.windows(2).find(|pair| pair[1] == pair[0] + 2);
    let whose = skipped.map_or_else(String::new, |pair| format!(", perhaps in id{}", pair[0] + 1));
    Err(format!(
        "the {} files of domain {domain} of level {level} leave a gap in it{place}: a file is \
         missing{whose}",
        pieces.len()
    ))
}

/// A cell in `all` that none of `pieces` has, beside one of them.
fn gap(pieces: &[&Piece], all: &IndexBox) -> Option<[i128; 3]> {
    let boxes: Vec<IndexBox> = pieces.iter().map(|piece| piece.grid.cells()).collect();
    let is_in = |cells: &IndexBox, cell| cells.contains(&IndexBox::at(cell, [1; 3]));
    let mut beside = cells_beside(&boxes).into_iter().filter(|&cell| is_in(all, cell));
    beside.find(|&cell| !boxes.iter().any(|cells| is_in(cells, cell)))
}

/// Cells beside the faces of boxes where no other box begins or ends as they do: few where boxes share a
/// larger one.
fn cells_beside(boxes: &[IndexBox]) -> Vec<[i128; 3]> {
    let above = |cells: &IndexBox, a: usize| {
        std::array::from_fn(|b| if a == b { cells.hi[b] } else { cells.lo[b] })
    };
    let first: HashSet<[i128; 3]> = boxes.iter().map(|cells| cells.lo).collect();
    let mut beside = Vec::new();
    for a in 0..3 {
        let next: HashSet<[i128; 3]> = boxes.iter().map(|cells| above(cells, a)).collect();
        beside.extend(next.difference(&first));
        beside.extend(first.difference(&next).map(|&cell| {
            let mut below = cell;
            below[a] -= 1;
            below
        }));
    }
    beside.sort_unstable();
    beside
}

/// Refuses that another output's `file` lies outside all that this one has of the same domain. Files
/// of other cells are of another run, and damaged ones tell nothing.
fn check_elsewhere(file: &Path, domain: &Domain, domains: &Domains<'_>) -> Result<(), String> {
    let Ok(header) = Header::read(file) else { return Ok(()) };
    let Ok(cells) = lattice::cells(&header, domain) else { return Ok(()) };
    let (level, number) = header.place();
    match domains.get(&(level, number)) {
        Some(pieces) if around(pieces).contains(&cells) => Ok(()),
        _ => Err(format!(
            "no file has the part of domain {number} of level {level} that {} has in another \
             output: copy the missing file, or move that one away if it is of another run",
            file.display()
        )),
    }
}
