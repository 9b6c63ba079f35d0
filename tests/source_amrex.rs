//! AMReX plotfiles of real runs, through their reader and through ingest, against facts that
//! independent readers found (`yt_facts.json`).

#![allow(clippy::unwrap_used)] // a test's way to fail

#[path = "support/data.rs"]
mod data;
#[path = "support/facts.rs"]
mod facts;

use deepfield::source::{self, GridRecord, Source};

fn check_set(set: &str) {
    let Some((path, stated)) = facts::load(set, "path") else { return };
    let source = source::open(&path, None).unwrap();
    assert_eq!(source.format(), "amrex");
    facts::check_domain(&*source, &stated);
    facts::check_samples(&*source, &stated);
    check_blocks(&*source);
    for brick in [8, 16, 32] {
        facts::check_cache(&path, &stated, brick);
    }
}

/// Where a cell of a grid stands among its values.
fn offset(grid: &GridRecord, cell: [u32; 3]) -> usize {
    let [nx, ny, _] = grid.size.map(|n| n as usize);
    let [x, y, z] = cell.map(|i| i as usize);
    x + nx * (y + ny * z)
}

/// Blocks of grids hold the same as the whole grids.
fn check_blocks(source: &dyn Source) {
    for grid in facts::grids(source).iter().step_by(17) {
        let whole = facts::read_whole(source, grid, 0);
        let lo = grid.size.map(|n| n / 3);
        let size = [0, 1, 2].map(|a| (3 + a as u32).min(grid.size[a] - lo[a]));
        let block = source::GridBlock { lo, size };
        let mut part = vec![0.0; block.len()];
        source.read(grid, 0, block, &mut part).unwrap();
        let mut part = part.into_iter();
        for z in lo[2]..lo[2] + size[2] {
            for y in lo[1]..lo[1] + size[1] {
                for x in lo[0]..lo[0] + size[0] {
                    let expected = whole[offset(grid, [x, y, z])];
                    assert_eq!(part.next().unwrap().to_bits(), expected.to_bits());
                }
            }
        }
    }
}

#[test]
fn little_endian_doubles() {
    check_set("amrex_adv");
}

#[test]
fn big_endian_floats() {
    check_set("amrex_be32");
}
