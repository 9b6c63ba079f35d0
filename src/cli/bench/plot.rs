//! Plots as SVG text: both axes logarithmic, whole decades, a legend beside.

use std::fmt::Write;
use std::ops::Range;

const WIDTH: f64 = 760.0;
const HEIGHT: f64 = 420.0;
/// The box between the axes: left, top, right, bottom.
const FRAME: [f64; 4] = [80.0, 40.0, 560.0, 360.0];
/// Most decades whose ticks all have a label.
const LABELLED_DECADES: i32 = 8;
/// Colours that people with any kind of colour vision tell apart (Okabe and Ito, 2008).
const COLORS: [&str; 5] = ["#999999", "#e69f00", "#0072b2", "#009e73", "#d55e00"];

/// How a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mark {
    /// Single points.
    Dots,
    /// Points joined in their order.
    Joined,
}

/// Points under one name.
#[derive(Debug)]
pub(super) struct Series {
    name: String,
    mark: Mark,
    points: Vec<[f64; 2]>,
}

impl Series {
    /// The points that a logarithmic axis can show: the others are left out.
    pub(super) fn new(name: &str, mark: Mark, points: impl Iterator<Item = [f64; 2]>) -> Self {
        let points = points.filter(|point| point.iter().all(|x| is_shown(*x))).collect();
        Self { name: name.to_owned(), mark, points }
    }
}

/// A dashed line across the plot; left out where a logarithmic axis cannot show it.
#[derive(Debug)]
pub(super) struct Line {
    /// What the plot calls it.
    pub(super) name: String,
    /// Whether it stands at an x; else it lies at a y.
    pub(super) is_vertical: bool,
    /// That x or y, in the axis' unit.
    pub(super) at: f64,
}

/// A plot.
#[derive(Debug)]
pub(super) struct Plot {
    /// What stands above it.
    pub(super) title: String,
    /// What stands beside the x axis.
    pub(super) x_label: String,
    /// What stands beside the y axis.
    pub(super) y_label: String,
    /// The points, series by series.
    pub(super) series: Vec<Series>,
    /// The dashed lines.
    pub(super) lines: Vec<Line>,
}

impl Plot {
    /// The plot as an SVG file.
    pub(super) fn svg(&self) -> String {
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" \
             font-family=\"sans-serif\" font-size=\"12\">\n\
             <rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"white\"/>\n"
        );
        let axes = [self.axis(0), self.axis(1)];
        let [left, top, right, bottom] = FRAME;
        let middle = [0.5 * (left + right), 0.5 * (top + bottom)];
        text(&mut svg, [middle[0], top - 16.0], "text-anchor=\"middle\"", &self.title);
        text(&mut svg, [middle[0], bottom + 42.0], "text-anchor=\"middle\"", &self.x_label);
        let upright = format!("text-anchor=\"middle\" transform=\"rotate(-90 20 {})\"", middle[1]);
        text(&mut svg, [20.0, middle[1]], &upright, &self.y_label);
        for axis in &axes {
            axis.ticks(&mut svg);
        }
        self.draw_series(&mut svg, &axes);
        self.draw_lines(&mut svg, &axes);
        svg + "</svg>\n"
    }

    /// The axis that shows all that there is along x (0) or y (1).
    fn axis(&self, which: usize) -> Axis {
        let points = self.series.iter().flat_map(|series| &series.points);
        let lines = self.shown_lines().filter(|line| line.is_vertical == (which == 0));
        let values = points.map(|point| point[which]).chain(lines.map(|line| line.at));
        Axis::new(which == 0, values)
    }

    fn shown_lines(&self) -> impl Iterator<Item = &Line> {
        self.lines.iter().filter(|line| is_shown(line.at))
    }

    fn draw_series(&self, svg: &mut String, axes: &[Axis; 2]) {
        let shown = self.series.iter().filter(|series| !series.points.is_empty());
        for (entry, (series, color)) in shown.zip(COLORS).enumerate() {
            let at = |[x, y]: &[f64; 2]| [axes[0].place(*x), axes[1].place(*y)];
            let points: Vec<_> = series.points.iter().map(at).collect();
            if series.mark == Mark::Joined {
                let path: Vec<_> = points.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
                put(
                    svg,
                    format_args!(
                        "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"2\"/>",
                        path.join(" ")
                    ),
                );
            }
            let name_at = legend(entry);
            for [x, y] in points.iter().chain([&[name_at[0] - 14.0, name_at[1] - 4.0]]) {
                put(
                    svg,
                    format_args!(
                        "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.5\" fill=\"{color}\"/>"
                    ),
                );
            }
            text(svg, name_at, "", &series.name);
        }
    }

    fn draw_lines(&self, svg: &mut String, axes: &[Axis; 2]) {
        let [left, top, right, bottom] = FRAME;
        let first = self.series.iter().filter(|series| !series.points.is_empty()).count();
        for (entry, line) in self.shown_lines().enumerate() {
            let (color, dashes) = (COLORS[(3 + entry) % COLORS.len()], "stroke-dasharray=\"6 4\"");
            let at = axes[usize::from(!line.is_vertical)].place(line.at);
            let ends = if line.is_vertical { [at, top, at, bottom] } else { [left, at, right, at] };
            let [x, y] = legend(first + entry);
            for ends in [ends, [x - 24.0, y - 4.0, x - 4.0, y - 4.0]] {
                stroke(svg, ends, &format!("stroke=\"{color}\" {dashes}"));
            }
            text(svg, [x, y], "", &line.name);
        }
    }
}

