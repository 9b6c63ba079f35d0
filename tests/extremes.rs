//! Pictures at the ends of what numbers can say: each has a known answer.

// Helpers fail the tests that call them.
#![allow(clippy::unwrap_used)]

mod bricks;
#[path = "support/data.rs"]
mod data;
#[path = "support/random.rs"]
mod random;
mod twin;

use bricks::sets::Set;
use deepfield::cache::Cache;
use deepfield::render::{Film, RenderOptions, Rendered, render};
use deepfield::scene::Scene;
use deepfield::source;
use deepfield::synth::Recipe;
use twin::dataset::{Dataset, Precision};
use twin::picture::Picture;

/// Three levels about a point beside the middle of the unit cube.
const REFINED: &str = "[domain]\nleft = [0.0, 0.0, 0.0]\nright = [1.0, 1.0, 1.0]\n\
     root = [16, 16, 16]\n[refinement]\nmax_level = 2\n[[refinement.centre]]\n\
     position = [0.4, 0.55, 0.6]\nhalf_size = [5, 4, 6]\n";
/// Width of a cell of the deepest level.
const CELL: f64 = 1.0 / 64.0;
const PIXELS: usize = 9;

struct Subject {
    set: Set,
    cache: Cache,
}

impl Subject {
    /// The refined cube with these components of density.
    fn new(density: &str) -> Self {
        let recipe = Recipe::parse(&format!("{REFINED}{density}"), "recipe").unwrap();
        let set = Set::of_recipe("extreme", &recipe);
        let cache = set.cache(8);
        Self { set, cache }
    }

    fn constant(value: f64) -> Self {
        Self::new(&format!("[[density]]\nkind = \"constant\"\nvalue = {value:e}\n"))
    }

    fn render(&self, view: &View, volume: &str) -> Film {
        self.draw(&view.scene(volume))
    }

    fn draw(&self, scene: &str) -> Film {
        let film = self.drawn(scene).unwrap().film;
        assert!(film.pixels().iter().flatten().all(|c| c.is_finite() && *c >= 0.0), "{film:?}");
        film
    }

    fn drawn(&self, scene: &str) -> deepfield::Result<Rendered> {
        self.drawn_by(2, scene)
    }

    fn drawn_by(&self, threads: usize, scene: &str) -> deepfield::Result<Rendered> {
        let scene = Scene::parse(scene, "scene").unwrap();
        let options = RenderOptions {
            memory: 256 << 20,
            threads: Some(threads),
            progress: None,
            fixed: None,
            resident: false,
        };
        render(&self.cache, &scene, &options)
    }

    /// The largest difference to the twin's picture, relative to its largest value.
    fn difference(&self, view: &View, volume: &str) -> f64 {
        let source = source::open(&self.set.input, None).unwrap();
        let dataset = Dataset::load(source.as_ref(), "Density", Precision::Single).unwrap();
        let scene = twin::scene::Scene::parse(&view.scene(volume)).unwrap();
        let truth = Picture::render(&scene, &dataset).unwrap();
        assert!(truth.largest() > 0.0, "{volume}");
        let pixels = self.render(view, volume).pixels().iter().map(|p| p.map(f64::from)).collect();
        let picture = Picture { pixels, ..truth.clone() };
        picture.difference(&truth).unwrap().largest
    }

