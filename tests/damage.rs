//! Thousands of damaged caches: clear errors, no panic, no huge allocation, no endless walk, and
//! nothing wrong drawn silently. Half of them have all their checksums repaired, so that the
//! damage reaches what lies behind the checksums.

// What tests share fails as a test does.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod forge;

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use std::sync::Mutex;

use deepfield::cache::{BrickEntry, Cache, Decoder, Precision, RawBrick, verify};
use deepfield::ingest::{Options, Progress, ingest};
use deepfield::synth::{self, Recipe};
use forge::allocator::Counting;
use forge::anatomy::Anatomy;
use forge::examine::{Examined, Questions};
use forge::mutation::{Damaged, Expected, Sound};
use forge::noise::Noise;
use forge::payload::{Payload, decompress};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Tests that count memory run one after another.
static ALONE: Mutex<()> = Mutex::new(());

/// A sound cache, and what it answers.
struct Stock {
    name: &'static str,
    sound: Sound,
    questions: Questions,
    examined: Examined,
}

impl Stock {
    fn new(name: &'static str, recipe: &str, options: &Options, folder: &Path) -> Self {
        let recipes = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets_synthetic");
        let recipe = recipes.join(recipe).with_extension("toml");
        let text = std::fs::read_to_string(&recipe).unwrap();
        let output = folder.join(name);
        let recipe = Recipe::parse(&text, recipe.display()).unwrap();
        let written = synth::write(&recipe, &output, &mut |_, _| {}).unwrap();
        let source = deepfield::source::open(&written.input, None).unwrap();
        let cache = folder.join(format!("{name}.dfc"));
        let mut quiet = |_, _, _| {};
        ingest(source.as_ref(), &cache, options, &mut Progress::new(&mut quiet)).unwrap();
        let bytes = std::fs::read(&cache).unwrap();
        let anatomy = Anatomy::read(&bytes);
        let questions = Questions::new("Density");
        let examined = questions.examine(&cache).unwrap();
        assert_eq!(examined.verified, Ok(()), "{name}");
        let errors = examined.answers.iter().filter(|answer| answer.is_err());
        assert_eq!(errors.count(), 0, "{name}: {:?}", examined.answers);
        println!("{name}: {} bricks, {} bytes", anatomy.nodes, bytes.len());
        Self { name, sound: Sound { bytes, anatomy }, questions, examined }
    }
}

fn stocks(folder: &Path) -> Vec<Stock> {
    let fields = ["Density", "Temperature"].map(str::to_owned).to_vec();
    let with = |brick| Options { brick: Some(brick), threads: Some(2), ..Options::default() };
    let two_fields = Options { fields, ..with(8) };
    let dropped = Options { drop_below: Some(2.0), ..with(16) };
    vec![
        Stock::new("two fields", "small", &two_fields, folder),
        Stock::new("dropped", "small", &dropped, folder),
        Stock::new("jumps", "jumps", &with(8), folder),
        Stock::new("factor 4", "factor4", &with(16), folder),
        Stock::new("dropped factor 4", "factor4", &Options { brick: Some(8), ..dropped }, folder),
    ]
}

/// What is wrong with how a damaged cache was met.
fn judge(damaged: &Damaged, examined: &Examined, sound: &Examined) -> Result<(), &'static str> {
    if damaged.expected == Expected::Sound {
        return Ok(());
    }
    if examined.verified.is_ok() {
        return Err("not reported");
    }
    if damaged.expected == Expected::Found && !examined.answers_nothing_else(sound) {
        return Err("wrong answers without an error");
    }
    Ok(())
}

/// What a user is told: one line, and no fault of the program's own.
fn tell(cache: &Path) -> Result<(), String> {
    let mut info = Command::new(env!("CARGO_BIN_EXE_deepfield"));
    let output = info.args(["info", "--json"]).arg(cache).output().map_err(|e| e.to_string())?;
    let said = String::from_utf8_lossy(&output.stderr);
    let clear = said.starts_with("error: ") && said.lines().count() == 1;
    match output.status.code() {
        Some(0) => Ok(()),
        Some(1) if clear && !said.contains("internal fault") => Ok(()),
        _ => Err(format!("info: {}: {said}", output.status)),
    }
}

#[derive(Default)]
struct Tally {
    faults: Vec<String>,
    counts: BTreeMap<String, [usize; 4]>,
    messages: BTreeMap<String, usize>,
}

