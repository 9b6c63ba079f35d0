//! What a user may do about values that cannot be taken.

use crate::source::Source;

/// How to bring the values of field `field` of `source` between bounds; `bounded` writes them around
/// what is bounded.
pub(super) fn to_limit(source: &dyn Source, field: usize, bounded: fn(&str) -> String) -> String {
    let name = source.hierarchy().fields[field].name.escape_debug().to_string();
    if source.is_computed(field) {
        // Every derived field is stored: a second one, of the first, would leave that as it is.
        return format!("limit its own expression, as in --derive '{name} = {}'", bounded("…"));
    }
    let limited = bounded(&format!("{{{name}}}"));
    format!("limit them as you ingest, as in --derive 'limited = {limited}' --field limited")
}
