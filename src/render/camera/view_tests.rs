//! Rays and footprints against exact arithmetic.

use glam::{DVec2, DVec3};
use num_bigint::BigInt;
use num_integer::Integer;
use num_traits::ToPrimitive;
use proptest::prelude::*;

use super::view::View;
use crate::scene::{CameraSettings, Projection, Scene};
use crate::space::{Decimal, Domain, Position};

/// Fraction bits of the fixed-point numbers that the twin computes with.
const BITS: u32 = 600;

#[derive(Clone)]
struct Fixed(BigInt);

impl Fixed {
    fn from_f64(x: f64) -> Self {
        let bits = x.abs().to_bits();
        let exponent = i64::try_from(bits >> 52).unwrap() - 1075 + i64::from(BITS);
        let mantissa = BigInt::from(bits & ((1 << 52) - 1) | 1 << 52);
        let magnitude = if exponent >= 0 { mantissa << exponent } else { mantissa >> -exponent };
        Self(if x == 0.0 {
            BigInt::from(0)
        } else if x < 0.0 {
            -magnitude
        } else {
            magnitude
        })
    }
    fn times(&self, other: &Self) -> Self {
        Self((&self.0 * &other.0) >> BITS)
    }
    fn over(&self, other: &Self) -> Self {
        Self((&self.0 << BITS) / &other.0)
    }
    fn sqrt(&self) -> Self {
        Self((&self.0 << BITS).sqrt())
    }
    fn to_f64(&self) -> f64 {
        let shift = i64::try_from(self.0.bits()).unwrap() - 100;
        let (top, shift) = if shift > 0 { (&self.0 >> shift, shift) } else { (self.0.clone(), 0) };
        top.to_f64().unwrap() * (shift as f64 - f64::from(BITS)).exp2()
    }
}

type Vector = [Fixed; 3];

fn map(a: &Vector, b: &Vector, f: impl Fn(&BigInt, &BigInt) -> BigInt) -> Vector {
    std::array::from_fn(|k| Fixed(f(&a[k].0, &b[k].0)))
}
fn dot(a: &Vector, b: &Vector) -> Fixed {
    Fixed((0..3).map(|k| a[k].times(&b[k]).0).sum())
}
fn scale(a: &Vector, s: &Fixed) -> Vector {
    std::array::from_fn(|k| a[k].times(s))
}
fn unit(a: &Vector) -> Vector {
    let length = dot(a, a).sqrt();
    std::array::from_fn(|k| a[k].over(&length))
}
fn cross(a: &Vector, b: &Vector) -> Vector {
    std::array::from_fn(|k| {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        Fixed(a[i].times(&b[j]).0 - a[j].times(&b[i]).0)
    })
}
/// Code length of a position, from the domain's left edge.
fn exact(domain: &Domain, position: &Position) -> Vector {
    let width = domain.root_cell_width();
    std::array::from_fn(|k| {
        Fixed(BigInt::from(position.0[k]) << (BITS - 96)).times(&Fixed::from_f64(width[k]))
    })
}

fn domain() -> Domain {
    Domain::new([-0.4, 0.0, 1.0], [0.6, 1.5, 2.0], [48, 36, 20]).unwrap()
}

fn camera(projection: Projection, position: [&str; 3], look_at: [&str; 3]) -> CameraSettings {
    let decimals = |all: [&str; 3]| all.map(|text| Decimal::parse(text).unwrap());
    CameraSettings {
        projection,
        position: decimals(position),
        look_at: decimals(look_at),
        up: DVec3::new(0.1, 1.0, -0.2),
    }
}

