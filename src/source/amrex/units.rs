//! Units: of the codes that write plotfiles, Quokka (Wibking and Krumholz, *MNRAS* 512, 2022) says
//! what its are, in `metadata.yaml` beside the `Header`.

use std::io::Read;
use std::path::Path;

use crate::regular_file;
use crate::source::SourceField;

/// Bytes of `metadata.yaml` that are looked at.
const MOST_BYTES: u64 = 1 << 20;
/// The factors to g, cm and s as the file calls them.
const KEYS: [&str; 3] = ["unit_mass", "unit_length", "unit_time"];
/// Quokka's variables, those of photon groups without the group's number: their powers of mass,
/// length and time, and the cgs unit of these.
const VARIABLES: [(&str, [i32; 3], &str); 10] = [
    ("gasDensity", [1, -3, 0], "g/cm^3"),
    ("gasEnergy", [1, -1, -2], "erg/cm^3"),
    ("gasInternalEnergy", [1, -1, -2], "erg/cm^3"),
    ("x-GasMomentum", [1, -2, -1], "g/(cm^2*s)"),
    ("y-GasMomentum", [1, -2, -1], "g/(cm^2*s)"),
    ("z-GasMomentum", [1, -2, -1], "g/(cm^2*s)"),
    ("radEnergy-Group", [1, -1, -2], "erg/cm^3"),
    ("x-RadFlux-Group", [1, 0, -3], "erg/(cm^2*s)"),
    ("y-RadFlux-Group", [1, 0, -3], "erg/(cm^2*s)"),
    ("z-RadFlux-Group", [1, 0, -3], "erg/(cm^2*s)"),
];

/// A run's units of mass, length and time, in cgs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Units([f64; 3]);

impl Units {
    /// What the plotfile at `folder` says; none where it says nothing, or of one unit that there
    /// is none (`.nan`), as of runs whose constants of nature are 1.
    pub(super) fn read(folder: &Path) -> Option<Self> {
        let mut bytes = Vec::new();
        let file = regular_file::open(folder.join("metadata.yaml")).ok()?;
        file.take(MOST_BYTES).read_to_end(&mut bytes).ok()?;
        Self::parse(&String::from_utf8_lossy(&bytes))
    }

    fn parse(text: &str) -> Option<Self> {
        let stated = |key: &str| {
            let mut entries = text.lines().filter_map(|line| line.split_once(':'));
            let (_, value) = entries.find(|(name, _)| *name == key)?;
            let value = value.split('#').next().unwrap_or(value);
            value.trim().parse().ok().filter(|factor: &f64| factor.is_normal() && *factor > 0.0)
        };
        let [mass, length, time] = KEYS.map(stated);
        Some(Self([mass?, length?, time?]))
    }

    /// Factor to cgs of what has these powers of mass, length and time.
    fn to_cgs(self, powers: [i32; 3]) -> Option<f64> {
        let factors = self.0.iter().zip(powers).map(|(unit, power)| unit.powi(power));
        Some(factors.product()).filter(|factor: &f64| factor.is_normal())
    }
}

/// The field that component `name` is, with its unit where that is known.
pub(super) fn describe(name: String, units: Option<Units>) -> SourceField {
    let without_group = name.trim_end_matches(|c: char| c.is_ascii_digit());
    let variable = VARIABLES.iter().find(|(known, ..)| *known == without_group);
    let known = variable.and_then(|(_, powers, unit)| Some((*unit, units?.to_cgs(*powers)?)));
    let (unit, to_cgs) = known.unzip();
    SourceField { name, units: unit.map(str::to_owned), to_cgs }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STATED: &str = "c: 1\nunit_length: 4\nunit_mass: 192\nunit_time: 2.0 # s\nk_B: 1\n";

    #[test]
    fn variables_have_the_units_that_their_kind_implies() {
        let of = |name: &str| describe(name.to_owned(), Units::parse(STATED));
        let field = of("gasDensity");
        assert_eq!((field.to_cgs, field.units.as_deref()), (Some(3.0), Some("g/cm^3")));
        assert_eq!(of("gasEnergy").to_cgs, Some(12.0));
        assert_eq!(of("y-GasMomentum").to_cgs, Some(6.0));
        assert_eq!(of("radEnergy-Group12").to_cgs, Some(12.0));
        assert_eq!(of("x-RadFlux-Group0").to_cgs, Some(24.0));
        assert_eq!((of("scalar_0").to_cgs, of("scalar_0").units), (None, None));
    }

    #[test]
    fn what_is_not_stated_is_unknown() {
        for (from, to) in [
            ("unit_mass: 192", "unit_mass: .nan"),
            ("unit_mass", "unit_of_mass"),
            ("unit_time: 2.0", "unit_time: 0"),
            ("unit_time: 2.0", "unit_time: -2"),
            ("unit_length: 4", "unit_length: inf"),
            ("unit_length: 4", "  unit_length: 4"),
        ] {
            assert_eq!(Units::parse(&STATED.replace(from, to)), None, "{to}");
        }
        let tiny = Units::parse(&STATED.replace("unit_length: 4", "unit_length: 1e-200"));
        assert_eq!(describe("gasDensity".to_owned(), tiny).to_cgs, None);
        assert_eq!(describe("gasDensity".to_owned(), None).units, None);
    }
}
