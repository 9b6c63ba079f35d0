//! HDF5 by the pure-Rust reader, with positional reads: nothing of the file is mapped.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

use hdf5_reader::{
    Attribute, CompoundField, Datatype, H5Type, Hdf5File, OpenOptions, SliceInfo, SliceInfoElem,
    StringSize,
};

use super::extended::Extended;
use super::pure_number::{self, Half, Number, element, with_number};
use super::{Backend, Dataset, Element, LIST_VALUES, Members, READ_VALUES, Values};

/// Decoded chunks kept for each open file: how many, and bytes of all.
const CACHED_CHUNKS: usize = 512;
const CHUNK_CACHE_BYTES: usize = 4 << 20;
/// How many where a block lies in more than half as many, or as large ones. (The library takes memory for
/// so many at once.)
const MORE_CHUNKS: usize = 16 * CACHED_CHUNKS;
/// Largest decoded chunk accepted.
const CHUNK_BYTES: usize = 64 << 20;
/// Largest object header accepted; real ones have a few kB.
const HEADER_BYTES: usize = 1 << 20;

/// A file open in the pure-Rust reader.
pub(super) struct Pure {
    path: PathBuf,
    file: Hdf5File,
    /// The same file with room for more decoded chunks, opened once it is needed: a whole dataset
    /// may be one chunk.
    roomy: OnceLock<Hdf5File>,
    /// Whether chunks have been read.
    has_chunks: AtomicBool,
}

impl Pure {
    fn opened(path: &Path, chunks: usize, bytes: usize) -> Result<Hdf5File, String> {
        let options = OpenOptions::default()
            .with_chunk_cache_slots(chunks)
            .with_chunk_cache_bytes(bytes)
            .with_max_chunk_bytes(CHUNK_BYTES)
            .with_max_read_bytes(READ_VALUES.max(LIST_VALUES) * size_of::<f64>())
            .with_max_object_header_bytes(HEADER_BYTES);
        Hdf5File::open_with_options(path, options).map_err(|e| reason(&e))
    }

    /// A dataset of which a block is read, in a file that keeps the decoded chunks in which it lies: others
    /// beside it lie in them as well.
    fn dataset_of_block(
        &self,
        path: &str,
        start: &[u64],
        count: &[u64],
    ) -> Result<hdf5_reader::Dataset, String> {
        let dataset = self.file.dataset(path).map_err(|e| reason(&e))?;
        let Some(chunk) = dataset.chunks() else { return Ok(dataset) };
        self.has_chunks.store(true, Ordering::Relaxed);
        let mut bytes = dataset.raw_element_size().map_err(|e| reason(&e))?;
        let mut chunks = 1_u64;
        for ((&edge, &start), &count) in chunk.iter().zip(start).zip(count) {
            bytes = bytes.saturating_mul(edge as usize);
            let edge = u64::from(edge.max(1));
            chunks = chunks.saturating_mul((start + count).div_ceil(edge) - start / edge);
        }
        let chunks = usize::try_from(chunks).unwrap_or(usize::MAX);
        let is_roomy =
            chunks <= CACHED_CHUNKS / 2 && chunks.saturating_mul(bytes) <= CHUNK_CACHE_BYTES / 2;
        if is_roomy {
            return Ok(dataset);
        }
        let roomy = match self.roomy.get() {
            Some(file) => file,
            None => {
                let file = Self::opened(&self.path, MORE_CHUNKS, CHUNK_BYTES)?;
                self.roomy.get_or_init(|| file)
            }
        };
        roomy.dataset(path).map_err(|e| reason(&e))
    }
}

impl Backend for Pure {
    fn open(path: &Path) -> Result<Self, String> {
        let file = Self::opened(path, CACHED_CHUNKS, CHUNK_CACHE_BYTES)?;
        check_end(path, &file)?;
        let (path, roomy) = (path.to_path_buf(), OnceLock::new());
        Ok(Self { path, file, roomy, has_chunks: AtomicBool::new(false) })
    }

    fn cached_bytes(&self) -> usize {
        let has_chunks = self.has_chunks.load(Ordering::Relaxed);
        let chunks = if has_chunks { CHUNK_CACHE_BYTES } else { 0 };
        chunks + if self.roomy.get().is_some() { CHUNK_BYTES } else { 0 }
    }

