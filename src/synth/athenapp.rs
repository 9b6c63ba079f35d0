//! Athena++'s `.athdf` layout: the leaf blocks of a tree in one HDF5 file.

use std::path::Path;

use hdf5_pure::{AttrValue, FileBuilder, LibVer};

use super::edges::cell_edge;
use super::grids::Grids;
use super::hdf5::{add_big_endian_i32, add_big_endian_i64, cannot_write, save, stored_type};
use super::output::{MARK, OutputFolder};
use super::recipe::Recipe;
use super::tree::{Block, BlockTree};
use super::{Layout, Summary};
use crate::{Error, Result};

/// How the layout is listed among the others.
pub(super) const LAYOUT: Layout = Layout { name: "athena++", write };

/// Code time of the output.
const TIME: f32 = 0.25;
/// Bytes of a name: 20 letters and their end.
const NAME_BYTES: u32 = 21;
/// What the code calls the recipes' fields, and the dataset that it puts them in.
const NAMES: [(&str, &str, &str); 5] = [
    ("Density", "prim", "rho"),
    ("x-velocity", "prim", "vel1"),
    ("y-velocity", "prim", "vel2"),
    ("z-velocity", "prim", "vel3"),
    ("Temperature", "user_out_var", "temp"),
];

fn write(recipe: &Recipe, directory: &Path, progress: &mut dyn FnMut(u64, u64)) -> Result<Summary> {
    let grids = Grids::new(recipe)?;
    let tree = BlockTree::new(recipe, &grids)?;
    let leaves: Vec<usize> =
        (0..tree.blocks.len()).filter(|&number| tree.blocks[number].is_leaf()).collect();
    let cells = (leaves.len() * tree.block_cells()) as u64;
    let marked = format!("athinput.{}", recipe.name);
    let folder = OutputFolder::create(directory, &recipe.name, &marked)?;
    let mut bytes = folder.write_text(&marked, &format!("{MARK}\n"))?;

    let mut builder = FileBuilder::new();
    builder.with_libver_bounds(LibVer::Earliest, LibVer::V18);
    set_mesh_attributes(&mut builder, recipe, &tree, &leaves)?;
    add_places(&mut builder, &tree, &leaves)?;
    add_faces(&mut builder, &grids, &tree, &leaves);
    let mut values = tree.values(recipe, &grids);
    values = leaves.iter().map(|&leaf| std::mem::take(&mut values[leaf])).collect();
    progress(cells, cells);
    add_variables(&mut builder, recipe, &tree, &values)?;
    let name = format!("{}.athdf", recipe.name);
    bytes += save(builder, &folder.file(&name))?;
    let levels = tree.blocks.iter().map(|block| block.level + 1).max().unwrap_or(0);
    let input = folder.finish()?.join(name);
    Ok(Summary { input, levels, grids: leaves.len() as u64, cells, bytes })
}

fn set_mesh_attributes(
    builder: &mut FileBuilder,
    recipe: &Recipe,
    tree: &BlockTree,
    leaves: &[usize],
) -> Result<()> {
    let deepest = leaves.iter().map(|&leaf| tree.blocks[leaf].level).max().unwrap_or(0);
    let sizes = |sizes: [u64; 3]| AttrValue::I32Array(sizes.map(|n| n as i32).to_vec());
    builder.set_attr("NumCycles", AttrValue::I32(0));
    builder.set_attr("Time", AttrValue::F32(TIME));
    builder.set_attr("Coordinates", text("cartesian")?);
    builder.set_attr("NumMeshBlocks", AttrValue::I32(leaves.len() as i32));
    builder.set_attr("MeshBlockSize", sizes(tree.size.map(u64::from)));
    builder.set_attr("MaxLevel", AttrValue::I32(deepest as i32));
    builder.set_attr("RootGridSize", sizes(recipe.domain.root));
    for (axis, name) in ["RootGridX1", "RootGridX2", "RootGridX3"].into_iter().enumerate() {
        let (left, right) = (recipe.domain.left[axis] as f32, recipe.domain.right[axis] as f32);
        builder.set_attr(name, AttrValue::F32Array(vec![left, right, 1.0]));
    }
    Ok(())
}