impl Tally {
    fn count(&mut self, what: &str, examined: &Examined, sound: &Examined) {
        let counts = self.counts.entry(what.to_owned()).or_default();
        counts[0] += 1;
        counts[1] += usize::from(examined.verified.is_err());
        counts[2] += usize::from(examined.answers.is_empty());
        counts[3] += usize::from(examined.answers == sound.answers);
        if let Err(message) = &examined.verified {
            let digits = |c: char| if c.is_ascii_digit() { '#' } else { c };
            let message = message.split(": ").skip(1).collect::<Vec<_>>().join(": ");
            *self.messages.entry(message.chars().map(digits).collect()).or_default() += 1;
        }
    }

    fn print(&self) {
        println!(
            "{:<36}{:>8}{:>10}{:>10}{:>10}",
            "damage", "cases", "reported", "unopened", "same"
        );
        for (what, [cases, reported, unopened, same]) in &self.counts {
            println!("{what:<36}{cases:>8}{reported:>10}{unopened:>10}{same:>10}");
        }
        for (message, count) in &self.messages {
            println!("{count:>6} × {message}");
        }
    }
}

fn attack(rounds: u64) {
    let _alone = ALONE.lock().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let stocks = stocks(folder.path());
    let path = folder.path().join("damaged.dfc");
    let mut tally = Tally::default();
    for round in 0..rounds {
        let mut noise = Noise::new(round);
        let stock = &stocks[noise.below(stocks.len())];
        let other = &stocks[noise.below(stocks.len())].sound;
        let damaged = if round % 2 == 0 {
            stock.sound.forged(&mut noise, other)
        } else {
            stock.sound.damaged(&mut noise)
        };
        std::fs::write(&path, &damaged.bytes).unwrap();
        let examined = stock.questions.examine(&path);
        let examined = examined.and_then(|examined| {
            tally.count(&damaged.what, &examined, &stock.examined);
            judge(&damaged, &examined, &stock.examined)?;
            if round % 32 == 0 { tell(&path) } else { Ok(()) }
        });
        if let Err(fault) = examined {
            tally.faults.push(format!("{round}: {}: {}: {fault}", stock.name, damaged.what));
        }
    }
    tally.print();
    let first = tally.faults.iter().take(40).map(String::as_str).collect::<Vec<_>>();
    assert!(first.is_empty(), "{} faults, as\n{}", tally.faults.len(), first.join("\n"));
}

/// The layout, read and written a second time.
#[test]
fn payloads_are_what_a_second_reader_makes_of_them() {
    let _alone = ALONE.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let folder = tempfile::tempdir().unwrap();
    let mut compared = 0;
    for stock in stocks(folder.path()) {
        let Sound { bytes, anatomy } = &stock.sound;
        let cache = Cache::open(&folder.path().join(format!("{}.dfc", stock.name)), 16).unwrap();
        let all = (0..anatomy.nodes).flat_map(|n| (0..anatomy.fields).map(move |f| (n, f)));
        for (node, field) in all.filter(|&(n, f)| !anatomy.stored(bytes, n, f)[0].is_empty()) {
            let payload = anatomy.payload(bytes, node, field);
            for (stored, raw) in anatomy.stored(bytes, node, field).iter().zip(payload.parts()) {
                // What is left out holds nothing.
                let held = if stored.is_empty() { vec![0; raw.len()] } else { decompress(stored) };
                assert!(held == raw, "{}: brick {node}", stock.name);
            }
            compared += values_are_read(&cache, (node, field), &payload);
            if node % 16 == 0 {
                let parts = payload.compressed();
                let parts = parts.each_ref().map(Vec::as_slice);
                let put = (parts, payload.rounding_errors());
                let path = folder.path().join("again.dfc");
                std::fs::write(&path, anatomy.with_payload(bytes, (node, field), put)).unwrap();
                let report = verify(&Cache::open(&path, 16).unwrap(), &mut |_, _| {}).unwrap();
                assert_eq!(report.listed, [], "{}: brick {node}", stock.name);
            }
        }
    }
    assert!(compared > 100_000, "{compared}");
}

