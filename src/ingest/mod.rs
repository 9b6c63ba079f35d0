//! Simulation output → brick cache, in three passes and within a memory limit:
//!
//! 1. `overlaps.rs` reads boxes only and sorts which grids lie in which bricks;
//! 2. `build.rs` assembles bricks from the finest level to the root, averaging children;
//! 3. `complete.rs` adds ghosts and ancestors' blocks, compresses, and writes the index.
//!
//! Between passes everything lies in nameless temporary files beside the target.

mod advice;
mod assemble;
mod build;
mod cells;
mod complete;
mod drafts;
mod gather;
mod header;
mod load_cache;
mod morton;
mod neighbourhood;
mod overlaps;
mod packed;
mod plan;
mod progress;
mod range;
mod residual;
mod sort;
mod spool;
mod store;
mod tally;
mod target;
mod upward;

use std::path::Path;

use crate::atomic_file::AtomicFile;
use crate::cache::{BrickShape, Header, MAX_FIELDS};
use crate::source::{Source, has_covered_cells};
use crate::space::{AXES, Decimal, Domain, FRACTION_BITS, IndexBox, MAX_OCTREE_LEVEL};
use crate::spelling::{nearest_first, position};
use crate::{Error, Result};

use assemble::{Assembler, Rules};
use build::Built;
use cells::SourceCells;
pub use cells::chunks;
use complete::{Completion, Spare};
use header::header;
use overlaps::{CUBE_EDGE, Layout};
pub use plan::DEFAULT_MEMORY;
use plan::{Plan, Shares};
pub use progress::{Progress, Stage};
pub use target::{refuse_files_of, refuse_source_files};

/// What to ingest, and how.
#[derive(Debug, Clone)]
pub struct Options {
    /// Names of the fields, without regard to case unless only that tells two apart; empty: the
    /// density, or else the only field.
    pub fields: Vec<String>,
    /// Limit of the process' memory, bytes.
    pub memory: u64,
    /// Threads at most; none: one a core.
    pub threads: Option<usize>,
    /// Simulation levels deeper than this are left out.
    pub max_level: Option<u32>,
    /// Largest relative error of a stored value; 0: lossless.
    pub relative_error: f64,
    /// Leaf cells below this value are dropped.
    pub drop_below: Option<f64>,
    /// Only leaf cells that reach into this box (code length, lower and upper corner) are kept.
    pub region: Option<[[Decimal; 3]; 2]>,
    /// Cells along a brick's edge; none: chosen by cost.
    pub brick: Option<u32>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            fields: Vec::new(),
            memory: DEFAULT_MEMORY,
            threads: None,
            max_level: None,
            relative_error: 0.0,
            drop_below: None,
            region: None,
            brick: None,
        }
    }
}

/// Writes the cache of `source` to `target`; its header.
///
/// # Errors
/// Anything wrong with the source, the options or the target. Nothing stands at the target then
/// that did not before.
pub fn ingest(
    source: &dyn Source,
    target: &Path,
    options: &Options,
    progress: &mut Progress<'_>,
) -> Result<Header> {
    refuse_source_files(source, target)?;
    if options.fields.len() > MAX_FIELDS {
        return Err(Error::request(format!(
            "{} fields are more than the {MAX_FIELDS} that a cache holds: choose fewer with --field",
            options.fields.len()
        )));
    }
    in_pool(options.threads, || {
        let file = AtomicFile::create(target)?;
        let directory = file.directory().to_path_buf();
        let Survey { built, header, shares } =
            survey_in(source, &directory, options, true, progress)?;
        progress.begin(Stage::Write, header.nodes());
        let completion = Completion {
            store: &built.store,
            batch: shares.completed,
            memory: shares.stored_bricks,
            scratch: Spare::default(),
            header,
            target,
            directory: &directory,
        };
        within(shares.threads, || completion.run(file, progress))
    })
}

