//! One file: the header of a legacy VTK file as Athena writes it, and the variables after it.

use std::path::Path;
use std::str::FromStr;

use crate::source::lines::{Lines, printing_error, shown};
use crate::source::open_file::OpenFile;
use crate::source::raw::{Number, RawArray};
use crate::space::{AXES, Decimal, MAX_OCTREE_LEVEL};
use crate::{Error, Result};

/// Digits that Athena prints of a coordinate (`%e`).
pub(super) const PRINTED_DIGITS: i32 = 7;
/// Bytes of the smallest number that a file can hold.
const SMALLEST_NUMBER: u64 = 4;
/// Most bytes of the lines before a variable's values.
const LONGEST_TITLE: usize = 512;
/// Most variables of a file.
const MOST_VARIABLES: usize = 10_000;

/// A coordinate as printed, and its nearest double.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Printed {
    text: String,
    /// The nearest double.
    pub(super) value: f64,
}

impl FromStr for Printed {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        let value: f64 = text.parse().map_err(|_| ())?;
        if value.is_finite() { Ok(Self { text: text.to_owned(), value }) } else { Err(()) }
    }
}

impl Printed {
    /// The number as printed, exactly.
    pub(super) fn decimal(&self) -> Result<Decimal> {
        Decimal::parse(&self.text)
    }

    /// Largest difference from the number that the code held.
    pub(super) fn error(&self) -> f64 {
        printing_error(&self.text, self.value, PRINTED_DIGITS)
    }
}

/// What a file's header says.
#[derive(Debug, Clone)]
pub(super) struct Header {
    /// Time, level and domain.
    pub(super) title: Title,
    /// Cells along x, y, z.
    pub(super) cells: [u32; 3],
    /// Lower corner.
    pub(super) origin: [Printed; 3],
    /// Width of the cells.
    pub(super) spacing: [Printed; 3],
    /// Where the variables begin, bytes.
    pub(super) variables: u64,
}

/// Athena's title, `PRIMITIVE vars at time= 1.0e+00, level= 0, domain= 0`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Title {
    time: f64,
    /// Level of the domain that the file is of.
    pub(super) level: u32,
    /// The domain's number among those of its level.
    pub(super) domain: u32,
}

impl Title {
    fn parse(line: &str) -> Option<Self> {
        let after = |key: &str| {
            let (_, rest) = line.split_once(key)?;
            rest.trim_start().split([',', ' ']).next()
        };
        let [time, level, domain] = ["time=", "level=", "domain="].map(after);
        Some(Self {
            time: time?.parse().ok()?,
            level: level?.parse().ok()?,
            domain: domain?.parse().ok()?,
        })
    }

    /// The title of the file at `path`, where it begins as Athena's do.
    pub(super) fn of(path: &Path) -> Option<Self> {
        Self::parse(&line_of_title(path)?)
    }
}

/// The title of a VTK file, whatever it says; none of another file.
pub(super) fn line_of_title(path: &Path) -> Option<String> {
    let mut lines = Lines::open(path).ok()?;
    let vtk = lines.expect("VTK's mark").ok()?.starts_with("# vtk DataFile Version");
    lines.expect("a title").ok().filter(|_| vtk)
}

fn three<T: FromStr>(text: &str) -> Option<[T; 3]> {
    let list: Option<Vec<T>> = text.split_whitespace().map(|word| word.parse().ok()).collect();
    list?.try_into().ok()
}

impl Header {
    /// Code time.
    pub(super) fn time(&self) -> Option<f64> {
        Some(self.title.time).filter(|time| time.is_finite())
    }

    /// Level of the domain that the file is of.
    pub(super) fn level(&self) -> u32 {
        self.title.level
    }

    /// Level and number of the domain that the file is of.
    pub(super) fn place(&self) -> (u32, u32) {
        (self.title.level, self.title.domain)
    }

