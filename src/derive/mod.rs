//! Derived fields: expressions over an output's fields, computed cell by cell from the source's
//! own values, before anything is averaged or rounded.
//!
//! [`Derived`] is a source with more fields than the one it reads; ingest tells them apart in its advice
//! alone.

mod cells;
mod dimensions;
mod expression;
mod grammar;
mod units;

#[cfg(test)]
mod tests;

use std::path::PathBuf;

use crate::source::{About, GridBlock, GridRecord, Source, SourceField};
use crate::spelling::{nearest_first, position};
use crate::{Error, Result};

use expression::Expression;
use units::Unit;

/// Values of operands that are held at a time while a block is computed: 1 MiB of them, or a
/// plane of the block.
const HELD_VALUES: usize = 1 << 17;
/// Most derived fields of a source.
const MOST_FIELDS: usize = 64;
/// Longest name of a derived field, bytes.
const LONGEST_NAME: usize = 100;

/// A source and fields that are computed from its own.
pub struct Derived<'s> {
    source: &'s dyn Source,
    /// The source's, with the derived fields after its own.
    about: About,
    /// In the order of the hierarchy's last fields; each has only fields before it as operands.
    fields: Vec<DerivedField>,
}

struct DerivedField {
    name: String,
    expression: Expression,
    /// The hierarchy's field for each of the expression's names.
    operands: Vec<usize>,
}

/// Whether `definition` can be read, whatever fields there are.
///
/// # Errors
/// Why it cannot.
pub fn check_definition(definition: &str) -> Result<(), String> {
    parse(definition).map(|_| ())
}

/// Name and expression of a definition, `NAME=EXPRESSION`.
fn parse(definition: &str) -> Result<(String, Expression), String> {
    let (name, text) =
        definition.split_once('=').ok_or("it is no definition: write one as NAME=EXPRESSION")?;
    let name = name.trim();
    if name.is_empty() || name.len() > LONGEST_NAME || name.contains(char::is_control) {
        return Err(format!("its name must have 1 to {LONGEST_NAME} printable bytes"));
    }
    if name.contains(['{', '}']) {
        return Err("its name must have no braces: they quote names in expressions".into());
    }
    let expression = Expression::parse(text)?;
    if expression.names().is_empty() {
        return Err("it names no field: it would be the same everywhere".into());
    }
    Ok((name.to_owned(), expression))
}

impl<'s> Derived<'s> {
    /// Adds to `source` the fields that `definitions` (`NAME=EXPRESSION`) define. An expression
    /// may name the source's fields and those defined before it, without regard to case, in braces
    /// where a name is not letters, digits and underscores alone.
    ///
    /// # Errors
    /// A definition that cannot be read, that names an unknown field, whose name is taken, or that
    /// adds or compares fields whose units are known and differ.
    pub fn new(source: &'s dyn Source, definitions: &[String]) -> Result<Self> {
        let about = source.about().clone();
        let mut derived = Self { source, about, fields: Vec::new() };
        for definition in definitions {
            derived.define(definition).map_err(|reason| {
                Error::request(format!("--derive `{}`: {reason}", shortened(definition)))
            })?;
        }
        Ok(derived)
    }

