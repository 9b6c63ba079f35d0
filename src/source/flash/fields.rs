//! Which datasets are fields, and their units.

use std::path::Path;

use super::header::{Header, Units};
use crate::source::SourceField;
use crate::source::hdf5::{Dataset, Element, File, Values};
use crate::{Error, Result};

/// Units of variables in FLASH's own naming, where a run computes in cgs; and the power of the scale
/// factor that makes the physical quantity of the comoving one, where it computes in comoving
/// coordinates (FLASH User's Guide, "Cosmology Unit": x = r/a, ρ̃ = a³ρ, p̃ = a·p, T̃ = T/a²).
const CGS_UNITS: [(&str, &str, Option<i32>); 11] = [
    ("dens", "g/cm^3", Some(-3)),
    ("pres", "erg/cm^3", Some(-1)),
    ("temp", "K", Some(2)),
    ("velx", "cm/s", Some(1)),
    ("vely", "cm/s", Some(1)),
    ("velz", "cm/s", Some(1)),
    ("ener", "erg/g", Some(2)),
    ("eint", "erg/g", Some(2)),
    ("gpot", "cm^2/s^2", None),
    ("pden", "g/cm^3", Some(-3)),
    ("pde", "g/cm^3", Some(-3)),
];

const NOTHING: &str = "lists no variable that has a dataset of its own; files that hold all of them in one \
                       are not read";

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
        fields.push(describe(name, header.units));
    }
    if fields.is_empty() {
        return Err(Error::invalid(place, NOTHING));
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

fn describe(name: &str, units: Units) -> SourceField {
    let known = CGS_UNITS.iter().find(|(known, ..)| *known == name);
    let factor = known.and_then(|(_, _, power)| match units {
        Units::Unknown => None,
        Units::Cgs => Some(1.0),
        Units::Comoving { scale_factor } => power.map(|power| scale_factor.powi(power)),
    });
    // A factor beyond what doubles hold is none.
    let factor = factor.filter(|factor| factor.is_normal());
    SourceField {
        name: name.to_owned(),
        units: known.filter(|_| factor.is_some()).map(|(_, unit, _)| (*unit).to_owned()),
        to_cgs: factor,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_cgs_where_the_run_says_so_and_the_name_is_known() {
        assert_eq!(describe("dens", Units::Cgs).to_cgs, Some(1.0));
        assert_eq!(describe("dens", Units::Cgs).units.as_deref(), Some("g/cm^3"));
        assert_eq!(describe("dens", Units::Unknown).to_cgs, None);
        assert_eq!(describe("he4", Units::Cgs).units, None);
    }

    #[test]
    fn comoving_quantities_become_physical_ones() {
        let factor = |name| describe(name, Units::Comoving { scale_factor: 0.25 }).to_cgs;
        assert_eq!(["dens", "pden"].map(factor), [Some(64.0); 2]);
        assert_eq!(["pres", "temp"].map(factor), [Some(4.0), Some(0.0625)]);
        assert_eq!(["velx", "eint"].map(factor), [Some(0.25), Some(0.0625)]);
        assert_eq!(["gpot", "he4"].map(factor), [None; 2]);
        let tiny = describe("dens", Units::Comoving { scale_factor: 1e-200 });
        assert_eq!((tiny.to_cgs, tiny.units), (None, None));
    }
}
