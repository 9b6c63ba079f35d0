//! Tests of the picture files.

use std::fs::{self, File};
use std::io::BufReader;
use std::path::Path;

use super::*;
use crate::Result;
use crate::atomic_file::AtomicFile;
use crate::render::Film;

fn film(width: u32, height: u32) -> Film {
    let mut film = Film::new(width, height).unwrap();
    let pixels: Vec<[f32; 4]> = (0..width * height)
        .map(|n| [n as f32 * 1e-3, 1.0 / (n as f32 + 1.0), n as f32 * -1e30, (n % 7) as f32 / 7.0])
        .collect();
    film.write_rectangle(0, 0, width, &pixels).unwrap();
    film
}

fn attributes() -> Vec<(String, String)> {
    [("scene", "[camera]\nα = \"ü\""), ("cacheChecksum", "00ff"), ("stats", "{}"), ("empty", "")]
        .map(|(name, text)| (name.to_owned(), text.to_owned()))
        .to_vec()
}

fn file(path: &Path) -> AtomicFile {
    AtomicFile::create(path).unwrap()
}

#[test]
fn exr_reads_back_as_written() {
    let directory = tempfile::tempdir().unwrap();
    for (width, height) in [(1, 1), (37, 16), (5, 33), (300, 50), (4097, 3)] {
        let (path, film) = (directory.path().join("a.exr"), film(width, height));
        write_exr(file(&path), &film, &attributes(), 3).unwrap();
        let image = ::exr::prelude::read_first_flat_layer_from_file(&path).unwrap();
        let layer = &image.layer_data;
        assert_eq!((layer.size.0, layer.size.1), (width as usize, height as usize));
        for (channel, (name, place)) in
            layer.channel_data.list.iter().zip([("A", 3), ("B", 2), ("G", 1), ("R", 0)])
        {
            assert_eq!(channel.name.to_string(), name);
            assert!(!channel.quantize_linearly, "{name}");
            let read: Vec<f32> = channel.sample_data.values_as_f32().collect();
            let written: Vec<f32> = film.pixels().iter().map(|pixel| pixel[place]).collect();
            assert_eq!(read, written, "{name}");
        }
        let white = image.attributes.chromaticities.unwrap().white;
        assert_eq!((white.0, white.1), (0.3127, 0.329));
        let other = &layer.attributes.other;
        for (name, text) in attributes() {
            let found = other.iter().find(|(key, _)| key.to_string() == name).unwrap().1;
            let ::exr::prelude::AttributeValue::Text(found) = found else { panic!("{name}") };
            assert_eq!(found.as_slice(), text.as_bytes(), "{name}");
        }
    }
}

#[test]
fn equal_pixels_give_equal_bytes() {
    let directory = tempfile::tempdir().unwrap();
    let film = film(64, 40);
    let bytes = |name: &str, write: &dyn Fn(&Path) -> Result<()>| {
        let path = directory.path().join(name);
        write(&path).unwrap();
        fs::read(&path).unwrap()
    };
    let exr = |path: &Path| write_exr(file(path), &film, &attributes(), 1);
    let together = |path: &Path| write_exr(file(path), &film, &attributes(), 2);
    let png = |path: &Path| write_png(file(path), &film, 0.5, [0.1; 3]);
    for _ in 0..5 {
        assert_eq!(bytes("a.exr", &exr), bytes("b.exr", &together));
        assert_eq!(bytes("a.png", &png), bytes("b.png", &png));
    }
}

#[test]
fn attribute_names_that_readers_do_not_take_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.exr");
    let long = "n".repeat(32);
    for names in [vec![""], vec!["a", "a"], vec!["ü"], vec!["a\0b"], vec![long.as_str()]] {
        let attributes: Vec<_> =
            names.iter().map(|name| (String::from(*name), String::new())).collect();
        assert!(write_exr(file(&path), &film(2, 2), &attributes, 1).is_err(), "{names:?}");
    }
    assert!(fs::read_dir(directory.path()).unwrap().next().is_none());
}

#[test]
fn png_values_by_hand() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.png");
    let mut film = Film::new(3, 2).unwrap();
    let pixels = [
        [0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 1.0],
        [0.107_020_57, 0.001, 9.0, 1.0],
        [0.05, 0.0, 0.0, 0.5],
        [f32::NAN, -1.0, f32::INFINITY, 1.0],
        [0.5, 0.25, 0.125, 1.0],
    ];
    film.write_rectangle(0, 0, 3, &pixels).unwrap();
    write_png(file(&path), &film, 1.0, [0.1, 0.2, 0.5]).unwrap();
    let decoder = ::png::Decoder::new(BufReader::new(File::open(&path).unwrap()));
    let mut reader = decoder.read_info().unwrap();
    assert!(reader.info().srgb.is_some());
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut bytes).unwrap();
    // Doubled linear values: 0.2, 0.4, 1 (background); 0.21404 is sRGB ½; 0.002 is in the linear
    // part (12.92·0.002·255 = 6.6); (0.05 + ½·0.1)·2 = 0.2, ½·0.2·2 = 0.2, ½·0.5·2 = 0.5.
    let expected =
        [[124, 170, 255], [0, 0, 0], [128, 7, 255], [124, 124, 188], [0, 0, 255], [255, 188, 137]];
    assert_eq!(bytes, expected.concat());
}
