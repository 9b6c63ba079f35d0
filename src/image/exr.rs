//! OpenEXR files.

use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::Path;
use std::thread::{Builder, ScopedJoinHandle};

use exr::block::chunk::{Chunk, CompressedBlock, CompressedScanLineBlock};
use exr::compression::Compression;
use exr::error::Error as ExrError;
use exr::math::Vec2;
use exr::meta::attribute::{
    self, AttributeValue, ChannelDescription, Chromaticities, LineOrder, SampleType, Text,
};
use exr::meta::header::Header;
use exr::meta::{BlockDescription, MetaData, magic_number, sequence_end};

use super::zip;
use crate::atomic_file::AtomicFile;
use crate::render::{Film, MOST_WRITERS};
use crate::{Error, Result};

/// The channels as the format wants them, by name, each with its place in a pixel.
const CHANNELS: [(&str, usize); 4] = [("A", 3), ("B", 2), ("G", 1), ("R", 0)];
/// Widest picture (pixels) whose rows are compressed 16 together: compressing takes up to four
/// times a block of 16 bytes a pixel.
const WIDEST_IN_BLOCKS: u32 = 4096;
/// What the channels R, G and B are, as programs that convert colours ask: the primaries and the white
/// of Rec. 709, CIE x and y (ITU-R BT.709-6, table 1), in which colour maps are given.
const PRIMARIES: Chromaticities = Chromaticities {
    red: Vec2(0.64, 0.33),
    green: Vec2(0.3, 0.6),
    blue: Vec2(0.15, 0.06),
    white: Vec2(0.3127, 0.329),
};

/// The stack of a thread that compresses, bytes.
const STACK_BYTES: usize = 1 << 20;
/// Longest attribute name that every reader takes (bytes).
const MAX_NAME: usize = 31;

/// Writes `film` to `file`: scan lines of R, G, B, A as 32-bit floats under ZIP compression, with
/// `attributes` (name, UTF-8 text) in their order. Equal films and attributes give equal bytes.
///
/// Blocks of 16 rows (wide pictures: single rows) are compressed on up to `threads` threads, one on
/// each, [`MOST_WRITERS`] at most: beyond the film, it takes a few MiB of memory for each. The header
/// is assembled here because the `exr` crate orders custom attributes by chance, so that files would
/// differ from run to run.
///
/// # Errors
/// The system's, as a full disk, and attribute names that the format does not take; nothing is left
/// there then.
pub fn write_exr(
    file: AtomicFile,
    film: &Film,
    attributes: &[(String, String)],
    threads: usize,
) -> Result<()> {
    check_names(attributes)?;
    let mut writer = BufWriter::new(file.file());
    let threads = threads.clamp(1, MOST_WRITERS);
    write_image(&mut writer, film, attributes, threads)
        .map_err(|error| failure(file.target(), error))?;
    drop(writer);
    file.commit()
}

fn failure(path: &Path, error: ExrError) -> Error {
    match error {
        ExrError::Io(error) => Error::io(path, "cannot write the picture", error),
        other => Error::invalid(path.display(), format!("cannot write the picture: {other}")),
    }
}

fn check_names(attributes: &[(String, String)]) -> Result<()> {
    for (index, (name, value)) in attributes.iter().enumerate() {
        let repeated = attributes[..index].iter().any(|(earlier, _)| earlier == name);
        let fits = (1..=MAX_NAME).contains(&name.len()) && i32::try_from(value.len()).is_ok();
        if repeated || !fits || name.bytes().any(|byte| !byte.is_ascii_graphic()) {
            return Err(Error::request(format!(
                "EXR attribute `{}`: names are unique, of 1 to {MAX_NAME} ASCII letters, and texts \
                 below 2 GiB",
                name.escape_debug()
            )));
        }
    }
    Ok(())
}

