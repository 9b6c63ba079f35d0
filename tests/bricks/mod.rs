//! Bricks looked at one by one, through the library: what the tests of the interpolant share.

// Each test program uses only a part of it.
#![allow(dead_code)]

pub(crate) mod borders;
pub(crate) mod sets;
pub(crate) mod slice;
pub(crate) mod unblended;

use std::cell::RefCell;
use std::collections::HashMap;
use std::rc::Rc;

use deepfield::cache::{
    BrickEntry, BrickPlace, Cache, Decoder, FieldRecord, NodeRecord, Precision, RawBrick, state,
};
use deepfield::render::cut::FootprintCut;
use deepfield::render::interpolant::DrawnNeighbours;
use deepfield::render::scaled::{ScaledBrick, one_by_one};
use deepfield::scene::Interpolation;
use deepfield::space::{FRACTION_BITS, Position};
use glam::DVec3;

/// Bricks kept decoded at a time.
const KEPT: usize = 2000;

/// The scale in which values are interpolated, over stored values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Scale {
    Linear,
    Log10,
}

/// A brick as the index describes it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Node {
    pub(crate) index: u64,
    pub(crate) place: BrickPlace,
    pub(crate) record: NodeRecord,
    pub(crate) field: FieldRecord,
}

/// All bricks of a cache's first field.
pub(crate) struct Tree<'c> {
    pub(crate) cache: &'c Cache,
    /// By the brick's index in the cache.
    pub(crate) nodes: Vec<Node>,
    decoder: RefCell<Decoder>,
    raw: RefCell<HashMap<u64, Rc<RawBrick>>>,
    scaled: RefCell<HashMap<(u64, Scale), Rc<ScaledBrick>>>,
    unblended: RefCell<HashMap<(u64, Scale), Rc<ScaledBrick>>>,
}

impl<'c> Tree<'c> {
    pub(crate) fn new(cache: &'c Cache) -> Self {
        let header = cache.header();
        let mut cursor = cache.cursor();
        let mut nodes: Vec<Option<Node>> = vec![None; header.nodes() as usize];
        let mut waiting = vec![(0, BrickPlace::root(-header.levels[0].octree))];
        while let Some((index, place)) = waiting.pop() {
            let record = cursor.node(index).unwrap();
            let field = cursor.field(index, 0).unwrap();
            nodes[index as usize] = Some(Node { index, place, record, field });
            let children = (0..8).filter_map(|o| Some((record.child(o)?, place.child(o))));
            waiting.extend(children);
        }
        Self {
            cache,
            nodes: nodes.into_iter().map(Option::unwrap).collect(),
            decoder: RefCell::new(Decoder::new().unwrap()),
            raw: RefCell::default(),
            scaled: RefCell::default(),
            unblended: RefCell::default(),
        }
    }

    pub(crate) fn edge(&self) -> i128 {
        self.cache.header().shape.edge() as i128
    }

    /// Stored value to what is interpolated.
    pub(crate) fn map(&self, scale: Scale, stored: f32) -> f64 {
        match scale {
            Scale::Linear => f64::from(stored),
            Scale::Log10 => {
                let field = &self.cache.header().fields[0];
                let floor = field.smallest_positive.unwrap_or(1.0);
                field.value(stored).max(floor).log10()
            }
        }
    }

    pub(crate) fn raw(&self, node: &Node) -> Rc<RawBrick> {
        if let Some(raw) = self.raw.borrow().get(&node.index) {
            return Rc::clone(raw);
        }
        let mut raw = RawBrick::default();
        let (node_record, field_record) = (&node.record, &node.field);
        let entry = BrickEntry { node: node.index, field: 0, node_record, field_record };
        let mut decoder = self.decoder.borrow_mut();
        self.cache.read_brick(&entry, Precision::Full, &mut decoder, &mut raw).unwrap();
        Rc::clone(keep(&mut self.raw.borrow_mut(), node.index, raw))
    }

