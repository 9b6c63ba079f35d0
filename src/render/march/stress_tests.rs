//! The march along a ray against arithmetic of fifty digits.

use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::TestRunner;

use super::absorb::Integrator;
use super::ray_state::{Ending, RayState};
use crate::polynomial::Polynomial;
use crate::render::testing::exact_light::{ExactLight, Gathered, Tables};
use crate::render::testing::fixed::Fixed;
use crate::render::transfer::pieces::TransferPieces;
use crate::scene::{ColorMap, ColorTable, PiecewiseLinear, TransferFunction};

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
        Self::colored(absorption, emission, &color)
    }

    fn colored(absorption: &[(f64, f64)], emission: &[(f64, f64)], color: &ColorTable) -> Self {
        Self::allowing(absorption, emission, color, |_| 0.0)
    }

    /// One whose emission may be off by `allowed` of the least extinction.
    fn allowing(
        absorption: &[(f64, f64)],
        emission: &[(f64, f64)],
        color: &ColorTable,
        allowed: impl Fn(f64) -> f64,
    ) -> Self {
        let table = |points: &[(f64, f64)]| {
            let points: Vec<_> = points.iter().map(|&(x, y)| (x, [y])).collect();
            PiecewiseLinear::new(&points).unwrap()
        };
        let (absorption, emission) = (table(absorption), table(emission));
        let transfer = TransferFunction::from_tables(&absorption, &emission, color);
        let tables = Tables { absorption, emission, color: color.table().clone() };
        Self { pieces: TransferPieces::new(&transfer, allowed), exact: ExactLight::new(&tables) }
    }

    /// The march along `x`.
    fn march<const N: usize>(&self, x: &Polynomial<N>, length: f64) -> RayState {
        let ending = Ending::new(1e30 * self.pieces.largest_emission(), 0.0);
        let mut state = RayState::default();
        Integrator::new(&self.pieces.all, &ending, false, &mut state).along(x, length);
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
    let scale = |value: f64| value.max(1e-38);
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

const WHITE: [(f64, [f64; 3]); 1] = [(0.0, [1.0; 3])];
/// With a ramp of emission: quadratic light, whose slope changes sign.
const RAMPS: [(f64, [f64; 3]); 2] = [(0.0, [1.0, 0.0, 0.5]), (1.0, [0.0, 1.0, 0.5])];
const RAMP: [(f64, f64); 2] = [(0.0, 0.0), (1.0, 1.0)];

impl Volume {
    fn check<const N: usize>(&self, x: &Polynomial<N>, length: f64, what: &str) {
        let error = self.error(x, length);
        assert!(error <= CERTIFIED, "{error:e} over {length:e} of {x:?}: {what}");
    }
}

#[test]
fn random_tables_along_random_polynomials() {
    let tables = (sizes(), sizes()).prop_flat_map(|(k, j)| (tables(k), tables(j), colors()));
    let four = prop::array::uniform4(point());
    let eight = prop::array::uniform8(point());
    for ((k, j, color), four, eight) in sampled((tables, four, eight), 60) {
        let volume = Volume::new(&k, &j, &color);
        let what = format!("{k:?} {j:?} {color:?}");
        volume.check(&through(four), 1.0, &what);
        volume.check(&through(eight), 1.0, &what);
        volume.check(&through(four), 1e-13, &what);
    }
}

/// Extinction constant, rising and falling over one piece.
fn extinctions(depth: f64) -> [[(f64, f64); 2]; 3] {
    [[depth; 2], [0.0, depth], [depth, 0.0]].map(|[left, right]| [(0.0, left), (1.0, right)])
}

/// On both sides of every limit between rules of quadrature.
const DEPTHS: [f64; 12] =
    [1e-30, 1e-12, 0.99e-5, 1.01e-5, 1e-3, 0.0624, 0.0626, 0.249, 0.251, 1.99, 2.01, 1e6];

#[test]
fn one_piece_at_the_limits_of_every_rule() {
    let corner = |n: u32| -> f64 { f64::from(n & 1) };
    for depth in DEPTHS {
        for extinction in extinctions(depth) {
            let volume = Volume::new(&extinction, &RAMP, &RAMPS);
            let what = format!("{extinction:?}");
            for n in 1..8 {
                volume.check(&through::<4>(std::array::from_fn(|b| corner(n >> b))), 1.0, &what);
            }
            for n in [0x55, 0xaa, 0x0f, 0x18, 0x7e, 0x80] {
                volume.check(&through::<8>(std::array::from_fn(|b| corner(n >> b))), 1.0, &what);
            }
        }
    }
}

#[test]
fn lines_that_hardly_bend() {
    for depth in [1e-6, 0.0624, 0.24, 1.99] {
        for extinction in extinctions(depth) {
            let volume = Volume::new(&extinction, &RAMP, &RAMPS);
            for bend in [0.0, 1e-3, 0.01, 0.03, 0.1, 0.3, 0.9, 1.1] {
                for [b, c] in [[bend, 0.0], [-bend, 0.0], [0.0, bend], [0.5 * bend, -0.5 * bend]] {
                    let line = Polynomial([0.0, 1.0, b, c].map(|c| 0.5 * c));
                    volume.check(&line, 1.0, &format!("{extinction:?}"));
                    let falling = Polynomial([2.0, -1.0, -b, -c].map(|c| 1e-3 * c));
                    volume.check(&falling, 1.0, &format!("{extinction:?}"));
                }
            }
        }
    }
}

#[test]
fn shells_crossed_at_once_and_touched() {
    for width in [1e-3, 1e-6, 1e-9, 1e-12, 1e-15] {
        for peak in [1.0, 1e6, 1e18] {
            let shell = [(0.5, 0.0), (0.5 + width, peak), (0.5 + 2.0 * width, 0.0)];
            let wall = [(0.5, 0.0), (0.5, peak), (0.5 + width, peak), (0.5 + width, 0.0)];
            for (absorption, emission) in
                [(&shell[..], &shell[..]), (&shell, &RAMP), (&wall, &wall), (&shell, &WHITE_LIGHT)]
            {
                let volume = Volume::new(absorption, emission, &WHITE);
                let what = format!("{absorption:?} {emission:?}");
                volume.check(&Polynomial([-1e12, 3e12, 0.0, 0.0]), 1.0, &what);
                volume.check(&Polynomial([0.25 + width, 1.0, -1.0, 0.0]), 1.0, &what);
                volume.check(&Polynomial([0.25, 1.0, -1.0, 0.0]), 1.0, &what);
                volume.check(&Polynomial([0.0, 4.0, -9.0, 6.0]), 1.0, &what);
                volume.check(&through([0.1, 0.9, 0.2, 0.7, 0.0, 1.0, 0.4, 0.6]), 1.0, &what);
            }
        }
    }
}

const WHITE_LIGHT: [(f64, f64); 1] = [(0.0, 1.0)];

#[test]
fn entries_of_a_colour_map_are_met_one_by_one() {
    let map = ColorTable::Map(ColorMap::named("inferno").unwrap());
    for (extinction, x) in [
        ([(0.0, 0.0), (1.0, 5.0)], [-0.2, 1.3, -0.4, 1.1]),
        ([(0.1, 1e3), (0.2, 0.0)], [0.0, 0.3, 0.05, 0.0]),
    ] {
        let volume = Volume::colored(&extinction, &RAMP, &map);
        volume.check(&through(x), 0.7, "inferno");
    }
}

/// 10⁵ steps of mixed sizes and depths, and the same sums in exact numbers.
#[test]
fn what_is_simplified_is_off_by_what_it_says_and_may() {
    /// Of the brightest that there is.
    const ALLOWED: f64 = 1e-2;
    let map = ColorTable::Map(ColorMap::named("batlow").unwrap());
    let mut is_simpler = false;
    for depth in [1e-2, 1.0, 10.0, 1e2, 1e3, 1e5] {
        let table = [(0.1, 0.0), (0.1, depth), (0.9, 0.3 * depth), (0.9, 0.0)];
        let volume = Volume::allowing(&table, &table, &map, |least| ALLOWED * least);
        let ending = Ending::new(1.0, 0.0);
        for ends in [[0.3, 0.3001], [0.3, 0.303], [0.52, 0.5], [0.2, 0.4], [0.8, 0.3]] {
            let x = Polynomial([ends[0], ends[1] - ends[0], 0.0, 0.0]);
            let mut state = RayState::default();
            let mut integrator = Integrator::new(&volume.pieces.merged, &ending, true, &mut state);
            integrator.along(&x, 1.0);
            let off = integrator.tally.quadrature;
            let exact = volume.exact.along(&x.0, 0.0, 1.0);
            for c in 0..3 {
                let (found, truth, _) = channel(&state, &exact, c);
                let error = (&found - &truth).abs().to_f64();
                is_simpler |= error > 1e-6;
                assert!(error <= off + 1e-9, "{depth} {ends:?}: {error} {off}");
            }
            // A part for entries taken together, one for stretches of one value.
            let most = 2.5 * ALLOWED * opacity(&state);
            assert!(off <= most, "{depth} {ends:?}: {off} {most}");
        }
    }
    assert!(is_simpler);
}

#[test]
fn long_sums_do_not_drift() {
    const STEPS: usize = 100_000;
    // (extinction, emission, log2 of length): τ ≈ 1e-12, 1e-31, 1e-6, 0.02 once in 2000 steps.
    let kinds: [(f64, f64, i32); 5] = [
        (1e-8, 0.3, -13),
        (1e-16, 7.0, -50),
        (1e-3, 1e-3, -10),
        (0.16, 2.0, -3),
        (900.0, 1e3, -50),
    ];
    let exact = kinds.map(|(extinction, emission, power)| {
        let depth = Fixed::of(extinction).scaled(power);
        let through = (-&depth).exp();
        let absorbed = &Fixed::one() - &through;
        (through, (&Fixed::of(emission) * &absorbed).divided(&Fixed::of(extinction)))
    });
    let (mut state, mut transmittance, mut light) =
        (RayState::default(), Fixed::one(), Fixed::zero());
    let mut errors = [0.0_f64; 2];
    for n in 0..STEPS {
        let kind = if n % 2000 == 1999 { 3 } else { [0, 1, 0, 2, 4][n % 5] };
        let (extinction, emission, power) = kinds[kind];
        state.pass(extinction, [emission, 0.0, 0.0], f64::from(power).exp2());
        light = &light + &(&transmittance * &exact[kind].1);
        transmittance = &transmittance * &exact[kind].0;
        if n == 999 || n == STEPS - 1 {
            let opacity = &Fixed::one() - &transmittance;
            let relative = |found: f64, exact: &Fixed| (found / exact.to_f64() - 1.0).abs();
            let error = relative(state.radiance[0], &light)
                .max(relative(state.opacity(), &opacity))
                .max(relative(state.transmittance, &transmittance));
            errors[usize::from(n > 999)] = error;
        }
    }
    assert!(errors[0] <= 1e-15 && errors[1] <= 4e-15, "{errors:?}");
}

/// Opaque steps only: the transmittance becomes very small, and stays as exact.
#[test]
fn thousands_of_thick_steps_do_not_drift() {
    let mut state = RayState::default();
    let (step, mut exact) = (Fixed::of(-0.07).exp(), Fixed::one());
    for _ in 0..2000 {
        state.pass(0.07, [1.0, 0.0, 0.0], 1.0);
        exact = &exact * &step;
    }
    assert!((state.transmittance / exact.to_f64() - 1.0).abs() < 1e-12);
    let light = (&Fixed::one() - &exact).divided(&Fixed::of(0.07)).to_f64();
    assert!((state.radiance[0] / light - 1.0).abs() < 1e-15);
}