/// Distance of a local ray's points from the exact ray, in pixels at that depth, and at once the
/// error of the length.
fn error_in_pixels(view: &View, settings: &CameraSettings, octree: i32, pixel: [f64; 2]) -> f64 {
    let domain = domain();
    let (eye, target) =
        (domain.position(&settings.position).unwrap(), domain.position(&settings.look_at).unwrap());
    let cell = domain.cell_of(octree, &target).map(|c| c - c.rem_euclid(8));
    let corner = domain.cell_corner(octree, cell);
    let frame = view.frame(&corner, octree, 8.0);
    let (plane, ray) = (view.plane(pixel[0], pixel[1]), frame.ray(view.plane(pixel[0], pixel[1])));
    let (eye_x, target_x) = (exact(&domain, &eye), exact(&domain, &target));
    let forward = unit(&map(&target_x, &eye_x, |a, b| a - b));
    let up: Vector = settings.up.to_array().map(Fixed::from_f64);
    let right = unit(&cross(&forward, &up));
    let true_up = cross(&right, &forward);
    let (p, q) = (Fixed::from_f64(plane.x), Fixed::from_f64(plane.y));
    let aside = map(&scale(&right, &p), &scale(&true_up, &q), |a, b| a + b);
    let is_perspective = matches!(settings.projection, Projection::Perspective { .. });
    let (start, along) = if is_perspective {
        (eye_x, map(&forward, &aside, |a, b| a + b))
    } else {
        (map(&eye_x, &aside, |a, b| a + b), forward.clone())
    };
    let along = unit(&along);
    let mut worst = 0.0_f64;
    for steps in [-20.0, 0.0, 3.0, 50.0] {
        let sigma = steps * domain.cell_width(octree).max_element();
        if sigma < ray.sigma_min {
            continue;
        }
        let local = (ray.origin + ray.direction * sigma).to_array();
        let width = domain.cell_width(octree).to_array();
        let corner_x = exact(&domain, &corner);
        let point: Vector = std::array::from_fn(|k| {
            Fixed(&corner_x[k].0 + Fixed::from_f64(local[k]).times(&Fixed::from_f64(width[k])).0)
        });
        let from_start = map(&point, &start, |a, b| a - b);
        let depth = dot(&from_start, &forward).to_f64();
        if depth < 1e-3 * domain.cell_width(octree).min_element() {
            continue;
        }
        let along_ray = dot(&from_start, &along);
        let off = map(&from_start, &scale(&along, &along_ray), |a, b| a - b);
        let pixel = view.pixel_size_at(depth);
        worst = worst.max(dot(&off, &off).sqrt().to_f64() / pixel);
    }
    worst
}

#[test]
fn rays_are_exact_at_every_level() {
    // (octree level of the brick looked at, digits of the offset from eye to target)
    let near = |level: u32| {
        let small = (-f64::from(level)).exp2() * 0.037;
        format!("0.3{:0>40}", format!("{:.0}", small * 1e40))
    };
    for level in [1, 25, 48, 60] {
        let telescope = Projection::Perspective { fov_degrees: (-f64::from(level)).exp2() * 10.0 };
        let parallel = Projection::Orthographic { height: (-f64::from(level)).exp2() };
        let wide = Projection::Perspective { fov_degrees: 60.0 };
        let text = near(level);
        let cases = [
            (telescope, ["0.11", "0.77", "-0.9"], ["0.3", "0.7", "1.4"]),
            (parallel, ["0.11", "0.77", "-0.9"], ["0.3", "0.7", "1.4"]),
            (wide, [text.as_str(), "0.7", "1.4"], ["0.3", "0.7", "1.4"]),
            (parallel, [text.as_str(), "0.7", "1.4"], ["0.3", "0.7", "1.4"]),
        ];
        for (n, (projection, position, look_at)) in cases.into_iter().enumerate() {
            let settings = camera(projection, position, look_at);
            let view = View::from_camera(&settings, 640, 480, &domain()).unwrap();
            for pixel in [[0.5, 0.5], [320.5, 240.5], [639.5, 3.5]] {
                let error = error_in_pixels(&view, &settings, level as i32, pixel);
                assert!(error < 1e-4, "level {level} case {n}: {error} pixels");
            }
        }
    }
}

