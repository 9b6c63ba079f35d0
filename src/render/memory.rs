//! The memory plan of a picture: what everything takes, and how many bricks the rest holds.

use std::num::NonZero;

use crate::cache::{BrickShape, Cache, Cursor, PAGE_BYTES, WINDOW_BYTES};
use crate::paging::{Budget, Counters, FORMS, MEBIBYTE, Pool, Reservation};
use crate::render::RenderOptions;
use crate::render::brick::load::{BrickLoader, BrickScratch};
use crate::render::brick::scaled::ScaledBrick;
use crate::render::brick::thin::Thinner;
use crate::render::camera::rays::PixelGrid;
use crate::render::film::Film;
use crate::render::renderer::TILE_BYTES;
use crate::render::tiles::ray_batch::RayBatch;
use crate::render::tiles::refine::TilePixels;
use crate::render::transfer::pieces::TransferPieces;
use crate::render::transfer::shading::Shading;
use crate::render::transfer::table::TransferTable;
use crate::scene::Interpolation;
use crate::spelling::size;
use crate::{Error, Result};

/// Stack of every thread, bytes; `STACK_TOUCHED` of it at most become resident.
pub(crate) const STACK_BYTES: usize = 2 << 20;
/// What a thread uses of its stack, and its allocator's own, bytes.
const STACK_TOUCHED: u64 = 256 << 10;
/// Most reader threads: more do not decompress faster than the marching threads consume.
const MAX_READERS: usize = 4;
/// Slots of the smallest pool for bricks read ahead, for each marching thread.
const AHEAD_SLOTS: usize = 2;
/// Most threads that compress a picture that is written.
pub const MOST_WRITERS: usize = 4;
/// Memory per pixel of a row that writing a picture takes at a time: 16 rows of 16 bytes, raw, in
/// between, and compressed, for which there is room to be grown once.
const WRITING_PER_COLUMN: u64 = 4 * 16 * 16;
/// The rest of what writing takes, on each thread.
const WRITING_FIXED: u64 = 1 << 20;
/// Index windows beyond the fewest, threads beyond one that write, and thinner bricks, take at most
/// this part of what is left.
const EXTRA_SHARE: u64 = 8;
/// Bricks of which a thread keeps thinner ones, at most: as many as rays of a tile may meet, with
/// some to spare.
const MOST_THINNED: u64 = 512;

/// How a picture divides its memory limit. The fewest bytes depend on picture, cache and threads
/// only, never on the limit.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct MemoryPlan {
    /// Threads that march.
    pub threads: usize,
    /// Threads that read ahead.
    pub readers: usize,
    /// Index windows that may be mapped at a time.
    pub windows: usize,
    /// Slots of the brick pool.
    pub slots: usize,
    /// Threads that write the picture.
    pub writers: usize,
    /// Bricks of which each marching thread may keep thinner ones.
    pub thinned: usize,
    /// What takes how much, bytes.
    parts: Vec<(&'static str, u64)>,
}

/// What a plan is made from.
#[derive(Debug, Clone, Copy)]
struct Demand {
    width: u32,
    height: u32,
    tiles: u64,
    threads: u64,
    readers: u64,
    /// Levels of the tree.
    levels: u64,
    /// Bricks in the cache.
    bricks: u64,
    /// The transfer function.
    transfer: u64,
    /// Windows that hold the whole index, and bytes of its page checksums.
    index_windows: u64,
    page_table: u64,
    /// One thread's decoder and buffers; and its rays and what it marches them by.
    scratch: u64,
    tile: u64,
    /// A slot with a brick of the largest kind; and thinner ones of such, 0 where there are none.
    slot: u64,
    thinned: u64,
    /// Whether all bricks stay.
    resident: bool,
}

/// Bytes that a brick of `shape` with `blocks` blocks takes while it is loaded.
pub(crate) fn loaded_bytes(shape: BrickShape, blocks: usize, interpolation: Interpolation) -> u64 {
    let overhead = Pool::<BrickLoader<'_>>::slot_overhead() + size_of::<ScaledBrick>() as u64;
    ScaledBrick::bytes(shape, blocks, interpolation) + overhead
}

