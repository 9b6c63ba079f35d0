//! The sweep as CSV.

use super::fixed::{Rival, best};
use super::measure::Measured;
use super::reference::Reference;
use super::renderer::Cost;
use crate::{Error, Result};

/// One tolerance's row.
#[derive(Debug)]
pub(super) struct Row {
    /// Relative tolerance; 0: exact.
    pub(super) tolerance: f64,
    /// Its picture.
    pub(super) measured: Measured,
}

/// The rows with a header: numbers that do not exist are empty.
///
/// # Errors
/// None in practice: text in memory.
pub(super) fn sweep(
    rows: &[Row],
    reference: &Reference,
    rivals: Option<&[Rival]>,
) -> Result<String> {
    let table: Vec<_> = rows.iter().map(|row| sweep_row(row, rows, reference, rivals)).collect();
    csv(&table)
}

/// Name and value of each of a row's columns.
pub(super) type Columns = Vec<(String, String)>;

/// Rows of equal columns as CSV.
///
/// # Errors
/// None in practice: text in memory.
pub(super) fn csv(rows: &[Columns]) -> Result<String> {
    let failed = |error: &dyn std::fmt::Display| Error::request(format!("cannot write: {error}"));
    let mut writer = csv::Writer::from_writer(Vec::new());
    let names = rows.first().into_iter().map(|row| row.iter().map(|(name, _)| name).collect());
    let values = rows.iter().map(|row| row.iter().map(|(_, value)| value).collect());
    for record in names.chain(values) {
        let record: Vec<&String> = record;
        writer.write_record(record).map_err(|error| failed(&error))?;
    }
    let bytes = writer.into_inner().map_err(|error| failed(&error))?;
    String::from_utf8(bytes).map_err(|error| failed(&error))
}

/// A column.
pub(super) fn column(name: impl Into<String>, value: impl ToString) -> (String, String) {
    optional(name, Some(value))
}

/// A column that may be empty.
pub(super) fn optional(name: impl Into<String>, value: Option<impl ToString>) -> (String, String) {
    (name.into(), value.map(|value| value.to_string()).unwrap_or_default())
}

/// What a picture cost beside time.
pub(super) fn counts(cost: &Cost) -> Columns {
    vec![
        column("bytes_read", cost.bytes_read),
        column("bytes_decompressed", cost.bytes_decompressed),
        column("bricks_loaded", cost.bricks_loaded),
        column("samples", cost.samples),
        optional("rays", cost.rays),
        optional("peak_rss_bytes", cost.peak_rss_bytes),
    ]
}

/// A number in the scientific notation, as errors span decades.
pub(super) fn number(value: f64) -> String {
    format!("{value:e}")
}

fn sweep_row(row: &Row, rows: &[Row], reference: &Reference, rivals: Option<&[Rival]>) -> Columns {
    let Measured { cost, seconds, error, .. } = &row.measured;
    let largest = reference.largest_value();
    let relative = |value: f64| (largest > 0.0).then(|| number(value / largest));
    let looseness = cost.error_bound.filter(|_| *error > 0.0).map(|bound| number(bound / error));
    let mut columns = vec![
        column("tolerance", row.tolerance),
        optional("tolerance_absolute", cost.tolerance.map(number)),
        optional("error_bound", cost.error_bound.map(number)),
        optional("error_bound_relative", cost.error_bound.and_then(relative)),
        optional("error_estimate", cost.error_estimate.map(number)),
        optional("error_estimate_relative", cost.error_estimate.and_then(relative)),
        column("error", number(*error)),
        optional("error_relative", relative(*error)),
        optional("bound_over_error", looseness),
        column("seconds", seconds),
    ];
    columns.extend(counts(cost));
    columns.push(column("reference_rays", reference.rays));
    columns.push(column("reference_change", number(reference.change)));
    columns.push(optional("reference_change_relative", relative(reference.change)));
    let shares = rows.iter().find_map(|row| row.measured.cost.error_shares.as_ref());
    for name in shares.iter().flat_map(|shares| shares.keys()) {
        let share = cost.error_shares.as_ref().and_then(|shares| *shares.get(name)?);
        columns.push(optional(format!("share_{name}"), share.map(number)));
    }
    if let Some(rivals) = rivals {
        columns.extend(rival_columns(&row.measured, reference, rivals));
    }
    columns
}

fn rival_columns(row: &Measured, reference: &Reference, rivals: &[Rival]) -> Columns {
    let rival = best(rivals, reachable(row, reference));
    let setting = rival.map(|rival| rival.setting);
    let seconds = rival.map(|rival| rival.measured.seconds);
    vec![
        optional("fixed_pixels_per_cell", setting.map(|setting| setting.pixels_per_cell)),
        optional("fixed_rays_per_axis", setting.map(|setting| setting.rays_per_axis)),
        optional("fixed_accuracy", setting.map(|setting| setting.relative_accuracy)),
        optional("fixed_error", rival.map(|rival| number(rival.measured.error))),
        optional("fixed_seconds", seconds),
        optional("seconds_over_fixed", seconds.map(|seconds| row.seconds / seconds)),
    ]
}

/// The error that a rival must reach: the row's own, but no smaller than can be measured. Where the
/// picture is smooth, the error of n×n rays falls with n², so that the reference's own is a third of
/// what it moved by when n was doubled.
pub(super) fn reachable(row: &Measured, reference: &Reference) -> f64 {
    row.error.max(reference.change / 3.0)
}
