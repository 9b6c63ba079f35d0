//! The brick cache: one file, laid out as `docs/FORMAT.md` says, byte by byte.
//!
//! [`Writer`] makes it, [`Cache`] reads it. The cache knows levels, bricks and fields; it knows
//! neither simulation formats nor cameras.

mod brick;
pub(crate) mod bytes;
mod check;
mod checksum;
mod codec;
mod digits;
mod header;
mod index;
mod largest;
mod lorenzo;
pub mod parts;
mod reader;
mod record;
mod verify;
#[allow(unsafe_code)]
mod window;
mod writer;

pub use brick::{Block, BrickPlace, BrickShape, Inside, RawBrick, state, visit_outside};
pub use codec::{Decoder, Encoder, Payload};
pub use digits::{PARTS, Precision};
pub use header::{CachedField, Header, MAX_FIELDS, TreeLevel};
pub(crate) use index::PAGE_BYTES;
pub use index::{Cursor, WINDOW_BYTES};
pub use largest::{LeafCell, largest_leaf};
pub use reader::Cache;
pub(crate) use record::EMPTY_RANGE;
pub use record::{BrickEntry, FieldRecord, NodeRecord};
pub use verify::{Damage, Part, Report, verify};
pub use writer::Writer;
