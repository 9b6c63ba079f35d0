//! The camera's rays in a brick's coordinates against exact ones, at levels 1, 25, 48 and 60.

// Helpers fail the tests that call them.
#![allow(clippy::unwrap_used)]

mod rational;

use deepfield::render::view::View;
use deepfield::scene::Scene;
use deepfield::space::{Domain, FRACTION_BITS, Position};
use glam::{DVec2, DVec3};
use num_bigint::BigInt;
use num_traits::Zero;
use proptest::prelude::*;
use rational::{
    Rational, cells_at, decimal_text, domains, parts, power, rational, root_width, to_f64,
};

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
