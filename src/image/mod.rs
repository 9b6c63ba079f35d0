//! The files that pictures are written to.

mod exr;
mod format;
mod png;
mod zip;

pub use exr::write_exr;
pub use format::Format;
pub use png::write_png;

#[cfg(test)]
mod tests;
