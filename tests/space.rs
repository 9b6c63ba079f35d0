//! Exact positions against arbitrary-precision rationals, at levels 1, 25, 48 and 60.

// Helpers fail the tests that call them.
#![allow(clippy::unwrap_used)]

use deepfield::cache::BrickPlace;
use deepfield::render::view::View;
use deepfield::scene::Scene;
use deepfield::space::{Decimal, Domain, FRACTION_BITS, Levels, MAX_OCTREE_LEVEL, Position};
use glam::{DVec2, DVec3};
use num_bigint::BigInt;
use num_rational::Ratio;
use num_traits::{Signed, ToPrimitive, Zero};
use proptest::prelude::*;

const LEVELS: [i32; 3] = [1, 25, 60];

/// Edges that are no binary fractions, root grids of odd sizes, cells that are not cubes; lower
/// and upper edges and root cells along each axis.
fn domains() -> impl Strategy<Value = Domain> {
    let of = |left, right, cells| Domain::new(left, right, cells).unwrap();
    prop_oneof![
        // Cells of 0.1 along each axis.
        Just(of([-0.3, 0.1, -1.0], [2.1, 1.8, -0.5], [24, 17, 5])),
        // 0.05, 0.06, 0.04.
        Just(of([-0.3, 0.1, -1.0], [0.9, 1.06, -0.12], [24, 16, 22])),
        Just(of([0.0; 3], [1.0, 0.7, 1.3], [17, 5, 24])),
        Just(of([1e-3, -7e5, 0.1], [1.1e-3, 3e6, 0.3], [5, 24, 17])),
        Just(of([-1.0; 3], [1.0; 3], [64; 3])),
    ]
}

fn level() -> impl Strategy<Value = i32> {
    prop::sample::select(LEVELS.to_vec())
}

type Rational = Ratio<BigInt>;

/// The rational that the double `value` is: 53 bits, then powers of two.
fn rational(value: f64) -> Rational {
    let exponent = value.abs().log2().max(-1000.0).floor() as i32;
    let mantissa = value / f64::from(exponent).exp2() * 53f64.exp2();
    Rational::from(BigInt::from(mantissa as i64)) * power(exponent - 53)
}

/// To a few bits fewer than a double has.
fn to_f64(value: &Rational) -> f64 {
    const BITS: i32 = 300;
    (value * power(BITS)).to_integer().to_f64().unwrap() * f64::from(-BITS).exp2()
}

fn power(exponent: i32) -> Rational {
    let whole = BigInt::from(1) << exponent.unsigned_abs();
    if exponent < 0 { Rational::new(1.into(), whole) } else { whole.into() }
}

fn root_width(domain: &Domain, axis: usize) -> Rational {
    let cells = Rational::from(BigInt::from(domain.root_cells()[axis]));
    (rational(domain.right()[axis]) - rational(domain.left()[axis])) / cells
}

/// `value` (code length) in cells of `octree` from the domain's left edge.
fn in_cells(domain: &Domain, axis: usize, octree: i32, value: &Rational) -> Rational {
    (value - rational(domain.left()[axis])) / root_width(domain, axis) * power(octree)
}

/// A coordinate that lies at `part` (of 2⁶³) of the domain.
fn within(domain: &Domain, axis: usize, octree: i32, part: u64) -> i128 {
    let cells = i128::from(domain.root_cells()[axis]) << octree;
    (BigInt::from(cells) * part >> 63u32).to_i128().unwrap()
}

fn cells_at(domain: &Domain, octree: i32, parts: [u64; 3]) -> [i128; 3] {
    std::array::from_fn(|a| within(domain, a, octree, parts[a]))
}

fn parts() -> impl Strategy<Value = [u64; 3]> {
    prop::array::uniform3(prop_oneof![4 => 0..1u64 << 63, 1 => Just(0), 1 => Just((1 << 63) - 1)])
}

/// `value` to `digits` decimals, floored.
fn decimal_text(value: &Rational, digits: u32) -> String {
    let scale = BigInt::from(10).pow(digits);
    let floored = (value * Rational::from(scale)).floor().to_integer();
    format!("{floored}e-{digits}")
}

