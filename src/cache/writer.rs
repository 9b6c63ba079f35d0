//! Writing a cache: payloads as they come, then the index, then the header.

use std::io::{Seek, SeekFrom, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use super::bytes::ByteWriter;
use super::checksum::{checksum, checksum_at, payload_place};
use super::codec::Payload;
use super::digits::PARTS;
use super::header::{Header, MAX_HEADER_BYTES, PREFIX_BYTES};
use super::index::{PAGE_BYTES, record_bytes, records_per_page};
use super::record::{FieldRecord, NodeRecord};
use crate::atomic_file::AtomicFile;
use crate::{Error, Result};

/// Writes one cache. Nothing stands at the target before [`Writer::finish`]; dropped before
/// that, nothing is left.
pub struct Writer {
    target: PathBuf,
    file: AtomicFile,
    header_bytes: u64,
    end: u64,
    /// Payloads' first parts, second ones and so on.
    streams: [Stream; PARTS],
}

/// Parts of many payloads, one after another, written as runs: so those that a reader in fewer digits
/// leaves out do not lie between those that it reads, and each call and page of the file is used well.
#[derive(Default)]
struct Stream {
    /// What is to be written next.
    buffer: Vec<u8>,
    /// Bytes before those.
    written: u64,
    /// For each run how many bytes of the stream are before it, and where it lies in the file.
    runs: Vec<[u64; 2]>,
}

impl Stream {
    /// Where byte `at` of the stream lies in the file.
    fn place(&self, at: u64) -> u64 {
        let run = self.runs.partition_point(|run| run[0] <= at).checked_sub(1);
        run.map_or(0, |run| self.runs[run][1] + (at - self.runs[run][0]))
    }
}

/// Bytes of a run that parts fit into.
const RUN: usize = 512 << 10;

impl Writer {
    /// Begins the cache at `target` in `file`. `header` must have its final levels and fields:
    /// their number and names fix where payloads begin.
    ///
    /// # Errors
    /// What the system says.
    pub fn new(target: &Path, file: AtomicFile, header: &Header) -> Result<Self> {
        let header_bytes = header.to_bytes().len() as u64;
        if header_bytes > u64::from(MAX_HEADER_BYTES) {
            let reason = "fields have names that are too long for one cache; ingest fewer of them";
            return Err(Error::request(reason));
        }
        let mut writer = Self {
            target: target.to_path_buf(),
            file,
            header_bytes,
            end: header_bytes,
            streams: Default::default(),
        };
        writer.seek(header_bytes)?;
        Ok(writer)
    }

    /// Takes the stored payload of field `field` of brick `node`; its checksums and lengths, how far
    /// values in fewer digits are off, and where its parts lie in their streams go into `record`.
    /// Where that is in the file, [`Self::finish`] knows.
    ///
    /// # Errors
    /// What the system says, a full disk included.
    pub fn payload(
        &mut self,
        node: u64,
        field: usize,
        payload: &Payload,
        record: &mut FieldRecord,
    ) -> Result<()> {
        record.errors = payload.errors;
        for (part, stored) in payload.parts.iter().enumerate().filter(|(_, p)| !p.is_empty()) {
            if self.streams[part].buffer.len() + stored.len() > RUN {
                self.end_run(part)?;
            }
            let stream = &mut self.streams[part];
            record.offsets[part] = stream.written + stream.buffer.len() as u64;
            stream.buffer.extend_from_slice(stored);
            record.checksums[part] = checksum_at(payload_place(node, field, part), stored);
            record.lengths[part] = u32::try_from(stored.len()).map_err(|_| {
                Error::invalid(self.target.display(), "a payload is longer than 4 GiB")
            })?;
        }
        Ok(())
    }

    fn end_run(&mut self, part: usize) -> Result<()> {
        let mut bytes = std::mem::take(&mut self.streams[part].buffer);
        let stream = &mut self.streams[part];
        if !bytes.is_empty() {
            stream.runs.push([stream.written, self.end]);
            stream.written += bytes.len() as u64;
        }
        self.write(&bytes)?;
        bytes.clear();
        self.streams[part].buffer = bytes;
        Ok(())
    }

    /// Writes the index (all bricks' records in the order of their numbers, through `records`)
    /// and the header, whose offsets and checksums are filled in here, and puts the file in its
    /// place.
    ///
    /// # Errors
    /// What `records` or the system says.
    pub fn finish(
        mut self,
        mut header: Header,
        mut records: impl FnMut(u64, &mut Vec<FieldRecord>) -> Result<NodeRecord>,
    ) -> Result<Header> {
        let page_bytes = PAGE_BYTES as u64;
        (0..PARTS).try_for_each(|part| self.end_run(part))?;
        header.index_offset = self.end.next_multiple_of(page_bytes);
        let padding = usize::try_from(header.index_offset - self.end).unwrap_or(0);
        self.write(&vec![0; padding])?;
        let per_page = records_per_page(header.fields.len()) as u64;
        let nodes = header.nodes();
        header.index_pages = nodes.div_ceil(per_page);
        let mut table = ByteWriter::default();
        for page in 0..header.index_pages {
            let members = page * per_page..nodes.min((page + 1) * per_page);
            let bytes = self.page_of(members, header.fields.len(), &mut records)?;
            self.write(&bytes)?;
            table.u64(checksum_at(page, &bytes));
        }
        self.write(&table.bytes)?;
        header.page_table_checksum = checksum(&table.bytes);
        header.file_bytes =
            header.index_offset + header.index_pages * page_bytes + table.bytes.len() as u64;
        self.put_header(&mut header)?;
        self.file.commit()?;
        Ok(header)
    }

    fn put_header(&mut self, header: &mut Header) -> Result<()> {
        let bytes = header.to_bytes();
        if bytes.len() as u64 != self.header_bytes {
            return Err(Error::invalid(self.target.display(), "the header changed its length"));
        }
        header.checksum = checksum(&bytes[PREFIX_BYTES..]);
        self.file
            .file()
            .write_all_at(&bytes, 0)
            .map_err(|source| Error::io(&self.target, "cannot write the cache", source))
    }

    fn seek(&mut self, to: u64) -> Result<()> {
        let mut file = self.file.file();
        file.seek(SeekFrom::Start(to))
            .map_err(|source| Error::io(&self.target, "cannot write the cache", source))?;
        Ok(())
    }

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        let mut file = self.file.file();
        file.write_all(bytes)
            .map_err(|source| Error::io(&self.target, "cannot write the cache", source))?;
        self.end += bytes.len() as u64;
        Ok(())
    }

    fn page_of(
        &self,
        members: std::ops::Range<u64>,
        fields: usize,
        records: &mut impl FnMut(u64, &mut Vec<FieldRecord>) -> Result<NodeRecord>,
    ) -> Result<Vec<u8>> {
        let mut page = ByteWriter::default();
        page.bytes.reserve_exact(PAGE_BYTES);
        let mut of_fields = Vec::with_capacity(fields);
        for node in members {
            of_fields.clear();
            records(node, &mut of_fields)?.write(&mut page);
            of_fields.iter().for_each(|record| self.placed(record).write(&mut page));
        }
        debug_assert!(page.bytes.len() % record_bytes(fields) == 0);
        page.bytes.resize(PAGE_BYTES, 0);
        Ok(page.bytes)
    }

    /// `record` with its parts' places in the file.
    fn placed(&self, record: &FieldRecord) -> FieldRecord {
        let place = |part: usize| {
            let is_there = record.lengths[part] > 0;
            if is_there { self.streams[part].place(record.offsets[part]) } else { 0 }
        };
        FieldRecord { offsets: std::array::from_fn(place), ..*record }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_of_a_stream_are_found_in_the_run_that_holds_them() {
        let runs = vec![[0, 100], [10, 500], [30, 200]];
        let stream = Stream { runs, ..Stream::default() };
        for (at, place) in [(0, 100), (9, 109), (10, 500), (29, 519), (30, 200), (31, 201)] {
            assert_eq!(stream.place(at), place);
        }
    }
}
