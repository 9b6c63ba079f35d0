//! The march along a ray against arithmetic of a hundred digits.

use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::TestRunner;

use super::absorb::Integrator;
use super::polynomial::Polynomial;
use super::ray_state::{Accuracy, RayState};
use super::test_exact_light::{ExactLight, Gathered, Tables};
use super::test_fixed::Fixed;
use super::transfer_pieces::TransferPieces;
use crate::scene::{ColorTable, PiecewiseLinear, TransferFunction};

/// The largest relative error of quadrature.
const CERTIFIED: f64 = 1e-9;

/// One volume, for the march and in exact numbers.
struct Volume {
    pieces: TransferPieces,
    exact: ExactLight,
}

impl Volume {
    fn new(absorption: &[(f64, f64)], emission: &[(f64, f64)], color: &[(f64, [f64; 3])]) -> Self {
        let color = ColorTable::List(PiecewiseLinear::new(color).unwrap());
        Self::colored(absorption, emission, color)
    }

    fn colored(absorption: &[(f64, f64)], emission: &[(f64, f64)], color: ColorTable) -> Self {
        let table = |points: &[(f64, f64)]| {
            let points: Vec<_> = points.iter().map(|&(x, y)| (x, [y])).collect();
            PiecewiseLinear::new(&points).unwrap()
        };
        let (absorption, emission) = (table(absorption), table(emission));
        let transfer = TransferFunction::from_tables(&absorption, &emission, &color);
        let tables = Tables { absorption, emission, color: color.table().clone() };
        Self { pieces: TransferPieces::new(&transfer), exact: ExactLight::new(&tables) }
    }

    /// The march along `x`.
    fn march<const N: usize>(&self, x: &Polynomial<N>, length: f64) -> RayState {
        let accuracy = Accuracy { relative: 0.0, longest_path: 1e30 };
        let mut state = RayState::default();
        Integrator::new(&self.pieces, &accuracy, &mut state).along(x, length);
        state
    }

    /// The march's error relative to the stretch's own light and opacity, beyond what moving x by
    /// rounding changes.
    fn error<const N: usize>(&self, x: &Polynomial<N>, length: f64) -> f64 {
        let state = self.march(x, length);
        let exact = self.exact.along(&x.0, 0.0, length);
        let error = relative_error(&state, &exact);
        if error <= CERTIFIED {
            return error;
        }
        let rounding = 4.0 * f64::EPSILON * x.0.iter().map(|c| c.abs()).sum::<f64>();
        let moved = [-rounding, rounding].map(|shift| {
            let moved = self.exact.along(&x.0, shift, length);
            differences(&exact, &moved)
        });
        let excess = (0..4).map(|c| {
            let (found, exact, scale) = channel(&state, &exact, c);
            let allowed = moved[0][c].max(moved[1][c]);
            ((&found - &exact).abs().to_f64() - allowed) / scale
        });
        excess.fold(0.0, f64::max)
    }
}

fn opacity(state: &RayState) -> f64 {
    state.opacity()
}

fn differences(a: &Gathered, b: &Gathered) -> [f64; 4] {
    let light = |c: usize| (&a.radiance[c] - &b.radiance[c]).abs().to_f64();
    [light(0), light(1), light(2), (&a.opacity() - &b.opacity()).abs().to_f64()]
}

/// What was found, what is exact, and what errors are relative to, for R, G, B and A.
fn channel(state: &RayState, exact: &Gathered, c: usize) -> (Fixed, Fixed, f64) {
    let scale = |value: f64| value.max(1e-100);
    if c == 3 {
        let exact = exact.opacity();
        let size = scale(exact.to_f64());
        return (Fixed::of(opacity(state)), exact, size);
    }
    let largest = exact.radiance.iter().map(Fixed::to_f64).fold(0.0, f64::max);
    (Fixed::of(state.radiance[c]), exact.radiance[c].clone(), scale(largest))
}

fn relative_error(state: &RayState, exact: &Gathered) -> f64 {
    let errors = (0..4).map(|c| {
        let (found, exact, scale) = channel(state, exact, c);
        (&found - &exact).abs().to_f64() / scale
    });
    errors.fold(0.0, f64::max)
}

