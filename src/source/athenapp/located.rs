//! The `.athdf` file behind what the user named.

use std::io::Read;
use std::path::{Path, PathBuf};

use crate::{Error, Result, regular_file};

/// Bytes of an `.xdmf` that are looked at: it names its file in the first block's geometry.
const MOST_BYTES: u64 = 1 << 16;
/// What an `.xdmf` puts behind the file's name, before an object in it.
const NAME_END: &str = ".athdf:/";

/// The data file: `path` itself, or the one that an `.xdmf` there names, in the same folder.
///
/// # Errors
/// A file that cannot be read, or an `.xdmf` that names none.
pub(super) fn data_file(path: &Path) -> Result<PathBuf> {
    let mut bytes = Vec::new();
    regular_file::open(path)
        .and_then(|file| file.take(MOST_BYTES).read_to_end(&mut bytes))
        .map_err(|e| Error::io(path, "cannot read", e))?;
    let text = String::from_utf8_lossy(&bytes);
    if !text.contains("<Xdmf") {
        return Ok(path.to_path_buf());
    }
    let name = named(&text).ok_or_else(|| {
        Error::invalid(path.display(), "names no .athdf file: open that file itself")
    })?;
    Ok(path.with_file_name(name))
}

/// The file name (without folders) in `… name.athdf:/dataset …`.
fn named(text: &str) -> Option<&str> {
    let end = text.find(NAME_END)? + NAME_END.len() - ":/".len();
    let name = text[..end].rsplit(['>', '"', '/', '\n', '\t', ' ']).next()?;
    (name.len() > ".athdf".len()).then_some(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_xdmf_leads_to_the_file_that_it_names() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("any.name");
        let text = "<?xml version=\"1.0\" ?>\n<Xdmf Version=\"2.0\">\n<DataItem Format=\"HDF\" \
                    NumberType=\"Float\">run.out1.00001.athdf:/x1f</DataItem>";
        std::fs::write(&path, text).unwrap();
        assert_eq!(data_file(&path).unwrap(), folder.path().join("run.out1.00001.athdf"));
        std::fs::write(&path, "<Xdmf> .athdf:/x1f").unwrap();
        assert!(data_file(&path).unwrap_err().to_string().contains("names no .athdf"));
        std::fs::write(&path, "\u{89}HDF run.athdf:/x1f").unwrap();
        assert_eq!(data_file(&path).unwrap(), path);
        assert!(data_file(folder.path()).is_err());
    }
}