/// What a cache of `source` would hold, without writing one: everything in its header but the
/// places of things. Temporary files go to `directory`.
///
/// # Errors
/// Anything wrong with the source or the options, and temporary files that cannot be written.
pub fn survey(
    source: &dyn Source,
    directory: &Path,
    options: &Options,
    progress: &mut Progress<'_>,
) -> Result<Header> {
    in_pool(options.threads, || Ok(survey_in(source, directory, options, false, progress)?.header))
}

/// Runs `run` on `threads` threads, or on as many as there are cores.
///
/// # Errors
/// Threads that cannot be started, and what `run` returns.
pub fn in_pool<T: Send>(
    threads: Option<usize>,
    run: impl FnOnce() -> Result<T> + Send,
) -> Result<T> {
    let mut builder = rayon::ThreadPoolBuilder::new();
    if let Some(threads) = threads {
        builder = builder.num_threads(threads.max(1));
    }
    let pool = builder
        .build()
        .map_err(|error| Error::request(format!("cannot start threads: {error}")))?;
    pool.install(run)
}

/// Runs `run` on `threads` threads of those there are.
fn within<T: Send>(threads: usize, run: impl FnOnce() -> Result<T> + Send) -> Result<T> {
    if threads < rayon::current_num_threads() { in_pool(Some(threads), run) } else { run() }
}

/// Passes 1 and 2.
struct Survey {
    built: Built,
    header: Header,
    shares: Shares,
}

fn survey_in(
    source: &dyn Source,
    directory: &Path,
    options: &Options,
    keep_cells: bool,
    progress: &mut Progress<'_>,
) -> Result<Survey> {
    let hierarchy = source.hierarchy();
    let fields = choose_fields(source, &options.fields)?;
    let plan = Plan::new(options.memory)?;
    check_levels(source, options.max_level)?;
    let rules = rules(options, &hierarchy.domain)?;
    progress.begin(Stage::Hierarchy, 0);
    let layout = overlaps::lay_out(source, fields[0], options.max_level, directory, plan.sort())?;
    let (shape, shares) = choose_shape(&layout, options.brick, &plan, fields.len())?;
    let assembler = Assembler {
        cells: SourceCells::new(source, &layout.grids, &fields, shares.source_cells),
        shape,
        root_cells: hierarchy.domain.root_cells(),
        fields: fields.len(),
        rules,
        place: source.path().display().to_string(),
        has_covered_cells: has_covered_cells(source.format()),
        keeps_cells: keep_cells,
    };
    progress.begin(Stage::Cells, layout.cubes[shape.edge().trailing_zeros() as usize - 3]);
    let (batch, domain) = (shares.assembled, &hierarchy.domain);
    let built = within(shares.threads, || {
        build::build(&layout, &assembler, domain, directory, batch, progress)
    })?;
    let header = header(source, &fields, shape, &layout, &built);
    if keep_cells {
        check_spans(source, &fields, &header, &built.tallies)?;
    }
    Ok(Survey { built, header, shares })
}

/// Values beyond f32's largest are stored as parts of the field's largest: small ones, which f32 itself
/// would hold, must not be lost by that.
fn check_spans(
    source: &dyn Source,
    fields: &[usize],
    header: &Header,
    tallies: &[tally::Tally],
) -> Result<()> {
    for ((field, tally), number) in header.fields.iter().zip(tallies).zip(fields) {
        if field.exponent > 0 && tally.smallest_magnitude < field.least_exact() {
            return Err(Error::not_supported(
                source.path().display(),
                format!(
                    "field `{name}`: magnitudes from {:.1e} to {:.1e} are more than 32-bit floats hold \
                     side by side: if the largest only mark cells, {}",
                    tally.smallest_magnitude,
                    field.min.abs().max(field.max.abs()),
                    advice::to_limit(source, *number, |values| format!("min({values}, 1e30)")),
                    name = field.name.escape_debug(),
                ),
            ));
        }
    }
    Ok(())
}

