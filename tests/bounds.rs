//! The index's ranges and residuals enclose the interpolant.

// Helpers fail the tests that call them.
#![allow(clippy::unwrap_used)]

mod bricks;
#[path = "support/data.rs"]
mod data;
#[path = "support/random.rs"]
mod random;

use bricks::sets::Set;
use bricks::{Node, Scale, Tree};
use deepfield::render::interpolant::DrawnNeighbours;
use deepfield::space::Position;
use random::Random;

/// What the bounds were found to be.
#[derive(Default)]
struct Tightness {
    points: usize,
    /// Largest |own − finest| / residual.
    residual: f64,
    /// Largest part of a range that is taken.
    range: f64,
}

/// A random point of the domain in the brick's box, half of them where it is refined further.
fn point_of(tree: &Tree<'_>, node: &Node, random: &mut Random) -> Option<Position> {
    let mut node = node;
    while node.record.child_mask != 0 && random.below(2) == 0 {
        let child = random.below(node.record.child_mask.count_ones() as usize) as u64;
        node = &tree.nodes[(node.record.first_child + child) as usize];
    }
    let bits = (96 - node.place.octree) as u32;
    let lowest = node.place.lowest_cell(tree.cache.header().shape);
    let brick = tree.edge() << bits;
    let point = Position(lowest.map(|c| (c << bits) + random.whole(brick)));
    tree.cache.header().domain.contains(&point).then_some(point)
}

fn check_bounds(tree: &Tree<'_>, node: &Node, random: &mut Random, seen: &mut Tightness) {
    for _ in 0..24 {
        let Some(point) = point_of(tree, node, random) else { continue };
        // Mapping to f32 and ghosts in f32 round each value by 2⁻²⁴ of itself.
        for (scale, residual, rounding) in [
            (Scale::Linear, f64::from(node.field.residual_linear), 1e-6),
            (Scale::Log10, f64::from(node.field.residual_log10), 1e-6),
        ] {
            let own = tree.own(node, &point, DrawnNeighbours::ALL, scale);
            let finest = tree.drawn(&point, None, scale);
            let faded = DrawnNeighbours(random.bits() as u32 | 1 << 13);
            let faded = tree.own(node, &point, faded, scale);
            let slack = rounding * own.abs().max(finest.abs());
            let range = |of: [f32; 2]| of.map(|end| tree.map(scale, end));
            let within = |value: f64, [low, high]: [f64; 2]| {
                low - 1e-12 * low.abs() <= value && value <= high + 1e-12 * high.abs()
            };
            let place = (node.place, point, scale);
            assert!(within(own, range(node.field.own)), "{place:?}: {own}, {:?}", node.field);
            assert!(within(faded, range(node.field.own)), "{place:?}: {faded}, {:?}", node.field);
            assert!(within(finest, range(node.field.tree)), "{place:?}: {finest} {:?}", node.field);
            let far = (own - finest).abs();
            assert!(far <= residual + slack, "{place:?}: {own}, {finest}, {:?}", node.field);
            seen.points += 1;
            if residual > 100.0 * slack && residual.is_finite() {
                seen.residual = seen.residual.max(far / residual);
            }
            let [low, high] = range(node.field.own);
            if high > low {
                seen.range = seen.range.max((own - low) / (high - low));
            }
        }
    }
}

fn bounds_enclose(set: &Set, brick: u32) {
    let cache = set.cache(brick);
    let tree = Tree::new(&cache);
    let mut random = Random::new(23);
    let mut seen = Tightness::default();
    let drawn = tree.nodes.iter().filter(|node| !node.field.is_void()).count();
    let part = (drawn / 400).max(1);
    for node in tree.nodes.iter().filter(|node| !node.field.is_void()) {
        if node.place.octree <= 0 || random.below(part) == 0 {
            check_bounds(&tree, node, &mut random, &mut seen);
        }
    }
    println!(
        "{} {brick}: {} points, up to {:.2} of the residual, {:.2} of the range",
        set.name, seen.points, seen.residual, seen.range
    );
    assert!(seen.points > 1000 && seen.range > 0.5, "{}", set.name);
    // Large bricks hold both the largest residual and much where there is none.
    assert!(brick > 8 || seen.residual > 0.1, "{}: a bound that says little", set.name);
}

#[test]
fn bounds_of_the_index_enclose_the_interpolant() {
    for (name, brick) in [
        ("small", 8),
        ("jumps", 8),
        ("jumps", 16),
        ("factor4", 8),
        ("offdomain", 32),
        ("deep25", 8),
    ] {
        bounds_enclose(&Set::synthetic(name), brick);
    }
}

#[test]
fn bounds_of_the_index_enclose_the_interpolant_of_real_sets() {
    for (path, brick) in [
        ("enzo_small/DD0010/DD0010", 8),
        ("enzo_offdomain/DD0001/DD0001", 8),
        ("enzo_deep13/DD0010/DD0010", 16),
        ("enzo_deep48/DD0011/DD0011", 8),
    ] {
        if let Some(set) = Set::real(path) {
            bounds_enclose(&set, brick);
        }
    }
}