    /// That every pixel of a view along z from outside is (r, r, r, a), for both interpolations.
    fn shows(&self, volume: &str, [r, a]: [f64; 2]) {
        for linear in [false, true] {
            let film = self.render(&View { linear, ..View::default() }, volume);
            for pixel in film.pixels() {
                let close =
                    |found: f32, exact: f64| (f64::from(found) - exact).abs() <= 2e-7 * exact;
                let right = pixel[..3].iter().all(|c| close(*c, r)) && close(pixel[3], a);
                assert!(right, "{pixel:?}, not {r} and {a}: {volume}");
            }
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct View {
    position: [f64; 3],
    look_at: [f64; 3],
    up: [f64; 3],
    perspective: bool,
    linear: bool,
}

impl Default for View {
    /// Along z, over the inner half of the cube's face.
    fn default() -> Self {
        Self {
            position: [0.5, 0.5, -1.0],
            look_at: [0.5; 3],
            up: [0.0, 1.0, 0.0],
            perspective: false,
            linear: true,
        }
    }
}

impl View {
    fn scene(&self, volume: &str) -> String {
        let Self { position, look_at, up, perspective, linear } = self;
        let lens = if *perspective {
            "projection = \"perspective\"\nfov = 60.0"
        } else {
            "projection = \"orthographic\"\nheight = 0.5"
        };
        let interpolation = if *linear { "linear" } else { "cell" };
        format!(
            "[image]\nwidth = {PIXELS}\nheight = {PIXELS}\n[camera]\nposition = {position:?}\n\
             look_at = {look_at:?}\nup = {up:?}\n{lens}\n[render]\n\
             interpolation = \"{interpolation}\"\ntolerance = 0\nsamples = 1\n[[volume]]\n\
             field = \"Density\"\n{volume}"
        )
    }

    /// How far the ray of pixel (i, j) runs through the unit cube, whose upper faces are outside.
    fn chord(&self, i: usize, j: usize) -> f64 {
        let sum = |a: [f64; 3], t: f64, b: [f64; 3]| -> [f64; 3] {
            std::array::from_fn(|n| a[n] + t * b[n])
        };
        let cross = |a: [f64; 3], b: [f64; 3]| -> [f64; 3] {
            std::array::from_fn(|n| {
                a[(n + 1) % 3] * b[(n + 2) % 3] - a[(n + 2) % 3] * b[(n + 1) % 3]
            })
        };
        let unit = |a: [f64; 3]| a.map(|x| x / a.iter().map(|x| x * x).sum::<f64>().sqrt());
        let forward = unit(sum(self.look_at, -1.0, self.position));
        let right = unit(cross(forward, self.up));
        let half = if self.perspective { 30_f64.to_radians().tan() } else { 0.25 };
        let place = |n: usize| (2.0 * (n as f64 + 0.5) / PIXELS as f64 - 1.0) * half;
        let aside = sum(right.map(|x| x * place(i)), -place(j), cross(right, forward));
        let (origin, direction, mut from) = if self.perspective {
            (self.position, unit(sum(forward, 1.0, aside)), 0.0)
        } else {
            (sum(self.position, 1.0, aside), forward, f64::NEG_INFINITY)
        };
        let mut to = f64::INFINITY;
        for a in 0..3 {
            if direction[a].abs() < 1e-13 {
                if !(0.0..1.0).contains(&origin[a]) {
                    return 0.0;
                }
                continue;
            }
            let ends = [0.0, 1.0].map(|face| (face - origin[a]) / direction[a]);
            from = from.max(ends[0].min(ends[1]));
            to = to.min(ends[0].max(ends[1]));
        }
        (to - from).max(0.0)
    }
}

const WHITE: &str = "color = [[0.0, 1.0, 1.0, 1.0], [1.0, 1.0, 1.0, 1.0]]\n";

fn volume(scale: &str, range: &str, absorption: &str, emission: &str) -> String {
    format!(
        "scale = \"{scale}\"\n{range}{WHITE}absorption = [{absorption}]\nemission = [{emission}]\n"
    )
}

fn linear(range: [f64; 2], absorption: &str, emission: &str) -> String {
    volume("linear", &format!("range = {range:?}\n"), absorption, emission)
}

#[test]
fn extinction_of_nothing_and_of_1e30() {
    let subject = Subject::constant(3.0);
    subject.shows(&linear([1.0, 5.0], "[0, 0]", "[0, 0], [1, 4]"), [2.0, 0.0]);
    subject.shows(&linear([1.0, 5.0], "[0, 5e29]", "[0, 0], [1, 1e30]"), [1.0, 1.0]);
    subject.shows(&linear([1.0, 5.0], "[0, 1e30]", "[0, 0]"), [0.0, 1.0]);
    // Thinner than f32's 1 − 2⁻²⁴, and than f64's.
    for depth in [1e-10, 1e-20, 1e-31] {
        let table = format!("[0, {depth:e}]");
        subject.shows(&linear([1.0, 5.0], &table, &table), [depth, depth]);
    }
}

/// Where nothing shines what is left out behind an opaque place still counts for the opacity.
#[test]
fn rays_that_end_early_in_the_dark_say_what_they_miss() {
    let subject = Subject::constant(3.0);
    let dark = linear([1.0, 5.0], "[0, 9]", "[0, 0]");
    let black = dark.replace("emission = [[0, 0]]", "").replace("1.0, 1.0, 1.0]", "0.0, 0.0, 0.0]");
    for volume in [dark, black] {
        for (linear, tolerance) in [(false, "0.5"), (true, "0.5"), (false, "0.05"), (true, "0.05")]
        {
            let scene = View { linear, ..View::default() }.scene(&volume);
            let scene = scene.replace("tolerance = 0", &format!("tolerance = {tolerance}"));
            let rendered = subject.drawn(&scene).unwrap();
            let bound = rendered.stats.error_bound.unwrap();
            let truth = -(-9.0_f64).exp_m1();
            for pixel in rendered.film.pixels() {
                let off = (f64::from(pixel[3]) - truth).abs();
                assert!(off <= bound, "{off:e}, bound {bound:e}: {scene}");
            }
        }
    }
}

#[test]
fn light_beyond_floats_is_refused() {
    let subject = Subject::constant(3.0);
    let volume =
        linear([1.0, 5.0], "[0, 0]", "[0, 1e30]").replace("1.0, 1.0, 1.0]", "1e9, 0.0, 0.0]");
    for tolerance in ["0", "1e30", "\"1%\""] {
        let scene = View::default().scene(&volume);
        let scene = scene.replace("tolerance = 0", &format!("tolerance = {tolerance}"));
        let error = subject.drawn(&scene).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains("brighter than 32-bit floats"), "{error}");
    }
}

#[test]
fn tables_whose_end_points_are_equal() {
    let subject = Subject::constant(3.0);
    let seen = |depth: f64| [1.0 - (-depth).exp(); 2];
    let steps = "[0, 7], [0, 1], [0.5, 4], [0.5, 0.5], [1, 0.5], [1, 2]";
    // At a step the last point counts: x is 0, ½ and 1.
    for (range, depth) in
        [([3.0, 5.0], 1.0), ([2.0, 4.0], 0.5), ([1.0, 3.0], 2.0), ([0.0, 1.0], 2.0)]
    {
        subject.shows(&linear(range, steps, steps), seen(depth));
    }
    for one in ["[0.5, 3]", "[0, 3]", "[1, 3]", "[-7, 3]", "[7, 3]", "[0, 3], [0, 3]"] {
        subject.shows(&linear([3.0, 5.0], one, one), seen(3.0));
    }
}

#[test]
fn fields_constant_in_space() {
    // Of the second, 16 bits are nearer than 20.
    let [subject, _] = [3.0, 0.0923].map(|value| {
        let subject = Subject::constant(value);
        // Without a range everything maps to 0.
        for scale in ["linear", "log10", "symlog\"\nlinthresh = 0.1 #\""] {
            let volume = volume(scale, "", "[0, 0.5], [1, 9]", "[0, 0.5], [1, 9]");
            subject.shows(&volume, [1.0 - (-0.5_f64).exp(); 2]);
        }
        subject
    });
    let log = volume("log10", "range = [0.3, 30.0]\n", "[0, 0]", "[0, 0], [1, 4]");
    subject.shows(&log, [2.0, 0.0]);
}

#[test]
fn logarithms_of_what_is_not_positive() {
    // Nowhere positive: everything maps to 0.
    for value in [0.0, -3.0] {
        let subject = Subject::constant(value);
        for range in ["", "range = [1.0, 10.0]\n"] {
            let volume = volume("log10", range, "[0, 0.5], [1, 9]", "[0, 0.5], [1, 9]");
            subject.shows(&volume, [1.0 - (-0.5_f64).exp(); 2]);
        }
    }
    // From −1 to 1, exactly 0 nowhere and everywhere near the middle.
    let subject =
        Subject::new("[[density]]\nkind = \"gradient\"\nvalue = -1.0\nslope = [2.0, 0.0, 0.0]\n");
    let tables = "[0, 0.3], [1, 4]";
    for linear in [false, true] {
        let view = View { linear, ..View::default() };
        for range in ["", "range = [0.02, 0.5]\n"] {
            let difference = subject.difference(&view, &volume("log10", range, tables, tables));
            assert!(difference < 2e-6, "{difference} {range}");
        }
    }
}

#[test]
fn sixty_decades() {
    // From 1e-30 beyond a sphere's radius to 1e30 in its middle.
    let subject = Subject::new(
        "[[density]]\nkind = \"power_law\"\ncentre = [0.5, 0.5, 0.5]\nvalue = 1e-30\nslope = 40.0\n\
         inner = 0.0316227766\n",
    );
    let tables = "[0, 0.1], [0.3, 6], [0.4, 0], [1, 30]";
    for linear in [false, true] {
        let view = View { linear, ..View::default() };
        for (scale, range) in [
            ("log10", ""),
            ("log10", "range = [1e-30, 1e30]\n"),
            ("linear", "range = [1e-30, 1e30]\n"),
            ("linear", "range = [1e-30, 1e-20]\n"),
            ("symlog\"\nlinthresh = 1e-25 #\"", "range = [-1e30, 1e30]\n"),
        ] {
            let difference = subject.difference(&view, &volume(scale, range, tables, tables));
            assert!(difference < 2e-6, "{difference}: {scale} {range}, linear: {linear}");
        }
    }
}

#[test]
fn denormals() {
    let subject = Subject::constant(1e-310);
    subject.shows(&linear([0.0, 2e-310], "[0, 0]", "[0, 0], [1, 4]"), [2.0, 0.0]);
    subject.shows(&linear([0.0, 1.0], "[0, 1]", "[0, 1]"), [1.0 - (-1.0_f64).exp(); 2]);
    let subject = Subject::constant(3.0);
    // What f32 cannot hold is 0 in a picture; what does not absorb lets everything through.
    subject.shows(&linear([1.0, 5.0], "[0, 5e-324]", "[0, 1e-310]"), [0.0, 0.0]);
    subject.shows(&linear([1.0, 5.0], "[0, 5e-324]", "[0, 0], [1, 4]"), [2.0, 0.0]);
    // Points a denormal apart.
    let steep = "[0, 1], [5e-324, 3], [1, 3]";
    subject.shows(&linear([1.0, 5.0], steep, steep), [1.0 - (-3.0_f64).exp(); 2]);
    subject.shows(&linear([3.0, 5.0], steep, steep), [1.0 - (-1.0_f64).exp(); 2]);
}

/// Cameras on corners, faces and edges of cells and of the domain, along axes and in planes.
fn cameras() -> Vec<View> {
    let up = [0.0, 1.0, 0.0];
    let corner = [27.0 * CELL, 36.0 * CELL, 39.0 * CELL];
    let along_x = |p: [f64; 3], step: f64| [p[0] + step, p[1], p[2]];
    let mut pairs = Vec::new();
    for place in [corner, [0.5; 3], [0.5, 0.51, 0.52], [0.0; 3], [0.0, 0.5, 0.5], [0.0, 0.0, 0.4]] {
        // Along an axis, in a plane of faces, along a diagonal of cells.
        pairs.push((place, along_x(place, 0.5)));
        pairs.push((place, [place[0] + 0.25, place[1], place[2] + 0.125]));
        pairs.push((place, place.map(|x| x + 0.25)));
    }
    // From upper faces, which are outside, inward and along.
    for place in [[1.0, 0.5, 0.5], [1.0; 3], [1.0, 1.0, 0.25]] {
        pairs.push((place, along_x(place, -0.5)));
        pairs.push((place, [place[0] - 0.25, place[1], place[2] - 0.125]));
        pairs.push((place, place.map(|x| x - 0.25)));
        pairs.push((place, [place[0], place[1], place[2] - 0.25]));
    }
    let view = |(position, look_at), perspective, linear| View {
        position,
        look_at,
        up,
        perspective,
        linear,
    };
    pairs
        .into_iter()
        .flat_map(|pair| {
            [[false, false], [false, true], [true, false], [true, true]]
                .map(|[perspective, linear]| view(pair, perspective, linear))
        })
        .collect()
}

#[test]
fn cameras_on_corners_and_faces_see_all_of_a_constant_field() {
    let subject = Subject::constant(3.0);
    let volume = linear([1.0, 5.0], "[0, 0], [1, 4]", "[0, 1]");
    for view in cameras() {
        let film = subject.render(&view, &volume);
        for (n, pixel) in film.pixels().iter().enumerate() {
            let chord = view.chord(n % PIXELS, n / PIXELS);
            let opacity = 1.0 - (-2.0 * chord).exp();
            let error = (f64::from(pixel[3]) - opacity).abs();
            let light = (f64::from(pixel[0]) - 0.5 * opacity).abs();
            assert!(error < 1e-6 && light < 1e-6, "{n}: {pixel:?}, not {opacity}: {view:?}");
        }
    }
}

/// A rolled camera in the plane of bricks' faces has rays that lie in that plane but for what rounding
/// makes of it: no brick is passed over by these.
#[test]
fn rolled_cameras_in_faces_see_all_of_a_constant_field() {
    let subject = Subject::constant(3.0);
    let volume = linear([1.0, 5.0], "[0, 0], [1, 4]", "[0, 1]");
    for up in [[1.0, 1.0, 0.0], [-1.0, 3.0, 0.0], [0.3, 0.5, 0.8], [4.0, -1.0, 0.1]] {
        for (axis, place) in [[0.5, 0.5], [0.25, 0.5], [0.5, 0.75], [0.375, 0.625]]
            .iter()
            .flat_map(|p| [(0, p), (1, p), (2, p)])
        {
            let turned =
                |v: [f64; 3]| -> [f64; 3] { std::array::from_fn(|a| v[(a + 2 - axis) % 3]) };
            let position = turned([place[0], place[1], -0.7]);
            let look_at = turned([place[0], place[1], 0.5]);
            for [perspective, linear] in
                [[true, true], [true, false], [false, true], [false, false]]
            {
                let view = View { position, look_at, up: turned(up), perspective, linear };
                for (n, pixel) in subject.render(&view, &volume).pixels().iter().enumerate() {
                    let (i, j) = (n % PIXELS, n / PIXELS);
                    let opacity = 1.0 - (-2.0 * view.chord(i, j)).exp();
                    let error = (f64::from(pixel[3]) - opacity).abs();
                    assert!(error < 1e-6, "{i} {j}: {pixel:?}, not {opacity}: {view:?}");
                }
            }
        }
    }
}

/// Moves the camera by 1e-9 of the smallest cell, inward if it stands on an edge.
fn moved(view: &View) -> View {
    let step = 1e-9 * CELL;
    let by: [f64; 3] = std::array::from_fn(|a| if view.position[a] < 1.0 { step } else { -step });
    let add = |p: [f64; 3]| -> [f64; 3] { std::array::from_fn(|a| p[a] + by[a]) };
    View { position: add(view.position), look_at: add(view.look_at), ..*view }
}

#[test]
fn cameras_on_corners_and_faces_see_what_is_seen_beside() {
    let subject = Subject::new(
        "[[density]]\nkind = \"gaussian\"\ncentre = [0.4, 0.5, 0.6]\npeak = 3.0\nsigma = 0.2\n\
         [[density]]\nkind = \"constant\"\nvalue = 1.0\n",
    );
    let volume = linear([1.0, 4.0], "[0, 0.5], [0.5, 4], [1, 1]", "[0, 1], [1, 5]");
    for view in cameras().into_iter().filter(|view| view.linear) {
        let beside = moved(&view);
        let [here, there] = [&view, &beside].map(|view| subject.render(view, &volume));
        for (n, (a, b)) in here.pixels().iter().zip(there.pixels()).enumerate() {
            // Where the move enters or leaves the domain along a face, that is another picture.
            let chords = [&view, &beside].map(|view| view.chord(n % PIXELS, n / PIXELS));
            if (chords[0] - chords[1]).abs() > 1e-8 {
                continue;
            }
            let same = a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-6 * (1.0 + b));
            assert!(same, "pixel {n}: {a:?} and {b:?}: {view:?}");
        }
    }
}

/// Rays that lie in faces of cells see those above: pictures do not change where all of them are
/// moved up by less than a cell, whatever the number of pixels and of rays in them.
#[test]
fn rays_in_faces_see_the_cells_above() {
    let subject =
        Subject::new("[[density]]\nkind = \"gradient\"\nvalue = 1.0\nslope = [5.0, 3.0, 8.0]\n");
    let volume = "range = [1.0, 20.0]\nabsorption = [[0.0, 0.1], [1.0, 9.0]]\n";
    let [x, y, z] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let views = [(x, y), (y, z), (z, x), (z, y), ([1.0, 1.0, 0.0], z), ([0.0, -1.0, 1.0], x)];
    let mut in_faces = 0;
    for ((forward, up), (height, samples)) in views
        .into_iter()
        .flat_map(|view| [-1.0, 1.0].map(|sign| (view.0.map(|c| c * sign), view.1)))
        .flat_map(|view| [("0.28125", 1), ("0.84375", 3), ("0.140625", 1)].map(|s| (view, s)))
    {
        let picture = |by: f64| {
            // Across the view in all directions, or along `up` where others are in no face.
            let is_along_axis = forward.iter().filter(|c| **c != 0.0).count() == 1;
            let moves = |a: usize| if is_along_axis { forward[a] == 0.0 } else { up[a] != 0.0 };
            let look_at: [f64; 3] =
                std::array::from_fn(|a| 0.5 + if moves(a) { by * CELL } else { 0.0 });
            let position = std::array::from_fn(|a| look_at[a] - 2.0 * forward[a]);
            let view = View { position, look_at, up, linear: false, ..View::default() };
            let scene = view.scene(volume).replace("height = 0.5", &format!("height = {height}"));
            subject.draw(&scene.replace("samples = 1", &format!("samples = {samples}")))
        };
        let difference = |a: &Film, b: &Film| {
            let pairs = a.pixels().iter().flatten().zip(b.pixels().iter().flatten());
            pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
        };
        let (here, above, below) = (picture(0.0), picture(0.25), picture(-0.25));
        let off = difference(&here, &above);
        assert!(off <= 1e-6, "{forward:?} {up:?} {height} {samples}: {off:e}");
        in_faces += u32::from(difference(&here, &below) > 1e-3);
    }
    assert!(in_faces == 36, "rays in faces in {in_faces} of 36 pictures");
}

/// A polygon on the image plane, in pixels from the picture's left and upper edge.
type Polygon = Vec<[f64; 2]>;

/// What of a convex polygon lies where a·x + b·y ≤ c.
fn clipped(polygon: &Polygon, [a, b, c]: [f64; 3]) -> Polygon {
    let beyond = |p: &[f64; 2]| a * p[0] + b * p[1] - c;
    let mut left = Polygon::new();
    for (p, q) in polygon.iter().zip(polygon.iter().cycle().skip(1)) {
        let (from, to) = (beyond(p), beyond(q));
        if from <= 0.0 {
            left.push(*p);
        }
        if from * to < 0.0 {
            let t = from / (from - to);
            left.push([0, 1].map(|k| p[k] + t * (q[k] - p[k])));
        }
    }
    left
}

fn area(polygon: &Polygon) -> f64 {
    let edges = polygon.iter().zip(polygon.iter().cycle().skip(1));
    0.5 * edges.map(|(p, q)| p[0] * q[1] - q[0] * p[1]).sum::<f64>().abs()
}

/// The convex hull of points, by the angle that each makes with the one before (Jarvis, 1973).
fn hull(points: &Polygon) -> Polygon {
    let side = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| {
        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    };
    let first = *points.iter().min_by(|a, b| a[0].total_cmp(&b[0])).unwrap();
    let mut hull = vec![first];
    loop {
        let last = hull[hull.len() - 1];
        let others = points.iter().copied().filter(|p| *p != last);
        let next = others.reduce(|a, b| if side(last, a, b) > 0.0 { a } else { b }).unwrap();
        if next == first {
            return hull;
        }
        hull.push(next);
    }
}

/// Silhouettes of an opaque cube: a pixel's opacity is the part that the cube's polygon covers. Edges
/// run beside all rays of many pixels alike, where nothing but their neighbours tells of them.
#[test]
fn pixels_at_an_opaque_edge_are_covered_as_they_should() {
    const SIZE: usize = 60;
    let subject = Subject::constant(1.0);
    let volume = "range = [0.1, 1.0]\nabsorption = [[0.0, 1e7], [1.0, 1e7]]\n";
    let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|k| a[k] * b[k]).sum::<f64>();
    let unit = |a: [f64; 3]| a.map(|x| x / dot(a, a).sqrt());
    let cross = |a: [f64; 3], b: [f64; 3]| {
        std::array::from_fn(|k| a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3])
    };
    for (n, away) in [[2.0, 0.3, 0.1], [-0.1, 2.2, 0.9], [0.05, -0.2, -2.5], [1.1, 1.3, -1.7]]
        .into_iter()
        .enumerate()
    {
        let position: [f64; 3] = away.map(|x| 0.5 + x);
        let up = [0.1, 1.0, 0.37 * n as f64];
        let view = View { position, up, perspective: true, linear: false, ..View::default() };
        let scene = view.scene(volume).replace("tolerance = 0", "tolerance = 0.01");
        let scene = scene.replace("samples = 1", "samples = \"area\"");
        let scene = scene.replace(&format!("= {PIXELS}\n"), &format!("= {SIZE}\n"));
        let film = subject.draw(&scene);
        let forward = unit(away.map(|x| -x));
        let right = unit(cross(forward, up));
        let above = cross(right, forward);
        let half = 30f64.to_radians().tan();
        let corner = |octant: usize| {
            let offset: [f64; 3] =
                std::array::from_fn(|a| f64::from(octant as u32 >> a & 1) - position[a]);
            let depth = dot(offset, forward) * half;
            let (p, q) = (dot(offset, right) / depth, dot(offset, above) / depth);
            [p + 1.0, 1.0 - q].map(|x| 0.5 * x * SIZE as f64)
        };
        let outline = hull(&(0..8).map(corner).collect());
        let mut worst = 0.0_f64;
        for (k, pixel) in film.pixels().iter().enumerate() {
            let [x, y] = [k % SIZE, k / SIZE].map(|n| n as f64);
            let sides =
                [[-1.0, 0.0, -x], [1.0, 0.0, x + 1.0], [0.0, -1.0, -y], [0.0, 1.0, y + 1.0]];
            let covered = area(&sides.iter().fold(outline.clone(), |left, s| clipped(&left, *s)));
            worst = worst.max((f64::from(pixel[3]) - covered).abs());
        }
        // No bound is certified here, and what is likely is no certainty; but an edge that no ray of
        // a pixel has met would make up to 0.25.
        assert!(worst < 0.05, "{away:?}: {worst}");
    }
}