    fn members(&self, group: &str) -> Result<Members, String> {
        let group = self.file.group(group).map_err(|e| reason(&e))?;
        let (groups, datasets) = group.member_names().map_err(|e| reason(&e))?;
        Ok(Members { groups, datasets })
    }

    fn attributes(&self, group: &str) -> Result<BTreeMap<String, Values>, String> {
        let group = self.file.group(group).map_err(|e| reason(&e))?;
        let attributes = group.attributes().map_err(|e| reason(&e))?;
        Ok(attributes
            .iter()
            .filter_map(|attribute| Some((attribute.name.clone(), attribute_values(attribute)?)))
            .collect())
    }

    fn dataset(&self, path: &str) -> Result<Dataset, String> {
        let dataset = self.file.dataset(path).map_err(|e| reason(&e))?;
        let element = match element(dataset.dtype()) {
            Element::Float | Element::Integer if !has_plain_bits(&dataset)? => Element::Other,
            Element::Other if extended(&dataset)?.is_some() => Element::Extended,
            element => element,
        };
        Ok(Dataset { shape: dataset.shape().to_vec(), element })
    }

    fn strings(&self, path: &str) -> Result<Vec<String>, String> {
        let strings = self
            .file
            .dataset(path)
            .map_err(|e| reason(&e))?
            .read_strings()
            .map_err(|e| reason(&e))?;
        Ok(strings.iter().map(|text| super::unpadded(text)).collect())
    }

    fn extended(&self, path: &str) -> Result<Vec<[f64; 2]>, String> {
        let dataset = self.file.dataset(path).map_err(|e| reason(&e))?;
        let kind = extended(&dataset)?.ok_or("its elements are not numbers of 80 or 128 bits")?;
        Ok(kind.sums(&dataset.read_raw_bytes().map_err(|e| reason(&e))?))
    }

    fn named_values(&self, path: &str) -> Result<Vec<(String, Values)>, String> {
        let dataset = self.file.dataset(path).map_err(|e| reason(&e))?;
        let Datatype::Compound { size, fields } = dataset.dtype() else {
            return Err("is no table of names and values".into());
        };
        let member = |name: &str| {
            let found = fields.iter().find(|field| field.name == name);
            found.ok_or_else(|| format!("its rows have no member `{name}`"))
        };
        let (name, value) = (member("name")?, member("value")?);
        let bytes = dataset.read_raw_bytes().map_err(|e| reason(&e))?;
        let rows = bytes.chunks_exact((*size as usize).max(1));
        rows.map(|row| Ok((text_member(row, name)?, value_member(row, value)?))).collect()
    }

    fn read_f64(
        &self,
        path: &str,
        start: &[u64],
        count: &[u64],
        out: &mut [f64],
    ) -> Result<(), String> {
        let block = Block::new(self, path, start, count)?;
        with_number!(block.dataset.dtype(), T => block.fill(out, T::to_f64), else {
            Err("its elements are not numbers of a supported kind".into())
        })
    }

    fn read_i64(
        &self,
        path: &str,
        start: &[u64],
        count: &[u64],
        out: &mut [i64],
    ) -> Result<(), String> {
        let block = Block::new(self, path, start, count)?;
        if element(block.dataset.dtype()) != Element::Integer {
            return Err("its elements are not integers".into());
        }
        with_number!(block.dataset.dtype(), T => block.fill(out, T::to_i64), else Ok(()))
    }
}

/// Refuses a file that ends before its superblock says, as the C library does: what is missing
/// may be data that nobody asks for at first.
fn check_end(path: &Path, file: &Hdf5File) -> Result<(), String> {
    let stated = file.superblock().eof_address;
    let bytes = std::fs::metadata(path).map_err(|e| e.to_string())?.len();
    // All ones: unknown.
    if stated <= bytes || stated == u64::MAX || stated == u64::from(u32::MAX) {
        return Ok(());
    }
    Err(format!("is truncated: {bytes} of {stated} bytes are there"))
}

/// A selection of one dataset.
struct Block {
    dataset: hdf5_reader::Dataset,
    selection: SliceInfo,
}

