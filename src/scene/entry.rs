//! Access to the tables and values of a TOML text, with errors that name place, line and key.

use std::ops::Range;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::space::Decimal;
use crate::spelling::nearest;
use crate::{Error, Result};

/// A TOML text and where it comes from.
#[derive(Clone, Copy)]
pub(super) struct Text<'a> {
    /// Where the text comes from, for messages: a path.
    pub(super) place: &'a str,
    /// The text itself.
    pub(super) source: &'a str,
}

impl Text<'_> {
    /// An error in the line that holds byte `offset`.
    pub(super) fn error(&self, offset: usize, reason: impl Into<String>) -> Error {
        let before = &self.source.as_bytes()[..offset.min(self.source.len())];
        let line = 1 + before.iter().filter(|byte| **byte == b'\n').count();
        Error::invalid(format_args!("{}:{line}", self.place), reason)
    }
}

/// A table of the text whose keys are all known.
#[derive(Clone, Copy)]
pub(super) struct Table<'a> {
    text: Text<'a>,
    /// The table's name as it is written in the text, such as `[camera]`; empty for the text as a
    /// whole.
    name: &'a str,
    start: usize,
    entries: &'a DeTable<'a>,
}

impl<'a> Table<'a> {
    /// The table `entries` that begins at byte `start`.
    ///
    /// # Errors
    /// A key that is not one of `known`: the first in the text is named, with the nearest known.
    pub(super) fn new(
        text: Text<'a>,
        name: &'a str,
        start: usize,
        entries: &'a DeTable<'a>,
        known: &[&str],
    ) -> Result<Self> {
        let unknown = entries.keys().filter(|key| !known.contains(&key.get_ref().as_ref()));
        if let Some(key) = unknown.min_by_key(|key| key.span().start) {
            let suggestion = nearest(key.get_ref(), known.iter().copied()).unwrap_or_default();
            let place = if name.is_empty() { String::new() } else { format!(" in {name}") };
            let reason = format!(
                "unknown key `{}`{place}; did you mean `{suggestion}`? (known: {})",
                shown(key.get_ref()),
                known.join(", ")
            );
            return Err(text.error(key.span().start, reason));
        }
        Ok(Self { text, name, start, entries })
    }

    /// The entry of `key`, if the text has it.
    pub(super) fn get(&self, key: &'a str) -> Option<Entry<'a>> {
        let value = self.entries.get(key)?;
        Some(Entry { text: self.text, table: self.name, key, value })
    }

    /// The entry of `key`.
    ///
    /// # Errors
    /// The text does not have it.
    pub(super) fn required(&self, key: &'a str) -> Result<Entry<'a>> {
        self.get(key).ok_or_else(|| {
            let place = if self.name.is_empty() { "the scene" } else { self.name };
            self.text.error(self.start, format!("{place} needs the key `{key}`"))
        })
    }
}

/// One value of a table, or an element of a list there.
#[derive(Clone, Copy)]
pub(super) struct Entry<'a> {
    text: Text<'a>,
    table: &'a str,
    key: &'a str,
    value: &'a Spanned<DeValue<'a>>,
}

impl<'a> Entry<'a> {
    /// An error about this value: names its line and key.
    pub(super) fn error(&self, reason: impl std::fmt::Display) -> Error {
        let place =
            if self.table.is_empty() { String::new() } else { format!(" in {}", self.table) };
        self.text.error(self.span().start, format!("`{}`{place}: {reason}", self.key))
    }

    fn span(&self) -> Range<usize> {
        self.value.span()
    }

    fn expected(&self, what: &str) -> Error {
        self.error(format_args!("expected {what}, found {}", kind(self.value.get_ref())))
    }

    /// This value as the table called `name`, with keys of `known` only.
    pub(super) fn table(&self, name: &'a str, known: &[&str]) -> Result<Table<'a>> {
        match self.value.get_ref() {
            DeValue::Table(entries) => {
                Table::new(self.text, name, self.span().start, entries, known)
            }
            _ => Err(self.expected("a table")),
        }
    }

    /// The elements of a list.
    pub(super) fn elements(&self) -> Result<Vec<Entry<'a>>> {
        match self.value.get_ref() {
            DeValue::Array(list) => Ok(list.iter().map(|value| Entry { value, ..*self }).collect()),
            _ => Err(self.expected("a list")),
        }
    }

