//! Which datasets are fields, and their units.

use std::path::Path;

use super::header::Header;
use crate::source::SourceField;
use crate::source::hdf5::{Dataset, Element, File, Values};
use crate::{Error, Result};

/// Units of variables in FLASH's own naming, where a run computes in cgs.
const CGS_UNITS: [(&str, &str); 11] = [
    ("dens", "g/cm^3"),
    ("pres", "erg/cm^3"),
    ("temp", "K"),
    ("velx", "cm/s"),
    ("vely", "cm/s"),
    ("velz", "cm/s"),
    ("ener", "erg/g"),
    ("eint", "erg/g"),
    ("gpot", "cm^2/s^2"),
    ("pden", "g/cm^3"),
    ("pde", "g/cm^3"),
];

/// The datasets of the variables that `unknown names` lists, and the fields that they are.
/// Variables whose dataset is not there are left out.
///
/// # Errors
/// A list that cannot be read, datasets of another shape than the blocks', and none at all.
pub(super) fn find(
    file: &File,
    path: &Path,
    header: &Header,
) -> Result<(Vec<String>, Vec<SourceField>)> {
    let place = format!("{}: /unknown names", path.display());
    let Values::Text(names) = file.values("/unknown names")? else {
        return Err(Error::invalid(place, "is no list of names"));
    };
    let members = file.members("/")?.datasets;
    let (mut datasets, mut fields) = (Vec::new(), Vec::<SourceField>::new());
    for name in names.iter().map(|name| name.trim()) {
        // Names of fewer than four characters are filled with blanks, in the file's own too.
        let Some(dataset) = members.iter().find(|member| member.trim() == name) else { continue };
        if fields.iter().any(|field| field.name == name) {
            return Err(Error::invalid(place, format!("lists `{name}` twice")));
        }
        let dataset = format!("/{dataset}");
        check(&file.dataset(&dataset)?, header)
            .map_err(|reason| Error::invalid(format!("{}: {dataset}", path.display()), reason))?;
        datasets.push(dataset);
        fields.push(describe(name, header.is_cgs));
    }
    if fields.is_empty() {
        return Err(Error::invalid(place, "lists no variable that has a dataset: nothing to read"));
    }
    Ok((datasets, fields))
}

fn check(dataset: &Dataset, header: &Header) -> Result<(), String> {
    if !matches!(dataset.element, Element::Float | Element::Integer) {
        return Err("its elements are not numbers of a known kind".into());
    }
    let [x, y, z] = header.block_size.map(u64::from);
    let expected = [header.blocks, z, y, x];
    if dataset.shape != expected {
        return Err(format!(
            "its shape {:?} should be {expected:?}: guard cells and other data are not read",
            dataset.shape
        ));
    }
    Ok(())
}

fn describe(name: &str, is_cgs: bool) -> SourceField {
    let unit = CGS_UNITS.iter().find(|(known, _)| is_cgs && *known == name);
    SourceField {
        name: name.to_owned(),
        units: unit.map(|(_, unit)| (*unit).to_owned()),
        to_cgs: unit.map(|_| 1.0),
    }
}

#[cfg(test)]
mod tests {
    use super::describe;

    #[test]
    fn units_are_cgs_where_the_run_says_so_and_the_name_is_known() {
        assert_eq!(describe("dens", true).to_cgs, Some(1.0));
        assert_eq!(describe("dens", true).units.as_deref(), Some("g/cm^3"));
        assert_eq!(describe("dens", false).to_cgs, None);
        assert_eq!(describe("he4", true).units, None);
    }
}