/// At the view's axis distances from the eye to a plane bend one way in all directions: nothing of that
/// cancels between opposite rays of a pixel, be it at the domain's faces or where values change along
/// the axis.
#[test]
fn areas_around_the_axis_are_within_their_bound() {
    let constant = Subject::constant(1.0);
    let along_z =
        Subject::new("[[density]]\nkind = \"gradient\"\nvalue = 0.2\nslope = [0.0, 0.0, 1.0]\n");
    let emits = "color = [[0.0, 1.0, 0.5, 0.2]]\nscale = \"linear\"\nrange = [0.0, 1.25]\n\
                 emission = [[0.0, 0.0], [1.0, 1.0]]\n";
    let clear = format!("{emits}absorption = [[0.0, 0.0]]\n");
    let dims = format!("{emits}absorption = [[0.0, 0.0], [1.0, 3.0]]\n");
    // The last one is so near that pixels are smaller than cells.
    let eyes = [
        ([0.5, 0.5, -1.0], 15.0),
        ([0.5; 3], 60.0),
        ([0.3, 0.5, -9.0], 0.7),
        ([0.5, 0.5, 0.92], 15.0),
    ];
    let (mut certified, mut pictures) = (0, 0);
    for (subject, volume) in [(&constant, &clear), (&constant, &dims), (&along_z, &dims)] {
        for (position, fov) in eyes {
            for (size, linear) in [(1, true), (3, false), (3, true), (4, true)] {
                let look_at = [0.5, 0.5, 1.0];
                let view = View { position, look_at, perspective: true, linear, ..View::default() };
                let scene = view.scene(volume).replace("fov = 60.0", &format!("fov = {fov}"));
                let [wide, high] = ["width", "height"].map(|side| format!("{side} = {PIXELS}"));
                let scene = scene
                    .replace(&wide, &format!("width = {size}"))
                    .replace(&high, &format!("height = {size}"));
                let truth = subject.draw(&scene.replace("samples = 1", "samples = 64"));
                let scene = scene.replace("samples = 1", "samples = \"area\"");
                for tolerance in ["3%", "0.1%", "0.01%"] {
                    let within = format!("tolerance = \"{tolerance}\"");
                    let Rendered { film, stats, .. } =
                        subject.drawn(&scene.replace("tolerance = 0", &within)).unwrap();
                    let pairs = film.pixels().iter().flatten().zip(truth.pixels().iter().flatten());
                    let off = pairs.map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max);
                    let bound = stats.error_bound.unwrap();
                    // The truth is a mean of rays itself, and off by a part of what one ray is.
                    let unsure = 2e-6 * f64::from(truth.largest_value());
                    assert!(off <= bound + unsure, "{off:e}, not {bound:e}: {within}\n{scene}");
                    certified += u32::from(bound <= stats.tolerance.unwrap());
                    pictures += 1;
                }
            }
        }
    }
    assert!(5 * certified > 2 * pictures, "{certified} of {pictures} pictures are certified");
}