    /// Names of the derived fields, in the order of their definitions.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.fields.iter().map(|field| field.name.as_str())
    }

    fn define(&mut self, definition: &str) -> Result<(), String> {
        let (name, expression) = parse(definition)?;
        self.check_is_new(&name)?;
        let operands: Vec<usize> =
            expression.names().iter().map(|name| self.operand(name)).collect::<Result<_, _>>()?;
        let units: Vec<Unit> =
            operands.iter().map(|&field| Unit::of(&self.hierarchy().fields[field])).collect();
        let unit = Unit::of_expression(&expression, &units)?;
        self.about.hierarchy.fields.push(SourceField {
            name: name.clone(),
            units: unit.dimensions.map(|dimensions| dimensions.to_string()),
            to_cgs: unit.to_cgs,
        });
        self.fields.push(DerivedField { name, expression, operands });
        Ok(())
    }

    fn check_is_new(&self, name: &str) -> Result<(), String> {
        if self.hierarchy().fields.iter().any(|field| field.name.eq_ignore_ascii_case(name)) {
            return Err(format!("there is a field `{name}` already: choose another name"));
        }
        if self.fields.len() == MOST_FIELDS {
            return Err(format!("there are {MOST_FIELDS} derived fields already"));
        }
        Ok(())
    }

    /// The field that an expression calls `name`.
    fn operand(&self, name: &str) -> Result<usize, String> {
        let fields = || self.hierarchy().fields.iter().map(|field| field.name.as_str());
        position(name, fields()).ok_or_else(|| {
            let known: Vec<String> =
                nearest_first(name, fields()).into_iter().map(grammar::written).collect();
            // Of `x-velocity` without braces, `x` is what is not found.
            let start = format!("{{{name}").to_lowercase();
            let meant = known.iter().find(|known| known.to_lowercase().starts_with(&start));
            let meant = meant.map_or_else(String::new, |meant| format!(" (is {meant} meant?)"));
            format!("no field `{}`{meant}: there are {}", name.escape_debug(), known.join(", "))
        })
    }

    /// The fields that derived field `last` is computed from, by way of others or not, and itself,
    /// in an order in which each can be computed.
    fn needed(&self, last: usize) -> Vec<usize> {
        let own = self.source.hierarchy().fields.len();
        let mut is_needed = vec![false; own + last + 1];
        is_needed[own + last] = true;
        for (number, field) in self.fields.iter().enumerate().take(last + 1).rev() {
            if is_needed[own + number] {
                field.operands.iter().for_each(|&operand| is_needed[operand] = true);
            }
        }
        (0..is_needed.len()).filter(|&field| is_needed[field]).collect()
    }

    /// All values of the fields `needed` in `block`, in their order.
    fn compute(
        &self,
        grid: &GridRecord,
        needed: &[usize],
        block: GridBlock,
    ) -> Result<Vec<Vec<f64>>> {
        let own = self.source.hierarchy().fields.len();
        let mut computed: Vec<Vec<f64>> = Vec::with_capacity(needed.len());
        for &field in needed {
            let mut values = vec![0.0; block.len()];
            match field.checked_sub(own) {
                None => self.source.read(grid, field, block, &mut values)?,
                Some(derived) => {
                    let derived = &self.fields[derived];
                    let of =
                        |operand| needed.binary_search(operand).ok().map(|at| &computed[at][..]);
                    let operands: Option<Vec<&[f64]>> = derived.operands.iter().map(of).collect();
                    let lacking = "a derived field lacks one that it is made of";
                    let operands = operands.ok_or_else(|| Error::request(lacking))?;
                    cells::evaluate(&derived.expression, &operands, &mut values);
                }
            }
            computed.push(values);
        }
        Ok(computed)
    }
}

impl Source for Derived<'_> {
    fn about(&self) -> &About {
        &self.about
    }

    fn for_each_grid(&self, visit: &mut dyn FnMut(GridRecord) -> Result<()>) -> Result<()> {
        self.source.for_each_grid(visit)
    }

    fn data_files(&self) -> Result<Vec<PathBuf>> {
        self.source.data_files()
    }

    fn is_computed(&self, field: usize) -> bool {
        field >= self.source.hierarchy().fields.len()
    }

    fn read(
        &self,
        grid: &GridRecord,
        field: usize,
        block: GridBlock,
        out: &mut [f64],
    ) -> Result<()> {
        let Some(derived) = field.checked_sub(self.source.hierarchy().fields.len()) else {
            return self.source.read(grid, field, block, out);
        };
        let needed = self.needed(derived);
        let plane = GridBlock { size: [block.size[0], block.size[1], 1], ..block };
        let planes = (HELD_VALUES / (needed.len() * plane.len().max(1))).max(1);
        for (slab, out) in (0..).step_by(planes).zip(out.chunks_mut(planes * plane.len().max(1))) {
            let mut part = block;
            part.lo[2] += slab;
            part.size[2] = planes.min((block.size[2] - slab) as usize) as u32;
            let computed = self.compute(grid, &needed, part)?;
            if let Some(values) = computed.last() {
                out.copy_from_slice(values);
            }
        }
        Ok(())
    }
}

/// Whether `text` is an expression, and more than a field's name.
pub fn is_expression(text: &str) -> bool {
    Expression::parse(text).is_ok_and(|expression| !expression.is_name())
}

/// The beginning of a definition, as much of it as a message shows.
fn shortened(definition: &str) -> String {
    const SHOWN: usize = 60;
    let shown: String = definition.chars().take(SHOWN).collect();
    let more = if shown.len() < definition.len() { "…" } else { "" };
    format!("{}{more}", shown.escape_debug())
}
