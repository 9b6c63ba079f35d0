//! Runs that are killed, refused or in each other's way: nothing half-written is left, and a user
//! is told in one line.

// What tests share fails as a test does.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod support;

use std::fs::File;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use deepfield::cache::{Cache, Header};
use support::program::{end, names, run, start, written};
use support::synth;

const SCENE: &str = "[image]\nwidth = 24\nheight = 16\n[camera]\nposition = [0.45, 0.4, -1.2]\n\
                     look_at = [0.45, 0.45, 0.4]\n[[volume]]\nfield = \"density\"\n[render]\nsamples = 1\n";

/// A folder with the data set `name` in it.
fn data(name: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let source = synth(name, folder.path()).unwrap();
    (folder, source)
}

fn is_root() -> bool {
    let id = Command::new("id").arg("-u").output();
    id.is_ok_and(|output| output.stdout.trim_ascii() == b"0")
}

#[test]
fn a_killed_ingest_leaves_nothing_that_the_next_does_not_clean() {
    let (folder, source) = data("jumps");
    let target = folder.path().join("out/cache.dfc");
    std::fs::create_dir(folder.path().join("out")).unwrap();
    let arguments: [&dyn AsRef<std::ffi::OsStr>; 5] =
        [&"ingest", &source, &"-o", &target, &"--brick=8"];
    let began = Instant::now();
    run(&arguments).done();
    let whole = began.elapsed();
    let sound = std::fs::read(&target).unwrap();
    std::fs::remove_file(&target).unwrap();
    let mut killed = 0;
    for twentieth in 1..20 {
        let mut child = start(&arguments);
        std::thread::sleep(whole * twentieth / 20);
        let _ = child.kill();
        killed += u32::from(child.wait().unwrap().code().is_none());
        if target.exists() {
            assert!(std::fs::read(&target).unwrap() == sound, "a cache that is not whole");
            std::fs::remove_file(&target).unwrap();
        }
        let left = names(&folder.path().join("out"));
        assert!(left.iter().all(|name| name == ".cache.dfc.deepfield-partial"), "{left:?}");
    }
    assert!(killed >= 5, "only {killed} runs were killed before they ended");
    run(&arguments).done();
    assert_eq!(names(&folder.path().join("out")), ["cache.dfc"]);
    assert!(std::fs::read(&target).unwrap() == sound, "an ingest after killed ones differs");
}

#[test]
fn a_signal_leaves_nothing_and_ends_as_signals_do() {
    let (folder, source) = data("jumps");
    let out = folder.path().join("out");
    std::fs::create_dir(&out).unwrap();
    let partial = out.join(".cache.dfc.deepfield-partial");
    let arguments: [&dyn AsRef<std::ffi::OsStr>; 5] =
        [&"ingest", &source, &"-o", &out.join("cache.dfc"), &"--brick=8"];
    // What the tests were started to ignore, runs of theirs ignore as well.
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:")).unwrap();
    let ignored = u64::from_str_radix(ignored.trim(), 16).unwrap();
    let signals = [
        ("HUP", 1),
        ("INT", 2),
        ("QUIT", 3),
        ("USR1", 10),
        ("USR2", 12),
        ("TERM", 15),
        ("XCPU", 24),
    ];
    for (name, number) in signals.into_iter().filter(|(_, n)| ignored >> (n - 1) & 1 == 0) {
        // A run may be over before the signal comes.
        let heard = (0..50).any(|_| {
            let mut child = start(&arguments);
            while !partial.exists() && child.try_wait().unwrap().is_none() {}
            let kill = Command::new("kill").args(["-s", name, &child.id().to_string()]).output();
            kill.unwrap();
            let status = child.wait().unwrap();
            assert!(status.signal() == Some(number) || status.success(), "{status} of SIG{name}");
            let left = names(&out);
            let expected = if status.success() { vec!["cache.dfc"] } else { vec![] };
            assert_eq!(left, expected, "SIG{name}");
            left.iter().for_each(|name| std::fs::remove_file(out.join(name)).unwrap());
            !status.success()
        });
        assert!(heard, "no run was ended by SIG{name}");
    }
}

