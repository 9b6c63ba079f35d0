//! The interpolant is continuous across borders of levels: those of the data and those that the
//! choice of levels makes, at faces, edges and corners, whatever the jump.

// Helpers fail the tests that call them.
#![allow(clippy::unwrap_used)]

mod bricks;
#[path = "support/data.rs"]
mod data;
#[path = "support/random.rs"]
mod random;

use std::collections::BTreeMap;
use std::path::Path;

use bricks::borders::{self, Border, Kind};
use bricks::sets::Set;
use bricks::slice::Slice;
use bricks::{Scale, Tree};
use deepfield::atomic_file::AtomicFile;
use deepfield::image::write_png;
use deepfield::render::cut::FootprintCut;
use deepfield::render::interpolant::DrawnNeighbours;
use deepfield::scene::Scene;
use deepfield::space::{Decimal, Position};
use glam::DVec3;
use random::Random;

/// Largest jump allowed, relative to the change over one cell beside it.
const LARGEST: f64 = 1e-5;
/// Rounding of values of magnitude 1 (decades; smaller ones are sums of such).
const ROUNDING: f64 = 1e-14;
/// Points looked at on each border that the choice of levels makes.
const POINTS: usize = 4;

/// What was measured at borders of one kind.
#[derive(Debug, Clone, Copy, Default)]
struct Measured {
    points: usize,
    /// Largest jump / change of one point.
    largest: f64,
    jumps: f64,
    changes: f64,
    /// The same without the rule.
    largest_without: f64,
    jumps_without: f64,
    changes_without: f64,
}

