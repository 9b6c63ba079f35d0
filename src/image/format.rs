//! Which kind of picture file a name asks for.

use std::path::Path;

use crate::{Error, Result};

/// The kinds of picture file that are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// OpenEXR: linear radiance, 32-bit float.
    Exr,
    /// PNG: 8-bit sRGB over the background.
    Png,
}

impl Format {
    /// The kind that the extension of `path` names, without regard to case.
    ///
    /// # Errors
    /// Another extension, or none.
    pub fn from_path(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let extension = path.extension().map(|name| name.to_string_lossy().to_lowercase());
        match extension.as_deref() {
            Some("exr") => Ok(Self::Exr),
            Some("png") => Ok(Self::Png),
            _ => Err(Error::request(format!(
                "{}: the name of a picture must end in .exr or .png",
                path.display()
            ))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_extension_decides() {
        assert_eq!(Format::from_path("a/b.png.exr").unwrap(), Format::Exr);
        assert_eq!(Format::from_path("A.PNG").unwrap(), Format::Png);
        for name in ["a", "a.jpg", "exr", ".png", "a.exr.gz", ""] {
            let message = Format::from_path(name).unwrap_err().to_string();
            assert!(message.contains(".exr or .png"), "{message}");
        }
    }
}
