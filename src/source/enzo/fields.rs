//! Which datasets are fields, and their units.

use super::parameters::Parameters;
use crate::source::SourceField;
use crate::source::hdf5::{Element, File};
use crate::{Error, Result};

/// The one field that Enzo leaves out of grids that no particle has touched
/// (`Grid_Group_WriteGrid.C`): it is 0 there.
pub(super) const DARK_MATTER: &str = "Dark_Matter_Density";

/// Names of the datasets of grid group `group` that are fields: numbers of the grid's own
/// `size` (x, y, z). Particle data have one axis; face-centred data one cell more.
///
/// # Errors
/// No such group, or a damaged one.
pub(super) fn names(file: &File, group: &str, size: [u32; 3]) -> Result<Vec<String>> {
    let mut names = Vec::new();
    for name in file.members(group)?.datasets {
        if is_field(file, group, &name, size)? {
            names.push(name);
        }
    }
    Ok(names)
}

fn is_field(file: &File, group: &str, name: &str, size: [u32; 3]) -> Result<bool> {
    let dataset = file.dataset(&format!("{group}/{name}"))?;
    let shape = size.iter().rev().map(|&n| u64::from(n));
    let numbers = matches!(dataset.element, Element::Float | Element::Integer);
    Ok(numbers && shape.eq(dataset.shape) && !name.starts_with("particle_"))
}

/// Whether field `name` is 0 in the grid of group `group` and cells `size`, since Enzo has left it out.
///
/// # Errors
/// As [`names`].
pub(super) fn is_left_out(file: &File, group: &str, name: &str, size: [u32; 3]) -> Result<bool> {
    if name != DARK_MATTER {
        return Ok(false);
    }
    let datasets = file.members(group)?.datasets;
    if datasets.iter().any(|dataset| dataset == name) {
        return Ok(false);
    }
    // A grid without any field has been lost, or its size is made up.
    for other in &datasets {
        if is_field(file, group, other, size)? {
            return Ok(true);
        }
    }
    Ok(false)
}

/// The error about a file that has fields, but not in groups of grids, as `group` is one: a run
/// without packed AMR, which writes one file a grid.
pub(super) fn unpacked(file: &File, group: &str) -> Option<Error> {
    let members = file.members("/").ok()?;
    let has_grids = members.groups.iter().any(|name| name.starts_with("Grid"));
    (!has_grids && !members.datasets.is_empty()).then(|| {
        let reason = format!(
            "its fields stand in no group {group}: only packed AMR is read (Enzo built with \
             `make packed-amr-yes`, which is its default); or move each grid's datasets into such a \
             group of its file"
        );
        Error::not_supported(file.path().display(), reason)
    })
}

/// What a field measures, as far as its name tells: by Enzo's rules all densities of mass share a
/// unit, velocities are lengths over times, energies are specific but for those of cosmic rays,
/// temperatures are kelvins.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Density,
    Velocity,
    Energy,
    EnergyDensity,
    Temperature,
}

/// What else than mass a density may be of.
const NO_MASS: [&str; 5] = ["energy", "number", "momentum", "current", "charge"];

impl Kind {
    fn of(name: &str) -> Option<Self> {
        match name {
            "x-velocity" | "y-velocity" | "z-velocity" => Some(Self::Velocity),
            "TotalEnergy" | "GasEnergy" | "Total_Energy" | "Gas_Energy" => Some(Self::Energy),
            "Temperature" | "Dust_Temperature" => Some(Self::Temperature),
            "CREnergyDensity" => Some(Self::EnergyDensity),
            _ => {
                let of = name.strip_suffix("Density")?.to_lowercase();
                let is_mass = NO_MASS.iter().all(|other| !of.contains(other));
                is_mass.then_some(Self::Density)
            }
        }
    }

    fn cgs_unit(self) -> &'static str {
        match self {
            Self::Density => "g/cm^3",
            Self::Velocity => "cm/s",
            Self::Energy => "erg/g",
            Self::EnergyDensity => "erg/cm^3",
            Self::Temperature => "K",
        }
    }
}

/// The field `name` with its unit: what the parameter file says of it, or what its kind implies
/// where the file has the factor to cgs.
pub(super) fn describe(name: String, parameters: &Parameters) -> SourceField {
    let to_cgs = to_cgs(&name, parameters);
    let implied = Kind::of(&name).filter(|_| to_cgs.is_some()).map(Kind::cgs_unit);
    let stated = parameters.unit_names.get(&name).cloned();
    SourceField { name, units: stated.or(implied.map(str::to_owned)), to_cgs }
}

/// Which of `fields` is the density.
pub(super) fn density(fields: &[SourceField]) -> Option<usize> {
    fields
        .iter()
        .position(|field| field.name == "Density")
        .or_else(|| fields.iter().position(|field| field.name.eq_ignore_ascii_case("density")))
}

/// Factor from code units to cgs, where f64 holds it.
fn to_cgs(name: &str, parameters: &Parameters) -> Option<f64> {
    factor(name, parameters).filter(|factor| factor.is_normal())
}