impl Block {
    fn new(file: &Pure, path: &str, start: &[u64], count: &[u64]) -> Result<Self, String> {
        let selections = start
            .iter()
            .zip(count)
            .map(|(&start, &count)| SliceInfoElem::Slice { start, end: start + count, step: 1 })
            .collect();
        let dataset = file.dataset_of_block(path, start, count)?;
        Ok(Self { dataset, selection: SliceInfo { selections } })
    }

    fn fill<T: Number + Copy, U>(
        &self,
        out: &mut [U],
        widen: impl Fn(T) -> U,
    ) -> Result<(), String> {
        let values = if self.selection.selections.is_empty() {
            self.dataset.read_array::<T>()
        } else {
            self.dataset.read_slice::<T>(&self.selection)
        };
        let values = values.map_err(|e| reason(&e))?;
        if values.len() != out.len() {
            return Err(format!("{} values were read, {} expected", values.len(), out.len()));
        }
        // Walking an array of any rank by its own iterator takes ten times as long.
        let Some(values) = values.as_slice() else {
            return Err("the values are not in the order of the file".into());
        };
        for (to, &from) in out.iter_mut().zip(values) {
            *to = widen(from);
        }
        Ok(())
    }
}

/// Whether a dataset's numbers are IEEE floats, or integers that fill their bytes: the library takes them
/// for such, whatever the file says of their bits.
fn has_plain_bits(dataset: &hdf5_reader::Dataset) -> Result<bool, String> {
    let datatype = dataset.raw_datatype().map_err(|e| reason(&e))?;
    Ok(pure_number::has_plain_bits(&datatype))
}

/// How a dataset's numbers are read if they are floats of more than 64 bits.
fn extended(dataset: &hdf5_reader::Dataset) -> Result<Option<Extended>, String> {
    if !matches!(dataset.dtype(), Datatype::FloatingPoint { .. }) {
        return Ok(None);
    }
    let datatype = dataset.raw_datatype().map_err(|e| reason(&e))?;
    Ok(Extended::of(&datatype))
}

/// A string member of a table's row.
fn text_member(row: &[u8], member: &CompoundField) -> Result<String, String> {
    let Datatype::String { size: StringSize::Fixed(length), .. } = member.datatype else {
        return Err(format!("its member `{}` is no string of fixed length", member.name));
    };
    Ok(super::unpadded(&String::from_utf8_lossy(member_bytes(row, member, length as usize)?)))
}

/// A member of a table's row as a list of one.
fn value_member(row: &[u8], member: &CompoundField) -> Result<Values, String> {
    with_number!(&member.datatype, T => {
        let bytes = member_bytes(row, member, T::element_size(&member.datatype))?;
        let number = T::from_bytes(bytes, &member.datatype).map_err(|e| reason(&e))?;
        Ok(match T::ELEMENT {
            Element::Float => Values::Floats(vec![number.to_f64()]),
            _ => Values::Integers(vec![number.to_i64()]),
        })
    }, else text_member(row, member).map(|text| Values::Text(vec![text])))
}

fn member_bytes<'r>(
    row: &'r [u8],
    member: &CompoundField,
    length: usize,
) -> Result<&'r [u8], String> {
    let start = member.byte_offset as usize;
    let end = start.checked_add(length);
    let inside = end.and_then(|end| row.get(start..end));
    inside.ok_or_else(|| format!("its member `{}` lies outside the row", member.name))
}

fn attribute_values(attribute: &Attribute) -> Option<Values> {
    with_number!(&attribute.datatype, T => {
        let numbers = attribute.read_1d::<T>().ok()?.into_iter();
        Some(match T::ELEMENT {
            Element::Float => Values::Floats(numbers.map(T::to_f64).collect()),
            _ => Values::Integers(numbers.map(T::to_i64).collect()),
        })
    }, else {
        let strings = attribute.read_strings().ok()?;
        Some(Values::Text(strings.iter().map(|text| super::unpadded(text)).collect()))
    })
}

fn reason(error: &hdf5_reader::error::Error) -> String {
    let text = error.to_string();
    if text.contains("unsupported") {
        return format!("{text} (a build with `--features libhdf5` may read it)");
    }
    text
}
