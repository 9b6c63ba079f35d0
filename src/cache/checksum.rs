//! Checksums: XXH3, 64 bits (Collet, github.com/Cyan4973/xxHash).

/// Computes what [`checksum`] does of bytes that come in pieces.
pub(super) use xxhash_rust::xxh3::Xxh3Default as Checksum;
use xxhash_rust::xxh3::{xxh3_64, xxh3_64_with_seed};

/// Checksum of `bytes`.
pub(super) fn checksum(bytes: &[u8]) -> u64 {
    xxh3_64(bytes)
}

/// Checksum of `bytes` that also names their place, so that two sound pieces that changed places
/// are found.
pub(super) fn checksum_at(place: u64, bytes: &[u8]) -> u64 {
    xxh3_64_with_seed(bytes, place)
}

/// What the checksum of a payload's part is seeded with: its brick and field, and which part.
pub(super) fn payload_place(node: u64, field: usize, part: usize) -> u64 {
    node.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ field as u64 ^ (part as u64) << 32
}