    /// Reads the header of the file at `path`.
    ///
    /// # Errors
    /// A file that is no VTK file of Athena's, or whose data are not binary, three-dimensional
    /// and on a uniform Cartesian grid.
    pub(super) fn read(path: &Path) -> Result<Self> {
        let mut lines = Lines::open(path)?;
        lines.parse("`# vtk DataFile Version`", |text| {
            text.starts_with("# vtk DataFile Version").then_some(())
        })?;
        let title = lines.parse("Athena's `… time= …, level= …, domain= …`", Title::parse)?;
        let level = title.level;
        if level > MAX_OCTREE_LEVEL {
            let reason = format!("level {level}: at most {MAX_OCTREE_LEVEL} are supported");
            return Err(lines.fault(&reason));
        }
        refuse(&mut lines, path, "BINARY", "only binary files can be read")?;
        let uniform = "only uniform Cartesian grids (STRUCTURED_POINTS) can be read";
        refuse(&mut lines, path, "DATASET STRUCTURED_POINTS", uniform)?;
        let grid = Grid::read(&mut lines)?;
        let missing = |key: &str| lines.fault(&format!("has no {key} of three numbers"));
        let points = grid.points.ok_or_else(|| missing("DIMENSIONS"))?;
        let cells = cells(points, grid.cells).map_err(|reason| lines.fault(&reason))?;
        let length = std::fs::metadata(path).map_err(|e| Error::io(path, "cannot open", e))?.len();
        if length / SMALLEST_NUMBER < grid.cells {
            let reason =
                format!("{} cells in a file of {length} bytes: is it truncated?", grid.cells);
            return Err(lines.fault(&reason));
        }
        Ok(Self {
            title,
            cells,
            origin: grid.origin.ok_or_else(|| missing("ORIGIN"))?,
            spacing: grid.spacing.ok_or_else(|| missing("SPACING"))?,
            variables: lines.offset(),
        })
    }
}

/// VTK's description of a uniform grid, whose lines come in any order.
#[derive(Default)]
struct Grid {
    points: Option<[u32; 3]>,
    origin: Option<[Printed; 3]>,
    spacing: Option<[Printed; 3]>,
    cells: u64,
}

impl Grid {
    /// Reads the lines up to that with the number of cells.
    fn read(lines: &mut Lines) -> Result<Self> {
        let mut grid = Self::default();
        loop {
            let line = lines.expect("CELL_DATA")?;
            let (key, value) = line.split_once(char::is_whitespace).unwrap_or((&line, ""));
            match (key, value.trim().parse()) {
                ("DIMENSIONS", _) => grid.points = three(value),
                ("ORIGIN", _) => grid.origin = three(value),
                ("SPACING", _) => grid.spacing = three(value),
                ("CELL_DATA", Ok(cells)) => return Ok(Self { cells, ..grid }),
                _ => {
                    let reason = format!("`{}` where CELL_DATA should stand", shown(&line));
                    return Err(lines.fault(&reason));
                }
            }
        }
    }
}

/// Refuses a line that is not `known`.
fn refuse(lines: &mut Lines, path: &Path, known: &str, reason: &str) -> Result<()> {
    let line = lines.expect(known)?;
    if line == known {
        return Ok(());
    }
    Err(Error::not_supported(path.display(), format!("`{}`: {reason}", shown(&line))))
}

/// Cells along each axis, of `points` and `count` cells in all. Some programs that join files
/// give the cells instead of the points.
fn cells(points: [u32; 3], count: u64) -> Result<[u32; 3], String> {
    if points[2] <= 1 || points[1] <= 1 {
        return Err("only three-dimensional runs can be read".to_owned());
    }
    let product = |cells: [u32; 3]| cells.iter().map(|&n| u128::from(n)).product::<u128>();
    [points.map(|n| n.saturating_sub(1)), points]
        .into_iter()
        .find(|&cells| count > 0 && product(cells) == u128::from(count))
        .ok_or_else(|| format!("DIMENSIONS {points:?} do not make the CELL_DATA's {count} cells"))
}

