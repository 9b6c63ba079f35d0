//! `deepfield verify`.

use std::collections::BTreeMap;
use std::path::PathBuf;

use clap::Args;

use super::output::Output;
use super::progress::Bar;
use super::size;
use crate::cache::{Cache, Cursor, Damage, Header, Report};
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
        output.line(what_remains(report, header))?;
    }
    output.finish()
}

fn places(damaged: u64) -> String {
    if damaged == 1 { "1 damaged place".to_owned() } else { format!("{damaged} damaged places") }
}

/// What can still be rendered: fields without damage, and views that need no damaged brick.
fn what_remains(report: &Report, header: &Header) -> String {
    if report.damaged as usize > report.listed.len() {
        return "still renders: only what needs none of the damaged bricks (not all are listed)"
            .to_owned();
    }
    let whole = |field: usize| {
        let touches = |d: &Damage| d.field.is_none_or(|damaged| damaged == field);
        !report.listed.iter().any(touches)
    };
    let names = (0..header.fields.len()).filter(|&field| whole(field));
    let names: Vec<&str> = names.map(|field| header.fields[field].name.as_str()).collect();
    let mut levels = BTreeMap::new();
    for damage in &report.listed {
        *levels.entry(damage.octree).or_insert(0) += 1;
    }
    let levels: Vec<String> = levels
        .into_iter()
        .map(|(level, count)| match level {
            Some(level) => format!("{count} at octree level {level}"),
            None => format!("{count} outside all bricks"),
        })
        .collect();
    let levels = levels.join(", ");
    let views = "views that need none of the damaged bricks";
    if names.is_empty() {
        format!("no field is undamaged; still renders: {views} ({levels})")
    } else {
        format!("still renders: {}; of the other fields, {views} ({levels})", names.join(", "))
    }
}