    /// The elements of a list of exactly `N`.
    pub(super) fn exactly<const N: usize>(&self) -> Result<[Entry<'a>; N]> {
        let elements = self.elements()?;
        let count = elements.len();
        elements
            .try_into()
            .map_err(|_| self.error(format_args!("expected a list of {N}, found {count}")))
    }

    /// A list of `N` numbers.
    pub(super) fn numbers<const N: usize>(&self) -> Result<[f64; N]> {
        let mut numbers = [0.0; N];
        for (number, entry) in numbers.iter_mut().zip(self.exactly::<N>()?) {
            *number = entry.number()?;
        }
        Ok(numbers)
    }

    /// A string.
    pub(super) fn string(&self) -> Result<&'a str> {
        match self.value.get_ref() {
            DeValue::String(text) => Ok(text.as_ref()),
            _ => Err(self.expected("a string")),
        }
    }

    /// The text of a number or of a string.
    pub(super) fn number_or_string(&self) -> Result<&'a str> {
        match self.value.get_ref() {
            DeValue::String(text) => Ok(text.as_ref()),
            _ => self.digits().ok_or_else(|| self.expected("a number or a string")),
        }
    }

    /// A finite number: the double nearest to the decimal as written.
    pub(super) fn number(&self) -> Result<f64> {
        let digits = self.digits().ok_or_else(|| self.expected("a number"))?;
        match digits.parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            _ => Err(self.error(format_args!("{} is not a finite number", shown(digits)))),
        }
    }

    /// A whole number of `range`.
    pub(super) fn whole(&self, range: Range<u32>) -> Result<u32> {
        match self.value.get_ref() {
            DeValue::Integer(number) => u32::from_str_radix(number.as_str(), number.radix())
                .ok()
                .filter(|number| range.contains(number))
                .ok_or_else(|| {
                    self.error(format_args!("must be from {} to {}", range.start, range.end - 1))
                }),
            _ => Err(self.expected("a whole number")),
        }
    }

    /// A number or a decimal string, exactly.
    pub(super) fn decimal(&self) -> Result<Decimal> {
        let digits = self.number_or_string()?;
        Decimal::parse(digits).map_err(|error| self.error(error))
    }

    /// One of the words of `choices`, with what it stands for.
    pub(super) fn choice<T: Copy>(&self, choices: &[(&str, T)]) -> Result<T> {
        let word = self.string()?;
        if let Some((_, meaning)) = choices.iter().find(|(name, _)| *name == word) {
            return Ok(*meaning);
        }
        let names = || choices.iter().map(|(name, _)| *name);
        Err(self.error(format_args!(
            "unknown value `{}`; did you mean `{}`? (known: {})",
            shown(word),
            nearest(word, names()).unwrap_or_default(),
            names().collect::<Vec<_>>().join(", ")
        )))
    }

    /// The digits of a number as written, underscores removed. Hexadecimal, octal and binary
    /// numbers are not decimals and give nothing.
    fn digits(&self) -> Option<&'a str> {
        match self.value.get_ref() {
            DeValue::Integer(number) if number.radix() == 10 => Some(number.as_str()),
            DeValue::Float(number) => Some(number.as_str()),
            _ => None,
        }
    }
}

fn kind(value: &DeValue<'_>) -> &'static str {
    match value {
        DeValue::String(_) => "a string",
        DeValue::Integer(number) if number.radix() != 10 => "a number that is not decimal",
        DeValue::Integer(_) => "a whole number",
        DeValue::Float(_) => "a number",
        DeValue::Boolean(_) => "true or false",
        DeValue::Datetime(_) => "a date",
        DeValue::Array(_) => "a list",
        DeValue::Table(_) => "a table",
    }
}

/// Foreign text fit for a message of one line.
pub(super) fn shown(text: &str) -> String {
    text.chars().take(40).flat_map(char::escape_debug).collect()
}