type Table = BTreeMap<(&'static str, Kind), Measured>;

impl Measured {
    fn add(
        &mut self,
        tree: &Tree<'_>,
        (border, point): (&Border, &Position),
        with: impl Fn(&Position) -> f64,
        without: impl Fn(&Position) -> f64,
    ) {
        let found = tree.jump(border, point, with);
        let excess = found.jump - ROUNDING * found.magnitude.max(1.0);
        assert!(excess <= LARGEST * found.change, "{border:?} at {point:?}: {found:?}");
        let other = tree.jump(border, point, without);
        self.points += 1;
        if found.change > 0.0 {
            self.largest = self.largest.max(excess / found.change);
        }
        let excess = other.jump - ROUNDING * other.magnitude.max(1.0);
        if other.change > 0.0 {
            self.largest_without = self.largest_without.max(excess / other.change);
        }
        self.jumps += found.jump;
        self.changes += found.change;
        self.jumps_without += other.jump;
        self.changes_without += other.change;
    }

    fn merge(&mut self, other: &Self) {
        self.points += other.points;
        self.largest = self.largest.max(other.largest);
        self.largest_without = self.largest_without.max(other.largest_without);
        self.jumps += other.jumps;
        self.changes += other.changes;
        self.jumps_without += other.jumps_without;
        self.changes_without += other.changes_without;
    }
}

fn measure_data(tree: &Tree<'_>, table: &mut Table) {
    let mut random = Random::new(7);
    let log10 = Scale::Log10;
    for (kind, borders) in borders::of_data(tree, &mut random) {
        let measured = table.entry(("data", kind)).or_default();
        for border in borders {
            let point = border.point(&mut random);
            let [fine, coarse] = tree.levels(&border, &point);
            assert_eq!((fine, fine - coarse), (border.octree, kind.levels), "{border:?}");
            let with = |p: &Position| tree.drawn(p, None, log10);
            let without = |p: &Position| tree.unblended(p, log10);
            measured.add(tree, (&border, &point), with, without);
        }
    }
}

/// A scene whose eye is at `eye` (in units of the domain) and whose pixels are coarse.
fn coarse_scene(tree: &Tree<'_>, eye: &Position, fov: f64) -> Scene {
    let domain = &tree.cache.header().domain;
    let text = |position: &Position| {
        let axes = std::array::from_fn::<_, 3, _>(|a| {
            let root = domain.root_cell_width()[a];
            let cells = position.0[a] as f64 * (-96f64).exp2();
            format!("\"{:e}\"", domain.left()[a] + cells * root)
        });
        axes.join(", ")
    };
    let target = Position(std::array::from_fn(|a| domain.upper().0[a] / 2));
    let toml = format!(
        "[image]\nwidth = 12\nheight = 12\n[camera]\nposition = [{}]\nlook_at = [{}]\n\
         up = [0.3, 1.0, 0.2]\nfov = {fov}\n[render]\n\
         [[volume]]\nfield = \"Density\"\n",
        text(eye),
        text(&target)
    );
    Scene::parse(&toml, "scene").unwrap()
}

/// A random point of a leaf cell of the deepest level.
fn deepest_point(tree: &Tree<'_>, random: &mut Random) -> Position {
    let deepest = tree.nodes.iter().filter(|n| n.record.leaf_cells > 0).map(|n| n.place.octree);
    let deepest = deepest.max().unwrap();
    let of_level = tree.nodes.iter().filter(|node| node.place.octree == deepest);
    let node = of_level.max_by_key(|node| node.record.leaf_cells).unwrap();
    let lowest = node.place.lowest_cell(tree.cache.header().shape);
    let bits = (96 - deepest) as u32;
    let brick = (tree.edge()) << bits;
    Position(lowest.map(|c| (c << bits) + random.whole(brick)))
}

fn measure_cuts(tree: &Tree<'_>, table: &mut Table) {
    let mut random = Random::new(11);
    let header = tree.cache.header();
    let upper = header.domain.upper();
    for n in 0..8 {
        let inside = deepest_point(tree, &mut random);
        let eye = Position(std::array::from_fn(|a| {
            let outside = [upper.0[a] * 3 / 2, -upper.0[a] / 3][random.below(2)];
            if n % 4 != 3 { inside.0[a] } else { outside }
        }));
        let scene = coarse_scene(tree, &eye, if n < 4 { 60.0 } else { 15.0 });
        let cut = FootprintCut::new(1.0, &scene, &header.domain, header.shape).unwrap();
        for (kind, borders) in borders::of_cut(tree, &cut) {
            let measured = table.entry(("choice", kind)).or_default();
            for border in pick(borders, 60, &mut random) {
                for _ in 0..POINTS {
                    let point = border.point(&mut random);
                    let with = |p: &Position| tree.drawn(p, Some(&cut), Scale::Log10);
                    let without = |p: &Position| {
                        let path = tree.path(p, Some(&cut));
                        tree.own(path[path.len() - 1], p, DrawnNeighbours::ALL, Scale::Log10)
                    };
                    measured.add(tree, (&border, &point), with, without);
                }
            }
        }
    }
}

/// At most `count` of the borders.
fn pick(mut borders: Vec<Border>, count: usize, random: &mut Random) -> Vec<Border> {
    while borders.len() > count {
        borders.swap_remove(random.below(borders.len()));
    }
    borders
}

fn measure(set: &Set, brick: u32, all: &mut Table) {
    let cache = set.cache(brick);
    let tree = Tree::new(&cache);
    let mut table = Table::new();
    measure_data(&tree, &mut table);
    measure_cuts(&tree, &mut table);
    println!("{}, bricks of {brick}³ ({} bricks)", set.name, tree.nodes.len());
    print_table(&table);
    for (key, measured) in &table {
        all.entry(*key).or_default().merge(measured);
    }
}

fn print_table(table: &Table) {
    println!(
        "{:8} {:6} {:6} {:6} {:>6}  {:>9} {:>9}  {:>9} {:>9}",
        "border", "levels", "where", "alone", "points", "largest", "mean", "without", "mean"
    );
    for ((of, kind), m) in table {
        println!(
            "{of:8} {:6} {:6} {:6} {:6}  {:9.1e} {:9.1e}  {:9.1e} {:9.1e}",
            kind.levels,
            ["face", "edge", "corner"][kind.axes - 1],
            if kind.is_alone && kind.axes > 1 { "alone" } else { "" },
            m.points,
            m.largest,
            m.jumps / m.changes,
            m.largest_without,
            m.jumps_without / m.changes_without
        );
    }
}

/// Points tested at borders `of` the data or the choice of levels, and the mean jump without the
/// rule.
fn tested(table: &Table, of: &str, levels: i32, axes: usize) -> (usize, f64) {
    let of_kind = |((name, kind), _): &(&(&'static str, Kind), &Measured)| {
        *name == of && kind.levels == levels && kind.axes == axes
    };
    let (mut points, mut jumps, mut changes) = (0, 0.0, 0.0);
    for (_, measured) in table.iter().filter(of_kind) {
        points += measured.points;
        jumps += measured.jumps_without;
        changes += measured.changes_without;
    }
    (points, jumps / changes)
}

fn assert_complete(table: &Table, points: usize) {
    for axes in 1..=3 {
        for (of, levels) in [("data", 1), ("data", 2), ("data", 3), ("choice", 1)] {
            let (found, without) = tested(table, of, levels, axes);
            assert!(found >= points, "{of}, {levels} levels, {axes} axes: {found} points");
            assert!(without > 1e-3, "{of}, {levels} levels, {axes} axes: no jump to remove");
        }
    }
    for axes in 2..=3 {
        let alone = |(key, _): &(&(&str, Kind), &Measured)| key.1.is_alone && key.1.axes == axes;
        assert!(table.iter().any(|entry| alone(&entry)), "no border is {axes} axes alone");
    }
}

#[test]
fn synthetic_sets_have_no_seams() {
    let mut all = Table::new();
    for (name, brick) in
        [("jumps", 8), ("jumps", 16), ("small", 8), ("small", 32), ("factor4", 8), ("deep25", 8)]
    {
        measure(&Set::synthetic(name), brick, &mut all);
    }
    println!("all");
    print_table(&all);
    assert_complete(&all, 100);
}

#[test]
fn real_sets_have_no_seams() {
    let mut all = Table::new();
    for (path, brick) in [
        ("enzo_small/DD0010/DD0010", 8),
        ("enzo_offdomain/DD0001/DD0001", 16),
        ("enzo_deep13/DD0010/DD0010", 8),
    ] {
        let Some(set) = Set::real(path) else { return };
        measure(&set, brick, &mut all);
    }
    println!("all");
    print_table(&all);
    for (of, levels) in [("data", 1), ("data", 2), ("choice", 1)] {
        for axes in 1..=3 {
            let (points, _) = tested(&all, of, levels, axes);
            assert!(points >= 20, "{of}, {levels} levels, {axes} axes: {points} points");
        }
    }
}

/// Writes the pictures of `docs/SEAMS.md`:
/// `cargo test --release --test seams -- --ignored pictures`.
#[test]
#[ignore = "writes docs/seams-with.png and docs/seams-without.png"]
fn pictures_with_and_without_the_rule() {
    let set = Set::synthetic("jumps");
    let cache = set.cache(8);
    let tree = Tree::new(&cache);
    let slice = Slice { centre: DVec3::new(0.395, 0.335, 0.7717), size: 0.11, bands: 20.0 };
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/docs"));
    let with = |p: &Position| tree.drawn(p, None, Scale::Log10);
    let without = |p: &Position| tree.unblended(p, Scale::Log10);
    let write = |name: &str, value: &dyn Fn(&Position) -> f64| {
        let film = slice.picture(&tree, 360, value);
        let file = AtomicFile::create(folder.join(name)).unwrap();
        write_png(file, &film, 0.0, [0.0; 3]).unwrap();
    };
    write("seams-with.png", &with);
    write("seams-without.png", &without);
}

#[test]
fn the_scene_of_a_point_has_its_eye_there() {
    let set = Set::synthetic("small");
    let cache = set.cache(8);
    let tree = Tree::new(&cache);
    let eye = deepest_point(&tree, &mut Random::new(3));
    let domain = &cache.header().domain;
    let scene = coarse_scene(&tree, &eye, 60.0);
    let parsed: &[Decimal; 3] = &scene.camera.position;
    let found = domain.position(parsed).unwrap();
    assert!(domain.difference(&found, &eye).abs().max_element() < 1e-12);
}
