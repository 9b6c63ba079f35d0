//! HDF5 by the C library, for files whose filters or types the pure-Rust reader does not know.
//! The library takes one lock for every call.

use std::collections::BTreeMap;
use std::path::Path;

use hdf5::types::{
    FixedAscii, FixedUnicode, FloatSize, TypeDescriptor, VarLenAscii, VarLenUnicode,
};
use hdf5::{Container, Group, H5Type, Hyperslab, LocationType, SliceOrIndex};

use super::{Backend, Dataset, Element, Members, Values};

/// Longest string of fixed length that is read.
const LONGEST_STRING: usize = 4096;

/// A table's names and texts; longer ones are cut.
type Name = FixedAscii<512>;

/// A row of a table of integers; the library converts members by name.
#[derive(Clone, hdf5::H5Type)]
#[repr(C)]
struct IntegerRow {
    name: Name,
    value: i64,
}

/// A row of a table of floating point numbers.
#[derive(Clone, hdf5::H5Type)]
#[repr(C)]
struct FloatRow {
    name: Name,
    value: f64,
}

/// A row of a table of strings.
#[derive(Clone, hdf5::H5Type)]
#[repr(C)]
struct TextRow {
    name: Name,
    value: Name,
}

/// A file open in the C library.
pub(super) struct Native {
    file: hdf5::File,
}

impl Backend for Native {
    fn open(path: &Path) -> Result<Self, String> {
        // Reasons come back as errors; the library would print them as well.
        hdf5::silence_errors(true);
        Ok(Self { file: hdf5::File::open(path).map_err(|e| reason(&e))? })
    }

    fn cached_bytes(&self) -> usize {
        // The library keeps decoded chunks with a dataset, and datasets are open while they are read.
        0
    }

    fn members(&self, group: &str) -> Result<Members, String> {
        let group = self.group(group)?;
        let mut members = Members::default();
        for name in group.member_names().map_err(|e| reason(&e))? {
            match group.loc_type_by_name(&name) {
                Ok(LocationType::Group) => members.groups.push(name),
                Ok(LocationType::Dataset) => members.datasets.push(name),
                // Types, and links that lead nowhere.
                _ => {}
            }
        }
        Ok(members)
    }

    fn attributes(&self, group: &str) -> Result<BTreeMap<String, Values>, String> {
        let group = self.group(group)?;
        let mut attributes = BTreeMap::new();
        for name in group.attr_names().map_err(|e| reason(&e))? {
            let attribute = group.attr(&name).map_err(|e| reason(&e))?;
            let values = match element(&attribute) {
                Element::Float => attribute.read_raw().ok().map(Values::Floats),
                Element::Integer => attribute.read_raw().ok().map(Values::Integers),
                Element::Text => strings(&attribute).ok().map(Values::Text),
                Element::Extended | Element::Other => None,
            };
            attributes.extend(values.map(|values| (name, values)));
        }
        Ok(attributes)
    }

    fn dataset(&self, path: &str) -> Result<Dataset, String> {
        let dataset = self.file.dataset(path).map_err(|e| reason(&e))?;
        let shape = dataset.shape().iter().map(|&n| n as u64).collect();
        Ok(Dataset { shape, element: element(&dataset) })
    }

    fn strings(&self, path: &str) -> Result<Vec<String>, String> {
        strings(&*self.file.dataset(path).map_err(|e| reason(&e))?)
    }

    fn named_values(&self, path: &str) -> Result<Vec<(String, Values)>, String> {
        let table = self.file.dataset(path).map_err(|e| reason(&e))?;
        let Ok(TypeDescriptor::Compound(row)) = table.dtype().and_then(|t| t.to_descriptor())
        else {
            return Err("is no table of names and values".into());
        };
        let Some(value) = row.fields.iter().find(|field| field.name == "value") else {
            return Err("its rows have no member `value`".into());
        };
        match value.ty {
            TypeDescriptor::Float(_) => rows(&table, |row: &FloatRow| {
                (row.name.as_str().to_owned(), Values::Floats(vec![row.value]))
            }),
            TypeDescriptor::Integer(_) | TypeDescriptor::Unsigned(_) => {
                rows(&table, |row: &IntegerRow| {
                    (row.name.as_str().to_owned(), Values::Integers(vec![row.value]))
                })
            }
            TypeDescriptor::FixedAscii(_) | TypeDescriptor::FixedUnicode(_) => {
                rows(&table, |row: &TextRow| {
                    let text = super::unpadded(row.value.as_str());
                    (row.name.as_str().to_owned(), Values::Text(vec![text]))
                })
            }
            _ => Err("its member `value` is neither a number nor a string".into()),
        }
    }

