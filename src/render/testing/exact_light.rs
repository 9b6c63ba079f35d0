//! The emission–absorption integral along a polynomial, to fifty digits and by brute force:
//! the stretch is halved until x lies within one segment of the transfer function and the optical
//! depth is small; transmittance and light are then power series in s. Shares nothing with the
//! march.

use super::fixed::Fixed;
use crate::scene::PiecewiseLinear;

/// Parts shorter than 2⁻²⁴⁰ of the stretch are left out.
const SMALLEST_PART: u32 = 240;
/// Light behind a transmittance below 2⁻¹⁵⁰ is left out.
const OPAQUE: u32 = 150;
/// Terms of a series below 2⁻²⁰⁰ are left out.
const LAST_TERM: u32 = 200;

/// The tables of a scene's volume.
pub(crate) struct Tables {
    pub(crate) absorption: PiecewiseLinear,
    pub(crate) emission: PiecewiseLinear,
    pub(crate) color: PiecewiseLinear<3>,
}

/// What a ray has gathered.
pub(crate) struct Gathered {
    pub(crate) radiance: [Fixed; 3],
    pub(super) transmittance: Fixed,
}

impl Gathered {
    pub(crate) fn opacity(&self) -> Fixed {
        &Fixed::one() - &self.transmittance
    }
}

type Line = [Fixed; 2];

/// Between `start` and `end` (none: unbounded) all tables are straight lines in t, which is 0 at
/// the start and 1 at the end.
struct Segment {
    start: Option<Fixed>,
    end: Option<Fixed>,
    extinction: Line,
    emission: Line,
    color: [Line; 3],
}

/// The integral for one volume.
pub(crate) struct ExactLight {
    segments: Vec<Segment>,
}

impl ExactLight {
    pub(crate) fn new(tables: &Tables) -> Self {
        let inside = |x: &f64| *x > 0.0 && *x < 1.0;
        let mut knots: Vec<f64> = [
            tables.absorption.positions(),
            tables.emission.positions(),
            tables.color.positions(),
            &[0.0, 1.0],
        ]
        .concat();
        knots.retain(|x| inside(x) || *x == 0.0 || *x == 1.0);
        knots.sort_by(f64::total_cmp);
        knots.dedup();
        let mut segments = vec![segment(tables, [0.0; 2], [None, Some(0.0)])];
        segments.extend(
            knots.windows(2).map(|w| segment(tables, [w[0], w[1]], [Some(w[0]), Some(w[1])])),
        );
        segments.push(segment(tables, [1.0; 2], [Some(1.0), None]));
        Self { segments }
    }

    /// What a ray gathers along `length` where x is Σ `x`[k] s^k + `shift`, s in [0, 1].
    pub(crate) fn along(&self, x: &[f64], shift: f64, length: f64) -> Gathered {
        let mut x: Vec<Fixed> = x.iter().map(|c| Fixed::of(*c)).collect();
        x[0] = &x[0] + &Fixed::of(shift);
        let mut gathered = Gathered {
            radiance: std::array::from_fn(|_| Fixed::zero()),
            transmittance: Fixed::one(),
        };
        self.part(&x, &Fixed::of(length), 0, &mut gathered);
        gathered
    }

    fn part(&self, x: &[Fixed], length: &Fixed, halvings: u32, gathered: &mut Gathered) {
        if gathered.transmittance.is_below(OPAQUE) || halvings > SMALLEST_PART {
            return;
        }
        let points = control_points(x);
        let (Some(low), Some(high)) = (points.iter().min(), points.iter().max()) else { return };
        let holds = |segment: &&Segment| {
            segment.start.as_ref().is_none_or(|start| start <= low)
                && segment.end.as_ref().is_none_or(|end| high <= end)
        };
        let done =
            self.segments.iter().find(holds).is_some_and(|segment| {
                segment.is_dark() || add_series(segment, x, length, gathered)
            });
        if !done {
            let (lower, upper) = halves(x);
            let length = length.scaled(-1);
            self.part(&lower, &length, halvings + 1, gathered);
            self.part(&upper, &length, halvings + 1, gathered);
        }
    }
}

impl Segment {
    fn is_dark(&self) -> bool {
        let is_zero = |line: &Line| line.iter().all(|c| *c == Fixed::zero());
        is_zero(&self.extinction) && (is_zero(&self.emission) || self.color.iter().all(is_zero))
    }
}

fn segment(tables: &Tables, [start, end]: [f64; 2], bounds: [Option<f64>; 2]) -> Segment {
    let ends = |table: &PiecewiseLinear| -> Line {
        let [line] = table_line(table, start, end);
        line
    };
    let [first, last] = bounds.map(|bound| bound.map(Fixed::of));
    Segment {
        start: first,
        end: last,
        extinction: ends(&tables.absorption),
        emission: ends(&tables.emission),
        color: table_line(&tables.color, start, end),
    }
}

/// Values just above `start` and just below `end`, between which there is no point; at `start`
/// if both are one.
fn table_line<const C: usize>(table: &PiecewiseLinear<C>, start: f64, end: f64) -> [Line; C] {
    let positions = table.positions();
    let above = positions.partition_point(|x| *x <= start);
    std::array::from_fn(|c| {
        let value = |n: usize| Fixed::of(table.values()[n][c]);
        if above == 0 || above == positions.len() {
            let n = if above == 0 { 0 } else { above - 1 };
            return [value(n), value(n)];
        }
        let (left, right) = (Fixed::of(positions[above - 1]), Fixed::of(positions[above]));
        [start, end].map(|x| {
            let t = (&Fixed::of(x) - &left).divided(&(&right - &left));
            &value(above - 1) + &(&t * &(&value(above) - &value(above - 1)))
        })
    })
}