fn decimal_value(text: &str) -> Rational {
    let (mantissa, exponent) = text.split_once('e').unwrap_or((text, "0"));
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let digits: BigInt = format!("{whole}{fraction}").parse().unwrap();
    let shift = exponent.parse::<i32>().unwrap() - fraction.len() as i32;
    let ten = Rational::from(BigInt::from(10).pow(shift.unsigned_abs()));
    if shift < 0 { Rational::from(digits) / ten } else { Rational::from(digits) * ten }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..Default::default() })]

    #[test]
    fn cells_and_positions_round_trip(domain in domains(), octree in level(), parts in parts()) {
        let cell = cells_at(&domain, octree, parts);
        let corner = domain.cell_corner(octree, cell);
        let last = (1i128 << (i64::from(FRACTION_BITS) - i64::from(octree))) - 1;
        prop_assert!(domain.contains(&corner));
        prop_assert_eq!(domain.cell_of(octree, &corner), cell);
        let far = Position(corner.0.map(|c| c + last));
        prop_assert_eq!(domain.cell_of(octree, &far), cell);
        // Half-open: a face belongs to the cell above it.
        let above = Position(far.0.map(|c| c + 1));
        prop_assert_eq!(domain.cell_of(octree, &above), cell.map(|i| i + 1));
        let below = Position(corner.0.map(|c| c - 1));
        prop_assert_eq!(domain.cell_of(octree, &below), cell.map(|i| i - 1));
        for coarser in -3..octree {
            let expected = cell.map(|i| i >> (octree - coarser));
            prop_assert_eq!(domain.cell_of(coarser, &far), expected);
        }
    }

    #[test]
    fn differences_are_rounded_exact_ones(
        domain in domains(),
        octree in level(),
        parts in parts(),
        offset in prop::array::uniform3(any::<i64>()),
        shift in 0u32..64,
    ) {
        let from = domain.cell_corner(octree, cells_at(&domain, octree, parts));
        // From a position's last bits up to many cells.
        let to = Position(std::array::from_fn(|a| from.0[a] + (i128::from(offset[a]) >> shift)));
        for (to, from) in [(to, from), (from, to), (to, Position([0; 3])), (domain.upper(), to)] {
            let found = domain.difference(&to, &from);
            for a in 0..3 {
                let units = Rational::from(BigInt::from(to.0[a]) - BigInt::from(from.0[a]));
                let exact = units * power(-(FRACTION_BITS as i32)) * root_width(&domain, a);
                let error = (rational(found[a]) - &exact).abs();
                // Five roundings: the width's two, the difference's, and two products.
                prop_assert!(error <= exact.abs() * rational(5.1 * (-53f64).exp2()), "axis {a}");
            }
        }
    }

    #[test]
    fn decimals_are_floored(
        domain in domains(),
        octree in level(),
        parts in parts(),
        digits in 1u32..150,
    ) {
        // Decimals at, just below and just above a cell's faces, cut off at any length.
        let cell = cells_at(&domain, octree, parts);
        for nudge in [-1, 0, 1] {
            let texts: [String; 3] = std::array::from_fn(|a| {
                let face = Rational::from(BigInt::from(cell[a])) * power(-octree);
                let face = rational(domain.left()[a]) + face * root_width(&domain, a);
                let nudge = Rational::new(nudge.into(), BigInt::from(10).pow(digits));
                decimal_text(&(face + nudge), digits)
            });
            let decimals = texts.each_ref().map(|text| Decimal::parse(text).unwrap());
            let position = domain.position(&decimals).unwrap();
            let found = domain.cell_of(octree, &position);
            for a in 0..3 {
                let value = decimal_value(&texts[a]);
                let fraction_bits = FRACTION_BITS as i32;
                let units = in_cells(&domain, a, fraction_bits, &value).floor().to_integer();
                prop_assert_eq!(BigInt::from(position.0[a]), units, "{}", &texts[a]);
                let index = in_cells(&domain, a, octree, &value).floor().to_integer();
                prop_assert_eq!(BigInt::from(found[a]), index, "{}", &texts[a]);
            }
        }
    }

    #[test]
    fn doubles_and_decimals_are_taken_as_they_are(
        domain in domains(),
        value in prop::array::uniform3(-1.5f64..1.5),
    ) {
        let exact = value.map(|v| Decimal::from_f64(v).unwrap());
        let position = domain.position(&exact);
        for a in 0..3 {
            let units = in_cells(&domain, a, FRACTION_BITS as i32, &rational(value[a])).floor();
            match &position {
                Ok(position) => {
                    prop_assert_eq!(BigInt::from(position.0[a]), units.to_integer());
                }
                // Too far from a domain whose cells are small.
                Err(_) => prop_assert!(domain.root_cell_width().min_element() < 1e-4),
            }
        }
    }

    #[test]
    fn levels_of_factors_2_and_4_map_both_ways(
        factors in prop::collection::vec(prop::sample::select(vec![2u32, 4]), 0..30),
    ) {
        let levels = Levels::from_factors(&factors).unwrap();
        let mut octree = 0;
        prop_assert_eq!(levels.octree(0), Some(0));
        for (level, factor) in factors.iter().enumerate() {
            for half in octree + 1..octree + factor.ilog2() {
                prop_assert_eq!(levels.simulation(half), None);
            }
            octree += factor.ilog2();
            prop_assert_eq!(levels.octree(level + 1), Some(octree));
            prop_assert_eq!(levels.simulation(octree), Some(level + 1));
        }
        prop_assert_eq!(levels.deepest(), octree);
        prop_assert_eq!(levels.simulation(octree + 1), None);
        prop_assert_eq!(levels.octree(factors.len() + 1), None);
        prop_assert_eq!(levels.count(), factors.len() + 1);
    }
}

