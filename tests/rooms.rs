//! Rooms know only the rooms before them ("Data flow" in `docs/ARCHITECTURE.md`).

#![allow(clippy::unwrap_used)] // a test's way to fail

use std::path::{Path, PathBuf};

/// The program's rooms in this order; what is not among them stands beside the line and knows none.
const ROOMS: [&str; 11] = [
    "space", "source", "derive", "cache", "ingest", "paging", "scene", "render", "image", "synth",
    "cli",
];
/// The folders of `render`; what lies beside them makes a picture and may know them all.
const RENDER: [&str; 7] = ["camera", "transfer", "brick", "bounds", "march", "plan", "tiles"];

#[test]
fn rooms_know_only_those_before_them() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    for file in sources(&src) {
        let text = without_tests(&std::fs::read_to_string(&file).unwrap());
        let path = file.strip_prefix(&src).unwrap();
        let parts: Vec<String> =
            path.with_extension("").iter().map(|x| x.display().to_string()).collect();
        if parts[0] == "lib" || parts[0] == "main" {
            continue;
        }
        let place = rank(&ROOMS, &parts[0]);
        for known in named(&text, "crate::") {
            let known_place = rank(&ROOMS, known);
            assert!(
                known_place.is_none() || known_place <= place,
                "{} knows {known}",
                path.display()
            );
        }
        let Some(place) = (parts[0] == "render").then(|| rank(&RENDER, parts.get(1)?)).flatten()
        else {
            continue;
        };
        for known in named(&text, "crate::render::") {
            let before = rank(&RENDER, known).is_some_and(|known| known <= place);
            assert!(before, "{} knows render::{known}", path.display());
        }
    }
}

fn rank(rooms: &[&str], name: &str) -> Option<usize> {
    rooms.iter().position(|room| *room == name)
}

/// The names that follow `path` in a text, alone or in braces.
fn named<'t>(text: &'t str, path: &str) -> Vec<&'t str> {
    let word = |rest: &'t str| {
        rest.trim_start().split(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap()
    };
    let several = |rest: &'t str| match rest.strip_prefix('{') {
        Some(list) => outermost(list).into_iter().map(word).collect(),
        None => vec![word(rest)],
    };
    text.split(path).skip(1).flat_map(several).collect()
}

/// The parts between the commas of a list up to its closing brace; braces within hold lists of their own.
fn outermost(list: &str) -> Vec<&str> {
    let (mut depth, mut start, mut parts) = (1, 0, Vec::new());
    for (at, c) in list.char_indices() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            _ => {}
        }
        if depth == 0 || depth == 1 && c == ',' {
            parts.push(&list[start..at]);
            start = at + 1;
        }
        if depth == 0 {
            break;
        }
    }
    parts
}

#[test]
fn names_are_found_alone_and_in_braces() {
    let text = "use crate::cache::{A, B};\nuse crate::{Error, source};\nlet x = crate::scene::Y;";
    assert_eq!(named(text, "crate::"), ["cache", "Error", "source", "scene"]);
    let nested = "use crate::{cache::{A, b::{C, D}}, cli, scene::{E}};\nuse crate::paging::F;";
    assert_eq!(named(nested, "crate::"), ["cache", "cli", "scene", "paging"]);
}

/// All sources below `folder` but those of tests alone.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let found = entries
        .filter(|path| !path.ends_with("testing"))
        .flat_map(|path| if path.is_dir() { sources(&path) } else { vec![path] });
    found.filter(|path| path.extension().is_some_and(|x| x == "rs") && !is_test(path)).collect()
}

fn is_test(path: &Path) -> bool {
    path.file_stem().is_some_and(|stem| stem.to_string_lossy().ends_with("tests"))
}

/// The text up to its module of tests, which may know whatever they need.
fn without_tests(text: &str) -> String {
    text.split("#[cfg(test)]\nmod tests {").next().unwrap().to_owned()
}