#[test]
fn a_telescope_tells_every_pixel_apart() {
    let tiny = Projection::Perspective { fov_degrees: (-45.0_f64).exp2() * 57.0 };
    let settings = camera(tiny, ["0.11", "0.77", "-0.9"], ["0.3", "0.7", "1.4"]);
    let view = View::from_camera(&settings, 512, 512, &domain()).unwrap();
    let domain = domain();
    let target = domain.position(&settings.look_at).unwrap();
    let corner = domain.cell_corner(50, domain.cell_of(50, &target));
    let frame = view.frame(&corner, 50, 8.0);
    let step = |i: f64| {
        let (a, b) = (frame.ray(view.plane(i, 256.5)), frame.ray(view.plane(i + 1.0, 256.5)));
        (b.origin - a.origin).length()
    };
    for i in 0..511 {
        assert!((step(f64::from(i) + 0.5) / step(255.5) - 1.0).abs() < 1e-6);
    }
}

#[test]
fn a_target_beside_the_eye_steers_to_the_far_side() {
    let settings = camera(
        Projection::Perspective { fov_degrees: 30.0 },
        ["0.3", "0.7", "1.4"],
        ["0.30000000000000000000001", "0.70000000000000000000002", "1.40000000000000000000003"],
    );
    let view = View::from_camera(&settings, 100, 100, &domain()).unwrap();
    let domain = domain();
    let corner = domain.cell_corner(
        30,
        domain.cell_of(30, &domain.position(&settings.position).unwrap()).map(|c| c + (1 << 28)),
    );
    let frame = view.frame(&corner, 30, 8.0);
    assert!(frame.depth > 0.0 && frame.anchor.is_finite());
}

#[test]
fn edges_along_pixels_are_told_by_where_they_lead() {
    // x from −0.4 to 0.6, y from 0 to 1.5, z from 1 to 2.
    let is_along = |cells: &str, camera: &str, plane: [f64; 2]| {
        let text = format!(
            "[image]\nwidth = 100\nheight = 100\n[camera]\nlook_at = [0.0, 1.0, 1.5]\n{camera}\n\
             [render]\ninterpolation = \"{cells}\"\n[[volume]]\nfield = \"x\"\nscale = \"linear\"\n"
        );
        let view = View::new(&Scene::parse(&text, "scene").unwrap(), &domain()).unwrap();
        view.has_edges_along_pixels(DVec2::from_array(plane), view.pixel())
    };
    let flat = "projection = \"orthographic\"\nheight = 3.0\n";
    let wide = "fov = 40.0\n";
    let front = |lens: &str, up: [f64; 3]| format!("{lens}position = [0.0, 1.0, 6.0]\nup = {up:?}");
    let corner =
        |lens: &str, up: [f64; 3]| format!("{lens}position = [2.0, 3.1, 4.2]\nup = {up:?}");
    const UPRIGHT: [f64; 3] = [0.0, 1.0, 0.0];
    // Cells along an axis, upright and turned about it.
    for lens in [flat, wide] {
        assert!(is_along("cell", &front(lens, UPRIGHT), [0.3, 0.2]));
        assert!(!is_along("cell", &front(lens, [1.0, 1.5, 0.0]), [0.3, 0.2]));
        assert!(!is_along("cell", &corner(lens, [0.5, 1.0, 0.0]), [0.0, 0.1]));
        assert!(!is_along("linear", &front(lens, UPRIGHT), [0.05, -0.02]));
    }
    // What stands upright does so where the view's middle is, and everywhere if rays are parallel.
    for (plane, by_perspective) in [([0.01, 0.3], true), ([0.3, 0.3], false)] {
        assert!(is_along("cell", &corner(flat, UPRIGHT), plane));
        assert_eq!(is_along("cell", &corner(wide, UPRIGHT), plane), by_perspective);
    }
    // The domain's sides, of which the nearest is 4 from the eye.
    for (lens, depth) in [(flat, 1.0), (wide, 4.0)] {
        assert!(is_along("linear", &front(lens, UPRIGHT), [0.601 / depth, 0.3]));
        assert!(!is_along("linear", &front(lens, UPRIGHT), [0.68 / depth, 0.3]));
        assert!(is_along("linear", &front(lens, UPRIGHT), [0.2, -0.999 / depth]));
    }
}

