//! The parameter file.

use std::fmt::Write;

use super::{TIME, Totals, field_types};
use crate::Result;
use crate::synth::output::{MARK, OutputFolder};
use crate::synth::recipe::Recipe;

/// Writes the parameter file; its size.
pub(super) fn write(
    recipe: &Recipe,
    factor: u32,
    folder: &OutputFolder,
    totals: Totals,
) -> Result<u64> {
    folder.write_text(&recipe.name, &text(recipe, factor, totals))
}

fn text(recipe: &Recipe, factor: u32, totals: Totals) -> String {
    let domain = &recipe.domain;
    let mut text = format!("{MARK}\n");
    // Writing to a string cannot fail.
    let mut line = |key: &str, value: &dyn std::fmt::Display| {
        let _ = writeln!(text, "{key:<26} = {value}");
    };
    line("InitialCycleNumber", &0);
    line("InitialTime", &TIME);
    line("TopGridRank", &3);
    line("TopGridDimensions", &three(&domain.root));
    line("NumberOfParticles", &format!("{} (do not modify)", all_particles(recipe, totals)));
    line("RefineBy", &factor);
    line("MaximumRefinementLevel", &(totals.levels - 1));
    line("Gamma", &"1.6667");
    line("HydroMethod", &0);
    line("DomainLeftEdge", &three(&domain.left));
    line("DomainRightEdge", &three(&domain.right));
    for (i, (_, name)) in field_types(recipe).iter().enumerate() {
        line(&format!("DataLabel[{i}]"), name);
    }
    for switch in ["ComovingCoordinates", "MultiSpecies", "DualEnergyFormalism"] {
        line(switch, &0);
    }
    line("LeftFaceBoundaryCondition", &three(&[3; 3]));
    line("RightFaceBoundaryCondition", &three(&[3; 3]));
    for unit in ["MassUnits", "DensityUnits", "TimeUnits", "LengthUnits"] {
        line(unit, &1);
    }
    line("CurrentTimeIdentifier", &1);
    line("VersionNumber", &"2.600000");
    text
}

fn three<T: std::fmt::Display>(values: &[T; 3]) -> String {
    format!("{} {} {}", values[0], values[1], values[2])
}

fn all_particles(recipe: &Recipe, totals: Totals) -> u64 {
    u64::from(recipe.output.particles) * (totals.grids / 3)
}
