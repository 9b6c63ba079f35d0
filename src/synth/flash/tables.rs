//! Lists of scalars and runtime parameters: compounds of a name and a value, in either order.

use hdf5_pure::{
    CharacterSet, CompoundTypeBuilder, Datatype, FileBuilder, StringPadding, make_f64_type,
    make_i32_type,
};

use crate::Result;
use crate::synth::hdf5::cannot_write;
use crate::synth::recipe::{Precision, Recipe};
use crate::synth::tree::BlockTree;

/// Letters of a name or text.
const LETTERS: usize = 80;
/// Code time of the output.
const TIME: f64 = 0.25;
/// The version of the file format that is written.
const FORMAT_VERSION: i32 = 9;

/// Which member of a row stands first.
#[derive(Clone, Copy, PartialEq)]
enum First {
    Name,
    Value,
}

/// Adds all lists.
pub(super) fn add(builder: &mut FileBuilder, recipe: &Recipe, tree: &BlockTree) -> Result<()> {
    let deepest = tree.blocks.iter().map(|block| block.level).max().unwrap_or(0) as i32;
    let [nx, ny, nz] = tree.size.map(|n| n as i32);
    let [rx, ry, rz] = tree.roots.map(|n| n as i32);
    let (left, right) = (recipe.domain.left, recipe.domain.right);
    let scalars = [
        ("nxb", nx),
        ("nyb", ny),
        ("nzb", nz),
        ("dimensionality", 3),
        ("globalnumblocks", tree.blocks.len() as i32),
        ("splitnumblocks", 0),
    ];
    let parameters = [
        ("lrefine_max", deepest + 1),
        ("lrefine_min", 1),
        ("nblockx", rx),
        ("nblocky", ry),
        ("nblockz", rz),
    ];
    let edges = [
        ("xmin", left[0]),
        ("xmax", right[0]),
        ("ymin", left[1]),
        ("ymax", right[1]),
        ("zmin", left[2]),
        ("zmax", right[2]),
    ];
    let is_checkpoint = i32::from(recipe.output.precision == Precision::F64);
    let switches = [("double_precision", is_checkpoint), ("corners", 0)];
    add_integers(builder, "integer scalars", First::Name, &scalars)?;
    add_integers(builder, "integer runtime parameters", First::Name, &parameters)?;
    add_integers(builder, "logical scalars", First::Value, &switches)?;
    add_reals(builder, "real scalars", &[("time", TIME), ("dt", 1.0)])?;
    add_reals(builder, "real runtime parameters", &edges)?;
    add_texts(builder, "string scalars", &[("geometry", "cartesian")])?;
    let texts = [("geometry", "cartesian"), ("pc_unitsbase", "CGS"), ("unitsystem", "none")];
    add_texts(builder, "string runtime parameters", &texts)?;
    add_information(builder)
}

/// The names of the variables, four letters each.
pub(super) fn add_names(builder: &mut FileBuilder, names: &[&str]) {
    let letters = names.iter().flat_map(|name| padded(name, 4)).collect();
    let count = names.len() as u64;
    let list = builder.create_dataset("unknown names");
    list.with_raw_data(text_type(4), letters, count).with_shape(&[count, 1]);
}

fn add_integers(
    builder: &mut FileBuilder,
    name: &str,
    first: First,
    rows: &[(&str, i32)],
) -> Result<()> {
    let rows = rows.iter().map(|(name, value)| (*name, value.to_le_bytes().to_vec()));
    add_table(builder, name, first, make_i32_type(), rows)
}

fn add_reals(builder: &mut FileBuilder, name: &str, rows: &[(&str, f64)]) -> Result<()> {
    let rows = rows.iter().map(|(name, value)| (*name, value.to_le_bytes().to_vec()));
    add_table(builder, name, First::Name, make_f64_type(), rows)
}

fn add_texts(builder: &mut FileBuilder, name: &str, rows: &[(&str, &str)]) -> Result<()> {
    let rows = rows.iter().map(|(name, value)| (*name, padded(value, LETTERS)));
    add_table(builder, name, First::Value, text_type(LETTERS as u32), rows)
}

fn add_table<'r>(
    builder: &mut FileBuilder,
    table: &str,
    first: First,
    value_type: Datatype,
    rows: impl ExactSizeIterator<Item = (&'r str, Vec<u8>)>,
) -> Result<()> {
    let (name, value) = (("name", text_type(LETTERS as u32)), ("value", value_type));
    let members = if first == First::Name { [name, value] } else { [value, name] };
    let row_type = members
        .into_iter()
        .fold(CompoundTypeBuilder::new(), |row, (name, datatype)| row.field(name, datatype));
    let row_type = row_type.build().map_err(|e| cannot_write(&e))?;
    let count = rows.len() as u64;
    let row = |(name, value): (&str, Vec<u8>)| {
        let name = padded(name, LETTERS);
        if first == First::Name { [name, value].concat() } else { [value, name].concat() }
    };
    builder.create_dataset(table).with_compound_data(row_type, rows.flat_map(row).collect(), count);
    Ok(())
}

/// What wrote the file.
fn add_information(builder: &mut FileBuilder) -> Result<()> {
    let row_type = CompoundTypeBuilder::new()
        .i32_field("file format version")
        .field("setup call", text_type(400))
        .field("file creation time", text_type(80))
        .field("flash version", text_type(80))
        .build()
        .map_err(|e| cannot_write(&e))?;
    let parts = [
        FORMAT_VERSION.to_le_bytes().to_vec(),
        padded("deepfield synth", 400),
        padded("", 80),
        padded("FLASH 4", 80),
    ];
    builder.create_dataset("sim info").with_compound_data(row_type, parts.concat(), 1);
    Ok(())
}

fn text_type(letters: u32) -> Datatype {
    let (padding, charset) = (StringPadding::SpacePad, CharacterSet::Ascii);
    Datatype::String { size: letters, padding, charset }
}

fn padded(text: &str, letters: usize) -> Vec<u8> {
    let mut bytes = text.as_bytes().to_vec();
    bytes.resize(letters, b' ');
    bytes
}