#[test]
fn wrong_cameras_are_refused() {
    let wide = Projection::Perspective { fov_degrees: 60.0 };
    let refuse = |settings: &CameraSettings| {
        View::from_camera(settings, 10, 10, &domain()).unwrap_err().to_string()
    };
    let same = camera(wide, ["0.1", "0.2", "0.3"], ["1e-1", "2e-1", "3e-1"]);
    assert!(refuse(&same).contains("look_at"));
    let close = camera(wide, ["0.1", "0.2", "0.3"], ["0.1", "0.2", "0.3000000000000000000000001"]);
    assert!(refuse(&close).contains("which tells no direction"));
    // Along the longest side a unit of positions is longer than all of the way.
    let domain = Domain::new([0.0; 3], [1.0, 1e10, 1.0], [4; 3]).unwrap();
    let across = camera(wide, ["0.1", "0.2", "0.3"], ["0.1000000000001", "0.2", "0.3"]);
    let refused = View::from_camera(&across, 10, 10, &domain).unwrap_err().to_string();
    assert!(refused.contains("which tells no direction"), "{refused}");
    let mut along = camera(wide, ["0", "0", "0"], ["0.1", "0.2", "0.3"]);
    along.up = DVec3::new(-0.1, -0.2, -0.3);
    assert!(refuse(&along).contains("up"));
    let far = camera(wide, ["1e300", "0", "0"], ["0.1", "0.2", "0.3"]);
    assert!(refuse(&far).starts_with("camera: position: "));
    let away = camera(wide, ["0.1", "0.2", "0.3"], ["0", "1e300", "0"]);
    assert!(refuse(&away).starts_with("camera: look_at: "));
}

#[test]
fn footprints_do_not_depend_on_the_unit_of_length() {
    for projection in ["perspective", "orthographic"] {
        let footprint = |exponent: i32| {
            let unit = f64::from(exponent).exp2();
            let edge = [-0.4, 0.0, 1.0].map(|x| x * unit);
            let end = [0.6, 1.5, 2.0].map(|x| x * unit);
            let domain = Domain::new(edge, end, [48, 36, 20]).unwrap();
            let projection = match projection {
                "perspective" => Projection::Perspective { fov_degrees: 40.0 },
                _ => Projection::Orthographic { height: 2.0 * unit },
            };
            let mut settings = camera(projection, ["0", "0", "0"], ["0", "0", "0"]);
            settings.position = [0.5, 0.75, -3.0].map(|x| Decimal::from_f64(x * unit).unwrap());
            settings.look_at = [0.1, 0.75, 1.5].map(|x| Decimal::from_f64(x * unit).unwrap());
            let view = View::from_camera(&settings, 64, 48, &domain).unwrap();
            let frame = view.frame(&domain.cell_corner(1, [8, 16, 8]), 1, 8.0);
            let seen = frame.footprint(DVec3::ZERO, DVec3::splat(8.0)).unwrap();
            let plane = if frame.is_perspective { 1.0 } else { unit };
            (
                seen.plane_lo / plane,
                seen.plane_hi / plane,
                seen.depth_lo / unit,
                seen.depth_hi / unit,
            )
        };
        let one = footprint(0);
        assert!(one.0.cmplt(one.1).all(), "{one:?}");
        for exponent in [-80, -30, 30, 38, 44, 80, 300] {
            assert_eq!(footprint(exponent), one, "{projection} 2^{exponent}");
        }
    }
}

#[test]
fn rays_across_stretched_cells_stay_in_them() {
    let narrow = Projection::Perspective { fov_degrees: 20.0 };
    for projection in [narrow, Projection::Orthographic { height: 0.9 }] {
        for stretch in [1.0, 1e6, 1e10] {
            let domain = Domain::new([0.0; 3], [1.0, stretch, 1.0], [4; 3]).unwrap();
            let mut settings = camera(projection, ["0", "0", "0"], ["0", "0", "0"]);
            let (eye, target) = ([-1.0, 0.05 * stretch, 0.5], [0.5, 0.05 * stretch + 1.0, 0.5]);
            settings.position = eye.map(|x| Decimal::from_f64(x).unwrap());
            settings.look_at = target.map(|x| Decimal::from_f64(x).unwrap());
            settings.up = DVec3::Z;
            let view = View::from_camera(&settings, 5, 5, &domain).unwrap();
            let ray = view.frame(&Position([0; 3]), 0, 4.0).ray(DVec2::ZERO);
            let place = ray.origin + ray.direction * ((2.0 - ray.origin.x) / ray.direction.x);
            let expected = 0.2 + 4.0 / stretch;
            assert!((place.y - expected).abs() < 1e-12, "{stretch:e}: {}", place.y);
        }
    }
}