#[test]
fn the_domains_side_along_a_column_of_pixels_covers_its_part_of_them() {
    let subject = Subject::new("[[density]]\nkind = \"constant\"\nvalue = 2.0\n");
    // Pixels a tenth wide; the domain ends at x = 1, and all of its depth is opaque.
    for (x, covered) in [(0.93, 0.2), (0.9, 0.5), (0.917, 0.33), (0.958, 0.92)] {
        for interpolation in ["linear", "cell"] {
            let scene = format!(
                "[image]\nwidth = 9\nheight = 7\n[camera]\nprojection = \"orthographic\"\n\
                 position = [{x}, 0.5, -2.0]\nlook_at = [{x}, 0.5, 0.5]\nheight = 0.7\n\
                 [render]\ntolerance = \"1%\"\nsamples = \"area\"\n\
                 interpolation = \"{interpolation}\"\n[[volume]]\nfield = \"Density\"\n\
                 scale = \"linear\"\nrange = [0.0, 4.0]\nabsorption = [[0.0, 50.0], [1.0, 50.0]]\n"
            );
            let film = subject.drawn(&scene).unwrap().film;
            // Each row has whole pixels, one that is covered in part, and empty ones.
            for row in film.pixels().chunks_exact(9) {
                let whole = row.iter().filter(|pixel| pixel[3] > 0.99).count() as f64;
                let found = row.iter().map(|pixel| f64::from(pixel[3])).sum::<f64>() - whole;
                assert!((found - covered).abs() < 0.01, "{found}, not {covered}: {interpolation}");
            }
        }
    }
}