fn write_image<W: Write + Seek>(
    writer: &mut W,
    film: &Film,
    attributes: &[(String, String)],
    threads: usize,
) -> exr::error::Result<()> {
    let headers = [header(film)];
    write_header(writer, &headers, attributes)?;
    let table_start = writer.stream_position()?;
    let mut offsets = vec![0_u64; headers[0].chunk_count];
    write_offsets(writer, &offsets)?;
    for (batch, offsets) in offsets.chunks_mut(threads).enumerate() {
        let first = batch * threads;
        for (chunk, offset) in
            compressed(&headers[0], film, first..first + offsets.len()).into_iter().zip(offsets)
        {
            *offset = writer.stream_position()?;
            chunk?.write(writer, headers.len())?;
        }
    }
    writer.seek(SeekFrom::Start(table_start))?;
    write_offsets(writer, &offsets)?;
    Ok(writer.flush()?)
}

/// Blocks of rows, each compressed on a thread of its own; the first on this one.
fn compressed(
    header: &Header,
    film: &Film,
    mut blocks: Range<usize>,
) -> Vec<exr::error::Result<Chunk>> {
    let compress = |index: usize| block(header, film, index);
    let Some(first) = blocks.next() else { return Vec::new() };
    std::thread::scope(|scope| {
        let others: Vec<_> = blocks
            .map(|index| {
                let thread = Builder::new().stack_size(STACK_BYTES);
                (index, thread.spawn_scoped(scope, move || compress(index)))
            })
            .collect();
        let first = std::iter::once(compress(first));
        // Where the system grants no more threads, this one does it.
        let others =
            others.into_iter().map(|(index, thread)| match thread.map(ScopedJoinHandle::join) {
                Ok(Ok(chunk)) => chunk,
                Ok(Err(panic)) => std::panic::resume_unwind(panic),
                Err(_) => compress(index),
            });
        first.chain(others).collect()
    })
}

fn header(film: &Film) -> Header {
    // `pLinear` is for channels that are no light, as hue is: 0 for R, G, B and A.
    let channel = |(name, _)| ChannelDescription::new(Text::from(name), SampleType::F32, false);
    let size = Vec2(film.width() as usize, film.height() as usize);
    let channels = CHANNELS.into_iter().map(channel).collect();
    let compression =
        if film.width() <= WIDEST_IN_BLOCKS { Compression::ZIP16 } else { Compression::ZIP1 };
    Header::new(Text::from("main"), size, channels).with_encoding(
        compression,
        BlockDescription::ScanLines,
        LineOrder::Increasing,
    )
}

fn write_header(
    writer: &mut impl Write,
    headers: &[Header; 1],
    attributes: &[(String, String)],
) -> exr::error::Result<()> {
    let requirements = MetaData::validate(headers, true)?;
    magic_number::write(writer)?;
    requirements.write(writer)?;
    for (name, value) in headers[0].all_named_attributes() {
        attribute::write(name, &value, writer)?;
    }
    attribute::write(b"chromaticities", &AttributeValue::Chromaticities(PRIMARIES), writer)?;
    for (name, value) in attributes {
        let text = AttributeValue::Text(Text::from_slice_unchecked(value.as_bytes()));
        attribute::write(name.as_bytes(), &text, writer)?;
    }
    sequence_end::write(writer)
}

/// The table of the blocks' file offsets, from the top.
fn write_offsets(writer: &mut impl Write, offsets: &[u64]) -> std::io::Result<()> {
    offsets.iter().try_for_each(|offset| writer.write_all(&offset.to_le_bytes()))
}

/// Block `index` from the top, of as many rows as the compression takes together.
fn block(header: &Header, film: &Film, index: usize) -> exr::error::Result<Chunk> {
    let rows = header.compression.scan_lines_per_block();
    let top = index * rows;
    let width = film.width() as usize;
    let end = film.pixels().len().min((top + rows) * width);
    let pixels = &film.pixels()[top * width..end];
    let mut samples = Vec::with_capacity(size_of_val(pixels));
    for row in pixels.chunks_exact(width) {
        for (_, channel) in CHANNELS {
            samples.extend(row.iter().flat_map(|pixel| pixel[channel].to_le_bytes()));
        }
    }
    let y_coordinate = i32::try_from(top).map_err(std::io::Error::other)?;
    let block =
        CompressedScanLineBlock { y_coordinate, compressed_pixels_le: zip::compress(samples)? };
    Ok(Chunk { layer_index: 0, compressed_block: CompressedBlock::ScanLine(block) })
}
