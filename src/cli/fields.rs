//! Fields that a user names.

use crate::cache::Cache;
use crate::derive::is_expression;
use crate::{Error, Result};

/// Refuses a field that the cache does not hold. One that may be meant as an expression is told
/// where those are computed: averages and bounds in the cache are those of its fields.
pub(super) fn check(field: &str, cache: &Cache) -> Result<()> {
    let Err(reason) = cache.header().find_field(field) else { return Ok(()) };
    let hint = if is_expression(field) {
        format!(
            "; an expression is computed by `deepfield ingest` with --derive \"NAME={}\", and then \
             shown as NAME",
            field.escape_debug()
        )
    } else {
        String::new()
    };
    Err(Error::request(format!("{}: {reason}{hint}", cache.path().display())))
}