#[test]
fn a_signal_ends_the_commands_that_a_demo_runs() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("demo");
    let simulation = target.join("simulation");
    let mut demo = start(&[&"demo", &target]);
    while !simulation.exists() || names(&simulation).is_empty() {
        assert!(demo.try_wait().unwrap().is_none(), "the demo ended before it wrote anything");
    }
    let kill = Command::new("kill").args(["-s", "TERM", &demo.id().to_string()]).output();
    kill.unwrap();
    assert_eq!(demo.wait().unwrap().signal(), Some(15));
    // The command clears up for itself, which may take it a moment longer.
    let told = Instant::now();
    while !names(&simulation).is_empty() {
        assert!(told.elapsed().as_secs() < 20, "{:?} is left", names(&simulation));
    }
}

#[test]
fn signals_that_are_ignored_stay_so_and_files_too_large_are_told() {
    let (folder, source) = data("jumps");
    let cache = folder.path().join("cache.dfc");
    let shell = |script: &str| {
        let mut shell = Command::new("sh");
        shell.args(["-c", script, env!("CARGO_BIN_EXE_deepfield")]).arg(&source).arg(&cache);
        shell.output().unwrap()
    };
    // As `nohup` starts it.
    let partial = folder.path().join(".cache.dfc.deepfield-partial");
    let script = format!(
        "trap '' HUP; \"$0\" ingest \"$1\" -o \"$2\" --brick=8 & until [ -e '{}' ] || [ -e \"$2\" ]; do :; done; \
         kill -s HUP $!; wait $!",
        partial.display()
    );
    assert!(shell(&script).status.success());
    assert_eq!(names(folder.path()).iter().filter(|name| name.contains("cache")).count(), 1);
    std::fs::remove_file(&cache).unwrap();
    let limited = shell("ulimit -f 8; \"$0\" ingest \"$1\" -o \"$2\" --brick=8");
    let line = String::from_utf8(limited.stderr).unwrap();
    assert_eq!(limited.status.code(), Some(1), "{line}");
    assert!(line.starts_with("error: ") && line.contains("File too large"), "{line}");
    assert!(!partial.exists() && !cache.exists());
}

#[test]
fn a_dump_is_found_by_its_bare_name() {
    let (folder, source) = data("small");
    for name in [source.clone(), source.with_extension("hierarchy")] {
        let name = name.file_name().unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_deepfield"));
        command.current_dir(source.parent().unwrap()).arg("ingest").arg(name);
        let output = command.arg("-o").arg(folder.path().join("cache.dfc")).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
}

#[test]
fn a_folder_of_several_dumps_asks_for_one() {
    let (folder, _) = data("small");
    synth("jumps", folder.path()).unwrap();
    let both = folder.path().join("both");
    std::fs::create_dir(&both).unwrap();
    for (set, name) in [("small", "a"), ("jumps", "b")] {
        let dumps = names(&folder.path().join(set));
        std::fs::rename(folder.path().join(set).join(&dumps[0]), both.join(name)).unwrap();
    }
    let line = run(&[&"info", &both]).failed();
    assert!(line.contains("holds 2 Enzo dumps"), "{line}");
}

/// Values that f32 holds are not given up for one that it does not.
#[test]
fn magnitudes_that_floats_do_not_hold_together_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let ingested = |rest: f64, peak: f64| {
        let recipe = format!(
            "[domain]\nleft = [0.0, 0.0, 0.0]\nright = [1.0, 1.0, 1.0]\nroot = [16, 16, 16]\n\
             [refinement]\nmax_level = 0\n[[density]]\nkind = \"constant\"\nvalue = {rest:e}\n\
             [[density]]\nkind = \"gaussian\"\ncentre = [0.4, 0.5, 0.6]\npeak = {peak:e}\nsigma = 0.02\n"
        );
        let recipe = written(folder.path(), "recipe.toml", &recipe);
        let set = folder.path().join(format!("{rest:e}"));
        run(&[&"synth", &recipe, &"-o", &set]).done();
        run(&[&"ingest", &set, &"-o", &folder.path().join("cache.dfc")])
    };
    let line = ingested(1.5, 1e100).failed();
    assert!(line.contains("`Density`: magnitudes from 1.5e0 to"), "{line}");
    assert!(!folder.path().join("cache.dfc").exists());
    // As the message says.
    let set = folder.path().join("1.5e0");
    let limited = ["--derive", "limited = min({Density}, 1e30)", "--field", "limited"];
    let limited = limited.each_ref().map(|word| word as &dyn AsRef<std::ffi::OsStr>);
    let cache = folder.path().join("limited.dfc");
    run(&[&[&"ingest" as &dyn AsRef<_>, &set, &"-o", &cache][..], &limited].concat()).done();
    let ended = ingested(1e-60, 1.0);
    assert!(ended.stderr.contains("Density: values below 1.2e-38 are held with fewer digits"));
    ended.done();
    assert_eq!(ingested(1e-30, 1e30).stderr, "");
}