proptest! {
    #[test]
    fn footprints_enclose_and_octants_come_front_to_back(
        eye in prop::array::uniform3(-1.0..3.0_f64),
        target in prop::array::uniform3(0.0..1.0_f64),
        cell in prop::array::uniform3(0i128..40),
        inside in prop::array::uniform3(0.0..8.0_f64),
        perspective in any::<bool>(),
    ) {
        let projection = if perspective {
            Projection::Perspective { fov_degrees: 80.0 }
        } else {
            Projection::Orthographic { height: 3.0 }
        };
        let mut settings = camera(projection, ["0", "0", "0"], ["0", "0", "1"]);
        settings.position = eye.map(|x| Decimal::from_f64(x).unwrap());
        settings.look_at = target.map(|x| Decimal::from_f64(x).unwrap());
        let domain = domain();
        let Ok(view) = View::from_camera(&settings, 64, 48, &domain) else { return Ok(()) };
        let corner = domain.cell_corner(1, cell);
        let frame = view.frame(&corner, 1, 8.0);
        // The point's own place on the image plane, by plain arithmetic.
        let point = (DVec3::from_array(inside) + DVec3::from_array(cell.map(|c| c as f64)))
            * domain.cell_width(1) + DVec3::from_array(domain.left());
        let basis = frame.basis;
        let offset = point - DVec3::from_array(eye);
        let depth = offset.dot(basis.forward);
        let over = if perspective { depth } else { 1.0 };
        let plane = DVec2::new(offset.dot(basis.right), offset.dot(basis.up)) / over;
        let seen = !perspective || depth > 1e-9;
        prop_assert!((basis.right.dot(basis.forward)).abs() < 1e-15);
        prop_assert!((basis.right.length() - 1.0).abs() < 1e-15);
        prop_assert!((basis.up.length() - 1.0).abs() < 1e-15);
        if !seen || plane.x.abs() > view.plane_half_size().x || plane.y.abs() > view.plane_half_size().y {
            return Ok(());
        }
        let footprint = frame.footprint(DVec3::ZERO, DVec3::splat(8.0)).unwrap();
        let (error, size) = (DVec2::splat(1e-9), 1e-9);
        prop_assert!((footprint.plane_lo - error).cmple(plane).all());
        prop_assert!((footprint.plane_hi + error).cmpge(plane).all());
        prop_assert!(footprint.depth_lo - size <= depth && depth <= footprint.depth_hi + size);
        let ray = frame.ray(plane);
        let sigma = depth - frame.depth;
        let error = ray.origin + ray.direction * sigma - DVec3::from_array(inside);
        prop_assert!(error.length() < 1e-6, "{error}");
        // Along the ray the octants' numbers, masked, never fall.
        let centre = domain.cell_corner(1, cell.map(|c| c + 4));
        let mask = view.octant_order(&centre);
        let mut last = [0; 3];
        for n in 0..200 {
            let sigma = ray.sigma_min.max(sigma - 3.0) + f64::from(n) * 0.03;
            let at = (ray.origin + ray.direction * sigma).to_array();
            if at.iter().all(|x| (0.0..8.0).contains(x)) {
                let now: [u8; 3] = std::array::from_fn(|a| u8::from(at[a] >= 4.0) ^ mask >> a & 1);
                prop_assert!((0..3).all(|a| now[a] >= last[a]));
                last = now;
            }
        }
    }
}