/// A logarithmic axis over whole decades.
#[derive(Debug)]
struct Axis {
    is_horizontal: bool,
    decades: Range<i32>,
}

impl Axis {
    fn new(is_horizontal: bool, values: impl Iterator<Item = f64>) -> Self {
        let logs: Vec<f64> = values.map(f64::log10).collect();
        let low = logs.iter().copied().fold(f64::INFINITY, f64::min).floor();
        let high = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max).ceil();
        // With nothing to show, any decade will do.
        let decades =
            if low <= high { low as i32..(high as i32).max(low as i32 + 1) } else { 0..1 };
        Self { is_horizontal, decades }
    }

    /// Where `value` lies in the picture.
    fn place(&self, value: f64) -> f64 {
        let share = (value.log10() - f64::from(self.decades.start)) / self.decades.len() as f64;
        let [left, top, right, bottom] = FRAME;
        if self.is_horizontal {
            left + share * (right - left)
        } else {
            bottom - share * (bottom - top)
        }
    }

    /// Grid lines at decades, small ticks between them, and labels.
    fn ticks(&self, svg: &mut String) {
        let every = (self.decades.len() as i32).div_euclid(LABELLED_DECADES) + 1;
        for decade in self.decades.start..=self.decades.end {
            self.tick(svg, 10f64.powi(decade), "stroke=\"#cccccc\"", f64::INFINITY);
            if (decade - self.decades.start) % every == 0 {
                self.label(svg, decade);
            }
            if decade < self.decades.end {
                for n in 2..10 {
                    let value = f64::from(n) * 10f64.powi(decade);
                    self.tick(svg, value, "stroke=\"black\"", 4.0);
                }
            }
        }
        let [left, top, right, bottom] = FRAME;
        let ends = if self.is_horizontal {
            [left, bottom, right, bottom]
        } else {
            [left, top, left, bottom]
        };
        stroke(svg, ends, "stroke=\"black\"");
    }

    fn tick(&self, svg: &mut String, value: f64, style: &str, length: f64) {
        let [left, top, right, bottom] = FRAME;
        let at = self.place(value);
        let ends = if self.is_horizontal {
            [at, bottom, at, (bottom - length).max(top)]
        } else {
            [left, at, (left + length).min(right), at]
        };
        stroke(svg, ends, style);
    }

    fn label(&self, svg: &mut String, decade: i32) {
        let [left, _, _, bottom] = FRAME;
        let at = self.place(10f64.powi(decade));
        let name = if (-1..=3).contains(&decade) {
            format!("{}", 10f64.powi(decade))
        } else {
            format!("1e{decade}")
        };
        if self.is_horizontal {
            text(svg, [at, bottom + 18.0], "text-anchor=\"middle\"", &name);
        } else {
            text(svg, [left - 8.0, at + 4.0], "text-anchor=\"end\"", &name);
        }
    }
}

/// Where the name of legend entry `entry` begins.
fn legend(entry: usize) -> [f64; 2] {
    [FRAME[2] + 40.0, FRAME[1] + 16.0 + 20.0 * entry as f64]
}

fn is_shown(value: f64) -> bool {
    value.is_finite() && value > 0.0
}

fn stroke(svg: &mut String, [x1, y1, x2, y2]: [f64; 4], style: &str) {
    put(
        svg,
        format_args!("<line x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\" {style}/>"),
    );
}

fn text(svg: &mut String, [x, y]: [f64; 2], style: &str, words: &str) {
    let words = words.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    put(svg, format_args!("<text x=\"{x:.1}\" y=\"{y:.1}\" {style}>{words}</text>"));
}

/// A line of text; writing to memory does not fail.
fn put(svg: &mut String, line: std::fmt::Arguments<'_>) {
    let _ = writeln!(svg, "{line}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decades_hold_all_values_and_places_are_logarithmic() {
        let axis = Axis::new(true, [3e-4, 0.02].into_iter());
        assert_eq!(axis.decades, -4..-1);
        assert_eq!(axis.place(1e-4), FRAME[0]);
        assert!((axis.place(1e-1) - FRAME[2]).abs() < 1e-9);
        assert!((axis.place(1e-2) - (FRAME[0] + 2.0 * (FRAME[2] - FRAME[0]) / 3.0)).abs() < 1e-9);
        assert_eq!(Axis::new(false, [10.0].into_iter()).decades, 1..2);
        assert_eq!(Axis::new(false, std::iter::empty()).decades, 0..1);
    }

    #[test]
    fn what_no_logarithm_shows_is_left_out() {
        let points = [[0.0, 1.0], [1e-3, 2.0], [1e-2, f64::NAN], [f64::INFINITY, 1.0]];
        let series = vec![Series::new("a < b & c", Mark::Joined, points.into_iter())];
        let line = |at| Line { name: "exact".into(), is_vertical: false, at };
        let plot = Plot {
            title: String::new(),
            x_label: "error".into(),
            y_label: "time".into(),
            series,
            lines: vec![line(0.0), line(5.0)],
        };
        let svg = plot.svg();
        // One point and its sign in the legend.
        assert_eq!(svg.matches("<circle").count(), 2);
        assert_eq!(svg.matches("stroke-dasharray").count(), 2);
        assert!(svg.contains("a &lt; b &amp; c") && !svg.contains("NaN") && !svg.contains("inf"));
    }
}