#[test]
fn a_failed_ingest_leaves_the_cache_that_was_there() {
    let (folder, source) = data("small");
    let target = folder.path().join("cache");
    run(&[&"ingest", &source, &"-o", &target]).done();
    let (sound, before) = (std::fs::read(&target).unwrap(), names(folder.path()));
    let data = source.with_extension("cpu0000");
    let length = std::fs::metadata(&data).unwrap().len();
    File::options().write(true).open(&data).unwrap().set_len(length / 2).unwrap();
    let line = run(&[&"ingest", &source, &"-o", &target]).failed();
    assert!(line.contains("cpu0000"), "{line}");
    assert!(std::fs::read(&target).unwrap() == sound);
    assert_eq!(names(folder.path()), before);
}

/// A cache of several index pages with `spoil`ed bytes, and what `verify` prints of it.
fn verified(spoil: impl Fn(&Header, &mut [u8])) -> (String, String) {
    let (folder, source) = data("jumps");
    let target = folder.path().join("cache.dfc");
    run(&[&"ingest", &source, &"-o", &target, &"--brick=8", &"--derive=twice=2*Density"]).done();
    let mut bytes = std::fs::read(&target).unwrap();
    spoil(Cache::open(&target, 16).unwrap().header(), &mut bytes);
    std::fs::write(&target, bytes).unwrap();
    let ended = run(&[&"verify", &target]);
    (ended.stdout.clone(), ended.failed())
}

#[test]
fn a_damaged_index_page_is_one_place() {
    const PAGE: usize = 64 << 10;
    let damaged = |page: fn(&Header) -> usize| {
        let (told, error) = verified(|header, bytes| {
            assert!(header.index_pages > 1 && header.levels.len() > 2);
            bytes[header.index_offset as usize + page(header) * PAGE + PAGE / 2] ^= 1;
        });
        assert_eq!(told.matches("index page").count(), 1, "{told}");
        assert!(error.contains("1 damaged place:"), "{error}");
        told
    };
    // What lies above the last page's bricks needs that too.
    let told = damaged(|header| header.index_pages as usize - 1);
    assert!(told.contains("bricks cannot be reached: damaged pages of the index hold"), "{told}");
    assert!(told.contains("no field is undamaged; still renders: views that need none"), "{told}");
    assert!(told.contains("(1 in the index)"), "{told}");
    // Nothing is reached without the root.
    let told = damaged(|_| 0);
    let all = told.split_once(" bricks, ").unwrap().0.rsplit(' ').next().unwrap();
    assert!(told.contains(&format!("\n{all} of {all} bricks cannot be reached: ")), "{told}");
    assert!(told.contains("nothing can be rendered"), "{told}");
}

#[test]
fn damaged_padding_takes_no_field_away() {
    let (told, error) = verified(|header, bytes| bytes[header.index_offset as usize - 1] ^= 1);
    assert!(told.contains("damaged: the padding before the index is not empty"), "{told}");
    assert!(told.contains("still renders: everything (1 outside all bricks)"), "{told}");
    assert!(!told.contains("reached") && error.contains("1 damaged place:"), "{told}");
}

#[test]
fn a_second_ingest_to_the_same_target_is_refused() {
    let (folder, source) = data("jumps");
    let target = folder.path().join("cache.dfc");
    let partial = folder.path().join(".cache.dfc.deepfield-partial");
    let first = start(&[&"ingest", &source, &"-o", &target, &"--brick=8", &"--threads=1"]);
    let began = Instant::now();
    while !partial.exists() && began.elapsed() < Duration::from_secs(30) {
        std::thread::sleep(Duration::from_millis(1));
    }
    let line = run(&[&"ingest", &source, &"-o", &target]).failed();
    assert!(line.contains("another process is writing"), "{line}");
    end(first).done();
    run(&[&"verify", &target]).done();
}

