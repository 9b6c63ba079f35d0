//! `deepfield info`.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Value, json};

use super::output::{Output, warn};
use super::{ingest, progress::Bar, size, values};
use crate::cache::{Cache, CachedField, Cursor, Header, LeafCell, TreeLevel, largest_leaf};
use crate::ingest::{Options, Progress};
use crate::source::{self, Source};
use crate::{Error, Result};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// A simulation output or a cache
    input: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// The input's format: enzo, amrex, athena++, flash or athena (default: told by its content)
    #[arg(long, value_name = "NAME", value_parser = values::read_format)]
    format: Option<String>,
    /// Of a simulation output, read only what describes it: no extrema, sums and leaf cells
    #[arg(long)]
    headers: bool,
    /// Memory that reading a simulation output may take, as in `256MiB`
    #[arg(
        long,
        value_name = "SIZE",
        default_value = "1GiB",
        value_parser = size::parse,
        allow_hyphen_values = true
    )]
    memory: u64,
}

/// Digits of a position beyond those of a cell's width.
const MORE_DIGITS: usize = 2;

/// Runs the command.
///
/// # Errors
/// An input that cannot be read, and standard output that cannot be written.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let facts = if Cache::is_cache(&arguments.input) {
        let cache = Cache::open(&arguments.input, Cursor::WINDOWS)?;
        let mut facts = facts(cache.header(), &arguments.input, &json!("cache"));
        add_maxima(&cache, &mut facts);
        facts
    } else {
        let source = source::open(&arguments.input, arguments.format.as_deref())?;
        if arguments.headers {
            super::headers::facts(source.as_ref(), &arguments.input)?
        } else {
            let (header, unreadable) = survey(source.as_ref(), arguments.memory)?;
            let mut facts = facts(&header, &arguments.input, &json!("simulation output"));
            if !unreadable.is_empty() {
                facts["unreadable_fields"] = json!(unreadable);
            }
            facts
        }
    };
    let mut output = Output::new();
    if arguments.json {
        let text = serde_json::to_string_pretty(&facts)
            .map_err(|error| Error::request(format!("cannot write JSON: {error}")))?;
        return output.end_with(&text);
    }
    print(&facts, &mut output)?;
    output.finish()
}

/// Reads all fields of a source that can be read, and says of the others why they are left out: extrema
/// and sums over leaf cells are not in its headers.
fn survey(source: &dyn Source, memory: u64) -> Result<(Header, Vec<Value>)> {
    let names: Vec<_> = source.hierarchy().fields.iter().map(|field| field.name.clone()).collect();
    let first = match survey_fields(source, memory, &names) {
        Ok(header) => return Ok((header, Vec::new())),
        Err(error) => error,
    };
    let (mut readable, mut unreadable) = (Vec::new(), Vec::<(String, String)>::new());
    for name in names {
        match survey_fields(source, memory, std::slice::from_ref(&name)) {
            Ok(_) => readable.push(name),
            // What is said of two fields is no fault of theirs.
            Err(error) if unreadable.iter().any(|(_, said)| *said == error.to_string()) => {
                return Err(first);
            }
            Err(error) => unreadable.push((name, error.to_string())),
        }
    }
    if readable.is_empty() {
        return Err(first);
    }
    let header = survey_fields(source, memory, &readable)?;
    for (name, reason) in &unreadable {
        warn(format!("{name} is left out: {reason}"));
    }
    let left_out = |(name, reason)| json!({ "name": name, "reason": reason });
    Ok((header, unreadable.into_iter().map(left_out).collect()))
}

fn survey_fields(source: &dyn Source, memory: u64, fields: &[String]) -> Result<Header> {
    let options = Options { fields: fields.to_vec(), memory, ..Options::default() };
    let bar = Bar::new("reading", "bricks");
    let mut listener = |stage, done, total| bar.show(ingest::label(stage), done, total);
    let mut progress = Progress::new(&mut listener);
    crate::ingest::survey(source, &std::env::temp_dir(), &options, &mut progress)
}

