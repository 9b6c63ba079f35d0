//! HDF5 by the pure-Rust reader, with positional reads: nothing of the file is mapped.

use std::collections::BTreeMap;
use std::path::Path;

use hdf5_reader::{Attribute, Datatype, H5Type, Hdf5File, OpenOptions, SliceInfo, SliceInfoElem};

use super::{Backend, Dataset, Element, LIST_VALUES, Members, READ_VALUES, Values};

/// Bytes of decoded chunks kept for each open file.
const CHUNK_CACHE_BYTES: usize = 4 << 20;
/// Largest decoded chunk accepted.
const CHUNK_BYTES: usize = 64 << 20;
/// Largest object header accepted; real ones have a few kB.
const HEADER_BYTES: usize = 1 << 20;

/// A number that a file may hold.
trait Number: H5Type {
    const ELEMENT: Element;
    fn to_f64(self) -> f64;
    fn to_i64(self) -> i64;
}

macro_rules! number {
    ($($type:ident $element:ident $to_f64:expr, $to_i64:expr;)*) => {$(
        impl Number for $type {
            const ELEMENT: Element = Element::$element;
            fn to_f64(self) -> f64 {
                $to_f64(self)
            }
            fn to_i64(self) -> i64 {
                $to_i64(self)
            }
        }
    )*};
}

number! {
    f32 Float f64::from, |v| v as i64;
    f64 Float f64::from, |v| v as i64;
    i8 Integer f64::from, i64::from;
    u8 Integer f64::from, i64::from;
    i16 Integer f64::from, i64::from;
    u16 Integer f64::from, i64::from;
    i32 Integer f64::from, i64::from;
    u32 Integer f64::from, i64::from;
    i64 Integer |v| v as f64, i64::from;
    u64 Integer |v| v as f64, |v| i64::try_from(v).unwrap_or(i64::MAX);
}

/// Evaluates the first expression with `$type` standing for the [`Number`] that the datatype is,
/// or the second if it is none.
macro_rules! with_number {
    ($datatype:expr, $type:ident => $some:expr, else $none:expr) => {
        with_number!(@match $datatype, $type, $some, $none,
            FloatingPoint { size: 4 } f32, FloatingPoint { size: 8 } f64,
            FixedPoint { size: 1, signed: true } i8, FixedPoint { size: 1, signed: false } u8,
            FixedPoint { size: 2, signed: true } i16, FixedPoint { size: 2, signed: false } u16,
            FixedPoint { size: 4, signed: true } i32, FixedPoint { size: 4, signed: false } u32,
            FixedPoint { size: 8, signed: true } i64, FixedPoint { size: 8, signed: false } u64)
    };
    (@match $datatype:expr, $type:ident, $some:expr, $none:expr,
     $($class:ident { $($key:ident : $value:literal),* } $number:ident),*) => {
        match $datatype {
            $(Datatype::$class { $($key: $value,)* .. } => {
                type $type = $number;
                $some
            })*
            _ => $none,
        }
    };
}

/// A file open in the pure-Rust reader.
pub(super) struct Pure {
    file: Hdf5File,
}

impl Backend for Pure {
    fn open(path: &Path) -> Result<Self, String> {
        let options = OpenOptions::default()
            .with_chunk_cache_bytes(CHUNK_CACHE_BYTES)
            .with_max_chunk_bytes(CHUNK_BYTES)
            .with_max_read_bytes(READ_VALUES.max(LIST_VALUES) * size_of::<f64>())
            .with_max_object_header_bytes(HEADER_BYTES);
        Ok(Self { file: Hdf5File::open_with_options(path, options).map_err(|e| reason(&e))? })
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
        Ok(Dataset { shape: dataset.shape().to_vec(), element: element(dataset.dtype()) })
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

    fn read_f64(
        &self,
        path: &str,
        start: &[u64],
        count: &[u64],
        out: &mut [f64],
    ) -> Result<(), String> {
        let block = Block::new(&self.file, path, start, count)?;
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
        let block = Block::new(&self.file, path, start, count)?;
        if element(block.dataset.dtype()) != Element::Integer {
            return Err("its elements are not integers".into());
        }
        with_number!(block.dataset.dtype(), T => block.fill(out, T::to_i64), else Ok(()))
    }
}

/// A selection of one dataset.
struct Block {
    dataset: hdf5_reader::Dataset,
    selection: SliceInfo,
}

impl Block {
    fn new(file: &Hdf5File, path: &str, start: &[u64], count: &[u64]) -> Result<Self, String> {
        let selections = start
            .iter()
            .zip(count)
            .map(|(&start, &count)| SliceInfoElem::Slice { start, end: start + count, step: 1 })
            .collect();
        let dataset = file.dataset(path).map_err(|e| reason(&e))?;
        Ok(Self { dataset, selection: SliceInfo { selections } })
    }

    fn fill<T: H5Type + Copy, U>(
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

fn element(datatype: &Datatype) -> Element {
    with_number!(datatype, T => T::ELEMENT, else match datatype {
        Datatype::String { .. } => Element::Text,
        _ => Element::Other,
    })
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