/// Compares what the program reads of a payload, in every precision, and says how many values that is.
fn values_are_read(cache: &Cache, (node, field): (usize, usize), payload: &Payload) -> usize {
    let (mut cursor, mut decoder) = (cache.cursor(), Decoder::new().unwrap());
    let mut brick = RawBrick::default();
    let number = node as u64;
    let node_record = cursor.node(number).unwrap();
    let record = cursor.field(number, field).unwrap();
    assert_eq!(record.errors, payload.rounding_errors());
    let mut compared = 0;
    for precision in Precision::FEWER.into_iter().chain([Precision::Full]) {
        let entry =
            BrickEntry { node: number, field, node_record: &node_record, field_record: &record };
        cache.read_brick(&entry, precision, &mut decoder, &mut brick).unwrap();
        let cells = brick.blocks.iter().flat_map(|block| block.values.iter().zip(&block.states));
        let values = payload.values(precision.last_part() + 1);
        for (((value, bits), other), state) in cells.zip(values).zip(&payload.states) {
            let exists = bits & 1 == 1;
            let other = if exists { other.clamp(record.own[0], record.own[1]) } else { 0.0 };
            assert!(bits == state && *value == other, "brick {node}: {value} {other}");
            compared += 1;
        }
    }
    compared
}

/// Children are numbered one behind the other: of a record that cannot be read nobody knows how many
/// it has, which is no fault of those that follow.
#[test]
fn an_unreadable_record_is_reported_where_it_is() {
    let _alone = ALONE.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let folder = tempfile::tempdir().unwrap();
    let options = Options { brick: Some(8), threads: Some(2), ..Options::default() };
    let Stock { sound: Sound { bytes, anatomy }, .. } =
        Stock::new("unreadable", "small", &options, folder.path());
    let number = |node: usize, name: &str| {
        let numbers = anatomy.node_numbers(node);
        numbers.iter().find(|number| number.name == name).unwrap().at
    };
    let is_parent = |node: usize| bytes[number(node, "child mask")] != 0;
    let parent = |node: usize| &bytes[number(node, "parent")..][..8];
    let first = (1..anatomy.nodes - 1)
        .find(|&n| is_parent(n) && is_parent(n + 1) && parent(n) == parent(n + 1));
    let mut forged = bytes.clone();
    forged[number(first.unwrap(), "octant")] = 8;
    anatomy.seal(&mut forged);
    let path = folder.path().join("forged.dfc");
    std::fs::write(&path, forged).unwrap();
    let report = verify(&Cache::open(&path, 16).unwrap(), &mut |_, _| {}).unwrap();
    let reasons: Vec<_> = report.listed.iter().map(|damage| damage.reason.as_str()).collect();
    assert!(!reasons.is_empty());
    let others = reasons.iter().filter(|reason| reason.contains("out of order"));
    assert_eq!(others.count(), 0, "{reasons:?}");
}

/// Beside coarser bricks such a payload would be drawn with a seam.
#[test]
fn a_payload_without_its_ancestors_is_reported() {
    let _alone = ALONE.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let folder = tempfile::tempdir().unwrap();
    let options = Options { brick: Some(8), threads: Some(2), ..Options::default() };
    let Stock { sound: Sound { bytes, anatomy }, .. } =
        Stock::new("alone", "small", &options, folder.path());
    let stored = |node: &usize| !anatomy.stored(&bytes, *node, 0)[0].is_empty();
    let alone = |node: usize| Some((node, anatomy.payload(&bytes, node, 0).alone()?));
    let (node, alone) = (1..anatomy.nodes).filter(stored).find_map(alone).unwrap();
    let parts = alone.compressed();
    let put = (parts.each_ref().map(Vec::as_slice), alone.rounding_errors());
    let mut forged = anatomy.with_payload(&bytes, (node, 0), put);
    Anatomy::read(&forged).forget_parents(&mut forged, node, 0);
    let path = folder.path().join("forged.dfc");
    std::fs::write(&path, forged).unwrap();
    let report = verify(&Cache::open(&path, 16).unwrap(), &mut |_, _| {}).unwrap();
    let reasons: Vec<_> = report.listed.iter().map(|damage| damage.reason.as_str()).collect();
    assert!(reasons.len() == 1 && reasons[0].contains("ancestors' blocks"), "{reasons:?}");
}

#[test]
fn damaged_caches_are_refused() {
    attack(300);
}

#[test]
#[ignore = "takes minutes"]
fn ten_thousand_damaged_caches_are_refused() {
    attack(10_000);
}
