//! Opening a cache and reading its bricks.

use std::fs::File;
#[cfg(target_os = "linux")]
use std::num::NonZeroU64;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

#[cfg(target_os = "linux")]
use rustix::fs::{Advice, fadvise};

use super::brick::{BrickPlace, RawBrick};
use super::bytes::ByteReader;
use super::check::{check_brick, marks_outside};
use super::checksum::{Checksum, checksum, checksum_at, payload_place};
use super::codec::{Decoder, can_be_stored};
use super::digits::Precision;
use super::header::{Header, MAGIC, MAX_HEADER_BYTES, PREFIX_BYTES, VERSION};
use super::index::{Cursor, Index};
use super::record::{BrickEntry, FieldRecord};
use crate::{Error, Result, regular_file};

/// An open cache. Opening reads the header and the table of page checksums, nothing else.
pub struct Cache {
    file: File,
    path: PathBuf,
    header: Header,
    header_bytes: u64,
    index: Index,
}

impl Cache {
    /// Opens the cache at `path`, mapping at most `index_windows` windows of its index
    /// ([`super::WINDOW_BYTES`] each) at a time.
    ///
    /// # Errors
    /// A file that is no cache, is of another version, truncated or damaged.
    pub fn open(path: &Path, index_windows: usize) -> Result<Self> {
        let failed = |source| Error::io(path, "cannot read the cache", source);
        if path.is_dir() {
            let reason = "is a folder, not a deepfield cache: make one with `deepfield ingest`";
            return Err(Error::invalid(path.display(), reason));
        }
        let file = regular_file::open(path).map_err(failed)?;
        let length = file.metadata().map_err(failed)?.len();
        let (header, header_bytes) = read_header(&file, path, length)?;
        if length != header.file_bytes {
            let how = if length < header.file_bytes { "truncated" } else { "longer than it says" };
            return Err(Error::invalid(
                path.display(),
                format!(
                    "the cache is {how}: {length} bytes instead of {}; ingest the data again",
                    header.file_bytes
                ),
            ));
        }
        let table = read_page_table(&file, path, &header)?;
        let index_file = file.try_clone().map_err(failed)?;
        let index = Index::new(index_file, path.to_path_buf(), table, index_windows);
        Ok(Self { file, path: path.to_path_buf(), header, header_bytes, index })
    }

    /// Whether the file at `path` begins as a cache does.
    pub fn is_cache(path: &Path) -> bool {
        let mut magic = [0; MAGIC.len()];
        regular_file::open(path)
            .is_ok_and(|file| file.read_exact_at(&mut magic, 0).is_ok() && magic == MAGIC)
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What the cache holds.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Sets how many windows of the index may be mapped at a time: at least
    /// [`Cursor::WINDOWS`] for each cursor, and one more.
    pub fn set_index_windows(&self, windows: usize) {
        self.index.set_limit(windows);
    }

    /// A reader of the index for one thread.
    pub fn cursor(&self) -> Cursor<'_> {
        Cursor::new(&self.index, &self.header)
    }

    /// Most bytes that one [`Decoder`] holds when it reads this cache's bricks.
    pub fn decoder_bytes(&self) -> u64 {
        Decoder::bytes(self.header.shape, usize::from(self.header.max_parent_blocks) + 1)
    }

    /// Bytes before the first payload.
    pub(super) fn header_bytes(&self) -> u64 {
        self.header_bytes
    }

    /// The cache's file, for checks of what no brick owns.
    pub(super) fn file(&self) -> &File {
        &self.file
    }

    /// Tells the system that the payload of `record` will be read soon, so that it may begin to.
    pub fn announce(&self, record: &FieldRecord, precision: Precision) {
        #[cfg(target_os = "linux")]
        for (_, offset, length) in record.parts(precision) {
            // A hint: where it is of no use nothing is lost.
            let _ = fadvise(&self.file, offset, NonZeroU64::new(length as u64), Advice::WillNeed);
        }
    }

    /// Reads the payload of `entry` into `brick`, checked against its checksum, its records and the
    /// tree; of values in fewer digits only what tells these. Says how long the file took.
    ///
    /// # Errors
    /// A payload that cannot be read, is damaged, or contradicts its records.
    pub fn read_brick(
        &self,
        entry: &BrickEntry<'_>,
        precision: Precision,
        decoder: &mut Decoder,
        brick: &mut RawBrick,
    ) -> Result<Duration> {
        let BrickEntry { node, field, node_record, field_record: record } = *entry;
        let damaged = |reason: &str| self.damaged(node, field, reason);
        let shape = self.header.shape;
        let blocks = usize::from(record.parent_blocks) + 1;
        if record.is_void() || !can_be_stored(shape.cells_in_blocks(blocks), record) {
            return Err(damaged("its length is none that a payload has"));
        }
        decoder.stored.iter_mut().for_each(Vec::clear);
        let mut reading = Duration::ZERO;
        for (part, offset, length) in record.parts(precision) {
            if offset < self.header_bytes {
                return Err(damaged("it lies in the header"));
            }
            let stored = &mut decoder.stored[part];
            stored.reserve_exact(length);
            stored.resize(length, 0);
            let started = Instant::now();
            self.file.read_exact_at(stored, offset).map_err(|source| {
                Error::io(&self.path, format!("cannot read brick {node}"), source)
            })?;
            reading += started.elapsed();
            if checksum_at(payload_place(node, field, part), stored) != record.checksums[part] {
                return Err(damaged("its checksum differs"));
            }
        }
        decoder.decode(shape, blocks, brick).map_err(damaged)?;
        if record.error(precision) > 0.0 {
            // Rounding leads beyond the range that all values lie in, though never towards it.
            brick.clamp(record.own);
        }
        check_brick(shape.edge(), node_record, record, brick).map_err(damaged)?;
        Ok(reading)
    }