    pub(crate) fn scaled(&self, node: &Node, scale: Scale) -> Rc<ScaledBrick> {
        if let Some(scaled) = self.scaled.borrow().get(&(node.index, scale)) {
            return Rc::clone(scaled);
        }
        let (raw, header) = (self.raw(node), self.cache.header());
        let map = one_by_one(|stored| self.map(scale, stored));
        let mut scaled = ScaledBrick::new();
        scaled.prepare(&raw, &node.place, header.shape, map, Interpolation::Linear).unwrap();
        Rc::clone(keep(&mut self.scaled.borrow_mut(), (node.index, scale), scaled))
    }

    /// `position` in the brick's cells from its lowest corner.
    pub(crate) fn local(&self, place: &BrickPlace, position: &Position) -> DVec3 {
        let lowest = place.lowest_cell(self.cache.header().shape);
        let corner = self.cache.header().domain.cell_corner(place.octree, lowest);
        let cells_per_unit = f64::from(place.octree - FRACTION_BITS as i32).exp2();
        let along = |a: usize| (position.0[a] - corner.0[a]) as f64 * cells_per_unit;
        DVec3::from_array(std::array::from_fn(along))
    }

    /// The bricks that hold `position`, from the root to the one that is drawn: the finest, or
    /// the first that `cut` does not open.
    pub(crate) fn path(&self, position: &Position, cut: Option<&FootprintCut>) -> Vec<&Node> {
        let mut path = vec![&self.nodes[0]];
        loop {
            let node = path[path.len() - 1];
            let cell = self.cell(node, position);
            let upper = |a: usize| cell[a] - node.place.coordinates[a] * self.edge();
            let octant = (0..3).fold(0, |o, a| o | u8::from(upper(a) >= self.edge() / 2) << a);
            match node.record.child(octant) {
                Some(child) if cut.is_none_or(|cut| cut.opens(&node.place)) => {
                    path.push(&self.nodes[child as usize]);
                }
                _ => return path,
            }
        }
    }

    /// The level's cell that holds `position`.
    pub(crate) fn cell(&self, node: &Node, position: &Position) -> [i128; 3] {
        self.cache.header().domain.cell_of(node.place.octree, position)
    }

    /// State of the brick's own cell that holds `position`.
    fn state(&self, node: &Node, position: &Position) -> u8 {
        let raw = self.raw(node);
        let cell = self.cell(node, position);
        let lowest = node.place.lowest_cell(self.cache.header().shape);
        let [x, y, z] = std::array::from_fn(|a| (cell[a] - lowest[a] + 1) as usize);
        raw.blocks[0].states[raw.blocks[0].at(x, y, z)]
    }

    /// The deepest brick of `path` whose level has data at `position`.
    pub(crate) fn owner<'n>(&self, path: &[&'n Node], position: &Position) -> &'n Node {
        let exists = |node: &&&Node| self.state(node, position) & state::EXISTS != 0;
        path.iter().rev().find(exists).unwrap()
    }

    /// What is drawn at `position`.
    pub(crate) fn drawn(
        &self,
        position: &Position,
        cut: Option<&FootprintCut>,
        scale: Scale,
    ) -> f64 {
        let path = self.path(position, cut);
        let node = path[path.len() - 1];
        let drawn = cut.map_or(DrawnNeighbours::ALL, |cut| cut.drawn_neighbours(&node.place));
        self.own(node, position, drawn, scale)
    }

    /// The interpolant of one brick.
    pub(crate) fn own(
        &self,
        node: &Node,
        position: &Position,
        drawn: DrawnNeighbours,
        scale: Scale,
    ) -> f64 {
        self.scaled(node, scale).value_at(self.local(&node.place, position), drawn)
    }
}

fn keep<K: std::hash::Hash + Eq + Copy, T>(
    kept: &mut HashMap<K, Rc<T>>,
    key: K,
    made: T,
) -> &Rc<T> {
    if kept.len() >= KEPT {
        kept.clear();
    }
    kept.entry(key).or_insert_with(|| Rc::new(made))
}
