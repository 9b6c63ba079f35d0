//! Which variables an output has, and where they lie.

use std::collections::BTreeMap;
use std::path::Path;

use super::attributes::Attributes;
use crate::source::SourceField;
use crate::source::hdf5::{Element, File};
use crate::source::names::tell_apart;
use crate::{Error, Result};

/// Names of the density, the likeliest first: of primitive and of conserved variables.
pub(super) const DENSITIES: [&str; 3] = ["rho", "dens", "density"];

/// One variable.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Variable {
    /// The name that the file gives it; where two variables have it, after its dataset's name and a
    /// point, and where two of one dataset have it, before a point and its place among all.
    pub(super) name: String,
    /// Path of the dataset.
    pub(super) dataset: String,
    /// Its number in the dataset.
    pub(super) number: u64,
}

impl Variable {
    /// The field that it is; Athena++ states no units.
    pub(super) fn describe(&self) -> SourceField {
        SourceField { name: self.name.clone(), units: None, to_cgs: None }
    }
}

/// The variables of all datasets, in the file's order.
///
/// # Errors
/// Lists of names and numbers that do not fit each other, and datasets that do not fit them.
pub(super) fn variables(
    file: &File,
    path: &Path,
    attributes: &Attributes<'_>,
    blocks: u64,
) -> Result<Vec<Variable>> {
    let (datasets, counts) =
        (attributes.texts("DatasetNames")?, attributes.counts("NumVariables")?);
    let names = attributes.texts("VariableNames")?;
    let total = counts.iter().try_fold(0usize, |sum, &n| sum.checked_add(n));
    if datasets.len() != counts.len() || total != Some(names.len()) || names.is_empty() {
        let reason = format!(
            "{} DatasetNames, {} NumVariables and {} VariableNames do not fit each other",
            datasets.len(),
            counts.len(),
            names.len()
        );
        return Err(Error::invalid(path.display(), reason));
    }
    let mut uses = BTreeMap::new();
    names.iter().for_each(|name| *uses.entry(name).or_insert(0) += 1);
    let mut left = names;
    let mut variables = Vec::with_capacity(names.len());
    for (dataset, count) in datasets.iter().zip(counts) {
        check_shape(file, path, attributes, dataset, [count as u64, blocks])?;
        let (own, rest) = left.split_at(count);
        for (number, name) in (0..).zip(own) {
            let is_double = uses.get(name).is_some_and(|&uses| uses > 1);
            let name = if is_double { format!("{dataset}.{name}") } else { name.clone() };
            variables.push(Variable { name, dataset: format!("/{dataset}"), number });
        }
        left = rest;
    }
    // Athena++ cuts names to 20 characters.
    let mut names: Vec<String> = variables.iter().map(|variable| variable.name.clone()).collect();
    tell_apart(&mut names);
    variables.iter_mut().zip(names).for_each(|(variable, name)| variable.name = name);
    Ok(variables)
}

/// Refuses a dataset that is not numbers of all `[variables, blocks]`, in blocks of the size
/// stated.
fn check_shape(
    file: &File,
    path: &Path,
    attributes: &Attributes<'_>,
    name: &str,
    [variables, blocks]: [u64; 2],
) -> Result<()> {
    let dataset = file.dataset(&format!("/{name}"))?;
    let place = format!("{}: /{name}", path.display());
    if !matches!(dataset.element, Element::Float | Element::Integer) {
        return Err(Error::not_supported(place, "its elements are not numbers of a known kind"));
    }
    let [x, y, z] = attributes.stored_block_size()?.map(u64::from);
    let stated = [variables, blocks, z, y, x];
    if dataset.shape != stated {
        let reason = format!("its shape {:?} should be {stated:?} by attributes", dataset.shape);
        return Err(Error::invalid(place, reason));
    }
    Ok(())
}
