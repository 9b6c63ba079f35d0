//! `cargo bench --bench codec`: what it costs to take payloads apart and to put them together on one
//! thread, without compression, in GB/s of values.
//!
//! Each figure is the best of several rounds over a brick that stays in the core's cache.

use std::hint::black_box;
use std::time::Instant;

use deepfield::cache::parts::{Joiner, Splitter};
use deepfield::cache::{Block, PARTS, RawBrick, state};

/// Cells along the edges of a brick of 16³ cells with ghosts and of its parent's block.
const SIDES: [usize; 2] = [18, 10];
const TIMES: usize = 1000;
const ROUNDS: usize = 7;

fn main() {
    // `cargo test --benches` asks for nothing but a sign of life.
    if std::env::args().any(|argument| argument == "--test") {
        return;
    }
    let brick = RawBrick { blocks: SIDES.map(block).to_vec() };
    let (mut splitter, mut joiner) = (Splitter::default(), Joiner::default());
    let mut parts: [Vec<u8>; PARTS] = Default::default();
    report("split", &mut || splitter.split(black_box(&brick), &mut parts));
    let mut joined = brick.clone();
    for read in 1..=PARTS {
        let mut some = [&[][..]; PARTS];
        for (some, part) in some.iter_mut().zip(&parts).take(read) {
            *some = part;
        }
        let name = format!("join, {read} of {PARTS} parts");
        report(&name, &mut || assert_eq!(joiner.join(black_box(some), &mut joined), Ok(())));
    }
    assert_eq!(joined, brick);
    report("copy", &mut || {
        for (to, from) in joined.blocks.iter_mut().zip(black_box(&brick).blocks.iter()) {
            to.values.copy_from_slice(&from.values);
        }
    });
}

fn block(side: usize) -> Block {
    let values = (0..side.pow(3)).map(|n| (n as f32 * 0.011).sin() + 2.0).collect();
    Block { side, values, states: vec![state::EXISTS; side.pow(3)] }
}

fn report(name: &str, run: &mut dyn FnMut()) {
    let bytes = 4 * SIDES.map(|side| side.pow(3)).iter().sum::<usize>();
    let mut best = f64::INFINITY;
    for _ in 0..ROUNDS {
        let started = Instant::now();
        (0..TIMES).for_each(|_| run());
        best = best.min(started.elapsed().as_secs_f64());
    }
    println!("{name:<18}{:>8.2} GB/s", (bytes * TIMES) as f64 / best / 1e9);
}
