//! The memory limit: the smallest that works is named and works, the picture does not depend on
//! it, and the process stays under it.

// What tests share fails as a test does.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod support;

use std::path::{Path, PathBuf};

use support::program::{Ended, run, written};
use support::synth;

const MEBIBYTE: u64 = 1 << 20;
/// What the program itself may take beyond its limit.
const ITSELF: u64 = 48 * MEBIBYTE;

struct Picture<'c> {
    cache: &'c Path,
    scene: PathBuf,
    picture: PathBuf,
    stats: PathBuf,
}

impl<'c> Picture<'c> {
    fn new(cache: &'c Path, folder: &Path, interpolation: &str) -> Self {
        let scene = format!(
            "[image]\nwidth = 96\nheight = 64\n[camera]\nposition = [0.45, 0.4, -0.9]\n\
             look_at = [0.45, 0.45, 0.4]\n[render]\ninterpolation = \"{interpolation}\"\n\
             tolerance = 0\nsamples = 1\n[[volume]]\nfield = \"density\"\nscale = \"log10\"\n"
        );
        Self {
            cache,
            scene: written(folder, &format!("{interpolation}.toml"), &scene),
            picture: folder.join("picture.exr"),
            stats: folder.join("stats.json"),
        }
    }

    fn render(&self, memory: &str, threads: u32) -> Ended {
        let threads = format!("--threads={threads}");
        let output = [&"-o" as &dyn AsRef<_>, &self.picture, &"--stats", &self.stats];
        let limits = [&"--memory" as &dyn AsRef<_>, &memory, &threads];
        let what = [&"render" as &dyn AsRef<_>, &self.cache, &self.scene];
        run(&[&what[..], &output, &limits].concat())
    }

    fn pixels(&self) -> Vec<u32> {
        let (_, _, pixels) = support::read_exr(&self.picture).unwrap();
        pixels.iter().flatten().map(|value| value.to_bits()).collect()
    }

    /// The smallest limit that works, MiB, as an error names it.
    fn smallest(&self, memory: &str, threads: u32) -> u64 {
        let line = self.render(memory, threads).failed();
        let named = line.split("smallest that works is ").nth(1);
        named.and_then(|rest| rest.split("MiB").next()?.parse().ok()).expect(&line)
    }

    /// Pixels under a limit that works, which the process keeps.
    fn within(&self, mebibytes: u64, threads: u32) -> Vec<u32> {
        let ended = self.render(&format!("{mebibytes}MiB"), threads);
        let limit = mebibytes * MEBIBYTE + ITSELF;
        assert!(ended.peak <= limit, "{} of {limit} bytes", ended.peak);
        ended.done();
        let stats = std::fs::read_to_string(&self.stats).unwrap();
        let stats: serde_json::Value = serde_json::from_str(&stats).unwrap();
        assert!(stats["peak_rss_bytes"].as_u64().unwrap() <= limit, "{stats}");
        assert_eq!(stats["memory_limit_bytes"], mebibytes * MEBIBYTE);
        self.pixels()
    }
}

fn caches(folder: &Path) -> [PathBuf; 2] {
    [("small", "8"), ("jumps", "16")].map(|(name, brick)| {
        let source = synth(name, folder).unwrap();
        let cache = folder.join(format!("{name}.dfc"));
        run(&[&"ingest", &source, &"-o", &cache, &"--brick", &brick]).done();
        cache
    })
}

#[test]
fn the_smallest_limit_is_named_works_and_gives_the_same_picture() {
    let folder = tempfile::tempdir().unwrap();
    for cache in caches(folder.path()) {
        for interpolation in ["cell", "linear"] {
            let picture = Picture::new(&cache, folder.path(), interpolation);
            let plenty = picture.within(4096, 2);
            assert!(plenty.iter().any(|&bits| bits != 0), "a black picture shows nothing");
            for threads in [1, 2] {
                let smallest = picture.smallest("1MiB", threads);
                let below = format!("{}MiB", smallest - 1);
                assert_eq!(picture.smallest(&below, threads), smallest);
                let same = picture.within(smallest, threads) == plenty;
                assert!(same, "{}: {interpolation}: {threads} threads", cache.display());
            }
        }
    }
}

#[test]
fn files_of_one_picture_are_the_same_whatever_it_took() {
    let folder = tempfile::tempdir().unwrap();
    let source = synth("small", folder.path()).unwrap();
    let cache = folder.path().join("cache.dfc");
    run(&[&"ingest", &source, &"-o", &cache, &"--brick=8"]).done();
    for extension in ["exr", "png"] {
        let mut picture = Picture::new(&cache, folder.path(), "linear");
        picture.picture.set_extension(extension);
        let text = std::fs::read_to_string(&picture.scene).unwrap();
        for settings in ["tolerance = 0\nsamples = 1", "tolerance = \"5%\"\nsamples = \"area\""] {
            let text = text.replace("tolerance = 0\nsamples = 1", settings);
            std::fs::write(&picture.scene, text).unwrap();
            let smallest = format!("{}MiB", picture.smallest("1MiB", 1));
            let mut files = [("1GiB", 2), ("64MiB", 3), (smallest.as_str(), 1)].map(|took| {
                picture.render(took.0, took.1).done();
                std::fs::read(&picture.picture).unwrap()
            });
            files.sort();
            assert!(files[0] == files[2], "{extension}: {settings}");
        }
    }
}

#[test]
fn ingest_names_its_smallest_limit_and_gives_the_same_cache() {
    let folder = tempfile::tempdir().unwrap();
    let source = synth("jumps", folder.path()).unwrap();
    let target = folder.path().join("cache.dfc");
    let with = |memory: &str, threads: &str| {
        run(&[&"ingest", &source, &"-o", &target, &"--memory", &memory, &"--threads", &threads])
    };
    let line = with("1KiB", "1").failed();
    let named = line.split_whitespace().find_map(|word| word.strip_suffix("MiB"));
    let smallest: u64 = named.and_then(|number| number.parse().ok()).expect(&line);
    with(&format!("{}MiB", smallest - 1), "1").failed();
    let mut caches = Vec::new();
    for (mebibytes, threads) in [(smallest, "1"), (smallest, "2"), (1024, "2")] {
        // This set is too small to reach any limit: `tests/memory.rs` counts bytes of larger ones.
        with(&format!("{mebibytes}MiB"), threads).done();
        caches.push(std::fs::read(&target).unwrap());
    }
    assert!(caches.windows(2).all(|pair| pair[0] == pair[1]), "the cache depends on the limit");
}