#[test]
fn a_certified_picture_of_many_tiles_does_not_depend_on_threads() {
    let subject = Subject::new(
        "[[density]]\nkind = \"gaussian\"\ncentre = [0.4, 0.55, 0.6]\npeak = 3.0\nsigma = 0.2\n",
    );
    // Some of its tiles are drawn before the others, since they tell whether these can be certified.
    let scene = "[image]\nwidth = 450\nheight = 380\n[camera]\nposition = [1.9, 1.2, -1.4]\n\
         look_at = [0.5, 0.5, 0.5]\nfov = 40.0\n[render]\ntolerance = \"3%\"\nsamples = \"area\"\n\
         [[volume]]\nfield = \"Density\"\nscale = \"linear\"\nrange = [0.0, 4.0]\n\
         emission = [[0.0, 0.0], [1.0, 3.0]]\nabsorption = [[0.0, 0.0], [1.0, 2.0]]\n";
    let [one, two] = [1, 2].map(|threads| subject.drawn_by(threads, scene).unwrap());
    assert!(one.film == two.film);
    assert!(one.stats.error_bound.unwrap() <= one.stats.tolerance.unwrap(), "{:?}", one.stats);
}

/// A picture of the areas of 32 by 32 pixels, `height` high, of values between 4.2 and 4.4; or of n by n
/// rays.
fn shell(height: f64, samples: &str) -> String {
    format!(
        "[image]\nwidth = 32\nheight = 32\n[camera]\nprojection = \"orthographic\"\n\
         position = [2.0, 1.3, -1.5]\nlook_at = [0.4, 0.55, 0.6]\nheight = {height}\n\
         [render]\ntolerance = \"1%\"\nsamples = {samples}\n[[volume]]\nfield = \"Density\"\n\
         scale = \"linear\"\nrange = [1.0, 9.0]\n\
         absorption = [[0.4, 0.0], [0.4, 7.0], [0.425, 7.0], [0.425, 0.0]]\n"
    )
}