fn facts(header: &Header, path: &Path, kind: &Value) -> Value {
    let levels = || header.levels.iter();
    let simulated = || levels().filter(|level| level.simulation.is_some());
    // Of codes that write leaf cells alone, refined cells of their levels are averages of our own.
    let has_covered = source::has_covered_cells(&header.source_format);
    let own_cells = |level: &TreeLevel| {
        let all = has_covered || level.simulation.is_none();
        if all { level.cells } else { level.leaf_cells }
    };
    let mut facts = json!({
        "path": path.display().to_string(),
        "kind": kind,
        "format": header.source_format,
        "time": header.time,
        "domain": {
            "left": header.domain.left(),
            "right": header.domain.right(),
            "root_cells": header.domain.root_cells(),
        },
        "max_level": simulated().filter_map(|level| level.simulation).max(),
        "refinement_factors": factors(header),
        "grids": levels().map(|level| level.grids).sum::<u64>(),
        "cells": simulated().map(own_cells).sum::<u64>(),
        "leaf_cells": levels().map(|level| level.leaf_cells).sum::<u64>(),
        "brick_edge": header.shape.edge(),
        "bricks": header.nodes(),
        "levels": levels().map(|level| level_facts(level, own_cells(level))).collect::<Vec<_>>(),
        "fields": header.fields.iter().map(field_facts).collect::<Vec<_>>(),
    });
    if kind == "cache"
        && let Some(facts) = facts.as_object_mut()
    {
        facts.insert("file_bytes".into(), json!(header.file_bytes));
        facts.insert("checksum".into(), json!(format!("{:016x}", header.checksum)));
    }
    facts
}

/// Adds to the facts of each field where it is largest. Of damaged caches all else is told.
fn add_maxima(cache: &Cache, facts: &mut Value) {
    let fields = facts["fields"].as_array_mut().into_iter().flatten();
    for (number, (field, described)) in fields.zip(&cache.header().fields).enumerate() {
        let found = largest_leaf(cache, number, 0)
            .and_then(|cell| cell.map(|cell| maximum(cache, &cell)).transpose());
        field["max_at"] = found
            .unwrap_or_else(|error| {
                warn(format!("{}: it is not told where it is largest: {error}", described.name));
                None
            })
            .unwrap_or(Value::Null);
    }
}

/// Where a cell lies: its centre, in digits enough to tell it from its neighbours, and its level.
fn maximum(cache: &Cache, cell: &LeafCell) -> Result<Value> {
    let header = cache.header();
    let domain = &header.domain;
    let mut position = domain.decimals(&cell.centre(cache))?;
    for (text, width) in position.iter_mut().zip(domain.cell_width(cell.octree).to_array()) {
        let digits = (-width.log10()).ceil().max(0.0) as usize + MORE_DIGITS;
        let point = text.find('.').unwrap_or(text.len());
        text.truncate((point + 1 + digits).min(text.len()));
    }
    let level = header.levels.get(cell.tree_level).and_then(|level| level.simulation);
    Ok(json!({ "position": position, "level": level }))
}

fn factors(header: &Header) -> Vec<u32> {
    let simulated = header.levels.iter().filter(|level| level.simulation.is_some());
    let octree: Vec<i32> = simulated.map(|level| level.octree).collect();
    octree.windows(2).map(|pair| 1 << (pair[1] - pair[0])).collect()
}

fn level_facts(level: &TreeLevel, cells: u64) -> Value {
    json!({
        "level": level.simulation,
        "octree_level": level.octree,
        "grids": level.grids,
        "cells": cells,
        "leaf_cells": level.leaf_cells,
        "bricks": level.nodes,
    })
}

fn field_facts(field: &CachedField) -> Value {
    json!({
        "name": field.name,
        "units": field.units,
        "to_cgs": field.to_cgs,
        "min": field.min,
        "max": field.max,
        "smallest_positive": field.smallest_positive,
        "sum": field.sum,
        "sum_as_stored": field.stored_sum,
        "exponent": field.exponent,
        "relative_error": field.relative_error,
        "leaf_error": field.leaf_error,
        "nan_cells": field.nan_cells,
        "dropped_cells": field.dropped_cells,
        "dropped_volume": field.dropped_volume,
        "dropped_sum": field.dropped_sum,
    })
}

