//! Writing a cache: payloads as they come, then the index, then the header.

use std::io::{Seek, SeekFrom, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use super::bytes::ByteWriter;
use super::checksum::{checksum, checksum_at, payload_place};
use super::codec::{PARTS, Payload};
use super::header::Header;
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
    /// What is to be written next: many payloads at a time, as each call costs and so does each page
    /// of the file that is not written whole.
    buffer: Vec<u8>,
}

/// Bytes from which on what waits is written.
const BUFFERED: usize = 256 << 10;

impl Writer {
    /// Begins the cache at `target` in `file`. `header` must have its final levels and fields:
    /// their number and names fix where payloads begin.
    ///
    /// # Errors
    /// What the system says.
    pub fn new(target: &Path, file: AtomicFile, header: &Header) -> Result<Self> {
        let header_bytes = header.to_bytes().len() as u64;
        let mut writer = Self {
            target: target.to_path_buf(),
            file,
            header_bytes,
            end: header_bytes,
            buffer: Vec::new(),
        };
        writer.seek(header_bytes)?;
        Ok(writer)
    }

    /// Appends the stored payload of field `field` of brick `node`; its place, checksums and
    /// lengths, and how far values in fewer digits are off, go into `record`.
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
        let Payload { bytes, ends, errors } = payload;
        self.write(bytes)?;
        let too_long = || Error::invalid(self.target.display(), "a payload is longer than 4 GiB");
        for (end, place) in ends.iter().zip(&mut record.ends) {
            *place = u32::try_from(*end).map_err(|_| too_long())?;
        }
        (record.offset, record.errors) = (self.end, *errors);
        for part in 0..PARTS {
            let stored = &bytes[record.part(part)];
            let place = payload_place(node, field, part);
            record.checksums[part] = if stored.is_empty() { 0 } else { checksum_at(place, stored) };
        }
        self.end += bytes.len() as u64;
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
        header.index_offset = self.end.next_multiple_of(page_bytes);
        let padding = usize::try_from(header.index_offset - self.end).unwrap_or(0);
        self.write(&vec![0; padding])?;
        let per_page = records_per_page(header.fields.len()) as u64;
        let nodes = header.nodes();
        header.index_pages = nodes.div_ceil(per_page);
        let mut table = ByteWriter::default();
        for page in 0..header.index_pages {
            let members = page * per_page..nodes.min((page + 1) * per_page);
            let bytes = page_of(members, header.fields.len(), &mut records)?;
            self.write(&bytes)?;
            table.u64(checksum_at(page, &bytes));
        }
        self.write(&table.bytes)?;
        header.page_table_checksum = checksum(&table.bytes);
        header.file_bytes =
            header.index_offset + header.index_pages * page_bytes + table.bytes.len() as u64;
        self.flush()?;
        self.put_header(&mut header)?;
        self.file.commit()?;
        Ok(header)
    }

    fn put_header(&mut self, header: &mut Header) -> Result<()> {
        let bytes = header.to_bytes();
        if bytes.len() as u64 != self.header_bytes {
            return Err(Error::invalid(self.target.display(), "the header changed its length"));
        }
        header.checksum = checksum(&bytes[super::header::PREFIX_BYTES..]);
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
        if self.buffer.len() + bytes.len() > BUFFERED {
            self.flush()?;
        }
        self.buffer.extend_from_slice(bytes);
        Ok(())
    }

    fn flush(&mut self) -> Result<()> {
        let mut file = self.file.file();
        file.write_all(&self.buffer)
            .map_err(|source| Error::io(&self.target, "cannot write the cache", source))?;
        self.buffer.clear();
        Ok(())
    }
}

fn page_of(
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
        of_fields.iter().for_each(|record| record.write(&mut page));
    }
    debug_assert!(page.bytes.len() % record_bytes(fields) == 0);
    page.bytes.resize(PAGE_BYTES, 0);
    Ok(page.bytes)
}
