//! Byte-level codecs: checked reading, varints, bincode, zstd and the two entropy coders.
//!
//! Within this crate, only these modules call the `bincode` and `zstd` crates.

pub mod bincode;
pub(crate) mod byte_reader;
pub mod object_names;
pub mod range;
pub(crate) mod rans;
pub mod varint;
pub mod zstd;

/// CRC-32 (IEEE 802.3), the checksum of tiles and mesh files.
pub fn checksum(bytes: &[u8]) -> u32 {
    crc32fast::hash(bytes)
}
