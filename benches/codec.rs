//! `cargo bench --bench codec`: what byte planes cost to split and to join on one thread, in GB/s of
//! values.
//!
//! Each figure is the best of several rounds over blocks that stay in the core's cache.

use std::hint::black_box;
use std::time::Instant;

use deepfield::cache::planes;

/// Values of a brick of 16³ cells with ghosts and its parent's block.
const VALUES: usize = 18 * 18 * 18 + 10 * 10 * 10;
const TIMES: usize = 2000;
const ROUNDS: usize = 7;

fn main() {
    // `cargo test --benches` asks for nothing but a sign of life.
    if std::env::args().any(|argument| argument == "--test") {
        return;
    }
    let values: Vec<f32> = (0..VALUES).map(|n| (n as f32 * 0.011).sin() + 2.0).collect();
    let mut bytes = vec![0; 4 * VALUES];
    let mut joined = vec![0.0_f32; VALUES];
    report("split", &mut || split(black_box(&values), &mut bytes));
    split(&values, &mut bytes);
    for join in [join, plain] {
        joined.fill(0.0);
        join(&bytes, &mut joined);
        assert!(
            values.iter().zip(&joined).all(|(value, joined)| value.to_bits() == joined.to_bits())
        );
    }
    report("join", &mut || join(black_box(&bytes), &mut joined));
    report("join, plain twin", &mut || plain(black_box(&bytes), &mut joined));
    report("copy", &mut || joined.copy_from_slice(black_box(&values)));
}

fn split(values: &[f32], bytes: &mut [u8]) {
    let (low, high) = bytes.split_at_mut(2 * VALUES);
    let ((a, b), (c, d)) = (low.split_at_mut(VALUES), high.split_at_mut(VALUES));
    planes::split(values, [a, b, c, d]);
}

fn join(bytes: &[u8], values: &mut [f32]) {
    let plane = |n: usize| &bytes[n * VALUES..(n + 1) * VALUES];
    planes::join([plane(0), plane(1), plane(2), plane(3)], values);
}

/// Value by value, as a compiler that finds no better way would.
fn plain(bytes: &[u8], values: &mut [f32]) {
    for (n, value) in values.iter_mut().enumerate() {
        let byte = |plane: usize| black_box(bytes[plane * VALUES + n]);
        let bits = u32::from_le_bytes([byte(0), byte(1), byte(2), byte(3)]);
        // The lower half, and the lowest byte, count as negative from their middles on.
        let bits = bits.wrapping_sub((bits & 0x8000) << 1);
        *value = f32::from_bits(bits.wrapping_sub((bits & 0x80) << 1));
    }
}

fn report(name: &str, run: &mut dyn FnMut()) {
    let mut best = f64::INFINITY;
    for _ in 0..ROUNDS {
        let started = Instant::now();
        (0..TIMES).for_each(|_| run());
        best = best.min(started.elapsed().as_secs_f64());
    }
    println!("{name:<18}{:>8.2} GB/s", (4 * VALUES * TIMES) as f64 / best / 1e9);
}