#[test]
fn targets_and_sources_that_cannot_be_are_named() {
    let (folder, source) = data("small");
    let before = names(folder.path());
    let to = |target: &Path| run(&[&"ingest", &source, &"-o", &target]).failed();
    assert!(to(&folder.path().join("no/such/cache.dfc")).contains("no/such/cache.dfc"));
    assert!(to(folder.path()).contains("is a directory"));
    assert!(to(Path::new("/dev/full")).contains("not a regular file"));
    let target = folder.path().join("cache.dfc");
    let from = |source: &Path| run(&[&"ingest", &source, &"-o", &target]).failed();
    assert!(from(&folder.path().join("absent")).contains("absent"));
    assert!(from(&written(folder.path(), "text", "no output")).contains("known format"));
    std::fs::remove_file(folder.path().join("text")).unwrap();
    let line = run(&[&"ingest", &source, &"-o", &source]).failed();
    assert!(line.contains("is the input itself"), "{line}");
    let line = run(&[&"ingest", &source, &"-o", &target, &"--field=densty"]).failed();
    assert!(line.contains("densty") && line.contains("Density"), "{line}");
    assert_eq!(names(folder.path()), before);
}

#[test]
fn what_is_read_is_not_written_over() {
    let (folder, source) = data("small");
    let cache = folder.path().join("cache.dfc");
    for _ in 0..2 {
        run(&[&"ingest", &source, &"-o", &cache]).done();
    }
    for suffix in ["cpu0000", "hierarchy"] {
        let file = source.with_extension(suffix);
        let before = std::fs::read(&file).unwrap();
        let line = run(&[&"ingest", &source, &"-o", &file]).failed();
        assert!(line.contains("is one of the input's files"), "{line}");
        assert!(std::fs::read(&file).unwrap() == before, "{suffix}");
    }
    let data = source.with_extension("cpu0001");
    let before = std::fs::read(&data).unwrap();
    let other = folder.path().join("other.dfc");
    let line = run(&[&"ingest", &source, &"-o", &other, &"--stats", &data]).failed();
    assert!(line.contains("is one of the input's files") && !other.exists(), "{line}");
    assert!(std::fs::read(&data).unwrap() == before);
    let line = run(&[&"ingest", &source, &"-o", &cache, &"--stats", &cache]).failed();
    assert!(line.contains("is named for the stats and for the cache"), "{line}");
    let scene = written(folder.path(), "scene.toml", SCENE);
    let picture = folder.path().join("picture.exr");
    let sound = [&cache, &scene].map(|file| std::fs::read(file).unwrap());
    for stats in [&cache, &scene, &picture] {
        let line = run(&[&"render", &cache, &scene, &"-o", &picture, &"--stats", stats]).failed();
        assert!(line.contains("is named for the"), "{line}");
    }
    assert!([&cache, &scene].map(|file| std::fs::read(file).unwrap()) == sound);
    assert!(!picture.exists());
}

#[test]
fn what_cannot_be_written_is_told_before_the_work() {
    let (folder, source) = data("small");
    let [cache, other] = ["cache.dfc", "other.dfc"].map(|name| folder.path().join(name));
    let nowhere = folder.path().join("no/stats.json");
    run(&[&"ingest", &source, &"-o", &cache]).done();
    let line = run(&[&"ingest", &source, &"-o", &other, &"--stats", &nowhere]).failed();
    assert!(line.contains("no/stats.json") && !other.exists(), "{line}");
    let scene = written(folder.path(), "scene.toml", SCENE);
    let picture = folder.path().join("picture.exr");
    let line = run(&[&"render", &cache, &scene, &"-o", &picture, &"--stats", &nowhere]).failed();
    assert!(line.contains("no/stats.json") && !picture.exists(), "{line}");
    // Before anything is read: there is no such scene.
    let nowhere = folder.path().join("no/picture.exr");
    let line = run(&[&"render", &cache, &"no-scene.toml", &"-o", &nowhere]).failed();
    assert!(line.contains("no/picture.exr"), "{line}");
}

#[test]
fn a_pipe_is_no_input() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("pipe");
    let Ok(made) = Command::new("mkfifo").arg(&pipe).status() else {
        return eprintln!("skipped: there is no `mkfifo`");
    };
    assert!(made.success());
    for words in [["info", "--json"], ["verify", "--"]] {
        let line = run(&[&words[0], &words[1], &pipe]).failed();
        assert!(
            line.contains("pipe: is neither a file") || line.contains("is not a regular file"),
            "{line}"
        );
    }
}