fn print(facts: &Value, output: &mut Output) -> Result<()> {
    let text = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    for key in [
        "path",
        "kind",
        "format",
        "time",
        "max_level",
        "refinement_factors",
        "grids",
        "cells",
        "leaf_cells",
        "brick_edge",
        "bricks",
        "checksum",
    ] {
        if let Some(value) = facts.get(key) {
            output.line(format!("{key}: {}", text(value)))?;
        }
    }
    if let Some(bytes) = facts.get("file_bytes").and_then(Value::as_u64) {
        output.line(format!("file: {bytes} bytes ({})", size::show(bytes)))?;
    }
    let domain = &facts["domain"];
    let (left, right, cells) = (&domain["left"], &domain["right"], &domain["root_cells"]);
    output.line(format!("domain: {left} to {right}, root grid {cells}"))?;
    let title = ["level", "octree", "grids", "cells", "leaf cells", "bricks"];
    output.line(row(&title.map(str::to_owned)))?;
    for level in facts["levels"].as_array().into_iter().flatten() {
        let simulation = &level["level"];
        let name = if simulation.is_null() { "–".to_owned() } else { text(simulation) };
        let [octree, grids, cells, leaf, bricks] =
            ["octree_level", "grids", "cells", "leaf_cells", "bricks"]
                .map(|key| level.get(key).map_or_else(|| "–".to_owned(), text));
        output.line(row(&[name, octree, grids, cells, leaf, bricks]))?;
    }
    for field in facts["fields"].as_array().into_iter().flatten() {
        print_field(field, output)?;
    }
    Ok(())
}

fn row(cells: &[String; 6]) -> String {
    cells.iter().map(|cell| format!("{cell:>12}")).collect()
}

/// The unit of a field's code values: ` g/cm^3`, or ` in 1.67e-24 g/cm^3`; empty if unknown.
fn unit(field: &Value) -> String {
    let factor = field["to_cgs"].as_f64().filter(|factor| *factor != 1.0);
    match (factor, field["units"].as_str()) {
        (None, None) => String::new(),
        (None, Some(unit)) => format!(" {unit}"),
        (Some(factor), unit) => format!(" in {factor:?} {}", unit.unwrap_or("cgs")),
    }
}

fn print_field(field: &Value, output: &mut Output) -> Result<()> {
    let number = |key: &str| match &field[key] {
        Value::Null => "none".to_owned(),
        value => value.to_string(),
    };
    let unit = unit(field);
    if field.get("min").is_none() {
        return output.line(format!("field {}:{unit}", field["name"].as_str().unwrap_or("?")));
    }
    output.line(format!(
        "field {}: {} to {}{unit}, sum value·volume {} (as stored {})",
        field["name"].as_str().unwrap_or("?"),
        number("min"),
        number("max"),
        number("sum"),
        number("sum_as_stored"),
    ))?;
    if let Some([x, y, z]) = field["max_at"]["position"].as_array().map(Vec::as_slice) {
        let position = [x, y, z].map(|x| x.as_str().unwrap_or("?")).join(",");
        let level = &field["max_at"]["level"];
        output.line(format!("  max {} at {position} (level {level})", number("max")))?;
    }
    if field["dropped_cells"].as_u64().is_some_and(|cells| cells > 0) {
        output.line(format!(
            "  dropped: {} leaf cells, volume {}, sum value·volume {}",
            number("dropped_cells"),
            number("dropped_volume"),
            number("dropped_sum")
        ))?;
    }
    if field["nan_cells"].as_u64().is_some_and(|cells| cells > 0) {
        output.line(format!("  NaN: {} leaf cells", number("nan_cells")))?;
    }
    Ok(())
}
