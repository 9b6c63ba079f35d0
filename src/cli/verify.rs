//! `deepfield verify`.

use std::collections::BTreeMap;
use std::path::PathBuf;

use clap::Args;

use super::output::Output;
use super::progress::Bar;
use super::size;
use crate::cache::{Cache, Cursor, Header, Part, Report};
use crate::{Error, Result, cache};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The cache to check
    cache: PathBuf,
}

/// Index windows that a check by one thread needs.
pub(super) const WINDOWS: usize = 4 * Cursor::WINDOWS;

/// Runs the command.
///
/// # Errors
/// A cache that cannot be opened, or in which anything is damaged.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let opened = Cache::open(&arguments.cache, WINDOWS)?;
    let bar = Bar::new("verify", "bricks");
    let report = cache::verify(&opened, &mut |done, total| bar.show("verify", done, total))?;
    drop(bar);
    let told = tell(arguments, &report, opened.header());
    if report.damaged == 0 {
        return told;
    }
    // Damage is told by the status even if nobody reads where it is.
    Err(Error::invalid(
        arguments.cache.display(),
        format!("{}: ingest the data again", places(report.damaged)),
    ))
}

fn tell(arguments: &Arguments, report: &Report, header: &Header) -> Result<()> {
    let mut output = Output::new();
    output.line(format!(
        "{}: {} bricks, {} payloads, {}",
        arguments.cache.display(),
        report.bricks,
        report.payloads,
        size::show(header.file_bytes)
    ))?;
    if report.damaged == 0 {
        output.line("every byte is sound")?;
    } else {
        for damage in &report.listed {
            output.line(format!("damaged: {}", damage.reason))?;
        }
        if report.unreachable > 0 {
            output.line(unreachable(report))?;
        }
        output.line(what_remains(report, header))?;
    }
    output.finish()
}

/// How much more than their own bytes damaged pages of the index take away.
fn unreachable(report: &Report) -> String {
    format!(
        "{} of {} bricks cannot be reached: damaged pages of the index hold what it says of them, of \
         their children or of those above them",
        report.unreachable, report.bricks
    )
}

fn places(damaged: u64) -> String {
    if damaged == 1 { "1 damaged place".to_owned() } else { format!("{damaged} damaged places") }
}

/// What can still be rendered: fields without damage, and views that need no damaged brick.
fn what_remains(report: &Report, header: &Header) -> String {
    if report.unreachable == report.bricks {
        return "nothing can be rendered".to_owned();
    }
    if report.damaged as usize > report.listed.len() {
        return "still renders: only what needs none of the damaged bricks (not all are listed)"
            .to_owned();
    }
    let whole = |field: usize| !report.listed.iter().any(|damage| touches(damage.part, field));
    let names = (0..header.fields.len()).filter(|&field| whole(field));
    let names: Vec<&str> = names.map(|field| header.fields[field].name.as_str()).collect();
    let places = by_place(report);
    let views = "views that need none of the damaged bricks";
    if names.is_empty() {
        format!("no field is undamaged; still renders: {views} ({places})")
    } else if names.len() == header.fields.len() {
        format!("still renders: everything ({places})")
    } else {
        format!("still renders: {}; of the other fields, {views} ({places})", names.join(", "))
    }
}

/// Whether pictures of a field may need what is damaged.
fn touches(damaged: Part, field: usize) -> bool {
    match damaged {
        Part::Brick { field: damaged, .. } => damaged.is_none_or(|damaged| damaged == field),
        Part::Page => true,
        Part::Between => false,
    }
}

/// How many damaged places are where: bricks by level, then the index, then what lies between.
fn by_place(report: &Report) -> String {
    let mut bricks = BTreeMap::new();
    let (mut pages, mut between) = (0, 0);
    for damage in &report.listed {
        match damage.part {
            Part::Brick { octree, .. } => *bricks.entry(octree).or_insert(0) += 1,
            Part::Page => pages += 1,
            Part::Between => between += 1,
        }
    }
    let bricks =
        bricks.into_iter().map(|(level, count)| format!("{count} at octree level {level}"));
    let pages = (pages > 0).then(|| format!("{pages} in the index"));
    let between = (between > 0).then(|| format!("{between} outside all bricks"));
    bricks.chain(pages).chain(between).collect::<Vec<_>>().join(", ")
}