#[test]
fn folders_and_files_without_permission_are_named() {
    use std::os::unix::fs::PermissionsExt;
    if is_root() {
        return eprintln!("skipped: root may read and write everything");
    }
    let (folder, source) = data("small");
    let closed = folder.path().join("closed");
    std::fs::create_dir(&closed).unwrap();
    std::fs::set_permissions(&closed, std::fs::Permissions::from_mode(0o555)).unwrap();
    let line = run(&[&"ingest", &source, &"-o", &closed.join("cache")]).failed();
    assert!(line.contains("closed/cache"), "{line}");
    let data = source.with_extension("cpu0000");
    std::fs::set_permissions(&data, std::fs::Permissions::from_mode(0o000)).unwrap();
    let line = run(&[&"ingest", &source, &"-o", &folder.path().join("cache")]).failed();
    assert!(line.contains("cpu0000"), "{line}");
    // What tells the format.
    std::fs::set_permissions(&source, std::fs::Permissions::from_mode(0o000)).unwrap();
    for input in [source.as_path(), source.parent().unwrap()] {
        let line = run(&[&"info", &input]).failed();
        let name = source.file_name().unwrap().to_str().unwrap();
        assert!(line.contains(name) && line.contains("ermission denied"), "{line}");
    }
}

/// A file system of `kibibytes`, gone when dropped.
struct SmallDisk(PathBuf);

impl SmallDisk {
    fn new(folder: &Path, kibibytes: u32) -> Option<Self> {
        std::fs::create_dir_all(folder).unwrap();
        let mut mount = Command::new("mount");
        mount.args(["-t", "tmpfs", "-o", &format!("size={kibibytes}k"), "tmpfs"]).arg(folder);
        let mounted = mount.stderr(Stdio::null()).status().is_ok_and(|status| status.success());
        mounted.then(|| Self(folder.to_path_buf()))
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(&self.0).status();
    }
}

#[test]
fn a_full_disk_is_told_and_left_empty() {
    let (folder, source) = data("small");
    let cache = folder.path().join("cache.dfc");
    run(&[&"ingest", &source, &"-o", &cache]).done();
    let scene = written(folder.path(), "scene.toml", SCENE);
    for kibibytes in [64, 256, 448] {
        let Some(disk) = SmallDisk::new(&folder.path().join("disk"), kibibytes) else {
            return eprintln!("skipped: no small file system can be mounted");
        };
        let target = disk.0.join("cache.dfc");
        let line = run(&[&"ingest", &source, &"-o", &target]).failed();
        assert!(line.contains("No space left"), "{line}");
        assert_eq!(names(&disk.0), [""; 0]);
        if kibibytes == 64 {
            let wide = SCENE.replace("width = 24\nheight = 16", "width = 400\nheight = 300");
            let wide = written(folder.path(), "wide.toml", &wide);
            let picture = disk.0.join("picture.exr");
            let line = run(&[&"render", &cache, &wide, &"-o", &picture]).failed();
            assert!(line.contains("No space left"), "{line}");
            let stats = disk.0.join("no/stats.json");
            let picture = folder.path().join("picture.exr");
            run(&[&"render", &cache, &scene, &"-o", &picture, &"--stats", &stats]).failed();
            assert_eq!(names(&disk.0), [""; 0]);
        }
    }
}

#[test]
fn a_reader_that_goes_away_is_no_fault_and_a_full_device_is() {
    let (folder, source) = data("small");
    let cache = folder.path().join("cache.dfc");
    run(&[&"ingest", &source, &"-o", &cache]).done();
    for command in ["info", "verify"] {
        let mut child = start(&[&command, &cache]);
        drop(child.stdout.take());
        let ended = end(child);
        assert_eq!((ended.code, ended.stderr.as_str()), (Some(0), ""), "{command}");
        let mut child = Command::new(env!("CARGO_BIN_EXE_deepfield"));
        let full = File::options().write(true).open("/dev/full").unwrap();
        let output = child.arg(command).arg(&cache).stdout(full).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{command}");
        assert!(said.starts_with("error: ") && said.contains("No space left"), "{said}");
    }
}