/// A vector of rationals.
type Vector = [Rational; 3];

/// Bits of square roots.
const ROOT_BITS: u32 = 400;

/// To about [`ROOT_BITS`] bits below the number's own.
fn square_root(value: &Rational) -> Rational {
    let scaled = (value.numer() * value.denom()) << (2 * ROOT_BITS);
    Rational::new(scaled.sqrt(), value.denom() << ROOT_BITS)
}

fn dot(a: &Vector, b: &Vector) -> Rational {
    (0..3).map(|n| &a[n] * &b[n]).fold(Rational::zero(), |sum, term| sum + term)
}

fn cross(a: &Vector, b: &Vector) -> Vector {
    std::array::from_fn(|n| {
        let (i, j) = ((n + 1) % 3, (n + 2) % 3);
        &a[i] * &b[j] - &a[j] * &b[i]
    })
}

fn normalized(v: &Vector) -> Vector {
    let scale = square_root(&dot(v, v));
    // Shorter numbers: the products below stay quick.
    v.each_ref().map(|x| shortened(&(x / &scale)))
}

fn shortened(value: &Rational) -> Rational {
    let bits = Rational::from(BigInt::from(1) << ROOT_BITS);
    (value * &bits).floor() / bits
}

/// Code length from the domain's left edge, exactly.
fn exact_point(domain: &Domain, position: &Position) -> Vector {
    std::array::from_fn(|a| {
        Rational::from(BigInt::from(position.0[a]))
            * power(-(FRACTION_BITS as i32))
            * root_width(domain, a)
    })
}

/// A camera at `octree`: where it looks, and from what distance.
#[derive(Debug, Clone)]
struct Case {
    domain: Domain,
    octree: i32,
    target: [u64; 3],
    /// Of the view direction; not normalised.
    toward: [f64; 3],
    /// From the eye to the target, code length.
    distance: f64,
    is_perspective: bool,
    /// Where the ray passes the target's plane, in cells.
    plane: [f64; 2],
}

fn cases() -> impl Strategy<Value = Case> {
    let domain = domains().prop_filter("of one size", |d| d.right()[1] < 1e3);
    let axis = prop_oneof![0.1f64..1.0, -1.0f64..-0.1, Just(1e-9)];
    let octree = prop::sample::select(vec![1, 25, 48, 60]);
    let reach = prop_oneof![Just(None), (3.0f64..40.0).prop_map(Some)];
    (
        domain,
        octree,
        parts(),
        prop::array::uniform3(axis),
        reach,
        any::<bool>(),
        -20.0f64..20.0,
        -20.0f64..20.0,
    )
        .prop_map(|(domain, octree, target, toward, reach, is_perspective, p, q)| {
            let cell = domain.cell_width(octree).max_element();
            // A telescope at distance 1, or an eye some cells away.
            let distance = reach.map_or(1.0, |cells| cells * cell);
            Case { domain, octree, target, toward, distance, is_perspective, plane: [p, q] }
        })
}

impl Case {
    /// Decimals of the eye and the target.
    fn points(&self) -> [[String; 3]; 2] {
        let cell = cells_at(&self.domain, self.octree, self.target);
        let length = DVec3::from_array(self.toward).length();
        let target: Vector = std::array::from_fn(|a| {
            let centre = Rational::from(BigInt::from(cell[a])) + rational(0.37);
            rational(self.domain.left()[a])
                + centre * power(-self.octree) * root_width(&self.domain, a)
        });
        let eye: Vector =
            std::array::from_fn(|a| &target[a] - rational(self.toward[a] / length * self.distance));
        [eye, target].map(|point| point.map(|x| decimal_text(&x, 45)))
    }

