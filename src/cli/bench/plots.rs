//! What pictures take against their errors, as plots.

use super::fixed::Rival;
use super::measure::Measured;
use super::plot::{Line, Mark, Plot, Series};
use super::reference::Reference;
use super::table::Row;

/// Something that a picture takes.
struct Quantity {
    /// The plot's file.
    file: &'static str,
    label: &'static str,
    of: fn(&Measured) -> f64,
}

const QUANTITIES: [Quantity; 3] = [
    Quantity { file: "seconds.svg", label: "time (s)", of: |picture| picture.seconds },
    Quantity {
        file: "bytes.svg",
        label: "bytes read",
        of: |picture| picture.cost.bytes_read as f64,
    },
    Quantity { file: "samples.svg", label: "samples", of: |picture| picture.cost.samples as f64 },
];

/// The plots of a sweep of `scene`, each with its file's name.
pub(super) fn plots(
    scene: &str,
    rows: &[Row],
    reference: &Reference,
    rivals: &[Rival],
) -> Vec<(&'static str, Plot)> {
    let plot = |quantity| plot(scene, quantity, rows, reference, rivals);
    QUANTITIES.iter().map(|quantity| (quantity.file, plot(quantity))).collect()
}

fn plot(
    scene: &str,
    quantity: &Quantity,
    rows: &[Row],
    reference: &Reference,
    rivals: &[Rival],
) -> Plot {
    let scale = reference.largest_value().recip();
    let measured = |picture: &Measured| [scale * picture.error, (quantity.of)(picture)];
    let bound =
        |picture: &Measured| Some([scale * picture.cost.error_bound?, (quantity.of)(picture)]);
    let swept = || rows.iter().filter(|row| row.tolerance > 0.0).map(|row| &row.measured);
    let exact = rows.iter().find(|row| row.tolerance == 0.0);
    let exact = exact.map_or(0.0, |row| (quantity.of)(&row.measured));
    let by_hand = rivals.iter().map(|rival| measured(&rival.measured));
    let change = scale * reference.change;
    Plot {
        title: format!("{scene}: {}", quantity.label),
        x_label: "error / largest value of the picture".to_owned(),
        y_label: quantity.label.to_owned(),
        series: vec![
            Series::new("set by hand", Mark::Dots, by_hand),
            Series::new("certified bound", Mark::Joined, swept().filter_map(bound)),
            Series::new("measured error", Mark::Joined, swept().map(measured)),
        ],
        lines: vec![
            Line { name: "exact".into(), is_vertical: false, at: exact },
            Line { name: "reference\u{2019}s own change".into(), is_vertical: true, at: change },
        ],
    }
}