/// Levels can be left out only where coarser ones have values in their place.
fn check_levels(source: &dyn Source, max_level: Option<u32>) -> Result<()> {
    let deepest = source.hierarchy().levels.count().saturating_sub(1);
    match max_level {
        Some(most) if (most as usize) < deepest && !has_covered_cells(source.format()) => {
            Err(Error::request(format!(
                "--max-level {most}: of {} outputs only blocks that are not refined further have \
                 values, so none of the {deepest} levels can be left out: leave the option out, and \
                 let --tolerance choose levels",
                source.format()
            )))
        }
        _ => Ok(()),
    }
}

/// Bricks of the edge that is asked for, or else that costs least; smaller ones where memory has no
/// room for these.
fn choose_shape(
    layout: &Layout,
    asked: Option<u32>,
    plan: &Plan,
    fields: usize,
) -> Result<(BrickShape, Shares)> {
    let threads = rayon::current_num_threads();
    if let Some(edge) = asked {
        let shape = BrickShape::new(edge)?;
        return Ok((shape, plan.shares(threads, shape, fields)?));
    }
    let mut shape = overlaps::choose_shape(layout.cubes)?;
    loop {
        match plan.shares(threads, shape, fields) {
            Ok(shares) => return Ok((shape, shares)),
            Err(_) if shape.edge() > CUBE_EDGE as usize => shape = shape.coarser(),
            Err(error) => return Err(error),
        }
    }
}

fn choose_fields(source: &dyn Source, names: &[String]) -> Result<Vec<usize>> {
    let hierarchy = source.hierarchy();
    // The nearest to what was asked for comes first.
    let known = |name: &str| {
        nearest_first(name, hierarchy.fields.iter().map(|f| f.name.as_str())).join(", ")
    };
    if names.is_empty() {
        let only = (hierarchy.fields.len() == 1).then_some(0);
        return hierarchy.density.or(only).map(|field| vec![field]).ok_or_else(|| {
            Error::request(format!(
                "{}: no density field: choose with --field from {}",
                source.path().display(),
                known("density")
            ))
        });
    }
    let mut chosen = Vec::new();
    for name in names {
        let field = position(name, hierarchy.fields.iter().map(|f| f.name.as_str()));
        let field = field.ok_or_else(|| {
            Error::request(format!(
                "{}: no field `{}`{}: there are {}",
                source.path().display(),
                name.escape_debug(),
                if name.contains(',') { " (for several repeat --field)" } else { "" },
                known(name)
            ))
        })?;
        if !chosen.contains(&field) {
            chosen.push(field);
        }
    }
    Ok(chosen)
}

fn rules(options: &Options, domain: &Domain) -> Result<Rules> {
    if !(0.0..1.0).contains(&options.relative_error) {
        return Err(Error::request(format!(
            "--error {}: a relative error of at least 0 and below 1 is needed",
            options.relative_error
        )));
    }
    if options.drop_below.is_some_and(f64::is_nan) {
        return Err(Error::request("--drop-below NaN: a number is needed"));
    }
    let region = options.region.as_ref().map(|corners| region(corners, domain)).transpose()?;
    let relative_error = options.relative_error;
    Ok(Rules { drop_below: options.drop_below, region, relative_error })
}

/// The region in cells of the deepest octree level, rounded outward.
fn region(corners: &[[Decimal; 3]; 2], domain: &Domain) -> Result<IndexBox> {
    let named = |error: Error| Error::request(format!("--region: {error}"));
    let place = |corner| domain.position(corner).map_err(named);
    let [lo, hi] = [place(&corners[0])?, place(&corners[1])?];
    let shift = FRACTION_BITS - MAX_OCTREE_LEVEL;
    if let Some(a) = (0..3).find(|&a| lo.0[a] >= hi.0[a]) {
        let axis = AXES[a];
        return Err(Error::request(format!(
            "--region: the box has no extent along {axis}: give its lower corner, then its upper one"
        )));
    }
    let region = IndexBox { lo: lo.0.map(|c| c >> shift), hi: hi.0.map(|c| -((-c) >> shift)) };
    let upper = domain.upper().0.map(|c| c >> shift);
    if region.intersection(&IndexBox { lo: [0; 3], hi: upper }).is_empty() {
        return Err(Error::request(
            "--region: the box lies outside the domain: `info` says where that is",
        ));
    }
    Ok(region)
}
