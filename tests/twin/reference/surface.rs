//! How far a square's rays are from a quadratic surface.

/// The corners of a square.
pub(crate) const CORNERS: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
/// The first rays lie on a regular grid, which makes the basis below orthogonal over them; the
/// surface is fitted to these.
const FITTED: usize = 16;

/// Values by place in the square, 0 … 1.
pub(crate) type Values = [([f64; 2], f64)];

/// 1, x, y, xy, x² and y², each orthogonal to the others over the fitted rays.
fn basis([x, y]: [f64; 2], mean_square: f64) -> [f64; 6] {
    let (x, y) = (x - 0.5, y - 0.5);
    [1.0, x, y, x * y, x * x - mean_square, y * y - mean_square]
}

/// The largest distance of any value from the surface fitted to the first sixteen.
pub(crate) fn distance(values: &Values) -> f64 {
    let fitted = &values[..FITTED];
    let square = |(place, _): &([f64; 2], f64)| (place[0] - 0.5) * (place[0] - 0.5);
    let mean_square = fitted.iter().map(square).sum::<f64>() / FITTED as f64;
    let (mut products, mut squares) = ([0.0; 6], [0.0; 6]);
    for (place, value) in fitted {
        for (n, term) in basis(*place, mean_square).into_iter().enumerate() {
            products[n] += term * value;
            squares[n] += term * term;
        }
    }
    let away = |(place, value): &([f64; 2], f64)| {
        let terms = basis(*place, mean_square).into_iter().enumerate();
        let surface: f64 = terms.map(|(n, term)| term * products[n] / squares[n]).sum();
        (value - surface).abs()
    };
    values.iter().map(away).fold(0.0, f64::max)
}
