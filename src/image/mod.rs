//! The picture: pixels in memory, and the files they are written to.

mod exr;
mod film;
mod format;
mod png;
mod zip;

pub use exr::{MOST_WRITERS, write_exr};
pub use film::Film;
pub use format::Format;
pub use png::write_png;

#[cfg(test)]
mod tests;