#[test]
fn statistics_go_where_the_process_prints() {
    let (folder, source) = data("small");
    let (log, cache) = (folder.path().join("job.log"), folder.path().join("out.dfc"));
    let script = "(echo before; \"$0\" ingest \"$1\" -o \"$2\" --stats /dev/stdout; echo after) > \"$3\"; \
                  \"$0\" ingest \"$1\" -o \"$2\" --stats /dev/stdout | cat; \
                  \"$0\" ingest \"$1\" -o \"$2\" --stats /dev/null; \
                  \"$0\" ingest \"$1\" -o /dev/stdout >> \"$3\"";
    let mut shell = Command::new("sh");
    shell.args(["-c", script, env!("CARGO_BIN_EXE_deepfield")]).args([&source, &cache, &log]);
    let ended = shell.output().unwrap();
    let said = String::from_utf8(ended.stderr).unwrap();
    assert!(said.starts_with("error: /dev/stdout: ") && said.lines().count() == 1, "{said}");
    let logged = std::fs::read_to_string(&log).unwrap();
    let whole = logged.starts_with("before\n") && logged.ends_with("\nafter\n");
    assert!(whole && logged.contains("wall_seconds"), "{logged}");
    assert!(String::from_utf8(ended.stdout).unwrap().contains("wall_seconds"));
}

#[test]
fn wrong_usage_is_told_apart_from_failures() {
    let wrong: [&[&dyn AsRef<std::ffi::OsStr>]; 7] = [
        &[&"frobnicate"],
        &[&"ingest", &"input"],
        &[&"ingest", &"input", &"-o", &"cache", &"--memory", &"much"],
        &[&"ingest", &"input", &"-o", &"cache", &"--threads", &"0"],
        &[&"render", &"cache"],
        &[&"probe", &"cache", &"--field", &"density"],
        &[&"info", &"one", &"two"],
    ];
    for arguments in wrong {
        let ended = run(arguments);
        assert_eq!(ended.code, Some(2), "{ended:?}");
        assert!(ended.stdout.is_empty() && ended.stderr.starts_with("error: "), "{ended:?}");
    }
}

#[test]
fn pictures_scenes_and_points_that_cannot_be_are_refused() {
    let (folder, source) = data("small");
    let cache = folder.path().join("cache.dfc");
    run(&[&"ingest", &source, &"-o", &cache]).done();
    let render = |scene: &str, picture: &str| {
        let scene = written(folder.path(), "scene.toml", scene);
        let picture = folder.path().join(picture);
        let line = run(&[&"render", &cache, &scene, &"-o", &picture]).failed();
        assert!(!picture.exists());
        line
    };
    let line = render(SCENE, "picture.jpg");
    assert!(line.contains("picture.jpg") && line.contains(".png"), "{line}");
    for (wrong, line_number, hint) in [
        (SCENE.replace("width", "widht"), ":2:", "width"),
        (SCENE.replace("look_at", "lookat"), ":6:", "look_at"),
        (SCENE.replace("[[volume]]", "[[volumes]]"), ":7:", "volume"),
        (SCENE.replace("24", "0"), ":2:", "width"),
    ] {
        let line = render(&wrong, "picture.exr");
        let told = line.contains("scene.toml") && line.contains(line_number) && line.contains(hint);
        assert!(told, "{line}");
    }
    let line = render(&SCENE.replace("density", "densty"), "picture.exr");
    assert!(line.contains("densty") && line.contains("Density"), "{line}");
    let probe = |text: &str| {
        let points = written(folder.path(), "points.csv", text);
        run(&[&"probe", &cache, &"--field=density", &"--points", &points]).failed()
    };
    assert!(probe("").contains("points.csv"));
    assert!(probe("a,b,c\n0,0,0\n").contains("x,y,z"));
    assert!(probe("x,y,z\n0,0,0\n0.5,zero,0\n").contains("line 3"));
    assert!(probe("x,y,z\n0,0\n").contains("points.csv"));
    assert!(probe("x,y,z\n0,0,\"\n").contains("line"));
    let line = run(&[&"probe", &cache, &"--field=density", &"--points=/dev/zero"]).failed();
    assert!(line.contains("/dev/zero") && line.contains("longer than"), "{line}");
    // Lines between quotes are one, and so they count.
    let line = probe(&format!("x,y,z\n\"{}", "0\n".repeat(1 << 20)));
    assert!(line.contains("longer than"), "{line}");
    assert!(probe("x,y,z\n\"0\",\"0\"\n").contains("line 2"));
}