/// The stated factor, or the one by the kind's rule. Enzo states that of mass densities for whatever has
/// `Density` in its name (`WriteParameterFile`), which says nothing of what is none.
fn factor(name: &str, parameters: &Parameters) -> Option<f64> {
    let stated = |label: &str| parameters.factors.get(label).copied();
    let is_misnamed = name.contains("Density") && Kind::of(name) != Some(Kind::Density);
    if let (Some(factor), false) = (stated(name), is_misnamed) {
        return Some(factor);
    }
    let [density, length, time] = parameters.units;
    let density = || stated("Density").or(density);
    let velocity = || stated("x-velocity").or_else(|| Some(length? / time?));
    match Kind::of(name)? {
        Kind::Density => density(),
        Kind::Velocity => velocity(),
        Kind::Energy => velocity().map(|v| v * v),
        Kind::EnergyDensity => Some(density()? * velocity()?.powi(2)),
        Kind::Temperature => Some(1.0),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    const PARAMETERS: &str = "TopGridRank = 3\nTopGridDimensions = 4 4 4\nRefineBy = 2\n\
        DomainLeftEdge = 0 0 0\nDomainRightEdge = 1 1 1\nDataLabel[0] = Density\n\
        DataLabel[1] = TotalEnergy\nDataLabel[2] = x-velocity\nDataUnits[0] = g/cm^3\n\
        DataUnits[1] = (null)\n";

    fn field(name: &str, more: &str) -> SourceField {
        let text = format!("{PARAMETERS}{more}");
        describe(name.into(), &Parameters::parse(Path::new("p"), &text).unwrap())
    }

    #[test]
    fn a_stated_factor_comes_before_one_derived_from_the_units() {
        let units = "DensityUnits = 2\nLengthUnits = 12\nTimeUnits = 4\n";
        assert_eq!(field("Density", units).to_cgs, Some(2.0));
        assert_eq!(field("Dark_Matter_Density", units).to_cgs, Some(2.0));
        assert_eq!(field("y-velocity", units).to_cgs, Some(3.0));
        assert_eq!(field("TotalEnergy", units).to_cgs, Some(9.0));
        let stated = "#DataCGSConversionFactor[0] = 5\n#DataCGSConversionFactor[2] = 7\n";
        assert_eq!(field("Density", &format!("{units}{stated}")).to_cgs, Some(5.0));
        assert_eq!(field("GasEnergy", stated).to_cgs, Some(49.0));
        assert_eq!(field("HII_Density", stated).to_cgs, Some(5.0));
    }

    #[test]
    fn a_unit_is_named_where_its_factor_is_known() {
        let units = "LengthUnits = 12\nTimeUnits = 4\n";
        assert_eq!(field("y-velocity", units).units.as_deref(), Some("cm/s"));
        assert_eq!(field("GasEnergy", units).units.as_deref(), Some("erg/g"));
        assert_eq!(field("Temperature", "").units.as_deref(), Some("K"));
        assert_eq!(field("HII_Density", units).units, None);
        let stated = "DensityUnits = 3\nDataUnits[0] = Msun/pc^3\n";
        assert_eq!(field("Density", stated).units.as_deref(), Some("Msun/pc^3"));
        assert_eq!(field("Metallicity", units).units, None);
    }

    #[test]
    fn factors_beyond_f64_are_unknown() {
        for units in
            ["LengthUnits = 1e200\nTimeUnits = 1\n", "LengthUnits = 1e-170\nTimeUnits = 1\n"]
        {
            assert_eq!(field("TotalEnergy", units).to_cgs, None);
            assert!(field("x-velocity", units).to_cgs.is_some());
        }
    }

    #[test]
    fn what_is_not_stated_is_unknown() {
        assert_eq!(field("Density", "").to_cgs, None);
        assert_eq!(field("Density", "DensityUnits = 0\n").to_cgs, None);
        assert_eq!(field("Metallicity", "DensityUnits = 2\n").to_cgs, None);
        assert_eq!(field("Density", "").units.as_deref(), Some("g/cm^3"));
        assert_eq!(field("TotalEnergy", "").units, None);
    }

    #[test]
    fn not_all_densities_are_of_mass() {
        let units = "DensityUnits = 2\nLengthUnits = 12\nTimeUnits = 4\n";
        let cosmic_rays = field("CREnergyDensity", units);
        assert_eq!(cosmic_rays.to_cgs, Some(18.0));
        assert_eq!(cosmic_rays.units.as_deref(), Some("erg/cm^3"));
        // Enzo states mass density's factor for it all the same.
        let stated = "DataLabel[3] = CREnergyDensity\n#DataCGSConversionFactor[3] = 2\n";
        assert_eq!(field("CREnergyDensity", &format!("{units}{stated}")).to_cgs, Some(18.0));
        for name in ["NumberDensity", "Momentum_Density", "Energy_Density", "Current_Density"] {
            assert_eq!(field(name, units).to_cgs, None, "{name}");
        }
        assert_eq!(field("Electron_Density", units).to_cgs, Some(2.0));
    }
}
