//! AMReX' plotfiles: `Header`, and for each level `Level_N/Cell_H` and `Level_N/Cell_D_NNNNN`.

mod header;
mod level;

use std::path::Path;

use super::batches::{by_level, evaluate};
use super::grids::{Grid, Grids};
use super::output::{MARK, OutputFolder};
use super::recipe::Recipe;
use super::{Layout, Summary};
use crate::{Error, Result};
use level::LevelWriter;

/// How the layout is listed among the others.
pub(super) const LAYOUT: Layout = Layout { name: "amrex", write };

/// Code time.
const TIME: f64 = 0.25;
/// The file that tells of the run. Readers learn from it that the code was AMReX.
const JOB_INFO: &str = "job_info";

/// Writes the data set, as [`super::write`].
fn write(recipe: &Recipe, directory: &Path, progress: &mut dyn FnMut(u64, u64)) -> Result<Summary> {
    let grids = Grids::new(recipe)?;
    let levels = by_level(&grids)?;
    check_indices(&grids, &levels)?;
    let total = levels.iter().flatten().map(Grid::count).sum();
    let folder = OutputFolder::create(directory, &recipe.name, JOB_INFO)?;
    let mut bytes = folder.write_text(JOB_INFO, &format!("{MARK}\nAMReX Job Information\n"))?;
    bytes += folder.write_text("Header", &header::text(recipe, &grids, &levels))?;
    let mut done = 0;
    for (level, list) in levels.iter().enumerate() {
        let mut writer = LevelWriter::create(recipe, &folder, level)?;
        evaluate(recipe, &grids, list, &recipe.output.fields, &mut |grid, v| {
            writer.add(grid, &v)?;
            done += grid.count();
            progress(done, total);
            Ok(())
        })?;
        bytes += writer.finish()?;
    }
    Ok(Summary {
        input: folder.finish()?,
        levels: levels.len() as u32,
        grids: levels.iter().map(|list| list.len() as u64).sum(),
        cells: total,
        bytes,
    })
}

/// Refuses levels whose cells AMReX cannot count: it has 32-bit indices.
fn check_indices(grids: &Grids, levels: &[Vec<Grid>]) -> Result<()> {
    let deepest = levels.len().saturating_sub(1) as u32;
    let octree = grids.octree(deepest);
    match grids.domain().root_cells().into_iter().max() {
        Some(cells) if i128::from(cells) << octree > i128::from(i32::MAX) => {
            Err(Error::request(format!(
                "refinement: cell indices of level {deepest} exceed the 32 bits that AMReX has: \
                 refine less"
            )))
        }
        _ => Ok(()),
    }
}

/// Names of the components, as Castro has them.
fn component(field: &str) -> &str {
    match field {
        "Density" => "density",
        "Temperature" => "Temp",
        "x-velocity" => "x_velocity",
        "y-velocity" => "y_velocity",
        "z-velocity" => "z_velocity",
        other => other,
    }
}

/// A box as AMReX prints it, with its last index.
fn printed(cells: &crate::space::IndexBox) -> String {
    let [[x0, y0, z0], [x1, y1, z1]] = [cells.lo, cells.hi.map(|i| i - 1)];
    format!("(({x0},{y0},{z0}) ({x1},{y1},{z1}) (0,0,0))")
}
