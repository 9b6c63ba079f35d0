//! FLASH's layout: the whole PARAMESH tree, parents included, in one HDF5 file. With 64-bit values
//! it is a checkpoint, with 32-bit ones a plot file, whose geometry is 32-bit as well.

mod blocks;
mod tables;

use std::path::Path;

use hdf5_pure::{FileBuilder, LibVer};

use super::grids::Grids;
use super::hdf5::{save, stored_type};
use super::output::{MARK, OutputFolder};
use super::recipe::{Precision, Recipe};
use super::tree::BlockTree;
use super::{Layout, Summary};
use crate::Result;

/// How the layout is listed among the others.
pub(super) const LAYOUT: Layout = Layout { name: "flash", write };

/// The text file beside the data.
const PARAMETERS: &str = "flash.par";
/// What the code calls the recipes' fields.
const NAMES: [(&str, &str); 5] = [
    ("Density", "dens"),
    ("Temperature", "temp"),
    ("x-velocity", "velx"),
    ("y-velocity", "vely"),
    ("z-velocity", "velz"),
];

fn write(recipe: &Recipe, directory: &Path, progress: &mut dyn FnMut(u64, u64)) -> Result<Summary> {
    let grids = Grids::new(recipe)?;
    let tree = BlockTree::new(recipe, &grids)?;
    let cells = (tree.blocks.len() * tree.block_cells()) as u64;
    let folder = OutputFolder::create(directory, &recipe.name, PARAMETERS)?;
    let mut bytes = folder.write_text(PARAMETERS, &format!("{MARK}\n"))?;

    let mut builder = FileBuilder::new();
    builder.with_libver_bounds(LibVer::Earliest, LibVer::V18);
    tables::add(&mut builder, recipe, &tree)?;
    blocks::add(&mut builder, recipe, &grids, &tree);
    let values = tree.values(recipe, &grids);
    progress(cells, cells);
    add_variables(&mut builder, recipe, &tree, &values)?;
    let kind = match recipe.output.precision {
        Precision::F32 => "plt_cnt",
        Precision::F64 => "chk",
    };
    let name = format!("{}_hdf5_{kind}_0000", recipe.name);
    bytes += save(builder, &folder.file(&name))?;
    let levels = tree.blocks.iter().map(|block| block.level + 1).max().unwrap_or(0);
    let input = folder.finish()?.join(name);
    Ok(Summary { input, levels, grids: tree.blocks.len() as u64, cells, bytes })
}

fn add_variables(
    builder: &mut FileBuilder,
    recipe: &Recipe,
    tree: &BlockTree,
    values: &[Vec<Vec<f64>>],
) -> Result<()> {
    let precision = recipe.output.precision;
    let [x, y, z] = tree.size.map(u64::from);
    let shape = [values.len() as u64, z, y, x];
    let mut names = Vec::new();
    for (number, field) in recipe.output.fields.iter().enumerate() {
        let name = NAMES.iter().find(|(known, _)| known == field).map_or("dens", |known| known.1);
        let bytes: Vec<u8> =
            values.iter().flat_map(|block| precision.stored(&block[number])).collect();
        let data = builder.create_dataset(name);
        data.with_raw_data(stored_type(precision), bytes, shape.iter().product());
        data.with_shape(&shape);
        names.push(name);
    }
    tables::add_names(builder, &names);
    Ok(())
}