fn text(value: &str) -> Result<AttrValue> {
    AttrValue::ascii_string_sized(value, NAME_BYTES).map_err(|e| cannot_write(&e))
}

fn texts(values: Vec<&str>) -> Result<AttrValue> {
    let values = values.into_iter().map(str::to_owned).collect();
    AttrValue::ascii_string_array_sized(values, NAME_BYTES).map_err(|e| cannot_write(&e))
}

/// Levels and logical locations.
fn add_places(builder: &mut FileBuilder, tree: &BlockTree, leaves: &[usize]) -> Result<()> {
    let blocks = || leaves.iter().map(|&leaf| &tree.blocks[leaf]);
    let levels: Vec<i32> = blocks().map(|block| block.level as i32).collect();
    let location = |block: &Block| match block.at.map(i64::try_from) {
        [Ok(x), Ok(y), Ok(z)] => Ok([x, y, z]),
        _ => Err(Error::request(format!(
            "refinement: block locations of level {} exceed 64 bits: refine less",
            block.level
        ))),
    };
    let locations = blocks().map(location).collect::<Result<Vec<_>>>()?;
    add_big_endian_i32(builder, "Levels", &levels);
    add_big_endian_i64(builder, "LogicalLocations", &locations);
    Ok(())
}

/// Faces and centres of the blocks' cells: too coarse for what lies deep, as in real outputs.
fn add_faces(builder: &mut FileBuilder, grids: &Grids, tree: &BlockTree, leaves: &[usize]) {
    for axis in 0..3 {
        let size = tree.size[axis];
        let (mut faces, mut centres) = (Vec::new(), Vec::new());
        for &leaf in leaves {
            let block = &tree.blocks[leaf];
            let first = tree.cells(block).lo[axis];
            let octree = grids.octree(block.level);
            let face = |n: u32| cell_edge(grids.domain(), octree, axis, first + i128::from(n));
            faces.extend((0..=size).map(|n| face(n) as f32));
            centres.extend((0..size).map(|n| (0.5 * (face(n) + face(n + 1))) as f32));
        }
        let blocks = leaves.len() as u64;
        for (kind, values, per_block) in [("f", faces, size + 1), ("v", centres, size)] {
            let dataset = builder.create_dataset(&format!("x{}{kind}", axis + 1));
            dataset.with_f32_data(&values).with_shape(&[blocks, per_block.into()]);
        }
    }
}

/// The datasets of variables, and the attributes that name them.
fn add_variables(
    builder: &mut FileBuilder,
    recipe: &Recipe,
    tree: &BlockTree,
    values: &[Vec<Vec<f64>>],
) -> Result<()> {
    let precision = recipe.output.precision;
    let (mut datasets, mut counts, mut names) = (Vec::new(), Vec::new(), Vec::new());
    for dataset in ["prim", "user_out_var"] {
        let of_dataset = |(number, field): (usize, &String)| {
            let known = NAMES.iter().find(|(known, ..)| known == field)?;
            (known.1 == dataset).then_some((number, known.2))
        };
        let fields: Vec<_> =
            recipe.output.fields.iter().enumerate().filter_map(of_dataset).collect();
        if fields.is_empty() {
            continue;
        }
        let blocks = fields.iter().flat_map(|&(number, _)| values.iter().map(move |b| &b[number]));
        let bytes: Vec<u8> = blocks.flat_map(|block| precision.stored(block)).collect();
        let [x, y, z] = tree.size.map(u64::from);
        let shape = [fields.len() as u64, values.len() as u64, z, y, x];
        let data = builder.create_dataset(dataset);
        data.with_raw_data(stored_type(precision), bytes, shape.iter().product());
        data.with_shape(&shape);
        datasets.push(dataset);
        counts.push(fields.len() as i32);
        names.extend(fields.iter().map(|&(_, name)| name));
    }
    builder.set_attr("DatasetNames", texts(datasets)?);
    builder.set_attr("NumVariables", AttrValue::I32Array(counts));
    builder.set_attr("VariableNames", texts(names)?);
    Ok(())
}
