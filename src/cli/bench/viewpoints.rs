//! Scenes for a cache whose user names none: from outside, and from within the deepest region.

use std::path::{Path, PathBuf};

use crate::atomic_file;
use crate::cache::{
    BrickEntry, BrickPlace, Cache, CachedField, Decoder, Precision, RawBrick, state,
};
use crate::{Error, Result};

/// From the deepest cell to the eye within, in such cells.
const EYE: [i128; 3] = [-11, 7, -13];
/// Cells across which what is seen from within becomes opaque, about.
const WITHIN: f64 = 32.0;

/// Writes `outside.toml` and `inside.toml` of the cache's first field to `folder`.
///
/// # Errors
/// A damaged cache, or a folder that takes no files.
pub(super) fn write(cache: &Cache, folder: &Path) -> Result<Vec<PathBuf>> {
    let header = cache.header();
    let (domain, field) = (&header.domain, &header.fields[0]);
    let (octree, cell) = deepest_cell(cache)?;
    let target = domain.decimals(&domain.cell_corner(octree + 1, cell.map(|c| 2 * c + 1)))?;
    let upper = domain.upper();
    let mut eye = domain.cell_corner(octree + 1, std::array::from_fn(|a| 2 * (cell[a] + EYE[a])));
    for (eye, upper) in eye.0.iter_mut().zip(upper.0) {
        *eye = (*eye).clamp(0, upper - 1);
    }
    let eye = domain.decimals(&eye)?;
    let size = domain.difference(&upper, &domain.cell_corner(0, [0; 3])).length();
    let away = [0.9, 0.7, -1.3].map(|away| away * size);
    let outside = std::array::from_fn(|a| {
        format!("{:e}", 0.5 * (domain.left()[a] + domain.right()[a]) + away[a])
    });
    let cell_size = domain.cell_width(octree).length();
    let scenes = [
        ("outside.toml", scene(field, &outside, &target, size)),
        ("inside.toml", scene(field, &eye, &target, WITHIN * cell_size)),
    ];
    let write = |(name, text): (&str, String)| {
        let path = folder.join(name);
        atomic_file::write(&path, &text)?;
        Ok(path)
    };
    scenes.into_iter().map(write).collect()
}

/// A scene in which what lies `length` away shows.
fn scene(field: &CachedField, eye: &[String; 3], target: &[String; 3], length: f64) -> String {
    let (scale, [low, high]) = match field.smallest_positive {
        Some(low) if low < field.max => ("log10", [low, field.max]),
        _ if field.min < field.max => ("linear", [field.min, field.max]),
        _ => ("linear", [0.0, 1.0]),
    };
    let quoted = |point: &[String; 3]| format!("{point:?}");
    let [low_absorption, middle, high_absorption] = [0.3, 10.0, 1000.0].map(|k| k / length);
    format!(
        "[image]\nwidth = 320\nheight = 180\n[camera]\nposition = {}\nlook_at = {}\nfov = 40.0\n\
         [render]\nsamples = 1\ntolerance = \"1%\"\n[[volume]]\nfield = {}\nscale = \"{scale}\"\n\
         range = [{low:e}, {high:e}]\ncolormap = \"inferno\"\nabsorption = [[0.0, \
         {low_absorption:e}], [0.3, {middle:e}], [1.0, {high_absorption:e}]]\n",
        quoted(eye),
        quoted(target),
        toml::Value::String(field.name.clone()),
    )
}

/// The octree level and index of a cell of a deepest brick, near that brick's centre.
fn deepest_cell(cache: &Cache) -> Result<(i32, [i128; 3])> {
    let header = cache.header();
    let mut cursor = cache.cursor();
    let root = header.levels.first().map_or(0, |level| level.octree);
    let (mut node, mut place) = (0, BrickPlace::root(-root));
    let record = loop {
        let record = cursor.node(node)?;
        let mut deepest: Option<(u8, u64, u8)> = None;
        for octant in 0..8 {
            let Some(child) = record.child(octant) else { continue };
            let depth = cursor.node(child)?.depth;
            if deepest.is_none_or(|(most, ..)| depth > most) {
                deepest = Some((depth, child, octant));
            }
        }
        let Some((_, child, octant)) = deepest else { break record };
        (node, place) = (child, place.child(octant));
    };
    let described = cursor.field(node, 0)?;
    let edge = header.shape.edge();
    let mut cell = [edge / 2; 3];
    if !described.is_void() {
        let mut decoder = Decoder::new()
            .map_err(|source| Error::io(cache.path(), "cannot set up decompression", source))?;
        let mut brick = RawBrick::default();
        let entry = BrickEntry { node, field: 0, node_record: &record, field_record: &described };
        cache.read_brick(&entry, Precision::Full, &mut decoder, &mut brick)?;
        cell = central_cell(&brick, edge).unwrap_or(cell);
    }
    let lowest = place.lowest_cell(header.shape);
    Ok((place.octree, std::array::from_fn(|a| lowest[a] + cell[a] as i128)))
}

/// The cell nearest to the brick's centre at which its level has data.
fn central_cell(brick: &RawBrick, edge: usize) -> Option<[usize; 3]> {
    let cells = (0..edge.pow(3)).map(|n| [n % edge, n / edge % edge, n / edge / edge]);
    let exists = |[x, y, z]: &[usize; 3]| {
        let block = brick.blocks.first();
        let states = block.and_then(|block| block.states.get(block.at(x + 1, y + 1, z + 1)));
        states.is_some_and(|bits| bits & state::EXISTS != 0)
    };
    let distance = |cell: &[usize; 3]| cell.iter().map(|c| c.abs_diff(edge / 2).pow(2)).sum();
    cells.filter(exists).min_by_key(|cell| -> usize { distance(cell) })
}