    fn scene(&self) -> Scene {
        let [eye, target] = self.points().map(|point| format!("{point:?}"));
        let projection = if self.is_perspective { "perspective" } else { "orthographic" };
        let text = format!(
            "[camera]\nprojection = \"{projection}\"\nposition = {eye}\nlook_at = {target}\n\
             up = [0.3, 1.0, -0.7]\n[[volume]]\nfield = \"Density\"\n"
        );
        Scene::parse(&text, "scene").unwrap()
    }

    /// Largest distance, in cells, of points of the frame's ray from the exact one.
    fn error(&self) -> f64 {
        const BRICK: i128 = 16;
        let (scene, domain) = (self.scene(), &self.domain);
        let view = View::new(&scene, domain).unwrap();
        let eye = domain.position(&scene.camera.position).unwrap();
        let target = domain.position(&scene.camera.look_at).unwrap();
        let cell = domain.cell_of(self.octree, &target).map(|i| i.div_euclid(BRICK) * BRICK);
        let corner = domain.cell_corner(self.octree, cell);
        let frame = view.frame(&corner, self.octree, BRICK as f64);
        let width = domain.cell_width(self.octree).max_element();
        let scale = width / if self.is_perspective { self.distance } else { 1.0 };
        let plane = DVec2::from_array(self.plane) * scale;
        let local = frame.ray(plane);
        let exact = ExactRay::new(domain, [&eye, &target], self.is_perspective, plane);
        let corner = exact_point(domain, &corner);
        [-15.0, 0.0, 15.0]
            .map(|cells| {
                let point = local.origin + local.direction * (cells * width);
                let point: Vector = std::array::from_fn(|a| {
                    let cell = root_width(domain, a) * power(-self.octree);
                    &corner[a] + rational(point[a]) * cell
                });
                exact.distance(&point) / width
            })
            .into_iter()
            .fold(0.0, f64::max)
    }
}

/// The ray of (P, Q), exactly; lengths from the domain's left edge.
struct ExactRay {
    origin: Vector,
    direction: Vector,
}

impl ExactRay {
    fn new(domain: &Domain, ends: [&Position; 2], is_perspective: bool, plane: DVec2) -> Self {
        let [eye, target] = ends.map(|end| exact_point(domain, end));
        let ahead: Vector = std::array::from_fn(|a| &target[a] - &eye[a]);
        let forward = normalized(&ahead);
        let right = normalized(&cross(&forward, &[0.3, 1.0, -0.7].map(rational)));
        let up = cross(&right, &forward);
        let aside: Vector =
            std::array::from_fn(|a| &right[a] * rational(plane.x) + &up[a] * rational(plane.y));
        if is_perspective {
            let direction = std::array::from_fn(|a| &forward[a] + &aside[a]);
            return Self { origin: eye, direction };
        }
        Self { origin: std::array::from_fn(|a| &eye[a] + &aside[a]), direction: forward }
    }

    /// Distance of `point` from the ray, code length.
    fn distance(&self, point: &Vector) -> f64 {
        let offset: Vector = std::array::from_fn(|a| shortened(&(&point[a] - &self.origin[a])));
        let across = cross(&offset, &self.direction);
        let square = dot(&across, &across) / dot(&self.direction, &self.direction);
        to_f64(&square_root(&square))
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 150, failure_persistence: None, ..Default::default() })]

    #[test]
    fn rays_are_exact_at_any_depth(case in cases()) {
        let error = case.error();
        // The anchor is floored to a position's last bit: 2⁻³⁶ of a cell at level 60.
        let last_bit = f64::from(case.octree - FRACTION_BITS as i32).exp2();
        prop_assert!(error <= 1e-12 + 2.0 * last_bit, "{error:e} cells from the exact ray");
    }
}

#[test]
fn levels_beyond_the_deepest_are_refused() {
    let deepest = MAX_OCTREE_LEVEL as usize;
    assert!(Levels::from_factors(&vec![2; deepest]).is_ok());
    assert!(Levels::from_factors(&vec![2; deepest + 1]).is_err());
    // The deepest brick's place is one of its parent's children.
    let root = BrickPlace::root(3);
    let child = root.child(5);
    assert_eq!((child.octree, child.coordinates), (-2, [1, 0, 1]));
}