/// Which cell of `octree` holds the place `part`/`parts` of the view's height above the camera, which is
/// at so many hundredths, along y: by whole numbers alone.
fn cell_above(
    domain: &Domain,
    octree: u32,
    hundredths: i64,
    height: f64,
    [part, parts]: [i64; 2],
) -> BigInt {
    let [left, right, height] =
        [domain.left()[1], domain.right()[1], height].map(|x| Fixed::from_f64(x).0);
    let eye = (BigInt::from(hundredths) << BITS) * parts;
    let place: BigInt = eye + (height * part - &left * parts) * 100;
    let cells = BigInt::from(domain.root_cells()[1]) << octree;
    let width: BigInt = (right - left) * parts * 100;
    BigInt::div_floor(&(place * cells), &width)
}

/// A parallel view along z with rows of pixels in faces of cells, or a hair beside them.
#[test]
fn rays_beside_faces_are_in_the_cells_that_hold_them() {
    let domains =
        [([-0.3, 0.1, -1.0], [0.9, 0.9, 0.6]), ([0.0; 3], [0.8; 3]), ([0.0; 3], [0.3; 3])];
    let (mut faces, mut hairs) = (0, 0);
    for (left, right) in domains {
        let domain = Domain::new(left, right, [24, 20, 16]).unwrap();
        for (position, height) in [(50, 0.8), (40, 0.8), (15, 0.3), (50, 0.4), (30, 0.2)] {
            let parallel = Projection::Orthographic { height };
            let at = format!("0.{position}");
            let mut settings =
                camera(parallel, ["0.31", at.as_str(), "-2"], ["0.31", at.as_str(), "0.7"]);
            settings.up = DVec3::Y;
            for rows in [1, 4, 10, 15, 32, 48, 240] {
                let view = View::from_camera(&settings, 7, rows, &domain).unwrap();
                for (octree, per) in [(0, 1), (3, 1), (20, 1), (5, 3)] {
                    for n in 0..i64::from(rows) * per {
                        // The middle of the row's `n`-th part, from above.
                        let parts = 2 * i64::from(rows) * per;
                        let part = [i64::from(rows) * per - (2 * n + 1), parts];
                        let expected = cell_above(&domain, octree, position, height, part);
                        let corner = domain.cell_corner(octree as i32, [0; 3]);
                        let frame = view.frame(&corner, octree as i32, 8.0);
                        let place = [7.0, (2 * n + 1) as f64];
                        let found = frame.ray_of(&view.aim_in(place, per as f64)).origin.y;
                        assert_eq!(
                            BigInt::from(found.floor() as i128),
                            expected,
                            "{rows} {n} {octree}"
                        );
                        let off = (found - found.round()).abs();
                        faces += u32::from(off == 0.0);
                        hairs += u32::from(off > 0.0 && off < 1e-12);
                    }
                }
            }
        }
    }
    assert!(faces > 100 && hairs > 100, "{faces} {hairs}");
}

#[test]
fn rays_of_the_widest_views_are_far_away() {
    for height in [1e200, 1e290, 1e300] {
        let parallel = Projection::Orthographic { height };
        let mut settings = camera(parallel, ["0.3", "0.7", "-2"], ["0.3", "0.7", "1.4"]);
        settings.up = DVec3::Y;
        let view = View::from_camera(&settings, 3, 3, &domain()).unwrap();
        let frame = view.frame(&domain().cell_corner(0, [0; 3]), 0, 8.0);
        let [upper, middle, lower] =
            [1.0, 3.0, 5.0].map(|y| frame.ray_of(&view.aim_in([3.0, y], 1.0)).origin.y);
        assert!(upper > 1e8 && lower < -1e8 && middle.abs() < 100.0, "{upper} {middle} {lower}");
    }
}

#[test]
fn messages_about_cameras_name_the_scene() {
    let text = "[camera]\nposition = [0.3, 0.7, -2]\nlook_at = [0.3, 0.7, 1.4]\nup = [0, 0, 1]\n\
                [[volume]]\nfield = \"Density\"\n";
    let scene = Scene::parse(text, "here.toml").unwrap();
    let message = View::new(&scene, &domain()).unwrap_err().to_string();
    assert!(message.starts_with("here.toml: camera: up"), "{message}");
}