    /// Checks what [`Self::read_brick`] has read against the place at which the tree has the
    /// brick.
    ///
    /// # Errors
    /// Cells beyond the domain that hold something, or cells inside that are marked as beyond it.
    pub fn check_place(
        &self,
        node: u64,
        field: usize,
        place: &BrickPlace,
        brick: &RawBrick,
    ) -> Result<()> {
        if marks_outside(&self.header, place, brick) {
            return Ok(());
        }
        Err(self.damaged(node, field, "its cells are not marked where the domain ends"))
    }

    fn damaged(&self, node: u64, field: usize, reason: &str) -> Error {
        let level = self.header.levels[self.header.level_of(node)].octree;
        let name = self.header.fields.get(field).map_or("?", |f| f.name.as_str());
        Error::invalid(
            self.path.display(),
            format!(
                "brick {node} (octree level {level}), field {name}, is damaged: {reason}; ingest \
                 the data again"
            ),
        )
    }
}

fn read_header(file: &File, path: &Path, length: u64) -> Result<(Header, u64)> {
    let failed = |source| Error::io(path, "cannot read the header", source);
    let refuse = |reason: &str| Error::invalid(path.display(), reason);
    let mut prefix = [0; PREFIX_BYTES];
    if length < PREFIX_BYTES as u64 {
        return Err(refuse(TOO_SHORT));
    }
    file.read_exact_at(&mut prefix, 0).map_err(failed)?;
    if prefix[..MAGIC.len()] != MAGIC {
        return Err(refuse("not a deepfield cache: make one with `deepfield ingest`"));
    }
    let mut bytes = ByteReader::new(&prefix[MAGIC.len()..]);
    let (Some(version), Some(header_bytes), Some(expected)) =
        (bytes.u32(), bytes.u32(), bytes.u64())
    else {
        return Err(refuse(TOO_SHORT));
    };
    if version != VERSION {
        return Err(Error::not_supported(
            path.display(),
            format!("cache version {version}, this program reads {VERSION}: ingest the data again"),
        ));
    }
    let fits = u64::from(header_bytes) <= length && header_bytes <= MAX_HEADER_BYTES;
    let body_bytes = (header_bytes as usize).checked_sub(PREFIX_BYTES).filter(|_| fits);
    let Some(body_bytes) = body_bytes else {
        return Err(refuse("the cache is truncated or its header damaged: ingest the data again"));
    };
    let mut body = vec![0; body_bytes];
    file.read_exact_at(&mut body, PREFIX_BYTES as u64).map_err(failed)?;
    if checksum(&body) != expected {
        return Err(refuse("the cache's header is damaged (checksum): ingest the data again"));
    }
    let header = Header::from_body(&body, expected)
        .map_err(|why| Error::invalid(path.display(), format!("damaged: {why}")))?;
    if header.index_offset < u64::from(header_bytes) {
        return Err(refuse("damaged: its index lies in its header"));
    }
    Ok((header, u64::from(header_bytes)))
}

const TOO_SHORT: &str = "not a deepfield cache: it is too short: make one with `deepfield ingest`";

/// Bytes of the table of page checksums that are read at a time: whole entries.
const TABLE_PIECE: usize = 64 << 10;

/// The header's check has bounded the table by the file's size.
fn read_page_table(file: &File, path: &Path, header: &Header) -> Result<Vec<u64>> {
    let pages = usize::try_from(header.index_pages).unwrap_or(0);
    let mut table = Vec::new();
    table
        .try_reserve_exact(pages)
        .map_err(|_| Error::invalid(path.display(), "the index is larger than memory"))?;
    let (mut sum, mut piece) = (Checksum::new(), vec![0; TABLE_PIECE.min(8 * pages)]);
    let mut at = header.file_bytes - 8 * header.index_pages;
    while table.len() < pages {
        piece.truncate(8 * (pages - table.len()));
        file.read_exact_at(&mut piece, at)
            .map_err(|source| Error::io(path, "cannot read the table of checksums", source))?;
        sum.update(&piece);
        let words = piece.chunks_exact(8);
        table.extend(words.map(|w| w.try_into().map_or(0, u64::from_le_bytes)));
        at += piece.len() as u64;
    }
    if sum.digest() != header.page_table_checksum {
        return Err(Error::invalid(
            path.display(),
            "the table of index checksums is damaged: ingest the data again",
        ));
    }
    Ok(table)
}