#[test]
fn what_no_mean_shows_takes_no_more_rays_than_it_is_worth() {
    let subject = Subject::new(
        "[[density]]\nkind = \"constant\"\nvalue = 1.0\n[[density]]\nkind = \"gaussian\"\n\
         centre = [0.4, 0.55, 0.6]\npeak = 8.0\nsigma = 0.05\n",
    );
    // Near, and from so far that all of it is in a pixel, whose first ray need not meet it.
    for (height, most_rays) in [(0.6, 150), (9.0, 120)] {
        let area = subject.drawn(&shell(height, "\"area\"")).unwrap();
        assert!(area.stats.rays < most_rays * 1024, "{height}: {} rays", area.stats.rays);
        let truth = subject.drawn(&shell(height, "64")).unwrap();
        let largest = f64::from(truth.film.largest_value());
        assert!(largest > 0.0, "{height}");
        let pairs = area.film.pixels().iter().zip(truth.film.pixels());
        let off = |(a, b): (&[f32; 4], &[f32; 4])| (a[3] - b[3]).abs();
        let worst = f64::from(pairs.map(off).fold(0.0, f32::max));
        // What 64 by 64 rays are off by counts as well.
        assert!(worst <= 0.02 * largest, "{height}: {worst} of {largest}");
    }
}