/// A variable of a file: numbers, vectors or tensors.
#[derive(Debug, Clone)]
pub(super) struct Variable {
    name: String,
    array: RawArray,
}

impl Variable {
    /// Names of the fields that the variable's numbers are.
    pub(super) fn fields(&self) -> Vec<String> {
        let named = |part: &str| format!("{}_{part}", self.name);
        match self.array.per_cell {
            1 => vec![self.name.clone()],
            3 => AXES.map(named).to_vec(),
            _ => AXES
                .iter()
                .flat_map(|row| AXES.map(|axis| named(&format!("{row}{axis}"))))
                .collect(),
        }
    }
}

/// The variables of `file`, which has `header`, until `enough`.
///
/// # Errors
/// A file whose variables are malformed or that ends within one.
pub(super) fn variables(
    file: &OpenFile,
    header: &Header,
    enough: &dyn Fn(&Variable) -> bool,
) -> Result<Vec<Variable>> {
    let length = file.length()?;
    let mut found = Vec::new();
    let mut at = header.variables;
    while at < length && found.len() < MOST_VARIABLES {
        let fault = |reason: String| {
            Error::invalid(format!("{}: byte {at}", file.path().display()), reason)
        };
        let mut bytes = [0; LONGEST_TITLE];
        let read = (length - at).min(LONGEST_TITLE as u64) as usize;
        file.read_exact_at(&mut bytes[..read], at)?;
        let Some((name, array)) = variable(&bytes[..read], at, header.cells).map_err(fault)? else {
            break;
        };
        at = array.end().filter(|&end| end <= length).ok_or_else(|| {
            fault(format!("the file ends within the variable {name}: is it truncated?"))
        })?;
        let variable = Variable { name, array };
        let last = enough(&variable);
        found.push(variable);
        if last {
            break;
        }
    }
    Ok(found)
}

/// Name and values of the variable whose lines `bytes` begin with, which stand at byte `at`; none
/// where only blanks follow.
fn variable(bytes: &[u8], at: u64, shape: [u32; 3]) -> Result<Option<(String, RawArray)>, String> {
    let mut rest = bytes.trim_ascii_start();
    if rest.is_empty() {
        return Ok(None);
    }
    let mut line = || {
        let end = rest.iter().position(|&byte| byte == b'\n')?;
        let line = String::from_utf8_lossy(&rest[..end]).into_owned();
        rest = &rest[end + 1..];
        Some(line)
    };
    let title = line().ok_or("no SCALARS, VECTORS or TENSORS follow: is the file truncated?")?;
    let malformed =
        || format!("`{}` where SCALARS, VECTORS or TENSORS should stand", shown(&title));
    let words: Vec<&str> = title.split_whitespace().collect();
    let per_cell = match words.as_slice() {
        ["SCALARS", _, _] | ["SCALARS", _, _, "1"] => 1,
        ["VECTORS", _, _] => 3,
        ["TENSORS", _, _] => 9,
        _ => return Err(malformed()),
    };
    let is_table = |line: String| line.split_whitespace().next() == Some("LOOKUP_TABLE");
    if per_cell == 1 && !line().is_some_and(is_table) {
        return Err(format!("no LOOKUP_TABLE follows `{}`", shown(&title)));
    }
    let number = match words[2] {
        "float" => Number::F32Big,
        "double" => Number::F64Big,
        other => return Err(format!("numbers of type `{}`: only float and double", shown(other))),
    };
    let start = at + (bytes.len() - rest.len()) as u64;
    let shape = shape.map(u64::from);
    let array = RawArray { start, shape, number, per_cell, component: 0 };
    Ok(Some((words[1].to_owned(), array)))
}

/// The array of the field `name` among `variables`.
pub(super) fn array(variables: &[Variable], name: &str) -> Option<RawArray> {
    variables.iter().find_map(|variable| {
        let component = variable.fields().iter().position(|field| field == name)?;
        Some(RawArray { component: component as u64, ..variable.array })
    })
}
