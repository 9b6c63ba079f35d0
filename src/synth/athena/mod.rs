//! Legacy VTK files as Athena (the C code) writes them. Root grids are the parts of processes,
//! each in a folder `idP`; every refined grid is a domain of its level, in `idP/levL`.

mod piece;

use std::path::Path;

use super::batches::{by_level, evaluate};
use super::grids::{Grid, Grids};
use super::output::{MARK, OutputFolder};
use super::recipe::Recipe;
use super::{Layout, Summary};
use crate::{Error, Result};
use piece::Variable;

/// How the layout is listed among the others.
pub(super) const LAYOUT: Layout = Layout { name: "athena", write };

/// Code time.
const TIME: f64 = 0.25;
/// Largest error of a corner that its seven digits may have, in cells.
const LARGEST_ERROR: f64 = 0.25;

/// Writes the data set, as [`super::write`]. Values are 32-bit floats whatever the recipe says,
/// as Athena writes no others.
fn write(recipe: &Recipe, directory: &Path, progress: &mut dyn FnMut(u64, u64)) -> Result<Summary> {
    if recipe.one_factor()? != 2 {
        return Err(Error::request("refinement.factor: Athena refines by 2"));
    }
    let grids = Grids::new(recipe)?;
    let levels = by_level(&grids)?;
    levels.iter().flatten().try_for_each(|grid| check_digits(&grids, grid))?;
    let total = levels.iter().flatten().map(Grid::count).sum();
    let parameters = format!("athinput.{}", recipe.name);
    let folder = OutputFolder::create(directory, &recipe.name, &parameters)?;
    let job = format!("{MARK}\n<job>\nproblem_id = {}\n", recipe.name);
    let mut bytes = folder.write_text(&parameters, &job)?;
    let (variables, fields) = variables(recipe);
    let (processes, mut done) = (levels.first().map_or(1, Vec::len).max(1), 0);
    for list in &levels {
        let mut domain = 0;
        evaluate(recipe, &grids, list, &fields, &mut |grid, values| {
            let place = Place::of(grid, domain, processes);
            domain += 1;
            let path = folder.make(&place.folder())?.join(place.file(&recipe.name));
            bytes += piece::write(&path, &grids, grid, place.domain, &variables, &values)?;
            done += grid.count();
            progress(done, total);
            Ok(())
        })?;
    }
    let root = Place { process: 0, level: 0, domain: 0 };
    let input = folder.finish()?.join(root.folder()).join(root.file(&recipe.name));
    Ok(Summary {
        input,
        levels: levels.len() as u32,
        grids: levels.iter().map(|list| list.len() as u64).sum(),
        cells: total,
        bytes,
    })
}

/// Refuses grids whose corners seven digits do not tell.
fn check_digits(grids: &Grids, grid: &Grid) -> Result<()> {
    let octree = grids.octree(grid.level);
    let width = grids.domain().cell_width(octree.cast_signed());
    for a in 0..3 {
        let exact = super::edges::cell_edge(grids.domain(), octree, a, grid.cells.lo[a]);
        let printed: f64 = super::edges::exponential_6(exact).parse().unwrap_or(f64::NAN);
        if (printed - exact).abs().is_nan() || exact.abs() * 5e-7 > LARGEST_ERROR * width[a] {
            return Err(Error::request(format!(
                "refinement: cells of level {} are too small for the seven digits in which \
                 Athena's files say where they lie: refine less",
                grid.level
            )));
        }
    }
    Ok(())
}

/// The variables of a file, and which of the recipe's fields each takes its numbers from.
fn variables(recipe: &Recipe) -> (Vec<Variable>, Vec<String>) {
    let mut fields: Vec<String> = Vec::new();
    let mut variables = Vec::new();
    for name in &recipe.output.fields {
        let (variable, parts): (_, &[&str]) = match name.as_str() {
            "Density" => ("density", &["Density"]),
            "Temperature" => ("temperature", &["Temperature"]),
            _ => ("velocity", &["x-velocity", "y-velocity", "z-velocity"]),
        };
        if variables.iter().all(|other: &Variable| other.name != variable) {
            variables.push(Variable { name: variable, first: fields.len(), parts: parts.len() });
            fields.extend(parts.iter().map(|part| (*part).to_owned()));
        }
    }
    (variables, fields)
}

/// Where a grid is written.
struct Place {
    process: usize,
    level: u32,
    domain: usize,
}

impl Place {
    /// Root grids are parts of one domain; refined ones are domains, shared out among processes.
    fn of(grid: &Grid, number: usize, processes: usize) -> Self {
        let process = number % processes;
        Self { process, level: grid.level, domain: if grid.level == 0 { 0 } else { number } }
    }

    fn folder(&self) -> String {
        match self.level {
            0 => format!("id{}", self.process),
            level => format!("id{}/lev{level}", self.process),
        }
    }

    fn file(&self, name: &str) -> String {
        let part = |key: &str, number: usize| match number {
            0 => String::new(),
            number => format!("-{key}{number}"),
        };
        let (process, level) = (part("id", self.process), part("lev", self.level as usize));
        format!("{name}{process}{level}{}.0000.vtk", part("dom", self.domain))
    }
}