/// Adds a part within `segment`, unless the series would converge slowly.
fn add_series(segment: &Segment, x: &[Fixed], length: &Fixed, gathered: &mut Gathered) -> bool {
    let mut t = x.to_vec();
    if let (Some(start), Some(end)) = (&segment.start, &segment.end) {
        t[0] = &t[0] - start;
        let width = end - start;
        t.iter_mut().for_each(|c| *c = c.divided(&width));
    }
    let along = |line: &Line| -> Vec<Fixed> {
        let slope = &line[1] - &line[0];
        let mut values: Vec<Fixed> = t.iter().map(|c| c * &slope).collect();
        values[0] = &values[0] + &line[0];
        values
    };
    let extinction: Vec<Fixed> = along(&segment.extinction).iter().map(|c| c * length).collect();
    let size = extinction.iter().fold(Fixed::zero(), |sum, c| &sum + &c.abs());
    if size > Fixed::one() {
        return false;
    }
    let series = transmittance(&extinction);
    let emission = along(&segment.emission);
    for (radiance, color) in gathered.radiance.iter_mut().zip(&segment.color) {
        let light = product_integral(&product(&emission, &along(color)), &series);
        *radiance = &*radiance + &(&(&gathered.transmittance * length) * &light);
    }
    let through = series.iter().fold(Fixed::zero(), |sum, c| &sum + c);
    gathered.transmittance = &gathered.transmittance * &through;
    true
}

/// The power series of T(s), where T′ = −κ(s)·T and T(0) = 1: n·T_n = −Σ κ_k T_{n−1−k}.
fn transmittance(extinction: &[Fixed]) -> Vec<Fixed> {
    let mut series = vec![Fixed::one()];
    while !series.iter().rev().take(extinction.len()).all(|c| c.is_below(LAST_TERM)) {
        let n = series.len();
        let sum = extinction
            .iter()
            .take(n)
            .enumerate()
            .fold(Fixed::zero(), |sum, (k, c)| &sum + &(c * &series[n - 1 - k]));
        series.push(-&sum.over(n));
    }
    series
}

fn product(left: &[Fixed], right: &[Fixed]) -> Vec<Fixed> {
    let mut all = vec![Fixed::zero(); left.len() + right.len() - 1];
    for (i, a) in left.iter().enumerate() {
        for (j, b) in right.iter().enumerate() {
            all[i + j] = &all[i + j] + &(a * b);
        }
    }
    all
}

/// ∫ of a polynomial times a series over [0, 1].
fn product_integral(polynomial: &[Fixed], series: &[Fixed]) -> Fixed {
    product(polynomial, series)
        .iter()
        .enumerate()
        .fold(Fixed::zero(), |sum, (power, c)| &sum + &c.over(power + 1))
}

/// Bernstein coefficients, between which the polynomial lies.
fn control_points(x: &[Fixed]) -> Vec<Fixed> {
    let (mut points, mut binomial) = (x.to_vec(), 1);
    for (k, point) in points.iter_mut().enumerate() {
        *point = point.over(binomial);
        binomial = binomial * (x.len() - 1 - k) / (k + 1);
        binomial = binomial.max(1);
    }
    for done in 1..points.len() {
        for k in (done..points.len()).rev() {
            points[k] = &points[k] + &points[k - 1];
        }
    }
    points
}

/// The polynomial over [0, ½] and over [½, 1].
fn halves(x: &[Fixed]) -> (Vec<Fixed>, Vec<Fixed>) {
    let lower: Vec<Fixed> = (0i32..).zip(x).map(|(k, c)| c.scaled(-k)).collect();
    let mut upper = lower.clone();
    for done in 0..upper.len() {
        for k in (done..upper.len() - 1).rev() {
            upper[k] = &upper[k] + &upper[k + 1];
        }
    }
    (lower, upper)
}

#[test]
fn closed_forms() {
    let table = |points: &[(f64, f64)]| {
        PiecewiseLinear::new(&points.iter().map(|&(x, y)| (x, [y])).collect::<Vec<_>>()).unwrap()
    };
    let white = PiecewiseLinear::new(&[(0.0, [1.0, 0.5, 0.0])]).unwrap();
    let absorption = table(&[(0.0, 0.0), (1.0, 3.0)]);
    let emission = table(&[(0.0, 0.0), (1.0, 6.0)]);
    let light = ExactLight::new(&Tables { absorption, emission, color: white });
    // x from 0 to 1 and back; emission is twice the absorption.
    let gathered = light.along(&[0.0, 4.0, -4.0], 0.0, 5.0);
    let through = (-10.0_f64).exp();
    assert!((gathered.transmittance.to_f64() / through - 1.0).abs() < 1e-15);
    assert!((gathered.radiance[0].to_f64() - 2.0 * (1.0 - through)).abs() < 1e-15);
    assert!((gathered.radiance[1].to_f64() - (1.0 - through)).abs() < 1e-15);
    // ∫ x dx from −1 to 2, x clamped: ½ + 1 over a length of 3.
    let gathered = light.along(&[-1.0, 3.0], 0.0, 3e-20);
    assert!((gathered.opacity().to_f64() / (3e-20 * 1.5) - 1.0).abs() < 1e-15);
}