impl MemoryPlan {
    /// The plan of a picture of `pixels` that shows `shading` of `cache`, within the limit of
    /// `options`.
    ///
    /// # Errors
    /// A limit that is too small: the message names the smallest that works, in MiB.
    pub(crate) fn new(
        cache: &Cache,
        shading: &Shading,
        pixels: &PixelGrid,
        options: &RenderOptions<'_>,
    ) -> Result<Self> {
        let (header, interpolation) = (cache.header(), shading.interpolation);
        let transfer = transfer_bytes(shading.transfer.knots().len());
        let blocks = usize::from(header.max_parent_blocks) + 1;
        let index_bytes = header.index_pages.saturating_mul(PAGE_BYTES as u64);
        let demand = |threads: usize| Demand {
            width: pixels.view().width(),
            height: pixels.view().height(),
            tiles: pixels.tiles(),
            threads: threads.max(1) as u64,
            readers: threads.clamp(1, MAX_READERS) as u64,
            levels: header.levels.len() as u64,
            bricks: header.nodes(),
            transfer,
            index_windows: index_bytes.div_ceil(WINDOW_BYTES),
            page_table: header.index_pages.saturating_mul(8),
            scratch: BrickScratch::bytes(cache),
            tile: RayBatch::bytes(header.shape, blocks, interpolation) + TilePixels::BYTES,
            slot: loaded_bytes(header.shape, blocks, interpolation),
            thinned: match interpolation {
                Interpolation::Linear => Thinner::bytes_kept(header.shape),
                Interpolation::Cell => 0,
            },
            resident: options.resident,
        };
        let cores = || std::thread::available_parallelism().map_or(1, NonZero::get);
        let threads =
            options.threads.unwrap_or_else(|| most_threads(cores(), options.memory, demand));
        Self::from_demand(&demand(threads), options.memory)
    }

    fn from_demand(demand: &Demand, limit: u64) -> Result<Self> {
        let Demand { threads, readers, bricks, .. } = *demand;
        // A thread pins a brick a level on its way down, and fills one more.
        let per_thread = demand.levels + 1 + AHEAD_SLOTS as u64;
        let fewest_slots = threads.saturating_mul(per_thread).saturating_add(readers);
        let fewest_slots = if demand.resident { u64::MAX } else { fewest_slots };
        // Threads may need one brick in several forms at a time.
        let forms = if demand.resident { 1 } else { FORMS as u64 };
        let different = bricks.max(1).saturating_mul(forms);
        let fewest_slots = fewest_slots.min(different);
        let fewest_windows = threads.saturating_mul(Cursor::WINDOWS as u64).saturating_add(1);
        let mut parts = fixed_parts(demand);
        let fixed = parts.iter().fold(0u64, |sum, part| sum.saturating_add(part.1));
        let fewest = fixed
            .saturating_add(fewest_windows.saturating_mul(WINDOW_BYTES))
            .saturating_add(fewest_slots.saturating_mul(demand.slot));
        let left = limit.checked_sub(fewest).ok_or_else(|| too_small(limit, fewest, threads))?;
        let useful = demand.index_windows.saturating_sub(fewest_windows);
        let more_windows = useful.min(left / EXTRA_SHARE / WINDOW_BYTES);
        let left = left - more_windows * WINDOW_BYTES;
        let more_writers =
            (threads.min(MOST_WRITERS as u64) - 1).min(left / EXTRA_SHARE / writing(demand));
        let left = left - more_writers * writing(demand);
        let room = (left / EXTRA_SHARE / threads).checked_div(demand.thinned).unwrap_or(0);
        let thinned = room.min(MOST_THINNED).min(bricks);
        let left = left - thinned * threads * demand.thinned;
        let more_slots = (left / demand.slot.max(1)).min(different.saturating_sub(fewest_slots));
        let (windows, slots) = (fewest_windows + more_windows, fewest_slots + more_slots);
        parts.push(("the index", windows * WINDOW_BYTES));
        parts.push(("the brick pool", slots * demand.slot));
        parts.push(("writing on more threads", more_writers * writing(demand)));
        parts.push(("bricks in fewer cells", thinned * threads * demand.thinned));
        let count = |n: u64| usize::try_from(n).unwrap_or(usize::MAX);
        Ok(Self {
            threads: count(threads),
            readers: count(readers),
            windows: count(windows),
            slots: count(slots),
            writers: 1 + count(more_writers),
            thinned: count(thinned),
            parts,
        })
    }

    /// Takes everything from `budget`, until the reservations are dropped.
    ///
    /// # Errors
    /// A budget in which something else has been reserved already.
    pub(crate) fn reserve(&self, budget: &Budget) -> Result<Vec<Reservation>> {
        self.parts.iter().map(|(what, bytes)| budget.reserve(what, *bytes)).collect()
    }
}

/// What a thread takes that writes the picture.
fn writing(demand: &Demand) -> u64 {
    u64::from(demand.width) * WRITING_PER_COLUMN + WRITING_FIXED
}

/// The transfer function of a scene: as it is, as the picture has it, and for packets, of which new ones
/// are made beside those that are there.
fn transfer_bytes(knots: usize) -> u64 {
    4 * TransferPieces::bytes(knots) + 2 * TransferTable::bytes(knots)
}

fn fixed_parts(demand: &Demand) -> Vec<(&'static str, u64)> {
    let Demand { threads, readers, .. } = *demand;
    let thread = STACK_TOUCHED.saturating_add(demand.scratch);
    vec![
        ("the picture", Film::bytes_needed(demand.width, demand.height)),
        ("the tiles' errors", demand.tiles.saturating_mul(TILE_BYTES)),
        ("writing the picture", writing(demand)),
        ("the marching threads", threads.saturating_mul(thread.saturating_add(demand.tile))),
        ("the reading threads", readers.saturating_mul(thread)),
        ("the index' checksums", demand.page_table),
        ("the counters", Counters::bytes(demand.bricks)),
        ("the transfer function", demand.transfer),
    ]
}