    fn read_f64(
        &self,
        path: &str,
        start: &[u64],
        count: &[u64],
        out: &mut [f64],
    ) -> Result<(), String> {
        let dataset = self.file.dataset(path).map_err(|e| reason(&e))?;
        match element(&dataset) {
            Element::Float | Element::Integer => read(&dataset, start, count, out),
            _ => Err("its elements are not numbers of a supported kind".into()),
        }
    }

    fn read_i64(
        &self,
        path: &str,
        start: &[u64],
        count: &[u64],
        out: &mut [i64],
    ) -> Result<(), String> {
        let dataset = self.file.dataset(path).map_err(|e| reason(&e))?;
        match element(&dataset) {
            Element::Integer => read(&dataset, start, count, out),
            _ => Err("its elements are not integers".into()),
        }
    }
}

impl Native {
    fn group(&self, path: &str) -> Result<Group, String> {
        self.file.group(path).map_err(|e| reason(&e))
    }
}

/// Reads a block; the library widens the elements.
fn read<T: H5Type + Copy>(
    dataset: &Container,
    start: &[u64],
    count: &[u64],
    out: &mut [T],
) -> Result<(), String> {
    let mut slices = Vec::with_capacity(count.len());
    for (&start, &count) in start.iter().zip(count) {
        let range = usize::try_from(start)
            .ok()
            .zip(usize::try_from(count).ok())
            .and_then(|(start, count)| Some(start..start.checked_add(count)?))
            .ok_or("the block is beyond this machine's memory")?;
        slices.push(SliceOrIndex::from(range));
    }
    let values = if slices.is_empty() {
        dataset.read_dyn::<T>()
    } else {
        dataset.read_slice(Hyperslab::from(slices))
    };
    let values = values.map_err(|e| reason(&e))?;
    if values.len() != out.len() {
        return Err(format!("{} values were read, {} expected", values.len(), out.len()));
    }
    for (to, from) in out.iter_mut().zip(values) {
        *to = from;
    }
    Ok(())
}

fn element(object: &Container) -> Element {
    match object.dtype().and_then(|datatype| datatype.to_descriptor()) {
        Ok(TypeDescriptor::Float(FloatSize::U2 | FloatSize::U4 | FloatSize::U8)) => Element::Float,
        Ok(TypeDescriptor::Integer(_) | TypeDescriptor::Unsigned(_)) => Element::Integer,
        Ok(
            TypeDescriptor::FixedAscii(_)
            | TypeDescriptor::FixedUnicode(_)
            | TypeDescriptor::VarLenAscii
            | TypeDescriptor::VarLenUnicode,
        ) => Element::Text,
        _ => Element::Other,
    }
}

fn strings(object: &Container) -> Result<Vec<String>, String> {
    let datatype =
        object.dtype().and_then(|datatype| datatype.to_descriptor()).map_err(|e| reason(&e))?;
    match datatype {
        TypeDescriptor::FixedAscii(n) | TypeDescriptor::FixedUnicode(n) if n > LONGEST_STRING => {
            Err(format!("its strings are longer than {LONGEST_STRING} bytes"))
        }
        TypeDescriptor::FixedAscii(_) => {
            texts(object, |text: &FixedAscii<LONGEST_STRING>| text.as_str())
        }
        TypeDescriptor::FixedUnicode(_) => {
            texts(object, |text: &FixedUnicode<LONGEST_STRING>| text.as_str())
        }
        TypeDescriptor::VarLenAscii => texts(object, VarLenAscii::as_str),
        TypeDescriptor::VarLenUnicode => texts(object, VarLenUnicode::as_str),
        _ => Err("its elements are not strings".into()),
    }
}

/// All rows of `table`, read as `T`.
fn rows<T: H5Type>(
    table: &Container,
    values: impl Fn(&T) -> (String, Values),
) -> Result<Vec<(String, Values)>, String> {
    let rows: Vec<T> = table.read_raw().map_err(|e| reason(&e))?;
    let unpad = |(name, value): (String, Values)| (super::unpadded(&name), value);
    Ok(rows.iter().map(|row| unpad(values(row))).collect())
}

/// All elements of `object`, read as `T`, without padding.
fn texts<T: H5Type>(
    object: &Container,
    as_str: impl Fn(&T) -> &str,
) -> Result<Vec<String>, String> {
    let raw: Vec<T> = object.read_raw().map_err(|e| reason(&e))?;
    Ok(raw.iter().map(|text| super::unpadded(as_str(text))).collect())
}

fn reason(error: &hdf5::Error) -> String {
    error.to_string()
}
