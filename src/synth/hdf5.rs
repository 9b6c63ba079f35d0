//! HDF5 files as the layouts need them.

use std::fs::File;
use std::path::Path;

use hdf5_pure::{
    Datatype, DatatypeByteOrder, FileBuilder, make_f32_type, make_f64_type, make_i32_type,
    make_i64_type,
};

use super::recipe::Precision;
use crate::{Error, Result};

/// The type of stored field values.
pub(super) fn stored_type(precision: Precision) -> Datatype {
    match precision {
        Precision::F32 => make_f32_type(),
        Precision::F64 => make_f64_type(),
    }
}

/// A dataset of big-endian 32-bit integers.
pub(super) fn add_big_endian_i32(builder: &mut FileBuilder, name: &str, values: &[i32]) {
    let bytes = values.iter().flat_map(|v| v.to_be_bytes()).collect();
    let datatype = big_endian(make_i32_type());
    builder.create_dataset(name).with_raw_data(datatype, bytes, values.len() as u64);
}

/// A dataset of rows of three big-endian 64-bit integers.
pub(super) fn add_big_endian_i64(builder: &mut FileBuilder, name: &str, rows: &[[i64; 3]]) {
    let bytes = rows.iter().flatten().flat_map(|v| v.to_be_bytes()).collect();
    let dataset = builder.create_dataset(name);
    let datatype = big_endian(make_i64_type());
    dataset
        .with_raw_data(datatype, bytes, 3 * rows.len() as u64)
        .with_shape(&[rows.len() as u64, 3]);
}

fn big_endian(mut datatype: Datatype) -> Datatype {
    if let Datatype::FixedPoint { byte_order, .. } = &mut datatype {
        *byte_order = DatatypeByteOrder::BigEndian;
    }
    datatype
}

/// What HDF5 cannot hold.
pub(super) fn cannot_write(error: &hdf5_pure::FormatError) -> Error {
    Error::request(format!("cannot write HDF5: {error}"))
}

/// Writes an HDF5 file; its size.
pub(super) fn save(builder: FileBuilder, path: &Path) -> Result<u64> {
    let failed = |e: hdf5_pure::Error| match e {
        hdf5_pure::Error::Io(e) => Error::io(path, "cannot write", e),
        other => Error::invalid(path.display(), format!("cannot write HDF5: {other}")),
    };
    let file = File::create(path).map_err(|e| Error::io(path, "cannot create", e))?;
    builder.finish_to(&file).map_err(failed)?;
    let size = std::fs::metadata(path).map(|metadata| metadata.len());
    size.map_err(|e| Error::io(path, "cannot read the size", e))
}