fn too_small(limit: u64, fewest: u64, threads: u64) -> Error {
    let mebibytes = fewest.div_ceil(MEBIBYTE);
    let limit = size(limit);
    let advice = if threads > 1 { " (or use fewer --threads)" } else { "" };
    Error::request(format!(
        "--memory {limit} is too small for this picture: the smallest that works is \
         {mebibytes}MiB{advice}"
    ))
}

/// As many threads as there are `cores`, if what they need at least leaves half of the limit to more
/// bricks; two or one where they have room.
fn most_threads(cores: usize, limit: u64, demand: impl Fn(usize) -> Demand) -> usize {
    let fits = |threads: usize, limit| MemoryPlan::from_demand(&demand(threads), limit).is_ok();
    // All bricks have room beforehand, or there is no picture.
    let room = if demand(1).resident { limit } else { limit / 2 };
    let many = (3..=cores).rev().find(|&threads| fits(threads, room));
    many.unwrap_or(if cores > 1 && fits(2, limit) { 2 } else { 1 })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn demand() -> impl Strategy<Value = Demand> {
        let picture = (1u32..5000, 1u32..5000, 1u64..65, 1u64..70);
        let cache = (1u64..1 << 40, 0u64..100_000, 1u64..1 << 22, 1u64..1 << 22, any::<bool>());
        (picture, cache).prop_map(|((width, height, threads, levels), cache)| Demand {
            width,
            height,
            tiles: u64::from(width / 8),
            threads,
            readers: threads.min(4),
            levels,
            bricks: cache.0,
            transfer: cache.2,
            index_windows: cache.1,
            page_table: cache.1 * 32,
            scratch: cache.2,
            tile: cache.2 / 2,
            slot: cache.3,
            thinned: cache.3 / 4,
            resident: cache.4,
        })
    }

    fn named(error: &Error) -> u64 {
        let text = error.to_string();
        let number = text.split("works is ").nth(1).and_then(|rest| rest.split("MiB").next());
        number.unwrap().parse().unwrap()
    }

    #[test]
    fn threads_are_as_many_as_the_limit_has_room_for() {
        let demand = |threads: usize| Demand {
            threads: threads as u64,
            readers: threads.min(MAX_READERS) as u64,
            width: 1920,
            height: 1080,
            tiles: 510,
            levels: 14,
            bricks: 100_000,
            transfer: 2 << 20,
            index_windows: 100,
            page_table: 3200,
            scratch: 1 << 20,
            tile: 8 << 20,
            slot: 200 << 10,
            thinned: 50 << 10,
            resident: false,
        };
        let most = |cores: usize, mebibytes: u64| most_threads(cores, mebibytes << 20, demand);
        assert_eq!([most(1, 4096), most(2, 4096), most(16, 4096)], [1, 2, 16]);
        let many = most(128, 1024);
        assert!((16..64).contains(&many), "{many}");
        assert_eq!(most(128, 1), 1);
        assert!(MemoryPlan::from_demand(&demand(many), 512 << 20).is_ok());
        let named = |threads| {
            MemoryPlan::from_demand(&demand(threads), 1).map(|_| ()).unwrap_err().to_string()
        };
        assert!(named(2).starts_with("--memory 1B is too small for this picture: "));
        assert!(named(2).ends_with("MiB (or use fewer --threads)") && named(1).ends_with("MiB"));
    }

    proptest! {
        #[test]
        fn the_smallest_limit_is_named_and_works(demand in demand(), limit in 0u64..1 << 30) {
            let smallest = named(&MemoryPlan::from_demand(&demand, 0).unwrap_err());
            let least = MemoryPlan::from_demand(&demand, smallest * MEBIBYTE).unwrap();
            let below = MemoryPlan::from_demand(&demand, (smallest - 1) * MEBIBYTE).unwrap_err();
            prop_assert_eq!(named(&below), smallest);
            let pins = usize::try_from(demand.threads * (demand.levels + 1) + demand.readers);
            let bricks = usize::try_from(demand.bricks).unwrap();
            let different = if demand.resident { bricks } else { FORMS * bricks };
            let fewest = if demand.resident { bricks } else { pins.unwrap().min(different) };
            prop_assert!(least.slots >= fewest);
            match MemoryPlan::from_demand(&demand, limit) {
                Ok(plan) => {
                    let budget = Budget::new(limit);
                    let held = plan.reserve(&budget).unwrap();
                    let sum: u64 = held.iter().map(Reservation::bytes).sum();
                    prop_assert!(sum + budget.available() == limit);
                    // A byte more may go to a window or to thinner bricks in place of a slot.
                    prop_assert!(plan.slots >= fewest && plan.slots <= different);
                    let all = plan.slots == different;
                    prop_assert!(all || budget.available() < demand.slot + MEBIBYTE);
                }
                Err(error) => {
                    prop_assert_eq!(named(&error), smallest);
                    prop_assert!(limit < smallest * MEBIBYTE);
                }
            }
        }
    }
}
