//! The newcomer's run, and that the README shows what it makes.

// What tests share fails as a test does.
#![allow(clippy::unwrap_used, clippy::panic)]

mod support;

use std::ffi::OsStr;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use support::program::run;

/// Most that a channel of a PNG may be apart, of 255: what rounds another way with other lanes.
const ROUNDED: u8 = 1;

/// Width, height and channels of all pixels.
fn pixels(path: &Path) -> (u32, u32, Vec<u8>) {
    let file = File::open(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let mut reader = png::Decoder::new(BufReader::new(file)).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    bytes.truncate(info.buffer_size());
    (info.width, info.height, bytes)
}

#[test]
fn the_demo_makes_the_pictures_that_the_readme_shows() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let readme = std::fs::read_to_string(root.join("README.md")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("demo");
    let words: [&dyn AsRef<OsStr>; 2] = [&"demo", &target];
    let told = run(&words).done();
    for view in ["outside", "inside"] {
        let name = format!("docs/demo-{view}.png");
        assert!(readme.contains(&name));
        let [shown, made] =
            [root.join(name), target.join(format!("{view}.png"))].map(|path| pixels(&path));
        assert_eq!((shown.0, shown.1), (made.0, made.1), "{view}");
        let apart = shown.2.iter().zip(&made.2).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(apart.unwrap() <= ROUNDED, "{view}: {apart:?} of 255");
    }
    // Rows of the table that no machine changes.
    for row in ["levels", "cells", "bricks in the cache", "deepest level drawn"] {
        let row = |text: &str| -> String {
            let line = text.lines().find(|line| line.starts_with(row));
            line.unwrap_or_else(|| panic!("no row {row}")).trim_end().into()
        };
        assert_eq!(row(&told), row(&readme));
    }
}
