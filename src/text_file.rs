//! Short texts that people write: scenes and recipes.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::{Error, Result};

/// The text of the file at `path`, of at most `most` bytes; `what` it is called in messages.
///
/// # Errors
/// A file that cannot be read, is larger, or is not UTF-8.
pub(crate) fn read(path: &Path, what: &str, most: u64) -> Result<String> {
    let mut bytes = Vec::new();
    File::open(path)
        .and_then(|file| file.take(most + 1).read_to_end(&mut bytes))
        .map_err(|error| Error::io(path, format!("cannot read the {what}"), error))?;
    // A text may be cut inside a character: its length comes first.
    if bytes.len() as u64 > most {
        return Err(too_large(&path.display().to_string(), what, most));
    }
    String::from_utf8(bytes).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        Error::invalid(path.display(), format!("not a {what}: byte {at} is not UTF-8 text"))
    })
}

/// A text at `place` of more than `most` bytes.
pub(crate) fn too_large(place: &str, what: &str, most: u64) -> Error {
    Error::invalid(place, format!("larger than {} MiB; a {what} is a short TOML text", most >> 20))
}

#[cfg(test)]
mod tests {
    #[test]
    fn texts_are_short_and_utf_8() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("text");
        let read = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            super::read(&path, "recipe", 1 << 20).map_err(|error| error.to_string())
        };
        assert_eq!(read("a = \"é\"".as_bytes()).unwrap(), "a = \"é\"");
        assert!(read(b"ab\xff").unwrap_err().ends_with("not a recipe: byte 2 is not UTF-8 text"));
        // The limit lies within the last character.
        let cut = [&[b'a'; 1 << 20][..], "é".as_bytes()].concat();
        assert!(read(&cut).unwrap_err().contains("larger than 1 MiB; a recipe is a short"));
        assert_eq!(read(&cut[..1 << 20]).unwrap().len(), 1 << 20);
        let absent = super::read(&folder.path().join("none"), "recipe", 1).unwrap_err().to_string();
        assert!(absent.contains("cannot read the recipe"), "{absent}");
    }
}