/// The polynomial with these Bernstein coefficients.
fn through<const N: usize>(points: [f64; N]) -> Polynomial<N> {
    let mut c = points;
    for done in 1..N {
        for k in (done..N).rev() {
            c[k] -= c[k - 1];
        }
    }
    let mut binomial = 1.0;
    for (k, c) in c.iter_mut().enumerate() {
        *c *= binomial;
        binomial *= (N - 1 - k) as f64 / (k + 1) as f64;
    }
    Polynomial(c)
}

fn sampled<T>(strategy: impl Strategy<Value = T>, count: usize) -> Vec<T> {
    let mut runner = TestRunner::deterministic();
    (0..count).map(|_| strategy.new_tree(&mut runner).unwrap().current()).collect()
}

fn report(name: &str, mut errors: Vec<(f64, String)>) {
    errors.sort_by(|a, b| b.0.total_cmp(&a.0));
    let bad = errors.iter().filter(|e| e.0 > CERTIFIED).count();
    eprintln!("{name}: {bad} of {} bad", errors.len());
    for e in errors.iter().take(3) {
        eprintln!("    {:e} {}", e.0, e.1);
    }
}

type Knots = Vec<(f64, f64)>;

/// Tables with wide and narrow pieces, steps, empty stretches, and values of all sizes.
fn tables(largest: f64) -> impl Strategy<Value = Knots> {
    let width =
        prop_oneof![Just(0.0), 0.05..0.5_f64, (-15.0..-1.0_f64).prop_map(|p| 10_f64.powf(p))];
    let value = prop_oneof![
        2 => Just(0.0),
        2 => (0.0..1.0_f64).prop_map(move |v| v * largest),
        1 => (-12.0..0.0_f64).prop_map(move |p| 10_f64.powf(p) * largest),
    ];
    (0.0..0.5_f64, prop::collection::vec((width, value), 1..8)).prop_map(|(start, steps)| {
        let mut x = start;
        let steps = steps.into_iter();
        steps
            .map(|(width, value)| {
                x += width;
                (x, value)
            })
            .collect()
    })
}

fn colors() -> impl Strategy<Value = Vec<(f64, [f64; 3])>> {
    let rgb = prop::array::uniform3(0.0..1.0_f64);
    prop_oneof![
        rgb.clone().prop_map(|rgb| vec![(0.0, rgb)]),
        (rgb.clone(), rgb, 0.1..0.9_f64).prop_map(|(a, b, x)| vec![
            (0.0, a),
            (x, b),
            (1.0, [b[1], a[2], b[0]])
        ]),
    ]
}

/// Optical depths and sizes of emission, from what vanishes to what is opaque.
fn sizes() -> impl Strategy<Value = f64> {
    prop_oneof![
        (-13.0..6.0_f64).prop_map(|p| 10_f64.powf(p)),
        prop::sample::select(vec![
            0.062_499, 0.062_501, 0.249, 0.251, 1.99, 2.01, 0.0, 1e-31, 1e30
        ]),
    ]
}

/// Bernstein coefficients of x: within a piece, across all pieces, hardly bent, far outside.
fn point() -> impl Strategy<Value = f64> {
    prop_oneof![4 => -0.2..1.2_f64, 2 => 0.4..0.6_f64, 1 => Just(0.5), 1 => Just(0.0), 1 => -1e3..1e3_f64]
}

#[test]
fn debug() {
    let white = [(0.0, [1.0, 1.0, 1.0])];
    let (w, peak) = (1e-12, 1e18);
    let shell = [(0.5, 0.0), (0.5 + w, peak), (0.5 + 2.0 * w, 0.0)];
    let volume = Volume::new(&shell, &shell, &white);
    for touch in [Polynomial([0.5 + w - 0.25, 1.0, -1.0, 0.0]), Polynomial([-1e12, 3e12, 0.0, 0.0])]
    {
        let state = volume.march(&touch, 1.0);
        let exact = volume.exact.along(&touch.0, 0.0, 1.0);
        eprintln!("{state:?} {} {}", exact.radiance[0].to_f64(), exact.opacity().to_f64());
    }
}

