//! Expressions where a field of the cache is due.

use crate::cache::Header;
use crate::derive::is_expression;
use crate::spelling::nearest_first;
use crate::{Error, Result};

/// Refuses a field that the cache does not hold and that may be meant as an expression: averages
/// and bounds in the cache are those of its fields, so an expression is computed at ingest.
pub(super) fn refuse(field: &str, header: &Header) -> Result<()> {
    if header.field(field).is_some() || !is_expression(field) {
        return Ok(());
    }
    let known = nearest_first(field, header.fields.iter().map(|f| f.name.as_str())).join(", ");
    Err(Error::request(format!(
        "the cache holds no field `{0}`: it has {known}; an expression is computed by `deepfield \
         ingest` with --derive \"NAME={0}\", and then shown as NAME",
        field.escape_debug()
    )))
}