#[test]
fn explore() {
    let case = (sizes(), sizes()).prop_flat_map(|(k, j)| {
        (
            tables(k),
            tables(j),
            colors(),
            prop::array::uniform4(point()),
            prop::array::uniform8(point()),
        )
    });
    let (mut four, mut eight) = (vec![], vec![]);
    for (k, j, c, p, q) in sampled(case, 150) {
        let volume = Volume::new(&k, &j, &c);
        four.push((volume.error(&through(p), 1.0), format!("{k:?} {j:?} {c:?} {p:?}")));
        eight.push((volume.error(&through(q), 1.0), format!("{k:?} {j:?} {c:?} {q:?}")));
    }
    report("four", four);
    report("eight", eight);
    let white = [(0.0, [1.0, 1.0, 1.0])];
    let ramps = [(0.0, [1.0, 0.0, 0.5]), (1.0, [0.0, 1.0, 0.5])];
    for depth in [1e-6, 1e-3, 0.0624, 0.24, 1.0, 1.99] {
        for k in
            [[(0.0, depth), (1.0, depth)], [(0.0, 0.0), (1.0, depth)], [(0.0, depth), (1.0, 0.0)]]
        {
            let volume = Volume::new(&k, &[(0.0, 0.0), (1.0, 1.0)], &ramps);
            for n in 0..256 {
                let p: [f64; 8] = std::array::from_fn(|b| f64::from(n >> b & 1));
                let error = volume.error(&through(p), 1.0);
                if error > CERTIFIED {
                    eprintln!("corner {depth} {k:?} {p:?} {error:e}");
                }
                if n < 16 {
                    let p: [f64; 4] = std::array::from_fn(|b| f64::from(n >> b & 1));
                    let error = volume.error(&through(p), 1.0);
                    if error > CERTIFIED {
                        eprintln!("corner {depth} {k:?} {p:?} {error:e}");
                    }
                }
            }
            for bend in [1e-3, 0.01, 0.03, 0.1, 0.3, 0.9, 1.1] {
                for shape in [
                    [0.0, 1.0, bend, 0.0],
                    [0.0, 1.0, -bend, 0.0],
                    [0.0, 1.0, 0.0, bend],
                    [0.0, 1.0, 0.0, -bend],
                    [0.0, 1.0, 0.5 * bend, -0.5 * bend],
                    [1.0, -1.0, 0.0, bend],
                    [1.0, -1.0, bend, 0.0],
                ] {
                    for s in [0.5, 1e-3] {
                        let p = Polynomial(shape.map(|c| c * s));
                        let error = volume.error(&p, 1.0);
                        if error > CERTIFIED {
                            eprintln!("bend {depth} {k:?} {p:?} {error:e}");
                        }
                    }
                }
            }
        }
    }
    for w in [1e-3, 1e-6, 1e-9, 1e-12, 1e-15] {
        for peak in [1.0, 1e6, 1e12, 1e18] {
            let shell = [(0.5, 0.0), (0.5 + w, peak), (0.5 + 2.0 * w, 0.0)];
            let box_ = [(0.5, 0.0), (0.5, peak), (0.5 + w, peak), (0.5 + w, 0.0)];
            let wide = [(0.3, 0.0), (0.9, peak)];
            for (name, volume) in [
                ("shell", Volume::new(&shell, &shell, &white)),
                ("shell in wide", Volume::new(&shell, &wide, &white)),
                ("box", Volume::new(&box_, &box_, &white)),
                ("wide shines", Volume::new(&shell, &[(0.0, 1.0)], &white)),
            ] {
                let errors = sampled(prop::array::uniform4(-0.2..1.2_f64), 8)
                    .into_iter()
                    .map(|p| (volume.error(&through(p), 1.0), format!("{p:?}")))
                    .collect();
                report(&format!("{name} {w:e} {peak:e}"), errors);
                let steep = Polynomial([-1e12, 3e12, 0.0, 0.0]);
                report(
                    &format!("{name} {w:e} {peak:e} steep"),
                    vec![(volume.error(&steep, 1.0), String::new())],
                );
                let touch = Polynomial([0.5 + w - 0.25, 1.0, -1.0, 0.0]);
                report(
                    &format!("{name} {w:e} {peak:e} touch"),
                    vec![(volume.error(&touch, 1.0), String::new())],
                );
            }
        }
    }
}
